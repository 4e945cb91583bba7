"""Random grasps around random parts: none is called held that an independent measurement does not hold."""

from __future__ import annotations

import importlib
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision.checking.line_surface import LineSurface
from pinproof.picks.judging.grip import SAMPLED, HeldPart, fingers_of, grip_by_fingers
from pinproof.spatial import SE3

COUNT = 50
"""Number of grasps. An error in 6 % of the grasps is found with a probability of 95 %."""
ROUNDING = 0.05
"""Share of a limit within which sampled areas of the two may be on different sides of it."""

DIRECTION = np.array([0.0, 0.0, 1.0])


@pytest.fixture
def oracle(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    return importlib.import_module("grip_oracle")


@pytest.mark.slow
def test_no_random_grasp_is_called_held_that_does_not_hold(oracle, arms) -> None:
    wrong, refused, seen = [], [], Counter()
    for index in range(COUNT):
        rng = np.random.default_rng([7, index])
        grasp = oracle.random_grasp(rng)
        part = HeldPart(LineSurface.of_obstacle(pp.Obstacle("part", grasp.shape)), grasp.pose)
        found = grip_by_fingers(grasp.moving(arms["ur5"]), part, DIRECTION, oracle.LIMITS)
        truth, by = oracle.judge(grasp, rng)
        seen[truth] += 1
        if by > ROUNDING and found.held != (truth == "held"):
            (wrong if found.held else refused).append((index, found.message, truth, by))
    assert wrong == []
    assert refused == []
    assert seen["held"] > 5
    assert seen["the open fingers overlap"] > 2
    assert seen["gap, area or overlap"] > 20
    assert seen["a finger meets nothing"] > 2


PAD = (0.02, 0.01, 0.03)


def true_contact(kind: str, shape: pp.Shape, turn: np.ndarray, offset: np.ndarray) -> tuple[float, float]:
    """Contact area (m^2) and its extent along z (m), from the formulas of the surfaces at 1,500 x 1,500 points."""
    limits, count = pp.picks.GripLimits(), 1500
    cells = (np.arange(count) + 0.5) / count - 0.5
    x, z = np.meshgrid(cells * PAD[0], cells * PAD[2])
    own = np.stack([x - offset[0], 0 * x, z - offset[2]], axis=-1) @ turn
    if kind == "box":
        inside = (np.abs(own[..., 0]) <= shape.x / 2) & (np.abs(own[..., 2]) <= shape.z / 2)
        height = np.where(inside, shape.y / 2, -1.0)
        cosine = np.ones_like(height)
    else:
        across = own[..., 0] ** 2 + (own[..., 2] ** 2 if kind == "sphere" else 0.0)
        inside = across < shape.radius**2
        if kind == "cylinder":
            inside &= np.abs(own[..., 2]) <= shape.length / 2
        height = np.where(inside, np.sqrt(np.maximum(shape.radius**2 - across, 0.0)), -1.0)
        cosine = height / shape.radius
    on = inside & (height.max() - height <= limits.compliance) & (cosine >= np.cos(limits.angle))
    rows = np.flatnonzero(on.any(axis=1))
    return float(on.mean() * PAD[0] * PAD[2]), float((np.ptp(rows) + 1) / count * PAD[2])


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["sphere", "cylinder", "box"])
def test_contacts_below_a_limit_by_any_amount_are_refused(kind, arms) -> None:
    """The area and extent of contact, from formulas; the sampled ones decide, so limits are raised by their error."""
    for index in range(8):
        rng = np.random.default_rng([13, index])
        a, b, c = rng.uniform(0.012, 0.05, 3).tolist()
        turn = pp.pose(rpy=(0, rng.uniform(-np.pi, np.pi), 0)).rotation
        offset = rng.uniform(-0.005, 0.005, 3) * [1, 0, 1]
        shapes = {"sphere": (pp.Sphere(a / 2), a), "cylinder": (pp.Cylinder(a / 2, b), a), "box": (pp.Box(a, b, c), b)}
        shape, width = shapes[kind]
        area, extent = true_contact(kind, shape, turn, offset)
        pads = [pp.Obstacle(f"finger_{k}", pp.Box(*PAD), pp.pose((0, s * PAD[1] / 2, 0))) for k, s in ((1, 1), (2, -1))]
        hand = pp.picks.GripperFingers(tuple(pads), opening=width + 0.01, grip=width)
        part = HeldPart(LineSurface.of_obstacle(pp.Obstacle("part", shape)), SE3(turn, offset))
        moving = fingers_of(arms["ur5"], hand, {})

        def held(part=part, moving=moving, **limits: float) -> bool:
            return grip_by_fingers(moving, part, DIRECTION, pp.picks.GripLimits(**limits)).held

        assert not held(area=1.0005 * area, overlap=0.0)  # the formulas are sampled too, to 0.05 %
        assert not held(area=0.0, overlap=1.002 * extent)
        assert held(area=(1 - 4 * SAMPLED) * area, overlap=(1 - 4 * SAMPLED) * extent)
