"""Proofs of robots of balls, whose distances are known exactly: what is claimed slightly beyond them is refused."""

from __future__ import annotations

import copy
from itertools import product

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision.certificates.proof_file import proof_document
from pinproof.motion import CubicPath
from pinproof.verifier import verify

from ..collision.exact_cells import cell

SLACK = 1e-4
"""Metres by which the margins of the proofs are below the distances, and those of the forgeries above them."""


@pytest.mark.parametrize("kinds", ["rprpr", "rrrr", "ppp"])
@pytest.mark.parametrize("off", [0.0, 5e-4])
@pytest.mark.parametrize("cubic", [False, True])
def test_a_margin_that_is_larger_than_a_distance_on_the_curve_is_refused(kinds: str, off: float, cubic: bool) -> None:
    """With tolerances of joints and obstacles; the evidence is that of the true margins, and the hashes are right."""
    known, rng = cell(1, kinds), np.random.default_rng(len(kinds))
    checker, moved = known.checker, 2e-3
    corners = np.array(list(product([-1.0, 1.0], repeat=len(kinds))))
    obstacle = np.array([checker.bodies[j].link is None for _, j in checker.pairs])
    free = np.array(["follower" not in names for names in known.owners])
    while True:
        at = rng.uniform(-1, 1, (2, len(kinds))) * np.where(np.array(list(kinds)) == "r", 2.0, 0.3)
        at = np.array([at[0], 0.9 * at[0] + 0.1 * at[1], 0.8 * at[0] + 0.2 * at[1] ** 2])
        curve = (CubicPath.through if cubic else pp.JointPath)(at, checker.arm.joint_names)
        on_curve = curve(np.linspace(*curve.domain, 401))
        distances = known.distances(on_curve)
        nearest = on_curve[np.unique(distances.argmin(axis=0))]
        gaps = known.distances((nearest[:, None] + off * corners).reshape(-1, len(kinds))).min(axis=0)
        slack = 4 * SLACK if off else SLACK
        margins = gaps - moved * obstacle - slack
        if off:  # a joint and its follower are assumed to deviate independently
            margins -= 10 * off * ~free
        if margins.min() > 0:
            break
    near = checker.with_margin(margins=dict(zip(known.owners, margins.tolist(), strict=True)))
    settings = {"joint_tolerance": off, "obstacle_tolerance": moved, "limits": None, "record": True}
    certificate = pp.certify(curve, near, **settings).or_raise()
    document = proof_document(certificate, curve, near)
    verdict = verify(document)
    assert verdict.ok
    assert (verdict.pairs, verdict.joint_tolerance) == (len(gaps), (off,) * len(kinds))
    assert margins.min() < verdict.clearance <= (gaps - moved * obstacle).min() - 1e-9
    rows = document["settings"]["margins"]
    assert {frozenset(row[:2]) for row in rows} == set(map(frozenset, known.owners))
    forged = {**document, "settings": copy.deepcopy(document["settings"])}
    for k in rng.choice(np.flatnonzero(free), size=6, replace=False).tolist():
        (row,) = [row for row in forged["settings"]["margins"] if set(row[:2]) == set(known.owners[k])]
        row[2] += 2 * slack
        assert f"pairs[{k}]" in str(verify(forged)), known.owners[k]
        row[2] -= 2 * slack
    for key, by in (("joint_tolerance", [off + 2e-3] * len(kinds)), ("obstacle_tolerance", moved + 2 * slack)):
        assert not verify({**document, "settings": {**document["settings"], key: by}}).ok, key
