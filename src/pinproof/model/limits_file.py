"""Limits of joints from a file, as MoveIt's ``joint_limits.yaml`` states them.

::

    joint_limits:
      elbow_joint:
        has_velocity_limits: true
        max_velocity: 3.15                 # rad/s or m/s
        has_acceleration_limits: true
        max_acceleration: 5.0              # rad/s^2 or m/s^2
        has_jerk_limits: true
        max_jerk: 40.0                     # rad/s^3 or m/s^3
        has_position_limits: true          # optional, as all of them
        min_position: -3.1
        max_position: 3.1

A limit counts where its ``has_...`` says true; what is not stated stays as it was. ``has_deceleration_limits`` with a
``max_deceleration`` (of either sign) that is smaller makes both smaller. ``default_velocity_scaling_factor`` and
``default_acceleration_scaling_factor`` are wishes for motions and no limits: they are read and left aside.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pinproof.description.lined_yaml import LinedMapping, read_yaml, refuse_unknown
from pinproof.errors import FileError, UnknownNameError
from pinproof.model.limits import DEFAULT_RAMP, JointLimits

__all__ = ["LimitsFile", "load_limits"]

KINDS = {
    "position": ("min_position", "max_position"),
    "velocity": ("max_velocity",),
    "acceleration": ("max_acceleration",),
    "deceleration": ("max_deceleration",),
    "jerk": ("max_jerk",),
}
LEFT_ASIDE = ("has_effort_limits", "max_effort", "angle_wraparound")
JOINT_KEYS = (*(f"has_{kind}_limits" for kind in KINDS), *(key for keys in KINDS.values() for key in keys), *LEFT_ASIDE)
FILE_KEYS = ("joint_limits", "default_velocity_scaling_factor", "default_acceleration_scaling_factor")


@dataclass(frozen=True)
class LimitsFile:
    """What a file states of joints, each by its name.

    Attributes
    ----------
    path
        The file.
    position
        (lower, upper) in rad or m.
    velocity, acceleration, jerk
        In rad or m per second, per second squared and cubed.
    joints
        All joints the file speaks of.
    """

    path: Path
    position: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    velocity: Mapping[str, float] = field(default_factory=dict)
    acceleration: Mapping[str, float] = field(default_factory=dict)
    jerk: Mapping[str, float] = field(default_factory=dict)
    joints: tuple[str, ...] = ()

    def over(self, limits: JointLimits, joint_names: Sequence[str], known: Sequence[str]) -> JointLimits:
        """The limits of an arm with those of the file in their place.

        Parameters
        ----------
        limits, joint_names
            The arm's.
        known
            All joints of the robot, of which the file may speak.

        Raises
        ------
        UnknownNameError
            If the file speaks of a joint that the robot does not have.
        """
        for name in self.joints:
            if name not in known:
                raise UnknownNameError("joint", name, known, f"limits file {self.path}")
        lower, upper, velocity = limits.lower.copy(), limits.upper.copy(), limits.velocity.copy()
        acceleration = limits.acceleration.copy()
        jerk = np.full(len(limits), np.nan) if limits.jerk is None else limits.jerk.copy()
        for i, name in enumerate(joint_names):
            lower[i], upper[i] = self.position.get(name, (lower[i], upper[i]))
            if name in self.velocity:
                velocity[i] = self.velocity[name]
                if limits.acceleration_source.startswith("default"):
                    acceleration[i] = velocity[i] / DEFAULT_RAMP
            acceleration[i] = self.acceleration.get(name, acceleration[i])
            jerk[i] = self.jerk.get(name, jerk[i])
        return JointLimits(
            lower,
            upper,
            velocity,
            acceleration,
            self._source(self.acceleration, joint_names, limits.acceleration_source),
            None if np.isnan(jerk).all() else jerk,
            self._source(self.jerk, joint_names, limits.jerk_source or "not known"),
        )

    def _source(self, stated: Mapping[str, float], joint_names: Sequence[str], others: str) -> str:
        missing = [name for name in joint_names if name not in stated]
        if not missing:
            return self.path.name
        if len(missing) == len(joint_names):
            return others
        # a default for some is no default for all, so the word does not come first
        return f"{self.path.name}, but for {', '.join(missing)}: {others}"


def load_limits(path: str | Path) -> LimitsFile:
    """Read limits of joints, such as MoveIt's ``joint_limits.yaml``; hand them to ``robot.arm(limits=...)``.

    Raises
    ------
    FileError
        If the file cannot be read or used; names the line, the joint and the valid keys.
    """
    path = Path(path)
    content = read_yaml(path, FILE_KEYS, FileError)
    refuse_unknown(FileError, path, "key", content, FILE_KEYS, "")
    joints = content.get("joint_limits")
    if not isinstance(joints, dict) or not joints:
        raise FileError(path, "holds no joint_limits; under that key stand joints by name")
    found: dict[str, dict[str, list[float]]] = {kind: {} for kind in KINDS}
    for name, stated in joints.items():
        if not isinstance(name, str) or not isinstance(stated, LinedMapping):
            raise FileError(path, f"joint {name!r} must be a name with a mapping of limits", "key joint_limits")
        where = f"line {stated.line}"
        refuse_unknown(FileError, path, "key", stated, JOINT_KEYS, f"{where}, joint {name}")
        for kind, keys in KINDS.items():
            values = _stated(path, f"{where}, joint {name}", stated, kind, keys)
            if values is not None:
                found[kind][name] = values
    acceleration = {name: value for name, (value,) in found["acceleration"].items()}
    for name, (value,) in found["deceleration"].items():
        if name not in acceleration:
            raise FileError(path, "has a limit of deceleration and none of acceleration", f"joint {name}")
        acceleration[name] = min(acceleration[name], value)
    return LimitsFile(
        path,
        {name: (low, high) for name, (low, high) in found["position"].items()},
        {name: value for name, (value,) in found["velocity"].items()},
        acceleration,
        {name: value for name, (value,) in found["jerk"].items()},
        tuple(joints),
    )


def _stated(path: Path, place: str, stated: LinedMapping, kind: str, keys: tuple[str, ...]) -> list[float] | None:
    """The numbers of one kind of limit, if the joint has it."""
    flag = f"has_{kind}_limits"
    has = stated.get(flag)
    given = [key for key in keys if key in stated]
    if flag not in stated:
        if given:
            raise FileError(path, f"{given[0]} counts only with {flag}: true, or false", place)
        return None
    if not isinstance(has, bool):
        raise FileError(path, f"{flag} is true or false, not {has!r}", place)
    if not has:
        return None
    values = []
    for key in keys:
        value = stated.get(key)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not np.isfinite(float(value)):
            raise FileError(path, f"{key} must be a finite number, not {value!r}", place)
        values.append(abs(float(value)) if kind == "deceleration" else float(value))
    if kind == "position" and values[0] > values[1]:
        raise FileError(path, f"min_position {values[0]} is above max_position {values[1]}", place)
    if kind != "position" and not values[0] > 0.0:
        raise FileError(path, f"{keys[0]} must be above 0, not {values[0]}", place)
    return values
