"""A robot with masses and every kind of joint: prismatic, continuous, mimic followers on the chain and off it."""

from __future__ import annotations

import numpy as np

LIMIT = '<limit lower="-2" upper="2" velocity="2" effort="{effort}"/>'

JOINTS = [
    # name, type, parent, child, origin, axis, effort, mimic
    ("slide", "prismatic", "base", "carriage", "0 0 0.1", "0 0 1", 900, ""),
    ("turn", "continuous", "carriage", "column", "0.1 0 0.2", "0 1 0", 400, ""),
    ("lift", "revolute", "column", "arm", "0 0.1 0.3", "0.6 0 0.8", 250, ""),
    ("lift_follower", "revolute", "arm", "forearm", "0.4 0 0", "0 1 0", 250,
     '<mimic joint="lift" multiplier="-0.5" offset="0.3"/>'),
    ("wrist", "revolute", "forearm", "hand", "0.2 0 0", "2 0 0", 60, ""),
    ("reach", "prismatic", "hand", "palm", "0.05 0 0.02", "1 1 0", 150, ""),
    ("tool_joint", "fixed", "palm", "tool", "0.1 0.05 0", "1 0 0", 1, ""),
    ("rod", "prismatic", "hand", "rod_link", "0 0.1 0", "0 1 0", 100, '<mimic joint="slide" multiplier="0.25"/>'),
    ("finger", "prismatic", "palm", "finger_link", "0 0 0.1", "0 0 1", 20, ""),
]  # fmt: skip


def heavy_robot_text(seed: int = 0) -> str:
    """The URDF; every link but the tool has a random mass and a random inertia that a body can have."""
    rng = np.random.default_rng(seed)
    parts = []
    for link in ("base", *(joint[3] for joint in JOINTS)):
        moments = 0.02 * np.diag(rng.uniform(0.5, 1.0, 3))
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        inertia = turn @ moments @ turn.T
        entries = " ".join(
            f'i{"xyz"[i]}{"xyz"[j]}="{inertia[i, j]!r}"'.replace("np.float64(", "").replace(")", "")
            for i in range(3)
            for j in range(i, 3)
        )
        centre = " ".join(f"{x:.3f}" for x in rng.uniform(-0.1, 0.1, 3))
        body = (
            f'<inertial><origin xyz="{centre}" rpy="0.1 0.2 0.3"/><mass value="{rng.uniform(0.5, 3.0):.3f}"/>'
            f"<inertia {entries}/></inertial>"
        )
        parts.append(f'<link name="{link}">{"" if link == "tool" else body}</link>')
    for name, kind, parent, child, xyz, axis, effort, mimic in JOINTS:
        limit = "" if kind == "fixed" else LIMIT.format(effort=effort)
        parts.append(
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{xyz}" rpy="0.1 -0.2 0.3"/><axis xyz="{axis}"/>{limit}{mimic}</joint>'
        )
    return f'<robot name="heavy">{"".join(parts)}</robot>'
