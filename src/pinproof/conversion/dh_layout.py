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
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from pinproof.description.dh_row import DhRow, row_transform
from pinproof.description.dh_table import DhTable

__all__ = ["ahead", "behind", "joint_origins", "tool_origin"]

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
