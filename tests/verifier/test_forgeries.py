"""Random forgeries with valid hashes: what the verifier accepts is true of the motion in the file."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from pinproof.verifier import verify

from .forging import forged, pick, small_proofs
from .sampling import Samples

FORGERIES = 500
"""Number of forgeries; a few seconds."""


@pytest.fixture(scope="module")
def proofs():
    return list(small_proofs())


def test_the_proofs_hold_and_samples_agree(proofs):
    for proof in proofs:
        verdict = verify(proof)
        assert verdict.ok, verdict
        samples = Samples(proof)
        assert samples.violation(verdict.clearance) is None
        assert samples.violation(verdict.clearance + 0.3) is not None


def test_the_samples_notice_a_motion_that_leaves_the_proof(proofs):
    """The check can fail: what the verifier refuses as a collision is one."""
    proof = proofs[0]
    changed = {**proof, "curve": {**proof["curve"], "control": [[[0.0], [0.45]], [[0.45], [0.1]]]}}
    assert Samples(changed).violation(0.0) is not None


@pytest.mark.slow
def test_no_forgery_that_is_accepted_is_unsafe(proofs):
    rng, count = np.random.default_rng(20), Counter()
    *small, large = proofs
    choice = [*small * 8, large]
    for _ in range(FORGERIES):
        document, changes = forged(pick(rng, choice), rng)
        if document is None:
            continue
        verdict = verify(document)
        count[verdict.ok] += 1
        if verdict.ok:
            assert Samples(document).violation(verdict.clearance) is None, changes
    assert count[True] > FORGERIES / 20
    assert count[False] > FORGERIES / 4
