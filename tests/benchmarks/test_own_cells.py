"""The benchmark of own cells: its cell is valid, and its check of edges finds contacts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from benchmarks import own_cells
from benchmarks.own_cells import BENCHMARK, _Truth, edge_row, pick_files, random_scene
from benchmarks.tote_cell import KINDS, write_cell

import pinproof as pp
from pinproof.collision import Box, Mesh


def test_the_cell_is_the_same_for_a_seed_and_can_be_read(tmp_path: Path) -> None:
    one, other = (tmp_path / name for name in ("one", "other"))
    for folder in (one, other):
        folder.mkdir()
        write_cell(folder, seed=3)
    assert sorted(file.name for file in one.iterdir()) == sorted(file.name for file in other.iterdir())
    assert all(
        (one / name).read_bytes() == (other / name).read_bytes() for name in ("scene.yaml", "tote.stl", "tee.yaml")
    )
    files = pick_files(one)
    assert {file.stem for file in files} == {*KINDS}
    picks = pp.read_picks(files[0])
    checker = pp.CollisionChecker(picks.load_arm(), pp.Scene.load(picks.scene), margin=picks.margin)
    assert checker.is_free(picks.load_arm().home)


def test_the_check_of_edges_finds_contacts_with_surfaces_and_insides() -> None:
    arm = pp.load_robot("ur5").arm()
    tip = arm.root_from_base * arm.forward_kinematics(arm.home)
    small = pp.Scene([pp.Obstacle("at_the_tip", Box(0.02, 0.02, 0.02), tip)])
    for scene, expected in ((pp.Scene([]), False), (small, True)):
        truth = _Truth(arm, scene)
        truth.place(arm.home)
        assert truth.contact() is expected
    mesh = own_cells._meshes()[1]  # a tube
    around = np.array([[x, y, z] for x in (-3, 3) for y in (-3, 3) for z in (-3, 3)], dtype=float)
    faces = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6],
                      [0, 6, 4], [1, 5, 7], [1, 7, 3]])  # fmt: skip
    outside = _Truth(
        arm, pp.Scene([pp.Obstacle("tube", Mesh.from_arrays(mesh.vertices, mesh.faces), pp.pose((5, 0, 0)))])
    )
    inside = _Truth(arm, pp.Scene([pp.Obstacle("cube", Mesh.from_arrays(around, faces))]))
    for truth, expected in ((outside, False), (inside, True)):
        truth.place(arm.home)
        assert not truth.contact()
        assert truth.inside() is expected


@pytest.mark.parametrize("count", [1, 40])
def test_edges_that_are_proven_free_have_no_contact(count: int) -> None:
    row = edge_row(count, 120, seed=5)
    assert row.free > 10
    assert row.samples > row.free
    assert row.wrong == []


def test_a_wrong_verdict_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(own_cells, "is_proven_free", lambda *_: True)
    row = edge_row(10, 60, seed=5)
    assert row.wrong
    assert row.wrong[0].startswith("ur5 among 10 bodies, edge ")


def test_a_scene_has_exact_meshes_of_its_own_kind() -> None:
    scene = random_scene(60, np.random.default_rng(0))
    assert len(scene) == 60
    exact = [each for each in scene.obstacles if isinstance(each.shape, Mesh)]
    assert len(exact) > 10
    assert all(each.shape.hull is False for each in exact)


@pytest.mark.parametrize(("name", "reason"), [("missing", "no such folder"), ("empty", "no picks file")])
def test_a_folder_without_picks_is_an_error_before_any_work(
    name: str, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "scene.yaml").write_text("obstacles: []\n", encoding="utf-8")
    monkeypatch.setattr(own_cells, "pick_row", lambda *_: pytest.fail("picks were judged"))
    monkeypatch.setattr("sys.argv", ["benchmark", "--cell", str(tmp_path / name)])
    with pytest.raises(SystemExit, match=f"{name}: .*{reason}"):
        own_cells.main()


def test_the_stored_results_are_complete() -> None:
    stored = BENCHMARK.stored
    assert {row.file for row in stored["picks"] if row.cell == own_cells.OWN} == {*KINDS}
    assert [row.bodies for row in stored["edges"]] == list(own_cells.BODIES)
