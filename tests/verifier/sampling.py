"""What a proof file states, checked by samples: plain products of matrices, Bernstein polynomials and coal.

It shares no code with the verifier.
"""

from __future__ import annotations

from math import comb

import coal
import numpy as np

from pinproof.collision.geometry.hulls import hull_of_any

SLACK = 2e-6
"""Metres: coal's GJK distances are off by less."""

FLAT = 1e-5
"""Metres by which points without volume are grown, since coal needs a solid."""


class Solid:
    """A subset of a body for coal, so that its distances are never too small by more than FLAT, and a radius."""

    def __init__(self, shape) -> None:
        self.radius, self.grown = 0.0, 0.0
        if shape == "half_space":
            self.geometry = coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
            return
        points, discs = np.array(shape["points"], dtype=float), np.array(shape["disc_radii"], dtype=float)
        semi, self.radius = np.array(shape["semi_axes"], dtype=float), float(shape["radius"])
        if discs.any():
            angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
            circle = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
            points = (points[:, None] + discs[:, None, None] * circle).reshape(-1, 3)
        if semi.any():
            ball = np.random.default_rng(0).normal(size=(60, 3))
            ball = np.concatenate([ball / np.linalg.norm(ball, axis=1)[:, None], np.eye(3), -np.eye(3)])
            points = (points[:, None] + semi * ball).reshape(-1, 3)
        if len(points) == 1:
            points, self.grown = points + FLAT * np.concatenate([np.eye(3), -np.eye(3)]), FLAT
        elif np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[-1] < FLAT:
            star = FLAT * np.concatenate([np.eye(3), -np.eye(3)])
            points, self.grown = (points[:, None] + star).reshape(-1, 3), FLAT
        self.geometry = hull_of_any(points)


class Samples:
    """Distances of all bodies that a proof file must separate, sampled over its own motion."""

    def __init__(self, document) -> None:
        self.document = document
        bodies = document["bodies"]
        excluded = {frozenset(row[:2]) for row in document["excluded"]}
        self.wanted: dict[tuple[str, str], list[tuple[int, int]]] = {}
        for i, a in enumerate(bodies):
            for j, b in enumerate(bodies):
                free = a["owner"] == b["owner"] or frozenset((a["owner"], b["owner"])) in excluded
                if not free and a["kind"] != "obstacle" and (b["kind"] == "obstacle" or i < j):
                    self.wanted.setdefault((a["owner"], b["owner"]), []).append((i, j))
        met = {i for pairs in self.wanted.values() for pair in pairs for i in pair}
        self.solids = {i: Solid(bodies[i]["shape"]) for i in met}
        self.tolerance = np.array(document["settings"]["joint_tolerance"], dtype=float)

    def configurations(self, count, rng):
        for piece in np.array(self.document["curve"]["control"], dtype=float):
            degree = len(piece) - 1
            for u in np.linspace(0, 1, count):
                weights = [comb(degree, r) * u**r * (1 - u) ** (degree - r) for r in range(degree + 1)]
                yield np.array(weights) @ piece + self.tolerance * rng.choice([-1.0, 0.0, 1.0], len(self.tolerance))

    def placements(self, q):
        frames = []
        for row in self.document["joints"]:
            above = np.eye(4) if row["parent"] < 0 else frames[row["parent"]]
            value = row["multiplier"] * q[row["leader"]] + row["offset"]
            move, axis = np.eye(4), np.array(row["axis"], dtype=float)
            if row["type"] == "prismatic":
                move[:3, 3] = value * axis
            else:
                x, y, z = axis
                skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
                move[:3, :3] += np.sin(value) * skew + (1 - np.cos(value)) * skew @ skew
            frames.append(above @ np.vstack([row["placement"], [0, 0, 0, 1]]) @ move)
        bodies = self.document["bodies"]
        return {
            i: (np.eye(4) if bodies[i]["joint"] < 0 else frames[bodies[i]["joint"]])
            @ np.vstack([bodies[i]["placement"], [0, 0, 0, 1]])
            for i in self.solids
        }

    def violation(self, clearance, count=25):
        """The first configuration and owners nearer than the margin or the proven clearance, or None."""
        settings, bodies = self.document["settings"], self.document["bodies"]
        margins: dict[frozenset[str], float] = {}
        for one, other, margin in settings["margins"]:  # of several the largest is what a reader may rely on
            margins[frozenset((one, other))] = max(margin, margins.get(frozenset((one, other)), margin))
        for q in self.configurations(count, np.random.default_rng(0)):
            places = {i: coal.Transform3s(at[:3, :3], at[:3, 3]) for i, at in self.placements(q).items()}
            for owners, pairs in self.wanted.items():
                levels: dict[tuple[str, int, str, int], float] = {}
                for i, j in pairs:
                    a, b = bodies[i], bodies[j]
                    key = (a["geometry"], a["level"], b["geometry"], b["level"])
                    levels[key] = min(levels.get(key, np.inf), self.distance(i, j, places))
                geometries: dict[tuple[str, str], float] = {}
                for (one, _, other, _), distance in levels.items():
                    geometries[one, other] = max(geometries.get((one, other), -np.inf), distance)
                tolerance = settings["obstacle_tolerance"] if bodies[pairs[0][1]]["kind"] == "obstacle" else 0.0
                required = max(margins.get(frozenset(owners), settings["margin"]), clearance)
                if min(geometries.values()) - tolerance < required - SLACK:
                    return q, owners, min(geometries.values()), required
        return None

    def distance(self, i, j, places):
        a, b, result = self.solids[i], self.solids[j], coal.DistanceResult()
        found = coal.distance(a.geometry, places[i], b.geometry, places[j], coal.DistanceRequest(), result)
        return found - a.radius - b.radius + a.grown + b.grown
