"""Reach maps: what an arm reaches at every point of a region in every orientation, comparisons of two maps, and files.

Maps are saved as CSV for spreadsheets, as NPZ with all data, and as PNG with slices of the region.
"""

from __future__ import annotations

import csv
import io
import zipfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker
from pinproof.common.files import write_bytes_whole, write_text_whole
from pinproof.common.validation import require_integer
from pinproof.errors import FileError, InputError
from pinproof.picks.batch.reach_region import ReachRegion
from pinproof.picks.batch.screening import Screening, ScreenStatus, code_of
from pinproof.spatial import SE3, matrix, rigid, rigid_many

__all__ = [
    "SHARE",
    "WON_AND_LOST",
    "ReachComparison",
    "ReachMap",
    "_read_map",
    "_write_comparison",
    "_write_map",
    "reach_map",
    "slices",
]

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
        _write_map(path, self)

    @classmethod
    def load(cls, path: str | Path) -> ReachMap:
        """Read a map that was saved as ``.npz``.

        Raises
        ------
        FileError
            Naming the file and what is wrong with it.
        """
        return _read_map(path)

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


@dataclass(frozen=True, eq=False)
class ReachComparison:
    """What a change of the set-up won and lost.

    Parameters
    ----------
    before, after
        Maps of the same poses.

    Raises
    ------
    InputError
        If they asked for different poses.
    """

    before: ReachMap
    after: ReachMap

    def __post_init__(self) -> None:
        if differ := self.before.same_question(self.after):
            raise InputError(f"two reach maps cannot be compared: {differ}")

    @property
    def won(self) -> npt.NDArray[np.bool_]:
        """(N, m) poses that are free after, and were not before."""
        return np.asarray(self.after.free & ~self.before.free)

    @property
    def lost(self) -> npt.NDArray[np.bool_]:
        """(N, m) poses that were free before, and are not after."""
        return np.asarray(self.before.free & ~self.after.free)

    @property
    def summary(self) -> str:
        """The change in a sentence, with the places where most was won and lost."""
        total = self.before.free.size
        words = [f"of {total} poses {_share(self.won, total)} won, {_share(self.lost, total)} lost"]
        for name, mask in (("won", self.won), ("lost", self.lost)):
            counts = mask.sum(axis=1)
            if counts.any():
                where = self.before.region.points[int(counts.argmax())]
                words.append(f"most {name} at ({', '.join(f'{v:.3f}' for v in where)}): {counts.max()} orientations")
        words += (
            []
            if self.before.complete and self.after.complete
            else ["poses that are not free were searched, not proven"]
        )
        return "; ".join(words)

    def save(self, path: str | Path) -> None:
        """Write the change, whole or not at all: ``.csv`` (a row a point) or ``.png`` (slices, won less lost).

        Raises
        ------
        InputError
            For another ending, or a picture of points that are no grid.
        FileError
            For a place that cannot be written to.
        """
        _write_comparison(path, self)


def _share(mask: npt.NDArray[np.bool_], total: int) -> str:
    return f"{int(mask.sum())} ({mask.sum() / total:.1%})"


MOST_SLICES = 12
"""More would be stamps; of more heights these many are picked, evenly."""

SHARE = ("viridis", 0.0, 1.0)
WON_AND_LOST = ("RdBu", -1.0, 1.0)
"""Colour map and the values at its ends."""


def slices(
    region: ReachRegion,
    values: npt.NDArray[np.float64],
    title: str,
    label: str,
    colours: tuple[str, float, float] = SHARE,
) -> bytes:
    """A PNG of ``values`` (N,) over a grid: one panel for each place along the axis with the fewest.

    Raises
    ------
    InputError
        If the region is no grid, or only a line or a point of one.
    """
    if region.axes is None:
        raise InputError(
            "a PNG shows slices of a grid, such as ReachRegion.box returns; this region is a list of single points"
        )
    counts = [len(axis) for axis in region.axes]
    through = min((counts[k], -k) for k in range(3))[1] * -1  # of equals z, so that slices are heights
    across = [k for k in range(3) if k != through]
    if any(counts[k] < 2 for k in across):
        raise InputError("a PNG needs a region that extends along at least two axes")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    grid = np.moveaxis(values.reshape(counts), through, 0)
    places = np.unique(np.linspace(0, counts[through] - 1, min(counts[through], MOST_SLICES)).round().astype(int))
    wide = int(np.ceil(np.sqrt(len(places))))
    tall = int(np.ceil(len(places) / wide))
    a, b = (region.axes[k] for k in across)
    figure = Figure(figsize=(3.4 * wide + 1.6, 3.2 * tall + 1.0), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(tall, wide, squeeze=False, sharex=True, sharey=True).ravel()
    half = [0.5 * (axis[1] - axis[0]) for axis in (a, b)]
    extent = (a[0] - half[0], a[-1] + half[0], b[0] - half[1], b[-1] + half[1])
    names = "xyz"
    for panel, place in zip(panels, places, strict=False):
        image = panel.imshow(
            grid[place].T, origin="lower", extent=extent, cmap=colours[0], vmin=colours[1], vmax=colours[2]
        )
        panel.set_title(f"{names[through]} = {region.axes[through][place]:.3f} m", fontsize=10)
        panel.plot(0.0, 0.0, "+", color="black", markersize=9) if through == 2 else None
    for panel in panels[len(places) :]:
        panel.set_visible(False)
    figure.supxlabel(f"{names[across[0]]} [m]")
    figure.supylabel(f"{names[across[1]]} [m]")
    figure.suptitle(title, fontsize=11)
    figure.colorbar(image, ax=panels.tolist(), label=label, shrink=0.8)
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=110, metadata={"Software": None})
    return out.getvalue()


SCHEMA = "pinproof/reach/1"
ARRAYS = ("orientations", "reachable", "free", "manipulability", "clearance")
COLUMNS = ("x", "y", "z", "reach_share", "free_share", "best_manipulability", "best_clearance")


def _write_map(path: str | Path, reach: ReachMap) -> None:
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


def _write_comparison(path: str | Path, change: ReachComparison) -> None:
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


def _read_map(path: str | Path) -> ReachMap:
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
        raise FileError(path, f"is not a reach map in .npz format: {error}") from error


def _kind(path: str | Path, known: tuple[str, ...]) -> str:
    kind = Path(path).suffix.lower()
    if kind not in known:
        raise InputError(f"{path}: the suffix must be {' or '.join(known)}, not {kind or 'empty'}")
    return kind


def _csv(columns: tuple[str, ...], rows: npt.NDArray[np.float64]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([["" if np.isnan(value) else f"{value:.9g}" for value in row] for row in rows])
    return out.getvalue()


CHUNK = 4096
"""Poses solved at a time: their answers stay in the processor's cache, and progress can be told."""


def reach_map(
    checker: CollisionChecker,
    region: ReachRegion,
    orientations: npt.ArrayLike,
    *,
    tip: SE3 | npt.ArrayLike | None = None,
    world_from_root: SE3 | npt.ArrayLike | None = None,
    attempts: int = 4,
    rng: int = 0,
    threads: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> ReachMap:
    """Tell at every point of a region, in every orientation, whether it is reachable, whether free, and how well.

    A :func:`pinproof.screen_picks` over a grid. Where the arm has a closed form, of the free branches the most
    manipulable is told of. Arms of seven are swept along a joint, others searched from up to ``attempts`` starts, until
    something free is found.

    Parameters
    ----------
    checker
        The arm in its scene, with its tool attached.
    region
        Where; see :meth:`ReachRegion.box`.
    orientations
        (m, 3, 3) ``root_from_tip`` rotations, as :func:`tool_orientations` makes them.
    tip
        ``tcp_from_tip``: what is put onto the points; by default the tcp itself.
    world_from_root
        Where the robot stands in the frame of the region and the orientations, to compare places for it; the checker's
        scene stays in the robot's root frame. By default they are one.
    attempts
        Starts of the search for arms without a closed form.
    rng
        Seed of the starts.
    threads
        Threads that share the work; the answers do not depend on their number.
    progress
        Called with the number of poses done and of all.

    Raises
    ------
    InputError
        If a shape is wrong, a matrix is no rotation, or a setting makes no sense.
    """
    require_integer("threads", threads, 1)
    frames = _frames(orientations)
    arm = checker.arm
    tcp_from_tip = matrix(rigid("tip", SE3.Identity() if tip is None else tip))
    place = rigid("world_from_root", SE3.Identity() if world_from_root is None else world_from_root)
    before, after = np.linalg.inv(matrix(place * arm.root_from_base)), np.linalg.inv(tcp_from_tip)
    screening = Screening(checker, arm.home, attempts=attempts, rng=rng, why=False, clearance=True)
    points, m = len(region), len(frames)
    total = points * m
    reachable, free = np.zeros(total, dtype=bool), np.zeros(total, dtype=bool)
    figures = np.full((total, 2), np.nan)

    def share(start: int) -> int:
        rows = np.arange(start, min(start + CHUNK, total))
        targets = frames[rows % m]
        targets[:, :3, 3] = region.points[rows // m]
        looked = screening.look(before @ targets @ after)
        free[rows] = looked.codes == code_of(ScreenStatus.FREE)
        reachable[rows] = looked.codes > code_of(ScreenStatus.LIMITS)
        figures[rows] = np.column_stack([looked.manipulability, looked.clearance])
        return len(rows)

    done = 0
    with ThreadPoolExecutor(threads) as pool:
        for count in pool.map(share, range(0, total, CHUNK)):
            done += count
            if progress is not None:
                progress(done, total)
    shape = points, m
    return ReachMap(
        region,
        frames[:, :3, :3],
        reachable.reshape(shape),
        free.reshape(shape),
        figures[:, 0].reshape(shape),
        figures[:, 1].reshape(shape),
        screening.complete,
        _title(checker, tcp_from_tip, place),
    )


def _title(checker: CollisionChecker, tcp_from_tip: Array, place: SE3) -> str:
    """What was looked at, in words."""
    arm, tool = checker.arm, ", ".join(body.name for body in checker.attached)
    tip, stands = tcp_from_tip[:3, 3], place.translation
    words = [f"{arm.robot.name}, {arm.base} to {arm.tcp}", f"{len(checker.scene.obstacles)} obstacles"]
    words += [f"with {tool}"] if tool else []
    words += [f"tip {_metres(tip)} m from the tcp"] if tip.any() else []
    words += [f"the robot at {_metres(stands)} m"] if stands.any() else []
    return ", ".join(words)


def _metres(point: Array) -> str:
    return f"({', '.join(f'{value:.3g}' for value in point)})"


def _frames(orientations: npt.ArrayLike) -> Array:
    """The orientations (m, 4, 4) at the origin, each of them checked."""
    given = np.asarray(orientations, dtype=float)
    if given.ndim != 3 or given.shape[1:] != (3, 3) or not len(given):
        raise InputError(f"orientations must have the shape (m, 3, 3), m >= 1, not {given.shape}")
    frames = np.tile(np.eye(4), (len(given), 1, 1))
    frames[:, :3, :3] = given
    return rigid_many("orientations", frames)
