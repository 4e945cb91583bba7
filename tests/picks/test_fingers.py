"""Fingers: their closing motion in the frame of the tcp, random grasps, and a robot's own fingers."""

from __future__ import annotations

import pickle
from collections import Counter
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import pinproof as pp
from pinproof.collision import Mesh
from pinproof.collision.checking.line_surface import LineSurface
from pinproof.collision.geometry.bodies import bodies_of
from pinproof.collision.geometry.hulls import spiral_directions
from pinproof.errors import InputError, UnknownNameError
from pinproof.picks import GripLimits, Stage
from pinproof.picks.judging.grip import (
    FLAT,
    SAGITTA,
    SAMPLED,
    MovingFinger,
    PlacedSurface,
    _earlier_contact,
    fingers_of,
    grip_by_fingers,
    too_far_to_hold,
)
from pinproof.spatial import SE3

from . import grip_oracle as oracle
from .conftest import DOWN, judge_in

BALL = spiral_directions(1000)
"""Unit vectors, of which one is within 0.09 rad of each direction."""

# -- the closing motion ------------------------------------------------------------------------------------------------

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
START, CLOSED = 0.1, 0.9
PADS = ("left_pad", "right_pad")
DIRECTION = np.array([0.0, 0.0, 1.0])

STEPS = np.linspace(START, CLOSED, 151).tolist()
"""Values of the closing joint."""


@pytest.fixture(scope="module")
def pincer() -> pp.Arm:
    return pp.load_robot(ROBOT).arm(tcp="hand", held={"left_joint": START})


@lru_cache(maxsize=2 * len(STEPS))
def bodies(arm: pp.Arm, value: float) -> dict[str, pp.SE3]:
    there = arm.with_held({"left_joint": value})
    hand = there.forward_kinematics(there.home)
    return {name: hand.actInv(there.frame_placement(there.home, name)) for name in ("left_knuckle", *PADS)}


@pytest.mark.slow
def test_swept_bodies_hold_every_point_of_rotating_fingers_and_little_more(pincer) -> None:
    found = {finger.name: finger for finger in fingers_of(pincer, None, {"left_joint": CLOSED})}
    assert set(found) == {"left_knuckle", "right_knuckle", *PADS}
    turns = np.linspace(0, 2 * np.pi, 40)
    rim = np.column_stack([0.006 * np.cos(turns), 0.006 * np.sin(turns), np.zeros(40)])
    own = {
        "left_pad": np.concatenate([rim, rim + np.array([0, 0, 0.04])]),
        "left_knuckle": np.array(np.meshgrid((-0.005, 0.005), (-0.006, 0.006), (0.0, 0.06))).reshape(3, 8).T,
    }
    for name, points in own.items():
        shapes = [each.shape for each in found[name].swept()]
        # The hull of points on the balls is inside the body, and at most 0.4 % of their radius below its surface.
        swept = [(shape.points[:, None] + shape.radius * BALL).reshape(-1, 3) for shape in shapes]
        faces, reached, last = [ConvexHull(each).equations for each in swept], [], 0
        deep = 0.004 * max(shape.radius for shape in shapes)
        for value in STEPS:
            at = bodies(pincer, value)[name]
            placed = points @ at.rotation.T + at.translation
            outside = placed
            for k in sorted(
                range(len(faces)), key=lambda k, last=last: abs(k - last)
            ):  # the hull of the last step first
                outside = outside[(outside @ faces[k][:, :3].T + faces[k][:, 3] > deep).any(axis=1)]
                if not len(outside):
                    last = k
                    break
            assert not len(outside), (name, value)
            reached.append(placed)
        corners, reached = np.concatenate(swept), np.concatenate(reached)
        assert 0 < found[name].sagitta <= SAGITTA
        if name == "left_knuckle":
            assert (corners.min(axis=0) >= reached.min(axis=0) - 2 * SAGITTA - 1e-6).all()
            assert (corners.max(axis=0) <= reached.max(axis=0) + 2 * SAGITTA + 1e-6).all()
    # The closing direction is that of the end of the motion
    for name in ("left_knuckle", *PADS):
        middle = np.array([0, 0, 0.03 if name == "left_knuckle" else 0.02])
        ends = [bodies(pincer, value)[name].act(middle) for value in (CLOSED - 1e-6, CLOSED)]
        along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        np.testing.assert_allclose(found[name].direction, along, atol=1e-3)


def test_rotating_fingers_hold_a_part_between_their_pads(pincer) -> None:
    """The pads are nearly parallel cylinders; a block as wide as they leave is held, others are not."""
    closed = 0.25
    found = fingers_of(pincer, None, {"left_joint": closed})
    _, inner, height = bodies(pincer, closed)["left_pad"].act(np.array([0, 0, 0.02])) - [0, 0.006, 0]
    for width, held in ((2 * inner, True), (2 * inner + 0.008, False), (2 * inner - 0.008, False)):
        block = LineSurface.of_obstacle(pp.Obstacle("block", pp.Box(0.03, width, 0.02)))
        part = PlacedSurface(block, pp.pose((0, 0, height)))
        result = grip_by_fingers(found, part, DIRECTION, GripLimits())
        assert result.held is held, result.message


def test_distances_alone_refuse_only_fingers_that_do_not_hold_the_part(pincer) -> None:
    """Blocks of widths around the one that is held, at poses around the middle, with random limits."""
    found = fingers_of(pincer, None, {"left_joint": 0.25})
    _, inner, height = bodies(pincer, 0.25)["left_pad"].act(np.array([0, 0, 0.02])) - [0, 0.006, 0]
    rng, outcomes = np.random.default_rng(4), Counter[tuple[bool, bool]]()
    for _ in range(60):
        block = LineSurface.of_obstacle(pp.Obstacle("block", pp.Box(0.03, 2 * inner + rng.uniform(-0.008, 0), 0.02)))
        part = PlacedSurface(block, pp.pose((0, rng.uniform(-0.003, 0.003), height), (rng.uniform(-0.05, 0.05), 0, 0)))
        limits = GripLimits(gap=rng.uniform(0, 0.003), depth=rng.uniform(0, 0.003), area=1e-7, overlap=1e-4)
        held = grip_by_fingers(found, part, DIRECTION, limits).held
        outcomes[held, too_far_to_hold(found, part, limits)] += 1
    assert outcomes[True, True] == 0
    assert min(outcomes[True, False], outcomes[False, True]) > 4


def finger_of(shape: pp.Shape, closed: SE3, direction: np.ndarray, travel: float) -> MovingFinger:
    """A body that translates along ``direction`` (3,) by ``travel`` (m) to its closed pose."""
    start = SE3(closed.rotation, closed.translation - travel * direction)
    surface = LineSurface.of_obstacle(pp.Obstacle("finger", shape))
    return MovingFinger("finger", (PlacedSurface(surface, SE3.Identity()),), (start, closed), direction)


@pytest.mark.parametrize("offset", [(0, 0, 0), (0.1, 0.2, 0.3), (-0.3, 0.05, -0.2)])
@pytest.mark.parametrize("axis", range(3))
def test_the_swept_body_of_a_flat_finger_is_somewhat_thicker_if_it_closes_in_its_plane(offset, axis: int) -> None:
    corners = np.insert(np.array([(0, 0), (0.02, 0), (0, 0.03), (0.02, 0.03)]), axis, 0.0, axis=1) + offset
    sheet = Mesh(vertices=corners, triangles=np.array([(0, 1, 2), (1, 3, 2)]), hull=False, hollow=True)
    for direction in np.eye(3):
        (swept,) = finger_of(sheet, SE3.Identity(), direction, 0.01).swept()
        (body,) = bodies_of(swept, "hand")
        grow = FLAT if direction[axis] == 0 else 0.0
        np.testing.assert_allclose(np.ptp(body.box, axis=0), np.ptp(corners, axis=0) + 0.01 * direction + 2 * grow)


def test_fingers_that_close_along_an_oblique_approach_touch_the_part_over_the_common_rectangle() -> None:
    rng = np.random.default_rng(2)
    for _ in range(5):
        frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        frame *= np.sign(np.linalg.det(frame))
        along, at = frame[:, 2], rng.uniform(-0.1, 0.1, 3)
        closed = {side: SE3(frame, at - side * 0.02 * along) for side in (1.0, -1.0)}
        pads = [finger_of(pp.Box(0.02, 0.04, 0.01), pose, side * along, 0.02) for side, pose in closed.items()]
        part = PlacedSurface(LineSurface.of_obstacle(pp.Obstacle("block", pp.Box(0.03, 0.03, 0.03))), SE3(frame, at))
        result = grip_by_fingers(pads, part, along, GripLimits())
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
        part = PlacedSurface(LineSurface.of_obstacle(pp.Obstacle("ball", pp.Sphere(other))), SE3(np.eye(3), middle))
        # |at + s direction - middle| = own + other
        half, rest = direction @ (at - middle), (at - middle) @ (at - middle) - (own + other) ** 2
        root = half**2 - rest
        touch = -half - np.sqrt(root) if root > 0 else np.inf
        if touch < -travel + 1e-4 or abs(touch) < 1e-4 or abs(root) < 1e-5:
            continue  # in contact at the start, or hardly at all
        found = _earlier_contact(np.inf, finger.surfaces[0], part, finger)
        assert found == (pytest.approx(touch, abs=1e-4) if touch < 0 else np.inf)
        if touch < 0:
            met += 1
            assert _earlier_contact(touch - 1e-3, finger.surfaces[0], part, finger) == np.inf
    assert met > 5


# -- random grasps: none is called held that an independent measurement does not hold ----------------------------------

COUNT = 50
"""Number of grasps. An error in 6 % of the grasps is found with a probability of 95 %."""
ROUNDING = 0.05
"""Share of a limit within which sampled areas of the two may be on different sides of it."""


@pytest.mark.slow
def test_no_random_grasp_is_called_held_that_does_not_hold(arms) -> None:
    wrong, refused, seen = [], [], Counter()
    for index in range(COUNT):
        rng = np.random.default_rng([7, index])
        grasp = oracle.random_grasp(rng)
        part = PlacedSurface(LineSurface.of_obstacle(pp.Obstacle("part", grasp.shape)), grasp.pose)
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
    limits, count = GripLimits(), 1500
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
        part = PlacedSurface(LineSurface.of_obstacle(pp.Obstacle("part", shape)), SE3(turn, offset))
        moving = fingers_of(arms["ur5"], hand, {})

        def held(part=part, moving=moving, **limits: float) -> bool:
            return grip_by_fingers(moving, part, DIRECTION, GripLimits(**limits)).held

        assert not held(area=1.0005 * area, overlap=0.0)  # the formulas are sampled too, to 0.05 %
        assert not held(area=0.0, overlap=1.002 * extent)
        assert held(area=(1 - 4 * SAMPLED) * area, overlap=(1 - 4 * SAMPLED) * extent)


# -- a robot's own fingers: open up to the grasp, on the object from there until it is let go --------------------------

OPEN, GRIP = 0.04, 0.0195
"""Of each finger; the cube is 40 mm wide, so they stand 0.5 mm in it, as rubber would."""

FINGERS = ("panda_leftfinger", "panda_rightfinger")
BUDGET = pp.picks.PickBudget(remedies=0)
CUBE = pp.Obstacle("cube", pp.Box(0.04, 0.04, 0.04), pp.pose((0.5, 0.1, 0.0155)))
PLACE = pp.picks.PlaceTarget(pp.pose((0.45, -0.25, 0.02), DOWN))
PICK = pp.Pick("cube", pp.pose((0.5, 0.1, 0.02), DOWN), carried="cube", place=PLACE)


@pytest.fixture(scope="module")
def arm() -> pp.Arm:
    return pp.load_robot("panda").arm(held={"panda_finger_joint1": OPEN})


def judge(arm: pp.Arm, pick: pp.Pick, *obstacles: pp.Obstacle) -> pp.picks.PickVerdict:
    table = pp.Obstacle("table", pp.Box(1.5, 1.3, 0.04), pp.pose((0.4, 0, -0.025)))
    scene = pp.Scene([table, CUBE, *obstacles], allowed=[("panda_link0", "table")])
    fingers = {"held": {"panda_finger_joint1": OPEN}, "grip": {"panda_finger_joint1": GRIP}}
    return judge_in(arm, scene, pick, budget=BUDGET, margin=0.002, **fingers)


@pytest.fixture(scope="module")
def good(arm) -> pp.picks.PickVerdict:
    verdict = judge(arm, PICK)
    assert verdict.ok, verdict.reason
    return verdict


def test_each_motion_states_its_finger_positions_and_is_proven_with_them(arm, good) -> None:
    def gap(motion: pp.picks.PickMotion) -> float:
        there = arm.with_held(motion.held)
        left, right = (there.frame_placement(good.q_grasp, link).translation for link in FINGERS)
        return float(np.linalg.norm(left - right))

    closed = dict.fromkeys(("retreat", "transfer", "place"), 2 * GRIP)
    expected = {**dict.fromkeys(("transit", "approach", "leave"), 2 * OPEN), **closed}
    assert {motion.name: gap(motion) for motion in good.motions} == pytest.approx(expected)
    for motion in good.motions:
        there = arm.with_held(motion.held)
        certificate = motion.certificate
        assert certificate.free
        assert certificate.matches(motion.trajectory, there, motion.scene, motion.attached)
        allowed = [*(parting.bodies for parting in certificate.partings), *((each, "cube") for each in FINGERS)]
        checker = pp.CollisionChecker(there, motion.scene, attached=motion.attached, allowed=allowed)
        assert all(checker.is_free_batch(motion.trajectory(np.linspace(0.0, motion.trajectory.duration, 120))))
    transit, retreat = good.motions[0], good.motions[2]
    assert not transit.certificate.matches(transit.trajectory, arm.with_held(retreat.held), transit.scene)
    # Without an allowed pair the closed fingers collide with the part
    checker = pp.CollisionChecker(arm.with_held(retreat.held), retreat.scene, attached=retreat.attached)
    touching = {name for contact in checker.check(retreat.trajectory.end).contacts for name in contact.bodies}
    assert touching == {*FINGERS, "cube"}


def test_open_fingers_meet_a_wall_that_gripping_ones_do_not(arm) -> None:
    # Between the 30 mm of the closed finger's outer face and the 50 mm of the open one's.
    beside = pp.Obstacle("wall", pp.Box(0.3, 0.005, 0.05), pp.pose((0.5, 0.1 + 0.052, 0.025)))
    verdict = judge(arm, replace(PICK, place=None), beside)
    assert verdict.failed is Stage.GRASP
    assert "wall" in verdict.reason
    assert "finger" in verdict.reason
    closed = arm.with_held({"panda_finger_joint1": GRIP})
    checker = pp.CollisionChecker(closed, pp.Scene([beside]))
    target = closed.root_from_base.actInv(PICK.pose)
    assert any(checker.is_free(pp.Clik().solve(closed, target, rng=seed).q) for seed in range(8))


def test_fingers_that_cannot_grip_are_refused(arm) -> None:
    for grip, named in (
        ({"panda_finger_joint1": 0.05}, "0.05 (grip) is outside its limits [0, 0.04]"),
        ({"panda_finger_joint2": 0.02}, "unknown joint 'panda_finger_joint2'"),
        ({"panda_joint3": 0.02}, "unknown joint 'panda_joint3'"),
    ):
        with pytest.raises((InputError, UnknownNameError)) as refused:
            pp.validate_picks(arm, pp.Scene(), pp.Picks((PICK,), grip=grip))
        assert named in str(refused.value)
        assert "panda_finger_joint1" in str(refused.value)  # the only valid choice
    upper = pp.load_robot("panda").arm(base="panda_link2")
    with pytest.raises(InputError, match="the tcp 'panda_hand_tcp' is moved by panda_joint1"):
        pp.validate_picks(upper, pp.Scene(), pp.Picks((PICK,), grip={"panda_joint1": 0.5}))


def test_a_checker_derived_with_other_held_joints_equals_a_new_one(arm) -> None:
    closed = {"panda_finger_joint1": GRIP}
    derived = pp.CollisionChecker(arm, pp.Scene()).with_held(closed)
    made = pp.CollisionChecker(pp.load_robot("panda").arm(held=closed), pp.Scene())
    assert derived.fingerprint() == made.fingerprint()
    assert derived.arm.held == {"panda_finger_joint1": GRIP, "panda_finger_joint2": GRIP}
    assert derived.clearance(arm.home) == made.clearance(arm.home)
    assert derived.with_held(closed) is derived


def test_a_set_up_carries_the_grip_to_other_processes(arm) -> None:
    scene = pp.Scene([CUBE])
    shared = pp.Picks((), held={"panda_finger_joint1": OPEN}, grip={"panda_finger_joint1": GRIP})
    setup = pp.picks.PickSetup.make(arm, scene, shared, home=None, rng=0, budget=BUDGET)
    pick = replace(PICK, place=None)
    one, other = (each.judge(0, pick) for each in (setup, pickle.loads(pickle.dumps(setup))))
    assert [motion.held for motion in one.motions] == [motion.held for motion in other.motions]
    assert one.motions[2].held["panda_finger_joint2"] == GRIP
    assert one.motions[2].certificate.setup == other.motions[2].certificate.setup
    assert setup.identity()["hand"] != replace(setup, shared=replace(shared, grip={})).identity()["hand"]
