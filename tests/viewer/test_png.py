"""PNG pictures, and the errors if no browser can render them."""

from __future__ import annotations

import stat
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pinproof.errors import InputError, UnknownNameError, ViewerError
from pinproof.viewer import png, write_png

from ..processes import is_alive, wait_for
from .browser import find_browser
from .conftest import small_arm, swing


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Make a shell script the browser."""

    def make(body: str) -> Path:
        script = tmp_path / "browser"
        script.write_text(f"#!/bin/sh\n{body}\n")
        script.chmod(script.stat().st_mode | stat.S_IXUSR)
        monkeypatch.setenv("PINPROOF_BROWSER", str(script))
        return script

    return make


@pytest.mark.slow
def test_a_still_picture_of_a_motion_has_its_size_its_moment_and_its_caption(tmp_path, monkeypatch) -> None:
    executable = find_browser()
    if executable is None:
        pytest.skip("no Chromium")
    monkeypatch.setenv("PINPROOF_BROWSER", executable)
    arm = small_arm()
    pictures = []
    for name, seconds in (("start", None), ("end", 2.0)):
        write_png(tmp_path / f"{name}.png", arm, None, swing(arm), time=seconds, size=(480, 360))
        pictures.append(np.asarray(Image.open(tmp_path / f"{name}.png").convert("RGB")).astype(int))
    assert [picture.shape for picture in pictures] == [(360, 480, 3)] * 2
    assert pictures[0][:300].std() > 10
    assert (np.abs(pictures[0] - pictures[1]).max(axis=2) > 30).mean() > 0.01  # another moment
    strip = pictures[0][-25:]
    assert (strip.min(axis=2) > 250).mean() > 0.6  # words on white
    assert (strip.max(axis=2) < 140).any()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["end.png", "start.png"]


def test_without_a_browser_the_error_names_the_remedy(tmp_path, monkeypatch) -> None:
    monkeypatch.delenv("PINPROOF_BROWSER", raising=False)
    monkeypatch.setattr(png, "BROWSERS", ("no-such-browser",))
    monkeypatch.setattr(png, "APPLICATIONS", ())
    with pytest.raises(ViewerError, match=r"no-such-browser.*PINPROOF_BROWSER"):
        write_png(tmp_path / "a.png", small_arm())
    assert list(tmp_path.iterdir()) == []


def test_a_missing_browser_is_named(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("PINPROOF_BROWSER", "gone-browser")
    with pytest.raises(ViewerError, match="PINPROOF_BROWSER names gone-browser"):
        write_png(tmp_path / "a.png", small_arm())


@pytest.mark.parametrize("body", ["exit 1", "echo ERROR: no display >&2; exit 1", "echo pinproof: drawn >&2"])
def test_a_browser_without_a_result_leaves_no_file(tmp_path, program, body: str) -> None:
    program(body)
    with pytest.raises(ViewerError, match="did not produce a picture"):
        write_png(tmp_path / "a.png", small_arm())
    assert not (tmp_path / "a.png").exists()


def test_a_browser_that_hangs_is_killed_with_its_child_processes(tmp_path, program, monkeypatch) -> None:
    program(f"sleep 100000 & echo $! > {tmp_path}/starting; mv {tmp_path}/starting {tmp_path}/child; wait")
    timeout = 0.5
    while not (tmp_path / "child").exists():  # on a busy machine it is ended before it has started a child
        monkeypatch.setattr(png, "TIMEOUT", timeout)
        with pytest.raises(ViewerError, match=r"did not produce a picture within \d+ s"):
            write_png(tmp_path / "a.png", small_arm())
        timeout *= 2
    child = int((tmp_path / "child").read_text())
    wait_for(lambda: not is_alive(child))


def test_invalid_settings_are_refused_before_a_browser_starts(tmp_path) -> None:
    arm, path = small_arm(), tmp_path / "a.png"
    for settings, expected in (
        ({"time": 1.0}, "trajectory"),
        ({"trajectory": swing(arm), "time": 2.5}, "2.5 s"),
        ({"size": (10, 10)}, "64 to 4096"),
        ({"trajectory": swing(arm), "q": [0, 0]}, "trajectory and q"),
    ):
        with pytest.raises(InputError, match=expected):
            write_png(path, arm, **settings)
    with pytest.raises(UnknownNameError, match="collision"):
        write_png(path, arm, layers=["collisions"])
