"""An answer is correct only inside the limits and within the tolerance, by Pinocchio's forward kinematics."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.ik_run import check_answers, random_targets, with_reduced_ranges

import pinproof as pp


@pytest.fixture(scope="module")
def arm() -> pp.Arm:
    return with_reduced_ranges(pp.load_robot("ur5").arm())


def checked(arm: pp.Arm, answers: np.ndarray, task: str = "pose", tolerance: float = 1e-6):
    return check_answers(arm, random_targets(arm, len(answers), 0).poses, answers, task, tolerance)


def true_answers(arm: pp.Arm, count: int = 4) -> np.ndarray:
    return random_targets(arm, count, 0).q[:, None].copy()


def test_the_configuration_that_generated_a_target_is_correct(arm: pp.Arm) -> None:
    found = checked(arm, true_answers(arm))
    assert found.success == 1.0
    assert found.false_positives == 0
    assert found.errors[:, 0].max() < 1e-12


def test_an_answer_one_full_rotation_outside_the_limits_is_a_false_positive(arm: pp.Arm) -> None:
    answers = true_answers(arm)
    answers[0, 0, 5] += 2 * np.pi
    found = checked(arm, answers)
    assert found.correct.tolist() == [False, True, True, True]
    assert found.false_positives == 1


def test_the_error_of_an_answer_is_measured(arm: pp.Arm) -> None:
    answers = true_answers(arm)
    answers[:, 0, 5] += 2e-6  # the last joint rotates the TCP by the same angle
    answers = np.clip(answers, arm.limits.lower, arm.limits.upper)
    found = checked(arm, answers)
    np.testing.assert_allclose(found.errors[:, 1], 2e-6, rtol=1e-3)
    assert found.success == 0.0
    assert checked(arm, answers, tolerance=1e-5).success == 1.0


def test_the_position_task_ignores_the_rotation_only(arm: pp.Arm) -> None:
    answers = true_answers(arm)
    answers[:, 0, 5] *= 0.5
    found = checked(arm, answers, "position")
    assert found.correct.tolist() == (found.errors[:, 0] <= 1e-6).tolist()
    assert found.errors[:, 1].max() == 0.0


def test_no_answer_is_a_failure_and_not_a_false_positive(arm: pp.Arm) -> None:
    answers = true_answers(arm)
    answers[1] = np.nan
    found = checked(arm, answers)
    assert found.answered.tolist() == [True, False, True, True]
    assert (found.success, found.false_positives) == (0.75, 0)


def test_an_answer_with_some_nan_is_wrong(arm: pp.Arm) -> None:
    answers = true_answers(arm)
    answers[2, 0, 3] = np.nan
    found = checked(arm, answers)
    assert found.false_positives == 1
    assert np.isinf(found.errors[2, 0])


def test_all_branches_must_be_correct(arm: pp.Arm) -> None:
    good = true_answers(arm)
    bad, none = good + 0.1, np.full_like(good, np.nan)
    assert checked(arm, np.concatenate([good, none], axis=1)).success == 1.0
    assert checked(arm, np.concatenate([good, bad], axis=1)).false_positives == 4
