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


@pytest.mark.slow
def test_an_own_planner_plans_motions_and_picks(run: Callable[[str], dict[str, Any]]) -> None:
    pytest.importorskip("ompl", reason="OMPL is not installed: pip install ompl")
    planner = run("own_planner")["Ompl"]()
    arm = pp.load_robot("ur5").arm(tcp="tool0")
    table = pp.Obstacle("table", pp.Box(1.2, 1.6, 0.04), pp.pose((0.4, 0, -0.025)))
    post = pp.Obstacle("post", pp.Cylinder(radius=0.04, length=0.5), pp.pose((0.45, 0, 0.245)))
    scene = pp.Scene([table, post], allowed=[("base_link", "table")])
    checker = pp.CollisionChecker(arm, scene, margin=0.01)
    poses = [pp.pose((0.45, y, 0.2), (np.pi, 0, 0)) for y in (0.35, -0.35)]
    start = pp.Clik().solve(arm, poses[0], accept=checker.is_free).or_raise().q
    assert pp.plan(checker, start, poses[1], planner=planner).or_raise().certificate.free
    budget = pp.picks.PickBudget(planner=planner, compared=1, remedies=0)
    report = pp.validate_picks(arm, scene, [pp.Pick("side", poses[1], retreat=0.05)], home=start, budget=budget)
    assert report.ok
    assert all(motion.certificate.free for motion in report.verdicts[0].motions)


@pytest.mark.slow
def test_an_own_check_an_own_column_and_any_executor_judge_picks(
    run: Callable[[str], dict[str, Any]], capsys: pytest.CaptureFixture[str]
) -> None:
    done = run("own_check")
    assert "reach 0.6 m" in capsys.readouterr().out
    assert done["report"].ok
    assert any(stage.stage is pp.picks.Stage.CHECK for stage in done["report"].verdicts[0].stages)
    # a camera above the arm sees nothing of the tip
    settings: dict[str, Any] = {"checks": [done["visible_from_camera"]], "budget": pp.picks.PickBudget(remedies=0)}
    done["visible_from_camera"].__globals__["camera"] = np.array([0.35, 0.2, 2.0])
    (verdict,) = pp.validate_picks(done["arm"], done["scene"], done["picks"][:1], **settings).verdicts
    assert verdict.failed is pp.picks.Stage.CHECK
    assert "hides the tip" in verdict.reason
