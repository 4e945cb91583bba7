"""What a proof file describes, in decimal numbers of 70 digits: the oracle for rounding errors of the verifier."""

from __future__ import annotations

from decimal import Decimal, getcontext
from fractions import Fraction
from itertools import pairwise

getcontext().prec = 70

D = Decimal
PI = D("3.14159265358979323846264338327950288419716939937510582097494459230781640628620899")


def sine_cosine(angle: D) -> tuple[D, D]:
    """By Taylor series, after full rotations are removed."""
    angle -= 2 * PI * (angle / (2 * PI)).to_integral_value()
    sums, term = [D(0), D(1)], D(1)
    for k in range(1, 120):
        term *= angle / k
        sums[1 - k % 2] += term if k % 4 < 2 else -term
    return sums[0], sums[1]


def matrix(rows) -> list[list[D]]:
    return [[D(x) for x in row] for row in rows]


def product(a, b):
    return [
        [sum((x * y for x, y in zip(row, column, strict=True)), D(0)) for column in zip(*b, strict=True)] for row in a
    ]


def transform(a, v):
    return [sum((x * y for x, y in zip(row, v, strict=True)), D(0)) for row in a]


def add(*vectors):
    return [sum(entries, D(0)) for entries in zip(*vectors, strict=True)]


def scaled(factor, v):
    return [factor * x for x in v]


def dot(a, b) -> D:
    return sum((x * y for x, y in zip(a, b, strict=True)), D(0))


def length(v) -> D:
    return dot(v, v).sqrt()


def unit(v):
    return scaled(1 / length(v), v)


def cross(a, b):
    return [a[i] * b[j] - a[j] * b[i] for i, j in ((1, 2), (2, 0), (0, 1))]


def transposed(a):
    return [list(column) for column in zip(*a, strict=True)]


def nearest_rotation(a):
    """The orthogonal polar factor, by Newton's iteration."""
    for _ in range(8):
        square = product(transposed(a), a)
        step = [[D("1.5") * (i == j) - square[i][j] / 2 for j in range(3)] for i in range(3)]
        a = product(a, step)
    return a


def about(axis, angle: D):
    """Rodrigues' formula, for each unit vector."""
    sine, cosine = sine_cosine(angle)
    columns = []
    for k in range(3):
        e = [D(int(i == k)) for i in range(3)]
        columns.append(add(scaled(cosine, e), scaled(sine, cross(axis, e)), scaled((1 - cosine) * axis[k], axis)))
    return transposed(columns)


def placed(place):
    rows = matrix(place)
    return nearest_rotation([row[:3] for row in rows]), [row[3] for row in rows]


def frames(document, q: list[D]):
    """Rotation and translation of each joint in the root frame; the last one is the root itself, of index -1."""
    found = []
    root = matrix([[1, 0, 0], [0, 1, 0], [0, 0, 1]]), [D(0)] * 3
    for row in document["joints"]:
        rotation, translation = root if row["parent"] < 0 else found[row["parent"]]
        turn, shift = placed(row["placement"])
        translation, rotation = add(transform(rotation, shift), translation), product(rotation, turn)
        axis, value = unit([D(x) for x in row["axis"]]), D(row["multiplier"]) * q[row["leader"]] + D(row["offset"])
        if row["type"] == "revolute":
            rotation = product(rotation, about(axis, value))
        else:
            translation = add(translation, scaled(value, transform(rotation, axis)))
        found.append((rotation, translation))
    return [*found, root]


def centre_of_ball(document, at, name: str) -> tuple[list[D], D]:
    """Centre in the root frame, and radius, of a body that is a ball."""
    row = next(row for row in document["bodies"] if row["name"] == name)
    (rotation, translation), (turn, shift) = at[row["joint"]], placed(row["placement"])
    point = add(transform(turn, [D(x) for x in row["shape"]["points"][0]]), shift)
    return add(transform(rotation, point), translation), D(row["shape"]["radius"])


def distance_of_balls(document, q: list[D], one: str, other: str) -> D:
    at = frames(document, q)
    (a, r), (b, s) = (centre_of_ball(document, at, name) for name in (one, other))
    return length([x - y for x, y in zip(a, b, strict=True)]) - r - s


def curve_at(document, t: float) -> list[D]:
    """The joint values at a parameter, exact."""
    knots, control = document["curve"]["knots"], document["curve"]["control"]
    k = max(k for k in range(len(knots) - 1) if knots[k] <= t or k == 0)
    u = (Fraction(t) - Fraction(knots[k])) / (Fraction(knots[k + 1]) - Fraction(knots[k]))
    rest = [[Fraction(x) for x in point] for point in control[k]]
    while len(rest) > 1:
        rest = [[(1 - u) * x + u * y for x, y in zip(a, b, strict=True)] for a, b in pairwise(rest)]
    return [D(x.numerator) / D(x.denominator) for x in rest[0]]
