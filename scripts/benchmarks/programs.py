"""Benchmark of robot programs: random programs with zones, and dense samples of what controllers may execute.

./scripts/benchmark programs --programs 40              a short run
./scripts/benchmark programs --programs 1000 --docs     rewrites docs/benchmarks/programs.*

Exit code 1 if a program is stated to be FREE and a sample of it is in contact.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import replace
from functools import cache
from itertools import pairwise
from multiprocessing import get_context
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from trimesh.creation import torus

import pinproof as pp
from benchmarks.tables import Benchmark, Blocks, Results, Row, page_parser, provenance, report, row_table
from pinproof.collision import certify_program
from pinproof.motion import Blend, JointMove, LinearMove, RobotProgram, find_dialect, make_program

Array = npt.NDArray[np.float64]
Curve = Callable[[Array], Array]
"""The configurations (k, n) of a move at shares (k,) of it."""

LANGUAGES = ("urscript", "rapid", "krl", "fanuc")
ROBOTS = ("ur5", "irb120", "m0609", "crx10ia", "ur10e", "generic_6dof", "rail")
"""Robots of the programs, one after the other; the last one is the UR5 on a rail, which URScript cannot express."""

DEVIATION = 0.002
"""rad: the deviation of the controller that the texts state; samples are displaced by up to this value."""

SAMPLES = 31
"""Samples of each form of each move and of each blend."""

STEP = 0.05
"""rad or m: largest motion of a joint between two samples that are checked."""

SHOWN = 20
"""Largest number of contacts that are kept as sentences."""


# -- random programs ---------------------------------------------------------------------------------------------------


@cache
def arm_of(name: str) -> pp.Arm:
    """The arm of a robot; ``rail`` is the UR5 on a rail."""
    if name != "rail":
        return pp.load_robot(name).arm()
    rail = (
        '<link name="rail"/><joint name="rail" type="prismatic"><parent link="rail"/><child link="world"/>'
        '<axis xyz="0 1 0"/><limit lower="-1.5" upper="1.5" velocity="1" effort="1"/></joint></robot>'
    )
    return pp.load_robot(pp.load_robot("ur5").urdf.text.replace("</robot>", rail)).arm(tcp="tool0")


def random_cell(arm: pp.Arm, carried: bool, rng: np.random.Generator) -> pp.CollisionChecker:
    """The arm among six obstacles, one of them a mesh with a hole, with or without a part in the hand."""
    obstacles = []
    for k in range(6):
        a, b, c = rng.uniform(0.05, 0.25, 3)
        ring = torus(a + 0.1, 0.2 * b)
        shapes = [pp.Box(a, b, c), pp.Sphere(radius=a / 2), pp.Cylinder(radius=b / 3, length=2 * c), ring]
        shape = shapes[3 if k == 0 else int(rng.integers(3))]
        turn, size = rng.uniform(-np.pi, np.pi), arm.robot.size
        place = size * rng.uniform(0.4, 0.9) * np.array([np.cos(turn), np.sin(turn), 0.0])
        place[2] = rng.uniform(0.0, 0.8) * size
        obstacles.append(pp.Obstacle(f"o{k}", shape, pp.pose(place, rng.uniform(-3, 3, 3))))
    part = pp.Obstacle("part", pp.Box(*rng.uniform(0.03, 0.12, 3)), pp.pose((0, 0, 0.08)))
    return pp.CollisionChecker(arm, pp.Scene(obstacles), attached=[part] if carried else [])


def random_program(
    checker: pp.CollisionChecker, language: str, external: dict[str, str], rng: np.random.Generator
) -> RobotProgram | None:
    """Joint and linear moves with random zones between configurations without contact; None if none was found."""
    arm, (lower, upper) = checker.arm, checker.arm.limits.sampling_range()
    inner = 0.9 * lower + 0.1 * upper, 0.1 * lower + 0.9 * upper
    starts = rng.uniform(*inner, (200, arm.dof))
    starts = starts[checker.is_free_batch(starts)]
    if not len(starts):
        return None
    q, zones = starts[0], find_dialect(language).zones
    if language == "krl":  # all blends between two stops have one distance
        zones = (zones[int(rng.integers(len(zones)))],)
    steps: list[JointMove | LinearMove] = [JointMove(q)]
    for k in range(4):
        blend = zones[int(rng.integers(len(zones)))] if k < 3 and rng.random() < 0.5 else None
        linear = rng.random() < 0.4
        for _ in range(4 if linear else 30):
            if linear:
                by = pp.pose(rng.uniform(-0.07, 0.07, 3), rng.uniform(-0.15, 0.15, 3))
                target = arm.forward_kinematics(q) * by
                near = q + np.linalg.pinv(arm.jacobian(q, reference="LOCAL")) @ pin.log6(by).vector
                if np.abs(near - q).max() > 0.5 or not checker.is_free_batch(near[None])[0]:
                    continue  # near a singularity or a contact
                trace = pp.collision.trace_line(arm, q, target)
                if trace.reason or not checker.is_free_batch(trace.path.q).all():
                    continue
                there = trace.path.end
            else:
                there = np.clip(q + rng.choice([0.15, 0.3, 0.6]) * rng.uniform(-1, 1, arm.dof), *inner)
                if not checker.edges_free(q[None], there[None])[0]:
                    continue
            break
        else:
            continue
        if linear:
            rests = q[: len(external)] if external else None
            pose = arm.forward_kinematics(there)
            timed = {"speed": 0.02} if language == "krl" else {"duration": 20.0}
            steps.append(LinearMove(there, pose, blend=blend, external=rests, **timed))
        else:
            steps.append(JointMove(there, 20.0, blend))
        q = there
    if len(steps) < 3:
        return None
    steps[-1] = replace(steps[-1], blend=None)
    return make_program(
        steps, arm.joint_names, dialect=language, deviation=DEVIATION, external_joints=external, name="random"
    )


def with_obstacle_in_a_corner(
    checker: pp.CollisionChecker, program: RobotProgram, rng: np.random.Generator
) -> pp.CollisionChecker:
    """The checker with a ball near the tcp at a blended point, which some of its blends meet and others pass."""
    arm = checker.arm
    corners = [move.q for move in program.moves[1:-1] if move.blend is not None and move.q is not None]
    if not corners:
        return checker
    place = arm.root_from_base * arm.forward_kinematics(corners[int(rng.integers(len(corners)))])
    place.translation += rng.uniform(-0.12, 0.12, 3)
    ball = pp.Obstacle("ball", pp.Sphere(radius=float(rng.uniform(0.01, 0.04))), place)
    near = checker.with_scene(checker.scene.add(ball))
    known = np.array([move.q for move in program.moves if move.q is not None])
    return near if near.is_free_batch(known).all() else checker


# -- what controllers may execute --------------------------------------------------------------------------------------


def line_forms(arm: pp.Arm, start: Array, end: Any, rng: np.random.Generator) -> list[Curve] | None:
    """A linear move with the documented interpolations of the orientation, each solved by CLIK; None if it fails.

    One rotation at a constant rate, or two angles: an axis of the tool swings, and the tool rotates about it.
    """
    first = arm.forward_kinematics(start)
    whole = first.rotation.T @ end.rotation
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    across = np.cross(axis, whole @ axis)
    swing = across * np.arctan2(np.linalg.norm(across), axis @ whole @ axis) / max(np.linalg.norm(across), 1e-12)
    spin = axis * (axis @ pin.log3(pin.exp3(swing).T @ whole))
    solver = pp.Clik(position_tolerance=1e-9, orientation_tolerance=1e-9)
    held, forms = arm.dof - 6, []
    six = arm if not held else None
    for rotation in (
        lambda share: pin.exp3(share * pin.log3(whole)),
        lambda share: pin.exp3(share * swing) @ pin.exp3(share * spin),
    ):
        points = [start]
        for share in np.linspace(0.0, 1.0, SAMPLES)[1:]:
            wanted = pin.SE3(
                first.rotation @ rotation(share), (1 - share) * first.translation + share * end.translation
            )
            q = np.array(points[-1])
            if six is not None:
                found = solver.solve(arm, wanted, q0=q)
                if not found.ok or np.abs(found.q - q).max() > 0.3:
                    return None
                points.append(found.q)
            else:  # the external axes rest: Newton's method on the other joints
                for _ in range(20):
                    error = pin.log6(arm.forward_kinematics(q).actInv(wanted)).vector
                    jacobian = arm.jacobian(q, reference="LOCAL")[:, held:]
                    q[held:] += np.linalg.lstsq(jacobian, error, rcond=None)[0]
                    if np.abs(error).max() < 1e-10:
                        break
                if np.abs(error).max() > 1e-8 or np.abs(q - points[-1]).max() > 0.3:
                    return None
                points.append(q)
        rows = np.array(points)
        forms.append(lambda shares, rows=rows: _at(rows, shares))
    return forms


def _at(rows: Array, shares: Array) -> Array:
    """The points (k, n) at shares of a line through equally spaced rows (m, n)."""
    grid = np.linspace(0.0, 1.0, len(rows))
    return np.stack([np.interp(shares, grid, column) for column in rows.T], axis=1)


def zone_share(arm: pp.Arm, blend: Blend, move: Curve, at: float) -> float:
    """The share of a move from its end ``at`` (0 or 1) that a blend there may use, from dense samples."""
    if blend.radius is None:
        return float(blend.share)
    away = np.linspace(0.0, min(1.0, blend.share), 401)
    tcp = arm.forward_kinematics_batch(move(np.abs(at - away)))[:, :3, 3]
    outside = np.linalg.norm(tcp - tcp[0], axis=1) > blend.radius
    return float(away[max(int(np.argmax(outside)) - 1, 0)] if outside.any() else away[-1])


def executed_curves(program: RobotProgram, arm: pp.Arm, rng: np.random.Generator) -> Iterator[tuple[str, Array]]:
    """The samples (k, n) of every form of every move and of every blend of a program.

    In a blend one move ends while the next one begins: the displacements of both from the point add up, in joint
    space or as poses, with several courses of time.
    """
    along, moves = np.linspace(0.0, 1.0, SAMPLES), program.moves
    forms: list[list[Curve]] = []
    q = np.array(moves[0].q)
    for move in moves[1:]:
        if isinstance(move, JointMove):
            ends = np.stack([q, move.q])
            forms.append([lambda shares, ends=ends: _at(ends, shares)])
        else:
            pose = move.pose if move.q is None else arm.forward_kinematics(move.q)
            found = line_forms(arm, q, pose, rng)
            if found is None:
                yield "unsolved", np.empty((0, arm.dof))
                return
            forms.append(found)
        for curve in forms[-1]:
            yield "move", curve(along)
        q = forms[-1][0](np.ones(1))[0]
    for k, (before, after) in enumerate(pairwise(forms)):
        blend = moves[k + 1].blend
        if blend is None:
            continue
        into, out = before[int(rng.integers(len(before)))], after[int(rng.integers(len(after)))]
        at = out(np.zeros(1))[0]
        share, share_after = zone_share(arm, blend, into, 1.0), zone_share(arm, blend, out, 0.0)
        power, power_after = rng.uniform(0.5, 3.0, 2)
        courses = [
            ("parabola", (1 - along) ** 2, along**2),
            ("superposed", 1 - along, along),
            ("circle", 1 - np.sin(along * np.pi / 2), 1 - np.cos(along * np.pi / 2)),
            ("other course", (1 - along) ** power, along**power_after),
        ]
        for name, left, passed in courses:
            yield name, into(1 - share * left) + out(share_after * passed) - at
        # The displacements of both poses add up; each row is solved from the one before, as a controller moves
        one, other = into(1 - share * (1 - along)), out(share_after * along)
        held, rows = arm.dof - 6, [one[0] + other[0] - at]
        centre, sums = arm.forward_kinematics(at), one + other - at
        for k, (first, second) in enumerate(zip(one, other, strict=True)):
            a, b = arm.forward_kinematics(first), arm.forward_kinematics(second)
            turned = a.rotation @ centre.rotation.T @ b.rotation
            wanted = pin.SE3(turned, a.translation + b.translation - centre.translation)
            row = predicted = rows[-1] + sums[k] - sums[max(k - 1, 0)]
            for _ in range(20):
                error = pin.log6(arm.forward_kinematics(row).actInv(wanted)).vector
                if np.abs(error).max() < 1e-9:
                    break
                jacobian = arm.jacobian(row, reference="LOCAL")[:, held:]
                row = row + np.append(np.zeros(held), np.linalg.lstsq(jacobian, error, rcond=None)[0])
            if np.abs(error).max() > 1e-8 or np.abs(row - predicted).max() > 0.3:
                break  # it passes a singular configuration, where no controller follows it
            rows.append(row)
        yield "poses", np.array(rows)
        if len(rows) <= SAMPLES:
            yield "unsolved", np.empty((0, arm.dof))


def sampled(
    program: RobotProgram, checker: pp.CollisionChecker, rng: np.random.Generator
) -> tuple[Counter[str], list[str]]:
    """The numbers of samples by kind, and the contacts, with each joint displaced by up to the deviation."""
    exact, counts, contacts = checker.exact(), Counter[str](), list[str]()
    for kind, curve in executed_curves(program, checker.arm, rng):
        if not len(curve):
            counts[kind] += 1
            continue
        shifted = curve + 0.99 * DEVIATION * rng.choice([-1.0, 1.0], curve.shape)
        for rows in (curve, shifted):
            counts[kind] += len(rows)
            if not exact.is_free_batch(rows).all():
                contacts.append(f"{kind}: core")
        if len(curve) > 1:
            audit = pp.audit(pp.JointPath(curve, checker.arm.joint_names), checker, step=STEP, measure=False)
            counts["coal"] += audit.samples
            if not audit.clean:
                contacts.append(f"{kind}: coal: {audit.message}")
    return counts, contacts


# -- the run -----------------------------------------------------------------------------------------------------------


def measured(seed: int, number: int) -> Row | None:
    """Make, certify and sample a random program; None if its cell has none."""
    rng = np.random.default_rng([seed, number])
    name = ROBOTS[number % len(ROBOTS)]
    language = LANGUAGES[1 + number % 3] if name == "rail" else LANGUAGES[(number // len(ROBOTS)) % 4]
    carried = bool((number // 3) % 2)
    arm = arm_of(name)
    checker = random_cell(arm, carried, rng)
    program = random_program(checker, language, {"rail": "mm"} if name == "rail" else {}, rng)
    if program is None:
        return None
    checker = with_obstacle_in_a_corner(checker, program, rng)
    certificate = certify_program(program, checker)
    counts, contacts = sampled(program, checker, rng)
    row = Row(language=language, robot=name, hand="a part" if carried else "empty", programs=1, wrong=[])
    found = bool(contacts) and not certificate.free
    vars(row).update(dict.fromkeys(SUMMED[1:], 0), found=int(found))
    if certificate.free:
        row.free, row.moves = 1, len(program.moves) - 1
        row.linear = sum(isinstance(move, LinearMove) for move in program.moves)
        row.blends = sum(move.blend is not None for move in program.moves)
        row.coal, row.unsolved, row.poses = counts.pop("coal", 0), counts.pop("unsolved", 0), counts["poses"]
        row.samples, row.contacts = sum(counts.values()), int(bool(contacts))
        row.wrong = [f"program {number}, {language}, {name}: {each}" for each in contacts[:1]]
    return row


def measure(options: argparse.Namespace) -> Results:
    """Make, certify and sample random programs, and add them up by language, robot and hand."""
    origin, total = provenance(options.seed), dict[tuple[str, str, str], Row]()
    made, until = 0, time.monotonic() + 60.0 * options.minutes
    with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as pool:
        waiting, number = list[Future[Row | None]](), 0
        while made < options.programs and time.monotonic() < until:
            while len(waiting) < 2 * options.workers:
                waiting.append(pool.submit(measured, options.seed, number))
                number += 1
            row = waiting.pop(0).result()
            if row is None:
                continue
            made += 1
            if made % 50 == 0:
                report(f"{made} programs")
            known = total.setdefault((row.language, row.robot, row.hand), row)
            if known is not row:
                for name in SUMMED:
                    setattr(known, name, getattr(known, name) + getattr(row, name))
                known.wrong = [*known.wrong, *row.wrong][:SHOWN]
        for each in waiting:
            each.cancel()
    return Results({"programs": made}, origin, {"programs": list(total.values())})


SUMMED = ("programs", "free", "moves", "linear", "blends", "samples", "coal", "poses", "unsolved", "contacts",
          "found")  # fmt: skip


def blocks(results: Results) -> Blocks:
    """The tables of the page: by language, and by robot and hand."""
    columns = {
        "programs": "{0.programs:,}", "FREE": "{0.free:,}", "moves": "{0.moves:,}", "linear": "{0.linear:,}",
        "zones": "{0.blends:,}", "samples": "{0.samples:,}", "added poses": "{0.poses:,}", "with coal": "{0.coal:,}",
        "not followed": "{0.unsolved:,}", "in contact": "{0.contacts:,}",
        "others in contact": "{0.found:,}",
    }  # fmt: skip

    def summed(*names: str) -> list[Row]:
        groups = dict[tuple[str, ...], Row]()
        for row in results["programs"]:
            key = tuple(getattr(row, name) for name in names)
            total = groups.setdefault(key, Row(**dict(zip(names, key, strict=True))))
            for name in SUMMED:
                setattr(total, name, getattr(total, name, 0) + getattr(row, name))
        return sorted(groups.values(), key=lambda row: [getattr(row, name) for name in names])

    def table(*names: str) -> list[str]:
        own = {name: f"{{0.{name}}}" for name in names}
        return row_table({**own, **columns}, summed(*names), text_columns=len(names))

    return {"languages": table("language"), "robots": table("robot", "hand")}


BENCHMARK = Benchmark("programs", measure, blocks)


def main() -> None:
    """Run the benchmark with the options of the command line."""
    parser = page_parser(__doc__, "programs")
    parser.add_argument("--programs", type=int, default=40, help="number of random programs")
    parser.add_argument("--workers", type=int, default=2, help="number of processes")
    parser.add_argument("--minutes", type=float, default=1e6, help="stop after this time, with fewer programs")
    BENCHMARK.run(parser)
