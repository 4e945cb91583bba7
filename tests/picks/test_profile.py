"""The profile of a picks file: the stages and the bodies that take the time."""

from __future__ import annotations

import json
import logging
from dataclasses import replace

import numpy as np
import pytest

import pinproof as pp
from pinproof.common.steps import LOG, step
from pinproof.description import robots_folder
from pinproof.picks import Stage, WorkProfile, profile_picks
from pinproof.picks.report import profile
from pinproof.picks.report.profile import _Watch

from ..pages import run_main
from .conftest import QUICK, cell_of


@pytest.fixture(scope="module")
def profiled() -> WorkProfile:
    """A good and a failed pick of the UR5 beside a solid of triangles, which convex pieces do not fit."""
    arm, scene, picks = cell_of("ur5", "picks.yaml", "bolt_1", "bolt_6")
    angles = np.linspace(0, 2 * np.pi, 100, endpoint=False)
    rings = [np.column_stack([r * np.cos(angles), r * np.sin(angles)]) for r in (0.1, 0.08)]
    vertices = np.vstack([np.column_stack([ring, np.full(100, z)]) for ring in rings for z in (0.0, 0.05)])
    around = np.arange(100)
    after = np.roll(around, -1)
    quads = [(0, 100), (300, 200), (100, 300), (200, 0)]  # outside, inside, top, bottom
    triangles = [np.column_stack([a + around, a + after, b + after]) for a, b in quads]
    triangles += [np.column_stack([a + around, b + after, b + around]) for a, b in quads]
    ring = pp.Mesh.from_arrays(vertices, np.vstack(triangles), hull=False)
    scene = scene.add(pp.Obstacle("ring", ring, pp.pose(xyz=(1.5, 0, 0))))
    return profile_picks(lambda: pp.validate_picks(arm, scene, picks, budget=QUICK))


def test_the_report_is_that_of_the_picks(profiled: WorkProfile) -> None:
    setup = profiled.report.setup
    assert setup is not None
    arm, _, picks = cell_of("ur5", "picks.yaml", "bolt_1", "bolt_6")
    again = pp.validate_picks(arm, setup.checker.scene, picks, budget=QUICK)
    assert profiled.report.to_dict() == again.to_dict()
    assert LOG.level == logging.NOTSET
    assert not LOG.handlers


def test_each_stage_has_its_time(profiled: WorkProfile) -> None:
    names = [each.stage for each in profiled.stages]
    assert len(set(names)) == len(names)
    assert {Stage.REACH.value, Stage.GRASP.value, Stage.TRANSIT.value, Stage.TIMING.value, "other"} <= {*names}
    seconds = [each.seconds for each in profiled.stages]
    assert seconds == sorted(seconds, reverse=True)
    assert profiled.seconds == pytest.approx(sum(seconds))
    reach = next(each for each in profiled.stages if each.stage == Stage.REACH.value)
    assert reach.calls >= len(profiled.report.verdicts)


def test_every_obstacle_is_measured_with_those_of_its_shape(profiled: WorkProfile) -> None:
    setup = profiled.report.setup
    assert setup is not None
    by_name = {each.name: each for each in profiled.bodies}
    assert by_name["ring"].geometry == "800 exact triangles"
    assert by_name["robot"].geometry.endswith("convex bodies")
    shapes = {thing.shape for thing in setup.checker.scene.obstacles}
    assert len(profiled.bodies) == len(shapes) + 1
    assert sum(each.share for each in profiled.bodies) == pytest.approx(1.0)
    assert all(each.seconds >= 0 for each in profiled.bodies)


def test_advice_is_for_slow_bodies_that_no_pick_is_in(monkeypatch, profiled: WorkProfile) -> None:
    """Rings of triangles, of which one is around the grasp of a pick; then all bodies cost the same."""
    report = profiled.report
    setup = report.setup
    assert setup is not None
    ring = setup.checker.scene["ring"]
    tip = report.good[0].pick.pose.translation
    others = [pp.Obstacle(f"box_{k}", pp.Box(0.1, 0.1, 0.1 + k / 100), pp.pose((3, 0, k))) for k in range(5)]

    def advice(seconds: float, at: np.ndarray) -> str:
        scene = pp.Scene([replace(ring, pose=pp.pose(at)), *others])
        own = {"ring": seconds, **{other.name: 0.2 for other in others}}
        monkeypatch.setattr(profile, "_seconds", lambda checker, _: sum(own[name] for name in checker.scene))
        made = replace(report, setup=replace(setup, checker=setup.checker.with_scene(scene)))
        return next(body.advice for body in profile_picks(lambda: made).bodies if body.name == "ring")

    far, around = np.array([1.5, 0, 0]), tip - [0, 0, 0.025]
    assert "hull: true" in advice(0.8, far)
    assert advice(0.8, around) == ""
    assert advice(0.2, far) == ""


def test_steps_in_a_step_count_once() -> None:
    watch = _Watch()
    with_steps = LOG.level
    LOG.addHandler(watch)
    LOG.setLevel(logging.DEBUG)
    try:
        with step("grasp"):
            with step("grip"):
                pass
            with step("grip"):
                pass
        with step("suggestions"), step("reach"), step("grip"):
            pass
    finally:
        LOG.removeHandler(watch)
        LOG.setLevel(with_steps)
    assert {name: calls for name, (_, calls) in watch.times.items()} == {"grip": 2, "grasp": 1, "suggestions": 3}


def test_the_command_prints_both_tables() -> None:
    file = str(robots_folder() / "generic_6dof" / "picks.yaml")
    code, out, _ = run_main("pick", file, "--profile", "--json")
    found = json.loads(out)
    assert code in (0, 1)
    assert found["profile"]["schema"] == "pinproof/profile/1"
    assert {each["stage"] for each in found["profile"]["stages"]} >= {"reach", "other"}
    assert "robot" in {each["name"] for each in found["profile"]["bodies"]}


def test_workers_are_not_measured() -> None:
    file = str(robots_folder() / "generic_6dof" / "picks.yaml")
    code, _, err = run_main("pick", file, "--profile", "--workers", "2")
    assert code == 2
    assert "--profile" in err
