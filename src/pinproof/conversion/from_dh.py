"""Where the joints, links and frames of a DH table lie in a URDF.

A URDF joint is an origin (parent link to joint) followed by the motion about or along one axis, here always z. A DH row
is therefore cut in two at its motion, ``A(q) = ahead motion(q) behind``:

========================  ===================================  ===============================
row                       ahead                                behind
========================  ===================================  ===============================
standard, revolute        Rz(theta)                            Tz(d) Tx(a) Rx(alpha)
standard, prismatic       1                                    Rz(theta) Tz(d) Tx(a) Rx(alpha)
modified, revolute        Rx(alpha) Tx(a) Rz(theta)            Tz(d)
modified, prismatic       Rx(alpha) Tx(a) Rz(theta) Tz(d)      1
========================  ===================================  ===============================

(rotations about z and moves along z commute, so the offsets may stand on either side of the motion). A turning joint
stands where its column d begins, as on real arms, so that joints of a shoulder or wrist share one place. The origin of
joint i+1 in link i is ``behind_i ahead_(i+1)``, and the frame dh_i stands at ``behind_i`` in link i.

From yourdfpy's robot to URDF text that loses no digit.

Bodies for the links of a DH table: plausible in look and weight, and the same for the eye and for the checker.

A table knows lengths and no shapes, so bodies are made by rule:

- A row's d and a become capsule-like arms, along z and along x: a cylinder with a ball at each end. A prismatic row's
  arm is a rod that reaches back to its joint at full stretch, and slides out behind it otherwise.
- Radius of a link: 4 % of the table's total length, but at most 30 % of its own length and of the nearest links with
  length on either side, and never more than that of a link before it, for arms taper. The ends of two links that are
  one link apart then keep 40 % of that link's length between their balls. It is a rule of thumb and no proof: a table
  that folds back on itself (d = 0.1, then d = -0.1) collides, and an offset elbow such as the Panda's does so when it
  is nearly straight.
- Each link with length has a housing about its joint's axis: a cylinder of 1.1 radii, 2.2 radii long.
- A row shorter than 2 % of the total length (or 1 mm) gets no body; the balls of its neighbours close the gap.
- The arm's foot and tip are trimmed: the first column stands on a flat foot 5 mm above dh_0, so that a table top at
  z = 0 is no contact; the last arm ends flat one radius before its end, so that a tool frame put on a surface is none
  either.
- Weights are those of solid cylinders at :data:`DENSITY`; a link without length weighs as a ball.

Everything drawn is collidable and the reverse: what a picture shows is what was checked.

DH table -> URDF.

Links and joints, for a table of n rows::

    base_link --base_joint--> dh_0 --<row 1>--> link_1 --<row 2>--> link_2 ... link_n --tool_joint--> tool0
                                                  |                   |          |
                                            dh_1_joint          dh_2_joint  dh_n_joint
                                                  v                   v          v
                                                 dh_1                dh_2       dh_n

A row's joint bears the row's name and moves ``link_i`` about or along z. ``dh_0`` ... ``dh_n`` and ``tool0`` are
frames: links without bodies, on fixed joints. Standard row i's d, a and alpha (and a prismatic row's theta) lie in the
origin of joint i+1, the last row's in ``tool_joint``; :mod:`pinproof.conversion.from_dh` derives it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from pinproof.common.files import write_text_whole
from pinproof.conversion.proof import prove_urdf_equals_table
from pinproof.description.dh import DhRow, DhTable, row_transform
from pinproof.errors import InputError

__all__ = [
    "DENSITY",
    "EFFORT",
    "TCP",
    "Body",
    "Shape",
    "ahead",
    "behind",
    "dh_to_urdf",
    "joint_origins",
    "link_bodies",
    "rpy_of",
    "tool_origin",
    "urdf_text",
    "write_urdf",
]

Array = npt.NDArray[np.float64]


def ahead(row: DhRow, convention: str) -> Array:
    """The (4, 4) part of a row before its motion."""
    if convention == "modified":
        return row_transform(row if row.is_prismatic else replace(row, d=0.0), convention, 0.0)
    if row.is_prismatic:
        return np.eye(4)
    return row_transform(replace(row, d=0.0, a=0.0, alpha=0.0), convention, 0.0)


def behind(row: DhRow, convention: str) -> Array:
    """The (4, 4) part of a row after its motion: link_i_from_dh_i."""
    if convention == "modified":
        return row_transform(_only_d(row), convention, 0.0)
    return row_transform(row if row.is_prismatic else replace(row, theta=0.0), convention, 0.0)


def _only_d(row: DhRow) -> DhRow:
    return replace(row, theta=0.0, d=0.0 if row.is_prismatic else row.d, a=0.0, alpha=0.0)


def joint_origins(table: DhTable) -> list[Array]:
    """For each row the origin (4, 4) of its joint: in dh_0 for the first, in the link before it for the others."""
    origins = [ahead(row, table.convention) for row in table.rows]
    for i, row in enumerate(table.rows[:-1]):
        origins[i + 1] = behind(row, table.convention) @ origins[i + 1]
    return origins


def tool_origin(table: DhTable) -> Array:
    """link_n_from_tool (4, 4): what lies behind the last joint, the table's tool included."""
    return np.array(behind(table.rows[-1], table.convention) @ table.tool)


def urdf_text(robot: Any, *, comment: str = "") -> str:
    """The XML text of a ``yourdfpy.Robot``; the same robot gives the same bytes.

    yourdfpy writes numbers with all their digits, but takes the roll, pitch and yaw of an origin from an algorithm that
    is wrong near a pitch of +-pi/2 (trimesh's ``euler_from_matrix``), so every origin's rpy is written anew here.
    """
    import yourdfpy
    from lxml import etree

    tree = yourdfpy.URDF(robot=robot, build_scene_graph=False, load_meshes=False).write_xml()
    for element, origin in zip(tree.iter("origin"), _origins(robot), strict=True):
        element.set("xyz", _text(origin[:3, 3]))
        element.set("rpy", _text(rpy_of(origin[:3, :3])))
    if comment:
        tree.getroot().insert(0, etree.Comment(f" {comment.replace('--', '- -')} "))
    return '<?xml version="1.0"?>\n' + str(etree.tostring(tree, encoding="unicode", pretty_print=True))


def rpy_of(rotation: Array) -> tuple[float, float, float]:
    """Roll, pitch, yaw of Rz(yaw) Ry(pitch) Rx(roll), to rounding for every rotation (3, 3), pitch +-pi/2 included.

    Roll is taken from what is left when the yaw found first has been undone. At a pitch of +-pi/2 yaw alone is
    arbitrary, and this way roll makes up for it (Shoemake, Graphics Gems IV, 1994, refined as in Eigen's eulerAngles).
    """
    r = rotation
    yaw = math.atan2(r[1, 0], r[0, 0])
    s, c = math.sin(yaw), math.cos(yaw)
    pitch = math.atan2(-r[2, 0], c * r[0, 0] + s * r[1, 0])
    roll = math.atan2(s * r[0, 2] - c * r[1, 2], c * r[1, 1] - s * r[0, 1])
    return roll, pitch, yaw


def _origins(robot: Any) -> Iterator[Array]:
    """Every origin of the robot in the order in which yourdfpy writes them."""
    for link in robot.links:
        for part in (link.inertial, *link.visuals, *link.collisions):
            if part is not None and part.origin is not None:
                yield part.origin
    for joint in robot.joints:
        if joint.origin is not None:
            yield joint.origin


def _text(numbers: Any) -> str:
    return " ".join(repr(float(number) + 0.0) for number in numbers)  # + 0.0 turns -0.0 into 0.0


DENSITY = 1500.0
"""kg/m^3: aluminium housings, motors and gears, with the air between them. The generic arm comes to 13.4 kg;
where short wrist links keep the radii small, arms come out light (a UR5's table: 3.8 kg, the arm itself 18 kg)."""
RADIUS_OF_TOTAL = 0.04
RADIUS_OF_LENGTH = 0.3
HOUSING = 1.1
"""Radius and half length of a housing in radii of its link: it holds a ball of one radius, so none is drawn there."""
SHORT_OF_TOTAL = 0.02
SHORT = 1e-3
"""Metres; anything shorter is a tolerance of the build and not a link."""
FOOT_GAP = 5e-3
"""Metres between dh_0 and the underside of the foot, more than a collision margin (2 mm is usual)."""
FOOT_RADIUS = 1.5
FOOT_HEIGHT = 0.5
"""Radius and height of the foot in radii of the first link."""
BALL_RADIUS = 5e-3
"""Metres; the ball that a link weighs as where neither it nor a neighbour has a length."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A ball (length None) or a cylinder along its own z; ``origin`` is link_from_shape (4, 4), sizes are metres."""

    origin: Array
    radius: float
    length: float | None = None
    part: Literal["arm", "joint"] = "arm"


@dataclass(frozen=True, eq=False)
class Body:
    """The shapes of a link and its weight: mass in kg, centre of mass (3,) in m, inertia (3, 3) about it in kg m^2."""

    shapes: tuple[Shape, ...]
    mass: float
    centre: Array
    inertia: Array


@dataclass(frozen=True, eq=False)
class _Arm:
    """A straight piece of a link, from ``start`` to ``end`` (3,) in the link; the chain goes on at ``end``."""

    start: Array
    end: Array

    @property
    def length(self) -> float:
        return float(np.linalg.norm(self.end - self.start))


def link_bodies(table: DhTable) -> tuple[Body, ...]:
    """The bodies (n + 1) of base_link, link_1, ..., link_n, each in its own link; one without shapes never collides."""
    arms = [_arms(table, i) for i in range(len(table) + 1)]
    total = sum(arm.length for link in arms for arm in link)
    shortest = max(SHORT, SHORT_OF_TOTAL * total)
    arms = [link if any(arm.length >= shortest for arm in link) else [] for link in arms]
    arms = [[arm for arm in link if arm.length >= SHORT] for link in arms]
    radii = _radii([_span(link) for link in arms], total)
    tip = max((i for i, link in enumerate(arms) if link), default=-1)

    foot = _foot(table, arms, radii)
    bodies = []
    for i, (link, radius) in enumerate(zip(arms, radii, strict=True)):
        on_foot = i == 1 and foot is not None
        cylinders, balls = _cylinders(link, radius, on_foot=on_foot, is_tip=i == tip)
        turns = i > 0 and not table.rows[i - 1].is_prismatic
        shapes = [*cylinders, *balls]
        if link and turns and not on_foot:
            shapes.insert(0, Shape(_at(link[0].start), HOUSING * radius, 2 * HOUSING * radius, "joint"))
        elif link and not on_foot:
            shapes.insert(0, Shape(_at(link[0].start), radius, part="joint"))
        if i == 0:
            shapes = [replace(shape, origin=table.base @ shape.origin) for shape in shapes]
            shapes += [] if foot is None else [foot]
        bodies.append(Body(tuple(shapes), *_weight(cylinders, radius or _neighbour(radii, i))))
    return tuple(bodies)


def _arms(table: DhTable, i: int) -> list[_Arm]:
    """The straight pieces of link i (0: what is fixed to dh_0) in its frame, in the order of the chain."""
    points: list[Array] = []
    if table.convention == "standard":
        if i == 0:
            return []
        row = table.rows[i - 1]
        yaw = row.theta if row.is_prismatic else 0.0
        corner = np.array([0.0, 0.0, row.d])
        points = [np.zeros(3), corner, corner + row.a * np.array([math.cos(yaw), math.sin(yaw), 0.0])]
    else:
        # The row's d leads up to dh_i, and from there the next row's a and alpha belong to this link.
        d = table.rows[i - 1].d if i > 0 else 0.0
        a = table.rows[i].a if i < len(table) else 0.0
        start = -d if i > 0 and table.rows[i - 1].is_prismatic else 0.0  # a sliding link's own frame is dh_i
        points = [np.array([x, 0.0, start + z]) for x, z in ((0.0, 0.0), (0.0, d), (a, d))]
    if i > 0 and table.rows[i - 1].is_prismatic:
        # The joint stands at z = (start of d) - q; the rod must reach it at both ends of its stroke.
        row, first, bend = table.rows[i - 1], float(points[0][2]), float(points[1][2])
        reach = (bend, first - row.lower, first - row.upper)
        low, high = min(reach), max(reach)
        start, end = (low, high) if bend - low >= high - bend else (high, low)
        rod = _Arm(np.array([0.0, 0.0, start]), np.array([0.0, 0.0, end]))
        return [arm for arm in (rod, _Arm(points[1], points[2])) if arm.length > 0]
    return [arm for arm in (_Arm(points[0], points[1]), _Arm(points[1], points[2])) if arm.length > 0]


def _span(link: Sequence[_Arm]) -> float:
    """How far apart the two ends of a link stand."""
    return float(np.linalg.norm(link[-1].end - link[0].start)) if link else 0.0


def _radii(lengths: Sequence[float], total: float) -> list[float]:
    """Radius of each link; 0 for a link without length."""
    radii: list[float] = []
    for i, length in enumerate(lengths):
        before = next((x for x in reversed(lengths[:i]) if x > 0), math.inf)
        after = next((x for x in lengths[i + 1 :] if x > 0), math.inf)
        thinnest = min((r for r in radii if r > 0), default=math.inf)
        radii.append(min(RADIUS_OF_TOTAL * total, RADIUS_OF_LENGTH * min(length, before, after), thinnest))
    return radii


def _neighbour(radii: Sequence[float], i: int) -> float:
    """Radius of the nearest link before, else after, that has one."""
    return next((r for r in [*reversed(radii[:i]), *radii[i + 1 :]] if r > 0), BALL_RADIUS)


def _foot(table: DhTable, arms: Sequence[Sequence[_Arm]], radii: Sequence[float]) -> Shape | None:
    """A flat foot on base_link, where a column that turns about its own axis begins; else None."""
    row, radius = table.rows[0], radii[1]
    height = FOOT_HEIGHT * radius
    if arms[0] or not arms[1] or row.is_prismatic or abs(row.d) < 2 * (FOOT_GAP + height):
        return None
    centre = math.copysign(FOOT_GAP + height / 2, row.d)
    origin = table.base @ ahead(replace(row, d=0.0), table.convention) @ _at(np.array([0.0, 0.0, centre]))
    return Shape(origin, FOOT_RADIUS * radius, height, "joint")


def _cylinders(link: Sequence[_Arm], radius: float, *, on_foot: bool, is_tip: bool) -> tuple[list[Shape], list[Shape]]:
    """The cylinders of a link and the balls at their ends; the ball at the link's start is left to the caller."""
    cylinders, balls = [], []
    for k, arm in enumerate(link):
        direction = (arm.end - arm.start) / arm.length
        ends_here = is_tip and k == len(link) - 1
        start = FOOT_GAP if on_foot and k == 0 else 0.0
        end = arm.length - (min(radius, arm.length / 2) if ends_here else 0.0)
        middle = arm.start + (start + end) / 2 * direction
        cylinders.append(Shape(_along(middle, direction), radius, end - start))
        if not ends_here:
            balls.append(Shape(_at(arm.end), radius, part="joint"))
    return cylinders, balls


def _weight(cylinders: Sequence[Shape], ball_radius: float) -> tuple[float, Array, Array]:
    """Mass, centre of mass and inertia about it of solid cylinders (a ball if there are none), by the parallel axes."""
    if not cylinders:
        mass = DENSITY * 4 / 3 * math.pi * ball_radius**3
        return mass, np.zeros(3), 2 / 5 * mass * ball_radius**2 * np.eye(3)
    masses = [DENSITY * math.pi * c.radius**2 * (c.length or 0.0) for c in cylinders]
    mass = sum(masses)
    centre = np.array(sum(m * c.origin[:3, 3] for m, c in zip(masses, cylinders, strict=True)) / mass)
    inertia = np.zeros((3, 3))
    for m, c in zip(masses, cylinders, strict=True):
        across = m * (3 * c.radius**2 + (c.length or 0.0) ** 2) / 12
        own = c.origin[:3, :3] @ np.diag([across, across, m * c.radius**2 / 2]) @ c.origin[:3, :3].T
        arm = c.origin[:3, 3] - centre
        inertia += own + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return mass, centre, (inertia + inertia.T) / 2


def _at(point: Array) -> Array:
    origin = np.eye(4)
    origin[:3, 3] = point
    return origin


def _along(point: Array, direction: Array) -> Array:
    """A frame at ``point`` whose z is the unit vector ``direction``, which lies along z or across it."""
    origin = _at(point)
    if direction[2] == 0.0:
        z = np.array([0.0, 0.0, 1.0])
        origin[:3, :3] = np.column_stack([np.cross(z, direction), z, direction])
    return origin


TCP = "tool0"
EFFORT = 100.0
"""N m or N. A URDF must state an effort limit and a DH table knows none; a small arm's, and nothing here reads it."""
COLOURS = {"arm": (0.85, 0.86, 0.88, 1.0), "joint": (0.16, 0.38, 0.62, 1.0)}


def dh_to_urdf(table: DhTable) -> str:
    """The URDF of a DH table, proven equal to it; the same table gives the same text.

    Parameters
    ----------
    table
        The arm. The URDF's root ``base_link`` is the frame that ``table.base`` is given in; the tcp is ``tool0``.

    Returns
    -------
    str
        URDF XML. Links are drawn and collidable as :mod:`pinproof.conversion.from_dh` says.

    Raises
    ------
    ConversionError
        Unless forward kinematics of the text through Pinocchio equals the table's product to 1e-12 m and 1e-12 rad at
        every frame dh_0 ... dh_n and at the tool.
    InputError
        If a row bears a name that the URDF gives to one of its own links or joints.
    """
    _refuse_reserved_names(table)
    text = urdf_text(
        _robot(table), comment=f"made by pinproof from the DH table {table.name} ({table.convention} convention)"
    )
    prove_urdf_equals_table(table, text, tcp=TCP)
    return text


def write_urdf(table: DhTable, path: str | Path) -> None:
    """Write :func:`dh_to_urdf` of a table to a file, whole or not at all.

    Raises
    ------
    ConversionError, InputError
        As :func:`dh_to_urdf`; nothing is written then.
    FileError
        If the file cannot be written.
    """
    write_text_whole(path, dh_to_urdf(table))


def _refuse_reserved_names(table: DhTable) -> None:
    # Joints and links share one name space in Pinocchio, where "universe" is the world.
    numbers = range(len(table) + 1)
    reserved = {"universe", "base_link", "base_joint", TCP, "tool_joint"}
    reserved |= {name.format(i) for i in numbers for name in ("dh_{}", "dh_{}_joint", "link_{}")}
    for row in table.rows:
        if row.name in reserved:
            raise InputError(f"DH row {row.name!r} bears a name that the URDF needs for a frame; rename the row")


def _robot(table: DhTable) -> Any:
    """The table as a ``yourdfpy.Robot``."""
    import yourdfpy

    n = len(table)
    movable = [f"link_{i}" for i in range(1, n + 1)]
    frames = [f"dh_{i}" for i in range(n + 1)]
    bodies = link_bodies(table)
    links = [_link("base_link", bodies[0], with_weight=False)]  # many tools refuse a root with an inertia
    links += [_link(name, body, with_weight=True) for name, body in zip(movable, bodies[1:], strict=True)]
    links += [yourdfpy.Link(name=name) for name in (*frames, TCP)]

    joints = [_fixed("base_joint", "base_link", "dh_0", table.base)]
    for row, origin, parent, child in zip(
        table.rows, joint_origins(table), ["dh_0", *movable[:-1]], movable, strict=True
    ):
        joints.append(
            yourdfpy.Joint(
                name=row.name,
                type=row.joint_type,
                parent=parent,
                child=child,
                origin=origin,
                axis=np.array([0.0, 0.0, 1.0]),
                limit=_limit(row),
            )
        )
    for row, parent, frame in zip(table.rows, movable, frames[1:], strict=True):
        joints.append(_fixed(f"{frame}_joint", parent, frame, behind(row, table.convention)))
    joints.append(_fixed("tool_joint", movable[-1], TCP, tool_origin(table)))
    return yourdfpy.Robot(name=table.name, links=links, joints=joints)


def _limit(row: DhRow) -> Any:
    import yourdfpy

    if row.joint_type == "continuous":
        return yourdfpy.Limit(effort=EFFORT, velocity=row.velocity)
    return yourdfpy.Limit(effort=EFFORT, velocity=row.velocity, lower=row.lower, upper=row.upper)


def _fixed(name: str, parent: str, child: str, origin: Any) -> Any:
    import yourdfpy

    return yourdfpy.Joint(name=name, type="fixed", parent=parent, child=child, origin=origin)


def _link(name: str, body: Body, *, with_weight: bool) -> Any:
    import yourdfpy

    link = yourdfpy.Link(name=name)
    if with_weight:
        origin = np.eye(4)
        origin[:3, 3] = body.centre
        link.inertial = yourdfpy.Inertial(origin=origin, mass=body.mass, inertia=body.inertia)
    for shape in body.shapes:
        colour = yourdfpy.Color(rgba=np.array(COLOURS[shape.part]))
        material = yourdfpy.Material(name=f"pinproof_{shape.part}", color=colour)
        link.visuals.append(yourdfpy.Visual(origin=shape.origin, geometry=_geometry(shape), material=material))
        link.collisions.append(yourdfpy.Collision(name=None, origin=shape.origin, geometry=_geometry(shape)))
    return link


def _geometry(shape: Shape) -> Any:
    import yourdfpy

    if shape.length is None:
        return yourdfpy.Geometry(sphere=yourdfpy.Sphere(radius=shape.radius))
    return yourdfpy.Geometry(cylinder=yourdfpy.Cylinder(radius=shape.radius, length=shape.length))
