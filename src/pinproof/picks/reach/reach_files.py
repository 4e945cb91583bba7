"""Reach maps on disk: CSV for a spreadsheet, NPZ for all of it, PNG for the eye."""

from __future__ import annotations

import csv
import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.common.files import write_bytes_whole, write_text_whole
from pinproof.errors import FileError, InputError
from pinproof.picks.reach.change import ReachComparison
from pinproof.picks.reach.reach_map import ReachMap
from pinproof.picks.reach.region import ReachRegion
from pinproof.picks.reach.slices import WON_AND_LOST, slices

__all__ = ["read", "write", "write_change"]

SCHEMA = "pinproof/reach/1"
ARRAYS = ("orientations", "reachable", "free", "manipulability", "clearance")
COLUMNS = ("x", "y", "z", "reach_share", "free_share", "best_manipulability", "best_clearance")


def write(path: str | Path, reach: ReachMap) -> None:
    """Write a map as the file's ending says."""
    kind = _kind(path, (".csv", ".npz", ".png"))
    if kind == ".csv":
        figures = reach.reach_share, reach.free_share, reach.best_manipulability, reach.best_clearance
        write_text_whole(path, _csv(COLUMNS, np.column_stack([reach.region.points, *figures])))
    elif kind == ".png":
        share = reach.free_share
        write_bytes_whole(path, slices(reach.region, share, reach.title, "share of orientations reachable and free"))
    else:
        content: dict[str, Any] = {"schema": SCHEMA, "title": reach.title, "complete": reach.complete}
        content |= {"points": reach.region.points, **{name: getattr(reach, name) for name in ARRAYS}}
        content |= {} if reach.region.axes is None else dict(zip("xyz", reach.region.axes, strict=True))
        out = io.BytesIO()
        np.savez_compressed(out, **content)
        write_bytes_whole(path, out.getvalue())


def write_change(path: str | Path, change: ReachComparison) -> None:
    """Write a comparison as the file's ending says."""
    points, won, lost = change.before.region.points, change.won.mean(axis=1), change.lost.mean(axis=1)
    if _kind(path, (".csv", ".png")) == ".csv":
        shares = change.before.free_share, change.after.free_share
        columns = ("x", "y", "z", "before", "after", "won", "lost")
        write_text_whole(path, _csv(columns, np.column_stack([points, *shares, won, lost])))
        return
    title = f"before: {change.before.title}\nafter: {change.after.title}"
    label = "share of orientations won (blue) less lost (red)"
    write_bytes_whole(path, slices(change.before.region, won - lost, title, label, colours=WON_AND_LOST))


def read(path: str | Path) -> ReachMap:
    """Read what :func:`write` wrote as ``.npz``."""
    try:
        with np.load(path, allow_pickle=False) as content:
            if str(content["schema"]) != SCHEMA:
                raise FileError(path, f"holds {str(content['schema'])!r}, not a reach map ({SCHEMA!r})")
            axes = ReachRegion.along([content[name] for name in "xyz"]) if "x" in content else None
            return ReachMap(
                ReachRegion(content["points"], axes),
                **{name: content[name] for name in ARRAYS},
                complete=bool(content["complete"]),
                title=str(content["title"]),
            )
    except (OSError, zipfile.BadZipFile, KeyError, ValueError, EOFError) as error:
        raise FileError(path, f"is no reach map: {error}; one is saved as .npz") from error


def _kind(path: str | Path, known: tuple[str, ...]) -> str:
    kind = Path(path).suffix.lower()
    if kind not in known:
        raise InputError(f"{path}: it is a file of {' or '.join(known)}, not {kind or 'one without ending'}")
    return kind


def _csv(columns: tuple[str, ...], rows: npt.NDArray[np.float64]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([["" if np.isnan(value) else f"{value:.9g}" for value in row] for row in rows])
    return out.getvalue()
