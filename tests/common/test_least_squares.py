"""Least squares with shares of 0 or more, against SciPy's solution, and without endless exchanges."""

from __future__ import annotations

from unittest import mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import nnls

from pinproof.common.least_squares import non_negative_shares


@given(st.integers(2, 7), st.integers(1, 120), st.booleans(), st.integers(0, 2**32 - 1))
def test_the_rest_is_the_smallest_after_few_exchanges(rows: int, columns: int, exact: bool, seed: int) -> None:
    rng = np.random.default_rng(seed)
    system = rng.normal(size=(rows, columns))
    wanted = system @ np.abs(rng.normal(size=columns)) if exact else rng.normal(size=rows)
    with mock.patch.object(np.linalg, "lstsq", wraps=np.linalg.lstsq) as solve:
        shares = non_negative_shares(system, wanted)
    rest = np.linalg.norm(system @ shares - wanted)
    assert (shares >= 0.0).all()
    assert rest == pytest.approx(nnls(system, wanted, maxiter=10_000)[1], abs=1e-10 * np.linalg.norm(wanted))
    assert solve.call_count <= 60
