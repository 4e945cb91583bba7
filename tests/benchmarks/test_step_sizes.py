"""Near a singularity the steps of the plain inverse grow without bound, and damped steps do not."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.ik_steps import METHODS, step_sizes

import pinproof as pp


@pytest.fixture(scope="module")
def steps():
    return step_sizes(pp.load_robot("ur5").arm())


def test_the_wrist_of_the_ur5_moves_into_the_singularity(steps) -> None:
    assert steps.joint == "wrist_2_joint"
    assert (np.diff(steps.smallest) <= 0).all()
    assert steps.smallest[0] > 0.1
    assert steps.smallest[-1] < 1e-8
    assert set(steps.steps) == set(METHODS)


def test_the_plain_inverse_grows_as_the_singular_value_falls(steps) -> None:
    near = (steps.smallest < 1e-3) & (steps.smallest > 1e-7)
    product = (steps.steps["inverse"] * steps.smallest)[near]
    np.testing.assert_allclose(product, product[0], rtol=0.05)
    assert np.nanmax(steps.steps["inverse"]) > 1e4


def test_far_from_the_singularity_the_undamped_methods_agree(steps) -> None:
    assert steps.steps["pseudo-inverse"][0] == pytest.approx(steps.steps["inverse"][0], rel=1e-9)


@pytest.mark.parametrize("name", ["damped least squares", "CLIK"])
def test_damped_steps_stay_bounded(steps, name: str) -> None:
    assert steps.steps[name].max() <= np.sqrt(6) * pp.Clik().max_step
    assert steps.steps[name][-1] < 0.1


def test_an_arm_with_seven_joints_has_no_step_sizes() -> None:
    assert step_sizes(pp.load_robot("panda").arm()) is None
