"""Joint limits: refused where they make no sense, and never writable."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp

ONE = np.ones(2)


def test_acceleration_default_says_so():
    limits = pp.JointLimits(-ONE, ONE, 2 * ONE)
    assert limits.acceleration.tolist() == [4.0, 4.0]
    assert "0.5 s" in limits.acceleration_source
    assert "caller" in pp.JointLimits(-ONE, ONE, ONE, ONE).acceleration_source


@pytest.mark.parametrize(
    "arguments",
    [
        (ONE, -ONE, ONE),
        (-ONE, np.array([1, np.nan]), ONE),
        (-ONE, ONE, np.array([1.0, 0.0])),
        (-ONE, ONE, -ONE),
        (-ONE, ONE, ONE, 0 * ONE),
        (-ONE, np.ones(3), ONE),
    ],
)
def test_limits_without_sense_are_refused(arguments):
    with pytest.raises(pp.InputError, match="limits"):
        pp.JointLimits(*arguments)


def test_arrays_are_copies_that_nobody_can_write():
    lower = -ONE
    limits = pp.JointLimits(lower, ONE, ONE)
    lower[0] = -9
    assert limits.lower[0] == -1
    with pytest.raises(ValueError, match="read-only"):
        limits.lower[0] = 0


def test_violations_name_joint_and_range():
    limits = pp.JointLimits(-ONE, ONE, ONE)
    (sentence,) = limits.violations(np.array([0.0, 1.5]), ["a", "b"])
    assert sentence == "b = 1.5 is outside [-1, 1]"
    assert not limits.contains(np.array([0.0, 1.5]))
    assert limits.contains(np.array([0.0, 1.0]))
    assert not limits.contains(np.array([0.0, np.nan]))


def test_sampling_range_of_open_limits_is_one_turn():
    infinite = np.array([np.inf, np.inf, 1.0])
    lower, upper = pp.JointLimits(np.array([-np.inf, 0.5, -np.inf]), infinite, np.ones(3)).sampling_range()
    assert lower == pytest.approx([-np.pi, 0.5, 1 - 2 * np.pi])
    assert upper == pytest.approx([np.pi, 0.5 + 2 * np.pi, 1.0])


def test_a_violation_is_printed_with_digits_that_show_it():
    limits = pp.JointLimits(-np.pi * ONE, np.pi * ONE, ONE)
    (sentence,) = limits.violations(np.array([0.0, -np.pi - 1e-8]), ["a", "b"])
    said, lowest = float(sentence.split()[2]), float(sentence.split("[")[1].split(",")[0])
    assert said < lowest
    for off in 10.0 ** np.arange(-15, 1):
        (sentence,) = limits.violations(np.array([0.0, np.pi + off]), ["a", "b"])
        assert float(sentence.split()[2]) > float(sentence.split()[-1].rstrip("]"))


def test_values_within_rounding_of_a_limit_become_the_limit():
    limits = pp.JointLimits(-ONE, ONE, ONE)
    snapped = limits.snap(np.array([[1 + 1e-10, -1 - 9e-10], [1 + 2e-9, 0.5], [1 - 1e-12, np.nan]]))
    assert snapped[0].tolist() == [1.0, -1.0]
    assert snapped[1].tolist() == [1 + 2e-9, 0.5]
    assert snapped[2, 0] == 1 - 1e-12
    assert np.isnan(snapped[2, 1])
    endless = pp.JointLimits(np.full(2, -np.inf), np.full(2, np.inf), ONE)
    assert endless.snap(np.array([1e3, -1e3])).tolist() == [1e3, -1e3]


def test_inside_counts_values_beyond_a_limit_by_rounding_as_the_limit():
    limits = pp.JointLimits(-ONE, ONE, ONE)
    many = np.array([[1.0, -1.0], [1.0 + 9e-10, -1.0 - 9e-10], [1.0 + 2e-9, 0.0], [0.0, np.nan]])
    assert limits.inside(many).tolist() == [True, True, False, False]
    assert limits.inside(many[:, None]).shape == (4, 1)
