"""Results that are a solution, or the reason why there is none."""

from __future__ import annotations

import copy
import pickle
from dataclasses import dataclass

import pytest

from pinproof.common.answer import Answer, Solution
from pinproof.errors import NoAnswer, PlanFailed


@dataclass(frozen=True, eq=False)
class _Root(Answer):
    failure = PlanFailed
    ok: bool
    value: Solution[float] = Solution()
    bound: Solution[float] = Solution()
    message: str = ""


def test_a_solution_is_read_and_returned() -> None:
    root = _Root(True, 2.0, message="found")
    for made in (root, pickle.loads(pickle.dumps(root)), copy.copy(root)):
        assert made.or_raise() is made
        assert (made.value, made.message) == (2.0, "found")
    with pytest.raises(PlanFailed, match="no bound"):
        root.bound  # noqa: B018
    with pytest.raises(AttributeError):
        root.value = 3.0  # type: ignore[misc]


def test_a_failure_raises_its_message_where_a_solution_is_read() -> None:
    failed = _Root(False, message="no root")
    for answer in (failed.or_raise, lambda: failed.value, lambda: failed.bound):
        with pytest.raises(NoAnswer, match="no root") as caught:
            answer()
        assert type(caught.value) is PlanFailed
        assert caught.value.result is failed


def test_a_changed_answer_keeps_all_other_values() -> None:
    failed = _Root(False, message="no root")
    changed = failed.changed(message="stopped", bound=1.0)
    assert (changed.ok, changed.bound, changed.message, failed.message) == (False, 1.0, "stopped", "no root")
    with pytest.raises(PlanFailed, match="stopped"):
        changed.value  # noqa: B018
