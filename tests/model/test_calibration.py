"""Calibrated arms: the forward kinematics is the perturbed DH product, all else stays, and wrong files are refused."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.description import MAKES
from pinproof.errors import CalibrationError, ConversionError, UnknownNameError

from . import calibrations as made

KINDS = ("conf", "yaml", "csv")
PERTURBED = [("ur5", 1), ("ur10", 2), ("ur5e", 3)]


@pytest.fixture(scope="module", params=PERTURBED, ids=lambda case: case[0])
def case(request, tmp_path_factory):
    """The robot, its perturbed table, and the arm calibrated from each of the three formats."""
    robot, seed = request.param
    table, folder = made.perturbed(robot, seed), tmp_path_factory.mktemp(robot)
    paths = {kind: made.write(folder, robot, table, kind) for kind in KINDS}
    return robot, table, {kind: pp.load_robot(robot, calibration=path).arm() for kind, path in paths.items()}


@pytest.mark.parametrize("kind", KINDS)
def test_the_tcp_is_that_of_the_perturbed_dh_matrices(case, kind):
    _, table, arms = case
    assert np.abs(table[1:4, 1]).max() > 20.0  # far common normals, as in factory calibrations
    for q in np.random.default_rng(0).uniform(-2 * np.pi, 2 * np.pi, (100, 6)):
        actual = arms[kind].forward_kinematics(q).homogeneous
        np.testing.assert_allclose(actual, made.forward(table, q), rtol=0, atol=1e-12)


def test_the_three_formats_place_every_link_equally(case):
    _, _, arms = case
    q = np.random.default_rng(1).uniform(-3, 3, 6)
    for link in arms["conf"].robot.urdf.links:
        poses = [arm.frame_placement(q, link).homogeneous for arm in arms.values()]
        np.testing.assert_allclose(poses[1:], [poses[0]] * (len(poses) - 1), rtol=0, atol=1e-11)


def test_links_stay_in_their_places_and_only_joint_origins_change(case):
    name, _, arms = case
    nominal, robot = pp.load_robot(name), arms["conf"].robot
    assert robot.urdf.links == nominal.urdf.links
    assert robot.urdf.joints == nominal.urdf.joints
    for before, after in zip(nominal.urdf.collisions, robot.urdf.collisions, strict=True):
        assert (before.name, before.mesh, before.size) == (after.name, after.mesh, after.size)
        np.testing.assert_array_equal(before.origin, after.origin)
    arm, zero = nominal.arm(), np.zeros(6)
    for link in nominal.urdf.links:
        before = arm.frame_placement(zero, link).homogeneous
        difference = np.abs(arms["conf"].frame_placement(zero, link).homogeneous - before)
        assert difference[:3, 3].max() < 0.01
        assert difference[:3, :3].max() < 0.02
    assert robot.nominal is not None
    assert robot.nominal.urdf.text == nominal.urdf.text
    assert any("calibrat" in note for note in robot.notes)


def test_no_change_leaves_the_arm(tmp_path):
    path = made.write(tmp_path, "ur5e", made.published("ur5e"), "conf")
    arm, nominal = pp.load_robot("ur5e", calibration=path).arm(), pp.load_robot("ur5e").arm()
    q = np.random.default_rng(0).uniform(-3, 3, (50, 6))
    np.testing.assert_allclose(arm.forward_kinematics_batch(q), nominal.forward_kinematics_batch(q), rtol=0, atol=1e-14)


def test_every_ik_solution_is_one_of_the_true_arm(case):
    """All branches reach the target by the perturbed DH product, and the generating configuration is among them."""
    name, table, arms = case
    arm, nominal = arms["conf"], pp.load_robot(name).arm()
    apart = []
    for q in np.random.default_rng(2).uniform(-3, 3, (20, 6)):
        target = made.forward(table, q)
        found = pp.AnalyticIk().solve_all(arm, target)
        for branch in found.branches:
            np.testing.assert_allclose(made.forward(table, branch), target, rtol=0, atol=1e-8)
        away = np.abs(found.branches - q)
        assert np.abs(away - 2 * np.pi * np.round(away / (2 * np.pi))).max(axis=1).min() < 1e-6
        apart.append(np.linalg.norm(nominal.forward_kinematics(found.branches[0]).translation - target[:3, 3]))
    assert min(apart) > 1e-4  # the solutions of the nominal arm are others


def test_no_branch_is_claimed_to_be_missing_for_poses_that_are_reached(case):
    """IMPOSSIBLE needs complete branches: at reached poses, also near singular ones, complete implies found."""
    _, table, arms = case
    rng = np.random.default_rng(3)
    q = rng.uniform(-np.pi, np.pi, (600, 6))
    q[:200, 2], q[200:400, 4] = 1e-3 * rng.normal(size=200), 1e-3 * rng.normal(size=200)
    batch = pp.AnalyticIk().solve_all_batch(arms["conf"], [made.forward(table, each) for each in q])
    away = np.abs(batch.q - q[:, None])
    away = np.abs(away - 2 * np.pi * np.round(away / (2 * np.pi))).max(axis=2)
    found = np.nanmin(np.where(np.isnan(away), 9.0, away), axis=1) < 1e-4
    assert batch.complete.mean() > 0.5
    assert found[batch.complete].all()


@pytest.mark.parametrize(("robot", "head"), [("panda", "# like: franka"), ("irb120", "# convention: standard")])
def test_differences_of_any_table_apply_to_every_row(tmp_path, robot, head):
    """Also a and alpha of the last row, which move what is attached to the last link."""
    arm = pp.load_robot(robot).arm()
    like = "franka" if "franka" in head else None
    table = pp.urdf_to_dh(arm, like=like)
    deltas = np.random.default_rng(5).normal(size=(arm.dof, 4)) * 1e-3
    rows = [
        f"{name},{','.join(map(repr, delta))}" for name, delta in zip(arm.joint_names, deltas.tolist(), strict=True)
    ]
    path = tmp_path / "deltas.csv"
    path.write_text("\n".join([head, "name,delta_theta,delta_d,delta_a,delta_alpha", *rows]))
    changed = [
        pp.DhRow(row.name, row.theta + t, row.d + d, row.a + a, row.alpha + al)
        for row, (t, d, a, al) in zip(table.rows, deltas.tolist(), strict=True)
    ]
    expected = pp.DhTable(changed, convention=table.convention, base=table.base, tool=table.tool)
    calibrated = pp.load_robot(robot, calibration=path).arm()
    assert calibrated.tcp == arm.tcp
    assert calibrated.dof == arm.dof
    for q in np.random.default_rng(0).uniform(-2, 2, (50, arm.dof)):
        actual = calibrated.forward_kinematics(q).homogeneous
        np.testing.assert_allclose(actual, expected.forward_kinematics(q), rtol=0, atol=1e-12)
    # The Panda has fingers, one of which follows the other
    effect = calibrated.robot.info().calibration
    assert effect is not None
    assert 1e-4 < effect.mean_shift < 0.02


RAIL = """<link name="floor"/><joint name="rail" type="prismatic"><parent link="floor"/><child link="base_link"/>
<origin xyz="0.1 0.2 0.3" rpy="0.4 0 0.5"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="1" effort="1"/>
</joint></robot>"""


@pytest.mark.parametrize("kind", KINDS)
def test_an_arm_on_a_rail_is_calibrated(tmp_path, kind):
    """Calibrations of a make were refused, because the robot has seven joints."""
    table, text = made.perturbed("ur5e", 3), pp.load_robot("ur5e").urdf.text.replace("</robot>", RAIL)
    arm = pp.load_robot(text, calibration=made.write(tmp_path, "ur5e", table, kind)).arm(tcp="tool0")
    assert arm.joint_names[0] == "rail"
    for q in np.random.default_rng(0).uniform(-2, 2, (20, 7)):
        rail = pp.pose((0.1, 0.2, 0.3), (0.4, 0, 0.5)) * pp.pose((0, q[0], 0))
        expected = rail.homogeneous @ made.forward(table, q[1:])
        np.testing.assert_allclose(arm.forward_kinematics(q).homogeneous, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("robot", ["ur3", "ur5", "ur10", "ur5e"])
def test_the_table_like_ur_is_the_published_one(robot):
    arm = pp.load_robot(robot).arm()
    table = pp.urdf_to_dh(arm, like="ur")
    rows = [(row.theta, row.d, row.a, row.alpha) for row in table.rows]
    np.testing.assert_array_equal(rows, made.published(robot))
    for q in np.random.default_rng(0).uniform(-3, 3, (20, 6)):
        np.testing.assert_allclose(table.forward_kinematics(q), arm.forward_kinematics(q).homogeneous, atol=1e-10)


def test_the_table_like_franka_is_the_published_one():
    """Franka Robotics, "Robot limits and interface specifications", Denavit-Hartenberg parameters (Craig)."""
    half = math.pi / 2
    d = (0.333, 0, 0.316, 0, 0.384, 0, 0)
    a, alpha = (0, 0, 0, 0.0825, -0.0825, 0, 0.088), (0, -half, half, half, -half, half, half)
    table = pp.urdf_to_dh(pp.load_robot("panda").arm(), like="franka")
    assert table.convention == "modified"
    np.testing.assert_array_equal(
        [(r.theta, r.d, r.a, r.alpha) for r in table.rows], np.array([np.zeros(7), d, a, alpha]).T
    )


def test_an_arm_of_another_make_has_no_table_of_it():
    for robot, make in (("irb120", "ur"), ("panda", "ur"), ("z1", "ur"), ("ur5", "franka")):
        with pytest.raises(ConversionError, match=MAKES[make].name if robot != "irb120" else "make"):
            pp.urdf_to_dh(pp.load_robot(robot).arm(), like=make)
    with pytest.raises(UnknownNameError, match="franka"):
        pp.urdf_to_dh(pp.load_robot("ur5").arm(), like="kuka")


def test_far_common_normals_are_explained_and_converted_exactly(tmp_path):
    table = made.perturbed("ur10", 2)
    rows = [pp.DhRow(name, *(float(x) for x in row)) for name, row in zip(made.JOINT_NAMES, table, strict=True)]
    far = pp.DhTable(rows, convention="standard", base=np.diag([-1.0, -1.0, 1.0, 1.0]))
    assert len(far.notes) == 2
    assert "'shoulder_lift_joint' and 'elbow_joint'" in far.notes[0]
    assert f"{1e3 * table[1, 3]:.3g} mrad" in far.notes[0]
    assert f"{table[1, 1]:.6g} m" in far.notes[0]
    robot = pp.load_robot(far)
    assert set(far.notes) <= set(robot.notes)
    for q in np.random.default_rng(0).uniform(-3, 3, (50, 6)):
        actual = robot.arm().forward_kinematics(q).homogeneous
        np.testing.assert_allclose(actual, made.forward(table, q), rtol=0, atol=1e-12)
    # the modified convention holds the same pair in the next row, and nominal tables have no note
    back = pp.urdf_to_dh(robot.arm(), convention="modified")
    assert "'shoulder_lift_joint' and 'elbow_joint'" in back.notes[0]
    assert not pp.DhTable.load("robots/ur10/dh.yaml").notes
    assert not pp.DhTable.load("robots/scara/dh.yaml").notes


CONF = made.conf_text("ur5", made.perturbed("ur5", 1))
KINEMATICS = made.kinematics_text(made.perturbed("ur5", 1))
CSV = made.csv_text("ur5", made.perturbed("ur5", 1))


def millimetres(text: str) -> str:
    """A calibration.conf with d and a in millimetres."""
    lines = text.splitlines()
    for i, line in enumerate(lines):
        name, _, values = line.partition(" = [ ")
        if name in ("delta_d", "delta_a"):
            scaled = (repr(1e3 * float(x)) for x in values.strip(" ]").split(","))
            lines[i] = f"{name} = [ {', '.join(scaled)}]"
    return "\n".join(lines)


def with_value(text: str, start: str, value: str) -> str:
    """The text with another first number in the line that starts so."""
    lines = text.splitlines()
    k = next(i for i, line in enumerate(lines) if line.strip().startswith(start))
    head, separator, rest = lines[k].partition("[ " if "[" in lines[k] else ": " if ":" in lines[k] else ",")
    lines[k] = head + separator + value + "".join(rest.partition(",")[1:])
    return "\n".join(lines)


WRONG = {
    "another robot": ("conf", CONF, "ur10", ["joint 'elbow_joint'", "mm", "another robot"]),
    "another make": ("conf", CONF, "irb120", ["Universal Robots", "joint_3"]),
    "another count": ("conf", CONF, "panda", ["6 joints", "panda_joint7"]),
    "five numbers": ("conf", with_value(CONF, "delta_a", "").replace("[ ,", "["), "ur5", ["line 4", "delta_a", "5"]),
    "millimetres": ("conf", millimetres(CONF), "ur5", ["mm", "metres"]),
    "nan": ("conf", with_value(CONF, "delta_d", "nan"), "ur5", ["line 3", "delta_d[0]", "nan"]),
    "no number": ("conf", with_value(CONF, "delta_alpha", "0.1x"), "ur5", ["line 5", "delta_alpha", "0.1x"]),
    "no section": ("conf", CONF.replace("[mounting]", "[other]"), "ur5", ["[mounting]", "delta_theta"]),
    "no key": ("conf", CONF.replace("delta_d", "delta_e"), "ur5", ["delta_d", "[mounting]"]),
    "not calibrated": ("conf", CONF.replace("status = 2", "status = 0"), "ur5", ["line 7", "calibration_status"]),
    "stated twice": ("conf", CONF + CONF, "ur5", ["line 9", "delta_theta", "line 2"]),
    "two tables": ("csv", "# convention: modified\n" + CSV, "ur5", ["like: ur", "modified", "standard"]),
    "no link": ("yaml", KINEMATICS.replace("  forearm:", "  elbow:"), "ur5", ["forearm", "wrist_3"]),
    "nan in YAML": ("yaml", with_value(KINEMATICS, "z", ".nan"), "ur5", ["line 5", "z"]),
    "no angle": ("yaml", KINEMATICS.replace("    pitch", "    pitsch", 1), "ur5", ["line 7", "pitsch", "pitch"]),
    "kinematics of another robot": ("yaml", KINEMATICS, "ur5e", ["ur5e", "mm"]),
    "kinematics of the series before": ("yaml", made.kinematics_text(made.perturbed("ur3", 1)), "ur3e", ["ur3e", "mm"]),
    "kinematics of another make": ("yaml", KINEMATICS, "panda", ["Universal Robots", "panda_joint7"]),
    "no table": ("csv", CSV.partition("\n")[2], "ur5", ["# convention: standard", "# like: ur"]),
    "unknown make": ("csv", CSV.replace("like: ur", "like: kuka"), "ur5", ["kuka", "franka"]),
    "unknown column": ("csv", CSV.replace("delta_alpha", "delta_beta"), "ur5", ["delta_beta", "delta_alpha"]),
    "unknown joint": ("csv", CSV.replace("elbow_joint", "elbow"), "ur5", ["elbow_joint", "wrist_1_joint"]),
    "missing row": ("csv", CSV.rpartition("wrist_3")[0], "ur5", ["wrist_3_joint"]),
    "nan in CSV": ("csv", with_value(CSV, "elbow", "nan"), "ur5", ["line 5", "delta_theta"]),
    "other rows": (
        "csv",
        CSV.replace("elbow", "x").replace("wrist_1", "elbow").replace("x_j", "wrist_1_j"),
        "ur5",
        ["order"],
    ),
    "another file": ("conf.txt", CONF, "ur5", ["not a calibration", "calibration.conf"]),
    "a scene": ("yaml", "obstacles: []\n", "ur5", ["not a calibration", "kinematics"]),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_file_is_refused_with_its_place_and_the_choices(tmp_path, name):
    suffix, text, robot, words = WRONG[name]
    path = tmp_path / f"calibration.{suffix}"
    path.write_text(text)
    with pytest.raises(CalibrationError) as caught:
        pp.load_robot(robot, calibration=path)
    message = str(caught.value)
    assert str(path) in message
    assert [word for word in words if word not in message] == []


@pytest.mark.parametrize("kind", KINDS)
def test_a_calibration_alone_is_recognised_and_named(tmp_path, kind):
    path = made.write(tmp_path, "ur5", made.perturbed("ur5", 1), kind)
    with pytest.raises(CalibrationError, match=r"needs the robot.*--calibration"):
        pp.load_robot(path)


def test_a_missing_file_is_reported(tmp_path):
    with pytest.raises(CalibrationError, match="nowhere"):
        pp.load_robot("ur5", calibration=Path(tmp_path) / "nowhere.conf")


def test_a_calibrated_robot_stays_calibrated_in_a_cell(case):
    _, table, arms = case
    cell = pp.assemble({"left": (arms["conf"], pp.pose()), "right": (arms["yaml"], pp.pose((2, 0, 0)))})
    assert sum("calibrated" in note for note in cell.robot.notes) == 2
    arm = cell.robot.arm(tcp="left/tool0", base="left/base_link")
    q = np.random.default_rng(4).uniform(-3, 3, 6)
    np.testing.assert_allclose(arm.forward_kinematics(q).homogeneous, made.forward(table, q), rtol=0, atol=1e-12)


def test_the_effect_at_the_tcp_is_that_of_a_comparison(case):
    name, table, arms = case
    effect = arms["conf"].robot.info().calibration
    assert effect is not None
    assert pp.load_robot(name).info().calibration is None
    q = np.random.default_rng(9).uniform(arms["conf"].limits.lower, arms["conf"].limits.upper, (1500, 6))
    pairs = [(made.forward(table, each), made.forward(made.published(name), each)) for each in q]
    shifts = [np.linalg.norm(after[:3, 3] - before[:3, 3]) for after, before in pairs]
    angles = [np.arccos(min(1.0, (np.trace(after[:3, :3].T @ before[:3, :3]) - 1) / 2)) for after, before in pairs]
    assert effect.mean_shift == pytest.approx(np.mean(shifts), rel=0.05)
    assert effect.mean_rotation == pytest.approx(np.mean(angles), rel=0.05)
    assert effect.largest_shift == pytest.approx(np.max(shifts), rel=0.1)
    assert effect.largest_rotation == pytest.approx(np.max(angles), rel=0.1)
