"""Proofs of small cells, random forgeries of them with valid hashes, and samples of what a proof file states."""

from __future__ import annotations

import copy
from math import comb

import coal
import numpy as np
import trimesh

import pinproof as pp
from pinproof.collision.certificates.proof_file import proof_document
from pinproof.collision.geometry.hulls import bvh, hull_of_any, winding_number
from pinproof.model import load_robot
from pinproof.motion import CubicPath
from pinproof.verifier import body_digest, curve_digest

from ..collision.conftest import urdf_of

SPECIAL = [0, 0.0, -0.0, 1, -1, 2, True, None, "1", "", [], {}, [0.0], float("nan"), float("inf"), -float("inf"),
           5e-324, -5e-324, 2.2e-308, 1e-300, 1e-17, 1e-9, 1e6, -1e6, 1e12, 1e308, 2**31, 2**53 + 1, -(2**63),
           2**63, 10**30, np.pi, 2 * np.pi, 1e3]  # fmt: skip


# -- proofs --------------------------------------------------------------------------------------------------------


def robot(name, joints):
    """A chain of (kind, axis, xyz of the joint, collision geometry behind it, extra elements)."""
    links = {"base": "", **{f"link{k}": shape for k, (_, _, _, shape, _) in enumerate(joints)}}
    parents = list(links)
    rows = [
        (f"joint{k}", kind, parents[k], f"link{k}", xyz, axis, extra)
        for k, (kind, axis, xyz, _, extra) in enumerate(joints)
    ]
    return load_robot(urdf_of(links, rows, name=name)).arm(tcp=parents[-1])


def box(size, xyz="0 0 0"):
    return f'<box size="{size}"/>@{xyz}'


def proven(arm, scene, curve, **settings):
    checker = pp.CollisionChecker(arm, scene, margin=0.002, margins=settings.pop("margins", None) or {})
    certificate = pp.certify(curve, checker, record=True, **settings).or_raise()
    return proof_document(certificate, curve, checker)


def small_proofs():
    """Proofs of four robots among obstacles of every convex shape, with and without a tube."""
    slider = robot("slider", [("prismatic", "1 0 0", "0 0 0", box("0.1 0.1 0.1"), "")])
    wall = pp.Scene([pp.Obstacle("wall", pp.Box(0.1, 1, 1), pp.pose((0.5, 0, 0)))])
    yield proven(slider, wall, pp.JointPath([[0.0], [0.2], [0.1]], slider.joint_names))
    planar = robot(
        "planar",
        [
            ("revolute", "0 0 1", "0 0 0", box("0.4 0.04 0.04", "0.2 0 0"), ""),
            ("revolute", "0 0 1", "0.4 0 0.06", box("0.3 0.04 0.04", "0.15 0 0"), ""),
        ],
    )
    around = pp.Scene(
        [
            pp.Obstacle("can", pp.Cylinder(0.05, 0.3), pp.pose((0.55, 0.45, 0.0))),
            pp.Obstacle("pill", pp.Capsule(0.04, 0.2), pp.pose((-0.1, 0.4, 0.0), (0.4, 0, 0))),
            pp.Obstacle("floor", pp.HalfSpace(), pp.pose((0, 0, -0.1))),
        ]
    )
    curve = CubicPath(
        [[-0.6, 0.2], [0.0, 0.4], [0.2, 0.1]], [[0.3, 0], [0.3, 0], [0, 0]], [0.0, 1.0, 2.5], planar.joint_names
    )
    yield proven(planar, around, curve, joint_tolerance=1e-3, obstacle_tolerance=2e-3)
    mixed = robot(
        "mixed",
        [
            ("revolute", "0 1 0", "0 0 0", box("0.05 0.05 0.3", "0 0 0.2"), ""),
            ("prismatic", "0 0 1", "0 0 0.4", box("0.04 0.04 0.2", "0 0.05 0.1"), ""),
            ("revolute", "0.6 0 0.8", "0 0 0.2", '<sphere radius="0.05"/>', ""),
            ("prismatic", "1 0 0", "0 0 0.1", box("0.02 0.1 0.02"), '<mimic joint="joint1" multiplier="-0.5"/>'),
        ],
    )
    scene = pp.Scene(
        [
            pp.Obstacle("egg", pp.collision.Ellipsoid(0.05, 0.1, 0.08), pp.pose((0.5, 0.2, 0.6), (0.3, 0.1, 0))),
            pp.Obstacle("tip", pp.collision.Cone(0.1, 0.2), pp.pose((-0.3, 0.0, 0.6))),
        ]
    )
    waypoints = [[0.1, 0.0, 0.0], [0.3, 0.05, 0.7], [0.2, 0.0, 1.0]]
    yield proven(mixed, scene, pp.JointPath(waypoints, mixed.joint_names), margins={("link2", "egg"): 0.004})
    still = pp.JointPath(waypoints[:1], mixed.joint_names)
    yield proven(mixed, scene, still, obstacle_tolerance=1e-3)
    yield mesh_proof()
    arm = pp.load_robot("generic_6dof").arm()
    shelf = pp.Scene([pp.Obstacle("board", pp.Box(0.4, 0.4, 0.02), pp.pose((0.9, 0.5, 0.2)))])
    yield proven(arm, shelf, pp.JointPath([arm.home, arm.home + 0.05], arm.joint_names))


def torus(radius, tube, count=12):
    mesh = trimesh.creation.torus(radius, tube, count, 8)
    return pp.Mesh.from_arrays(mesh.vertices, mesh.faces, hull=False)


def mesh_proof():
    """A ring on a slide that moves sideways above a bar through a ring, and turns."""
    arm = robot(
        "ringed",
        [
            ("prismatic", "1 0 0", "0 0 0.3", box("0.02 0.02 0.02"), ""),
            ("revolute", "0 0 1", "0 0 0", box("0.02 0.02 0.02", "0 0 0.1"), ""),
        ],
    )
    scene = pp.Scene(
        [
            pp.Obstacle("ring", torus(0.3, 0.05), pp.pose((0.2, 0, 0))),
            pp.Obstacle("bar", pp.Box(0.04, 0.04, 0.3), pp.pose((0.45, 0.06, 0.2))),
            pp.Obstacle("floor", pp.HalfSpace(), pp.pose((0, 0, -0.2))),
        ]
    )
    held = [
        pp.Obstacle("held", torus(0.05, 0.02), pp.pose((0, 0, -0.3))),
        pp.Obstacle("pin", pp.Box(0.02, 0.02, 0.1), pp.pose((0, 0, -0.15))),
    ]
    checker = pp.CollisionChecker(arm, scene, margin=0.002, attached=held)
    curve = pp.JointPath([[0.2, 0.0], [0.36, 0.6]], arm.joint_names)
    return proof_document(pp.certify(curve, checker, record=True).or_raise(), curve, checker)


# -- forgeries -----------------------------------------------------------------------------------------------------


def places(value, line=()):
    """The places of all values in a document."""
    if line:
        yield line
    entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, part in entries:
        yield from places(part, (*line, key))


def pick(rng, rows):
    return rows[int(rng.integers(len(rows)))]


def holder_of(document, line):
    for key in line[:-1]:
        document = document[key]
    return document


PARTS = ["claim", "settings", "curve", "joints", "bodies", "excluded", "intervals", "pairs"]


def one_place(document, rng):
    part = pick(rng, PARTS)
    return pick(rng, list(places(document[part], (part,))))


def other_number(document, rng):
    for _ in range(20):
        line = one_place(document, rng)
        holder = holder_of(document, line)
        value = holder[line[-1]]
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            size = 10.0 ** rng.uniform(-13, 1)
            factor = pick(rng, [1.0, 1.0, 0.0, -1.0, 0.5, 2.0, 0.9, 1e-3, 1e3, 1e-300, 1e6])
            whole = isinstance(value, int)
            holder[line[-1]] = (
                value + int(rng.integers(-2, 3)) if whole else value * factor + size * rng.normal() * (factor == 1)
            )
            return


def special_value(document, rng):
    line = one_place(document, rng)
    holder_of(document, line)[line[-1]] = copy.deepcopy(pick(rng, SPECIAL))


def other_entries(document, rng):
    """An entry of a list is dropped, repeated, or exchanged with another."""
    for _ in range(20):
        line = one_place(document, rng)
        holder, kind = holder_of(document, line), rng.integers(3)
        if isinstance(holder, list):
            if kind == 0:
                del holder[line[-1]]
            elif kind == 1:
                holder.insert(line[-1], copy.deepcopy(holder[line[-1]]))
            else:
                other = int(rng.integers(len(holder)))
                holder[line[-1]], holder[other] = holder[other], holder[line[-1]]
            return


def insert_motion(document, rng):
    """A motion away and back within narrow pieces at a knot."""
    knots, control = document["curve"]["knots"], document["curve"]["control"]
    k = int(rng.integers(len(control)))
    here, width = control[k][-1], pick(rng, [0.0, 5e-324, 1e-310, 1e-300, 1e-100, 1e-12, 1e-9, 1e-7, 1e-5, 1e-3])
    away = (np.array(here) + 10.0 ** rng.uniform(-12, 0.5) * rng.normal(size=len(here))).tolist()
    count = len(control[k])
    line = [(np.array(here) + s * (np.array(away) - here)).tolist() for s in np.linspace(0, 1, count)]
    control[k + 1 : k + 1] = [line, line[::-1]] if rng.random() < 0.7 else [line]
    at = knots[k + 1]
    inserted = [at + width, at + 2 * width][: len(control) + 1 - len(knots)]
    knots[k + 2 : k + 2] = inserted
    if rng.random() < 0.5:
        knots[k + 2 + len(inserted) :] = [t + len(inserted) * width for t in knots[k + 2 + len(inserted) :]]


def squeeze_curve(document, rng):
    """The curve and its evidence compressed to almost no width, with another motion in the rest."""
    curve, width = document["curve"], pick(rng, [5e-324, 1e-310, 1e-300, 1e-100, 1e-12, 1e-9])
    low, high = curve["knots"][0], curve["knots"][-1]
    pieces = len(curve["control"])
    curve["knots"] = [k * width for k in range(pieces + 1)]
    document["intervals"] = [
        [pieces * width * min(max((t - low) / (high - low), 0.0), 1.0) for t in span] for span in document["intervals"]
    ]
    if rng.random() < 0.5:
        one_wide_interval(document, rng)
    bend_curve(document, rng)


def absorb_motion(document, rng):
    """A joint value so large that the motion is lost in its rounding, undone by an equal and opposite one or not."""
    joint = pick(rng, document["joints"])
    joint[pick(rng, ["offset", "multiplier"])] = pick(rng, [-(2**63), 2**63, -(2**63) + 1, 1e6, -1e6, 1e16, 1e300])
    bend_curve(document, rng)


def bend_curve(document, rng):
    control = document["curve"]["control"]
    k, r = int(rng.integers(len(control))), int(rng.integers(len(control[0])))
    change = 10.0 ** rng.uniform(-6, 0.5) * rng.normal(size=len(control[0][0]))
    control[k][r] = (np.array(control[k][r]) + change).tolist()
    if r == 0 and k:
        control[k - 1][-1] = list(control[k][r])
    if r == len(control[0]) - 1 and k + 1 < len(control):
        control[k + 1][0] = list(control[k][r])


def one_wide_interval(document, rng):
    """Replaces the evidence of all pairs by a single interval, the first direction of each kept."""
    knots = document["curve"]["knots"]
    document["intervals"] = [[knots[0], knots[-1]]]
    for pair in document["pairs"]:
        if "parts" in pair:
            pair["intervals"] = [0 for _ in pair["intervals"]]
        else:
            pair["intervals"], pair["directions"] = [0], pair["directions"][:1]


def cut_intervals(document, rng):
    """Cuts every interval in two, so that the evidence covers changes of the curve more closely."""
    halves = []
    for a, b in document["intervals"]:
        halves += [[a, (a + b) / 2], [(a + b) / 2, b]]
    document["intervals"] = halves
    for pair in document["pairs"]:
        pair["intervals"] = [2 * k + side for k in pair["intervals"] for side in (0, 1)]
        for key in ("directions", "parts"):
            if key in pair:
                pair[key] = [list(row) for row in pair[key] for _ in (0, 1)]


def change_parts(document, rng):
    """Widens a part of a mesh, drops one or several with their directions, or uses one direction for others."""
    pair = pick(rng, [pair for pair in document["pairs"] if "parts" in pair])
    k, kind = int(rng.integers(len(pair["parts"]))), rng.integers(4)
    if kind == 0:
        pair["parts"][k][int(rng.integers(len(pair["parts"][k])))] += int(rng.integers(-3, 4))
    elif kind == 1:
        pair["parts"][k] = [min(row[i] if i % 2 == 0 else -row[i] for row in pair["parts"]) * (1 - i % 2 * 2)
                            for i in range(len(pair["parts"][k]))]  # fmt: skip
    elif kind == 2:
        for key in ("intervals", "directions", "parts"):
            del pair[key][k]
    else:
        pair["directions"] = [pair["directions"][k] for _ in pair["directions"]]


def change_mesh(document, rng):
    """Moves vertices, drops or turns triangles, fills or empties a mesh."""
    shape = pick(rng, [body["shape"] for body in document["bodies"] if "triangles" in (body["shape"] or "")])
    kind = rng.integers(4)
    if kind == 0:
        shape["vertices"] = (np.array(shape["vertices"]) * pick(rng, [0.5, 0.9, 0.99, 1.01, 1.1, 2.0])).tolist()
    elif kind == 1:
        for _ in range(int(rng.integers(1, 5))):
            k = int(rng.integers(len(shape["vertices"])))
            shape["vertices"][k] = (np.array(shape["vertices"][k]) + 0.02 * rng.normal(size=3)).tolist()
    elif kind == 2:
        k = int(rng.integers(len(shape["triangles"])))
        shape["triangles"][k] = pick(rng, [shape["triangles"][k][::-1], shape["triangles"][k - 1], [0, 0, 0]])
    else:
        shape["solid"] = pick(rng, [True, False, 1, None])


def move_body(document, rng):
    place = pick(rng, document["bodies"])["placement"]
    for axis in range(3):
        place[axis][3] += 10.0 ** rng.uniform(-4, 0) * rng.normal()


def change_shape(document, rng):
    body = pick(rng, document["bodies"])
    shape = body["shape"]
    if isinstance(shape, dict) and rng.random() < 0.8:
        key = pick(rng, ["points", "disc_radii", "radius", "semi_axes"])
        factor = pick(rng, [0.0, 0.5, 0.9, 1.1, 1.5, 3.0])
        shape[key] = (np.array(shape[key]) * factor + (rng.random() < 0.3) * 0.02 * rng.random()).tolist()
    else:
        body["shape"] = pick(rng, [None, "half_space", copy.deepcopy(pick(rng, document["bodies"])["shape"])])


def rename(document, rng):
    one, other = pick(rng, document["bodies"]), pick(rng, document["bodies"])
    key = pick(rng, ["name", "owner", "geometry", "kind", "level", "joint"])
    one[key] = other[key] if rng.random() < 0.7 else pick(rng, [0, 1, 2, -1, "obstacle", "link", "attached", "new"])


def change_joint(document, rng):
    joint = pick(rng, document["joints"])
    key = pick(rng, ["type", "parent", "leader", "multiplier", "offset", "axis"])
    joint[key] = {
        "type": pick(rng, ["revolute", "prismatic"]),
        "parent": int(rng.integers(-1, len(document["joints"]))),
        "leader": int(rng.integers(len(document["curve"]["joint_names"]))),
        "multiplier": pick(rng, [0.0, 1.0, -1.0, 0.1, 2.0, 1e6]),
        "offset": pick(rng, [0.0, 0.1, 2 * np.pi, -(2**63), 1e6, 1e-3]),
        "axis": pick(rng, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]),
    }[key]


def change_settings(document, rng):
    settings = document["settings"]
    owners = [body["owner"] for body in document["bodies"]]
    settings["margins"].append([pick(rng, owners), pick(rng, owners), pick(rng, [0.0, 0.01, 0.1, -1.0, 5e-324])])
    key = pick(rng, ["margin", "obstacle_tolerance"])
    settings[key] = pick(rng, [0.0, 1e-3, 0.01, 0.1, -0.1, 5e-324])
    settings["joint_tolerance"][0] = pick(rng, [0.0, 1e-3, 0.01, 0.1, -0.1])


def exclude(document, rng):
    owners = [body["owner"] for body in document["bodies"]]
    document["excluded"].append([pick(rng, owners), pick(rng, owners), "forged"])
    if rng.random() < 0.7:
        document["pairs"].pop(int(rng.integers(len(document["pairs"]))))


FORGERIES = [other_number, other_number, other_number, special_value, other_entries, other_entries,
             insert_motion, insert_motion, squeeze_curve, absorb_motion, bend_curve, one_wide_interval,
             cut_intervals, move_body, move_body, change_shape, rename, change_joint, change_settings,
             exclude, change_parts, change_parts, change_mesh, change_mesh]  # fmt: skip


def forged(document, rng):
    """A changed copy with valid hashes, and the names of the changes; None where nothing is left to hash."""
    changed, names = copy.deepcopy(document), []
    if rng.random() < 0.8:
        changed["claim"]["clearance"] = -1.0
    for _ in range(int(rng.integers(1, 4))):
        change = pick(rng, FORGERIES)
        try:
            with np.errstate(all="ignore"):
                change(changed, rng)
        except (TypeError, ValueError, KeyError, IndexError, AttributeError, OverflowError, ZeroDivisionError):
            continue  # an earlier change left nothing that this one could change
        names.append(change.__name__)
    try:
        for body in changed["bodies"]:
            body["sha256"] = body_digest(body)
        c = changed["curve"]
        control = np.array(c["control"], dtype=float)
        changed["hashes"]["curve"] = curve_digest(tuple(c["joint_names"]), np.array(c["knots"], dtype=float), control)
    except (TypeError, ValueError, KeyError, IndexError, AttributeError, OverflowError):
        return None, names
    return changed, names


SLACK = 2e-6
"""Metres: coal's GJK distances are off by less."""

FLAT = 1e-5
"""Metres by which points without volume are grown, since coal needs a solid."""


class Solid:
    """A subset of a body for coal, so that its distances are never too small by more than FLAT, and a radius."""

    def __init__(self, shape) -> None:
        self.radius, self.grown, self.triangles = 0.0, 0.0, None
        if isinstance(shape, dict) and "triangles" in shape:
            corners = np.array(shape["vertices"], dtype=float)[np.array(shape["triangles"])]
            self.geometry = bvh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
            self.triangles, self.point = corners if shape["solid"] else None, corners[0, 0]
            return
        if shape == "half_space":
            self.geometry = coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
            self.point = np.array([0.0, 0.0, -1e9])
            return
        points, discs = np.array(shape["points"], dtype=float), np.array(shape["disc_radii"], dtype=float)
        self.point = points[0]
        semi, self.radius = np.array(shape["semi_axes"], dtype=float), float(shape["radius"])
        if discs.any():
            angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
            circle = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
            points = (points[:, None] + discs[:, None, None] * circle).reshape(-1, 3)
        if semi.any():
            ball = np.random.default_rng(0).normal(size=(60, 3))
            ball = np.concatenate([ball / np.linalg.norm(ball, axis=1)[:, None], np.eye(3), -np.eye(3)])
            points = (points[:, None] + semi * ball).reshape(-1, 3)
        if len(points) == 1 and not points.any():
            self.geometry, self.radius, self.grown = coal.Sphere(self.radius + FLAT), 0.0, FLAT
            return
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
        for one, other, from_other in (
            (a, b, places[i].inverse() * places[j]),
            (b, a, places[j].inverse() * places[i]),
        ):
            if (
                one.triangles is not None
                and abs(winding_number(from_other.transform(other.point), one.triangles)) > 0.5
            ):
                return -1.0
        found = coal.distance(a.geometry, places[i], b.geometry, places[j], coal.DistanceRequest(), result)
        return found - a.radius - b.radius + a.grown + b.grown

    def pairs_at(self, q):
        """The distances (P,) of the pairs in the file at q (n,), and the normals (P, 3) from first to second."""
        places = {i: coal.Transform3s(at[:3, :3], at[:3, 3]) for i, at in self.placements(q).items()}
        found = []
        for i, j in (pair["bodies"] for pair in self.document["pairs"]):
            a, b, result = self.solids[i], self.solids[j], coal.DistanceResult()
            coal.distance(a.geometry, places[i], b.geometry, places[j], coal.DistanceRequest(), result)
            found.append((result.min_distance - a.radius - b.radius + a.grown + b.grown, result.normal))
        return np.array([distance for distance, _ in found]), np.array([normal for _, normal in found])

    def least(self, count=60):
        """The smallest distance of the pairs in the file, with the joints off as far as they may be."""
        return min(self.pairs_at(q)[0].min() for q in self.configurations(count, np.random.default_rng(0)))
