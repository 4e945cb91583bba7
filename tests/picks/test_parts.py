"""Tools and part types: a pick is judged with the hand of its tool, its part and its grasp."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

import pinproof as pp
from pinproof.collision import PairMargin
from pinproof.errors import InputError, PicksError, UnknownNameError
from pinproof.picks import PartGrasp, PartType, Tool

from .conftest import judge_in
from .test_grip import CUBE, GRIPPER, HAND, TABLE, fingers, grasp

HEAD = """\
robot: ur5
tcp: tool0
tools:
  jaws:
    tip: {xyz: [0, 0, 0.12]}
    fingers:
      opening: 0.06
      bodies: [{name: left, box: [0.01, 0.01, 0.05], xyz: [0, 0.005, 0.1]},
               {name: right, box: [0.01, 0.01, 0.05], xyz: [0, -0.005, 0.1]}]
  cup: {cup: {radius: 0.02}, tip: {xyz: [0, 0, 0.1]}}
tool_change: 8
"""
PARTS = """\
parts:
  block:
    box: [0.02, 0.02, 0.05]
    mass: 0.1
    friction: 0.4
    tool: jaws
    fingers: {opening: 0.03}
    grasps:
      - {name: top, xyz: [0, 0, 0.02], rpy: [pi, 0, 0], approach: 0.05}
      - {xyz: [0, 0, 0.025], rpy: [pi, 0, 0], tool: cup, cup: {gap: 0.002}}
"""


def read(folder: Path, *rows: str, head: str = HEAD, parts: str = PARTS) -> pp.Picks:
    path = folder / "picks.yaml"
    path.write_text("".join([head, parts, "picks:\n", *(f"- {row}\n" for row in rows)]))
    return pp.read_picks(path)


def test_a_pick_of_a_part_stands_for_the_grasps_of_its_part_in_their_order(tmp_path: Path) -> None:
    picks = read(tmp_path, "{name: a, part: block, object: block_1, approach: 0.08, fingers: {opening: 0.04}}")
    top, second = picks.grasps_of(picks.picks[0])
    assert [(own.grasp, own.tool, own.frame) for own in (top, second)] == [
        ("top", "jaws", "block_1"),
        ("grasp 2", "cup", "block_1"),
    ]
    assert (top.approach, second.approach) == (0.05, 0.08)  # what a grasp states replaces what the pick states
    np.testing.assert_allclose(pp.xyz_rpy(top.pose), [0, 0, 0.02, np.pi, 0, 0], atol=1e-15)
    assert top.payload.mass == 0.1
    jaws, cup = picks.for_pick(top), picks.for_pick(second)
    assert (jaws.fingers.opening, jaws.cup) == (0.04, None)  # that of the pick replaces that of the part
    assert (cup.fingers, cup.cup.gap, cup.cup.radius) == (None, 0.002, 0.02)
    assert (jaws.grip_limits.friction, cup.cup.friction) == (0.4, 0.4)
    np.testing.assert_allclose(cup.tip.translation, [0, 0, 0.1])
    assert picks.grasps_of(top)[0].hand_values() == top.hand_values()


def test_a_pick_may_choose_the_grasp_or_the_tool(tmp_path: Path) -> None:
    picks = read(
        tmp_path,
        "{name: grasp, part: block, object: block_1, grasp: top}",
        "{name: tool, part: block, object: block_1, tool: cup}",
        "{name: pose, part: block, object: block_1, xyz: [0, 0, 0.4], rpy: [pi, 0, 0]}",
    )
    (grasp,), (tool,), (pose,) = map(picks.grasps_of, picks)
    assert (grasp.grasp, tool.grasp, pose.grasp) == ("top", "grasp 2", None)
    assert (grasp.tool, tool.tool, pose.tool) == ("jaws", "cup", "jaws")
    assert pose.pose.translation[2] == 0.4
    assert pose.payload is not None


@pytest.mark.parametrize(
    ("row", "reason"),
    [
        ("part: blok, object: x", "unknown part 'blok' in the parts of the picks file; valid: block"),
        (
            "part: block, object: x, grasp: side",
            "unknown grasp 'side' in the grasps of part 'block'; valid: grasp 2, top",
        ),
        ("part: block, object: x, tool: hook", "unknown tool 'hook' in the tools of the picks file; valid: cup, jaws"),
        ("xyz: [0, 0, 0], rpy: [0, 0, 0]", "states no tool; choose one of jaws, cup"),
        ("part: block", "states a part but not the name of its object"),
        ("part: block, object: {box: [1, 1, 1]}", "states a part but not the name of its object"),
        ("part: block, object: x, grasp: top, xyz: [0, 0, 0], rpy: [0, 0, 0]", "a grasp of its part and xyz"),
        ("part: block, object: x, rpy: [0, 0, 0]", "states rpy but no xyz"),
        ("part: top_only, object: x, tool: cup", "the grasps of its part are top (jaws)"),
        ("part: block, object: x, grip_limits: {friction: 0}", "above 0"),
        ("part: block, object: x, fingers: {width: 1}", "unknown key 'width'; valid: grip, opening"),
        ("part: bare, object: x, grasp: top", "unknown grasp 'top'"),
        ("part: top_only, object: x, cup: {force: 3}", "key cup: states values of `cup`, which no tool that may hold"),
        ("part: top_only, object: x, held: {fngr: 3}", "unknown joint 'fngr' in the gripping joints of the hands"),
        ("grasp: top, object: x", "a grasp of its part and xyz"),
    ],
)
def test_a_pick_that_does_not_fit_the_parts_and_tools_is_named_with_the_choices(
    tmp_path: Path, row: str, reason: str
) -> None:
    more = "  bare: {box: [1, 1, 1], tool: jaws}\n"
    more += "  top_only: {box: [1, 1, 1], grasps: [{name: top, xyz: [0, 0, 0], rpy: [0, 0, 0], tool: jaws}]}\n"
    (problem,) = read(tmp_path, f"{{name: wrong, {row}}}", parts=PARTS + more).problems
    assert reason in problem.reason


@pytest.mark.parametrize(
    ("head", "parts", "place", "reason"),
    [
        (HEAD.replace("tool_change: 8\n", ""), PARTS, "line 3, column 1, key tools", "2 tools are stated but no"),
        (HEAD, "parts: {a: {tool: jaws}}\n", "line 12, column 9, key parts.a", "has no shape; it needs one of box"),
        (HEAD, "parts: {a: {box: [1, 1, 1], mass: 0}}\n", "column 29, key parts.a.mass", "above 0"),
        (HEAD, "parts: {a: {box: [1, 1, 1], friction: 0}}\n", "column 29, key parts.a.friction", "above 0"),
        (HEAD, "parts: {a: {box: [1, 1, 1]}}\n", "line 12, column 9, key parts.a", "states no tool"),
        (HEAD, PARTS.replace("tool: jaws", "tool: jaw"), "line 17, column 5, key parts.block.tool", "valid: jaws, cup"),
        (HEAD, PARTS.replace("tool: cup", "tool: hook"), "key parts.block.grasps['grasp 2'].tool", "valid: cup, jaws"),
        (HEAD + "cup: {radius: 0.01}\n", PARTS, "line 12, column 1, key cup", "beside tools; state it in one of jaws"),
        (HEAD + "tip: {xyz: [0, 0, 1]}\n", PARTS, "line 12, column 1, key tip", "beside tools"),
        (HEAD, PARTS.replace("tool: cup", "tool: cup, fingers: {opening: 0.01}"),
         "key parts.block.grasps['grasp 2'].fingers", "valid: `cup`, `grip_limits`"),
        (HEAD, "parts: {a: {box: [1, 1, 1], tool: jaws, cup: {force: 3}}}\n", "column 41, key parts.a.cup", "no tool"),
        (HEAD + "grip_limits: {friction: 0.3}\n", PARTS, "line 12, column 1, key grip_limits", "beside tools"),
        (HEAD, PARTS.replace("xyz: [0, 0, 0.025], ", ""), "key parts.block.grasps[1]", "does not state its xyz"),
        (HEAD, PARTS.replace("name: top", "name: grasp 2"), "key parts.block", "a second grasp of block is named"),
        (HEAD.replace("tool_change: 8", "tool_change: fast"), PARTS, "line 11, column 1, key tool_change", "mounted"),
        (HEAD + "tools: {}\n", PARTS, "line 12", "duplicate key 'tools'"),
        (HEAD.replace("  cup: {cup", "  cup: {robot: ur5, cup"), PARTS, "key tools.cup.robot", "unknown key 'robot'"),
        (HEAD.replace("  cup: {cup: {radius: 0.02}, tip: {xyz: [0, 0, 0.1]}}", "  cup: none.yaml"), PARTS,
         "none.yaml", "cannot be read"),
    ],
)  # fmt: skip
def test_tools_and_parts_that_do_not_fit_each_other_are_refused_with_their_place(
    tmp_path: Path, head: str, parts: str, place: str, reason: str
) -> None:
    with pytest.raises(PicksError) as caught:
        read(tmp_path, "{name: a, part: block, object: x}", head=head, parts=parts)
    assert place in str(caught.value)
    assert reason in str(caught.value)


def test_tools_that_are_all_mounted_are_attached_together(tmp_path: Path) -> None:
    two = HEAD.replace("tool_change: 8", "tool_change: mounted").replace(
        "cup: {cup", "cup: {tool: [{name: pipe, sphere: {radius: 0.01}}], cup"
    )
    picks = read(tmp_path, "{name: a, tool: cup, xyz: [0, 0, 0], rpy: [0, 0, 0]}", head=two)
    hand = picks.for_pick(picks.grasps_of(picks.picks[0])[0])
    assert [body.name for body in hand.open_tool] == ["pipe", "left", "right"]
    with pytest.raises(PicksError, match="a second body is named 'left'"):
        read(
            tmp_path,
            "{name: a, tool: cup, xyz: [0, 0, 0], rpy: [0, 0, 0]}",
            head=two.replace("name: pipe", "name: left"),
        )


def test_a_tool_file_is_the_tool_that_a_picks_file_names(tmp_path: Path) -> None:
    (tmp_path / "cup.yaml").write_text("robot: ur5\ntcp: tool0\ncup: {radius: 0.02}\n")
    tool = Tool.load(tmp_path / "cup.yaml")
    assert (tool.name, tool.cup.radius, tool.load_arm().tcp) == ("cup", 0.02, "tool0")
    picks = read(
        tmp_path, "{name: a, xyz: [0, 0, 0], rpy: [0, 0, 0]}", head="robot: ur5\ntools: {vac: cup.yaml}\n", parts=""
    )
    assert picks.for_pick(picks.grasps_of(picks.picks[0])[0]).cup.radius == 0.02
    assert picks.tools["vac"].name == "vac"


def test_a_part_is_made_in_python_with_a_shape_of_its_own_frame() -> None:
    part = PartType(shape=pp.Box(0.1, 0.1, 0.1), grasps=[PartGrasp(np.eye(4)), PartGrasp(np.eye(4), "side")])
    assert [grasp.name for grasp in part.grasps] == ["grasp 1", "side"]
    assert part.payload is None
    with pytest.raises(InputError, match="no mass"):
        PartType(shape=pp.Box(0.1, 0.1, 0.1), center_of_mass=(0, 0, 0.1))
    with pytest.raises(InputError, match="does not state its xyz"):
        pp.Pick("a")


def test_directions_of_grasps_in_the_root_frame_follow_a_transformed_cell(tmp_path: Path) -> None:
    parts = PARTS.replace("approach: 0.05", "approach: 0.05, retreat_direction: [1, 0, 0]")
    picks = read(tmp_path, "{name: a, part: block, object: x, grasp: top}", parts=parts)
    turned = picks.transformed(pp.pose(rpy=(0, 0, np.pi / 2)))
    (grasp,) = turned.grasps_of(turned.picks[0])
    np.testing.assert_allclose(grasp.retreat_direction, [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(grasp.approach_direction, [0, 0, 1], atol=1e-15)  # in the frame of the tip


def test_the_length_of_a_line_may_be_that_of_a_grasp_and_its_direction_that_of_the_pick(tmp_path: Path) -> None:
    parts = PARTS.replace("approach: 0.05", "retreat: 0.05")
    row = "{name: a, part: block, object: x, grasp: top, retreat: 0, retreat_direction: [1, 0, 0], retreat_frame: tip}"
    picks = read(tmp_path, row, parts=parts)
    assert not picks.problems
    (grasp,) = picks.grasps_of(picks.picks[0])
    assert (grasp.retreat, grasp.retreat_direction, grasp.retreat_frame) == (0.05, (1, 0, 0), "tip")


SPEC = {"tip": pp.pose((0, 0, 0.16)), "margin": 0.002}


def judged(
    arms, margins: tuple[PairMargin, ...], *more: pp.Obstacle, of_scene: tuple[PairMargin, ...] = ()
) -> pp.picks.PickVerdict:
    """The verdict on a cube beside a post, 12 mm from the cube and 7 mm from the open hand."""
    post = pp.Obstacle("post", pp.Box(0.01, 0.1, 0.03), pp.pose((0.482, 0.15, 0.01)))
    shared = {"fingers": fingers(), "tool": (HAND,), **SPEC, "margins": margins}
    return judge_in(
        arms["ur5"],
        pp.Scene([TABLE, CUBE, post, *more], allowed=[("base_link", "table")], margins=of_scene),
        grasp(retreat=0.05),
        **shared,
    )


def test_the_margin_of_a_pair_replaces_that_of_all_bodies(arms) -> None:
    assert judged(arms, ()).ok
    assert judged(arms, (PairMargin(("cube", "table"), 0.0),)).ok
    for name, stage in (("finger_1", "grasp"), ("hand", "grasp"), ("cube", "retreat")):
        # The object keeps its margins while it is carried
        verdict = judged(arms, (PairMargin((name, "post"), 0.1),))
        assert not verdict.ok, name
        assert verdict.failed.value in (stage, "approach"), name
        assert "post" in verdict.reason
    with pytest.raises(UnknownNameError, match="unknown body 'pole' in the margins of the picks; valid"):
        judged(arms, (PairMargin(("hand", "pole"), 0.1),))


def test_the_margins_of_a_scene_apply_to_picks_which_replace_them(arms) -> None:
    assert judged(arms, (), of_scene=(PairMargin(("cube", "table"), 0.0),)).ok
    for name, stage in (("finger_1", "grasp"), ("hand", "grasp"), ("cube", "retreat")):
        wide = (PairMargin((name, "post"), 0.1),)
        verdict = judged(arms, (), of_scene=wide)
        assert not verdict.ok, name
        assert verdict.failed.value in (stage, "approach"), name
        assert "post" in verdict.reason
        assert judged(arms, (PairMargin(("post", name), 0.001),), of_scene=wide).ok
    with pytest.raises(UnknownNameError, match="unknown body 'pole' in the margins of the scene; valid"):
        judged(arms, (), of_scene=(PairMargin(("hand", "pole"), 0.1),))


def test_two_links_of_one_gripper_are_checked_for_contact_only_and_the_notes_state_it() -> None:
    picks = pp.Picks((), held={"close": 0.0395, "rest": 0.0}, grip={"close": 0.0398}, margin=0.001, gripper=("pad",))
    arm = pp.load_robot(GRIPPER).arm(tcp="hand", held=picks.held)
    setup = pp.picks.PickSetup.make(arm, pp.Scene([CUBE]), picks, home=None, rng=0)
    margins = {frozenset(setup.checker.owners(k)): each for k, each in enumerate(setup.checker.margins.tolist())}
    assert margins[frozenset(("jaw", "pad"))] == 0.0
    assert margins[frozenset(("jaw", "cube"))] == margins[frozenset(("pad", "cube"))] == 0.001
    (note,) = [note for note in setup.not_covered({True}) if "contact only" in note]
    assert "jaw" in note
    assert "pad" in note
    with pytest.raises(InputError, match="home is not a valid start: pad is"):
        pp.picks.PickSetup.make(arm, pp.Scene([CUBE]), replace(picks, grip={}), home=None, rng=0)


def test_a_closing_finger_keeps_the_margin_of_its_pair(arms) -> None:
    # The open and the closed finger are 12 mm from the pin, and the finger passes it at 5 mm
    pin = pp.Obstacle("pin", pp.Box(0.002, 0.002, 0.04), pp.pose((0.466, 0.1875, 0.015)))
    scene = pp.Scene([TABLE, CUBE, pin], allowed=[("base_link", "table")])
    shared = {"fingers": fingers(0.1), "tool": (HAND,), **SPEC}
    for margin, good in ((0.004, True), (0.009, False)):
        margins = tuple(PairMargin((name, "pin"), margin) for name in ("finger_1", "finger_2"))
        verdict = judge_in(arms["ur5"], scene, grasp(retreat=0.05), **shared, margins=margins)
        assert verdict.ok == good, verdict.reason
    assert verdict.failed.value == "grip"
    assert "while the fingers move" in verdict.reason


def test_the_identity_of_a_setup_depends_on_margins_of_parts_that_are_not_in_the_scene_yet(arms) -> None:
    part = pp.Obstacle("part", pp.Box(0.03, 0.03, 0.03))
    picks = pp.Picks([pp.Pick("a", pp.pose((0.4, 0, 0.1)), carried=part)])

    def identity(margin: float, *, of_scene: bool = False) -> dict:
        stated = (PairMargin(("part", "table"), margin),)
        own = picks if of_scene else replace(picks, margins=stated)
        scene = pp.Scene([TABLE], allowed=[("base_link", "table")], margins=stated if of_scene else ())
        return pp.picks.PickSetup.make(arms["ur5"], scene, own, home=None, rng=0).identity()

    assert identity(0.001) == identity(0.001, of_scene=True) != identity(0.002)


@pytest.mark.parametrize("hull", [None, False])
def test_mass_of_a_part_is_at_the_centre_of_a_uniform_density_unless_it_is_stated(hull) -> None:
    at, corner = np.array([0.05, 0.02, 0.01]), trimesh.transformations.translation_matrix((0.05, 0.02, 0.01))
    block = trimesh.creation.box((0.1, 0.04, 0.02), corner)
    shape = pp.Mesh(vertices=block.vertices, triangles=block.faces, hull=hull)
    np.testing.assert_allclose(PartType(shape=shape, mass=0.2).payload.center_of_mass, at, atol=1e-9)
    assert PartType(shape=shape, mass=0.2, center_of_mass=(0, 0, 0)).payload.center_of_mass.tolist() == [0, 0, 0]


def test_a_part_that_states_a_joint_which_no_hand_has_is_refused_at_its_key(tmp_path: Path) -> None:
    parts = PARTS.replace("    fingers: {opening: 0.03}\n", "    held: {jont: {open: 0.1}}\n")
    with pytest.raises(PicksError, match="unknown joint 'jont' in the gripping joints of the hands") as refused:
        read(tmp_path, "{name: a, part: block, object: block_1}", parts=parts)
    assert "line 18, column 5, key parts.block.held" in str(refused.value)


def test_values_that_no_hand_has_are_refused_in_python_too(arms) -> None:
    block = PartType(shape=pp.Box(0.03, 0.03, 0.03), grasps=[PartGrasp(pp.pose())], cup={"force": 3.0})
    picks = pp.Picks((), parts={"block": block}, fingers=fingers(), tool=(HAND,), **SPEC)
    with pytest.raises(InputError, match=r"key parts\.block\.cup: states values of `cup`.*valid: `fingers`"):
        pp.picks.PickSetup.make(arms["ur5"], pp.Scene([]), picks, home=None, rng=0)
    bare = replace(picks, parts={"block": replace(block, cup={})})
    pick = pp.Pick("a", part="block", carried="x", held={"fngr": 0.1})
    with pytest.raises(InputError, match="unknown joint 'fngr'"):
        bare.grasps_of(pick)
