"""The closing motion of fingers in the frame of the tcp: its direction, and bodies that hold all of it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import pinproof as pp
from pinproof.collision.checking.line_surface import LineSurface
from pinproof.model import load_robot
from pinproof.picks.judging.grip import (
    FLAT,
    SAGITTA,
    SAMPLED,
    HeldPart,
    MovingFinger,
    _earlier_contact,
    _hull,
    fingers_of,
    grip_by_fingers,
)
from pinproof.spatial import SE3

FINGER = """
<link name="{side}_knuckle"><collision><origin xyz="0 0 0.03"/><geometry><box size="0.01 0.012 0.06"/></geometry>
</collision></link>
<joint name="{side}_joint" type="revolute"><parent link="hand"/><child link="{side}_knuckle"/>
<origin xyz="0 {y} 0.02"/><axis xyz="{sign} 0 0"/><limit lower="0" upper="1.2" velocity="1" effort="1"/>{mimic}</joint>
<link name="{side}_pad"><collision><origin xyz="0 0 0.02"/><geometry><cylinder radius="0.006" length="0.04"/></geometry>
</collision></link>
<joint name="{side}_tip_joint" type="revolute"><parent link="{side}_knuckle"/><child link="{side}_pad"/>
<origin xyz="0 0 0.06"/><axis xyz="-{sign} 0 0"/><limit lower="0" upper="1.2" velocity="1" effort="1"/>
<mimic joint="left_joint" multiplier="0.9"/></joint>"""

ROBOT = (
    '<robot name="pincer"><link name="base"/><link name="hand"/>'
    '<joint name="lift" type="prismatic"><parent link="base"/><child link="hand"/><axis xyz="0 0 1"/>'
    '<limit lower="0" upper="1" velocity="1" effort="1"/></joint>'
    + FINGER.format(side="left", y=0.03, sign="1", mimic="")
    + FINGER.format(side="right", y=-0.03, sign="-1", mimic='<mimic joint="left_joint"/>').replace("--", "")
    + "</robot>"
)
OPEN, CLOSED = 0.1, 0.9
PADS = ("left_pad", "right_pad")

STEPS = np.linspace(OPEN, CLOSED, 301).tolist()
"""Values of the closing joint."""


@pytest.fixture(scope="module")
def arm() -> pp.Arm:
    return load_robot(ROBOT).arm(tcp="hand", held={"left_joint": OPEN})


@lru_cache(maxsize=2 * len(STEPS))
def bodies(arm: pp.Arm, value: float) -> dict[str, pp.SE3]:
    there = arm.with_held({"left_joint": value})
    hand = there.forward_kinematics(there.home)
    return {name: hand.actInv(there.frame_placement(there.home, name)) for name in ("left_knuckle", *PADS)}


@pytest.mark.slow
def test_swept_bodies_hold_every_point_of_rotating_fingers(arm) -> None:
    found = {finger.name: finger for finger in fingers_of(arm, None, {"left_joint": CLOSED})}
    assert set(found) == {"left_knuckle", "right_knuckle", *PADS}
    turns = np.linspace(0, 2 * np.pi, 40)
    rim = np.column_stack([0.006 * np.cos(turns), 0.006 * np.sin(turns), np.zeros(40)])
    own = {
        "left_pad": np.concatenate([rim, rim + np.array([0, 0, 0.04])]),
        "left_knuckle": np.array(np.meshgrid((-0.005, 0.005), (-0.006, 0.006), (0.0, 0.06))).reshape(3, 8).T,
    }
    for name, points in own.items():
        faces = [ConvexHull(each.shape.points).equations for each in found[name].swept()]
        for value in STEPS:
            at = bodies(arm, value)[name]
            placed = points @ at.rotation.T + at.translation
            inside = np.any([(placed @ face[:, :3].T + face[:, 3] <= 1e-9).all(axis=1) for face in faces], axis=0)
            assert inside.all(), (name, value)


def test_swept_bodies_are_not_much_larger_than_the_motion(arm) -> None:
    finger = next(each for each in fingers_of(arm, None, {"left_joint": CLOSED}) if each.name == "left_knuckle")
    assert 0 < finger.sagitta <= SAGITTA
    points = np.concatenate([each.shape.points for each in finger.swept()])
    corners = np.array(np.meshgrid((-0.005, 0.005), (-0.006, 0.006), (0.0, 0.06))).reshape(3, 8).T
    reached = [
        corners @ at.rotation.T + at.translation for at in (bodies(arm, value)["left_knuckle"] for value in STEPS)
    ]
    reached = np.concatenate(reached)
    assert (points.min(axis=0) >= reached.min(axis=0) - 2 * SAGITTA - 1e-6).all()
    assert (points.max(axis=0) <= reached.max(axis=0) + 2 * SAGITTA + 1e-6).all()


def test_the_closing_direction_is_that_of_the_end_of_the_motion(arm) -> None:
    for finger in fingers_of(arm, None, {"left_joint": CLOSED}):
        if finger.name not in ("left_knuckle", *PADS):
            continue
        middle = np.array([0, 0, 0.03 if finger.name == "left_knuckle" else 0.02])
        ends = [bodies(arm, value)[finger.name].act(middle) for value in (CLOSED - 1e-6, CLOSED)]
        along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        np.testing.assert_allclose(finger.direction, along, atol=1e-3)


def test_rotating_fingers_hold_a_part_between_their_pads(arm) -> None:
    """The pads are nearly parallel cylinders; a block as wide as they leave is held, others are not."""
    closed = 0.25
    found = fingers_of(arm, None, {"left_joint": closed})
    left = bodies(arm, closed)["left_pad"]
    height = float(left.act(np.array([0, 0, 0.02]))[2])
    inner = float(left.act(np.array([0, 0, 0.02]))[1]) - 0.006
    for width, held in ((2 * inner, True), (2 * inner + 0.008, False), (2 * inner - 0.008, False)):
        block = LineSurface.of_obstacle(pp.Obstacle("block", pp.Box(0.03, width, 0.02)))
        part = HeldPart(block, pp.pose((0, 0, height)))
        result = grip_by_fingers(found, part, np.array([0.0, 0.0, 1.0]), pp.picks.GripLimits())
        assert result.held is held, result.message


@pytest.mark.parametrize("offset", [(0, 0, 0), (0.1, 0.2, 0.3), (-0.3, 0.05, -0.2)])
@pytest.mark.parametrize("axis", range(3))
def test_the_hull_of_a_flat_body_is_somewhat_thicker(offset, axis: int) -> None:
    points = np.insert(np.array([(0, 0), (0.02, 0), (0, 0.03), (0.02, 0.03)]), axis, 0.0, axis=1) + offset
    vertices = _hull(points, 0.0).points
    for thick, wide in zip(np.ptp(vertices, axis=0), np.ptp(points, axis=0), strict=True):
        assert thick == pytest.approx(wide + 2 * FLAT, abs=1e-9)
    solid = np.concatenate([points, points + 0.01])
    np.testing.assert_allclose(np.ptp(_hull(solid, 0.0).points, axis=0), np.ptp(solid, axis=0), atol=1e-12)


def finger_of(shape: pp.Shape, closed: SE3, direction: np.ndarray, travel: float) -> MovingFinger:
    """A body that translates along ``direction`` (3,) by ``travel`` (m) to its closed pose."""
    start = SE3(closed.rotation, closed.translation - travel * direction)
    surface = LineSurface.of_obstacle(pp.Obstacle("finger", shape))
    return MovingFinger("finger", ((surface, SE3.Identity()),), (start, closed), direction)


def test_fingers_that_close_along_an_oblique_approach_touch_the_part_over_the_common_rectangle() -> None:
    rng = np.random.default_rng(2)
    for _ in range(5):
        frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        frame *= np.sign(np.linalg.det(frame))
        along, at = frame[:, 2], rng.uniform(-0.1, 0.1, 3)
        pads = [
            finger_of(pp.Box(0.02, 0.04, 0.01), SE3(frame, at - side * 0.02 * along), side * along, 0.02)
            for side in (1.0, -1.0)
        ]
        part = HeldPart(LineSurface.of_obstacle(pp.Obstacle("block", pp.Box(0.03, 0.03, 0.03))), SE3(frame, at))
        result = grip_by_fingers(pads, part, along, pp.picks.GripLimits())
        assert result.held, result.message
        for contact in result.contacts:
            assert contact.contact_area == pytest.approx(0.02 * 0.03, rel=SAMPLED)
            assert contact.gap == pytest.approx(0.0, abs=1e-6)


def test_a_contact_before_that_of_the_lines_is_where_two_spheres_meet() -> None:
    rng, met = np.random.default_rng(4), 0
    for _ in range(40):
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        travel, (own, other) = rng.uniform(0.02, 0.08), rng.uniform(0.005, 0.02, 2)
        at, middle = rng.uniform(-0.02, 0.02, (2, 3))
        finger = finger_of(pp.Sphere(own), SE3(np.eye(3), at), direction, travel)
        part = HeldPart(LineSurface.of_obstacle(pp.Obstacle("ball", pp.Sphere(other))), SE3(np.eye(3), middle))
        # |at + s direction - middle| = own + other
        half, rest = direction @ (at - middle), (at - middle) @ (at - middle) - (own + other) ** 2
        root = half**2 - rest
        touch = -half - np.sqrt(root) if root > 0 else np.inf
        if touch < -travel + 1e-4 or abs(touch) < 1e-4 or abs(root) < 1e-5:
            continue  # in contact at the start, or hardly at all
        (surface, placed) = finger.surfaces[0]
        found = _earlier_contact(np.inf, surface, finger.closed * placed, part, finger)
        assert found == (pytest.approx(touch, abs=1e-4) if touch < 0 else np.inf)
        if touch < 0:
            met += 1
            assert _earlier_contact(touch - 1e-3, surface, finger.closed * placed, part, finger) == np.inf
    assert met > 5
