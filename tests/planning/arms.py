"""Small arms, and a check of paths that is independent of any proof."""

from __future__ import annotations

import numpy as np

import pinproof as pp
from pinproof.model import load_robot


def ball_arm(
    kinds: tuple[str, ...], limits: tuple[float, float] = (-1.0, 1.0), geometry: str = '<sphere radius="0.05"/>'
) -> pp.Arm:
    """A ball of 5 cm moved by a chain: ``"x"``, ``"y"``, ``"z"`` slide along an axis; ``"turn"`` swings it about z.

    It is then 1 m out. ``"spin"`` turns what follows about z.
    """
    low, high = limits
    parts = ['<robot name="ball"><link name="l0"/>']
    for i, kind in enumerate(kinds, 1):
        joint, axis = {
            "x": ("prismatic", "1 0 0"),
            "y": ("prismatic", "0 1 0"),
            "z": ("prismatic", "0 0 1"),
            "turn": ("continuous", "0 0 1"),
            "spin": ("continuous", "0 0 1"),
        }[kind]
        parts.append(
            f'<link name="l{i}">'
            + (f"<collision><geometry>{geometry}</geometry></collision>" if i == len(kinds) and kind != "turn" else "")
            + (f'<collision><origin xyz="1 0 0"/><geometry>{geometry}</geometry></collision>' if kind == "turn" else "")
            + f'</link><joint name="{kind}" type="{joint}"><parent link="l{i - 1}"/><child link="l{i}"/>'
            f'<axis xyz="{axis}"/><limit lower="{low}" upper="{high}" velocity="1" effort="1"/></joint>'
        )
    return load_robot("".join([*parts, "</robot>"])).arm(tcp=f"l{len(kinds)}")


def assert_free(path: pp.JointPath | pp.motion.CubicPath, checker: pp.CollisionChecker, step: float = 0.01) -> None:
    """Independent of any proof: a dense sample of the path is free and inside the limits."""
    first, last = path.domain
    rough = path(np.linspace(first, last, 200))
    count = int(np.abs(np.diff(rough, axis=0)).sum() / step) + 2
    for q in path(np.linspace(first, last, count)):
        assert checker.is_free(q)
        assert checker.arm.limits.contains(q, 1e-9)


def assert_solves(plan: pp.PlanResult, checker: pp.CollisionChecker, start: np.ndarray, goal: np.ndarray) -> None:
    """The path is certified and free, and connects the start with the goal."""
    path = plan.or_raise().path
    assert np.array_equal(path.start, start)
    assert np.array_equal(path.end, goal)
    assert plan.certificate.free
    assert plan.certificate.matches(path, checker.arm, checker.scene)
    assert_free(path, checker)
