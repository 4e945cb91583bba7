"""DH table -> URDF.

Links and joints, for a table of n rows::

    base_link --base_joint--> dh_0 --<row 1>--> link_1 --<row 2>--> link_2 ... link_n --tool_joint--> tool0
                                                  |                   |          |
                                            dh_1_joint          dh_2_joint  dh_n_joint
                                                  v                   v          v
                                                 dh_1                dh_2       dh_n

A row's joint bears the row's name and moves ``link_i`` about or along z. ``dh_0`` ... ``dh_n`` and ``tool0`` are
frames: links without bodies, on fixed joints. Standard row i's d, a and alpha (and a prismatic row's theta) lie in the
origin of joint i+1, the last row's in ``tool_joint``; :mod:`pinproof.conversion.dh_layout` derives it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pinproof.conversion.dh_layout import behind, joint_origins, tool_origin
from pinproof.conversion.link_bodies import Body, Shape, link_bodies
from pinproof.conversion.proof import prove_urdf_equals_table
from pinproof.conversion.urdf_text import urdf_text
from pinproof.description.dh_row import DhRow
from pinproof.description.dh_table import DhTable
from pinproof.description.whole_file import write_text_whole
from pinproof.errors import InputError

__all__ = ["EFFORT", "TCP", "dh_to_urdf", "write_urdf"]

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
        URDF XML. Links are drawn and collidable as :mod:`pinproof.conversion.link_bodies` says.

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
