"""Supports, limits, bounds and values of the verifier, each against an independent computation."""

from __future__ import annotations

import copy
import hashlib
import json
import math
import os
import runpy
import struct
import sys
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof.collision.certificates.proof_file import proof_document
from pinproof.motion import Bezier, CubicPath
from pinproof.verifier import IntervalBounds, Proof, Refused, body_digest, interval_bounds, load, rounding, verify
from pinproof.verifier.parts import Body, Curve, halves

from ..collision.exact_cells import cell
from ..examples import examples
from .forging import Samples


def body(points, discs, radius, semi) -> Body:
    row = {
        "name": "b", "owner": "b", "kind": "link", "geometry": "g", "level": 0, "source": "s", "joint": -1,
        "placement": np.eye(4)[:3].tolist(),
        "shape": {
            "points": np.asarray(points).tolist(), "disc_radii": np.asarray(discs).tolist(), "radius": radius,
            "semi_axes": list(semi),
        },
    }  # fmt: skip
    return Body(row | {"sha256": body_digest(row)}, 0, 0)


@pytest.mark.parametrize("semi", [(0.0, 0.0, 0.0), (0.3, 0.2, 0.1), (0.3, 0.0, 0.0), (0.0, 0.2, 0.1)])
@pytest.mark.parametrize("discs", [0.0, 0.4])
@pytest.mark.parametrize("radius", [0.0, 0.2])
def test_reach_is_the_largest_over_the_points_of_a_body(semi, discs, radius) -> None:
    """Sums of a point, a point of its disc, one of the ball and one of the ellipsoid, by dense samples."""
    rng = np.random.default_rng(0)
    points = rng.normal(size=(5, 3))
    radii = discs * rng.uniform(size=5) * [1, 1, 0, 1, 1]
    shape = body(points, radii, radius, semi)
    angle = np.linspace(0, 2 * np.pi, 2001)
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    k = np.arange(20000) + 0.5
    z, turn = 1 - k / 10000, np.pi * (1 + 5**0.5) * k
    sphere = np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1)
    directions = rng.normal(size=(40, 3))
    reach = shape.reach(directions)
    for d, found in zip(directions, reach, strict=True):
        discs_of_points = [(point + r * circle) @ d for point, r in zip(points, radii, strict=True)]
        largest = np.max(discs_of_points) + (radius * sphere @ d).max() + (sphere * semi @ d).max()
        assert largest - 1e-12 <= found <= largest + 1e-3
    far = [np.linalg.norm(p - shape.centre) + r for p, r in zip(points, radii, strict=True)]
    assert shape.ball <= max(far) + radius + max(semi) + 1e-12
    assert (shape.ball * np.linalg.norm(directions, axis=1) >= reach - directions @ shape.centre).all()


@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize("piece", [0, 1, 2])
def test_limits_hold_in_every_piece_of_a_curve_of_any_degree(degree: int, piece: int) -> None:
    """One piece of three moves at 2 units of the parameter; with a limit just above and below its largest rate."""
    share = np.linspace(0, 1, degree + 1)[:, None]
    ends = np.array([[0.0, 0.0], [0.1, 0.0], [0.2, 0.0], [0.3, 0.0]])
    ends[piece + 1 :, 1] += 1.0
    control = np.array([a + share * (b - a) for a, b in pairwise(ends)])
    knots = [0.0, 0.5, 1.0, 1.5]
    curve = Curve({"joint_names": ["a", "b"], "knots": knots, "control": control.tolist()})
    wide = np.full(2, 10.0)

    def check(position: float, velocity: float) -> tuple[str, ...]:
        fast = np.array([10.0, velocity])
        high = np.array([10.0, position])
        return curve.check_limits({"position": (-wide, high), "velocity": (-fast, fast)})

    assert check(1.0, 2.0) == ("position", "velocity")
    with pytest.raises(Refused, match=rf"control\[{piece}\]: the position"):
        check(1.0 - 1e-5, 2.0)
    with pytest.raises(Refused, match=rf"control\[{piece}\]: the velocity"):
        check(1.0, 2.0 * (1 - 1e-5))


@pytest.mark.parametrize("rates", [(1.0, 0.5), (0.5, 1.0), (-0.5, -1.0), (0.5, 0.5)])
def test_a_jump_of_the_velocity_keeps_no_limit_of_acceleration(rates) -> None:
    at = np.cumsum([0.0, *rates]).tolist()
    control = [[[at[k], 0.0], [at[k + 1], 0.0]] for k in range(2)]
    curve = Curve({"joint_names": ["a", "b"], "knots": [0.0, 1.0, 2.0], "control": control})
    wide, known = np.full(2, 10.0), np.array([5.0, np.inf])
    limits = {"position": (-wide, wide), "velocity": (-wide, wide), "acceleration": (-known, known)}
    if rates[0] == rates[1]:
        assert curve.check_limits(limits) == ("position", "velocity", "acceleration")
    else:
        with pytest.raises(Refused, match="acceleration"):
            curve.check_limits(limits)


@pytest.mark.parametrize(("jumps", "kept"), [(1, True), (8, False)])
def test_small_jumps_of_the_velocity_count_together(jumps, kept) -> None:
    """Each is below what rounding may change in all, 0.011 rad/s."""
    rates = 0.5 + 0.005 * (np.arange(jumps + 1) % 2)
    at = np.cumsum([0.0, *rates]).tolist()
    control = [[[at[k], 0.0], [at[k + 1], 0.0]] for k in range(jumps + 1)]
    curve = Curve({"joint_names": ["a", "b"], "knots": [float(k) for k in range(jumps + 2)], "control": control})
    wide = np.full(2, 10.0)
    limits = {"position": (-wide, wide), "velocity": (-wide, wide), "acceleration": (-wide, wide)}
    if kept:
        assert "acceleration" in curve.check_limits(limits)
    else:
        with pytest.raises(Refused, match="acceleration"):
            curve.check_limits(limits)


@pytest.mark.parametrize("degree", range(5))
def test_halves_are_parts_of_the_same_curve(degree) -> None:
    control = np.random.default_rng(degree).normal(size=(3, degree + 1, 2))
    left, right = np.split(halves(control), 2)
    for t in np.linspace(0, 1, 7):
        weights = np.array([math.comb(degree, r) * t**r * (1 - t) ** (degree - r) for r in range(degree + 1)])
        for part, share in ((left, t / 2), (right, (1 + t) / 2)):
            there = [math.comb(degree, r) * share**r * (1 - share) ** (degree - r) for r in range(degree + 1)]
            np.testing.assert_allclose(weights @ part, np.array(there) @ control, atol=1e-12)


@pytest.mark.parametrize("names", [[], ["a", "a", "b"], ["a", "", "b"], ["a", "b\n", "c"], ["a", "b", 3], "abc"])
def test_joint_names_are_different_printable_texts(tampered, names) -> None:
    tampered["curve"]["joint_names"] = names
    assert "curve.joint_names" in str(verify(tampered))


def test_integers_are_read_as_numbers(tampered, rehashed) -> None:
    """JSON has one kind of number: 2 is 2.0."""
    tampered["settings"]["margins"] = []
    tampered["settings"]["margin"] = 0
    tampered["joints"][0]["placement"] = [[1, 0, 0, 2], [0, 1, 0, 3], [0, 0, 1, 400]]
    moved = Proof(rehashed(tampered)).joints[0].translation.value
    assert moved.tolist() == [2.0, 3.0, 400.0]


def test_only_files_are_read(tmp_path, proof) -> None:
    """A pipe would never end."""
    os.mkfifo(tmp_path / "pipe")
    for place in (tmp_path / "pipe", tmp_path):
        with pytest.raises(ValueError, match="not a file"):
            load(place)
    (tmp_path / "proof.json").write_text(json.dumps(proof))
    assert load(tmp_path / "proof.json") == proof


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_the_module_is_a_command(tmp_path, proof, monkeypatch, capsys) -> None:
    (tmp_path / "proof.json").write_text(json.dumps(proof))
    for words, code in (([str(tmp_path / "proof.json")], 0), ([], 2), (["a", "b"], 2), ([str(tmp_path / "none")], 2)):
        monkeypatch.setattr(sys, "argv", ["verifier", *words])
        with pytest.raises(SystemExit) as ended:
            runpy.run_module("pinproof.verifier", run_name="__main__")
        assert ended.value.code == code
        assert bool(capsys.readouterr().out) is (code == 0)


def test_hashes_are_those_of_the_description_of_the_format(proof) -> None:
    """docs/formats/proof.md: numbers as little-endian doubles in a stated order, texts as UTF-8."""

    def doubles(*values: object) -> bytes:
        flat = [number for value in values for number in np.ravel(value).tolist()]
        return struct.pack(f"<{len(flat)}d", *flat)

    kinds = set()
    for row in proof["bodies"]:
        data, shape = doubles(row["joint"], row["placement"]), row["shape"]
        if isinstance(shape, dict):
            data += doubles(shape["points"], shape["disc_radii"], shape["radius"], shape["semi_axes"])
        elif shape is not None:
            data += shape.encode()
        assert row["sha256"] == hashlib.sha256(data).hexdigest()
        kinds.add(type(shape))
    assert len(kinds) > 1
    names, control = tuple(proof["curve"]["joint_names"]), np.array(proof["curve"]["control"])
    text = repr((names, control.shape)).encode()
    expected = hashlib.sha256(text + doubles(proof["curve"]["knots"], control)).hexdigest()
    assert proof["hashes"]["curve"] == expected


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("joint", range(2))
def test_a_limit_on_one_side_of_one_joint_is_checked(joint: int, side: int) -> None:
    control = np.zeros((1, 3, 2))
    control[0, :, joint] = [0.0, 1.0, 0.5] if side else [0.0, -1.0, -0.5]
    curve = Curve({"joint_names": ["a", "b"], "knots": [0.0, 1.0], "control": control.tolist()})
    for room, kept in ((0.7, True), (0.6, False)):  # the curve goes up to 2/3
        low, high = np.full(2, -np.inf), np.full(2, np.inf)
        (low, high)[side][joint] = room if side else -room
        if kept:
            assert curve.check_limits({"position": (low, high)}) == ("position",)
        else:
            with pytest.raises(Refused, match="position"):
                curve.check_limits({"position": (low, high)})


def test_a_refused_document_has_no_figures() -> None:
    verdict = verify({})
    assert not verdict.ok
    assert (verdict.pairs, verdict.intervals, verdict.excluded) == (0, 0, ())


def test_only_obstacles_may_be_displaced(proof) -> None:
    checked = Proof(proof)
    tolerance = proof["settings"]["obstacle_tolerance"]
    found = {row["kind"]: checked.tolerance_of(j) for j, row in enumerate(proof["bodies"])}
    assert found == {"link": 0.0, "obstacle": tolerance}
    assert tolerance > 0.0


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
@examples(25)
@given(seed=st.integers(0, 2**32 - 1), degree=st.integers(1, 5), size=st.sampled_from([0.03, 0.2, 0.8, 4.0]))
def test_no_sample_in_an_interval_is_nearer_than_its_bound(proof, rehashed, seed, degree, size):
    rng = np.random.default_rng(seed)
    tolerance = float(rng.choice([0.0, 0.02]))
    control = curve(rng, size, degree, 2)
    document = with_curve(proof, rehashed, control, tolerance)
    checked, look = Proof(document), Samples(document)
    ends = np.sort(rng.uniform(0, 2, (3, 2)), axis=1)
    _, middles = bounds(checked, rng.normal(size=(3, len(checked.pairs), 3)), ends)
    directions = np.array([look.pairs_at(q)[1] for q in middles]) + rng.normal(size=(3, 1, 3)) * rng.choice([0.0, 0.1])
    found, _ = bounds(checked, directions, ends)
    for row, (start, end) in enumerate(ends):
        for t in (start, end, *rng.uniform(start, end, 10)):
            q = Bezier(np.arange(3.0), control).at(t) + tolerance * rng.choice([-1, 1], 3)
            assert (look.pairs_at(q)[0] >= found[:, row] - 1e-6).all()


def test_on_a_short_interval_the_bound_is_close_to_the_distance(proof, rehashed):
    control = curve(np.random.default_rng(5), 0.01, 3, 1)
    document = with_curve(proof, rehashed, control)
    look, span = Samples(document), np.array([[0.4995, 0.5005]])
    q = Bezier(np.arange(2.0), control).at(0.5)
    found, _ = bounds(Proof(document), look.pairs_at(q)[1][None], span)
    assert found[:, 0] == pytest.approx(look.pairs_at(q)[0], abs=1e-4)


@pytest.mark.slow
def test_bounds_computed_together_equal_the_bounds_of_each_pair_alone(proof, rehashed, monkeypatch):
    # Only their rounding errors are not those of each pair alone, but the largest.
    for side in ("lower", "upper"):
        monkeypatch.setattr(rounding.Near, side, property(lambda each: each.value))
    rng = np.random.default_rng(8)
    checked = Proof(with_curve(proof, rehashed, curve(rng, 0.3, 3, 2), 0.01))
    table = IntervalBounds(checked, np.sort(rng.uniform(0, 2, (12, 2)), axis=1))
    count = 12 * len(checked.pairs)
    i, j = np.array([checked.members(k) for k in rng.integers(len(checked.pairs), size=count)]).T
    rows, u = rng.integers(12, size=count), rng.normal(size=(count, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    together = table.distance(i, j, rows, u)
    alone = [table.distance(*(each[[k]] for each in (i, j, rows, u)))[0] for k in range(count)]
    np.testing.assert_allclose(together, alone, rtol=0, atol=1e-13)
    for name in ("AT_ONCE", "PRODUCTS"):
        monkeypatch.setattr(interval_bounds, name, 7)
    np.testing.assert_allclose(table.distance(i, j, rows, u), together, rtol=0, atol=1e-13)


SLACK = 1e-4
"""Metres by which the margins of the proofs are below the distances, and those of the forgeries above them."""


@pytest.mark.parametrize("kinds", ["rprpr", "rrrr", "ppp"])
@pytest.mark.parametrize(("off", "cubic"), [(0.0, True), (5e-4, False)])
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
