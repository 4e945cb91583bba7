"""A small run of the IK benchmark: rows, columns, independent check, provenance."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.ik import BENCHMARK, success_rates
from benchmarks.ik_methods import OWN_METHODS, PARTS, PERIOD, IkMethod, Part, PreparedMethod
from benchmarks.ik_peers import PEERS, TIP, chain_urdf, screw_axes
from benchmarks.ik_run import (
    COLUMNS,
    check_answers,
    ik_benchmark,
    ik_tables,
    measured_row,
    random_targets,
    rows_of,
    smooth_targets,
    with_reduced_ranges,
)
from benchmarks.ik_steps import METHODS, step_sizes
from benchmarks.tables import NotApplicableError, Results, Row

import pinproof as pp
from pinproof.errors import ConversionError, FileError, InputError
from pinproof.model import load_robot

POINTS = 20


@pytest.fixture(scope="module")
def table() -> Results:
    return ik_benchmark(["ur5"], points=POINTS)


@pytest.fixture(scope="module")
def success() -> list[Row]:
    return success_rates(["ur5", "panda"], samples=50)


def test_iterative_methods_have_a_row_in_every_part(table: Results) -> None:
    for part in PARTS:
        named = {row.method for row in rows_of(table, "ur5", part)}
        assert named >= {"pseudo_inverse", "damped_least_squares", "clik"}


def test_every_method_has_a_row_or_a_reason(table: Results) -> None:
    for method in (*OWN_METHODS, *PEERS):
        assert (method.key in {row.method for row in table["rows"]}) or table["left_out"]["ur5"][method.key]


def test_rows_are_complete_and_plausible(table: Results) -> None:
    for row in table["rows"]:
        assert row.samples == POINTS
        assert 0 < row.median_ms <= row.p999_ms
        assert 0 < row.mean_ms <= row.p999_ms
        assert 0.0 <= row.success <= 1.0
        assert (row.largest_step is not None) == (row.problem == "trajectory")
        assert (row.ratio is None) or row.compared_with is not None
    own = [row for row in table["rows"] if row.compared_with is None]
    assert all(row.false_positives == 0 and row.position_error <= row.tolerance for row in own)
    assert all(row.batch_ms > 0 for row in own if row.problem == "random")


def test_clik_with_restarts_solves_all_targets(table: Results) -> None:
    rows = [row for row in table["rows"] if row.method == "clik" and row.restarts]
    assert [row.success for row in rows] == [1.0] * 3


def test_rows_contain_the_figures_of_the_textbook(table: Results) -> None:
    cells = {row.method: (row.textbook_ms, row.textbook_success) for row in table["rows"]}
    assert cells["pseudo_inverse"] == (1.20, 0.85)
    assert cells["damped_least_squares"] == (1.45, 0.95)
    assert cells["clik"] == (None, None)


def test_provenance_is_complete(table: Results) -> None:
    origin = table.provenance
    assert set(origin) == {"versions", "cpu", "cores", "system", "load", "seed", "commit", "date"}
    assert all(origin["versions"][name] for name in ("python", "pinproof", "pin", "numpy"))
    assert origin["cpu"]
    assert origin["cores"] >= 1
    assert origin["seed"] == 0
    assert origin["date"][:2] == "20"


def test_the_table_states_the_limits(table: Results) -> None:
    chain = table.settings["chains"]["ur5"]
    np.testing.assert_allclose(chain["upper"], np.pi, atol=1e-8)
    assert "+-pi" in table.settings["limits"]
    assert any("-3.142 to 3.142" in line for line in ik_tables(table))


def test_a_saved_table_is_read_unchanged(table: Results, tmp_path: Path) -> None:
    table.save(tmp_path / "ik.json")
    read = Results.load(tmp_path / "ik.json")
    assert read == table
    assert BENCHMARK.all_blocks(read) == BENCHMARK.all_blocks(table)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"rows": 1}'])
def test_other_files_are_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "ik.json").write_text(text)
    with pytest.raises(FileError):
        Results.load(tmp_path / "ik.json")


def test_rows_of_the_same_cell_are_replaced_and_others_are_kept(table: Results) -> None:
    new = Results(table.settings, {**table.provenance, "commit": "later"}, {"rows": [Row(robot="ur5", method="mine")]})
    both = new.added_to(table, ("robot", "method"))
    assert len(both["rows"]) == len({(row.robot, row.method) for row in table["rows"]}) + 1
    assert both.settings["measured"] == {"rows": "later", "left_out": table.provenance["commit"]}
    assert new.added_to(table, ())["rows"] == new["rows"]


def test_markdown_shows_every_row_and_column(table: Results) -> None:
    text = "\n".join(ik_tables(table))
    shown = [name for name in COLUMNS if name != "relative time" or any(row.ratio for row in table["rows"])]
    assert all(f" {name} |" in text for name in shown)
    lines = text.splitlines()
    assert sum(line.startswith("| Clik |") for line in lines) == len(PARTS)


def test_missing_peers_are_named(table: Results) -> None:
    text = "\n".join(ik_tables(table))
    for method in PEERS:
        reason = table["left_out"]["ur5"].get(method.key)
        assert reason is None or f"- {method.key}: {reason}" in text


def test_without_peers_only_own_methods_run() -> None:
    made = ik_benchmark(["ur5"], points=1, methods=["clik"], peers=False)
    assert made["left_out"] == {"ur5": {}}
    assert {row.method for row in made["rows"]} == {"clik"}


@pytest.mark.slow
def test_the_page_its_data_and_its_plots_are_written(
    table: Results, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (Path(__file__).parents[2] / "docs" / "benchmarks" / "ik.md").read_text(encoding="utf-8")
    (tmp_path / "ik.md").write_text(page, encoding="utf-8")
    monkeypatch.setattr("benchmarks.tables.FOLDER", tmp_path)
    BENCHMARK.write(table)
    assert BENCHMARK.stored == table
    assert "\n".join(ik_tables(table)) in (tmp_path / "ik.md").read_text(encoding="utf-8")
    for name in ("ik_latency.png", "ik_steps.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG\r\n\x1a\n")


@pytest.mark.parametrize(("words", "message"), [({"points": 0}, "at least 1"), ({"methods": ["magic"]}, "magic")])
def test_invalid_settings_are_refused(words: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        ik_benchmark(["ur5"], **{"points": 1, **words})


def wrong_method(arm: pp.Arm, part: Part) -> PreparedMethod:
    """Reports a configuration beside the start as the answer to every target."""
    return PreparedMethod(
        solve=lambda target, q0: q0,
        read=lambda q: q[None] + 0.3,
        solve_batch=lambda targets, q0: np.tile(q0 + 0.3, (len(targets), 1, 1)),
    )


@pytest.mark.parametrize("part", PARTS, ids=str)
def test_wrong_answers_are_false_positives(part: Part) -> None:
    arm = with_reduced_ranges(pp.load_robot("ur5").arm())
    make = random_targets if part.problem == "random" else smooth_targets
    row = measured_row(arm, "ur5", IkMethod("wrong", "wrong", wrong_method), part, make(arm, POINTS, 0))
    assert row is not None
    assert row.success == 0.0
    assert row.false_positives == 2 * POINTS  # single calls and a batch
    assert row.position_error > 1e-3


def test_the_trajectory_starts_each_call_at_the_last_answer() -> None:
    arm = pp.load_robot("ur5").arm()
    targets, seen = smooth_targets(arm, 5, 0), []

    def prepare(arm: pp.Arm, part: Part) -> PreparedMethod:
        seen.clear()
        ik = pp.Clik()
        return PreparedMethod(
            solve=lambda target, q0: (seen.append(q0), ik.solve(arm, target, q0))[1], read=lambda found: found.q[None]
        )

    row = measured_row(arm, "ur5", IkMethod("seen", "seen", prepare), Part("trajectory", "pose", True), targets)
    np.testing.assert_allclose(seen, [targets.start, *targets.q[:-1]], atol=1e-5)
    assert row.largest_step == pytest.approx(np.abs(np.diff(targets.q, axis=0)).max(), abs=1e-5)


def test_an_error_of_a_peer_is_listed_and_does_not_end_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(arm: pp.Arm, part: Part) -> PreparedMethod:
        raise OSError("its library is gone")

    peer = IkMethod("broken", "broken", broken, compared_with="clik")
    monkeypatch.setattr("benchmarks.ik_run.PEERS", (peer,))
    made = ik_benchmark(["ur5"], points=1, methods=["clik", "broken"])
    assert made["left_out"] == {"ur5": {"broken": "OSError: its library is gone"}}
    assert {row.method for row in made["rows"]} == {"clik"}


def test_the_ratio_refers_to_our_method_in_the_same_part(monkeypatch: pytest.MonkeyPatch) -> None:
    peer = replace(OWN_METHODS[0], key="peer", compared_with="clik", textbook=None)
    monkeypatch.setattr("benchmarks.ik_run.PEERS", (peer,))
    made = ik_benchmark(["ur5"], points=2, methods=["clik", "peer"])
    for part in PARTS:
        ours, theirs = rows_of(made, "ur5", part)
        assert theirs.ratio == pytest.approx(theirs.mean_ms / ours.mean_ms)
        assert ours.ratio is None


def test_success_rates_count_solved_targets(success: list[Row]) -> None:
    rows = [(row.robot, row.method) for row in success]
    assert rows == [("ur5", "clik"), ("ur5", "analytic"), ("panda", "clik")]
    assert all(row.samples == 50 and row.success == 1.0 and row.false_positives == 0 for row in success)
    assert all(row.batch_us > 0 for row in success)


def test_the_configuration_that_generated_the_target_is_among_the_branches(
    success: list[Row],
) -> None:
    recovered = {(row.robot, row.method): row.recovered for row in success}
    assert recovered == {("ur5", "clik"): None, ("ur5", "analytic"): 1.0, ("panda", "clik"): None}


def test_the_blocks_have_success_rates(table: Results, success: list[Row]) -> None:
    with_rates = deepcopy(table)
    with_rates.parts["success"] = success
    assert "| panda | Clik | 100 % | 0 |" in "\n".join(BENCHMARK.blocks(with_rates)["success"])
    assert BENCHMARK.blocks(table)["success"] == []


def test_an_arm_without_a_closed_form_is_left_out_with_the_reason(tmp_path: Path) -> None:
    rows = [
        pp.DhRow(f"j{k}", 0.3, 0.1 + 0.02 * k, 0.2, 0.7 + 0.1 * k, kind, -0.5, 0.5, 1.0)
        for k, kind in enumerate(["revolute", "prismatic", "prismatic", "prismatic", "prismatic", "revolute"])
    ]
    robot = str(tmp_path / "general.urdf")
    pp.write_urdf(pp.DhTable(rows, convention="standard", name="general"), robot)
    made = ik_benchmark([robot], points=1, methods=["analytic", "clik"], peers=False)
    assert made["left_out"][robot]["analytic"].startswith("no closed form")
    assert {row.method for row in made["rows"]} == {"clik"}


def test_stored_rows_have_the_fields_of_a_row(table: Results) -> None:
    """If this fails after a change of the fields, run the benchmark again."""
    assert all(vars(row).keys() == vars(table["rows"][0]).keys() for row in BENCHMARK.stored["rows"])


def test_tracking_has_a_row_for_the_trajectory_only(table: Results) -> None:
    (row,) = [row for row in table["rows"] if row.method == "tracking"]
    assert row.problem == "trajectory"
    assert row.batch_ms > 0
    assert row.success == 1.0
    arm = pp.load_robot("ur5").arm()
    assert row.largest_step <= 1e-3 * arm.limits.velocity.max()


# An answer is correct only inside the limits and within the tolerance, by Pinocchio's forward kinematics.


@pytest.fixture(scope="module")
def arm() -> pp.Arm:
    return with_reduced_ranges(pp.load_robot("ur5").arm())


def checked(arm: pp.Arm, answers: np.ndarray, task: str = "pose", tolerance: float = 1e-6):
    return check_answers(arm, random_targets(arm, len(answers), 0).poses, answers, task, tolerance)


def true_answers(arm: pp.Arm, count: int = 4) -> np.ndarray:
    return random_targets(arm, count, 0).q[:, None].copy()


def test_the_configuration_that_generated_a_target_is_correct(arm: pp.Arm) -> None:
    found = checked(arm, true_answers(arm))
    assert found.success == 1.0
    assert found.false_positives == 0
    assert found.errors[:, 0].max() < 1e-12


def test_an_answer_one_full_rotation_outside_the_limits_is_a_false_positive(arm: pp.Arm) -> None:
    answers = true_answers(arm)
    answers[0, 0, 5] += 2 * np.pi
    found = checked(arm, answers)
    assert found.correct.tolist() == [False, True, True, True]
    assert found.false_positives == 1


def test_the_error_of_an_answer_is_measured(arm: pp.Arm) -> None:
    answers = true_answers(arm)
    answers[:, 0, 5] += 2e-6  # the last joint rotates the TCP by the same angle
    answers = np.clip(answers, arm.limits.lower, arm.limits.upper)
    found = checked(arm, answers)
    np.testing.assert_allclose(found.errors[:, 1], 2e-6, rtol=1e-3)
    assert found.success == 0.0
    assert checked(arm, answers, tolerance=1e-5).success == 1.0


def test_the_position_task_ignores_the_rotation_only(arm: pp.Arm) -> None:
    answers = true_answers(arm)
    answers[:, 0, 5] *= 0.5
    found = checked(arm, answers, "position")
    assert found.correct.tolist() == (found.errors[:, 0] <= 1e-6).tolist()
    assert found.errors[:, 1].max() == 0.0


def test_no_answer_is_a_failure_and_not_a_false_positive(arm: pp.Arm) -> None:
    answers = true_answers(arm)
    answers[1] = np.nan
    found = checked(arm, answers)
    assert found.answered.tolist() == [True, False, True, True]
    assert (found.success, found.false_positives) == (0.75, 0)


def test_an_answer_with_some_nan_is_wrong(arm: pp.Arm) -> None:
    answers = true_answers(arm)
    answers[2, 0, 3] = np.nan
    found = checked(arm, answers)
    assert found.false_positives == 1
    assert np.isinf(found.errors[2, 0])


def test_all_branches_must_be_correct(arm: pp.Arm) -> None:
    good = true_answers(arm)
    bad, none = good + 0.1, np.full_like(good, np.nan)
    assert checked(arm, np.concatenate([good, none], axis=1)).success == 1.0
    assert checked(arm, np.concatenate([good, bad], axis=1)).false_positives == 4


# Other libraries receive a chain with the same forward kinematics and limits.


ROBOTS = ("ur5", "panda", "stanford", "kinova", "puma560", "scara")


@pytest.mark.parametrize("name", ROBOTS)
def test_the_chain_urdf_has_the_kinematics_of_the_arm(name: str) -> None:
    arm = pp.load_robot(name).arm()
    chain = load_robot(chain_urdf(arm)).arm(TIP)
    assert list(chain.joint_names) == list(arm.joint_names)
    q = np.random.default_rng(0).uniform(*arm.limits.sampling_range(), (50, arm.dof))
    np.testing.assert_allclose(chain.forward_kinematics_batch(q), arm.forward_kinematics_batch(q), atol=1e-12)
    np.testing.assert_array_equal(chain.limits.lower, arm.limits.lower)
    np.testing.assert_array_equal(chain.limits.upper, arm.limits.upper)


def test_the_product_of_the_screws_is_the_pose() -> None:
    arm = pp.load_robot("ur5").arm()
    axes, q = screw_axes(arm), np.array([0.3, -1.2, 1.4, -0.5, 0.7, 0.2])
    rotation, position = np.eye(3), np.zeros(3)
    for offset, direction, angle in zip(axes.offsets[:-1], axes.directions, q, strict=True):
        position = position + rotation @ offset
        x, y, z = direction
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        rotation = rotation @ (np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)
    pose = arm.forward_kinematics(q)
    np.testing.assert_allclose(position + rotation @ axes.offsets[-1], pose.translation, atol=1e-12)
    np.testing.assert_allclose(rotation @ axes.base_from_tcp[:3, :3], pose.rotation, atol=1e-12)


def test_the_geometry_is_recognised() -> None:
    ur5, puma = (screw_axes(pp.load_robot(name).arm()) for name in ("ur5", "puma560"))
    assert ur5.parallel(1, 2, 3)
    assert not ur5.parallel(0, 1)
    assert ur5.intersecting(3, 4, 5) is None
    moved = puma.intersecting(3, 4, 5)
    assert moved is not None
    np.testing.assert_allclose(moved.offsets[4:6], 0.0, atol=1e-6)
    np.testing.assert_allclose(moved.offsets.sum(axis=0), puma.offsets.sum(axis=0), atol=1e-12)


def test_the_points_of_the_axes_are_the_positions_of_the_joints() -> None:
    """By these points, ssik recognises the spherical wrist of the Puma: its last two joints are at the same point."""
    np.testing.assert_allclose(screw_axes(pp.load_robot("puma560").arm()).offsets[5], 0.0, atol=1e-9)


def test_parallel_axes_do_not_intersect() -> None:
    assert screw_axes(pp.load_robot("ur5").arm()).intersecting(1, 2) is None


def test_mimic_joints_are_refused() -> None:
    text = """<robot name="coupled"><link name="a"/><link name="b"/><link name="c"/>
      <joint name="one" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
        <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
      <joint name="two" type="revolute"><parent link="b"/><child link="c"/><axis xyz="0 1 0"/><mimic joint="one"/>
        <limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""
    arm = load_robot(text).arm("c")
    with pytest.raises(NotApplicableError, match="mimic"):
        screw_axes(arm)
    with pytest.raises(ConversionError, match="mimic"):
        chain_urdf(arm)


# Targets are reachable, inside the limits, reproducible, and smooth along a trajectory.


WITH_TARGETS = ("ur5", "panda", "kinova", "scara")


@pytest.mark.parametrize("name", WITH_TARGETS)
@pytest.mark.parametrize("make", [random_targets, smooth_targets])
def test_targets_are_poses_of_configurations_inside_the_limits(name: str, make) -> None:
    arm = with_reduced_ranges(pp.load_robot(name).arm())
    targets = make(arm, 30, 3)
    assert all(arm.limits.contains(q) for q in [*targets.q, targets.start])
    np.testing.assert_array_equal(targets.poses, arm.forward_kinematics_batch(targets.q))


@pytest.mark.parametrize("make", [random_targets, smooth_targets])
def test_targets_depend_on_the_seed(make) -> None:
    arm = pp.load_robot("panda").arm()
    np.testing.assert_array_equal(make(arm, 9, 1).q, make(arm, 9, 1).q)
    assert np.abs(make(arm, 9, 1).q - make(arm, 9, 2).q).max() > 0.1


@pytest.mark.parametrize("name", WITH_TARGETS)
def test_the_trajectory_keeps_the_velocity_limits_and_moves_every_joint(name: str) -> None:
    arm = with_reduced_ranges(pp.load_robot(name).arm())
    q = smooth_targets(arm, 10_000, 0).q
    speed = np.abs(np.diff(q, axis=0)).max(axis=0) / PERIOD
    assert (speed <= np.where(np.isnan(arm.limits.velocity), np.inf, arm.limits.velocity)).all()
    assert (np.ptp(q, axis=0) > 0).all()


def test_only_ranges_wider_than_one_rotation_are_reduced() -> None:
    ur5 = pp.load_robot("ur5").arm()
    assert ur5.limits.upper.max() > 6.0
    np.testing.assert_allclose(with_reduced_ranges(ur5).limits.upper, np.pi, atol=1e-8)
    np.testing.assert_allclose(with_reduced_ranges(ur5).limits.lower, -np.pi, atol=1e-8)
    panda, kinova = (pp.load_robot(name).arm() for name in ("panda", "kinova"))
    np.testing.assert_array_equal(with_reduced_ranges(panda).limits.upper, panda.limits.upper)
    unbounded = np.isinf(kinova.limits.upper)
    assert unbounded.any()
    assert np.isinf(with_reduced_ranges(kinova).limits.upper[unbounded]).all()


# Near a singularity the steps of the plain inverse grow without bound, and damped steps do not.


@pytest.fixture(scope="module")
def steps():
    return step_sizes(pp.load_robot("ur5").arm())


def test_the_wrist_of_the_ur5_moves_into_the_singularity(steps) -> None:
    assert steps.joint == "wrist_2_joint"
    assert (np.diff(steps.smallest) <= 0).all()
    assert steps.smallest[0] > 0.1
    assert steps.smallest[-1] < 1e-8
    assert set(steps.steps) == set(METHODS)


def test_the_plain_inverse_grows_as_the_singular_value_falls(steps) -> None:
    near = (steps.smallest < 1e-3) & (steps.smallest > 1e-7)
    product = (steps.steps["inverse"] * steps.smallest)[near]
    np.testing.assert_allclose(product, product[0], rtol=0.05)
    assert np.nanmax(steps.steps["inverse"]) > 1e4


def test_far_from_the_singularity_the_undamped_methods_agree(steps) -> None:
    assert steps.steps["pseudo-inverse"][0] == pytest.approx(steps.steps["inverse"][0], rel=1e-9)


@pytest.mark.parametrize("name", ["damped least squares", "CLIK"])
def test_damped_steps_stay_bounded(steps, name: str) -> None:
    assert steps.steps[name].max() <= np.sqrt(6) * pp.Clik().max_step
    assert steps.steps[name][-1] < 0.1


def test_an_arm_with_seven_joints_has_no_step_sizes() -> None:
    assert step_sizes(pp.load_robot("panda").arm()) is None
