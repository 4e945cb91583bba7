"""Benchmark of the reuse of certificates: motions of the Panda among MotionBenchMaker's scenes, which change.

./scripts/benchmark reuse --mbm FOLDER                       times of reuse and of certificates from scratch
./scripts/benchmark reuse --mbm FOLDER --changes 100000      also checks the verdicts of random changes
./scripts/benchmark reuse --mbm FOLDER --changes 100000 --docs     rewrites docs/benchmarks/reuse.*
./scripts/benchmark reuse --render                           rewrites the page from reuse.json

The times take a minute, 100,000 changes some minutes more. Exit code 1 if a verdict is wrong.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

import pinproof as pp
from benchmarks.planning_problems import PlanProblem, find_sets, read_problems
from benchmarks.tables import (
    BenchmarkTable,
    bullet_section,
    fastest,
    page_parser,
    provenance,
    provenance_text,
    quantiles,
    report,
    row_table,
    run,
    wrapped,
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


@dataclass(frozen=True)
class TimeRow:
    """The times in ms of all motions and changes of a set."""

    set: str
    motions: int
    pairs: float
    again: Mapping[str, list[float]]
    scratch: list[float]
    change: list[float]


@dataclass(frozen=True)
class VerdictRow:
    """Random changes of the scenes of a set, and the comparison of their verdicts."""

    set: str
    changes: int
    verdicts: Mapping[str, int]
    different: int
    audited: int
    samples: int
    wrong: tuple[str, ...]


@dataclass(frozen=True)
class ReuseTable(BenchmarkTable):
    """Times of reuse, and checks of its verdicts."""

    times: tuple[TimeRow, ...]
    verdicts: tuple[VerdictRow, ...]

    topic: ClassVar[str] = "reuse"
    row_types: ClassVar[dict[str, type]] = {"times": TimeRow, "verdicts": VerdictRow}

    @property
    def wrong(self) -> list[str]:
        """Wrong verdicts as sentences."""
        return [text for row in self.verdicts for text in row.wrong]


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


def measure_times(name: str, proofs: list[StoredProof], seed: int) -> TimeRow:
    """Measure certificates with and without reuse after random changes."""
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
    return TimeRow(name, len(proofs), pairs, again, scratch, changes)


def check_verdicts(name: str, proofs: list[StoredProof], changes: int, seed: int) -> VerdictRow:
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
    return VerdictRow(name, changes, counts, different, audited, samples, tuple(wrong))


def page(table: ReuseTable) -> str:
    """Return the page as Markdown."""
    lines = ["# Benchmark of reuse", "", *wrapped(provenance_text(table)), ""]
    if table.times:
        lines += ["## Times", "", *_times(table), ""]
    if table.verdicts:
        lines += ["## Verdicts after random changes", "", *_verdicts(table), ""]
    lines += bullet_section("Wrong verdicts", table.wrong)
    return "\n".join(lines).rstrip() + "\n"


def _spread(values: list[float]) -> str:
    return quantiles(values, "{:.3f}".format, (0.5, 0.95, 1.0))


def _times(table: ReuseTable) -> list[str]:
    text = (
        "Motions of the Panda for MotionBenchMaker's problems (RRT-Connect, shortcuts, limits of the robot), certified "
        f"again after {TIMED_CHANGES} random changes of their scene: an obstacle is moved, added near the path of the "
        f"tool, or removed. Processor times in ms on one thread, of {REPEATS} runs the fastest: median / 95th "
        "percentile / largest. The scene column is the new checker and its comparison with the old one, once for each "
        "change and all motions of a library."
    )
    columns = {
        "set": "{.set}",
        "motions": "{.motions}",
        "pairs": "{.pairs:.0f}",
        **{kind: lambda row, kind=kind: _spread(row.again[kind]) for kind in KINDS},
        "all changes": lambda row: _spread([t for kind in KINDS for t in row.again[kind]]),
        "from scratch": lambda row: _spread(row.scratch),
        "scene": lambda row: _spread(row.change),
    }
    rows = table.times
    total = TimeRow(
        "all",
        sum(row.motions for row in rows),
        float(np.mean([row.pairs for row in rows])),
        {kind: [t for row in rows for t in row.again[kind]] for kind in KINDS},
        [t for row in rows for t in row.scratch],
        [t for row in rows for t in row.change],
    )
    return [*wrapped(text), "", *row_table(columns, (*rows, total))]


def _verdicts(table: ReuseTable) -> list[str]:
    text = (
        "Each verdict from reuse is compared with a certificate from scratch. A verdict is wrong if one is FREE and "
        "the other COLLIDING, if the configuration of a first contact has no contact, or if the proven clearance "
        f"exceeds a measured distance. One of {AUDITED} FREE motions is checked by coal at samples between which no "
        f"joint moves more than {AUDIT_STEP:g} rad. The column 'different' counts verdicts of which one is UNDECIDED."
    )
    columns = {
        "set": "{.set}",
        "changes": "{.changes:,}",
        **{key: f"{{0.verdicts[{key}]:,}}" for key in ("FREE", "COLLIDING", "UNDECIDED")},
        "different": "{.different:,}",
        "audited": "{.audited:,}",
        "samples": "{.samples:,}",
        "wrong": lambda row: str(len(row.wrong)),
    }
    return [*wrapped(text), "", *row_table(columns, table.verdicts)]


def measure(options: argparse.Namespace) -> ReuseTable:
    """Return the table of all sets."""
    if options.mbm is None:
        raise SystemExit("--mbm is required")
    origin, times, verdicts = provenance(options.seed), [], []
    sets = find_sets(options.mbm)
    for each in sets:
        proofs = stored_motions(read_problems(each, options.problems), options.seed)
        times.append(measure_times(each.name, proofs, options.seed))
        if options.changes:
            verdicts.append(check_verdicts(each.name, proofs, -(-options.changes // len(sets)), options.seed))
        report(f"{each.name}: {times[-1].motions} motions, {verdicts[-1:]}")
    settings = {"problems": options.problems, "changes": options.changes}
    return ReuseTable(settings, origin, tuple(times), tuple(verdicts))


def main() -> None:
    """Run the benchmark with the arguments of the command line."""
    parser = page_parser(__doc__, "reuse")
    parser.add_argument("--mbm", type=Path, metavar="FOLDER", help="MotionBenchMaker problems of the Panda")
    parser.add_argument("--problems", type=int, default=20, metavar="N", help="problems per set")
    parser.add_argument("--changes", type=int, default=0, metavar="N", help="number of random changes to check")
    run(parser, "reuse", ReuseTable, measure, page)
