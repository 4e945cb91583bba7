"""DH rows and tables: the product, what is refused, and that values stay what they were."""

from __future__ import annotations

import copy
import math
import pickle
from dataclasses import FrozenInstanceError, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pinproof.common.files import parse_number
from pinproof.description.dh import DhRow, DhTable
from pinproof.errors import DhTableError, FileError, InputError, UnknownNameError
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


# DH tables as files: what is read, what is refused and where, and that writing loses nothing.


ROBOTS = Path(__file__).parents[2] / "robots"
HEADER = "name,type,theta,d,a,alpha,lower,upper,velocity"
ROW = "joint_1,revolute,0,0.33,0,pi/2,-pi,pi,3"
CSV = f"# convention: standard\n{HEADER}\n{ROW}\n"
YAML = "convention: standard\nrows:\n  - {name: joint_1, theta: 0, d: 0.33, a: 0, alpha: pi/2}\n"

values = st.floats(-12, 12)
names = st.text(min_size=1, max_size=8).filter(lambda s: s == s.strip() and s.isprintable())


@st.composite
def rows(draw: st.DrawFn, name: str) -> DhRow:
    kind = draw(st.sampled_from(["revolute", "prismatic", "continuous"]))
    numbers = [draw(values) for _ in range(4)]
    limits = sorted([draw(values), draw(values)]) if kind != "continuous" else [None, None]
    velocity = draw(st.floats(0, 1e6, exclude_min=True))
    return DhRow(name, *numbers, kind, *limits, velocity)


@st.composite
def tables(draw: st.DrawFn, transforms: bool) -> DhTable:
    chosen = draw(st.lists(names, min_size=1, max_size=4, unique=True))
    convention = draw(st.sampled_from(["standard", "modified"]))
    settings = {"name": draw(names)}
    if transforms:
        for which in ("base", "tool"):
            numbers = draw(st.lists(st.floats(-4, 4), min_size=6, max_size=6))
            settings[which] = pose(numbers[:3], numbers[3:])
    return DhTable([draw(rows(name)) for name in chosen], convention=convention, **settings)


def write(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


@given(table=tables(transforms=True))
def test_yaml_preserves_every_bit(table, tmp_path_factory):
    path = tmp_path_factory.mktemp("dh") / "table.yaml"
    table.save(path)
    assert DhTable.load(path).is_close(table)


@given(table=tables(transforms=False))
def test_csv_preserves_every_bit_of_the_rows(table, tmp_path_factory):
    path = tmp_path_factory.mktemp("dh") / "table.csv"
    table.save(path)
    back = DhTable.load(path)
    assert (back.rows, back.convention, back.name) == (table.rows, table.convention, "table")


def test_yaml_to_csv_and_back_is_the_same_table(tmp_path):
    table = DhTable.load(ROBOTS / "generic_6dof" / "dh.yaml")
    table.save(tmp_path / "generic_6dof.csv")
    DhTable.load(tmp_path / "generic_6dof.csv").save(tmp_path / "again.yml")
    assert DhTable.load(tmp_path / "again.yml").is_close(table)


def test_the_same_table_gives_the_same_bytes(tmp_path):
    table = DhTable.load(ROBOTS / "generic_6dof" / "dh.yaml")
    for name in ("a.yaml", "b.yaml"):
        table.save(tmp_path / name)
    assert (tmp_path / "a.yaml").read_bytes() == (tmp_path / "b.yaml").read_bytes()


def test_the_generic_arm_has_the_table_of_the_textbook():
    table = DhTable.load(ROBOTS / "generic_6dof" / "dh.yaml")
    half = math.pi / 2
    assert [(row.theta, row.d, row.a, row.alpha) for row in table.rows] == [
        (0, 0.33, 0, half),
        (0, 0, 0.30, 0),
        (0, 0, 0.35, 0),
        (0, 0.20, 0, -half),
        (0, 0, 0, half),
        (0, 0.10, 0, 0),
    ]
    assert table.convention == "standard"


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0.33", 0.33),
        (" -1e-3 ", -1e-3),
        (".5", 0.5),
        ("pi", math.pi),
        ("-pi/2", -math.pi / 2),
        ("+3*pi/4", 3 * math.pi / 4),
        ("0.5 * pi", math.pi / 2),
        ("-2 * pi / 3", -2 * math.pi / 3),
        (7, 7.0),
        (0.25, 0.25),
    ],
)
def test_numbers_may_be_decimals_or_parts_of_pi(text, value):
    assert parse_number(text) == value


@pytest.mark.parametrize(
    "text",
    ["", "pi/0", "2pi", "pi*2", "--pi", "1_000", "nan", "inf", "1,5", "__import__('os')", "pi/2/2", True, None, []],
)
def test_other_texts_are_not_numbers(text):
    with pytest.raises(ValueError, match="is not a number"):
        parse_number(text)


def test_a_csv_may_omit_columns_with_defaults_and_reorder_the_others(tmp_path):
    text = "# from the lab\n# convention: modified,,,\nalpha,a,d,theta,name\npi/2,0.1,0,0,elbow\n\n"
    table = DhTable.load(write(tmp_path, "arm.csv", text))
    assert table.rows == (DhRow("elbow", 0, 0, 0.1, math.pi / 2),)
    assert (table.convention, table.name) == ("modified", "arm")


def test_a_csv_from_a_spreadsheet_with_a_byte_order_mark_is_read(tmp_path):
    path = tmp_path / "arm.csv"
    path.write_bytes(b"\xef\xbb\xbf" + CSV.replace("\n", "\r\n").encode())
    assert DhTable.load(path).joint_names == ("joint_1",)


@pytest.mark.parametrize(
    ("block", "expected"),
    [
        ("{xyz: [0, 0, 0.1]}", pose((0, 0, 0.1))),
        ("{rpy: [0, pi/2, 0]}", pose(rpy=(0, math.pi / 2, 0))),
        ("{xyz: [1, 2, 3], quat_xyzw: [0, 0, 1, 1]}", pose((1, 2, 3), quat_xyzw=(0, 0, 1, 1))),
        ("{matrix: [[1, 0, 0, 5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}", pose((5, 0, 0))),
    ],
)
def test_yaml_states_base_and_tool(block, expected, tmp_path):
    table = DhTable.load(write(tmp_path, "arm.yaml", YAML + f"base: {block}\ntool: {block}\n"))
    np.testing.assert_array_equal(table.base, expected.homogeneous)
    np.testing.assert_array_equal(table.tool, expected.homogeneous)


@pytest.mark.parametrize(
    ("old", "new", "place", "reason"),
    [
        ("# convention: standard\n", "", "", "no convention; add"),
        ("convention: standard", "convention: craig", "", "valid: .*standard"),
        ("# convention: standard", "# convention: standard\n# convention: modified", "", "more than one convention"),
        ("joint_1,", ",", "line 3, row 1", "does not state name"),
        (ROW, f"{ROW}\n{ROW}", "line 4, row 2", "a second row is named 'joint_1'"),
        ("revolute", "ball", "line 3, row 1, column type", "'ball'.*; valid: .*revolute"),
        ("0.33", "0,33", "line 3, row 1", "has 10 cells; the header has 9"),
        ("0.33", "high", "line 3, row 1, column d", "'high' is not a number"),
        ("0.33", "nan", "line 3, row 1, column d", "'nan' is not a number"),
        ("0.33", "", "line 3, row 1", "does not state d"),
        ("0.33", "1e999", "line 3, row 1, column d", "must be a finite number"),
        ("-pi,pi,3", "pi,-pi,3", "line 3, row 1, column lower", "above the upper limit"),
        ("-pi,pi,3", "-pi,pi,0", "line 3, row 1, column velocity", "above 0"),
        ("revolute,0,0.33,0,pi/2,-pi", "prismatic,0,0.33,0,pi/2,", "line 3, row 1", "must state"),
        ("revolute", "continuous", "line 3, row 1, column lower", "has no limits"),
        ("alpha", "alfa", "header", "unknown column 'alfa'; valid: alpha"),
        ("type", "name", "header", "duplicate column name"),
        (ROW, "", "", "must have at least 1"),
        (CSV, "# convention: standard\n", "", "no header"),
    ],
)
def test_a_bad_csv_names_file_row_and_column(old, new, place, reason, tmp_path):
    assert old in CSV
    path = write(tmp_path, "arm.csv", CSV.replace(old, new))
    with pytest.raises(DhTableError, match=reason) as caught:
        DhTable.load(path)
    assert (caught.value.path, caught.value.place) == (str(path), place)


D = "line 3, column 31, key rows['joint_1'].d"


@pytest.mark.parametrize(
    ("old", "new", "place", "reason"),
    [
        ("convention: standard\n", "", "", "no convention; add"),
        ("convention: standard", "convention: 3", "line 1, column 1, key convention", "unknown convention 3"),
        ("convention: standard", "convention: standard\nconvention: modified", "line 2", "duplicate key"),
        ("a: 0,", "a: 0, a: 1,", "line 3", "duplicate key 'a'"),
        ("convention", "tools: {}\nconvention", "line 1, column 1, key tools", "unknown key 'tools'; valid: tool"),
        ("d: 0.33", "d: .nan", D, "must be a finite number"),
        ("d: 0.33", "d: true", D, "True is not a number"),
        ("d: 0.33", "d: [1]", D, "must be a finite number"),
        ("d: 0.33, ", "", "line 3, column 5, key rows['joint_1']", "does not state d"),
        ("d: 0.33", "d: 0.33, mass: 1", "line 3, column 40, key rows['joint_1'].mass", "unknown key 'mass'"),
        ("name: joint_1", "name: 1", "line 3, column 6, key rows[0].name", "1 is not a valid name"),
        ("  - {", "  - oops\n  - {", "line 2, column 1, key rows[0]", "'oops', not a mapping"),
        (YAML[YAML.index("rows") :], "rows: []", "line 2, column 1, key rows", "at least 1"),
        (YAML, "just words", "", "contains a str"),
        (YAML, "rows: {]", "line 1", "is not valid YAML"),
        ("rows", "tool: {xyz: [0, 0]}\nrows", "line 2, column 8, key tool.xyz", "must have 3 numbers, not 2"),
        ("rows", "tool: {xyz: [0, 0, up]}\nrows", "line 2, column 8, key tool.xyz", "'up' is not a number"),
        ("rows", "tool: &t {xyz: &x [*x, 0, 0]}\nrows", "line 2", "refers to its own parent"),
        (
            "rows",
            "tool: {xyz: [0, 0, 0], matrix: [&r [1, 0, 0, 0], *r, *r, *r]}\nrows",
            "line 2, column 1, key tool",
            "either matrix, or xyz",
        ),
        ("rows", "base: {rpy: [0, 0, 0], quat_xyzw: [0, 0, 0, 1]}\nrows", "line 2, column 1, key base", "not both"),
        ("rows", "base: {pos: [0, 0, 0]}\nrows", "line 2, column 8, key base.pos", "unknown key 'pos'"),
        ("rows", "base: [0, 0, 0]\nrows", "line 2, column 1, key base", "not a mapping"),
    ],
)
def test_a_bad_yaml_names_file_and_place(old, new, place, reason, tmp_path):
    assert old in YAML
    path = write(tmp_path, "arm.yaml", YAML.replace(old, new, 1))
    with pytest.raises(DhTableError, match=reason) as caught:
        DhTable.load(path)
    assert (caught.value.path, caught.value.place) == (str(path), place)


def test_yaml_cannot_run_code(tmp_path):
    path = write(tmp_path, "arm.yaml", "rows: !!python/object/apply:os.getcwd []\n")
    with pytest.raises(DhTableError, match="is not valid YAML"):
        DhTable.load(path)


@pytest.mark.parametrize("name", ["missing.yaml", "missing.csv", "arm.txt"])
def test_a_file_that_cannot_be_used_is_named(name, tmp_path):
    with pytest.raises(DhTableError, match=name):
        DhTable.load(tmp_path / name)


def test_text_that_is_not_utf8_is_refused(tmp_path):
    path = tmp_path / "arm.yaml"
    path.write_bytes(b"name: \xff\xfe")
    with pytest.raises(DhTableError, match="not UTF-8"):
        DhTable.load(path)


def test_a_failed_write_leaves_the_old_file_and_no_other(tmp_path, monkeypatch):
    path = tmp_path / "arm.yaml"
    table = DhTable([DhRow("j", 0, 0, 1, 0)], convention="standard")
    table.save(path)
    before = path.read_bytes()

    def full_disk(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full_disk)
    with pytest.raises(FileError, match="No space left on device"):
        DhTable([DhRow("other", 0, 0, 1, 0)], convention="standard").save(path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("name", "error", "named"),
    [
        ("arm.csv", InputError, "the tool of the table"),  # which a CSV file would lose
        ("nowhere/arm.yaml", FileError, r"nowhere/arm\.yaml: cannot be written"),
        ("arm.json", DhTableError, r"unknown file type '\.json'"),
    ],
)
def test_a_table_that_cannot_be_saved_writes_nothing(name, error, named, tmp_path):
    table = DhTable([DhRow("j", 0, 0, 1, 0)], convention="standard", tool=pose((0, 0, 1)))
    with pytest.raises(error, match=named):
        table.save(tmp_path / name)
    assert list(tmp_path.iterdir()) == []
