"""Programs outside the package, each with a part of its own; they are the examples of docs/extending.md."""

from __future__ import annotations

import ast
import runpy
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinproof as pp

HERE = Path(__file__).parent
PAGE = HERE.parents[1] / "docs" / "extending.md"
PROGRAMS = sorted(HERE.glob("own_*.py"))
LINES = 30


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], dict[str, Any]]:
    """Runs a program in an empty folder, and returns its names."""
    monkeypatch.chdir(tmp_path)
    return lambda name: runpy.run_path(str(HERE / f"{name}.py"))


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda path: path.stem)
def test_the_page_shows_the_program_word_for_word(program: Path) -> None:
    text = program.read_text(encoding="utf-8")
    assert f"```python\n{text}```" in PAGE.read_text(encoding="utf-8")
    assert sum(bool(line.strip()) for line in text.splitlines()) <= LINES


def private_names(source: str) -> Iterator[str]:
    """The names of pinproof in a program that no package exports: the face is ``pp.NAME`` or ``pp.package.NAME``."""
    faces = {"pp": pp.__all__} | {f"pp.{name}": getattr(pp, name).__all__ for name in pp._PACKAGES}
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "pinproof":
            yield f"from {node.module}"
        elif isinstance(node, ast.Import):
            yield from (one.name for one in node.names if one.name.startswith("pinproof") and one.asname != "pp")
            yield from (one.name for one in node.names if one.name.startswith("pinproof."))
        elif isinstance(node, ast.Attribute):
            owner = ast.unparse(node.value)
            inner = owner == "pp" and node.attr in pp._PACKAGES
            if (owner in faces and not inner and node.attr not in faces[owner]) or node.attr.startswith("_"):
                yield f"{owner}.{node.attr}"


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda path: path.stem)
def test_a_program_uses_public_names_only(program: Path) -> None:
    assert list(private_names(program.read_text(encoding="utf-8"))) == []


@pytest.mark.parametrize(
    "line",
    [
        "from pinproof.motion import own_motion",
        "import pinproof.ik",
        "pp.motion.own_motion",
        "pp.nothing",
        "pp.ik.x",
        "arm._q",
    ],
)
def test_a_private_name_is_noticed(line: str) -> None:
    assert list(private_names(f"import pinproof as pp\n{line}"))


@pytest.mark.slow
def test_an_own_motion_is_certified_and_a_spline_as_it_is(run: Callable[[str], dict[str, Any]]) -> None:
    done = run("own_motion")
    assert done["certificate"].free
    assert done["certificate"].clearance > 0.005
    assert any("trusted" in note for note in done["certificate"].notes)
    spline = pp.certify(done["spline"], done["checker"])
    assert spline.free
    assert not any("trusted" in note for note in spline.notes)


@pytest.mark.slow
def test_a_shape_of_its_farthest_points_contains_the_body_and_its_motions_are_proven(
    run: Callable[[str], dict[str, Any]],
) -> None:
    done = run("own_shape")
    cushion, checker, arm = done["cushion"], done["checker"], done["arm"]
    assert checker.scene["cushion"].shape == cushion
    # points of the surface, in random directions of the fourth power
    rng = np.random.default_rng(0)
    points = rng.normal(size=(500, 3))
    points *= done["half"] / (points**4).sum(axis=1, keepdims=True) ** 0.25
    assert (((points / done["half"]) ** 4).sum(axis=1) < 1 + 1e-9).all()
    directions = rng.normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    reach = (directions @ cushion.points.T).max(axis=1) + cushion.radius
    assert ((directions @ points.T).max(axis=1) <= reach).all()
    assert (reach <= [d @ done["farthest"](d) + 0.005 for d in directions]).all()
    # a motion among them, against samples, and its proof
    path = pp.JointPath([arm.home, arm.home + 0.3], arm.joint_names)
    certificate = pp.certify(path, checker, record=True)
    assert certificate.free
    assert certificate.clearance <= min(checker.clearance(path(t)) for t in np.linspace(0, 1, 200))
    certificate.save("proof.json")
    assert pp.verify_proof("proof.json", checker).ok


@pytest.mark.slow
def test_own_objectives_and_an_own_step_rule_give_checked_solutions(run: Callable[[str], dict[str, Any]]) -> None:
    done = run("own_ik")
    arm, target, elbow_aside = done["arm"], done["target"], done["elbow_aside"]
    plain = pp.Clik().solve(arm, target).or_raise()
    own = done["Transpose"](max_iterations=2000, position_tolerance=1e-4, orientation_tolerance=1e-4)
    assert elbow_aside(done["found"].q) < elbow_aside(plain.q) - 0.05
    for result, tolerance in ((done["found"], 1e-6), (own.solve(arm, target).or_raise(), 1e-4)):
        off = target.actInv(arm.forward_kinematics(result.q))
        assert np.linalg.norm(off.translation) <= tolerance
        assert not arm.limits.violations(result.q, arm.joint_names)
    looking = pp.Clik().solve(arm, target, task="position", goal=done["camera"]).or_raise()
    assert done["camera"](looking.q) < 1e-3
