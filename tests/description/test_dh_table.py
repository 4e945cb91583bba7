"""DH rows and tables: the product, what is refused, and that values stay what they were."""

from __future__ import annotations

import copy
import math
import pickle
from dataclasses import FrozenInstanceError, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pinproof.description.dh import DhRow, DhTable
from pinproof.errors import InputError, UnknownNameError
from pinproof.spatial import pose

GENERIC = DhTable(
    [
        DhRow("joint_1", 0, 0.33, 0, math.pi / 2),
        DhRow("joint_2", 0, 0, 0.30, 0),
        DhRow("joint_3", 0, 0, 0.35, 0),
        DhRow("joint_4", 0, 0.20, 0, -math.pi / 2),
        DhRow("joint_5", 0, 0, 0, math.pi / 2),
        DhRow("joint_6", 0, 0.10, 0, 0),
    ],
    convention="standard",
)

numbers = st.floats(-2, 2)


def elementary(axis: int, angle: float = 0.0, shift: float = 0.0) -> np.ndarray:
    """A turn about and a move along one axis, written without the closed form under test."""
    generator = np.zeros((3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    generator[j, i], generator[i, j] = 1.0, -1.0
    out = np.eye(4)
    out[:3, :3] += math.sin(angle) * generator + (1 - math.cos(angle)) * generator @ generator  # Rodrigues
    out[axis, 3] = shift
    return out


def test_the_textbook_arm_has_the_textbook_position():
    np.testing.assert_allclose(GENERIC.forward_kinematics(np.zeros(6))[:3, 3], [0.65, -0.30, 0.33], atol=1e-15)


@given(q=numbers, theta=numbers, d=numbers, a=numbers, alpha=numbers, prismatic=st.booleans())
def test_a_row_is_the_product_of_four_elementary_motions(q, theta, d, a, alpha, prismatic):
    row = DhRow("j", theta, d, a, alpha, *(("prismatic", -2, 2) if prismatic else ()))
    turn, move = (theta, d + q) if prismatic else (theta + q, d)
    rz, tz = elementary(2, angle=turn), elementary(2, shift=move)
    tx, rx = elementary(0, shift=a), elementary(0, angle=alpha)
    expected = {"standard": rz @ tz @ tx @ rx, "modified": rx @ tx @ rz @ tz}
    for convention, product in expected.items():
        table = DhTable([row], convention=convention)
        np.testing.assert_allclose(table.forward_kinematics([q]), product, atol=1e-14)


def test_base_comes_before_dh_0_and_tool_after_dh_n():
    base, tool = pose((1, 2, 3), (0.1, 0.2, 0.3)), pose((0, 0, 0.1), (0, math.pi / 2, 0))
    table = DhTable(GENERIC.rows, convention="standard", base=base, tool=tool)
    q = np.linspace(-1, 1, 6)
    frames = table.frames(q)
    assert frames.shape == (7, 4, 4)
    np.testing.assert_array_equal(frames[0], base.homogeneous)
    np.testing.assert_allclose(frames[-1], base.homogeneous @ GENERIC.forward_kinematics(q), atol=1e-15)
    np.testing.assert_allclose(table.forward_kinematics(q), frames[-1] @ tool.homogeneous, atol=1e-15)


def test_missing_limits_and_velocities_have_defaults():
    table = DhTable(
        [
            DhRow("r", 0, 0, 1, 0),
            DhRow("c", 0, 0, 1, 0, "continuous"),
            DhRow("p", 0, 0, 0, 0, "prismatic", lower=0, upper=1),
            DhRow("half", 0, 0, 1, 0, upper=1),
        ],
        convention="standard",
    )
    np.testing.assert_array_equal(table.lower, [-math.pi, -math.inf, 0, -math.pi])
    np.testing.assert_array_equal(table.upper, [math.pi, math.inf, 1, 1])
    np.testing.assert_array_equal(table.velocity, [math.pi, math.pi, 1, math.pi])
    assert table.joint_names == ("r", "c", "p", "half")


@pytest.mark.parametrize(
    ("change", "column"),
    [
        ({"name": ""}, "name"),
        ({"name": " j"}, "name"),
        ({"name": "a\nb"}, "name"),
        ({"joint_type": "ball"}, "joint_type"),
        ({"theta": math.nan}, "theta"),
        ({"d": math.inf}, "d"),
        ({"d": 1e7}, "d"),
        ({"a": "0.3"}, "a"),
        ({"alpha": None}, "alpha"),
        ({"alpha": True}, "alpha"),
        ({"lower": 1.0, "upper": 0.5}, "lower"),
        ({"upper": -4.0}, "lower"),
        ({"lower": -math.inf}, "lower"),
        ({"velocity": 0.0}, "velocity"),
        ({"velocity": -1.0}, "velocity"),
        ({"joint_type": "prismatic", "upper": 1.0}, "lower"),
        ({"joint_type": "prismatic", "lower": 1.0}, "upper"),
        ({"joint_type": "continuous", "upper": 1.0}, "upper"),
    ],
)
def test_an_invalid_row_is_refused_with_its_column(change: dict[str, Any], column: str):
    fields: dict[str, Any] = {"name": "j", "theta": 0.0, "d": 0.0, "a": 0.0, "alpha": 0.0}
    with pytest.raises(InputError, match=rf"\b{column} (=|is|of row|must)|'{column}'|{column} '"):
        DhRow(**{**fields, **change})


@pytest.mark.parametrize(
    ("rows", "settings", "error", "words"),
    [
        ((), {"convention": "standard"}, InputError, "rows .* must have at least 1"),
        (GENERIC.rows[0], {"convention": "standard"}, InputError, "rows .*is DhRow.*, not a list"),
        (("not a row",), {"convention": "standard"}, InputError, "must be of type DhRow, not 'not a row'"),
        (
            GENERIC.rows[:2] + GENERIC.rows[:1],
            {"convention": "standard"},
            InputError,
            "a second row is named 'joint_1'",
        ),
        (GENERIC.rows, {"convention": "craig"}, UnknownNameError, "valid: .*standard"),
        (GENERIC.rows, {"convention": "standard", "name": ""}, InputError, "not a valid name"),
        (GENERIC.rows, {"convention": "standard", "tool": 2 * np.eye(4)}, InputError, "tool.* is not a rigid"),
        (GENERIC.rows, {"convention": "standard", "base": np.full((4, 4), np.nan)}, InputError, "base.* holds"),
    ],
)
def test_an_invalid_table_is_refused(rows, settings, error, words):
    with pytest.raises(error, match=words):
        DhTable(rows, **settings)


@pytest.mark.parametrize("q", [np.zeros(5), np.zeros((6, 1)), [0, 0, 0, 0, 0, math.nan]])
def test_a_wrong_q_is_refused(q):
    with pytest.raises(InputError, match=r"^q "):
        GENERIC.forward_kinematics(q)


def test_changes_of_inputs_and_results_do_not_change_a_table():
    tool = np.eye(4)
    table = DhTable(list(GENERIC.rows), convention="standard", tool=tool)
    tool[0, 3] = 9.0
    table.frames(np.zeros(6))[0, 0, 3] = 9.0
    assert table.tool[0, 3] == 0.0
    assert table.base[0, 3] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        table.base[0, 3] = 9.0
    with pytest.raises(FrozenInstanceError):
        table.name = "other"  # type: ignore[misc]


@pytest.mark.parametrize("twin", [pickle.loads(pickle.dumps(GENERIC)), copy.deepcopy(GENERIC)], ids=["pickle", "copy"])
def test_copies_are_equal_and_read_only(twin):
    assert twin.is_close(GENERIC)
    assert not twin.base.flags.writeable


def test_a_row_can_be_replaced_field_by_field():
    continuous = DhRow("c", 0, 0, 1, 0, "continuous")
    assert replace(continuous, a=2.0).upper == math.inf
    assert replace(GENERIC.rows[0], d=1.0).lower == -math.pi


def test_is_close_detects_every_difference():
    moved = DhTable([replace(GENERIC.rows[0], d=0.33 + 1e-9), *GENERIC.rows[1:]], convention="standard")
    assert not moved.is_close(GENERIC)
    assert moved.is_close(GENERIC, tolerance=1e-8)
    assert not DhTable(GENERIC.rows, convention="modified").is_close(GENERIC, tolerance=1.0)
    assert not DhTable(GENERIC.rows[:5], convention="standard").is_close(GENERIC)
