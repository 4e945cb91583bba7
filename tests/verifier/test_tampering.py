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
from .forging import forged, pick, small_proofs
from .sampling import Samples

MARGIN = 0.002


def test_the_proof_holds_and_an_oracle_agrees(proof, oracle):
    verdict = verify(proof)
    assert verdict.ok, verdict
    assert verdict.clearance > 0
    assert verdict.margin == MARGIN
    assert verdict.margins == (("hand", "post", 0.004),)
    assert verdict.pairs == len(proof["pairs"])
    least = oracle(proof).least()
    assert least - 2e-3 < verdict.clearance + 0.02  # not far from what there is
    assert least >= verdict.clearance - 1e-6


def drop_interval(p):
    row = max(p["pairs"], key=lambda pair: len(pair["intervals"]))
    del row["intervals"][1], row["directions"][1]


def shift_interval(p):
    for span in p["intervals"]:
        if span[0] > 0:
            span[0] = span[0] + 1e-9


def enlarge_margin(p):
    p["settings"]["margin"] = 0.05


def enlarge_single_margin(p):
    p["settings"]["margins"][0][2] = 0.5


def enlarge_joint_tolerance(p):
    p["settings"]["joint_tolerance"][0] = 0.3


def enlarge_obstacle_tolerance(p):
    p["settings"]["obstacle_tolerance"] = 0.1


def claim_more(p):
    p["claim"]["clearance"] += 0.01


def body(p, name):
    return next(row for row in p["bodies"] if row["name"] == name)


def move_obstacle(p):
    body(p, "post")["placement"][1][3] -= 0.3


def grow_obstacle(p):
    body(p, "ball")["shape"]["radius"] = 0.3


def lift_floor(p):
    body(p, "floor")["placement"][2][3] = 0.0


def lengthen_link(p):
    shape = body(p, "hand_0")["shape"]
    shape["points"] = (np.array(shape["points"]) * [1, 4, 1]).tolist()


def shrink_body(p):
    shape = body(p, "hand_0")["shape"]
    shape["points"] = (np.array(shape["points"]) * 0.5).tolist()


def swap_direction(p):
    for pair in p["pairs"]:
        pair["directions"] = (-np.array(pair["directions"])).tolist()


def long_direction(p):
    p["pairs"][0]["directions"][0] = [2.0, 0.0, 0.0]


def drop_pair(p):
    del p["pairs"][3]


def drop_body(p):
    del p["bodies"][-1]


def change_control_point(p):
    p["curve"]["control"][0][1][0] += 0.5
    p["curve"]["control"][1][0][0] += 0.5


def tear_curve(p):
    p["curve"]["control"][1][0][0] += 1e-3


def not_a_number(p):
    p["curve"]["control"][0][0][0] = float("nan")


def unbounded_direction(p):
    p["pairs"][0]["directions"][0] = [float("inf"), 0.0, 0.0]


def turn_axis(p):
    p["joints"][0]["axis"] = [0.0, 0.0, 2.0]


def shear_placement(p):
    p["joints"][1]["placement"][0][0] = 1.1


def move_joint(p):
    p["joints"][2]["placement"][2][3] -= 0.2


def hang_child_on_itself(p):
    p["joints"][1]["parent"] = 1


def negative_index(p):
    p["pairs"][0]["bodies"][0] = -1


def interval_out_of_table(p):
    p["pairs"][0]["intervals"][0] = len(p["intervals"])


def hide_behind_one_owner(p):
    for row in p["bodies"]:
        if row["name"] == "hand_0":
            row["owner"] = "slide"


def hide_among_obstacles(p):
    for row in p["bodies"]:
        if row["name"] == "hand_0":
            row["kind"] = "obstacle"


def exclude_what_is_not_there(p):
    p["excluded"].append(["hand", "pots", "because"])


def leave_the_curve(p):
    p["intervals"][0][1] = 10.0


def no_clearance(p):
    p["claim"]["clearance"] = None


TAMPERINGS = {
    drop_interval: "nothing is proven",
    shift_interval: "nothing is proven",
    enlarge_margin: "pairs",
    enlarge_single_margin: "hand_0 and post",
    enlarge_joint_tolerance: "pairs",
    enlarge_obstacle_tolerance: "pairs",
    claim_more: "claim.clearance",
    move_obstacle: "and post",
    grow_obstacle: "and ball",
    lift_floor: "and floor",
    lengthen_link: "hand_0",
    swap_direction: "pairs[0]",
    long_direction: "pairs[0]",
    drop_pair: "neither checked nor excluded",
    drop_body: "bodies",
    change_control_point: "pairs",
    tear_curve: "curve.control[0]",
    not_a_number: "curve.control",
    unbounded_direction: "pairs[0]",
    turn_axis: "joints[0].axis",
    shear_placement: "joints[1].placement",
    move_joint: "pairs",
    hang_child_on_itself: "joints[1].parent",
    negative_index: "pairs[0].bodies",
    interval_out_of_table: "intervals",
    hide_behind_one_owner: "another joint or kind",
    hide_among_obstacles: "an obstacle moves with no joint",
    exclude_what_is_not_there: "pots",
    leave_the_curve: "lie on the curve",
    no_clearance: "claim.clearance",
}


@pytest.mark.parametrize("change", TAMPERINGS, ids=lambda change: change.__name__)
def test_a_changed_proof_is_refused_at_its_place_though_its_hashes_were_made_right(tampered, rehashed, change):
    change(tampered)
    try:
        rehashed(tampered)
    except ValueError:  # NaN has a hash too; what is ragged has none
        pytest.fail("the change leaves nothing to hash")
    verdict = verify(tampered)
    assert not verdict.ok
    assert TAMPERINGS[change] in str(verdict)
    assert np.isnan(verdict.clearance)


@pytest.mark.parametrize("change", [move_obstacle, shrink_body, lengthen_link, grow_obstacle])
def test_a_body_that_was_changed_by_accident_shows_in_its_hash(tampered, change):
    change(tampered)
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
@examples(120, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_numbers_changed_at_random_never_prove_a_motion_in_collision(proof, rehashed, oracle, data):
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
        assert oracle(document).least(25) > min(verdict.clearance, MARGIN) - 1e-6


@pytest.mark.slow
@examples(60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(x=st.floats(-0.5, 0.5), y=st.floats(-0.9, 0.3), z=st.floats(-0.3, 0.3), s=st.floats(0, 1))
def test_a_proof_with_a_moved_obstacle_is_refused_or_the_motion_is_free(proof, rehashed, oracle, x, y, z, s):
    document = copy.deepcopy(proof)
    place = body(document, "post")["placement"]
    for axis, by in enumerate((s * x, s * y, s * z)):
        place[axis][3] += by
    if verify(rehashed(document)).ok:
        assert oracle(document).least(25) > MARGIN - 1e-6


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
