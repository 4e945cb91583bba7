"""Denavit-Hartenberg tables: a serial arm on paper, and the plain matrix product that says where it stands.

The matrix of one row, in both conventions, stands in :mod:`pinproof.description.dh_row`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.description.dh_row import CONVENTIONS, DhRow, row_transform
from pinproof.errors import InputError, UnknownNameError
from pinproof.spatial import finite, matrix, rigid

__all__ = ["DhRow", "DhTable"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DhTable:
    """A serial arm as a Denavit-Hartenberg table.

    Frame ``dh_0`` stands at ``base`` in the arm's base frame, row i leads from dh_(i-1) to dh_i, and the tool stands at
    ``tool`` in dh_n.

    Parameters
    ----------
    rows
        One :class:`DhRow` a joint, base first; names differ.
    convention
        ``"standard"`` or ``"modified"``; never guessed.
    name
        Name of the robot.
    base
        base_from_dh_0, a ``pin.SE3`` or a (4, 4) matrix in metres; kept as a read-only (4, 4) array.
    tool
        dh_n_from_tool, likewise.

    Raises
    ------
    InputError
        For no rows, names that occur twice, an unknown convention (:class:`~pinproof.errors.UnknownNameError`), or a
        base or tool that is no rigid transform.
    """

    rows: tuple[DhRow, ...]
    convention: str = field(kw_only=True)
    name: str = field(default="dh_arm", kw_only=True)
    base: Array = field(default_factory=lambda: np.eye(4), kw_only=True)
    tool: Array = field(default_factory=lambda: np.eye(4), kw_only=True)

    def __post_init__(self) -> None:
        rows = _checked_rows(self.rows)
        if self.convention not in CONVENTIONS:
            raise UnknownNameError("DH convention", self.convention, CONVENTIONS)
        name: object = self.name
        if not isinstance(name, str) or not name.strip() or not name.isprintable():
            raise InputError(f"{self.name!r} is no name for a robot; wanted is printable text")
        object.__setattr__(self, "rows", rows)
        for which in ("base", "tool"):
            transform = matrix(rigid(which, getattr(self, which)))
            transform.setflags(write=False)
            object.__setattr__(self, which, transform)

    def __reduce__(self) -> tuple[Any, ...]:
        # Through the constructor again: NumPy forgets on the way through pickle that an array was read-only.
        return _rebuild, (self.rows, self.convention, self.name, self.base, self.tool)

    def __len__(self) -> int:
        return len(self.rows)

    @classmethod
    def load(cls, path: str | Path) -> DhTable:
        """Read a table from a ``.yaml``, ``.yml`` or ``.csv`` file; see :mod:`pinproof.description.dh_files`.

        Raises
        ------
        DhTableError
            Naming the file, and the row and column where there is one.
        """
        from pinproof.description.dh_files import load_table

        return load_table(path)

    def save(self, path: str | Path) -> None:
        """Write the table to a ``.yaml``, ``.yml`` or ``.csv`` file, whole or not at all; every number keeps its bits.

        Raises
        ------
        InputError
            If a base or a tool would be lost in a ``.csv``, which has no place for them.
        FileError
            If the file cannot be written; :class:`~pinproof.errors.DhTableError` for any other ending.
        """
        from pinproof.description.dh_files import save_table

        save_table(self, path)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the n joints, base first."""
        return tuple(row.name for row in self.rows)

    @property
    def lower(self) -> Array:
        """(n,) lower limits of q, rad or m; -inf for continuous rows."""
        return np.array([row.lower for row in self.rows])

    @property
    def upper(self) -> Array:
        """(n,) upper limits of q, rad or m; inf for continuous rows."""
        return np.array([row.upper for row in self.rows])

    @property
    def velocity(self) -> Array:
        """(n,) largest joint speeds, rad/s or m/s."""
        return np.array([row.velocity for row in self.rows])

    def frames(self, q: npt.ArrayLike) -> Array:
        """Where the frames dh_0 ... dh_n stand.

        Parameters
        ----------
        q
            (n,) joint variables, rad or m; limits are not looked at.

        Returns
        -------
        (n + 1, 4, 4)
            base_from_dh_i. The first is ``base``; the tool comes after the last and is not part of it.

        Raises
        ------
        InputError
            If q has the wrong length or is not finite.
        """
        variables = finite("q", q, (len(self.rows),))
        frames = [self.base]
        for row, value in zip(self.rows, variables, strict=True):
            frames.append(frames[-1] @ row_transform(row, self.convention, float(value)))
        return np.array(frames)

    def forward_kinematics(self, q: npt.ArrayLike) -> Array:
        """base_from_tool (4, 4) at joint variables q (n,): the plain product base A_1 ... A_n tool.

        This is the oracle that everything converted from the table is held against.

        Raises
        ------
        InputError
            If q has the wrong length or is not finite.
        """
        return np.array(self.frames(q)[-1] @ self.tool)

    def is_close(self, other: DhTable, *, tolerance: float = 0.0) -> bool:
        """Whether both tables hold the same words and, up to ``tolerance`` (rad, m, rad/s, m/s), the same numbers."""

        def words(table: DhTable) -> object:
            return table.name, table.convention, [(row.name, row.joint_type) for row in table.rows]

        def numbers(table: DhTable) -> Array:
            columns = [(r.theta, r.d, r.a, r.alpha, r.lower, r.upper, r.velocity) for r in table.rows]
            return np.concatenate([np.ravel(columns), table.base.ravel(), table.tool.ravel()])

        same = words(self) == words(other)
        return same and np.allclose(numbers(self), numbers(other), rtol=0.0, atol=tolerance)


def _checked_rows(rows: Iterable[DhRow]) -> tuple[DhRow, ...]:
    rows = tuple(rows)
    if not rows:
        raise InputError("a DH table needs at least one row")
    seen: dict[str, int] = {}
    for number, row in enumerate(rows, start=1):
        if not isinstance(row, DhRow):
            raise InputError(f"row {number} of a DH table must be a DhRow, not {type(row).__name__}")
        if row.name in seen:
            raise InputError(f"rows {seen[row.name]} and {number} of the DH table are both named {row.name!r}")
        seen[row.name] = number
    return rows


def _rebuild(rows: tuple[DhRow, ...], convention: str, name: str, base: Array, tool: Array) -> DhTable:
    return DhTable(rows, convention=convention, name=name, base=base, tool=tool)
