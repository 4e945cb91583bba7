"""Where picks come from: tables on disk, grids, lists; any stretch of them, and what makes two of them differ."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof.errors import InputError, PicksError
from pinproof.picks import PickList
from pinproof.picks.input.picks import PickProblem

from ..examples import examples

HEADER = "name,x,y,z,roll,pitch,yaw,approach,retreat,retreat_x,retreat_y,retreat_z\n"


@pytest.fixture
def write(tmp_path: Path):
    def write(text: str | bytes) -> Path:
        path = tmp_path / "many.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def same(one: pp.Pick, other: pp.Pick) -> bool:
    rest = ("name", "approach", "retreat", "retreat_direction")
    return one.pose == other.pose and all(getattr(one, key) == getattr(other, key) for key in rest)


def test_a_row_of_a_table_is_the_pick_it_states(write) -> None:
    table = pp.picks.open_picks(
        write(HEADER + "a,0.1,0.2,0.3,pi,0,-pi/2,0.05,0.06,1,0,0\n\n# aside\n ,1,2,3,0,0,0,,,,,\n")
    )
    first, second = table.part(0, 2)
    placed = pp.pose((0.1, 0.2, 0.3), rpy=(np.pi, 0, -np.pi / 2))
    assert same(first, pp.Pick("a", placed, approach=0.05, retreat=0.06, retreat_direction=(1, 0, 0)))
    assert same(second, pp.Pick("row_2", pp.pose((1, 2, 3))))


def test_a_cell_of_a_table_may_name_several_supports(write) -> None:
    header = (
        "x,y,z,roll,pitch,yaw,object,support,place_x,place_y,place_z,place_roll,place_pitch,place_yaw,place_support"
    )
    one, several = pp.read_picks(write(f"{header}\n1,2,3,0,0,0,a,b,,,,,,,\n1,2,3,0,0,0,a,b; c,4,5,6,0,0,0,d;e\n"))
    assert one.support == ("b",)
    assert (several.support, several.place.support) == (("b", "c"), ("d", "e"))


def test_a_table_may_state_quaternions_in_any_order_of_columns(write) -> None:
    (pick,) = pp.read_picks(write("\ufeffqw,qx,z,name,qz,qy,y,x\r\n0.5,0.5,3,p,0.5,0.5,2,1\r\n"))
    assert same(pick, pp.Pick("p", pp.pose((1, 2, 3), quat_xyzw=(0.5, 0.5, 0.5, 0.5))))


def test_a_picks_file_may_name_a_table_and_gives_it_what_is_shared(write, tmp_path) -> None:
    write("x,y,z\n1,2,3\n")
    path = tmp_path / "picks.yaml"
    path.write_text("robot: ur5\nmargin: 0.01\ntip: {xyz: [0, 0, 0.1]}\ndefaults: {rpy: [pi, 0, 0]}\npicks: many.csv\n")
    picks = pp.read_picks(path)
    assert (picks.robot, picks.margin, picks.tip.translation[2]) == ("ur5", 0.01, 0.1)
    assert same(picks.picks[0], pp.Pick("row_1", pp.pose((1, 2, 3), rpy=(np.pi, 0, 0))))
    assert pp.picks.open_picks(path).shared.margin == 0.01


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        ("b,1,2", "has 3 cells under 12 columns"),
        ("b,1,2,three,0,0,0,,,,,", "xyz: 'three' is not a number"),
        ("b,1,2,nan,0,0,0,,,,,", "xyz"),
        ("b,1,,3,0,0,0,,,,,", "states only some of x, y, z"),
        ("b,,,,0,0,0,,,,,", "does not state its xyz"),
        ("b,1,2,3,,,,,,,,", "states no orientation"),
        ("b,1,2,3,0,0,0,-1,,,,", "approach of pick 'b' must be a finite number of at least 0"),
        ('"b,1,2,3,0,0,0,,,,,', "not a valid line"),
        (b"\xff,1,2,3,0,0,0,,,,,", "UTF-8"),
        ("a,1,2,3,0,0,0,,,,,", "a second pick is named 'a'"),
    ],
)
def test_an_invalid_row_is_a_problem_at_its_index(write, row: str | bytes, expected: str) -> None:
    good = "{},1,2,3,0,0,0,,,,,\n"
    middle = (row if isinstance(row, bytes) else row.encode()) + b"\n"
    table = pp.picks.open_picks(write((HEADER + good.format("a")).encode() + middle + good.format("c").encode()))
    first, problem, last = table.part(0, 3)
    assert (first.name, last.name) == ("a", "c")
    assert problem.row == 2
    assert expected in problem.reason


def test_an_invalid_table_is_refused(write, tmp_path) -> None:
    for text, named in (
        ("", "is empty"),
        ("# only words\n", "is empty"),
        (HEADER, "contains no picks"),
        ("name,x,y\na,1,2\n", "line 1: lacks the column z beside x"),
        ("name,x,y,z,tilt\n", "line 1: unknown column 'tilt'"),
        ("x,y,z,x\n", "line 1: states a column twice"),
    ):
        with pytest.raises(PicksError, match=named):
            pp.picks.open_picks(write(text))
    with pytest.raises(PicksError, match=r"no.csv: cannot be read"):
        pp.picks.open_picks(tmp_path / "no.csv")
    # A table that was changed is not read on
    table = pp.picks.open_picks(write("name,x,y,z,roll,pitch,yaw\na,1,2,3,0,0,0\n"))
    write("name,x,y,z,roll,pitch,yaw\nbb,1,2,3,0,0,0\n")
    with pytest.raises(PicksError, match="was changed while"):
        table.part(0, 1)


def test_a_grid_is_the_pick_moved_about() -> None:
    first = pp.Pick("bolt", pp.pose((1, 2, 3), rpy=(np.pi, 0, 0.3)), approach=0.07)
    grid = pp.picks.PickGrid(first, (2, 1, 3), (0.1, 9, -0.2))
    picks = list(grid.part(0, len(grid)))
    assert [pick.name for pick in picks] == [f"bolt_{i}_0_{k}" for i in (0, 1) for k in (0, 1, 2)]
    for pick, shift in zip(picks, [(0.1 * i, 0, -0.2 * k) for i in (0, 1) for k in (0, 1, 2)], strict=True):
        np.testing.assert_allclose(pick.pose.translation, np.add((1, 2, 3), shift), atol=1e-15)
        np.testing.assert_array_equal(pick.pose.rotation, first.pose.rotation)
        assert pick.approach == 0.07

    for counts, step in (((1, 2), (1, 1, 1)), ((0, 1, 1), (1, 1, 1)), ((1, 1, 1.0), (0, 0, 0)), ((1, 1, 1), (0, 0))):
        with pytest.raises(InputError, match="grid"):
            pp.picks.PickGrid(first, counts, step)


@given(st.data())
@examples(40)
def test_a_part_of_a_source_equals_the_full_list(data) -> None:
    grid = pp.picks.PickGrid(pp.Pick("p", pp.pose((1, 2, 3))), (3, 4, 5), (0.1, 0.2, 0.3))
    every = list(grid.part(0, 60))
    for source in (grid, PickList(grid.load())):
        start = data.draw(st.integers(0, 60))
        stop = data.draw(st.integers(start, 60))
        part = pickle.loads(pickle.dumps(source.part(start, stop)))
        assert all(map(same, part, every[start:stop]))
        assert len(list(part)) == stop - start


def test_a_part_of_a_table_equals_the_full_table(write) -> None:
    rows = [f"p{k if k % 7 else 0},{k},0,0,0,0,0\n" + "\n" * (k % 3) + "# no\n" * (k % 2) for k in range(40)]
    table = pp.picks.open_picks(write("name,x,y,z,roll,pitch,yaw\n" + "".join(rows)))
    every = list(table.part(0, 40))
    assert [item.row for item in every if isinstance(item, PickProblem)] == [8, 15, 22, 29, 36]  # p0 again
    for start in range(40):
        for stop in range(start, 41, 5):
            part = list(pickle.loads(pickle.dumps(table.part(start, stop))))
            assert [item.name for item in part] == [item.name for item in every[start:stop]]
            assert [type(item) for item in part] == [type(item) for item in every[start:stop]]


def test_sources_that_differ_have_different_digests(write) -> None:
    first, header, rpy = pp.Pick("p", pp.pose((1, 2, 3))), "name,x,y,z\n", {"rpy": [0, 0, 0]}
    grids = [((1, 1, 2), (0, 0, 1)), ((1, 1, 2), (0, 0, 2)), ((1, 1, 3), (0, 0, 1))]
    near, longer = pp.Pick("p", pp.pose((1, 2, 3.0000001))), pp.Pick("p", pp.pose((1, 2, 3)), approach=0.2)
    made = [
        *(pp.picks.PickGrid(first, *grid) for grid in grids),
        *(PickList(pp.Picks((pick,))) for pick in (near, longer)),
        PickList(pp.Picks((first,), (PickProblem(2, "q", "bad"),))),
        *(pp.picks.PickTable(write(header + row)) for row in ("a,1,2,3\n", "a,1,2,4\n")),
        PickList(pp.Picks((first,))),
        pp.picks.PickTable(write(header + "a,1,2,4\n"), defaults=rpy),
    ]
    assert len({source.digest() for source in made}) == len(made)
    assert pp.picks.PickTable(write(header + "a,1,2,4\n"), defaults=rpy).digest() == made[-1].digest()
    assert PickList(pp.Picks((pp.Pick("p", pp.pose((1, 2, 3))),))).digest() == made[-2].digest()


@pytest.mark.parametrize(
    ("rows", "occurs"),
    [("1,0,0,0,0,0,\n", {False}), ("1,0,0,0,0,0,a\n", {True}), ("1,0,0,0,0,0,a\n1,0,0,0,0,0,\n", {True, False})],
)
def test_a_source_knows_whether_its_picks_state_an_object(write, rows: str, occurs: set[bool]) -> None:
    table = pp.picks.open_picks(write("x,y,z,roll,pitch,yaw,object\n" + rows))
    assert table.with_object == occurs
    assert PickList(table.load()).with_object == occurs
    if len(occurs) == 1:
        assert pp.picks.PickGrid(table.load().picks[0], (2, 1, 1), (1, 0, 0)).with_object == occurs
