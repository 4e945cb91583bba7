"""The benchmark of costs against size: its exponents, its meshes and its arms."""

import numpy as np
import pytest
from benchmarks.scaling import COSTS, JOINTS, blocks, calls, chain, exponent, rows_of, sphere
from benchmarks.tables import Results, Row

import pinproof as pp


def test_the_exponent_is_the_power_of_a_cost() -> None:
    rows = [Row(count=count, cost=3e-6 * count**1.5) for count in (10, 100, 1000)]
    assert exponent(rows, "cost") == pytest.approx(1.5)


@pytest.mark.parametrize("count", [100, 5000])
def test_spheres_are_solids_of_about_as_many_triangles(count: int) -> None:
    mesh = sphere(count)
    assert mesh.triangles is not None
    assert len(mesh.triangles) == pytest.approx(count, rel=0.25)
    a, b, c = np.moveaxis(np.asarray(mesh.vertices)[mesh.triangles], 1, 0)
    assert np.einsum("ij,ij->i", np.cross(a, b), c).sum() / 6 == pytest.approx(4 / 3 * np.pi * 0.3**3, rel=0.3)


def test_arms_have_the_stated_number_of_joints_and_reach() -> None:
    for count in JOINTS:
        arm = chain(count)
        assert arm.dof == count
        assert arm.forward_kinematics(np.zeros(count)).translation == pytest.approx([0.0, 0.0, 1.0])


def test_every_edge_is_proven_and_every_cost_has_an_exponent() -> None:
    rows = list(rows_of(1000, 0))
    assert all(row.free and not row.wrong for row in rows)
    shown = blocks(Results({}, {}, {"costs": rows}))
    assert len(shown["costs"]) == len(rows) + 2
    assert len(shown["exponents"]) == 5
    assert all(getattr(row, cost) > 0 for row in rows for cost in COSTS)
    assert isinstance(chain(3), pp.Arm)


@pytest.mark.slow
def test_single_calls_and_processes_have_a_time_and_processes_their_memory() -> None:
    rows = list(calls(500, None, 0))
    assert all(row.ms > 0 for row in rows)
    processes = [row for row in rows if row.what.startswith("process")]
    assert len(processes) == 4
    assert all(20 < row.peak_mb < 1000 for row in processes)
