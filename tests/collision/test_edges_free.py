"""Batches of proven edges: as single proofs, for any number of threads, and checked by dense samples."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision import is_proven_free
from pinproof.errors import InputError


@pytest.fixture(scope="module")
def cell() -> pp.CollisionChecker:
    arm = pp.load_robot("panda").arm()
    boxes = [
        pp.Obstacle("table", pp.Box(1.4, 1.4, 0.04), pp.pose(xyz=(0.3, 0, -0.1))),
        pp.Obstacle("post", pp.Cylinder(radius=0.05, length=0.9), pp.pose(xyz=(0.45, 0.25, 0.4))),
        pp.Obstacle("shelf", pp.Box(0.3, 0.8, 0.02), pp.pose(xyz=(0.6, -0.1, 0.55))),
    ]
    return pp.CollisionChecker(arm, pp.Scene(boxes), margin=0.005)


@pytest.fixture(scope="module")
def edges(cell: pp.CollisionChecker) -> tuple[np.ndarray, np.ndarray]:
    rng, limits = np.random.default_rng(4), cell.arm.limits
    begin = rng.uniform(limits.lower, limits.upper, (400, cell.arm.dof))
    return begin, np.clip(begin + rng.normal(scale=0.2, size=begin.shape), limits.lower, limits.upper)


def test_the_answers_are_those_of_single_proofs(cell: pp.CollisionChecker, edges) -> None:
    free = cell.edges_free(*edges, threads=1)
    names = cell.arm.joint_names
    single = [is_proven_free(pp.JointPath(np.array(ends), names), cell) for ends in zip(*edges, strict=True)]
    assert free.tolist() == single
    assert 50 < free.sum() < 350


def test_proven_edges_are_free_at_dense_samples(cell: pp.CollisionChecker, edges) -> None:
    free = cell.edges_free(*edges)
    shares = np.linspace(0, 1, 60)[:, None]
    for begin, end in zip(edges[0][free], edges[1][free], strict=True):
        assert cell.is_free_batch(begin + shares * (end - begin)).all()


@pytest.mark.parametrize("threads", [0, 2, 7])
def test_the_number_of_threads_changes_nothing(cell: pp.CollisionChecker, edges, threads: int) -> None:
    assert np.array_equal(cell.edges_free(*edges, threads=threads), cell.edges_free(*edges, threads=1))


def test_an_edge_of_no_length_is_a_configuration(cell: pp.CollisionChecker, edges) -> None:
    assert np.array_equal(cell.edges_free(edges[0], edges[0]), cell.is_free_batch(edges[0]))


def test_no_edges_have_no_answers(cell: pp.CollisionChecker) -> None:
    assert cell.edges_free(np.empty((0, 7)), np.empty((0, 7))).shape == (0,)


def test_a_contact_that_no_joint_changes_leaves_no_free_edge(edges) -> None:
    base = pp.Obstacle("on_the_base", pp.Box(0.1, 0.1, 0.1), pp.pose(xyz=(0, 0, 0.05)))
    blocked = pp.CollisionChecker(pp.load_robot("panda").arm(), pp.Scene([base]))
    assert not blocked.edges_free(*edges).any()


def test_arrays_that_do_not_fit_are_refused(cell: pp.CollisionChecker, edges) -> None:
    begin, end = edges
    for a, b, threads, named in (
        (begin[:, :6], end, 0, "A"),
        (begin, end[:10], 0, "B"),
        (np.full((2, 7), np.nan), end[:2], 0, "A"),
        (begin, end, -1, "threads"),
    ):
        with pytest.raises(InputError, match=named):
            cell.edges_free(a, b, threads=threads)


ROD = """<robot name="rod"><link name="base"/>
<link name="rod"><collision><geometry><box size="2 0.04 0.04"/></geometry></collision></link>
<link name="tip"/>
<joint name="turn" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
<joint name="end" type="fixed"><parent link="rod"/><child link="tip"/><origin xyz="1 0 0"/></joint></robot>"""


@pytest.mark.parametrize("rails", [1, 40])
def test_a_rod_that_turns_about_its_middle_into_a_rail_beside_it_is_not_free(rails: int) -> None:
    """In the middle of the edge the rod is parallel to the rail, and its middle, which does not move, is 0.2 m away."""
    arm = pp.load_robot(ROD).arm(tcp="tip")
    far = [pp.Obstacle(f"far_{k}", pp.Box(0.1, 0.1, 0.1), pp.pose((0.2 * k - 4, 3, 0))) for k in range(rails - 1)]
    rail = pp.Obstacle("rail", pp.Box(2, 0.02, 0.02), pp.pose((0, 0.2, 0)))
    checker = pp.CollisionChecker(arm, pp.Scene([rail, *far]))
    assert checker.edges_free([[-0.3], [-0.1]], [[0.3], [0.1]]).tolist() == [False, True]
    path = pp.JointPath([[-0.3], [0.3]], arm.joint_names)
    assert not is_proven_free(path, checker)  # without samples at the ends
    certificate = pp.certify(path, checker)
    assert certificate.first_contact is not None
    assert abs(certificate.first_contact.q[0]) > 0.15
