"""Benchmark of the reuse of certificates: motions of the Panda among MotionBenchMaker's scenes, which change.

./scripts/benchmark reuse --mbm FOLDER                       times of reuse and of certificates from scratch
./scripts/benchmark reuse --mbm FOLDER --changes 100000      also checks the verdicts of random changes
./scripts/benchmark reuse --mbm FOLDER --changes 100000 --docs     rewrites docs/benchmarks/reuse.*

The times take a minute, 100,000 changes some minutes more. Exit code 1 if a verdict is wrong.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import pinproof as pp
from benchmarks.planning_problems import PlanProblem, find_sets, read_problems
from benchmarks.tables import (
    Benchmark,
    Blocks,
    Results,
    Row,
    fastest,
    page_parser,
    provenance,
    quantiles,
    report,
    row_table,
)
from pinproof.collision.certificates.reuse import SetupChange, StoredProof

KINDS = ("moved", "added", "removed")

REPEATS = 3
"""Runs of each measurement, of which the fastest counts: this reduces the influence of other processes."""

TIMED_CHANGES = 12
"""Changes per motion whose times are measured, as many of each kind."""

AUDITED = 25
"""One of this number of FREE verdicts is checked at dense samples by coal."""

AUDIT_STEP = 0.01
"""Largest joint motion (rad or m) between these samples."""

SHOWN = 20
"""Largest number of wrong verdicts that are kept as sentences."""


def stored_motions(problems: Iterator[PlanProblem], seed: int) -> list[StoredProof]:
    """Plan, time and certify a motion for each problem."""
    found = []
    for problem in problems:
        checker = pp.CollisionChecker(problem.group, problem.scene)
        plan = pp.RrtConnect().plan(checker, problem.start, problem.goals, rng=seed)
        if not plan.ok:
            continue
        path = pp.shortcut(plan.path, plan.checker or checker, rng=seed)
        motion = pp.time_parametrise(path, problem.group.limits)
        certificate = pp.certify(motion, plan.checker or checker, record=True)
        if certificate.free:
            found.append(StoredProof(certificate))
    return found


def random_change(proof: StoredProof, kind: str, rng: np.random.Generator) -> pp.Scene:
    """Return the scene of a motion with one obstacle moved, added near the path of the tool, or removed."""
    scene, motion = proof.checker.scene, proof.curve
    name = str(rng.choice(scene.names))
    if kind == "removed":
        return scene.remove(name)
    if kind == "moved":
        step = pp.pose(
            rng.normal(size=3) * rng.choice([0.003, 0.03, 0.2]), rng.normal(size=3) * rng.choice([0.01, 0.3])
        )
        pose = scene[name].pose * step
        return scene.move(name, pose)
    tool = proof.checker.arm.forward_kinematics(motion(rng.uniform(*motion.domain))).translation
    sides = rng.uniform(0.02, 0.2, 3)
    shape = (pp.Sphere(sides[0] / 2), pp.Box(*sides), pp.Cylinder(sides[0] / 2, sides[1]))[rng.integers(3)]
    place = pp.pose(tool + rng.normal(size=3) * rng.choice([0.05, 0.2, 0.5]), rng.uniform(-3, 3, 3))
    return scene.add(pp.Obstacle("added", shape, place))


def measure_times(name: str, proofs: list[StoredProof], seed: int) -> Row:
    """Measure certificates with and without reuse after random changes; times in ms."""
    rng = np.random.default_rng(seed)
    again: dict[str, list[float]] = {kind: [] for kind in KINDS}
    scratch, changes = [], []
    for proof in proofs:
        for k in range(TIMED_CHANGES):
            kind = KINDS[k % len(KINDS)]
            scene = random_change(proof, kind, rng)
            change = SetupChange(proof.checker, proof.checker.with_scene(scene))
            measured = (
                (changes, lambda p=proof, s=scene: SetupChange(p.checker, p.checker.with_scene(s))),
                (again[kind], lambda p=proof, c=change: p.certify(c)),
                (scratch, lambda p=proof, c=change: pp.certify(p.curve, c.after)),
            )
            for times, call in measured:
                times.append(1e3 * fastest(call, REPEATS))
    pairs = float(np.mean([len(proof.checker.pairs) for proof in proofs]))
    return Row(set=name, motions=len(proofs), pairs=pairs, again=again, scratch=scratch, change=changes)


def check_verdicts(name: str, proofs: list[StoredProof], changes: int, seed: int) -> Row:
    """Compare the verdicts of reuse after random changes with those from scratch, and some with dense samples."""
    rng = np.random.default_rng(seed + 1)
    counts = {status.name: 0 for status in pp.CertificateStatus}
    different = audited = samples = 0
    wrong: list[str] = []
    for k in range(changes):
        proof, kind = proofs[k % len(proofs)], KINDS[int(rng.integers(len(KINDS)))]
        after = proof.checker.with_scene(random_change(proof, kind, rng))
        one, other = proof.certify(SetupChange(proof.checker, after)), pp.certify(proof.curve, after)
        counts[one.status.name] += 1
        different += one.status is not other.status
        reason = ""
        if {one.status, other.status} == {pp.CertificateStatus.FREE, pp.CertificateStatus.COLLIDING}:
            reason = f"{one.status.name}, from scratch {other.status.name}"
        elif one.first_contact is not None and after.check(one.first_contact.q).free:
            reason = "COLLIDING at a configuration without contact"
        elif one.free and one.clearance > one.observed + after.rounding:
            reason = f"proven clearance {one.clearance} m above the measured distance {one.observed} m"
        elif one.free and counts["FREE"] % AUDITED == 0:
            found = pp.audit(proof.curve, after, step=AUDIT_STEP, measure=False)
            audited, samples = audited + 1, samples + found.samples
            reason = "" if found.clean else f"FREE, but {found.message}"
        if reason and len(wrong) < SHOWN:
            wrong.append(f"{name}, change {k} ({kind}): {reason}")
    return Row(
        set=name, changes=changes, verdicts=counts, different=different, audited=audited, samples=samples, wrong=wrong
    )


def blocks(results: Results) -> Blocks:
    """The tables of the page."""

    def spread(values: list[float]) -> str:
        return quantiles(values, "{:.3f}", (0.5, 0.95, 1.0))

    columns = {
        "set": "{.set}",
        "motions": "{.motions}",
        "pairs": "{.pairs:.0f}",
        **{kind: lambda row, kind=kind: spread(row.again[kind]) for kind in KINDS},
        "all changes": lambda row: spread([t for kind in KINDS for t in row.again[kind]]),
        "from scratch": lambda row: spread(row.scratch),
        "scene": lambda row: spread(row.change),
    }
    rows = results["times"]
    total = Row(
        set="all",
        motions=sum(row.motions for row in rows),
        pairs=float(np.mean([row.pairs for row in rows])),
        again={kind: [t for row in rows for t in row.again[kind]] for kind in KINDS},
        scratch=[t for row in rows for t in row.scratch],
        change=[t for row in rows for t in row.change],
    )
    verdicts = {
        "set": "{.set}",
        "changes": "{.changes:,}",
        **{key: f"{{0.verdicts[{key}]:,}}" for key in ("FREE", "COLLIDING", "UNDECIDED")},
        "different": "{.different:,}",
        "audited": "{.audited:,}",
        "samples": "{.samples:,}",
        "wrong": lambda row: str(len(row.wrong)),
    }
    return {"times": row_table(columns, (*rows, total)), "verdicts": row_table(verdicts, results["verdicts"])}


def measure(options: argparse.Namespace) -> Results:
    """Measure all sets."""
    if options.mbm is None:
        raise SystemExit("--mbm is required")
    settings = {"problems": options.problems, "changes": options.changes}
    results = Results(settings, provenance(options.seed), {"times": [], "verdicts": []})
    sets = find_sets(options.mbm)
    for each in sets:
        proofs = stored_motions(read_problems(each, options.problems), options.seed)
        results["times"].append(measure_times(each.name, proofs, options.seed))
        if options.changes:
            count = -(-options.changes // len(sets))
            results["verdicts"].append(check_verdicts(each.name, proofs, count, options.seed))
        report(f"{each.name}: {len(proofs)} motions, {results['verdicts'][-1:]}")
    return results


BENCHMARK = Benchmark("reuse", measure, blocks)


def main() -> None:
    """Run the benchmark with the arguments of the command line."""
    parser = page_parser(__doc__, "reuse")
    parser.add_argument("--mbm", type=Path, metavar="FOLDER", help="MotionBenchMaker problems of the Panda")
    parser.add_argument("--problems", type=int, default=20, metavar="N", help="problems per set")
    parser.add_argument("--changes", type=int, default=0, metavar="N", help="number of random changes to check")
    BENCHMARK.run(parser)
