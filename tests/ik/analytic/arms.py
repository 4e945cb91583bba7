"""Arms generated from their axes: every geometry with a closed form, and some without."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
from hypothesis import strategies as st

import pinproof as pp
from pinproof.model import load_robot

TURN = 2 * np.pi


@cache
def arm_named(name: str) -> pp.Arm:
    """An arm of the catalogue, loaded once."""
    return pp.load_robot(name).arm()


@dataclass
class Axis:
    """A joint at q = 0: direction (3,), point (3,) in m, and whether it is prismatic."""

    direction: np.ndarray
    point: np.ndarray
    slides: bool = False


def arm_of(axes: Sequence[Axis], tool: Sequence[float] = (0.1, 0.2, 0.3), limits=None, mimic: str = "") -> pp.Arm:
    """An arm with these axes at q = 0 and its tcp at ``tool``, slightly rotated.

    ``limits`` are (lower, upper) for each joint, None for a continuous one; by default +-3.1 rad and +-0.6 m.
    """
    parts, last = ['<robot name="made"><link name="l0"/>'], np.zeros(3)
    for i, axis in enumerate(axes, 1):
        bounds = limits[i - 1] if limits is not None else ((-0.6, 0.6) if axis.slides else (-3.1, 3.1))
        kind = "prismatic" if axis.slides else "continuous" if bounds is None else "revolute"
        limit = (
            "" if bounds is None else f'<limit lower="{bounds[0]!r}" upper="{bounds[1]!r}" velocity="1" effort="1"/>'
        )
        follow = mimic if i == len(axes) else ""
        xyz, direction = (" ".join(map(repr, v.tolist())) for v in (axis.point - last, axis.direction))
        parts.append(
            f'<link name="l{i}"/><joint name="j{i}" type="{kind}"><parent link="l{i - 1}"/><child link="l{i}"/>'
            f'<origin xyz="{xyz}"/><axis xyz="{direction}"/>{limit}{follow}</joint>'
        )
        last = axis.point
    end = " ".join(map(repr, (np.asarray(tool, dtype=float) - last).tolist()))
    parts.append(
        f'<link name="tool"/><joint name="tool_joint" type="fixed"><parent link="l{len(axes)}"/><child link="tool"/>'
        f'<origin xyz="{end}" rpy="0.3 -0.2 0.5"/></joint></robot>'
    )
    return load_robot("".join(parts)).arm(tcp="tool")


def unit(rng: np.random.Generator) -> np.ndarray:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def spherical(rng: np.random.Generator, square: bool) -> list[Axis]:
    """Three revolute axes through one point; ``square``: each perpendicular to the next."""
    centre = rng.uniform(-0.5, 0.5, 3)
    frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    directions = [frame[0], frame[1], frame[0]] if square else [unit(rng) for _ in range(3)]
    return [Axis(h, centre + rng.uniform(-0.2, 0.2) * h) for h in directions]


def planar(rng: np.random.Generator, kinds: str) -> list[Axis]:
    """Three axes that generate planar motions, of kinds such as ``"RPR"``."""
    normal = unit(rng)
    axes = []
    for kind in kinds:
        across = np.cross(normal, unit(rng))
        axes.append(
            Axis(across / np.linalg.norm(across) if kind == "P" else normal, rng.uniform(-0.5, 0.5, 3), kind == "P")
        )
    return axes


def first_distinct(made: Callable[[], list[Axis]]) -> list[Axis]:
    """The first triple whose neighbours move differently: by 0.05 rad, or 5 cm where they are parallel and revolute.

    Neighbours within 0.01 of each other are one joint to the solver, which uses no triple with them.
    """
    while True:
        triple = made()
        for a, b in pairwise(triple):
            angle = np.linalg.norm(np.cross(a.direction, b.direction))
            apart = np.linalg.norm(np.cross(b.point - a.point, a.direction))
            if a.slides == b.slides and angle < 0.05 and (a.slides or apart < 0.05):
                break
        else:
            return triple


def others(rng: np.random.Generator, kinds: str, square: bool) -> list[Axis]:
    """Random axes of kinds such as ``"RPR"``; ``square``: along x, y or z, and some of them meet."""
    axes: list[Axis] = []
    for kind in kinds:
        direction = np.eye(3)[rng.integers(3)] if square else unit(rng)
        point = axes[-1].point if square and axes and rng.random() < 0.5 else rng.uniform(-0.5, 0.5, 3)
        axes.append(Axis(direction, point, kind == "P"))
    return axes


@st.composite
def six_axes(draw):
    """Six axes with a triple at a random position; the number of prismatic joints is bounded."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    first = draw(st.integers(0, 3))
    square = draw(st.booleans())
    if draw(st.booleans()):
        right_angles = draw(st.booleans())
        triple = first_distinct(lambda: spherical(rng, right_angles))
        rest = draw(st.sampled_from(["RRR", "RRR", "RRP", "RPR", "PRR", "PPR", "PRP", "RPP"]))
    else:
        kinds = draw(st.sampled_from(["RRR", "RRR", "RRP", "RPR", "PRR", "RPP", "PRP", "PPR"]))
        triple = first_distinct(lambda: planar(rng, kinds))
        rest = draw(st.sampled_from(["RRR", "RRP", "RPR", "PRR"]))
    around = others(rng, rest, square)
    return [*around[:first], *triple, *around[first:]], rng.uniform(-0.5, 0.5, 3), rng


def random_configurations(arm: pp.Arm, count: int, seed: int = 0) -> np.ndarray:
    """(count, n), uniform inside the limits."""
    return np.random.default_rng(seed).uniform(*arm.limits.sampling_range(), (count, arm.dof))


def conditioning(arm: pp.Arm, q: np.ndarray) -> float:
    """The smallest singular value of the Jacobian."""
    return float(np.linalg.svd(arm.jacobian(q), compute_uv=False)[-1])


def misses(arm: pp.Arm, found: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """(N,) distance of each row of wanted (N, n) from the closest row of found (N, k, n), NaN-padded."""
    gap = apart(arm, found, wanted[:, None])
    return np.where(np.isnan(gap), np.inf, gap).min(axis=1)


def assert_reaches(arm: pp.Arm, q: np.ndarray, target: np.ndarray, tolerance: float = 1.000001e-9) -> None:
    """Whether q is within the limits and at the target, by Pinocchio."""
    assert arm.limits.contains(q)
    off = np.linalg.inv(np.asarray(target)) @ arm.forward_kinematics(q).homogeneous
    assert np.linalg.norm(off[:3, 3]) <= tolerance
    assert np.linalg.norm(off[:3, :3] - off[:3, :3].T) / np.sqrt(8) <= tolerance + 1e-14
    assert np.trace(off[:3, :3]) > 2.9


def apart(arm: pp.Arm, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The largest joint difference between rows of a and b modulo 2 pi; broadcasts."""
    gap = np.abs(a - b)
    return np.where(arm.periodic, np.abs(gap - TURN * np.round(gap / TURN)), gap).max(axis=-1)
