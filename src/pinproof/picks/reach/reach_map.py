"""A reach map: what was found at every point of a region, in every orientation."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.picks.reach.region import ReachRegion

__all__ = ["ReachMap"]

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class ReachMap:
    """What an arm reaches over a region.

    Parameters
    ----------
    region
        The N points, in the frame of the robot's root link, or of the world it was placed in.
    orientations
        (m, 3, 3) ``root_from_tip``.
    reachable
        (N, m) whether a configuration inside the limits was found.
    free
        (N, m) whether one was found that also keeps every margin. Always proven for the configuration found.
    manipulability
        (N, m) sqrt(det(J J^T)) of the best free configuration found (Yoshikawa 1985; metres and radians mixed as J has
        them); NaN where none is free.
    clearance
        (N, m) metres between the bodies nearest to each other there; NaN where none is free.
    complete
        Whether the closed form told every configuration: what is not reachable, or not free, then cannot be. Else a
        "no" is one of a search.
    title
        What was looked at: robot, tool and scene, in words.
    """

    region: ReachRegion
    orientations: Array
    reachable: Mask
    free: Mask
    manipulability: Array
    clearance: Array
    complete: bool
    title: str = ""

    def __post_init__(self) -> None:
        count = len(self.region), len(self.orientations)
        for name in ("orientations", "reachable", "free", "manipulability", "clearance"):
            array = np.array(getattr(self, name))
            wanted = (count[1], 3, 3) if name == "orientations" else count
            if array.shape != wanted:
                raise InputError(f"{name} must have the shape {wanted}, one for each point and orientation")
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def reach_share(self) -> Array:
        """(N,) the share of orientations that are reachable at each point, 0 to 1."""
        return np.asarray(self.reachable.mean(axis=1))

    @property
    def free_share(self) -> Array:
        """(N,) the share of orientations that are reachable and free at each point, 0 to 1."""
        return np.asarray(self.free.mean(axis=1))

    @property
    def best_manipulability(self) -> Array:
        """(N,) the largest over all orientations; NaN where none is free."""
        return _best(self.manipulability)

    @property
    def best_clearance(self) -> Array:
        """(N,) metres, the largest over all orientations; NaN where none is free."""
        return _best(self.clearance)

    @property
    def summary(self) -> str:
        """The map in a sentence."""
        points, full = float((self.free_share > 0).mean()), float((self.free_share == 1).mean())
        how = "every configuration enumerated" if self.complete else "configurations searched for, others may exist"
        return (
            f"{len(self.region)} points x {len(self.orientations)} orientations: {self.reachable.mean():.1%} "
            f"reachable, {self.free.mean():.1%} reachable and free; {points:.1%} of the points in some orientation, "
            f"{full:.1%} in all ({how})"
        )

    def save(self, path: str | Path) -> None:
        """Write the map, whole or not at all: ``.csv`` (a row a point), ``.npz`` (all of it), ``.png`` (slices).

        Raises
        ------
        InputError
            For another ending, or a picture of points that are no grid.
        FileError
            For a place that cannot be written to.
        """
        from pinproof.picks.reach.reach_files import write

        write(path, self)

    @classmethod
    def load(cls, path: str | Path) -> ReachMap:
        """Read a map that was saved as ``.npz``.

        Raises
        ------
        FileError
            Naming the file and what is wrong with it.
        """
        from pinproof.picks.reach.reach_files import read

        return read(path)

    def same_question(self, other: ReachMap) -> str:
        """Why two maps cannot be compared; empty if they ask for the same poses."""
        if not self.region.equals(other.region):
            return f"they have different regions: {self.region} and {other.region}"
        if not np.array_equal(self.orientations, other.orientations):
            return f"they have different orientations: {len(self.orientations)} and {len(other.orientations)}"
        return ""


def _best(values: Array) -> Array:
    """(N,) the largest of each row (N, m) that is a number; NaN where none is."""
    filled = np.where(np.isnan(values), -np.inf, values).max(axis=1)
    return np.where(np.isneginf(filled), np.nan, filled)
