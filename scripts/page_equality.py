"""Compare pages that compute with Python: contacts, clearances and inverse kinematics of the compiled module in node.

``page_equality.py [ROBOT TCP SCENE] [--configurations N] [--targets N]``: one robot file in a scene, by default the
UR5, the Panda and both as two arms in the scene of the tests. It prints how many answers differ, and by how much.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import numpy as np

import pinproof as pp
from pinproof.errors import NoClosedForm

sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.viewer.test_web_cell import ask, sample, scene


def checkers(words: list[str]) -> dict[str, pp.CollisionChecker]:
    """The checker of a robot file, or those of the tests."""
    if words:
        robot, tcp, path = words
        arm = pp.load_robot(robot).arm(tcp=tcp)
        return {Path(robot).stem: pp.CollisionChecker(arm, pp.Scene.load(path))}
    left, right = pp.load_robot("ur5").arm(tcp="tool0"), pp.load_robot("panda").arm()
    two = pp.assemble({"left": (left, pp.pose(xyz=(0, 0.45, 0))), "right": (right, pp.pose(xyz=(0, -0.45, 0)))})
    return {name: pp.CollisionChecker(arm, scene()) for name, arm in {"ur5": left, "panda": right, "two": two}.items()}


def compare_poses(checker: pp.CollisionChecker, count: int) -> str:
    """Contacts and clearances at configurations."""
    configurations = sample(checker.group, count, 10)
    with tempfile.TemporaryDirectory() as folder:
        answers = ask(Path(folder), checker, configurations)["out"]
    different, off, apart, free = 0, 0.0, 0.0, 0
    for q, (lower, points, contacts, *_) in zip(configurations, answers, strict=True):
        expected = sorted(checker.indices_of(k) for k in checker.pairs_in_contact(q))
        different += sorted(map(tuple, contacts)) != expected
        if not expected:
            clearance, free = checker.clearance(q), free + 1
            off = max(off, abs(lower - clearance))
            apart = max(apart, abs(float(np.linalg.norm(np.subtract(*points))) - clearance))
    return (
        f"{count} configurations, {free} of them free: {different} with other contacts; clearances differ by at most "
        f"{off:.1e} m, the lengths of the drawn lines by {apart:.1e} m"
    )


def compare_targets(checker: pp.CollisionChecker, count: int) -> str:
    """The nearest solution and all branches of targets, one in ten of them out of reach."""
    group, clik, analytic = checker.group, pp.Clik(), pp.AnalyticIk()
    starts, goals, asked, expected = sample(group, count, 11), sample(group, count, 12), [], []
    for number, (q0, goal) in enumerate(zip(starts, goals, strict=True)):
        index = number % len(group.arms)
        label, arm = list(group.arms.items())[index]
        own = group.indices(label)
        target = arm.forward_kinematics(goal[own]).homogeneous.copy()
        target[:3, 3] *= 1.6 if number % 10 == 0 else 1.0
        every = None
        with suppress(NoClosedForm):
            redundant = analytic.redundant_joints(arm)
            values = {"redundant_values": [np.take(q0[own], redundant)]} if redundant else {}
            every = analytic.solve_all(arm, target, q0[own], **values)
        expected.append((own, clik.solve(arm, target, q0[own]), every))
        asked.append((index, arm.root_from_base.homogeneous @ target, q0))
    with tempfile.TemporaryDirectory() as folder:
        solved = ask(Path(folder), checker, starts[:1], asked)["solved"]
    counts = dict.fromkeys(("reached", "other verdict", "other iterations", "other solution", "other branches"), 0)
    branches = 0
    for (own, result, every), (found, got) in zip(expected, solved, strict=True):
        counts["reached"] += result.ok
        counts["other verdict"] += found["reached"] != result.ok
        if result.ok:
            counts["other iterations"] += found["iterations"] != result.iterations
            counts["other solution"] += not np.allclose(np.take(found["q"], own), result.q, atol=1e-6)
        if every is None or got is None:
            counts["other branches"] += (every is None) != (got is None)
            continue
        branches += len(every.branches)
        q = np.array(got["q"]).reshape(-1, group.dof)[:, own]
        same = len(q) == len(every.branches) and all(np.abs(q - b).max(axis=1).min() < 1e-7 for b in every.branches)
        counts["other branches"] += not same
    texts = ", ".join(f"{value} {name}" for name, value in counts.items())
    return f"{count} targets: {texts}; {branches} branches"


def main() -> None:
    """Print the comparisons."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robot", nargs="*", help="robot file, tcp and scene")
    parser.add_argument("--configurations", type=int, default=10_000)
    parser.add_argument("--targets", type=int, default=1_000)
    words = parser.parse_args()
    for name, checker in checkers(words.robot).items():
        start = time.process_time()
        print(f"{name}: {compare_poses(checker, words.configurations)}")
        print(f"{name}: {compare_targets(checker, words.targets)} ({time.process_time() - start:.0f} s)", flush=True)


if __name__ == "__main__":
    main()
