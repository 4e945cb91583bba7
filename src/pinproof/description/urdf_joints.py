"""The joints of a URDF, each checked; what the file leaves open stays open, never the 0 of the URDF specification."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast, get_args

import numpy as np

from pinproof.description.urdf_links import FARTHEST, origin
from pinproof.description.xml_reader import Element, number, numbers, only, place, required, spelt, spelt_attributes
from pinproof.errors import UnknownNameError, UrdfError

__all__ = ["JointType", "Mimic", "UrdfJoint", "check_mimics", "read_joint"]

SMALLEST_AXIS = 1e-6
"""An axis vector whose entries are all below this has no direction worth the name."""

UNBOUNDED = 1e4
"""Rad or m. A limit beyond this, such as the 1e16 that simulators write for a wheel, is none."""

JOINT_PARTS = ("axis", "calibration", "child", "dynamics", "limit", "mimic", "origin", "parent", "safety_controller")

JointType = Literal["revolute", "continuous", "prismatic", "fixed", "floating", "planar"]


@dataclass(frozen=True)
class Mimic:
    """A follower's rule: q = multiplier * q_leader + offset."""

    leader: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class UrdfJoint:
    """A joint as the file states it; None where the file states nothing usable.

    So it is with a limit beyond :data:`UNBOUNDED`, and with a velocity of 0: no joint with a use has that limit, it
    means "not known".
    """

    name: str
    type: JointType
    parent: str
    child: str
    lower: float | None
    upper: float | None
    velocity: float | None
    mimic: Mimic | None


def read_joint(element: Element, links: Mapping[str, Element], source: str | Path) -> UrdfJoint:
    """A ``<joint>`` element; ``links`` are the names it may join."""
    name, kind = required(element, "name", source), required(element, "type", source)
    where = place(element)
    if kind not in get_args(JointType):
        raise UrdfError(
            source, str(UnknownNameError("joint type", kind, get_args(JointType), f"joint {name!r}")), where
        )
    ends = []
    for tag in ("parent", "child"):
        end = element.find(tag)
        if end is None:
            raise UrdfError(source, f"joint {name!r} has no <{tag}>", where)
        link = required(end, "link", source)
        if link not in links:
            raise UrdfError(source, str(UnknownNameError("link", link, links, f"joint {name!r}")), place(end))
        ends.append(link)
    spelt(element, JOINT_PARTS, source)
    origin(element, source)
    axis = element.find("axis")
    if axis is not None and kind != "fixed":
        only(axis, ("xyz",), source)
        vector = numbers(axis, "xyz", 3, source)
        if np.abs(vector).max() < SMALLEST_AXIS:
            raise UrdfError(source, f"joint {name!r} has the axis {list(vector)}, which has no direction", place(axis))
    lower, upper, velocity = _limits(element, name, kind, source)
    mimic = element.find("mimic")
    rule = None
    if mimic is not None and kind != "fixed":
        leader = required(mimic, "joint", source)
        rule = Mimic(leader, number(mimic, "multiplier", source, "1"), number(mimic, "offset", source, "0"))
        if max(abs(rule.multiplier), abs(rule.offset)) > FARTHEST:
            what = f"joint {name!r} mimics with multiplier {rule.multiplier:g} and offset {rule.offset:g}"
            raise UrdfError(source, f"{what}; at most {FARTHEST:g} makes sense", place(mimic))
    return UrdfJoint(name, cast(JointType, kind), ends[0], ends[1], lower, upper, velocity, rule)


def _limits(
    element: Element, name: str, kind: str, source: str | Path
) -> tuple[float | None, float | None, float | None]:
    """Lower, upper, velocity; a bound that is not written is None, never the 0 that the URDF specification fills in."""
    limit = element.find("limit")
    if limit is None or kind == "fixed":
        return None, None, None
    spelt_attributes(limit, ("lower", "upper", "velocity", "effort"), source)
    lower = number(limit, "lower", source) if limit.get("lower") is not None else None
    upper = number(limit, "upper", source) if limit.get("upper") is not None else None
    if lower is not None and upper is not None and lower > upper:
        raise UrdfError(source, f"joint {name!r} has lower = {lower} above upper = {upper}", place(limit))
    velocity = number(limit, "velocity", source) if limit.get("velocity") is not None else None
    if velocity is not None and velocity < 0:
        raise UrdfError(source, f"joint {name!r} has the negative velocity limit {velocity}", place(limit))
    if kind == "continuous":
        lower = upper = None
    return _usable(lower), _usable(upper), _usable(velocity) or None


def _usable(bound: float | None) -> float | None:
    return None if bound is None or abs(bound) > UNBOUNDED else bound


def check_mimics(joints: Mapping[str, UrdfJoint], source: str | Path) -> None:
    """Refuse followers of a joint that is not there, or that does not move by itself."""
    for joint in joints.values():
        if joint.mimic is None:
            continue
        if joint.type in ("floating", "planar"):
            raise UrdfError(source, f"joint {joint.name!r} mimics another, which a {joint.type} joint cannot")
        leader = joints.get(joint.mimic.leader)
        if leader is None:
            raise UrdfError(
                source, str(UnknownNameError("joint", joint.mimic.leader, joints, f"mimic of {joint.name!r}"))
            )
        if leader.mimic is not None or leader.type not in ("revolute", "continuous", "prismatic"):
            what = "itself mimics" if leader.mimic is not None else f"is {leader.type}"
            raise UrdfError(
                source, f"joint {joint.name!r} mimics {leader.name!r}, which {what}; it must move by itself"
            )
