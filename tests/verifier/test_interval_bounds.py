"""The bound of the verifier, against the distances that samples have."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pinproof.motion import Bezier
from pinproof.verifier import IntervalBounds, Proof, interval_bounds

from ..examples import examples


def with_curve(proof, rehashed, control, tolerance=0.0):
    """The proof's robot and scene under another curve of pieces (k, degree + 1, 3)."""
    document = copy.deepcopy(proof)
    knots = np.arange(len(control) + 1.0)
    document["curve"] |= {"knots": knots.tolist(), "control": control.tolist()}
    document["settings"]["joint_tolerance"], document["intervals"] = [tolerance] * 3, []
    return rehashed(document)


def curve(rng, size, degree, pieces):
    """Random pieces that meet."""
    control = rng.uniform(-1.2, 1.2, 3) + size * rng.uniform(-1, 1, (pieces, degree + 1, 3)) * [1, 0.3, 1]
    control[1:, 0] = control[:-1, -1]
    return control


def bounds(proof, directions, intervals):
    """(P, T) of every pair on every interval."""
    table = IntervalBounds(proof, intervals)
    rows, count = np.arange(len(intervals)), len(proof.pairs)
    i, j = np.repeat([proof.members(k) for k in range(count)], len(rows), axis=0).T
    u = np.moveaxis(directions / np.linalg.norm(directions, axis=2, keepdims=True), 1, 0).reshape(-1, 3)
    return table.distance(i, j, np.tile(rows, count), u).reshape(count, -1), table.q


@pytest.mark.slow
@examples(60)
@given(seed=st.integers(0, 2**32 - 1), degree=st.integers(1, 5), size=st.sampled_from([0.03, 0.2, 0.8, 4.0]))
def test_no_sample_in_an_interval_is_nearer_than_its_bound(proof, rehashed, oracle, seed, degree, size):
    rng = np.random.default_rng(seed)
    tolerance = float(rng.choice([0.0, 0.02]))
    control = curve(rng, size, degree, 2)
    document = with_curve(proof, rehashed, control, tolerance)
    checked, look = Proof(document), oracle(document)
    ends = np.sort(rng.uniform(0, 2, (3, 2)), axis=1)
    _, middles = bounds(checked, rng.normal(size=(3, len(checked.pairs), 3)), ends)
    directions = np.array([look.normals(q) for q in middles]) + rng.normal(size=(3, 1, 3)) * rng.choice([0.0, 0.1])
    found, _ = bounds(checked, directions, ends)
    for row, (start, end) in enumerate(ends):
        for t in (start, end, *rng.uniform(start, end, 10)):
            q = Bezier(np.arange(3.0), control).at(t) + tolerance * rng.choice([-1, 1], 3)
            assert (look.distances(q) >= found[:, row] - 1e-6).all()


def test_on_a_short_interval_the_bound_is_close_to_the_distance(proof, rehashed, oracle):
    control = curve(np.random.default_rng(5), 0.01, 3, 1)
    document = with_curve(proof, rehashed, control)
    look, span = oracle(document), np.array([[0.4995, 0.5005]])
    q = Bezier(np.arange(2.0), control).at(0.5)
    found, _ = bounds(Proof(document), look.normals(q)[None], span)
    assert found[:, 0] == pytest.approx(look.distances(q), abs=1e-4)


@pytest.mark.slow
def test_bounds_computed_together_equal_the_bounds_of_each_pair_alone(proof, rehashed, monkeypatch):
    rng = np.random.default_rng(8)
    checked = Proof(with_curve(proof, rehashed, curve(rng, 0.3, 3, 2), 0.01))
    table = IntervalBounds(checked, np.sort(rng.uniform(0, 2, (40, 2)), axis=1))
    count = 40 * len(checked.pairs)
    i, j = np.array([checked.members(k) for k in rng.integers(len(checked.pairs), size=count)]).T
    rows, u = rng.integers(40, size=count), rng.normal(size=(count, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    together = table.distance(i, j, rows, u)
    alone = [table.distance(*(each[[k]] for each in (i, j, rows, u)))[0] for k in range(count)]
    np.testing.assert_allclose(together, alone, rtol=0, atol=1e-13)
    for name in ("AT_ONCE", "PRODUCTS"):
        monkeypatch.setattr(interval_bounds, name, 7)
    np.testing.assert_allclose(table.distance(i, j, rows, u), together, rtol=0, atol=1e-13)
