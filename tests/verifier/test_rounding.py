"""Bounds of rounding errors contain the exact values, and nothing is accepted that exceeds the truth by rounding."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass
from decimal import Decimal as D
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pinproof.verifier import IntervalBounds, Proof, rounding, verify
from pinproof.verifier.interval_bounds import _chord_and_bend, _Placed
from pinproof.verifier.parts import Curve, placement, unit_vector
from pinproof.verifier.rounding import (
    MOST_TURNS,
    PI_HALF,
    Near,
    angle_above,
    composed,
    cross,
    dot,
    hypotenuse,
    length,
    rotated,
    rounded,
    sine_cosine,
    weighted,
)

from ..examples import examples
from . import exact
from .test_forged_numbers import slider

ORACLE = D("1e-60")
"""Errors of decimal numbers of 70 digits, for results up to 1e10."""

SEEDS = st.integers(0, 2**32 - 1)


def some(rng: np.random.Generator, *shape: int) -> np.ndarray:
    """Numbers of very different sizes, some of them 0 or denormal."""
    sizes = rng.choice([0.0, 5e-324, 1e-310, 1e-200, 1e-9, 1.0, 1.0, 3.0, 1e6], shape)
    return rng.uniform(-1, 1, shape) * sizes


def decimals(values: np.ndarray) -> list:
    return [decimals(row) if isinstance(row, np.ndarray) else D(float(row)) for row in values]


def shifted(x: Near, rng: np.random.Generator) -> list[D]:
    """Exact numbers or vectors (n, ...) that an array may mean: at a distance of up to its error, in any direction."""
    off = rng.normal(size=x.value.shape)
    norm = np.sqrt((off**2).sum(axis=-1, keepdims=True)) if off.ndim > 1 else np.abs(off)
    off = decimals(off / np.maximum(norm, 1e-300))
    error = D(x.error) * D("0.999999999")

    def moved(value, by):
        return [moved(a, b) for a, b in zip(value, by, strict=True)] if isinstance(value, list) else value + error * by

    return moved(decimals(x.value), off)


def off_by(found: Near, truth: list) -> D:
    """The largest distance of numbers or vectors from the exact ones."""
    worst = D(0)
    for value, true in zip(decimals(found.value), truth, strict=True):
        gap = (
            exact.length([a - b for a, b in zip(value, true, strict=True)])
            if isinstance(value, list)
            else abs(value - true)
        )
        worst = max(worst, gap)
    return worst


@examples(200)
@given(seed=SEEDS)
def test_results_are_as_near_to_the_exact_ones_as_stated(seed: int) -> None:
    rng = np.random.default_rng(seed)
    error = float(rng.choice([0.0, 1e-13, 1e-3]))
    a, b, v, w = (
        Near(some(rng, 4), error),
        Near(some(rng, 4)),
        Near(some(rng, 4, 3), error),
        Near(some(rng, 4, 3), error),
    )
    x, y, p, q = (shifted(each, rng) for each in (a, b, v, w))
    pairs = list(zip(p, q, strict=True))
    cases = {
        "sum": (a + b, [m + n for m, n in zip(x, y, strict=True)]),
        "difference": (v - w, [[m - n for m, n in zip(*pair, strict=True)] for pair in pairs]),
        "product": (a * b, [m * n for m, n in zip(x, y, strict=True)]),
        "multiple": (a[:, None] * v, [exact.scaled(m, n) for m, n in zip(x, p, strict=True)]),
        "dot": (dot(v, w), [exact.dot(*pair) for pair in pairs]),
        "cross": (cross(v, w), [exact.cross(*pair) for pair in pairs]),
        "length": (length(v), [exact.length(each) for each in p]),
        "hypotenuse": (hypotenuse(a, b), [(m * m + n * n).sqrt() for m, n in zip(x, y, strict=True)]),
        "sums": (a.sums(), [sum(x[:k], D(0)) for k in range(5)]),
        "least": (a[None].least(axis=1), [min(x)]),
        "weighted": (
            weighted(a[:, None, None], v[:, None])[0],
            [exact.add(*(exact.scaled(m, n) for m, n in zip(x, p, strict=True)))],
        ),
    }
    for name, (found, truth) in cases.items():
        assert off_by(found, truth) <= D(found.error) + ORACLE, name
        largest = max(exact.length(row) if isinstance(row, list) else abs(row) for row in decimals(found.value))
        assert largest <= D(found.size) * D("1.000000000000001"), name
        if found.value.ndim == 1:
            assert all(
                D(low) <= true <= D(high) for low, true, high in zip(found.lower, truth, found.upper, strict=True)
            ), name


@examples(60)
@given(seed=SEEDS, off=st.sampled_from([0.0, 1e-10, 2e-10]))
def test_placements_and_axes_mean_the_nearest_rotation_and_the_unit_vector(seed: int, off: float) -> None:
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    rows = [
        {"placement": np.column_stack([turn + off * rng.uniform(-1, 1, (3, 3)), some(rng, 3)]).tolist()} for _ in (0, 1)
    ]
    (a, shift), (b, _) = (placement(row, "", 0.0) for row in rows)
    (turn_a, shift_a), (turn_b, _) = (exact.placed(row["placement"]) for row in rows)
    axis = rng.normal(size=3)
    axis = (axis / np.linalg.norm(axis) * (1.0 + off)).tolist()
    found, true_axis = unit_vector({"axis": axis}, "", "axis", 0.0), exact.unit([D(x) for x in axis])
    v = Near(some(rng, 5, 3), 1e-12)
    moved = shifted(v, rng)
    cases = {
        "translation": (shift[None], [shift_a]),
        "axis": (found[None], [true_axis]),
        "rotated": (rotated(a, v), [exact.transform(turn_a, row) for row in moved]),
        "back": (rotated(a, v, back=True), [exact.transform(exact.transposed(turn_a), row) for row in moved]),
        "composed": (
            rotated(composed(a, b), v),
            [exact.transform(exact.product(turn_a, turn_b), row) for row in moved],
        ),
    }
    for name, (result, truth) in cases.items():
        assert off_by(result, truth) <= D(result.error) + ORACLE, name
    entries = [x for row in turn_a for x in row]
    assert exact.length([D(float(x)) - y for x, y in zip(a.value.ravel(), entries, strict=True)]) <= D(a.error) < 1e-14


@examples(300)
@given(
    angle=st.one_of(st.floats(-1.6e6, 1.6e6), st.floats(-10, 10), st.floats(-1e-300, 1e-300)),
    turns=st.integers(-(10**6), 10**6),
)
def test_sines_and_cosines_contain_the_exact_ones(angle: float, turns: int) -> None:
    for x in (angle, turns * math.pi / 2, turns * math.pi / 4, math.nextafter(turns * math.pi / 2, math.inf)):
        found, truth = sine_cosine(Near(np.array([x]))), exact.sine_cosine(D(x))
        for each, true in zip(found, truth, strict=True):
            assert abs(D(float(each.value[0])) - true) <= D(each.error)
            assert each.error < 1e-15


def test_an_angle_whose_full_rotations_are_not_exact_is_not_known() -> None:
    assert abs(sum(map(Fraction, PI_HALF)) - Fraction(exact.PI) / 2) < Fraction(1, 10**36)
    for part in PI_HALF[:2]:
        assert Fraction(part) * (MOST_TURNS - 1) == Fraction(part * (MOST_TURNS - 1))
    sine, cosine = sine_cosine(Near(np.array([0.5, 2.0 * MOST_TURNS])))
    assert sine.error == cosine.error == 2.0


@examples(300)
@given(y=st.one_of(st.floats(0, 1e6), st.floats(0, 1e-8)), x=st.one_of(st.floats(-1, 1e6), st.floats(0, 1e-8)))
def test_an_angle_is_above_that_of_its_tangent(y: float, x: float) -> None:
    (angle,) = angle_above(np.array([y]), np.array([x]))
    if not np.isfinite(angle):
        assert x < 1e-300
        return
    sine, cosine = exact.sine_cosine(D(float(angle)))
    assert sine * D(x) >= cosine * D(y)
    assert angle <= math.atan2(y, x) + 1e-14


def ball(name: str, kind: str, joint: int, place: np.ndarray, radius: float) -> dict:
    shape = {"points": [[0.0, 0.0, 0.0]], "disc_radii": [0.0], "radius": radius, "semi_axes": [0.0, 0.0, 0.0]}
    row = {"name": name, "owner": name, "kind": kind, "geometry": name, "level": 0, "joint": joint}
    return {**row, "placement": place.tolist(), "shape": shape, "sha256": ""}


def chain(rng: np.random.Generator, joints: int, size: float, rail: float, turns: float) -> dict:
    """A chain of joints with balls at its end and in the middle, a ball in the scene, and a curve of two pieces."""

    def place(reach: float) -> np.ndarray:
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn = turn * np.sign(np.linalg.det(turn)) + 2e-10 * rng.uniform(-1, 1, (3, 3))
        return np.column_stack([turn, reach * rng.normal(size=3)])

    rows = []
    for k in range(joints):
        axis = rng.normal(size=3)
        row = {"name": f"joint {k}", "type": "prismatic" if k == 0 and rail else "revolute", "parent": k - 1}
        row |= {"axis": (axis / np.linalg.norm(axis)).tolist(), "placement": place(size).tolist()}
        rows.append({**row, "leader": k, "multiplier": float(rng.choice([1.0, -0.7])), "offset": float(rng.normal())})
    reach = np.full(joints, turns)
    reach[0] = rail or turns
    control = np.repeat(rng.uniform(-1, 1, (1, joints)) * reach, 8, axis=0).reshape(2, 4, joints)
    control = control + rng.uniform(-0.02, 0.02, control.shape)
    control[1, 0] = control[0, -1]
    bodies = [
        ball("hand", "link", joints - 1, place(size), 0.01 * size),
        ball("elbow", "link", joints // 2, place(size), 0.0),
    ]
    bodies.append(ball("post", "obstacle", -1, place(5.0 * size), 0.02 * size))
    begin = float(rng.choice([0.0, -3.0, 1e6]))
    document = slider(lambda each: each, 0.5, [], control.tolist(), (begin, begin + 0.3, begin + 1.0))
    document["curve"]["joint_names"] = [f"joint {k}" for k in range(joints)]
    document["settings"]["joint_tolerance"] = [0.0] * joints
    return {**document, "joints": rows, "bodies": bodies, "intervals": [], "pairs": []}


@pytest.mark.slow
@examples(25)
@given(
    seed=SEEDS,
    joints=st.sampled_from([1, 2, 5, 8]),
    size=st.sampled_from([1e-9, 0.3, 1.0, 1e4]),
    rail=st.sampled_from([0.0, 0.0, 1e3, 9e5]),
    turns=st.sampled_from([0.1, 3.0, 1e3, 1e6]),
)
def test_a_bound_is_below_the_exact_distance(rehashed, seed, joints, size, rail, turns) -> None:
    """Along the line of the centres, at one parameter the bound is as large as the distance, except for rounding."""
    rng = np.random.default_rng(seed)
    document = rehashed(chain(rng, joints, size, rail, turns))
    proof = Proof(document)
    pairs = [(0, 2), (1, 2)] + ([(0, 1)] if joints > 1 else [])
    low, high = document["curve"]["knots"][::2]
    t = float(rng.uniform(low, high))
    spans = np.array([[t, t], [t, min(high, t + 1e-3)], [low, t]])
    for i, j in pairs:
        names = [document["bodies"][k]["name"] for k in (i, j)]
        q = exact.curve_at(document, t)
        at = exact.frames(document, q)
        a, b = (exact.centre_of_ball(document, at, name)[0] for name in names)
        u = np.array([float(x) for x in exact.unit([y - x for x, y in zip(a, b, strict=True)])])
        bounds = IntervalBounds(proof, spans)
        found = bounds.distance(np.full(3, i), np.full(3, j), np.arange(3), np.tile(u, (3, 1)))
        distance = exact.distance_of_balls(document, q, *names)
        assert all(D(float(bound)) <= distance for bound in found)
        alone = IntervalBounds(proof, spans[:1]).distance(np.array([i]), np.array([j]), np.array([0]), u[None])[0]
        slack = 1e-13 + 1e-10 * (size + rail + size * turns)
        assert D(float(alone)) >= distance - D(slack) * (joints + 1)
        for row in (1, 2):
            for s in rng.uniform(*spans[row], 2):
                assert D(float(found[row])) <= exact.distance_of_balls(
                    document, exact.curve_at(document, float(s)), *names
                )


def test_without_its_errors_a_bound_would_exceed_the_exact_distance(rehashed, monkeypatch) -> None:
    """The check above can fail."""
    monkeypatch.setattr(Near, "lower", property(lambda each: each.value))
    above = 0
    for seed in range(30):
        document = rehashed(chain(np.random.default_rng(seed), 8, 1.0, 1e3, 3.0))
        at = exact.frames(document, exact.curve_at(document, document["curve"]["knots"][0]))
        a, b = (exact.centre_of_ball(document, at, name)[0] for name in ("hand", "post"))
        u = np.array([float(x) for x in exact.unit([y - x for x, y in zip(a, b, strict=True)])])
        bounds = IntervalBounds(Proof(document), np.full((1, 2), document["curve"]["knots"][0]))
        found = bounds.distance(np.array([0]), np.array([2]), np.array([0]), u[None])[0]
        q = exact.curve_at(document, document["curve"]["knots"][0])
        above += D(float(found)) > exact.distance_of_balls(document, q, "hand", "post")
    assert above > 3


@examples(60)
@given(seed=SEEDS, within=st.sampled_from([1e-10, 1e-13]))
def test_placements_and_axes_change_by_no_more_than_stated_if_all_their_numbers_change(
    seed: int, within: float
) -> None:
    rng = np.random.default_rng(seed)
    place, axis = np.array(exact_place(rng)), rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    row, signs = {"placement": place.tolist(), "axis": axis.tolist()}, rng.choice([-1.0, 1.0], (4, 4))
    rotation, translation = placement(row, "", within)
    found = unit_vector(row, "", "axis", within)
    by = D(within)
    moved = [
        [D(x) + D(s) * by for x, s in zip(*each, strict=True)] for each in zip(place.tolist(), signs[:3], strict=True)
    ]
    turn, shift = exact.nearest_rotation([row[:3] for row in moved]), [row[3] for row in moved]
    entries = [D(float(x)) - y for x, y in zip(rotation.value.ravel(), [y for row in turn for y in row], strict=True)]
    assert exact.length(entries) <= D(rotation.error) < 5 * D(within)
    assert D(within) < off_by(translation[None], [shift]) <= D(translation.error)
    other = exact.unit([D(x) + D(s) * by for x, s in zip(axis.tolist(), signs[3, :3], strict=True)])
    assert off_by(found[None], [other]) <= D(found.error) < 5 * D(within)


def exact_place(rng: np.random.Generator) -> np.ndarray:
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return np.column_stack([turn * np.sign(np.linalg.det(turn)), rng.normal(size=3)])


@pytest.mark.parametrize("error", [1e-3, 1e-9])
def test_a_rotation_that_is_not_known_exactly_moves_vectors_by_its_error(error: float) -> None:
    """The exact one turns by this angle more, about an axis across the vector."""
    turn, v = Near(np.eye(3), error), Near(np.array([[0.0, 0.0, 5.0]]))
    truth = exact.transform(exact.about([D(1), D(0), D(0)], D(error)), [D(0), D(0), D(5)])
    assert (
        D(4.9 * error) < off_by(rotated(turn, v), [truth]) <= D(rotated(turn, v).error) < D(5.1 * math.sqrt(3) * error)
    )


@pytest.mark.parametrize("error", [1e-3, 1e-9])
def test_a_support_changes_by_the_error_of_its_direction_times_the_farthest_point(rehashed, error: float) -> None:
    document = slider(rehashed, 0.5, [(1.0, 0.0, 0.0)], [[[0.0], [0.0]]], (0.0, 0.0))
    document["bodies"][0]["shape"]["points"] = [[5.0, 0.0, 0.0]]
    for within, lost in ((0.0, 4.9 * error), (error, 6.5 * error)):
        bounds = IntervalBounds(Proof(rehashed(document), within), np.zeros((1, 2)))
        placed = _Placed(bounds, np.array([0]), np.array([0]))
        found = placed.reach(Near(np.array([[[0.6, 0.8, 0.0]]]), error))
        # The direction is longer by its error along the point, which is farther away, as is the surface of the ball.
        truth = (0.6 + error) * (5.0 + within) + (0.01 + within) * math.hypot(0.6 + error, 0.8)
        assert lost < truth - found.value[0, 0] <= found.error


@pytest.mark.slow
@examples(12)
@given(seed=SEEDS, joints=st.sampled_from([1, 3, 8]), rail=st.sampled_from([0.0, 10.0]))
def test_a_bound_holds_for_all_numbers_within_the_stated_distance_of_those_in_the_file(rehashed, seed, joints, rail):
    """Each number is moved by this distance or left, at random."""
    rng, within = np.random.default_rng(seed), float(np.random.default_rng(seed).choice([1e-5, 1e-9]))
    document = rehashed(chain(rng, joints, 1.0, rail, 1.0))
    low, high = document["curve"]["knots"][::2]
    t = float(rng.uniform(low, high))

    def moved(value):
        if isinstance(value, list):
            return [moved(each) for each in value]
        return value + float(rng.choice([-0.999, 0.0, 0.999])) * within

    keys = ("axis", "placement", "multiplier", "offset")
    for _ in range(6):
        other = copy.deepcopy(document)
        for row in other["joints"]:
            row.update({key: moved(row[key]) for key in keys})
        for row in other["bodies"]:
            row.update(placement=moved(row["placement"]))
            row["shape"].update(points=moved(row["shape"]["points"]), radius=moved(row["shape"]["radius"]))
        other["curve"]["control"] = moved(other["curve"]["control"])
        q = exact.curve_at(other, t)
        at = exact.frames(other, q)
        for i, j in [(0, 2), (1, 2)] + ([(0, 1)] if joints > 1 else []):
            names = [document["bodies"][k]["name"] for k in (i, j)]
            a, b = (exact.centre_of_ball(other, at, name)[0] for name in names)
            u = np.array([float(x) for x in exact.unit([y - x for x, y in zip(a, b, strict=True)])])
            span = np.array([[t, t]])
            rough = IntervalBounds(Proof(document, within), span)
            found = rough.distance(np.array([i]), np.array([j]), np.array([0]), u[None])[0]
            assert D(float(found)) <= exact.distance_of_balls(other, q, *names)


@examples(60)
@given(seed=SEEDS, degree=st.integers(0, 6))
def test_control_points_and_boxes_of_intervals_contain_the_exact_ones(seed: int, degree: int) -> None:
    rng = np.random.default_rng(seed)
    begin = float(rng.choice([0.0, -0.3, 1e9]))
    knots = (begin, begin + float(rng.choice([0.1, 0.7])))
    control = rng.uniform(-1, 1, (1, degree + 1, 2)) * rng.choice([1.0, 1e4])
    curve = Curve({"joint_names": ["a", "b"], "knots": list(knots), "control": control.tolist()})
    ends = np.sort(rng.uniform(*knots, (4, 2)), axis=1)
    table = IntervalBounds(Bare(curve), ends)
    for row, (start, end) in enumerate(ends.tolist()):
        u = [(Fraction(t) - Fraction(knots[0])) / (Fraction(knots[1]) - Fraction(knots[0])) for t in (start, end)]
        for r in range(degree + 1):
            rest = [[Fraction(x) for x in point] for point in control[0].tolist()]
            for level in range(degree):
                v = u[1] if level < r else u[0]
                rest = [[(1 - v) * x + v * y for x, y in zip(a, b, strict=True)] for a, b in pairwise(rest)]
            for k in range(2):
                off = rest[0][k] - Fraction(float(table.q[row, k]))
                assert abs(Fraction(float(table.theta.value[row, r, k])) - off) <= Fraction(table.theta.error)
                assert abs(off) <= Fraction(float(table.half_width[row, k]))
    assert table.theta.error <= 1e-14 * (degree + 1) * np.abs(control).max()


@dataclass
class Bare:
    """A mechanism without joints and bodies."""

    curve: Curve
    joints: tuple = ()
    bodies: tuple = ()
    within: float = 0.0


@examples(200)
@given(delta=st.one_of(st.floats(0, 12), st.floats(0, 1e-3), st.floats(3.1, 3.2)))
def test_chords_and_second_order_terms_are_not_exceeded_by_any_smaller_angle(delta: float) -> None:
    chord, bend = _chord_and_bend(Near(np.array([delta])), np.array(True))
    for share in ("1", "0.999999", "0.7", "0.3"):
        theta = D(delta) * D(share)
        sine, cosine = exact.sine_cosine(theta)
        assert D(float(chord.upper[0])) >= exact.length([sine, 1 - cosine])
        assert D(float(bend.upper[0])) >= exact.length([theta - sine, 1 - cosine])
    assert D(float(chord.lower[0])) <= 2 * exact.sine_cosine(min(D(delta), exact.PI) / 2)[0]


def with_clearance(document: dict, clearance: float) -> bool:
    return verify({**document, "claim": {"status": "FREE", "clearance": clearance}}).ok


@pytest.mark.parametrize("place", [0.4, 0.3333, 1e-9, 0.479999])
def test_a_claim_that_exceeds_the_truth_by_one_digit_is_refused(rehashed, place) -> None:
    """The true clearance is a sum of the doubles in the file; what is 1e-14 below it is proven."""
    document = slider(rehashed, 0.5, [(1.0, 0.0, 0.0)], [[[0.0], [place]]])
    truth = Fraction(0.5) - Fraction(place) - 2 * Fraction(0.01)
    for above in (1e-15, 1e-14, 1e-12):
        assert not with_clearance(document, float(truth) + above)
    assert not with_clearance(document, math.nextafter(float(truth), math.inf))
    assert with_clearance(document, float(truth) - 1e-13)
    settings = {**document["settings"], "margin": 0.0, "obstacle_tolerance": float(truth) + 1e-15}
    assert not verify({**document, "settings": settings}).ok


def test_a_margin_and_a_tolerance_are_not_rounded_down(rehashed) -> None:
    """Their sum is between two doubles; the distance is the lower of the two."""
    document = slider(rehashed, 1.0, [(1.0, 0.0, 0.0)], [[[0.0], [0.0]]], (0.0, 0.0))
    proof = Proof(document)
    proof.margin, proof.obstacle_tolerance = 1.0, 2.0**-54
    assert Fraction(proof.required(0, 1)) >= 1 + Fraction(2) ** -54


@pytest.mark.parametrize("value", ["1e308", "-1e308", "1e155"])
def test_numbers_whose_products_overflow_are_refused_wherever_they_are(rehashed, value) -> None:
    for change in ("control", "offset", "obstacle", "margin", "direction"):
        document = slider(rehashed, 0.5, [(1.0, 0.0, 0.0)], [[[0.0], [0.4]]])
        holder, key = {
            "control": (document["curve"]["control"][0][1], 0),
            "offset": (document["joints"][0], "offset"),
            "obstacle": (document["bodies"][1]["placement"][0], 3),
            "margin": (document["settings"], "margin"),
            "direction": (document["pairs"][0]["directions"][0], 0),
        }[change]
        holder[key] = float(value)
        assert not verify(rehashed(document)).ok, change


def test_an_overflow_is_never_a_proof() -> None:
    huge = Near(np.array([1e308, -1e308]))
    with np.errstate(over="ignore", invalid="ignore"):
        product = huge * huge
        results = (product, product - product, product.sums(), rounding.choose(np.array(True), product, huge))
        assert not any((found.lower > -np.inf).any() for found in results)
    assert not (rounded(np.zeros(2), np.nan, 1).lower > -np.inf).any()


def test_a_thousand_joints_that_lose_all_digits_prove_nothing(rehashed) -> None:
    """Angles of 1e12 rad, whose sines are not known."""
    document = slider(rehashed, 5.0, [(1e6, 0.0, 0.0)] * 1000, [[[1e6], [1e6]]])
    for row in document["joints"]:
        row["type"] = "revolute"
    assert not verify(rehashed(document)).ok
