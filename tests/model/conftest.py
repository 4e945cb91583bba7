"""A robot with every kind of joint, and followers on the chain and off it."""

from __future__ import annotations

import pytest

LIMIT = '<limit lower="-2" upper="2" velocity="1" effort="1"/>'

JOINTS = [
    # name, type, parent, child, origin, axis, more
    ("slide", "prismatic", "base", "carriage", "0 0 0.1", "0 0 1", LIMIT),
    ("turn", "continuous", "carriage", "column", "0.1 0 0.2", "0 1 0", ""),
    ("lift", "revolute", "column", "arm", "0 0.1 0.3", "0.6 0 0.8", LIMIT),
    ("lift_follower", "revolute", "arm", "forearm", "0.4 0 0", "0 1 0",
     '<limit lower="-1" upper="1" velocity="0.25" effort="1"/><mimic joint="lift" multiplier="-0.5" offset="0.3"/>'),
    ("wrist", "revolute", "forearm", "hand", "0.2 0 0", "2 0 0", LIMIT),
    ("tool_joint", "fixed", "hand", "tool", "0.1 0.05 0", "1 0 0", ""),
    ("rod", "prismatic", "hand", "rod_link", "0 0.1 0", "0 1 0",
     f'{LIMIT}<mimic joint="slide" multiplier="0.25"/>'),
    ("finger", "prismatic", "hand", "finger_link", "0 0 0.1", "0 0 1",
     '<limit lower="0.01" upper="0.05" velocity="1" effort="1"/>'),
    ("thumb", "prismatic", "hand", "thumb_link", "0 0 0.1", "0 0 -1", f'{LIMIT}<mimic joint="finger"/>'),
]  # fmt: skip


@pytest.fixture(scope="session")
def zoo_text() -> str:
    links = ["base", *(joint[3] for joint in JOINTS)]
    parts = [f'<link name="{link}"/>' for link in links]
    for name, kind, parent, child, xyz, axis, more in JOINTS:
        parts.append(
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{xyz}" rpy="0.1 -0.2 0.3"/><axis xyz="{axis}"/>{more}</joint>'
        )
    return '<robot name="zoo">' + "".join(parts) + "</robot>"
