"""A reader accepts any content of a file or raises an error of this package, in bounded time."""

from __future__ import annotations

import contextlib
import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import trimesh
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

import pinproof as pp

from ..examples import examples
from .mutations import bytes_of, worse_lines, worse_tree, worse_xml
from .samples import MJCF, READERS, SRDF, TABLES, TREES, URDF, write_parts

pytestmark = pytest.mark.filterwarnings("ignore::pinproof.errors.UnitWarning")

EXAMPLES = int(os.environ.get("PINPROOF_FUZZ_EXAMPLES", "25"))
"""Number of examples of each test; errors were found with thousands."""

LONGEST = 5.0
"""Seconds of CPU time that a file may take; one that hangs would hang the suite."""

fuzzed = examples(
    EXAMPLES,
    derandomize="PINPROOF_FUZZ_EXAMPLES" not in os.environ,
    database=None,
    suppress_health_check=list(HealthCheck),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("fuzz")
    write_parts(folder)
    (folder / "parts").mkdir()
    trimesh.creation.box((100, 100, 100)).export(folder / "parts" / "part.stl")
    return folder


@contextlib.contextmanager
def in_time() -> Iterator[None]:
    def late(*_: object) -> None:
        raise TimeoutError(f"more than {LONGEST} s of CPU time")

    before = signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, LONGEST)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def look(folder: Path, name: str, content: bytes) -> None:
    """Read the file; anything but a value or an error of this package fails the test, as does an unreadable message."""
    file = folder / name
    file.write_bytes(content)
    text = "read"
    try:
        with in_time():
            READERS[name](file)
    except pp.PinproofError as error:
        text = str(error)
    assert 0 < len(text) < 4000
    assert text.replace("\n", "").isprintable()


@pytest.mark.parametrize("name", TREES)
@fuzzed
@given(data=st.data())
def test_trees(folder, name, data):
    tree, write = TREES[name]
    text = write(data.draw(worse_tree(tree)))
    look(folder, name, data.draw(bytes_of(text)))


@pytest.mark.parametrize("name", TABLES)
@fuzzed
@given(data=st.data())
def test_tables(folder, name, data):
    separator = data.draw(st.sampled_from([",", ",", ",", ";", "\t", " "]))
    text = data.draw(worse_lines(TABLES[name])).replace(",", separator)
    look(folder, name, data.draw(bytes_of(text)))


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("robot.urdf", URDF),
        ("robot.srdf", SRDF),
        pytest.param("robot.xml", MJCF, marks=pytest.mark.slow),  # the import of mujoco starts processes
    ],
)
@fuzzed
@given(data=st.data())
def test_xml(folder, name, text, data):
    content = data.draw(worse_xml(text)).decode()
    look(folder, name, data.draw(bytes_of(content)))


@pytest.mark.parametrize("name", READERS)
@fuzzed
@given(content=st.binary(max_size=200))
def test_any_bytes(folder, name, content):
    look(folder, name, content)


@pytest.fixture(scope="module")
def proof(folder) -> Any:
    arm = pp.load_robot("ur5").arm()
    checker = pp.CollisionChecker(arm, pp.Scene([pp.Obstacle("ball", pp.Sphere(0.1), pp.pose((0, 0, 2)))]))
    path = pp.JointPath([arm.home, arm.home + 0.01], arm.joint_names)
    pp.certify(path, checker, record=True).or_raise().save(folder / "proof.json")
    return json.loads((folder / "proof.json").read_bytes())


@fuzzed
@given(data=st.data())
def test_proofs(folder, proof, data):
    look(folder, "proof.json", data.draw(bytes_of(json.dumps(data.draw(worse_tree(proof))))))
