"""Every change of a proof is detected, or the result is a valid proof of its changed content."""

from __future__ import annotations

import copy
from collections import Counter

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from pinproof.verifier import verify

from ..examples import examples
from .forging import Samples, forged, pick, small_proofs

MARGIN = 0.002


def test_the_proof_holds_and_an_oracle_agrees(proof):
    verdict = verify(proof)
    assert verdict.ok, verdict
    assert verdict.clearance > 0
    assert verdict.margin == MARGIN
    assert verdict.margins == (("hand", "post", 0.004),)
    assert verdict.pairs == len(proof["pairs"])
    least = Samples(proof).least()
    assert least - 2e-3 < verdict.clearance + 0.02  # not far from what there is
    assert least >= verdict.clearance - 1e-6


def body(p, name):
    return next(row for row in p["bodies"] if row["name"] == name)


def change(*line, value=None, add=None, times=None):
    """Puts a value at a place, adds to its number, or multiplies it; the first key may be the name of a body."""

    def apply(p):
        holder = body(p, line[0]) if line[0] not in p else p[line[0]]
        for key in line[1:-1]:
            holder = holder[key]
        old = holder[line[-1]]
        holder[line[-1]] = value if add is times is None else old + add if times is None else scaled(old, times)

    return apply


def scaled(value, factor):
    return (np.array(value) * factor).tolist()


def drop_interval(p):
    row = max(p["pairs"], key=lambda pair: len(pair["intervals"]))
    del row["intervals"][1], row["directions"][1]


def shift_intervals(p):
    p["intervals"] = [[a + 1e-9 if a > 0 else a, b] for a, b in p["intervals"]]


def turn_directions(p):
    for pair in p["pairs"]:
        pair["directions"] = scaled(pair["directions"], -1)


def bend(p):
    change("curve", "control", 0, 1, 0, add=0.5)(p)
    change("curve", "control", 1, 0, 0, add=0.5)(p)


MOVED = change("post", "placement", 1, 3, add=-0.3)
GROWN = change("ball", "shape", "radius", value=0.3)
LONGER = change("hand_0", "shape", "points", times=[1, 4, 1])
SMALLER = change("hand_0", "shape", "points", times=0.5)
TAMPERINGS = {
    "an interval is dropped": (drop_interval, "nothing is proven"),
    "intervals begin later": (shift_intervals, "nothing is proven"),
    "a larger margin": (change("settings", "margin", value=0.05), "pairs"),
    "a larger single margin": (change("settings", "margins", 0, 2, value=0.5), "hand_0 and post"),
    "a larger joint tolerance": (change("settings", "joint_tolerance", 0, value=0.3), "pairs"),
    "a larger obstacle tolerance": (change("settings", "obstacle_tolerance", value=0.1), "pairs"),
    "more is claimed": (change("claim", "clearance", add=0.01), "claim.clearance"),
    "no clearance": (change("claim", "clearance"), "claim.clearance"),
    "the post is moved": (MOVED, "and post"),
    "the ball is larger": (GROWN, "and ball"),
    "the floor is lifted": (change("floor", "placement", 2, 3, value=0.0), "and floor"),
    "a longer link": (LONGER, "hand_0"),
    "opposite directions": (turn_directions, "pairs[0]"),
    "a long direction": (change("pairs", 0, "directions", 0, value=[2.0, 0.0, 0.0]), "pairs[0]"),
    "an infinite direction": (change("pairs", 0, "directions", 0, value=[np.inf, 0.0, 0.0]), "pairs[0]"),
    "a pair is dropped": (lambda p: p["pairs"].pop(3), "neither checked nor excluded"),
    "a body is dropped": (lambda p: p["bodies"].pop(), "bodies"),
    "another control point": (bend, "pairs"),
    "a curve with a gap": (change("curve", "control", 1, 0, 0, add=1e-3), "curve.control[0]"),
    "not a number": (change("curve", "control", 0, 0, 0, value=np.nan), "curve.control"),
    "a long axis": (change("joints", 0, "axis", value=[0.0, 0.0, 2.0]), "joints[0].axis"),
    "a sheared placement": (change("joints", 1, "placement", 0, 0, value=1.1), "joints[1].placement"),
    "a moved joint": (change("joints", 2, "placement", 2, 3, add=-0.2), "pairs"),
    "a joint is its own parent": (change("joints", 1, "parent", value=1), "joints[1].parent"),
    "a negative index": (change("pairs", 0, "bodies", 0, value=-1), "pairs[0].bodies"),
    "an interval beyond the table": (change("pairs", 0, "intervals", 0, value=10**6), "intervals"),
    "a body hides behind an owner": (change("hand_0", "owner", value="slide"), "another joint or kind"),
    "a body hides among obstacles": (change("hand_0", "kind", value="obstacle"), "an obstacle moves with no joint"),
    "an exclusion of nothing": (lambda p: p["excluded"].append(["hand", "pots", "because"]), "pots"),
    "an interval off the curve": (change("intervals", 0, 1, value=10.0), "lie on the curve"),
}


@pytest.mark.parametrize(("apply", "place"), TAMPERINGS.values(), ids=TAMPERINGS)
def test_a_changed_proof_is_refused_at_its_place_though_its_hashes_were_made_right(tampered, rehashed, apply, place):
    apply(tampered)
    verdict = verify(rehashed(tampered))
    assert not verdict.ok
    assert place in str(verdict)
    assert np.isnan(verdict.clearance)


@pytest.mark.parametrize("apply", [MOVED, SMALLER, LONGER, GROWN])
def test_a_body_that_was_changed_by_accident_shows_in_its_hash(tampered, apply):
    apply(tampered)
    assert "sha256" in str(verify(tampered))


@pytest.mark.parametrize("key", ["format", "version", "hashes", "curve", "joints", "bodies", "settings", "excluded",
                                 "intervals", "pairs", "claim"])  # fmt: skip
@pytest.mark.parametrize("value", [None, [], {}, "x", 7, [[]], [None], [{}]])
def test_an_invalid_proof_is_refused_without_an_exception(tampered, key, value):
    tampered[key] = value
    assert not verify(tampered).ok
    del tampered[key]
    assert not verify(tampered).ok


@pytest.mark.parametrize("document", [None, [], {}, "proof", 1.0])
def test_other_files_are_refused(document):
    assert not verify(document).ok


def leaves(value, line=()):
    """The places of all numbers in a document."""
    if isinstance(value, (dict, list)):
        for key, part in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(part, (*line, key))
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        yield line


def at(document, line):
    for key in line:
        document = document[key]
    return document


@pytest.mark.slow
@examples(50, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_numbers_changed_at_random_never_prove_a_motion_in_collision(proof, rehashed, data):
    """Whoever changes numbers and hashes alike may get another proof, but never an untrue one."""
    document = copy.deepcopy(proof)
    part = data.draw(st.sampled_from(["bodies", "joints", "curve", "settings", "intervals", "pairs"]))
    places = list(leaves(document[part], (part,)))
    for _ in range(data.draw(st.integers(1, 3))):
        line = data.draw(st.sampled_from(places))
        size = data.draw(st.sampled_from([1e-4, 1e-2, 0.1, 1.0]))
        change = size * data.draw(st.floats(-1, 1))
        holder, key = at(document, line[:-1]), line[-1]
        holder[key] = holder[key] + (round(3 * change) if isinstance(holder[key], int) else change)
    verdict = verify(rehashed(document))
    if verdict.ok:
        assert Samples(document).least(25) > min(verdict.clearance, MARGIN) - 1e-6


@pytest.mark.slow
@examples(25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(x=st.floats(-0.5, 0.5), y=st.floats(-0.9, 0.3), z=st.floats(-0.3, 0.3), s=st.floats(0, 1))
def test_a_proof_with_a_moved_obstacle_is_refused_or_the_motion_is_free(proof, rehashed, x, y, z, s):
    document = copy.deepcopy(proof)
    place = body(document, "post")["placement"]
    for axis, by in enumerate((s * x, s * y, s * z)):
        place[axis][3] += by
    if verify(rehashed(document)).ok:
        assert Samples(document).least(25) > MARGIN - 1e-6


FORGERIES = 250
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
