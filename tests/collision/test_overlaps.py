"""How often links touch, and the SRDF that excludes those that always do."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
import trimesh

import pinproof as pp
from pinproof.collision import sample_overlaps
from pinproof.collision.checking.links import AS_REQUESTED, DECOMPOSED, LinkBodies, Overlaps, meshes_of
from pinproof.description import find_robot, read_srdf

LIMIT = '<limit lower="-1.5" upper="1.5" velocity="1" effort="1"/>'


def solid(name: str, size: str) -> str:
    return f'<link name="{name}"><collision><geometry>{size}</geometry></collision></link>'


def revolute(name: str, parent: str, child: str, xyz: str, axis: str) -> str:
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}"/>'
        f'<axis xyz="{axis}"/>{LIMIT}</joint>'
    )


WRIST = (
    '<robot name="wrist">'
    + solid("base", '<box size="0.1 0.1 0.1"/>')
    + solid("fore", '<sphere radius="0.05"/>')
    + solid("cross", '<sphere radius="0.06"/>')
    + solid("hand", '<sphere radius="0.05"/>')
    + '<link name="tip"/>'
    + revolute("j1", "base", "fore", "0 0 0.4", "0 1 0")
    + revolute("j2", "fore", "cross", "0 0 0.02", "1 0 0")
    + revolute("j3", "cross", "hand", "0 0 0.02", "0 0 1")
    + '<joint name="end" type="fixed"><parent link="hand"/><child link="tip"/><origin xyz="0 0 0.1"/></joint></robot>'
)
"""A wrist whose housings overlap: fore and hand touch in every configuration."""


@pytest.fixture
def wrist(tmp_path):
    path = tmp_path / "wrist.urdf"
    path.write_text(WRIST)
    return path


def test_adjacent_and_always_touching_links_are_proposed_and_others_are_not(wrist):
    report = sample_overlaps(pp.load_robot(wrist), samples=100)
    assert {(frozenset(pair.links), pair.reason) for pair in report.proposed} == {
        (frozenset(("base", "fore")), "Adjacent"),
        (frozenset(("fore", "cross")), "Adjacent"),
        (frozenset(("cross", "hand")), "Adjacent"),
        (frozenset(("fore", "hand")), "Always"),
    }
    counts = {frozenset(pair.links): pair.touching for pair in report.pairs}
    assert counts[frozenset(("fore", "hand"))] == 100
    assert counts[frozenset(("base", "hand"))] == 0


def test_the_written_srdf_makes_the_home_free_and_keeps_the_other_pairs(wrist, tmp_path):
    arm = pp.load_robot(wrist).arm()
    assert not pp.CollisionChecker(arm).is_free(arm.home)
    sample_overlaps(arm.robot, samples=100).save_srdf(tmp_path / "wrist.srdf")
    arm = pp.load_robot(wrist, srdf=tmp_path / "wrist.srdf").arm()
    checker = pp.CollisionChecker(arm)
    assert checker.is_free(arm.home)
    assert {frozenset((checker.bodies[i].owner, checker.bodies[j].owner)) for i, j in checker.pairs} == {
        frozenset(("base", "cross")),
        frozenset(("base", "hand")),
    }


def test_groups_and_states_of_the_present_srdf_are_kept(wrist, tmp_path):
    (tmp_path / "own.srdf").write_text(
        '<robot name="wrist"><group name="arm"><chain base_link="base" tip_link="tip"/></group>'
        '<group_state name="up" group="arm"><joint name="j1" value="0.5"/></group_state>'
        '<disable_collisions link1="fore" link2="hand" reason="User"/></robot>'
    )
    robot = pp.load_robot(wrist, srdf=tmp_path / "own.srdf")
    sample_overlaps(robot, samples=50).save_srdf(tmp_path / "new.srdf")
    written = read_srdf(tmp_path / "new.srdf")
    assert written.groups["arm"].chains == (("base", "tip"),)
    assert written.states[0].joints == {"j1": (0.5,)}
    reasons = [pair.reason for pair in written.disabled if set(pair.links) == {"fore", "hand"}]
    assert reasons == ["User"]
    assert sum(pair.reason == "Adjacent" for pair in written.disabled) == 3


def test_links_whose_hulls_touch_and_meshes_do_not_are_counted_by_their_meshes():
    """The hulls of forearm and wrists of the UR5 overlap far more often than the links."""
    report = sample_overlaps(pp.load_robot("ur5"), samples=200)
    pairs = {frozenset(pair.links): pair for pair in report.pairs}
    forearm = pairs[frozenset(("forearm_link", "wrist_2_link"))]
    assert forearm.geometry != "collision model"
    assert forearm.frequency == "sometimes"
    assert forearm.disabled == "without a reason"
    assert {pair.reason for pair in report.proposed} == {"Adjacent"}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["talos_left", "tiago_no_hand"])
def test_the_overlaps_of_the_catalogue_touch_in_every_sample(name):
    entry = find_robot(name)
    report = sample_overlaps(pp.load_robot(entry.urdf, srdf=entry.srdf), samples=100)
    always = {frozenset(pair.links) for pair in report.proposed if pair.reason == "Always"}
    assert {frozenset(pair) for pair in entry.overlaps} <= always


def test_a_start_in_self_collision_names_the_command(wrist):
    arm = pp.load_robot(wrist).arm()
    plan = pp.RrtConnect().plan(pp.CollisionChecker(arm), arm.home, arm.home + 0.1, rng=0)
    assert plan.status is pp.planning.PlanStatus.START_INVALID
    assert "info ROBOT --overlaps" in plan.message
    with pytest.raises(pp.InputError, match="info ROBOT --overlaps"):
        pp.validate_picks(arm, pp.Scene(), [pp.Pick("a", pp.pose((0, 0, 0.5)))])


def test_a_start_at_which_links_touch_that_touch_in_most_configurations_states_their_share(arm_from_links):
    bar = '<box size="0.2 0.02 0.02"/>'
    arm = arm_from_links(
        {"fore": f"{bar}@-0.1 0 0", "empty": "", "hand": f"{bar}@0.104 0 0", "tip": ""},
        [
            ("j1", "revolute", "fore", "empty", "0.001 0 0", "0 1 0"),
            ("j2", "revolute", "empty", "hand", "0.001 0 0", "0 0 1"),
            ("end", "fixed", "hand", "tip", "1 0 0", "1 0 0"),
        ],
    ).arm(tcp="tip")
    start = np.array([0.0, 2.0])
    message = pp.RrtConnect().plan(pp.CollisionChecker(arm), start, arm.home, rng=0).message
    share = re.search(r"fore and hand in contact in (\d+) of 200 ", message)
    assert share is not None
    assert 180 < int(share[1]) < 200
    assert "allowed_contacts" in message


def test_contact_with_an_obstacle_at_home_gives_no_hint_of_an_srdf():
    arm = pp.load_robot("ur5").arm()
    scene = pp.Scene([pp.Obstacle("block", pp.Box(2, 2, 2))])
    plan = pp.RrtConnect().plan(pp.CollisionChecker(arm, scene), arm.home, arm.home + 0.1, rng=0)
    assert plan.status is pp.planning.PlanStatus.START_INVALID
    assert "--overlaps" not in plan.message


def test_the_command_lists_the_pairs_and_writes_both_files(wrist, tmp_path, monkeypatch, capsys):
    from pinproof.cli.main import main

    monkeypatch.chdir(tmp_path)

    def run(*words: str) -> tuple[int, str]:
        monkeypatch.setattr("sys.argv", ["pinproof", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        return int(ended.value.code or 0), capsys.readouterr().out

    code, out = run("info", "wrist.urdf", "--samples", "50", "--write-srdf", "new.srdf", "--write-urdf", "new.urdf")
    assert code == 0
    assert "exclude: Always" in out
    assert run("check", "new.urdf", "--srdf", "new.srdf")[0] == 0
    code, out = run("info", "wrist.urdf", "--overlaps", "--samples", "50", "--json")
    found = json.loads(out)
    assert (code, found["samples"], len(found["pairs"])) == (0, 50, 6)
    assert run("info", "wrist.urdf", "--overlaps", "--write-urdf", "wrist.urdf")[0] == 2


def test_few_samples_are_refused_because_chance_contacts_would_be_excluded() -> None:
    """In a single configuration of the Panda, link 1 and link 7 touch by chance."""
    with pytest.raises(pp.InputError, match="samples"):
        sample_overlaps(pp.load_robot("panda"), samples=1)


@pytest.mark.parametrize(("form", "level"), [("bar", AS_REQUESTED), ("angle", DECOMPOSED)])
def test_a_pair_is_checked_with_the_coarsest_bodies_that_touch_about_as_often_as_the_meshes(
    arm_from_links, mesh_file, form, level
):
    """A mesh turns about z past a block: a bar is its hull, an angle consists of two bars."""
    bars = [trimesh.creation.box((0.6, 0.04, 0.1)).apply_translation((0.28, 0, 0))]
    bars.append(trimesh.creation.box((0.04, 0.6, 0.1)).apply_translation((0, 0.28, 0)))
    mesh = {"bar": bars[0], "angle": trimesh.boolean.union(bars, engine="manifold")}[form]
    block, xyz = trimesh.creation.box((0.1, 0.2, 0.1)), "0.25 0 0"
    robot = arm_from_links(
        {
            "base": f'<mesh filename="{mesh_file(block)}"/>@{xyz}',
            "hand": f'<mesh filename="{mesh_file(mesh)}"/>',
        },
        [("turn", "continuous", "base", "hand", "0 0 0", "0 0 1")],
    )
    links = LinkBodies(robot.urdf.collisions, meshes_of(robot.urdf.links, "hull"))
    found = Overlaps(robot, links).of("base", "hand")
    assert found.level == level
