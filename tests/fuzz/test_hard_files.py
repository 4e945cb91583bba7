"""Inputs that hang, swell or crash what reads them carelessly: each is refused, by its name, before it does harm."""

from __future__ import annotations

import gzip
import os
import struct
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.description.meshes import read_mesh

from ..processes import PATIENCE
from .samples import READERS

MESHES = ("part.stl", "part.obj", "part.ply", "part.dae", "part.glb", "part.gltf")
ALL = {**READERS, **dict.fromkeys(MESHES, read_mesh), "cell.urdf.xacro": pp.load_robot}
SPARSE = 2**30
"""Bytes of a file that has only holes."""

NINE = "*{0},*{0},*{0},*{0},*{0},*{0},*{0},*{0},*{0}"
ALIASES = "a: &a [x]\n" + "".join(
    f"{b}: &{b} [{NINE.format(a)}]\n" for a, b in zip("abcdefghijk", "bcdefghijkl", strict=True)
)
LAUGHS = (
    '<!DOCTYPE r [<!ENTITY a "ha">'
    + "".join(f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in zip("abcdefghi", "bcdefghij", strict=True))
    + "]>"
)
FETCHES = '<!DOCTYPE r [<!ENTITY j SYSTEM "file:///etc/passwd">]>'
TRIANGLE = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 {}\n"
)


@pytest.fixture
def in_time():
    """Fail a test that waits for a pipe."""
    import signal

    def late(*_: object) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(int(PATIENCE))
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def said_of(path: Path) -> str:
    with pytest.raises(pp.FileError) as caught:
        ALL[path.name](path)
    assert caught.value.path == str(path)
    return str(caught.value)


@pytest.mark.parametrize("name", ALL)
@pytest.mark.usefixtures("in_time")
class TestWhatIsNoFile:
    def test_nothing_there(self, tmp_path, name):
        assert "No such file" in said_of(tmp_path / name)

    def test_folder(self, tmp_path, name):
        (tmp_path / name).mkdir()
        assert "a folder" in said_of(tmp_path / name)

    def test_pipe(self, tmp_path, name):
        os.mkfifo(tmp_path / name)
        assert "a pipe" in said_of(tmp_path / name)

    def test_device(self, tmp_path, name):
        (tmp_path / name).symlink_to("/dev/zero")
        assert "device" in said_of(tmp_path / name)

    def test_links_in_a_circle(self, tmp_path, name):
        (tmp_path / name).symlink_to(tmp_path / name)
        assert "symbolic links" in said_of(tmp_path / name)

    def test_empty(self, tmp_path, name):
        (tmp_path / name).touch()
        assert said_of(tmp_path / name)

    def test_file_that_may_not_be_read(self, tmp_path, name):
        (tmp_path / name).touch(mode=0o000)
        if os.access(tmp_path / name, os.R_OK):
            pytest.skip("whoever runs this may read everything")
        assert "Permission denied" in said_of(tmp_path / name)

    def test_name_that_no_file_can_have(self, tmp_path, name):
        with pytest.raises(pp.FileError, match="cannot be read"):
            ALL[name](tmp_path / f"a\0{name}")
        with pytest.raises(pp.FileError, match="File name too long"):
            ALL[name](tmp_path / f"{'x' * 300}{name}")


@pytest.mark.parametrize("name", [name for name in ALL if name != "picks.csv"])
def test_a_gigabyte_is_refused_unread(tmp_path, name, monkeypatch):
    with (tmp_path / name).open("wb") as file:
        file.truncate(SPARSE + 1)

    def unread(*_: object) -> bytes:
        raise AssertionError("was read")

    monkeypatch.setattr(Path, "read_bytes", unread)
    expected = said_of(tmp_path / name)
    assert "1,024 MiB" in expected or str(SPARSE + 1) in expected
    if name in MESHES:
        assert "simplify the mesh" in expected


def test_table_of_picks_is_not_taken_into_memory_in_search_of_a_line_end(tmp_path):
    with (tmp_path / "picks.csv").open("wb") as file:
        file.truncate(SPARSE)
    assert "a line of more than" in said_of(tmp_path / "picks.csv")


@pytest.mark.parametrize("name", [name for name in READERS if name.endswith("yaml")] + ["picks.json"])
@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (ALIASES, "values after the expansion of aliases"),
        ("a: &a [*a]\n", r"line 1.*\*a refers to its own parent"),
        ("a: &a {b: *a}\n", r"line 1.*\*a refers to its own parent"),
        ("a: &a {b: 1}\nc: {<<: *a}\n", "line 2.*merge keys"),
        ("a: " + "[" * 100_000, "nested too deep"),
        ("- " * 100_000, "nested too deep"),
        ("{a: " * 100_000, "nested too deep"),
        ("a: !!python/object/apply:os.system [x]\n", "line 1.*python"),
        ("a: !!bool maybe\n", "is not valid YAML"),
        ("a: !!int ''\n", "is not valid YAML"),
        ("a: !!timestamp x\n", "is not valid YAML"),
        ("a: 2026-99-99\n", "is not valid YAML"),
        ("a: 1\na: 2\n", "line 2.*duplicate key 'a'"),
        ("[1]: 2\n", "line 1.*cannot be a key"),
        ("a: " + "9" * 5000, "is not valid YAML"),
        ("a: 0x" + "f" * 5000, "larger than any double"),
        ("a: 1:30\n", "'1:30' is ambiguous"),
        ("a: *b\n", "line 1.*alias"),
        ("a\0b: 1\n", r"line 1.*U\+0000"),
    ],
)
def test_yaml(tmp_path, name, text, expected):
    (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises(pp.FileError, match=expected):
        ALL[name](tmp_path / name)


@pytest.mark.parametrize("name", ["message.json", "proof.json"])
@pytest.mark.parametrize(
    "text", ["[" * 200_000, '{"a":' * 200_000, "9" * 5000, '{"a": 1, "a": 2}', "NaN", "\ufeff{}", '"\\ud800"']
)
def test_json(tmp_path, name, text):
    (tmp_path / name).write_text(text, encoding="utf-8")
    if text == '"\\ud800"' or text in ("NaN", "\ufeff{}"):
        return _refused_or_a_verdict(tmp_path / name)
    assert said_of(tmp_path / name)
    return None


def _refused_or_a_verdict(path: Path) -> None:
    try:
        verdict = ALL[path.name](path)
    except pp.FileError:
        return
    assert not verdict.ok


@pytest.mark.parametrize(
    "content",
    [gzip.compress(b"{}" * 99, mtime=0)[:-9], b"\x1f\x8b" + b"\0" * 99, b"\x1f\x8b\x08\0" + b"\xff" * 99],
    ids=["cut off", "no method", "no data"],
)
def test_a_truncated_gzip_proof_is_refused(tmp_path, content):
    (tmp_path / "proof.json").write_bytes(content)
    assert "cannot be read as a proof" in said_of(tmp_path / "proof.json")


@pytest.mark.parametrize("name", ["robot.urdf", "robot.srdf", "robot.xml", "part.dae", "cell.urdf.xacro"])
@pytest.mark.parametrize("doctype", [LAUGHS, FETCHES])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_entities_neither_swell_nor_fetch(tmp_path, name, doctype, encoding):
    tag = {"robot.xml": "mujoco", "part.dae": "COLLADA"}.get(name, "robot")
    (tmp_path / name).write_bytes(f"{doctype}<{tag} name='r'>&j;</{tag}>".encode(encoding))
    assert "DOCTYPE" in said_of(tmp_path / name)


def test_groups_of_groups_of_groups(tmp_path):
    groups = "".join(f'<group name="g{i}"><group name="g{i + 1}"/></group>' for i in range(5000))
    (tmp_path / "robot.srdf").write_text(f'<robot name="r">{groups}</robot>', encoding="utf-8")
    assert "nested more than" in said_of(tmp_path / "robot.srdf")


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        (
            "part.stl",
            b"x" * 80 + struct.pack("<I", 2**31) + b"\0" * 100,
            "announces 107,374,182,484 bytes, but it has 184",
        ),
        ("part.stl", b"solid x\nendsolid x\n", "no triangle"),
        ("part.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "not finite"),
        ("part.obj", b"v 1e300 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "limit 10000 m|makes? sense"),
        ("part.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9999\n", "cannot be read as a mesh"),
        ("part.ply", TRIANGLE.format("0 1 77").encode(), "indices outside the 3 vertices"),
        ("part.ply", TRIANGLE.format("0 1 -7").encode(), "indices outside the 3 vertices"),
        ("part.ply", TRIANGLE.replace("vertex 3", "vertex 2147483647").format("0 1 2").encode(), "no triangle|cannot"),
        (
            "part.gltf",
            b'{"asset":{"version":"2.0"},"buffers":[{"uri":"../../etc/passwd","byteLength":9}]}',
            "cannot be",
        ),
        ("part.glb", b"glTF" + b"\xff" * 20, "cannot be read"),
        ("part.dae", b"<COLLADA/>", "cannot be read"),
    ],
)
def test_meshes(tmp_path, name, content, expected):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(pp.errors.MeshError, match=expected):
        read_mesh(tmp_path / name)


def test_materials_are_not_fetched(tmp_path, monkeypatch):
    os.mkfifo(tmp_path / "pipe.mtl")
    (tmp_path / "part.obj").write_text(
        "mtllib pipe.mtl\nusemtl x\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", encoding="utf-8"
    )
    assert len(read_mesh(tmp_path / "part.obj").triangles) == 1


def test_an_unknown_mesh_format_is_refused_with_the_known_formats(tmp_path):
    (tmp_path / "part.step").touch()
    with pytest.raises(pp.errors.MeshError, match=r"valid: \.stl, \.obj, \.dae, \.ply, \.glb, \.gltf"):
        read_mesh(tmp_path / "part.step")


def test_two_hundred_thousand_triangles_are_read(tmp_path):
    corners = np.random.default_rng(0).random((200_000, 3, 3), dtype=np.float32)
    rows = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])
    rows["corners"] = corners
    (tmp_path / "part.stl").write_bytes(b"\0" * 80 + struct.pack("<I", len(rows)) + rows.tobytes())
    assert read_mesh(tmp_path / "part.stl").vertices.shape == (600_000, 3)


@pytest.mark.parametrize("stated", ["counts: [4294967296, 4294967296, 1]", "counts: [1000000000000, 1, 1]"])
def test_a_pattern_too_large_for_memory_is_refused(tmp_path, stated):
    pattern = f"{{grid: {{{stated}, step: [1, 1, 1]}}}}"
    row = f"{{name: a, xyz: [0, 0, 0], rpy: [0, 0, 0], pattern: {pattern}}}"
    (tmp_path / "picks.yaml").write_text(f"picks:\n  - {row}\n", encoding="utf-8")
    (problem,) = pp.read_picks(tmp_path / "picks.yaml").problems
    assert "at most 100000" in problem.reason


def test_a_range_of_very_many_rotations(tmp_path):
    row = "{name: a, xyz: [0, 0, 0], rpy: [0, 0, 0], spin: {range: [0, 1], steps: 1000000000000}}"
    (tmp_path / "picks.yaml").write_text(f"picks:\n  - {row}\n", encoding="utf-8")
    (problem,) = pp.read_picks(tmp_path / "picks.yaml").problems
    assert "1 to 3600" in problem.reason


def test_likeness_of_long_names_costs_nothing(tmp_path):
    names = [f"{'x' * 20_000}{i}" for i in range(300)]
    many = "".join(f'<link name="{name}"/>' for name in names)
    joint = f'<joint name="j" type="fixed"><parent link="{"y" * 20_000}"/><child link="{names[0]}"/></joint>'
    (tmp_path / "robot.urdf").write_text(f'<robot name="r">{many}{joint}</robot>', encoding="utf-8")
    assert len(said_of(tmp_path / "robot.urdf")) < 4000
