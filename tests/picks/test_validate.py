"""Lists of picks: invalid homes, workers, the limits of good verdicts, random streams, and more."""

from __future__ import annotations

import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import pinproof as pp
from pinproof.errors import InputError
from pinproof.ik import Clik
from pinproof.model import load_robot
from pinproof.picks import PickBudget, PickSetup, Stage, SuctionCup
from pinproof.picks.input.picks import NamedFrame, PickProblem
from pinproof.picks.report.report import COLUMNS

from .conftest import judge_in


def part(arm: pp.Arm, angle: float = 0.5, name: str = "part") -> pp.Pick:
    pose = pp.pose(rpy=(0, 0, angle)) * arm.root_from_base * arm.forward_kinematics(arm.home)
    return pp.Pick(name, pose, approach=0.02, retreat=0.02)


@pytest.fixture(scope="module")
def arm(arms) -> pp.Arm:
    return arms["generic_6dof"]


def test_workers_change_nothing(arms, cells, reports) -> None:
    with ThreadPoolExecutor(2) as executor:  # to which the work is sent pickled, as to processes
        for name in ("generic_6dof", "ur5"):
            report = pp.validate_picks(arms[name], *cells[name], executor=executor)
            assert report.to_dict() == reports[name].to_dict()
            scene, picks = cells[name]
            for one, other in zip(report.good, reports[name].good, strict=True):
                assert one.trajectory.q.tobytes() == other.trajectory.q.tobytes()
                assert one.certificate.matches(other.trajectory, arms[name], scene, picks.tool)
                assert one.certificate.clearance == pytest.approx(other.certificate.clearance, abs=1e-9)
                assert one.certificate.intervals == other.certificate.intervals


def test_a_report_survives_pickling(reports) -> None:
    again = pickle.loads(pickle.dumps(reports["panda"]))
    assert again.to_dict() == reports["panda"].to_dict()


def test_a_plain_list_of_picks_is_accepted_and_anything_else_is_named(arm) -> None:
    budget = pp.picks.PickBudget(remedies=0)
    plain, picks = (pp.validate_picks(arm, pp.Scene(), p, budget=budget) for p in ([part(arm)], pp.Picks((part(arm),))))
    assert [verdict.pick.name for verdict in plain.verdicts] == ["part"]
    assert plain.verdicts[0].status == picks.verdicts[0].status
    with pytest.raises(InputError, match=r"picks\[1\] must be of type Pick"):
        pp.validate_picks(arm, pp.Scene(), [part(arm), "part"])


def test_a_home_in_contact_or_outside_the_limits_is_refused_with_the_reason(arm) -> None:
    at = arm.forward_kinematics(arm.home).translation
    scene = pp.Scene([pp.Obstacle("rock", pp.Sphere(0.05), pp.pose(at))])
    with pytest.raises(InputError, match=r"home .* link_6 penetrates rock") as caught:
        pp.validate_picks(arm, scene, pp.Picks((part(arm),)))
    assert str(caught.value).count("link_6") == 1  # it has several bodies; the deepest contact says it

    margin = pp.CollisionChecker(arm).clearance(arm.home) + 1e-3
    for home, settings, named in (
        (None, {"margin": margin}, r"home .* is [\d.]+ mm from "),
        (arm.home + np.eye(6)[5] * 7.0, {}, "joint_6 = 7 is outside"),
        ([0.0] * 5, {}, "home"),
        ([np.nan] * 6, {}, "home"),
        ("home", {}, "home"),
    ):
        with pytest.raises(InputError, match=named):
            judge_in(arm, pp.Scene(), part(arm), home=home, **settings)


def test_home_is_the_argument_then_the_list_then_the_arm(arm) -> None:
    stated = dict(zip(arm.joint_names, (arm.home + 0.1).tolist(), strict=True))
    picks = pp.Picks((part(arm),), home=stated)
    for given, start in ((None, arm.home + 0.1), (arm.home + 0.2, arm.home + 0.2)):
        (verdict,) = pp.validate_picks(arm, pp.Scene(), picks, home=given).verdicts
        np.testing.assert_allclose(verdict.trajectory.start, start, atol=1e-15)
    report = pp.validate_picks(arm, pp.Scene(), pp.Picks((part(arm),)))
    np.testing.assert_array_equal(report.verdicts[0].trajectory.start, arm.home)
    # A report is ok if all picks are good and there is one
    assert report.ok
    empty = pp.validate_picks(arm, pp.Scene(), pp.Picks(()))
    assert (empty.ok, empty.summary) == (False, "0 of 0 picks good")


def test_an_unreadable_row_makes_the_report_a_no(arm) -> None:
    problem = PickProblem(2, "torn | page", "xyz holds nan\nat index 1")
    report = pp.validate_picks(arm, pp.Scene(), pp.Picks((part(arm),), (problem,)))
    assert len(report.good) == 1
    assert not report.ok
    assert report.summary == "1 of 2 picks good; failed: 1 at input"
    assert report.rows()[-1][:3] == ("torn | page", "unreadable", "input")
    (row,) = (line for line in report.to_markdown().splitlines() if "torn" in line)
    assert row.replace("\\|", "").count("|") == len(COLUMNS) + 1
    assert report.to_dict()["problems"] == [{"row": 2, "name": problem.name, "reason": problem.reason}]


def test_a_joint_without_velocity_is_refused_before_the_work(arm) -> None:
    velocity = arm.limits.velocity.copy()
    velocity[2] = np.nan
    untimed = arm.with_limits(pp.JointLimits(arm.limits.lower, arm.limits.upper, velocity))
    with pytest.raises(InputError, match="joint_3 has no velocity"):
        pp.validate_picks(untimed, pp.Scene(), pp.Picks((part(arm),)))


# -- what a good verdict does not cover -------------------------------------------------------------------------------


def notes_of(arm: pp.Arm, *obstacles: pp.Obstacle) -> str:
    return "\n".join(pp.validate_picks(arm, pp.Scene(obstacles), pp.Picks(())).notes)


def test_limits_of_a_good_verdict_are_noted(arm, tmp_path) -> None:
    assert "no obstacles" in notes_of(arm)
    aside = pp.pose((2, 2, 0))
    assert "no obstacles" not in notes_of(arm, pp.Obstacle("block", pp.Box(1, 1, 1), aside))
    (tmp_path / "open.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n")
    sheet = pp.Obstacle("sheet", pp.Mesh(tmp_path / "open.obj", hull=False, hollow=True), aside)
    assert "not watertight: sheet" in notes_of(arm, sheet)


GHOST = """<robot name="ghost"><link name="a">{0}</link><link name="b">{1}</link>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""
BALL = "<{0}><geometry><sphere radius='0.1'/></geometry></{0}>"


def test_links_that_are_drawn_but_touch_nothing_are_named() -> None:
    drawn, solid = BALL.format("visual"), BALL.format("visual") + BALL.format("collision")
    ghost, bodiless, complete = (
        load_robot(GHOST.format(*each)).arm(tcp="b") for each in ((solid, drawn), (drawn, drawn), (solid, solid))
    )
    assert "no collision geometry: b" in notes_of(ghost)
    assert "the robot has no collision geometry" in notes_of(bodiless)
    assert "collision geometry" not in notes_of(complete)
    # A robot that can touch nothing still makes valid JSON
    pick = pp.Pick("turn", pp.pose(rpy=(0, 0, 0.5)), approach=0, retreat=0)
    stone = pp.Obstacle("stone", pp.Sphere(0.1))
    report = pp.validate_picks(bodiless, pp.Scene([stone]), pp.Picks((pick,)))
    assert report.verdicts[0].ok
    data = report.to_dict()["picks"][0]
    assert (data["clearance_proven"], data["pairs_proven"]) == (None, 0)
    assert "unbounded (no pair is checked)" in report.to_markdown()


def test_a_solution_that_only_the_wider_search_meets_is_still_a_solution(arm, monkeypatch) -> None:
    real = Clik.solve_many

    def unlucky(self, limited, *args, **settings):
        found = real(self, limited, *args, **settings)
        narrow = np.array_equal(limited.limits.upper, arm.limits.upper)
        return real(self, limited, *args, **{**settings, "accept": lambda q: False}) if narrow else found

    monkeypatch.setattr(Clik, "solve_many", unlucky)
    (verdict,) = pp.validate_picks(arm, pp.Scene(), pp.Picks((part(arm),))).verdicts
    assert verdict.ok
    missed = pp.IkResult(pp.ik.IkStatus.NOT_FOUND, arm.home, 0.1, 0.1, 1, 0, "pinocchio", "missed")
    monkeypatch.setattr(Clik, "solve", lambda *args, **settings: missed)
    direct = pp.Pick("part", part(arm).pose, approach=0, retreat=0)  # straight moves solve by Clik.solve
    (verdict,) = pp.validate_picks(arm, pp.Scene(), pp.Picks((direct,))).verdicts
    assert verdict.ok


@pytest.mark.slow
def test_the_stage_reports_how_far_the_best_configuration_got(arms) -> None:
    # Some configurations meet the stone at the grasp, others only the post on the retreat: the verdict tells of those.
    arm = arms["generic_6dof"]
    pick = part(arm, 0.8)
    found = Clik().solve_many(arm, arm.root_from_base.actInv(pick.pose), arm.home, rng=1)
    aside = pick.pose.rotation[:, 0]
    post = pp.Obstacle("post", pp.Sphere(0.05), pp.pose(pick.pose.translation + 0.16 * aside))
    elbows = [arm.frame_placement(q, "dh_2").translation for q in found.q]
    cells = (pp.Scene([post, pp.Obstacle("stone", pp.Sphere(0.03), pp.pose(elbow))]) for elbow in elbows)
    cell, checker = next((c, k) for c in cells if (k := pp.CollisionChecker(arm, c, margin=0.002)).is_free(arm.home))
    assert {checker.is_free(q) for q in found.q} == {True, False}
    blocked = pp.Pick("part", pick.pose, approach=0.02, retreat=0.16, retreat_direction=tuple(aside))
    (verdict,) = pp.validate_picks(arm, cell, pp.Picks((blocked,), margin=0.002)).verdicts
    assert verdict.failed is Stage.RETREAT


@pytest.mark.parametrize("objects", [(), (None,), ("block",), (None, "block")])
def test_notes_on_objects_apply_only_to_the_picks_that_state_them(stick, objects) -> None:
    empty, held = None in objects, "block" in objects
    block = pp.Obstacle("block", pp.Box(0.1, 0.1, 0.1), pp.pose((9, 9, 9)))
    picks = [pp.Pick(f"pick {k}", pp.pose((30, 0, 0)), carried=carried) for k, carried in enumerate(objects)]
    notes = "\n".join(pp.validate_picks(stick, pp.Scene([block]), picks).notes)
    assert ("empty gripper" in notes) == empty
    assert ("holding force" in notes) == held
    assert ("holding force of a tool without fingers" in notes) == held
    cup = pp.Picks(tuple(picks), cup=SuctionCup(radius=0.01))
    notes = "\n".join(pp.validate_picks(stick, pp.Scene([block]), cup).notes)
    assert ("holding force of the suction cup; only that its rim lies on the surface" in notes) == held
    assert "without fingers" not in notes


CHAIN = """<robot name="chain"><link name="a"/>
<link name="b"/>
<link name="c"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="first" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="last" type="revolute"><parent link="b"/><child link="c"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""


def test_what_limits_of_torque_leave_out_is_noted() -> None:
    arm = load_robot(CHAIN).arm(tcp="c")
    for limited in (True, False):
        notes = pp.validate_picks(arm, pp.Scene(), pp.Picks((), torque_limits=limited)).notes
        assert any("joint friction" in note for note in notes) == limited
        assert ("no mass of the links moved by first" in notes) == limited


# -- set-ups ----------------------------------------------------------------------------------------------------------


def setup(rng: object, *, optimise: int | None = None, budget: PickBudget | None = None) -> PickSetup:
    arm = pp.load_robot("ur5").arm()
    picks = pp.Picks((pp.Pick("p", pp.pose((0.4, 0.0, 0.4))),), optimise=optimise)
    return PickSetup.make(arm, pp.Scene(), picks, home=None, rng=rng, budget=budget)


@pytest.mark.parametrize("size", [4, 8])
def test_each_pick_has_its_own_stream_which_is_a_child_of_the_seed(size: int) -> None:
    """Children that the seed had before are not used again."""
    for before in (0, 3):
        seed, same = (np.random.SeedSequence(7, spawn_key=(2,), pool_size=size) for _ in range(2))
        seed.spawn(before)
        made = setup(seed)
        children = same.spawn(before + 4)[before:]
        for index, child in enumerate(children):
            expected = np.random.default_rng(child).integers(2**32, size=4)
            assert (made.rng(index).integers(2**32, size=4) == expected).all()


def test_the_budget_is_the_given_one_else_that_of_the_picks() -> None:
    assert setup(0).budget == PickBudget()
    assert setup(0, optimise=17).budget == PickBudget(motion=17)
    assert setup(0, optimise=17, budget=PickBudget(motion=3)).budget == PickBudget(motion=3)


def test_poses_of_picks_places_and_frames_are_copied_and_read_only() -> None:
    given = pp.pose((0.4, 0.0, 0.2))
    place = pp.picks.PlaceTarget(given)
    pick = pp.Pick("one", given, carried=pp.Obstacle("part", pp.Sphere(0.02)), place=place)
    picks = pp.Picks((pick,), tip=given)
    held = (pick.pose, place.pose, picks.tip, NamedFrame(given).pose, pickle.loads(pickle.dumps(pick)).pose)
    given.translation[2] = 9.0
    for each in held:
        with pytest.raises(ValueError, match="read-only"):
            each.translation[2] -= 1.0
        assert each.translation[2] == 0.2


def test_an_arm_of_five_joints_whose_description_is_rounded_executes_vertical_picks() -> None:
    arm = load_robot("so100").arm(held={"gripper": 1.0})
    tip = pp.pose([0.0, -0.09, 0.0], [np.pi / 2, 0.0, 0.0])
    pick = pp.Pick("one", pp.pose([0.1, -0.2, 0.03], [np.pi, 0.0, 1.3]), approach=0.04, retreat=0.04)
    verdict = judge_in(arm, pp.Scene([]), pick, tip=tip, held={"gripper": 1.0})
    assert verdict.ok
    off = pp.spatial.twist_size(arm.forward_kinematics(verdict.q_grasp) * tip, pick.pose)
    assert max(off) < 1e-5
