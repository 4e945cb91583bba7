"""Message classes as ROS 2 generates them, for tests without ROS: the same fields, types, defaults and checks.

Source of the definitions: ROS 2 Jazzy, packages builtin_interfaces, std_msgs, trajectory_msgs and sensor_msgs.
"""

from __future__ import annotations

import sys
from array import array
from collections.abc import Mapping
from types import ModuleType
from typing import Any

import pytest

STAMP = {"header": "std_msgs/Header"}
DEFINITIONS: Mapping[str, Mapping[str, str]] = {
    "builtin_interfaces/Time": {"sec": "int32", "nanosec": "uint32"},
    "builtin_interfaces/Duration": {"sec": "int32", "nanosec": "uint32"},
    "std_msgs/Header": {"stamp": "builtin_interfaces/Time", "frame_id": "string"},
    "trajectory_msgs/JointTrajectoryPoint": {
        **dict.fromkeys(("positions", "velocities", "accelerations", "effort"), "sequence<double>"),
        "time_from_start": "builtin_interfaces/Duration",
    },
    "trajectory_msgs/JointTrajectory": {
        **STAMP,
        "joint_names": "sequence<string>",
        "points": "sequence<trajectory_msgs/JointTrajectoryPoint>",
    },
    "sensor_msgs/JointState": {
        **STAMP,
        "name": "sequence<string>",
        **dict.fromkeys(("position", "velocity", "effort"), "sequence<double>"),
    },
    "sensor_msgs/PointField": {"name": "string", "offset": "uint32", "datatype": "uint8", "count": "uint32"},
    "sensor_msgs/PointCloud2": {
        **STAMP,
        "height": "uint32",
        "width": "uint32",
        "fields": "sequence<sensor_msgs/PointField>",
        "is_bigendian": "boolean",
        "point_step": "uint32",
        "row_step": "uint32",
        "data": "sequence<uint8>",
        "is_dense": "boolean",
    },
}
PLAIN = {"string": str, "boolean": bool, "int32": int, "uint32": int, "uint8": int}
CODES = {"sequence<double>": "d", "sequence<uint8>": "B"}


class Generated:
    """The base of the classes, whose setters refuse values of other types as those of ROS do."""

    definition: Mapping[str, str]

    def __init__(self) -> None:
        for field, kind in self.definition.items():
            empty = [] if kind.startswith("sequence") else PLAIN[kind]() if kind in PLAIN else CLASSES[kind]()
            setattr(self, field, empty)

    @classmethod
    def get_fields_and_field_types(cls) -> dict[str, str]:
        return dict(cls.definition)

    def __setattr__(self, field: str, value: Any) -> None:
        kind = self.definition[field]
        if kind in CODES:
            value = array(CODES[kind], value)
        elif kind.startswith("sequence<"):
            inner = kind[9:-1]
            item = PLAIN.get(inner) or CLASSES[inner]
            assert all(isinstance(each, item) for each in value), f"{field} must be a sequence of {inner}"
        else:
            assert isinstance(value, PLAIN.get(kind) or CLASSES[kind]), f"{field} must be a {kind}"
        object.__setattr__(self, field, value)


CLASSES = {name: type(name.partition("/")[2], (Generated,), {"definition": rows}) for name, rows in DEFINITIONS.items()}


def install(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the classes importable as in ROS: ``from trajectory_msgs.msg import JointTrajectory``."""
    for name, made in CLASSES.items():
        package, _, kind = name.partition("/")
        for module in (package, f"{package}.msg"):
            if not isinstance(sys.modules.get(module), ModuleType):
                monkeypatch.setitem(sys.modules, module, ModuleType(module))
        monkeypatch.setattr(sys.modules[f"{package}.msg"], kind, made, raising=False)
