"""Reach maps: which poses of a region an arm reaches, the comparison of two maps, and their files.

Maps are saved as CSV for spreadsheets, as NPZ with all data, and as PNG with slices of the region.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker
from pinproof.common.files import csv_text, figure
from pinproof.common.results import Saved, View
from pinproof.common.structs import described, key
from pinproof.common.validation import Rng, freeze_arrays, optional_module, require_integer, require_positive
from pinproof.errors import FileError, InputError
from pinproof.ik import Clik
from pinproof.model import Arm
from pinproof.picks.batch.screening import Screening, ScreenStatus, code_of, in_chunks
from pinproof.spatial import SE3, Array, finite, matrix, rigid, rigid_many, unit_vector

if TYPE_CHECKING:
    from pinproof.viewer import ColouredPoints

GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))
"""Radians between consecutive points of the spiral."""


def approach_directions(axis: npt.ArrayLike = (0.0, 0.0, -1.0), half_angle: float = 0.0, count: int = 1) -> Array:
    """(count, 3) unit vectors distributed evenly over the cone of ``half_angle`` (rad) about ``axis`` (3,).

    The vectors lie on a Fibonacci spiral, and each represents the same area of the sphere. A ``half_angle`` of pi
    covers the complete sphere. A ``count`` of 1 gives only the axis.

    Raises
    ------
    InputError
        If the axis is zero, the angle is outside [0, pi], or the count is not a positive integer.

    References
    ----------
    Swinbank, Purser (2006), "Fibonacci grids: a novel approach to global modelling".
    """
    direction = np.array(unit_vector("axis", axis))
    require_positive("half_angle", half_angle, zero=True)
    if half_angle > np.pi:
        raise InputError(f"half_angle = {half_angle}; it must be from 0 to pi rad")
    require_integer("count", count, 1)
    if count == 1 or half_angle == 0.0:
        return direction[None]
    # A spiral on the cone, whose points represent equal areas
    index = np.arange(count)
    height = 1.0 - (1.0 - np.cos(half_angle)) * (index + 0.5) / count
    radius, turn = np.sqrt(1.0 - height**2), GOLDEN_ANGLE * index
    around = np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=1)
    return np.asarray(around @ _with_z(direction).T)


def tool_orientations(directions: npt.ArrayLike = (0.0, 0.0, -1.0), spins: int = 8) -> Array:
    """(d * spins, 3, 3) ``root_from_tip`` rotations whose z axis is along the directions (3,) or (d, 3).

    For each direction there are ``spins`` rotations about it, evenly distributed over 2 pi. The x axis of the first one
    is as close as possible to the x axis of the root (to its y axis if the direction is close to x).

    Raises
    ------
    InputError
        If a direction is zero or the number of spins is not a positive integer.
    """
    # nested lists of different lengths have no dimension; finite() then names the valid shapes
    single = np.ndim(np.asarray(directions, dtype=object)) == 1 and not isinstance(directions, str)
    many = finite("directions", directions, (3,) if single else (None, 3)).reshape(-1, 3)
    lengths = np.linalg.norm(many, axis=1)
    if not (lengths > 1e-9).all():
        raise InputError(f"direction {int(np.flatnonzero(lengths <= 1e-9)[0])} is zero")
    require_integer("spins", spins, 1)
    # Rotations about z, then z to each direction
    turns = 2.0 * np.pi * np.arange(spins) / spins
    about_z = np.zeros((spins, 3, 3))
    about_z[:, 0, 0] = about_z[:, 1, 1] = np.cos(turns)
    about_z[:, 1, 0] = np.sin(turns)
    about_z[:, 0, 1] = -about_z[:, 1, 0]
    about_z[:, 2, 2] = 1.0
    frames = np.stack([_with_z(z) for z in many / lengths[:, None]])
    return np.asarray((frames[:, None] @ about_z[None]).reshape(-1, 3, 3))


def _with_z(z: Array) -> Array:
    """A rotation (3, 3) whose third column is the unit vector z (3,)."""
    near = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = near - (near @ z) * z
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


MOST_POINTS = 5_000_000
"""Largest number of points of a grid; more usually means that the step was given in millimetres."""


@described(eq=False)
class ReachRegion:
    """Points in the frame of the robot's root link.

    Raises
    ------
    InputError
        If there are no points, or a coordinate is not finite.
    """

    points: Array = key("(N, 3) in metres")
    axes: tuple[Array, Array, Array] | None = key(
        "the coordinates of a grid along x, y and z, in whose points z varies fastest; None if the points are not a "
        "grid",
        default=None,
    )

    def __post_init__(self) -> None:
        points = finite("points", self.points, (None, 3))
        if not len(points):
            raise InputError("points is empty; a region needs at least one point")
        points.flags.writeable = False
        object.__setattr__(self, "points", points)

    @classmethod
    def box(cls, lower: npt.ArrayLike, upper: npt.ArrayLike, step: float) -> ReachRegion:
        """A grid over the box from ``lower`` to ``upper`` (3,), both included.

        If coordinates of the corners are equal, the grid is a surface, a line or a point. The points are evenly spaced,
        at most ``step`` (m) apart.

        Raises
        ------
        InputError
            If an upper coordinate is below the lower one, the step is not positive, or there are too many points.
        """
        low, high = finite("lower", lower, (3,)), finite("upper", upper, (3,))
        for name, a, b in zip("xyz", low, high, strict=True):
            if b < a:
                raise InputError(f"the region's upper {name} = {b} is below its lower {name} = {a}")
        if not 0.0 < step < np.inf:
            raise InputError(f"step = {step}; it must be a distance in metres above 0")
        # rounding errors must not add a point to a side that is a multiple of the step
        counts = [int(np.ceil((b - a) / step * (1.0 - 1e-12))) + 1 for a, b in zip(low, high, strict=True)]
        if np.prod([float(count) for count in counts]) > MOST_POINTS:
            raise InputError(
                f"a step of {step} m makes {' x '.join(map(str, counts))} points, more than {MOST_POINTS}; "
                "choose a larger step"
            )
        x, y, z = (np.linspace(a, b, count) for a, b, count in zip(low, high, counts, strict=True))
        grid = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1)
        return cls(grid.reshape(-1, 3), (x, y, z))

    @property
    def shape(self) -> tuple[int, ...]:
        """The numbers of points along x, y and z for a grid; otherwise (N,)."""
        return (len(self.points),) if self.axes is None else tuple(len(axis) for axis in self.axes)

    def equals(self, other: ReachRegion) -> bool:
        """Whether both regions have the same points in the same order."""
        return bool(np.array_equal(self.points, other.points))

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        return f"ReachRegion({' x '.join(map(str, self.shape))} points)"


Mask = npt.NDArray[np.bool_]

SCHEMA = "pinproof/reach/1"
ARRAYS = ("orientations", "reachable", "free", "manipulability", "clearance")


@described(eq=False)
class ReachMap(Saved):
    """The poses that an arm reaches in a region."""

    region: ReachRegion = key(
        "the N points, in the frame of the root link of the robot, or in the world frame if the robot was placed in it"
    )
    orientations: Array = key("(m, 3, 3) ``root_from_tip``")
    reachable: Mask = key("(N, m) whether a configuration within the limits was found")
    free: Mask = key(
        "(N, m) whether a configuration was found that also keeps every margin, which is proven for that configuration"
    )
    manipulability: Array = key(
        "(N, m) sqrt(det(J J^T)) of the best free configuration found (Yoshikawa 1985; J mixes metres and radians); "
        "NaN if none is free"
    )
    clearance: Array = key(
        "(N, m) smallest distance (m) between any two bodies in that configuration; NaN if none is free"
    )
    complete: bool = key(
        "whether all configurations were enumerated in closed form. If so, poses that are not reachable or not free "
        "are proven to be so; otherwise a search found no such configuration"
    )
    title: str = key("the robot, tool and scene, as text", default="")

    formats = (".csv", ".npz", ".png")

    def _view(self) -> View:
        points, orientations = self.reachable.shape
        shares = f"{self.reachable.mean():.1%} reachable, {self.free.mean():.1%} free"
        return View(f"{points:,} points, {orientations} orientations: {shares}", title=self.summary)

    def __post_init__(self) -> None:
        count = len(self.region), len(self.orientations)
        for name in ARRAYS:
            freeze_arrays(self, name)
            wanted = (count[1], 3, 3) if name == "orientations" else count
            if getattr(self, name).shape != wanted:
                raise InputError(f"{name} must have the shape {wanted}, one for each point and orientation")

    @property
    def reach_share(self) -> Array:
        """(N,) fraction of the orientations that are reachable at each point, 0 to 1."""
        return np.asarray(self.reachable.mean(axis=1))

    @property
    def free_share(self) -> Array:
        """(N,) fraction of the orientations that are reachable and free at each point, 0 to 1."""
        return np.asarray(self.free.mean(axis=1))

    @property
    def best_manipulability(self) -> Array:
        """(N,) largest manipulability over all orientations; NaN if none is free."""
        return _best(self.manipulability)

    @property
    def best_clearance(self) -> Array:
        """(N,) largest clearance (m) over all orientations; NaN if none is free."""
        return _best(self.clearance)

    @property
    def summary(self) -> str:
        """A summary of the map in one sentence."""
        points, full = float((self.free_share > 0).mean()), float((self.free_share == 1).mean())
        how = "every configuration enumerated" if self.complete else "configurations searched for, others may exist"
        return (
            f"{len(self.region)} points x {len(self.orientations)} orientations: {self.reachable.mean():.1%} "
            f"reachable, {self.free.mean():.1%} reachable and free; {points:.1%} of the points in some orientation, "
            f"{full:.1%} in all ({how})"
        )

    def coloured_points(self, world_from_root: SE3, *, size: float) -> ColouredPoints:
        """The points that are free in some orientation, for a page of the arm; ``size`` is the grid step (m)."""
        return _coloured(self, np.any(self.free, axis=1), self.free_share, world_from_root, size, label="share free:")

    def to_csv(self) -> str:
        """One row per point."""
        columns = ("x", "y", "z", "reach_share", "free_share", "best_manipulability", "best_clearance")
        figures = self.reach_share, self.free_share, self.best_manipulability, self.best_clearance
        return _table(columns, self.region.points, *figures)

    def _npz(self) -> bytes:
        content: dict[str, Any] = {"schema": SCHEMA, "title": self.title, "complete": self.complete}
        content |= {"points": self.region.points, **{name: getattr(self, name) for name in ARRAYS}}
        content |= {} if self.region.axes is None else dict(zip("xyz", self.region.axes, strict=True))
        out = io.BytesIO()
        np.savez_compressed(out, **content)
        return out.getvalue()

    def _png(self) -> bytes:
        return slices(self.region, self.free_share, self.title, "share of orientations reachable and free")

    @classmethod
    def load(cls, path: str | Path) -> ReachMap:
        """Read a map that was saved as ``.npz``.

        Raises
        ------
        FileError
            If the file cannot be read; the message names the file and the reason.
        """
        try:
            with np.load(path, allow_pickle=False) as content:
                if str(content["schema"]) != SCHEMA:
                    raise FileError(path, f"holds {str(content['schema'])!r}, not a reach map ({SCHEMA!r})")
                axes = (content["x"], content["y"], content["z"]) if "x" in content else None
                return cls(
                    ReachRegion(content["points"], axes),
                    **{name: content[name] for name in ARRAYS},
                    complete=bool(content["complete"]),
                    title=str(content["title"]),
                )
        except (OSError, zipfile.BadZipFile, KeyError, ValueError, EOFError) as error:
            raise FileError(path, f"is not a reach map in .npz format: {error}") from error


def _best(values: Array) -> Array:
    """(N,) maximum of each row of (N, m), ignoring NaN; NaN if all values of the row are NaN."""
    filled = np.where(np.isnan(values), -np.inf, values).max(axis=1)
    return np.where(np.isneginf(filled), np.nan, filled)


@described(eq=False)
class ReachComparison(Saved):
    """The poses that a change of the setup gains and loses.

    Raises
    ------
    InputError
        If the maps have different poses.
    """

    before: ReachMap = key("the first map")
    after: ReachMap = key("the second map, of the same poses")

    formats = (".csv", ".png")

    def _view(self) -> View:
        return View(self.summary)

    def __post_init__(self) -> None:
        one, other = self.before, self.after
        if not one.region.equals(other.region):
            raise InputError(f"the maps have different regions: {one.region} and {other.region}")
        if not np.array_equal(one.orientations, other.orientations):
            counts = f"{len(one.orientations)} and {len(other.orientations)}"
            raise InputError(f"the maps have different orientations: {counts}")

    @property
    def won(self) -> npt.NDArray[np.bool_]:
        """(N, m) poses that are free in ``after`` but not in ``before``."""
        return np.asarray(self.after.free & ~self.before.free)

    @property
    def lost(self) -> npt.NDArray[np.bool_]:
        """(N, m) poses that are free in ``before`` but not in ``after``."""
        return np.asarray(self.before.free & ~self.after.free)

    @property
    def summary(self) -> str:
        """A summary of the change in one sentence, with the points that gain and lose the most orientations."""
        total = self.before.free.size
        words = [f"of {total} poses {_share(self.won, total)} won, {_share(self.lost, total)} lost"]
        for name, mask in (("won", self.won), ("lost", self.lost)):
            counts = mask.sum(axis=1)
            if counts.any():
                where = self.before.region.points[int(counts.argmax())]
                words.append(f"most {name} at ({', '.join(f'{v:.3f}' for v in where)}): {counts.max()} orientations")
        if not (self.before.complete and self.after.complete):
            words.append("poses that are not free were searched, not proven")
        return "; ".join(words)

    def coloured_points(self, world_from_root: SE3, *, size: float) -> ColouredPoints:
        """The points that gain or lose an orientation, for a page of the arm; ``size`` is the grid step (m)."""
        change, label = self.won.mean(axis=1) - self.lost.mean(axis=1), "gained minus lost:"
        changed = np.any(self.won | self.lost, axis=1)
        colours = {"colours": WON_AND_LOST[0], "low": WON_AND_LOST[1], "high": WON_AND_LOST[2]}
        return _coloured(self.after, changed, change, world_from_root, size, label=label, **colours)

    def to_csv(self) -> str:
        """One row per point."""
        shares = self.before.free_share, self.after.free_share, self.won.mean(axis=1), self.lost.mean(axis=1)
        return _table(("x", "y", "z", "before", "after", "won", "lost"), self.before.region.points, *shares)

    def _png(self) -> bytes:
        title = f"before: {self.before.title}\nafter: {self.after.title}"
        label = "share of orientations won (blue) less lost (red)"
        change = self.won.mean(axis=1) - self.lost.mean(axis=1)
        return slices(self.before.region, change, title, label, colours=WON_AND_LOST)


POINT_SIZE, MAX_POINT_SIZE = 0.4, 0.04
"""Size of a drawn point: as a fraction of the grid step, and the largest size in metres."""


def _coloured(
    reach: ReachMap, shown: Mask, values: Array, world_from_root: SE3, step: float, **colours: Any
) -> ColouredPoints:
    """The shown points in the frame of the robot's root; the others would hide them."""
    from pinproof.viewer import ColouredPoints

    local = (reach.region.points[shown] - world_from_root.translation) @ world_from_root.rotation
    size = min(POINT_SIZE * step, MAX_POINT_SIZE)
    return ColouredPoints.of_values(local, values[shown], size=size, **colours)


def _share(mask: npt.NDArray[np.bool_], total: int) -> str:
    return f"{int(mask.sum())} ({mask.sum() / total:.1%})"


MOST_SLICES = 12
"""Largest number of panels in a picture; if there are more slices, evenly spaced ones are chosen."""

SHARE = ("viridis", 0.0, 1.0)
WON_AND_LOST = ("RdBu", -1.0, 1.0)
"""Colour map, and its minimum and maximum value."""


def slices(
    region: ReachRegion,
    values: npt.NDArray[np.float64],
    title: str,
    label: str,
    colours: tuple[str, float, float] = SHARE,
) -> bytes:
    """A PNG of ``values`` (N,) over a grid: one panel per slice.

    The slices are perpendicular to the axis with the fewest points. InputError if the region is not a grid, or extends
    along fewer than two axes.
    """
    if region.axes is None:
        raise InputError(
            "a PNG shows slices of a grid, such as ReachRegion.box returns; this region is a list of single points"
        )
    # The axis with the fewest points is that of the slices
    counts = [len(axis) for axis in region.axes]
    through = min((counts[k], -k) for k in range(3))[1] * -1  # prefer z if equal: horizontal slices
    across = [k for k in range(3) if k != through]
    if any(counts[k] < 2 for k in across):
        raise InputError("a PNG needs a region that extends along at least two axes")
    figures = optional_module("matplotlib.figure", "a PNG", "plot")
    # Evenly spaced slices, side by side
    grid = np.moveaxis(values.reshape(counts), through, 0)
    places = np.unique(np.linspace(0, counts[through] - 1, min(counts[through], MOST_SLICES)).round().astype(int))
    wide = int(np.ceil(np.sqrt(len(places))))
    tall = int(np.ceil(len(places) / wide))
    a, b = (region.axes[k] for k in across)
    # One panel for each slice, all with the same scale
    picture = figures.Figure(figsize=(3.4 * wide + 1.6, 3.2 * tall + 1.0), layout="constrained")
    panels = picture.subplots(tall, wide, squeeze=False, sharex=True, sharey=True).ravel()
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
    picture.supxlabel(f"{names[across[0]]} [m]")
    picture.supylabel(f"{names[across[1]]} [m]")
    picture.suptitle(title, fontsize=11)
    picture.colorbar(image, ax=panels.tolist(), label=label, shrink=0.8)
    out = io.BytesIO()
    picture.savefig(out, format="png", dpi=110, metadata={"Software": None})
    return out.getvalue()


def _table(columns: tuple[str, ...], points: Array, *figures: Array) -> str:
    return csv_text(columns, (map(figure, row) for row in np.column_stack([points, *figures]).tolist()))


def attainable_orientations(
    arm: Arm,
    orientations: npt.ArrayLike,
    *,
    tip: SE3 | npt.ArrayLike | None = None,
    world_from_root: SE3 | npt.ArrayLike | None = None,
    rng: Rng = 0,
) -> Mask:
    """Search for configurations with each orientation at any position; without obstacles and self-collision.

    The result (m,) is True where a configuration was found. An arm with fewer than six joints takes only some
    orientations. If a search fails, this is no proof.

    Parameters
    ----------
    arm, orientations, tip, world_from_root, rng
        As for :func:`reach_map`.
    """
    before, after = _base_and_tip(arm, tip, world_from_root)
    targets = before @ _frames(orientations) @ after
    return np.asarray(Clik().solve_batch(arm, targets, rng=rng, task="orientation").ok)


def _base_and_tip(arm: Arm, tip: SE3 | npt.ArrayLike | None, place: SE3 | npt.ArrayLike | None) -> tuple[Array, Array]:
    """``base_from_world`` and ``tip_from_tcp`` (4, 4), between which a target is ``world_from_tip``."""
    tcp_from_tip = SE3.Identity() if tip is None else rigid("tip", tip)
    world_from_root = SE3.Identity() if place is None else rigid("world_from_root", place)
    return matrix((world_from_root * arm.root_from_base).inverse()), matrix(tcp_from_tip.inverse())


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
    """Compute for each point and orientation whether it is reachable and free, its manipulability and its clearance.

    This is equivalent to :func:`pinproof.screen_picks` over a grid. If the arm has closed-form IK, the result is the
    free branch with the largest manipulability. For arms with seven joints, one joint is swept. For all other arms, a
    numerical search runs from up to ``attempts`` start configurations until a free configuration is found.

    Parameters
    ----------
    checker
        The arm in its scene, with its tool attached.
    region
        The points; see :meth:`ReachRegion.box`.
    orientations
        (m, 3, 3) ``root_from_tip`` rotations, such as those of :func:`tool_orientations`.
    tip
        ``tcp_from_tip``: the frame that is placed at the points; the default is the tcp.
    world_from_root
        The pose of the root link in the frame of the region and the orientations, for the comparison of base
        placements. The scene of the checker remains in the root frame. The default is the identity.
    attempts, rng, threads, progress
        As for :func:`pinproof.screen_picks`.

    Raises
    ------
    InputError
        If a shape is wrong, a matrix is not a rotation, or a setting is invalid.
    """
    require_integer("threads", threads, 1)
    # All poses in chunks, orientation by orientation at each point
    frames = _frames(orientations)
    arm = checker.arm
    before, after = _base_and_tip(arm, tip, world_from_root)
    # Whether a pose without a free configuration fails at the limits or by contact is not of interest
    screening = Screening(checker, arm.home, attempts=attempts, rng=rng, why=False, clearance=True)
    points, m = len(region), len(frames)
    total = points * m
    reachable, free = np.zeros(total, dtype=bool), np.zeros(total, dtype=bool)
    figures = np.full((total, 2), np.nan)

    def share(start: int, stop: int) -> None:
        rows = np.arange(start, stop)
        targets = frames[rows % m]
        targets[:, :3, 3] = region.points[rows // m]
        screened = screening.screen(before @ targets @ after)
        free[rows] = screened.codes == code_of(ScreenStatus.FREE)
        reachable[rows] = screened.codes > code_of(ScreenStatus.LIMITS)
        figures[rows] = np.column_stack([screened.manipulability, screened.clearance])

    in_chunks(share, total, threads, progress)
    # The title states the robot, tool and scene
    words = [f"{arm.robot.name}, {arm.base} to {arm.tcp}", f"{len(checker.scene)} obstacles"]
    words += [f"with {', '.join(body.name for body in checker.attached)}"] if checker.attached else []
    for name, stated, text in (
        ("tip", tip, "tip {} m from the tcp"),
        ("world_from_root", world_from_root, "the robot at {} m"),
    ):
        if stated is not None and (offset := rigid(name, stated).translation).any():
            words.append(text.format(f"({', '.join(f'{value:.3g}' for value in offset)})"))
    shape = points, m
    return ReachMap(
        region,
        frames[:, :3, :3],
        reachable.reshape(shape),
        free.reshape(shape),
        figures[:, 0].reshape(shape),
        figures[:, 1].reshape(shape),
        screening.complete,
        ", ".join(words),
    )


def _frames(orientations: npt.ArrayLike) -> Array:
    """The validated orientations as transforms (m, 4, 4) at the origin."""
    given = np.asarray(orientations, dtype=float)
    if given.ndim != 3 or given.shape[1:] != (3, 3) or not len(given):
        raise InputError(f"orientations must have the shape (m, 3, 3), m >= 1, not {given.shape}")
    frames = np.tile(np.eye(4), (len(given), 1, 1))
    frames[:, :3, :3] = given
    return rigid_many("orientations", frames)
