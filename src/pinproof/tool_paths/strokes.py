"""Strokes: the tool paths of one job, between which the tool is lifted."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from pinproof.common.structs import described, key
from pinproof.common.validation import require_type
from pinproof.errors import InputError
from pinproof.spatial import SE3
from pinproof.tool_paths.path import ToolPath

# Largest difference of the axes of the tool at the two ends of a closed path.
SAME_AXES = 1e-6


@described(eq=False)
class Stroke:
    """A tool path that is followed without lifting the tool, and what may be chosen for it."""

    name: str = key("name of the stroke")
    path: ToolPath = key("its path, in the frame that the job states")
    process: bool = key("whether the process, such as the flow of glue, is on while it is followed", default=True)
    reversible: bool = key("whether it may be followed from its end to its start", default=True)
    closed: bool = key("whether it may start at any of its poses; its path then ends where it begins", default=False)

    def __post_init__(self) -> None:
        require_type("path", self.path, ToolPath)
        if self.closed and not self.can_be_closed(self.path):
            raise InputError(
                f"stroke {self.name!r} is stated as closed, but the first and the last pose of its path differ"
            )

    @staticmethod
    def can_be_closed(path: ToolPath) -> bool:
        """Whether the first and the last pose are equal, so that the path may start at any of its poses."""
        return path.closed and float(np.abs(path.poses[0, :3, :3] - path.poses[-1, :3, :3]).max()) < SAME_AXES

    def transformed(self, a_from_b: SE3 | npt.ArrayLike) -> Stroke:
        """The stroke in another frame."""
        return replace(self, path=self.path.transformed(a_from_b))

    def variant(self, start: int = 0, *, reverse: bool = False) -> Stroke:
        """The stroke from one of the poses of a closed path, and in its direction or the opposite one.

        Raises
        ------
        InputError
            If the stroke is not closed and ``start`` is not 0, or it is not reversible.
        """
        if (start and not self.closed) or (reverse and not self.reversible):
            raise InputError(f"stroke {self.name!r} {'is not reversible' if reverse else 'is not closed'}")
        path = self.path.started_at(start) if start else self.path
        return replace(self, path=path.reversed() if reverse else path)


def strokes_of(
    name: str,
    paths: Iterable[tuple[ToolPath, bool]],
    speed: float | None,
    *,
    reversible: bool = True,
    closed: bool | None = None,
) -> tuple[Stroke, ...]:
    """The strokes of one source, with whether the process is on; several have numbers behind the name.

    ``speed`` (m/s) is that of paths that state none. By default, paths whose ends are equal are closed.
    """
    found = list(paths)
    strokes = []
    for number, (path, process) in enumerate(found, 1):
        own = name if len(found) == 1 else f"{name} {number}"
        named = replace(path, name=own, speed=speed if path.speed is None else path.speed)
        free = Stroke.can_be_closed(path) if closed is None else closed
        strokes.append(Stroke(own, named, process, reversible, free))
    return tuple(strokes)
