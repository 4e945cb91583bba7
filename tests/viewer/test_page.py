from __future__ import annotations

import json
import re
import subprocess
import sys
from base64 import b64decode
from pathlib import Path

import numpy as np
import pytest

import pinproof
import pinproof.viewer.panels as panels_module
from pinproof.errors import InputError, ViewerError
from pinproof.viewer import write_html
from pinproof.viewer.page import render_page
from pinproof.viewer.picture import Picture
from pinproof.viewer.wire import Commands, node_path

from .conftest import small_arm, swing, turn

MEGABYTE = 1e6


def embedded(text: str, name: str) -> str:
    found = re.search(rf'<script type="[^"]+" id="{name}">(.*?)</script>', text, re.DOTALL)
    assert found
    return found[1]


@pytest.mark.slow
def test_the_page_of_the_ur5_is_small(ur5, cell, tmp_path) -> None:
    write_html(tmp_path / "pick.html", ur5, cell, turn(ur5))
    assert (tmp_path / "pick.html").stat().st_size < 5 * MEGABYTE


@pytest.mark.slow
def test_the_same_input_gives_the_same_bytes() -> None:
    arm = small_arm()
    assert render_page(Picture(arm, None, swing(arm))).text == render_page(Picture(arm, None, swing(arm))).text


def test_the_page_names_no_address_outside_its_licences_and_its_viewer() -> None:
    arm = small_arm()
    text = render_page(Picture(arm, None, swing(arm))).text
    bundle, _ = panels_module._viewer_bundle()
    own = text.replace(bundle, "").replace(embedded(text, "licences"), "")
    assert "://" not in own
    assert set(re.findall(r'https?://[^"\'\s]+', bundle)) == {"http://www.w3.org/1999/xhtml"}  # a name, not a place
    assert "connect-src 'none'" in own


def test_the_licence_of_the_viewer_travels_with_it() -> None:
    text = render_page(Picture(small_arm(), None, None)).text
    assert "Copyright (c) 2018 Robin Deits" in text
    assert "Three.js Authors" in text


def test_names_cannot_become_markup() -> None:
    arm = small_arm(name="&lt;/script&gt;&lt;script&gt;alert(1)&lt;/script&gt;")
    text = render_page(Picture(arm, None, None, title="<title>{{buffers}}")).text
    assert "alert(1)</script>" not in text
    assert "<h1>&lt;title&gt;{{buffers}}</h1>" in text


def test_a_page_that_fails_leaves_the_old_one_alone(tmp_path) -> None:
    old = tmp_path / "pick.html"
    old.write_text("old")
    arm = small_arm()
    with pytest.raises(InputError):
        write_html(old, arm, None, swing(arm), q=[0.0, 0.0])
    with pytest.raises(InputError):
        write_html(old, arm, None, None, q=[0.0])
    assert old.read_text() == "old"
    assert list(tmp_path.iterdir()) == [old]


def test_a_missing_folder_is_named(tmp_path) -> None:
    with pytest.raises(ViewerError, match="gone"):
        write_html(tmp_path / "gone" / "pick.html", small_arm())


def test_a_missing_viewer_is_named(monkeypatch) -> None:
    monkeypatch.setattr(panels_module, "find_spec", lambda name: None)
    with pytest.raises(ViewerError, match="meshcat is not installed"):
        render_page(Picture(small_arm(), None, None))


def test_arrays_come_back_from_the_blob_as_they_went_in() -> None:
    commands = Commands()
    arrays = [
        np.arange(5, dtype=np.int8),
        np.arange(3, dtype=np.float32) / 7,
        np.arange(3, dtype=np.uint16),
        np.arange(2, dtype=np.uint32),
    ]
    references = [commands.array(a)["$buffer"] for a in arrays]
    blob = b64decode(commands.base64())
    for (kind, offset, count), array in zip(references, arrays, strict=True):
        assert offset % 4 == 0
        assert kind.lower().removesuffix("array") == array.dtype.name
        assert np.array_equal(np.frombuffer(blob, array.dtype.newbyteorder("<"), count, offset), array)


def test_commands_are_safe_inside_a_script_and_mean_the_same() -> None:
    commands = Commands()
    commands.set_property("/</script>", "name", "<!--")
    assert "<" not in commands.json()
    assert json.loads(commands.json()) == commands.items


def test_a_slash_in_a_name_makes_no_new_level() -> None:
    assert node_path("robot", "left/arm").count("/") == 2


def test_a_large_surface_gets_wide_indices() -> None:
    from pinproof.viewer.surfaces import Surface

    count = 70_000
    points = np.zeros((count, 3))
    commands = Commands()
    commands.set_surface("/big", Surface(points, points, np.array([[0, 1, count - 1]]), (1, 1, 1, 1)))
    index = commands.items[0]["object"]["geometries"][0]["data"]["index"]
    assert index["type"] == "Uint32Array"
    assert index["itemSize"] == 1


@pytest.mark.slow
def test_neither_meshcat_nor_trimesh_is_loaded_before_it_is_needed() -> None:
    script = (
        "import sys, pinproof.viewer; "
        "print(sorted({'meshcat', 'trimesh', 'scipy', 'zmq', 'IPython'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_colours_and_fonts_are_stated_only_in_the_theme() -> None:
    root = Path(pinproof.__file__).parent
    sources = [path for suffix in ("py", "js", "css", "html") for path in root.rglob(f"*.{suffix}")]
    stated = re.compile(
        r"""["':\s]#[0-9a-fA-F]{3}(?:[0-9a-fA-F]{3}){0,1}\b(?!\))|0x[0-9a-fA-F]{6}\b|sans-serif|monospace"""
    )
    white = {"0xffffff", "0xFFFFFF"}  # of lights, and of what has its colour from elsewhere
    found = {
        path.relative_to(root).as_posix(): set(stated.findall(path.read_text("utf-8"))) - white for path in sources
    }
    assert {name for name, colours in found.items() if colours} == {"common/theme.py"}
