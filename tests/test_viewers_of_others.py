"""The programs of the manual that show a motion in viser and in rerun run where these are installed."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from unittest import mock

import numpy as np
import pytest

from .pages import ROOT

PAGE = ROOT / "docs" / "libraries.md"


def program(name: str) -> str:
    found = re.search(rf"`{name}`:\n\n```py\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert found is not None
    return found[1]


def run(name: str) -> dict[str, object]:
    names: dict[str, object] = {"__name__": name.removesuffix(".py")}
    exec(compile(program(name), name, "exec"), names)
    return names


@pytest.mark.filterwarnings("ignore")  # those of the viewers and their servers
def test_a_motion_is_shown_in_viser(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("viser", reason="viser is not installed: pip install viser")
    monkeypatch.setattr("time.sleep", lambda _: None)
    names = run("show_in_viser.py")
    try:
        arm, motion, handles, links = (names[each] for each in ("arm", "motion", "handles", "links"))
        assert len(handles) == len(links) == 7
        last = np.arange(0.0, motion.duration, 0.02)[-1]
        pose = arm.root_from_frame(motion.trajectory(last), links[-1].link)
        np.testing.assert_allclose(handles[-1].position, pose.act(links[-1].origin[:3, 3]), atol=1e-6)
    finally:
        names["server"].stop()


@pytest.mark.filterwarnings("ignore")
def test_a_motion_is_recorded_for_rerun(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    rerun = pytest.importorskip("rerun", reason="rerun is not installed: pip install rerun-sdk")
    monkeypatch.chdir(tmp_path)
    names = run("show_in_rerun.py")
    rerun.disconnect()
    assert (tmp_path / "motion.rrd").stat().st_size > 100_000
    assert len(names["links"]) == 7


@pytest.mark.parametrize("name", ["show_in_viser.py", "show_in_rerun.py"])
def test_the_programs_name_what_pinproof_has(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the viewers: every call but those of the viewer is made."""
    library = {"show_in_viser.py": "viser", "show_in_rerun.py": "rerun"}[name]
    monkeypatch.setitem(sys.modules, library, mock.MagicMock())
    monkeypatch.setattr("time.sleep", lambda _: None)
    names = run(name)
    assert names["motion"].ok
    assert len(names["links"]) == 7
