"""The command line in this process, in an empty folder."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinproof as pp
from pinproof.description import robots_folder

from ..pages import run_main

HOME = np.array([0.0, -1.57, 1.57, -1.57, -1.57, 0.0])
MOVED = HOME + np.array([0.3, 0.1, 0.0, 0.0, 0.0, 0.2])
"""Configurations of a UR5."""


@dataclass(frozen=True)
class Cli:
    """Runs command lines that begin with ``first``: exit code, stdout, stderr."""

    first: tuple[str, ...] = ()

    def __call__(self, *words: str) -> tuple[int, str, str]:
        return run_main(*self.first, *words)

    def prints(self, *words: str, code: int = 0) -> str:
        """The stdout of a command that ends with this exit code."""
        ended, out, err = self(*words)
        assert ended == code, out + err
        return out

    def json(self, *words: str, code: int = 0) -> Any:
        """The document that a command prints with ``--json``."""
        return json.loads(self.prints(*words, "--json", code=code))

    def refuses(self, *words: str, named: tuple[str, ...] | str = ()) -> str:
        """Wrong usage: exit code 2, nothing on stdout, and one line on stderr with all that is named."""
        code, out, err = self(*words)
        assert (code, out, err.count("\n")) == (2, "", 1), out + err
        assert err.startswith("pinproof: ")
        for each in (named,) if isinstance(named, str) else named:
            assert each in err
        return err


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Cli:
    """Run command lines in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return Cli()


def picks_of_generic(folder: Path, count: int = 1, *more: str, name: str = "picks.yaml", **shared: str) -> str:
    """The path of a picks file of the generic arm with so many good picks, followed by further rows."""
    scene = robots_folder() / "generic_6dof" / "scene.yaml"
    stated = {"robot": "generic_6dof", "scene": str(scene), "margin": "0.002", "tip": "{xyz: [0, 0, 0.005]}", **shared}
    stated["defaults"] = "{rpy: [pi, 0, 0], approach: 0.02, retreat: 0.02}"
    good = [f"{{name: pin_{k}, xyz: [{0.4 - 0.0005 * k}, -0.15, 0.035]}}" for k in range(count)]
    rows = "".join(f"  - {row}\n" for row in [*good, *more])
    (folder / name).write_text("".join(f"{key}: {value}\n" for key, value in stated.items()) + f"picks:\n{rows}")
    return str(folder / name)


def text_of(q: np.ndarray) -> str:
    return " ".join(map(repr, q.tolist()))


def save_motion(path: Path) -> None:
    """A motion of the UR5 from HOME to MOVED."""
    arm = pp.load_robot("ur5").arm()
    pp.time_parametrise(pp.JointPath([HOME, MOVED], arm.joint_names), arm.limits).save(path)


def save_scene(path: Path, name: str, shape: pp.Shape, xyz: object, **settings: Any) -> None:
    """A scene of one obstacle."""
    pp.Scene([pp.Obstacle(name, shape, pp.pose(xyz))], **settings).save(path)


JAWS = """\
fingers:
  opening: 0.07
  grip: 0.0
  bodies: [{name: left, box: [0.016, 0.008, 0.05], xyz: [0, 0.004, -0.025]},
           {name: right, box: [0.016, 0.008, 0.05], xyz: [0, -0.004, -0.025]}]
"""
"""A tool file with two fingers."""
