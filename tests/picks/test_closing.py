"""Fingers close until two of them touch the part: against dense samples of the motion, and in whole picks."""

from __future__ import annotations

from dataclasses import replace

import coal
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import pinproof as pp
from pinproof.collision import TOUCH
from pinproof.collision.checking.line_surface import LineSurface
from pinproof.errors import InputError
from pinproof.picks import PickSetup, PickTask, Stage
from pinproof.picks.judging.grip import PlacedSurface, close_on, fingers_of
from pinproof.spatial import SE3

from .conftest import QUICK, figures
from .test_fingers import ROBOT
from .test_grip import CUBE, SIDE, fingers, grasp, judge

END = 1.2
"""rad: the limit of the joint of the pincer."""

SAMPLES = np.linspace(0.0, END, 201)

SLACK = 2e-6
"""Metres: the tolerance of coal's distances."""


@pytest.fixture(scope="module")
def pincer() -> pp.Arm:
    return pp.load_robot(ROBOT).arm(tcp="hand", held={"left_joint": 0.0})


@pytest.fixture(scope="module")
def arm(arms) -> pp.Arm:
    return arms["ur5"]


def _rx(angle: float, y: float, z: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0, 0], [0, c, -s, y], [0, s, c, z], [0, 0, 0, 1.0]])


def distance(side: float, value: float, part, at: SE3) -> float:
    """The distance (m) of the knuckle and the pad of one side from a part, by coal and own kinematics."""
    knuckle, pad = coal.Box(0.01, 0.012, 0.06), coal.Cylinder(0.006, 0.04)
    hand_from_knuckle = _rx(side * value, side * 0.03, 0.02)
    hand_from_pad = hand_from_knuckle @ _rx(-side * 0.9 * value, 0, 0.06)
    placed, found = coal.Transform3s(at.rotation, at.translation), []
    for shape, pose, up in ((knuckle, hand_from_knuckle, 0.03), (pad, hand_from_pad, 0.02)):
        there, result = pose @ _rx(0.0, 0.0, up), coal.DistanceResult()
        own = coal.Transform3s(there[:3, :3], there[:3, 3])
        found.append(coal.distance(shape, own, part, placed, coal.DistanceRequest(), result))
    return float(min(found))


SIZES = st.floats(0.004, 0.03)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=100)
@given(
    kind=st.sampled_from(["box", "sphere", "cylinder"]),
    size=st.tuples(SIZES, SIZES, SIZES),
    at=st.tuples(st.floats(-0.01, 0.01), st.floats(-0.02, 0.02), st.floats(0.03, 0.13)),
    turn=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
)
def test_the_second_contact_of_rotating_fingers_is_that_of_dense_samples(pincer, kind, size, at, turn) -> None:
    shape, solid = {
        "box": (pp.Box(*size), coal.Box(*size)),
        "sphere": (pp.Sphere(radius=size[0]), coal.Sphere(size[0])),
        "cylinder": (pp.Cylinder(radius=size[0], length=size[1]), coal.Cylinder(size[0], size[1])),
    }[kind]
    placed = pp.pose(at, turn)
    part = PlacedSurface(LineSurface.of_obstacle(pp.Obstacle("part", shape)), placed)
    found = close_on(fingers_of(pincer, None, {"left_joint": END}), part)
    share, ahead = found.share * END, found.ahead * END

    def apart(link: str, value: float) -> float:
        return distance(1.0 if link.startswith("left") else -1.0, value, solid, placed)

    # Each finger is within the tolerance of the part where it reportedly touches it, and touches it at no sample before
    for link, at_contact in ((found.first, share - ahead), (found.second, share)):
        if link:
            assert apart(link, at_contact) <= TOUCH + SLACK
            assert all(apart(link, value) > 0.0 for value in SAMPLES[at_contact > SAMPLES])
    missing = {"left", "right"} - {link.partition("_")[0] for link in (found.first, found.second)}
    assert all(apart(side, value) > 0.0 for side in missing for value in SAMPLES)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(width=st.floats(0.005, 0.045), off=st.floats(-0.002, 0.002))
def test_straight_fingers_close_to_the_width_of_the_part_and_twice_its_offset(arm, width: float, off: float) -> None:
    block = PlacedSurface(
        LineSurface.of_obstacle(pp.Obstacle("block", pp.Box(0.02, width, 0.04))), pp.pose((0, off, 0.14))
    )
    found = close_on(fingers_of(arm, replace(fingers(), grip=None), {}), block)
    opening = fingers().opening
    assert abs((1 - found.share) * opening - (width - 2 * abs(off))) <= 4 * TOUCH
    assert abs(found.ahead * opening - 4 * abs(off)) <= 4 * TOUCH
    if abs(off) > TOUCH:
        assert (found.first, found.second) == (("finger_1", "finger_2") if off > 0 else ("finger_2", "finger_1"))


def test_fingers_that_state_no_grip_hold_the_part_as_those_that_state_its_width(arm) -> None:
    stated, found = judge(arm, grasp()), judge(arm, grasp(), fingers=fingers(grip=None))
    assert stated.ok
    assert found.ok
    for key, value in figures(stated, Stage.GRIP).items():
        assert figures(found, Stage.GRIP)[key] == pytest.approx(value, abs=3e-5, rel=0.01), key
    assert f"closed by contact at {SIDE * 1e3:.2f} mm" in next(s.message for s in found.stages if s.stage is Stage.GRIP)
    closed = {body.name: body.pose.translation[1] for body in found.motions[-1].attached}
    assert closed["finger_1"] == pytest.approx(0.005 + SIDE / 2, abs=2 * TOUCH)


@pytest.mark.parametrize(
    ("pick", "reason"),
    [
        (grasp((0.0, 0.003, -0.015)), "is not in the middle of the hand"),
        (grasp((0.0, 0.0, 0.02)), "no finger touches cube while the fingers close completely"),
        (grasp((0.0, 0.02, -0.015)), "the open finger_1 overlaps cube"),
    ],
)
def test_a_part_that_the_fingers_do_not_meet_together_is_not_held(arm, pick: pp.Pick, reason: str) -> None:
    verdict = judge(arm, pick, fingers=fingers(grip=None))
    assert verdict.failed is Stage.GRIP
    assert reason in verdict.reason


def test_the_figure_of_a_part_beside_the_middle_is_the_way_of_one_finger_between_the_contacts(arm) -> None:
    verdict = judge(arm, grasp((0.0, 0.003, -0.015)), fingers=fingers(grip=None))
    assert "finger_2 touches it 6.00 mm before finger_1" in verdict.reason or "6.00 mm before" in verdict.reason
    assert figures(verdict, Stage.GRIP)["pressed_in"] == pytest.approx(0.006, abs=2 * TOUCH)


def test_links_close_by_contact_and_the_program_states_the_joint_values() -> None:
    scene = pp.Scene([pp.Obstacle("cube", pp.Box(0.02, 0.02, 0.04), pp.pose((0.5, 0.0, 0.02)))])
    pick = pp.Pick("cube", pp.pose((0.5, 0.0, 0.02), (np.pi, 0, 0)), carried="cube", retreat=0.05)
    shared = {"held": {"panda_finger_joint1": 0.04}, "gripper": ("panda_hand",)}
    arm = pp.load_robot("panda").arm(held=shared["held"])
    tip = pp.pose((0, 0, 0)) if arm.tcp != "panda_hand" else pp.pose((0, 0, 0.1034))
    found = pp.validate_picks(
        arm, scene, pp.Picks((pick,), grip={"panda_finger_joint1": None}, tip=tip, **shared), budget=QUICK
    )
    (verdict,) = found.verdicts
    assert verdict.ok, verdict
    assert verdict.motions[-1].held["panda_finger_joint1"] == pytest.approx(0.01, abs=5e-5)
    assert verdict.program().events[0].joints["panda_finger_joint1"] == pytest.approx(0.01, abs=5e-5)


def test_fingers_of_which_only_some_state_their_closed_position_are_refused() -> None:
    panda = pp.load_robot("panda").arm(held={"panda_finger_joint1": 0.04})
    shared = pp.Picks((), held={"panda_finger_joint1": 0.04}, grip={"panda_finger_joint1": None}, fingers=fingers())
    with pytest.raises(InputError, match="only some of the fingers state a grip"):
        PickSetup.make(panda, pp.Scene(), shared, home=None, rng=0)


def test_grasps_of_equal_parts_share_the_checkers_of_the_closed_hand(arm) -> None:
    other = replace(CUBE, name="other", pose=pp.pose((0.3, 0.3, 0.0)) * CUBE.pose)
    scene = pp.Scene([CUBE, other])
    setup = PickSetup.make(arm, scene, pp.Picks((), fingers=fingers(grip=None)), home=None, rng=0)
    one, two = grasp(), replace(grasp(), name="other", pose=pp.pose((0.3, 0.3, 0.0)) * grasp().pose, carried="other")
    cells = {id(task.closed(task.nearest_group[0])) for pick in (one, two) for task in (PickTask(pick, setup.cell),)}
    assert len(cells) == 1
