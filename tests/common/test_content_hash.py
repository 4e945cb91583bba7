"""The cache on disk: equal results with and without it, changed inputs, damaged entries, limits."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision.checking import links
from pinproof.common import content_hash
from pinproof.common.content_hash import cached, content_digest
from pinproof.description.meshes import read_mesh
from pinproof.viewer.surfaces import link_surfaces


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder for the cache."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("PINPROOF_CACHE", str(folder))
    return folder


class Counted:
    """A function that counts its calls."""

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self) -> dict[str, np.ndarray]:
        self.calls += 1
        return {"a": np.arange(3.0) / 3, "b": np.array([[1, 2]])}


def test_entry_is_computed_once_and_read_back_exactly(place: Path) -> None:
    make = Counted()
    for _ in range(3):
        found = cached("test", content_digest("x"), make, code=[__file__])
        assert np.array_equal(found["a"], np.arange(3.0) / 3)
        assert found["b"].dtype == np.array([[1, 2]]).dtype
    assert make.calls == 1


def test_other_inputs_and_other_code_are_other_entries(place: Path, tmp_path: Path) -> None:
    make, code = Counted(), tmp_path / "code.py"
    code.write_text("1")
    cached("test", content_digest("x"), make, code=[str(code)])
    cached("test", content_digest("y"), make, code=[str(code)])
    cached("other", content_digest("x"), make, code=[str(code)])
    assert make.calls == 3
    code.write_text("2")
    content_hash._made_with.cache_clear()
    cached("test", content_digest("x"), make, code=[str(code)])
    assert make.calls == 4


@pytest.mark.parametrize("damage", [b"", b"no archive", None])
def test_damaged_entry_is_computed_again(place: Path, damage: bytes | None) -> None:
    make = Counted()
    cached("test", content_digest("x"), make, code=[__file__])
    (entry,) = place.glob("*.npz")
    content = bytearray(entry.read_bytes())
    content[len(content) // 3] ^= 0xFF
    entry.write_bytes(bytes(content) if damage is None else damage)
    found = cached("test", content_digest("x"), make, code=[__file__])
    assert make.calls == 2
    assert np.array_equal(found["a"], np.arange(3.0) / 3)


def test_disabled_or_unwritable_cache_changes_nothing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("")
    for stated in ("off", str(file / "below")):
        monkeypatch.setenv("PINPROOF_CACHE", stated)
        make = Counted()
        cached("test", content_digest("x"), make, code=[__file__])
        cached("test", content_digest("x"), make, code=[__file__])
        assert make.calls == 2


def test_oldest_entries_are_deleted(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(content_hash, "LARGEST_CACHE", 3000)
    for number in range(20):
        cached("test", content_digest(number), Counted(), code=[__file__])
        newest = max(place.glob("*.npz"), key=lambda entry: entry.stat().st_mtime_ns)
        os.utime(newest, ns=(number, number))
    assert 0 < sum(entry.stat().st_size for entry in place.glob("*.npz")) <= 3500


def test_meshes_hulls_and_surfaces_are_equal_with_and_without_the_cache(place: Path, monkeypatch) -> None:
    urdf = pp.load_robot("ur5").urdf
    visual = next(each for each in urdf.visuals if each.kind == "mesh")
    body = next(each for each in urdf.collisions if each.kind == "mesh" and "wrist_1" in each.link)

    def everything() -> list[np.ndarray]:
        for known in (links._solid, links._is_watertight, links._parts):
            known.cache_clear()
        mesh = read_mesh(visual.mesh.path)
        parts = links._parts(body.mesh.path, 0, (1.0, 1.0, 1.0))
        watertight = links._is_watertight(body.mesh.path, 0, (1.0, 1.0, 1.0))
        surfaces = link_surfaces(visual)
        arrays = [mesh.vertices, mesh.triangles, np.array(watertight), *(part.support.points for part in parts)]
        for surface in surfaces:
            arrays += [surface.vertices, surface.normals, surface.triangles, np.array(surface.rgba)]
            arrays += [] if surface.uv is None else [surface.uv, np.array(surface.image)]
        return arrays

    written, read = everything(), everything()
    assert list(place.glob("*.npz"))
    monkeypatch.setenv("PINPROOF_CACHE", "off")
    computed = everything()
    assert len(written) == len(read) == len(computed) > 8
    for one, two, three in zip(written, read, computed, strict=True):
        assert one.dtype == two.dtype == three.dtype
        assert np.array_equal(one, two)
        assert np.array_equal(one, three)


def test_changed_mesh_file_is_read_again(place: Path, tmp_path: Path) -> None:
    path = tmp_path / "part.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert read_mesh(path).vertices.max() == 1
    path.write_text("v 0 0 0\nv 2 0 0\nv 0 1 0\nf 1 2 3\n")
    assert read_mesh(path).vertices.max() == 2
