"""The judge believes nobody: a claim is right only inside the limits and within the tolerance, by Pinocchio."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp
from pinproof.benchmarks.ik_judge import judge_answers
from pinproof.benchmarks.ik_problems import narrowed, random_targets


@pytest.fixture(scope="module")
def arm() -> pp.Arm:
    return narrowed(pp.load_robot("ur5").arm())


def judged(arm: pp.Arm, answers: np.ndarray, task: str = "pose", tolerance: float = 1e-6):
    return judge_answers(arm, random_targets(arm, len(answers), 0).poses, answers, task, tolerance)


def true_answers(arm: pp.Arm, count: int = 4) -> np.ndarray:
    return random_targets(arm, count, 0).q[:, None].copy()


def test_the_configuration_that_made_a_target_is_right(arm: pp.Arm) -> None:
    found = judged(arm, true_answers(arm))
    assert found.success == 1.0
    assert found.false_yes == 0
    assert found.position_error.max() < 1e-12


def test_a_whole_turn_outside_the_limits_is_a_false_yes(arm: pp.Arm) -> None:
    answers = true_answers(arm)
    answers[0, 0, 5] += 2 * np.pi
    found = judged(arm, answers)
    assert found.right.tolist() == [False, True, True, True]
    assert found.false_yes == 1


def test_an_answer_is_measured_and_not_believed(arm: pp.Arm) -> None:
    answers = true_answers(arm)
    answers[:, 0, 5] += 2e-6  # the last joint turns the tcp by as much
    answers = np.clip(answers, arm.limits.lower, arm.limits.upper)
    found = judged(arm, answers)
    np.testing.assert_allclose(found.rotation_error, 2e-6, rtol=1e-3)
    assert found.success == 0.0
    assert judged(arm, answers, tolerance=1e-5).success == 1.0


def test_position_only_forgives_the_rotation_and_nothing_else(arm: pp.Arm) -> None:
    answers = true_answers(arm)
    answers[:, 0, 5] *= 0.5
    found = judged(arm, answers, "position")
    assert found.right.tolist() == (found.position_error <= 1e-6).tolist()
    assert found.rotation_error.max() == 0.0


def test_no_claim_is_a_miss_and_no_false_yes(arm: pp.Arm) -> None:
    answers = true_answers(arm)
    answers[1] = np.nan
    found = judged(arm, answers)
    assert found.answered.tolist() == [True, False, True, True]
    assert (found.success, found.false_yes) == (0.75, 0)


def test_half_a_nan_is_a_claim_and_wrong(arm: pp.Arm) -> None:
    answers = true_answers(arm)
    answers[2, 0, 3] = np.nan
    found = judged(arm, answers)
    assert found.false_yes == 1
    assert np.isinf(found.position_error[2])


def test_of_several_branches_each_has_to_be_right(arm: pp.Arm) -> None:
    good = true_answers(arm)
    bad, none = good + 0.1, np.full_like(good, np.nan)
    assert judged(arm, np.concatenate([good, none], axis=1)).success == 1.0
    assert judged(arm, np.concatenate([good, bad], axis=1)).false_yes == 4
