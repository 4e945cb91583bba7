"""Plots of trajectories: the drawn curves and limits are those of the motion."""

from __future__ import annotations

import pickle
from types import SimpleNamespace

import numpy as np
import pytest

import pinproof as pp

LIMITS = SimpleNamespace(
    velocity=np.array([1.0, 2.0]), acceleration=np.array([3.0, 4.0]), upper=np.array([2.0, np.inf])
)


@pytest.fixture(scope="module")
def trajectory() -> pp.Trajectory:
    return pp.time_parametrise(pp.JointPath([[0.0, 0.0], [1.0, -1.0]], ("a", "b")), LIMITS, jerk=20.0)


def test_each_panel_shows_each_joint_and_its_limits(trajectory: pp.Trajectory) -> None:
    panels = trajectory.plot(LIMITS, jerk=20.0).axes
    assert len(panels) == 4
    velocity = panels[1].lines
    levels = {float(line.get_ydata()[0]) for line in velocity if line.get_linestyle() == "--"}
    assert levels == {-1.0, 1.0, -2.0, 2.0}
    times, drawn = velocity[0].get_data()
    assert np.abs(drawn - trajectory.velocity(times)[:, 0]).max() < 1e-9
    jerk = panels[3].lines[0].get_ydata()
    assert np.abs(jerk).max() == pytest.approx(trajectory.max_jerk()[0])


def test_a_notebook_shows_the_picture(trajectory: pp.Trajectory) -> None:
    from IPython.core.formatters import DisplayFormatter

    shown, _ = DisplayFormatter().format(trajectory.plot(LIMITS))
    assert shown["image/png"].startswith(b"\x89PNG")
    assert pickle.loads(pickle.dumps(trajectory.plot())).axes


def test_a_constraint_adds_a_panel(trajectory: pp.Trajectory) -> None:
    class Sum:
        name = "sum"

        def coefficients(self, q, slope, curvature):
            total = slope.sum(axis=1, keepdims=True)
            return np.zeros_like(total), total, np.zeros_like(total), np.full_like(total, 5.0)

        def excess(self, trajectory):
            return np.ones(len(trajectory.times) - 1)

    panels = trajectory.plot(rate_limits=[Sum()]).axes
    assert len(panels) == 5
    assert panels[4].get_ylabel() == "sum"


def test_limits_of_another_length_are_refused(trajectory: pp.Trajectory) -> None:
    with pytest.raises(pp.InputError, match="velocity"):
        trajectory.plot(SimpleNamespace(velocity=np.ones(3), acceleration=np.ones(2)))
    with pytest.raises(pp.InputError, match="jerk"):
        trajectory.plot(LIMITS, jerk=-1.0)
