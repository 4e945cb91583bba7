"""Arms and cells for picks, their reports, and an independent check of good verdicts."""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import pinproof as pp
from pinproof.description import robots_folder
from pinproof.model import load_robot

ROBOTS = ("ur5", "generic_6dof", "panda")
DOWN = (np.pi, 0, 0)
QUICK = pp.picks.PickBudget(compared=1, remedies=0)


def judge_in(
    arm: pp.Arm, scene: pp.Scene, pick: pp.Pick, *, home=None, budget: pp.picks.PickBudget = QUICK, **shared
) -> pp.picks.PickVerdict:
    """The verdict on a pick in a scene, with these settings of the picks."""
    (verdict,) = pp.validate_picks(arm, scene, pp.Picks((pick,), **shared), home=home, budget=budget).verdicts
    return verdict


def cell_of(robot: str, file: str, *names: str) -> tuple[pp.Arm, pp.Scene, pp.Picks]:
    """A cell of the package, all its picks or those of these names."""
    picks = pp.read_picks(robots_folder() / robot / file)
    chosen = tuple(pick for pick in picks if not names or pick.name in names)
    return picks.load_arm(), pp.Scene.load(picks.scene), replace(picks, picks=chosen)


def named(items, name: str):
    """The pick of a name, or the verdict on it."""
    return next(each for each in items if getattr(each, "pick", each).name == name)


def figures(verdict: pp.picks.PickVerdict, stage: pp.picks.Stage) -> dict[str, float]:
    """The figures of a stage."""
    return next(each.figures for each in verdict.stages if each.stage is stage)


@pytest.fixture(scope="session")
def arms() -> dict[str, pp.Arm]:
    return {name: pp.load_robot(name).arm() for name in ROBOTS}


@pytest.fixture(scope="session")
def cells() -> dict[str, tuple[pp.Scene, pp.Picks]]:
    """The cells that come with the package."""
    return {name: cell_of(name, "picks.yaml")[1:] for name in ROBOTS}


@pytest.fixture(scope="session")
def reports(arms, cells) -> dict[str, pp.picks.PickReport]:
    return {name: pp.validate_picks(arms[name], *cells[name]) for name in ROBOTS}


def recheck(verdict: pp.picks.PickVerdict, arm: pp.Arm, scene: pp.Scene, picks: pp.Picks, home=None) -> None:
    """Check the claims of a good verdict independently: FK, limits, a new checker, dense samples."""
    pick, motion, time = verdict.pick, verdict.trajectory, verdict.grasp_time
    home = arm.home if home is None else home
    assert verdict.failed is None
    assert all(stage.ok for stage in verdict.stages)
    assert motion.joint_names == arm.joint_names
    np.testing.assert_array_equal(motion.start, home)

    def root_from_tip(q):
        return arm.root_from_base * arm.forward_kinematics(q) * picks.tip

    def off(q, pose) -> tuple[float, float]:
        gap = pose.actInv(root_from_tip(q))
        return float(np.linalg.norm(gap.translation)), float(np.linalg.norm(gap.rotation - np.eye(3)))

    assert max(off(motion(time), pick.pose)) < 2e-6
    assert off(motion(time), pick.pose)[0] < 1e-6
    np.testing.assert_allclose(motion(time), verdict.q_grasp, atol=1e-9)
    np.testing.assert_allclose(motion.velocity(time), 0.0, atol=1e-9)
    assert max(off(motion.end, pick.after(pick.pose))) < 2e-5
    # The tip goes straight, and does not turn, on the stated share of the approach and from the grasp to the end.
    before = np.linspace(0.0, time, 2000)
    away = np.array([off(motion(each), pick.pose)[0] for each in before])
    share = 1.0 if "approach" in pick.speed else picks.straight
    begin = time if pick.approach == 0 else before[np.flatnonzero(away >= share * pick.approach - 2e-5)[-1]]
    for first, last, target in ((begin, time, pick.before(pick.pose)), (time, motion.duration, pick.after(pick.pose))):
        direction = target.translation - pick.pose.translation
        for q in motion(np.linspace(first, last, 100)):
            at = root_from_tip(q)
            gone = at.translation - pick.pose.translation
            share = np.clip(gone @ direction / max(direction @ direction, 1e-12), 0, 1)
            assert np.linalg.norm(gone - share * direction) < 1.01e-3
            assert np.linalg.norm(at.rotation - pick.pose.rotation) < 5e-3

    low, high = motion.range()
    assert (low >= arm.limits.lower - 1e-9).all()
    assert (high <= arm.limits.upper + 1e-9).all()
    assert (motion.max_velocity() <= arm.limits.velocity * (1 + 1e-6)).all()
    assert (motion.max_acceleration() <= arm.limits.acceleration * (1 + 1e-6)).all()

    certificate = verdict.certificate
    assert certificate.status is pp.CertificateStatus.FREE
    assert certificate.matches(motion, arm, scene, picks.tool)
    assert certificate.margin == picks.margin < certificate.clearance <= certificate.observed
    checker = pp.CollisionChecker(arm, scene, margin=picks.margin, attached=picks.tool)
    seen = min(checker.clearance(q) for q in motion(np.linspace(0.0, motion.duration, 400)))
    assert seen >= certificate.clearance - 1e-6


STICK = """<robot name="stick"><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/>
<child link="b"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""


@pytest.fixture(scope="session")
def stick_urdf() -> str:
    return STICK


@pytest.fixture(scope="session")
def stick() -> pp.Arm:
    """A minimal arm, for campaigns whose judge does not use it."""
    return load_robot(STICK).arm(tcp="b")


@pytest.fixture(scope="session")
def many() -> pp.picks.PickGrid:
    """120 picks."""
    return pp.picks.PickGrid(pp.Pick("p", pp.pose(xyz=(0.1, 0.2, 0.3))), (4, 5, 6), (0.01, 0.02, 0.03))


@pytest.fixture(scope="module")
def judges() -> Iterator[ModuleType]:
    """The module of judges, importable by name here and in every process that is started from here."""
    here = str(Path(__file__).parent)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(here)
        patch.setenv("PYTHONPATH", os.pathsep.join([here, *filter(None, [os.environ.get("PYTHONPATH")])]))
        yield importlib.import_module("campaign_judges")


@pytest.fixture
def flag(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """The file by which processes know what another has done."""
    monkeypatch.setenv("CAMPAIGN_TEST_FLAG", str(tmp_path / "flag"))
    return tmp_path / "flag"
