"""Proofs with valid hashes whose numbers, texts or structure are chosen to deceive a verifier."""

from __future__ import annotations

import copy
import json
import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest

from pinproof.verifier import Proof, Refused, load, verify
from pinproof.verifier.parts import shown

from ..processes import PATIENCE

DENORMAL = 5e-324
WIDEST = 10.0
"""rad by which the forged motion leaves the proven one: more than a full rotation."""


def slider(rehashed, obstacle_at, joints, control, knots=(0.0, 1.0)):
    """A proof that a ball of 1 cm, carried by the prismatic joints given, stays away from another on the x axis.

    ``joints`` are (multiplier, offset, translation along x) of joints that all follow the only entry of q.
    """
    identity = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]

    def ball(name, kind, joint, x):
        place = copy.deepcopy(identity)
        place[0][3] = x
        shape = {"points": [[0.0, 0.0, 0.0]], "disc_radii": [0.0], "radius": 0.01, "semi_axes": [0.0, 0.0, 0.0]}
        row = {"name": name, "owner": name, "kind": kind, "geometry": name, "level": 0, "joint": joint}
        return {**row, "source": "sphere", "placement": place, "shape": shape, "sha256": ""}

    rows = []
    for k, (multiplier, offset, x) in enumerate(joints):
        place = copy.deepcopy(identity)
        place[0][3] = x
        row = {"name": f"joint {k}", "type": "prismatic", "axis": [1.0, 0.0, 0.0], "placement": place}
        rows.append({**row, "parent": k - 1, "leader": 0, "multiplier": multiplier, "offset": offset})
    spans = [[a, b] for a, b in pairwise(knots)]
    return rehashed(
        {
            "format": "pinproof proof",
            "version": 3,
            "limits": None,
            "made_by": "a forger",
            "claim": {"status": "FREE", "clearance": 0.0},
            "settings": {"margin": 0.0, "margins": [], "joint_tolerance": [0.0], "obstacle_tolerance": 0.0},
            "hashes": {"curve": ""},
            "robot": {},
            "curve": {"joint_names": ["x"], "knots": list(knots), "control": control},
            "joints": rows,
            "bodies": [ball("tool", "link", len(rows) - 1, 0.0), ball("post", "obstacle", -1, obstacle_at)],
            "notes": [],
            "excluded": [],
            "intervals": spans,
            "pairs": [
                {"bodies": [0, 1], "intervals": list(range(len(spans))), "directions": [[1.0, 0.0, 0.0]] * len(spans)}
            ],
        }
    )


# -- widths of pieces ----------------------------------------------------------------------------------------------


def test_the_slider_proof_holds_up_to_the_contact(rehashed):
    """The generator of the forgeries below makes proofs that hold, and only where the balls stay apart."""
    assert verify(slider(rehashed, 0.5, [(1.0, 0.0, 0.0)], [[[0.0], [0.4]]])).ok
    assert not verify(slider(rehashed, 0.5, [(1.0, 0.0, 0.0)], [[[0.0], [0.49]]])).ok


@pytest.mark.parametrize(("begin", "end"), [(0.0, DENORMAL), (0.0, 1e-320), (0.0, 2.2e-308), (0.0, 1e-300),
                                              (0.0, 1e-100), (-1e-300, 1e-300),
                                              (0.0, 1e-9), (-1.0, -1.0 + 1e-9)])  # fmt: skip
def test_a_motion_in_a_piece_of_nearly_no_width_is_refused(rehashed, begin, end):
    forged = slider(rehashed, 0.5, [(1.0, 0.0, 0.0)], [[[0.0], [WIDEST]]], (begin, end))
    verdict = verify(forged)
    assert "curve.knots" in str(verdict)


def with_rates(forged, acceleration):
    """The proof with the claim that its speed is at most 1 m/s, and its acceleration at most this."""
    rates = {"velocity": [1.0], "acceleration": [acceleration]}
    return verify({**forged, "limits": {"lower": [-1.0], "upper": [1.0], **rates}})


def test_an_acceleration_between_pieces_of_different_speed_is_refused(rehashed):
    """Each piece has a constant speed, and no acceleration; between them the speed jumps from 0.3 to -0.3 m/s."""
    zigzag = slider(rehashed, 0.5, [(1.0, 0.0, 0.0)], [[[0.0], [0.3]], [[0.3], [0.0]]], (0.0, 1.0, 2.0))
    assert verify(zigzag).ok
    (reason,) = with_rates(zigzag, 50.0).reasons
    assert "acceleration" in reason
    parabola = slider(rehashed, 0.5, [(1.0, 0.0, 0.0)], [[[0.0], [0.15], [0.0]]])  # 0.6 m/s^2
    assert with_rates(parabola, 0.61).limits == ("position", "velocity", "acceleration")
    assert not with_rates(parabola, 0.59).ok


@pytest.mark.parametrize("pieces", [1, 2, 50])
@pytest.mark.parametrize("width", [1e-9, 1e-8, 1e-5])
def test_an_acceleration_in_short_pieces_is_refused_although_their_numbers_are_rounded(rehashed, pieces, width):
    """From rest to 0.3 m/s: the rounding of a position allows some acceleration in a nanosecond, but not this."""
    speeds, control, place = np.linspace(0.0, 0.3, pieces + 1).tolist(), [], 0.0
    for before, after in pairwise(speeds):
        control.append([[place], [place + before * width / 2], [place + (before + after) * width / 2]])
        place = control[-1][-1][0]
    control.append([[place], [place + 0.15], [place + 0.3]])
    knots = (*(width * k for k in range(pieces + 1)), width * pieces + 1.0)
    forged = slider(rehashed, 0.5, [(1.0, 0.0, 0.0)], control, knots)
    assert verify(forged).ok
    (reason,) = with_rates(forged, 50.0).reasons
    assert "acceleration" in reason


@pytest.mark.parametrize("knots", [(0.0, 0.0), (0.0, 1.0)])
def test_limits_of_an_arm_at_rest_at_zero_hold(rehashed, knots):
    assert with_rates(slider(rehashed, 0.5, [(1.0, 0.0, 0.0)], [[[0.0], [0.0], [0.0]]], knots), 1.0).ok


@pytest.mark.parametrize("width", [DENORMAL, 1e-9])
def test_a_motion_hidden_between_two_wide_pieces_is_refused(rehashed, width):
    control = [[[0.0], [0.1]], [[0.1], [WIDEST]], [[WIDEST], [WIDEST]]]
    forged = slider(rehashed, 0.5, [(1.0, 0.0, 0.0)], control, (-1.0, 0.0, width, 1.0))
    assert "curve.knots" in str(verify(forged))


@pytest.mark.parametrize("pieces", [2, 1000])
def test_pieces_of_no_width_cannot_add_up_to_a_motion(rehashed, pieces):
    """Each moves by less than the rounding that is allowed between two pieces; together they would reach the post."""
    q = 0.48 - 1e-9 + 1e-12 * np.arange(pieces + 1)
    control = np.column_stack([q[:-1], q[1:]])[:, :, None].tolist()
    forged = slider(rehashed, 0.5, [(1.0, 0.0, 0.0)], control, (0.0,) * (pieces + 1))
    assert "curve.knots" in str(verify(forged))


def test_knots_whose_difference_overflows_are_refused(rehashed):
    forged = slider(rehashed, 0.5, [(1.0, 0.0, 0.0)], [[[0.0], [0.4]]], (-1.7e308, 1.7e308))
    assert "curve.knots" in str(verify(forged))


# -- integers and rounding -----------------------------------------------------------------------------------------

HUGE = [-(2**63), 2**63 - 1, 2**63, 2**64, -(2**64), 10**30, -(10**400), 2**53 + 1]


@pytest.mark.parametrize("value", HUGE)
def test_an_integer_beyond_the_limit_is_refused(rehashed, value):
    for joint in ((1.0, value, 0.0), (value, 0.0, 0.0), (1.0, 0.0, value)):
        try:
            forged = slider(rehashed, 0.5, [joint], [[[0.0], [WIDEST]]])
        except OverflowError:
            pytest.fail("the hash does not contain the joints")
        assert "joints[0]" in str(verify(forged))
    assert shown(value) == f"an integer of {value.bit_length()} bits"
    assert shown(-value % 1000) == str(-value % 1000)


@pytest.mark.parametrize("value", [-(2**63), -(10**400), 2**53 + 1])
def test_an_integer_beyond_the_limit_is_refused_wherever_numbers_are(tampered, value):
    for line in list(number_places(tampered)):
        document = changed(tampered, line, value)
        assert not verify(document).ok, line


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_a_value_that_is_not_finite_is_refused_wherever_numbers_are(tampered, rehashed, value):
    """In a parsed document, such as one that was not read from a file; its hashes are right."""
    for line in list(number_places(tampered)):
        document = changed(tampered, line, value)
        verdict = verify(rehashed(document))
        assert str(verdict).startswith(f"REFUSED: {line[0]}") or line[0] == "version", line


def changed(document, line, value):
    """A copy of the document with another value at a place."""
    copied = holder = copy.deepcopy(document)
    for key in line[:-1]:
        holder = holder[key]
    holder[line[-1]] = value
    return copied


def number_places(document):
    """One place of each kind: the first entry of every list is enough."""
    skipped = {"hashes", "robot", "notes", "made_by"}

    def walk(value, line):
        if isinstance(value, dict):
            for key, part in value.items():
                if line or key not in skipped:
                    yield from walk(part, (*line, key))
        elif isinstance(value, list):
            for k, part in enumerate(value[:1]):
                yield from walk(part, (*line, k))
        elif isinstance(value, (int, float)):
            yield line

    return walk(document, ())


def test_cancelling_prismatic_joints_cannot_absorb_a_translation(rehashed):
    """1e12 m out and 1e12 m back: in double precision 50 um in between vanish, and with them the contact."""
    joints = [(1e6, 0.0, 0.0), (-1e6, 0.0, 5e-5)]
    assert not verify(slider(rehashed, 0.02 + 4e-5, joints, [[[1e6], [1e6]]])).ok


# -- types, texts and keys -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("key", ["name", "owner", "kind", "geometry", "sha256"])
@pytest.mark.parametrize("value", [["hand_0"], {}, 7, None, True, 1.5, "", "a\nHOLDS", "a\x1b[2K", "\ud800"])
def test_a_text_of_a_body_is_a_printable_text(tampered, key, value):
    tampered["bodies"][1][key] = value
    assert f"bodies[1].{key}" in str(verify(tampered))


@pytest.mark.parametrize("value", [["fixed"], 7, None, "a\nHOLDS"])
def test_the_reason_of_an_exclusion_is_a_printable_text(tampered, value):
    assert tampered["excluded"]
    tampered["excluded"][0][2] = value
    assert "excluded" in str(verify(tampered))


def test_two_bodies_of_one_name_are_refused(tampered):
    tampered["bodies"][1]["name"] = tampered["bodies"][0]["name"]
    assert "bodies[1].name" in str(verify(tampered))


@pytest.mark.parametrize("swapped", [False, True])
def test_a_pair_has_one_margin(tampered, swapped):
    """Of two rows for a pair, one would be reported and the other applied."""
    row = ["post", "hand", 0.0] if swapped else ["hand", "post", 0.0]
    tampered["settings"]["margins"].append(row)
    assert "settings.margins" in str(verify(tampered))


@pytest.mark.parametrize("row", [["hand", "pots", 0.1], ["hand", "hand", 0.1]])
def test_a_margin_is_one_of_two_owners_of_the_proof(tampered, row):
    tampered["settings"]["margins"].append(row)
    assert "settings.margins" in str(verify(tampered))


def test_a_boolean_is_not_a_number(tampered):
    for line in list(number_places(tampered)):
        assert not verify(changed(tampered, line, True)).ok, line


@pytest.mark.parametrize("version", [True, 3.0, "3", 2, 4])
def test_another_version_is_refused(tampered, version):
    tampered["version"] = version
    assert "format" in str(verify(tampered))


@pytest.mark.parametrize("status", ["COLLIDING", "UNDECIDED", "free", None, ["FREE"]])
def test_only_a_claim_of_free_is_a_proof(tampered, status):
    tampered["claim"]["status"] = status
    assert "claim.status" in str(verify(tampered))


@pytest.mark.parametrize(
    "line",
    [
        (),
        ("claim",),
        ("settings",),
        ("curve",),
        ("joints", 0),
        ("bodies", 0),
        ("bodies", 0, "shape"),
        ("pairs", 0),
    ],
)
def test_an_unknown_field_is_refused(tampered, line):
    holder = tampered
    for key in line:
        holder = holder[key]
    holder["scale"] = 2.0
    assert "scale" in str(verify(tampered))


@pytest.mark.slow
def test_a_deeply_nested_value_is_refused_wherever_it_is(tampered):
    deep: list = []
    for _ in range(100_000):
        deep = [deep]
    checked = ("claim", "settings", "curve", "joints", "bodies", "excluded", "intervals", "pairs")
    for key in checked:
        for line in [(key,), *first_places(tampered[key], (key,))]:
            assert not verify(changed(tampered, line, deep)).ok or line[-1] == "source", line


def first_places(value, line):
    entries = value.items() if isinstance(value, dict) else enumerate(value[:1]) if isinstance(value, list) else ()
    for key, part in entries:
        yield (*line, key)
        yield from first_places(part, (*line, key))


# -- files ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("literal", ["NaN", "Infinity", "-Infinity", "1e999", "-1e999", "1e99999999999"])
def test_a_non_finite_literal_is_refused_anywhere_in_a_file(proof, tmp_path, literal):
    text = json.dumps(proof)
    for key in ("obstacle_tolerance", "version"):
        changed = text.replace(f'"{key}": {json.dumps(find(proof, key))}', f'"{key}": {literal}')
        assert changed != text
        (tmp_path / "proof.json").write_text(changed)
        with pytest.raises(ValueError, match="finite"):
            load(tmp_path / "proof.json")


def find(value, key):
    if isinstance(value, dict):
        if key in value:
            return value[key]
        value = list(value.values())
    for part in value if isinstance(value, list) else ():
        found = find(part, key)
        if found is not None:
            return found
    return None


def test_an_integer_of_ten_thousand_digits_is_refused(proof, tmp_path):
    (tmp_path / "proof.json").write_text(json.dumps(proof).replace('"version": 3', f'"version": 1{"0" * 10_000}'))
    with pytest.raises(ValueError, match="10001 digits"):
        load(tmp_path / "proof.json")


@pytest.mark.parametrize("key", ["format", "claim", "knots", "radius", "name", "margin", "bodies"])
def test_a_repeated_key_is_refused_at_any_depth(proof, tmp_path, key):
    text = json.dumps(proof)
    at = text.index(f'"{key}": ')
    (tmp_path / "proof.json").write_text(f'{text[:at]}"{key}": null, {text[at:]}')
    with pytest.raises(ValueError, match=key):
        load(tmp_path / "proof.json")


@pytest.mark.slow
def test_a_nested_file_is_refused_by_the_command(proof, tmp_path):
    (tmp_path / "proof.json").write_text('{"format": ' + "[" * 900 + "]" * 900 + "}")
    words = [sys.executable, "-m", "pinproof.verifier", "proof.json"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=PATIENCE)
    assert done.returncode in (1, 2)
    assert "Traceback" not in done.stderr


def test_a_proof_that_makes_no_sense_raises_refused(tampered):
    tampered["joints"][0]["offset"] = -(2**63)
    with pytest.raises(Refused, match=r"joints\[0\]\.offset"):
        Proof(tampered)
