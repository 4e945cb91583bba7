"""A small run of the collision benchmark; its independent check of verdicts finds wrong ones."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.__main__ import TOPICS
from benchmarks.collision import BENCHMARK, boxes, collision_benchmark
from benchmarks.collision_edges import ROBOTS, check_edges, check_verdict, random_edge, random_scene
from benchmarks.plain_coal import PlainCoal
from benchmarks.tables import Results, Row

import pinproof as pp
from pinproof.errors import InputError

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def table(request: pytest.FixtureRequest) -> Results:
    return collision_benchmark(["ur5"], problems=1, configurations=30, box_counts=(1, 4), edges=5)


@pytest.mark.slow
def test_every_part_is_there(table: Results) -> None:
    assert len(table["checks"]) == 5
    assert {row.robot for row in table["checks"]} == {"ur5"}
    assert [row.scene for row in table["growth"]] == ["boxes: 1", "boxes: 4"]
    assert [row.problems for row in table["proofs"]] == ["ur5, own scenes"]
    assert [(row.robot, row.edges) for row in table["edges"]] == [(robot, 1) for robot in ROBOTS]
    assert table.provenance["seed"] == 0


@pytest.mark.slow
def test_times_are_separate_for_free_and_colliding_configurations(table: Results) -> None:
    for row in (*table["checks"], *table["growth"]):
        for times in (row.is_free, row.check, row.clearance, row.coal, row.coal_tree):
            assert (times["free"] is None) == (row.free_share == 0.0)
            assert (times["colliding"] is None) == (row.free_share == 1.0)
            assert all(us is None or us > 0 for us in times.values())
        assert row.missed_contacts == 0


@pytest.mark.slow
def test_proofs_of_planned_paths_are_free(table: Results) -> None:
    (row,) = table["proofs"]
    assert row.free == row.paths >= 4
    assert 0 < row.median_ms <= row.p95_ms <= row.largest_ms


@pytest.mark.slow
def test_the_blocks_show_the_rows_and_what_is_wrong(table: Results) -> None:
    assert table.faults == []
    blocks = BENCHMARK.all_blocks(table)
    assert blocks["edges"][-1] == "UNDECIDED: 0.000 %."
    assert f"commit {table.provenance['commit']}" in " ".join(blocks["provenance"])
    assert blocks["wrong"] == []
    edge = Row(**{**vars(table["edges"][0]), "wrong": ["ur5, seed 0, scene 0, edge 0: FREE, but ..."]})
    wrong = Results(table.settings, table.provenance, {**table.parts, "edges": [edge]})
    assert len(wrong.faults) == 1
    assert "- ur5, seed 0, scene 0, edge 0: FREE, but ..." in BENCHMARK.all_blocks(wrong)["wrong"]
    assert list(BENCHMARK.figures(table)) == ["collision.png"]


@pytest.mark.parametrize("how", [{"configurations": 0}, {"box_counts": (0,)}, {"edges": -1}])
def test_invalid_settings_are_refused(how: dict) -> None:
    with pytest.raises(InputError):
        collision_benchmark([], **how)


@pytest.mark.slow
@pytest.mark.parametrize("robot", ROBOTS)
def test_no_verdict_on_random_edges_is_wrong(robot: str) -> None:
    row = check_edges(robot, 36, seed=7)
    assert row.wrong == []
    assert row.undecided == 0
    assert row.free > 5
    assert row.free + row.colliding == 36
    assert row.checked > 60 * row.free


@pytest.mark.slow
def test_each_scene_depends_only_on_its_number() -> None:
    few, more = check_edges("ur5", 12, seed=1), check_edges("ur5", 24, seed=1)
    assert few.free <= more.free
    assert more.checked >= few.checked


@pytest.fixture(scope="module")
def touching() -> tuple[pp.JointPath, pp.CollisionChecker, pp.CollisionChecker]:
    """A UR5 whose forearm collides with a sphere in the middle of the edge."""
    arm = pp.load_robot("ur5").arm()
    start, end = np.array([-0.6, -1.0, 1.0, 0, 0, 0]), np.array([0.6, -1.0, 1.0, 0, 0, 0])
    at = arm.frame_placement((start + end) / 2, "wrist_1_link").translation
    checker = pp.CollisionChecker(arm, pp.Scene([pp.Obstacle("ball", pp.Sphere(0.05), pp.pose(at))]))
    meshes = pp.CollisionChecker(arm, checker.scene, link_meshes="mesh")
    return pp.JointPath([start, end], arm.joint_names), checker, meshes


@pytest.mark.slow
def test_correct_verdicts_pass_the_check(touching: tuple) -> None:
    path, checker, meshes = touching
    certificate = pp.certify(path, checker)
    assert certificate.status is pp.CertificateStatus.COLLIDING
    assert check_verdict(path, certificate, checker, meshes) == (1, "")


def test_the_check_finds_a_wrong_free_verdict(touching: tuple) -> None:
    path, checker, meshes = touching
    wrong = pp.certify(path, checker.with_scene(pp.Scene()))
    assert wrong.free
    assert "FREE" in check_verdict(path, wrong, checker, meshes)[1]
    half = pp.JointPath([path.q[0], path.q[0] + 0.1], path.joint_names)
    true = pp.certify(half, checker)
    assert check_verdict(half, true, checker, meshes)[1] == ""
    assert "proven" in check_verdict(half, replace(true, clearance=true.observed + 0.01), checker, meshes)[1]


def test_the_check_finds_a_wrong_contact(touching: tuple) -> None:
    path, checker, meshes = touching
    certificate = pp.certify(path, checker)
    moved = replace(certificate, first_contact=replace(certificate.first_contact, q=path.q[0]))
    assert "COLLIDING, but" in check_verdict(path, moved, checker, meshes)[1]


def test_coal_agrees_except_within_rounding_of_the_margin(touching: tuple) -> None:
    _, checker, _ = touching
    rng = np.random.default_rng(0)
    many = rng.uniform(-3, 3, (60, 6))
    for broadphase in (False, True):
        plain = PlainCoal(checker.with_margin(0.01), broadphase=broadphase)
        for q, theirs in zip(many, plain.configurations(many), strict=True):
            clearance = checker.clearance(q)
            assert plain.is_free(theirs) == (clearance > 0.01) or abs(clearance - 0.01) < 1e-5
            if clearance > 0:
                assert plain.clearance(theirs) == pytest.approx(clearance, abs=1e-5)


def test_scenes_and_edges_are_the_same_for_the_same_seed() -> None:
    arm = pp.load_robot("ur5").arm()
    scenes = [random_scene(np.random.default_rng(3), 0.9) for _ in range(2)]
    assert [o.shape for o in scenes[0].obstacles] == [o.shape for o in scenes[1].obstacles]
    assert len(boxes(50, 0.9, 0).obstacles) == 50
    checker = pp.CollisionChecker(arm, scenes[0])
    one, two = (random_edge(checker, np.random.default_rng(5)) for _ in range(2))
    np.testing.assert_array_equal(one.q, two.q)


@pytest.mark.slow
def test_the_command_prints_the_table(printed: Callable[..., str]) -> None:
    assert "| all | 5 |" in printed("collision", "--only-edges", "5")


@pytest.mark.slow
def test_the_script_lists_its_topics() -> None:
    done = subprocess.run([ROOT / "scripts" / "benchmark"], capture_output=True, text=True, check=True)
    assert set(TOPICS) <= set(done.stdout.split())
