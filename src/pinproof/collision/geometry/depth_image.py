"""Depth images and point clouds: their files, cameras, units and sizes, and bodies that are removed from them."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from pinproof._core import Shape
from pinproof.collision.geometry.shape_values import point_array
from pinproof.common import structs as st
from pinproof.common.files import refuse_unreadable, unknown_suffix
from pinproof.common.validation import named_arguments, optional_module, require_positive
from pinproof.description import positions, read_elements
from pinproof.errors import FileError, InputError
from pinproof.spatial import SE3, Array, finite, matrix, rigid
from pinproof.units import MOST_REACH

LARGEST_FILE = 2**30
"""Bytes: a cloud of about 70 million points."""

Numbers = npt.NDArray[Any]


def read_image(path: str | Path) -> Numbers:
    """Return the numbers of an image file: ``.npy``, ``.png``, or ``.exr`` with the extra ``sensor``.

    FileError if it has another suffix or cannot be read; InputError if an extra is missing.
    """
    return _read(path, "depth image", (".npy", ".png", ".exr"))


def read_points(path: str | Path) -> npt.NDArray[np.float64]:
    """Return the points (N, 3) of a file: ``.npy``, ``.ply``, or ``.pcd`` with the extra ``sensor``.

    The points are returned in the frame of the file, including those that are not finite. The viewpoint that a PCD
    file may state is not applied.

    Raises
    ------
    FileError
        If it has another suffix, cannot be read, or has no points of three coordinates.
    InputError
        If an extra is missing.
    """
    points = _read(path, "point cloud", (".npy", ".ply", ".pcd"))
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "iuf":
        raise FileError(Path(path), f"holds {points.dtype} of the shape {points.shape}, not points (N, 3)")
    return points.astype(float)


def _read(path: str | Path, what: str, suffixes: tuple[str, ...]) -> Numbers:
    """Return the numbers of a file whose name has one of these suffixes."""
    file = Path(path)
    suffix = file.suffix.lower()
    if suffix not in suffixes:
        raise FileError(file, f"is not a {what}: {unknown_suffix(file, suffixes)}")
    refuse_unreadable(file, FileError, largest=LARGEST_FILE)
    try:
        if suffix == ".npy":
            return np.asarray(np.load(file, allow_pickle=False))
        if suffix == ".ply":
            return positions(read_elements(file.read_bytes()).get("vertex", {}))
        if suffix == ".png":
            from PIL import Image as PngImage

            with PngImage.open(file) as image:
                if image.mode not in ("I;16", "I;16B", "I", "F"):
                    raise ValueError(f"it has the mode {image.mode}; depth images have one channel of 16 bits")
                return np.asarray(image)
        library = optional_module({".exr": "OpenEXR", ".pcd": "pypcd4"}[suffix], f"a {suffix} file", "sensor")
        if suffix == ".exr":  # the channel Z, as renderers name depth, or the only channel
            channels = library.File(str(file), separate_channels=True).channels()
            names = [name for name in channels if name.rpartition(".")[2] == "Z"] or list(channels)
            if len(names) != 1:
                raise ValueError(f"it has the channels {', '.join(channels)}; needed is one channel, or one named Z")
            return np.asarray(channels[names[0]].pixels)
        cloud = library.PointCloud.from_path(file)
        points = np.asarray(cloud.numpy(("x", "y", "z")))
        if len(points) != cloud.metadata.points:
            raise ValueError(f"it holds {len(points)} points, but its header states {cloud.metadata.points}")
        return points
    # Pillow raises SyntaxError, OpenEXR RuntimeError, and readers of clouds others for damaged files.
    except (OSError, ValueError, SyntaxError, RuntimeError, KeyError, IndexError, TypeError) as error:
        if isinstance(error, InputError):
            raise
        raise FileError(file, f"cannot be read as a {what}: {str(error).splitlines()[0]}") from error


DEPTH_UNCERTAINTY = 0.005
"""Default largest error (m) of a measured depth: about that of common depth cameras at a distance of 1 m."""

PIXEL_MARGIN = 1
"""Default number of pixels around the image of a cell that must be farther too: an edge of a body may lie between the
centres of two pixels, and then only one of them measures the body."""

LEAST_DEPTH = 0.01
"""Metres. A median depth below this is too near for any depth camera: the image is in other units."""

LARGEST_WHOLE = 10.0
"""Metres. An image of integers whose median exceeds this is in millimetres."""

SATURATED = 2**16 - 1
"""The largest number of 16 bits, which marks pixels without a measurement."""

SAMPLES = 10_000
"""Number of pixels by which the unit of an image is checked."""

OFF_CENTER = 0.2
"""Share of the image by which the principal point of a camera may be off the center of its image; the principal point
for an image of half the size is off by 0.25."""


@named_arguments
@st.struct("intrinsics")
class Intrinsics:
    """A pinhole camera without distortion; the center of the first pixel is (0, 0).

    A point (x, y, z) of its frame is at the pixel (fx x / z + cx, fy y / z + cy).
    """

    fx: float = st.key("focal length along the rows", "pixels", above=0)
    fy: float = st.key("focal length along the columns", "pixels", above=0)
    cx: float = st.key("column of the principal point", "pixels")
    cy: float = st.key("row of the principal point", "pixels")
    width: int = st.key("columns of the image", "pixels", minimum=1)
    height: int = st.key("rows of the image", "pixels", minimum=1)

    def __post_init__(self) -> None:
        for name, size in (("cx", self.width), ("cy", self.height)):
            if not abs(getattr(self, name) - (size - 1) / 2) <= OFF_CENTER * size:
                raise InputError(
                    f"Intrinsics.{name} = {getattr(self, name):g} is far off the center of an image of {self.width} x "
                    f"{self.height} pixels; the intrinsics are those of another size of image"
                )

    @classmethod
    def from_matrix(cls, K: npt.ArrayLike, width: int, height: int) -> Intrinsics:
        """Return the camera of a matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]].

        Raises
        ------
        InputError
            If the matrix has another form, or is for another size of image.
        """
        k = finite("intrinsics", K, (3, 3))
        if np.any(k[[0, 1, 2, 2], [1, 0, 0, 1]]) or k[2, 2] != 1.0:
            raise InputError(f"intrinsics = {k.tolist()}; they must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
        return cls(float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2]), width, height)

    def scaled(self, factor: float) -> Intrinsics:
        """Return the camera of the same view in an image whose sides are ``factor`` times as long."""
        require_positive("factor", factor)
        cx, cy = ((c + 0.5) * factor - 0.5 for c in (self.cx, self.cy))
        size = (round(self.width * factor), round(self.height * factor))
        return Intrinsics(self.fx * factor, self.fy * factor, cx, cy, *size)


class DepthPiece(NamedTuple):
    """A convex piece of a body: its shape in the compiled core, and the pose of the root in its frame (4, 4)."""

    shape: Shape
    shape_from_root: Array


class RemovedBody(NamedTuple):
    """A body that was removed from a view."""

    name: str
    pieces: tuple[DepthPiece, ...]


@st.described(eq=False)
class DepthView:
    """A checked depth image with its camera; :meth:`read` makes one."""

    depth: Array = st.key("(height, width) measured depth (m) along the optical axis; 0 without a measurement")
    nearest: Array = st.key(
        "(height, width) every surface in a pixel is here or farther; 0 where nothing is known", "m"
    )
    farthest: Array = st.key("(height, width) a surface was measured here or nearer; 0 where none was measured", "m")
    uncertainty: Array = st.key("(height, width) or one number: the largest error (m) of a depth")
    intrinsics: Intrinsics = st.key("the camera")
    root_from_camera: SE3 = st.key("its pose")
    removed: tuple[RemovedBody, ...] = st.key(
        "the bodies that :func:`pinproof.collision.remove_body` removed", default=()
    )
    record: tuple[str, ...] = st.key("what was done, in sentences", default=())
    beside: Array = st.key(
        "(K, 3) measured points outside the image, in the frame of the grid; only of point clouds",
        "m",
        default_factory=lambda: np.zeros((0, 3)),
    )

    @classmethod
    def read(
        cls,
        image: npt.ArrayLike | str | Path,
        intrinsics: Intrinsics | npt.ArrayLike,
        camera_pose: SE3 | npt.ArrayLike,
        *,
        depth_scale: float | None = None,
        depth_uncertainty: float | npt.ArrayLike = DEPTH_UNCERTAINTY,
    ) -> DepthView:
        """Check and convert an image; arguments and errors are those of :meth:`pinproof.OccupancyGrid.from_depth`."""
        pose = rigid("camera_pose", camera_pose)
        # The numbers (height, width) of an array or a file; masked pixels have no measurement.
        what = f"the depth image {image}" if isinstance(image, (str, Path)) else "the depth image"
        stated = read_image(image) if isinstance(image, (str, Path)) else image
        stated = stated.filled(0) if isinstance(stated, np.ma.MaskedArray) else stated
        try:
            raw = np.asarray(stated)
        except ValueError as wrong:
            raise InputError(f"{what} is not an array: {wrong}") from wrong
        raw = raw[:, :, 0] if raw.ndim == 3 and raw.shape[2] == 1 else raw
        if raw.ndim != 2 or raw.size == 0 or raw.dtype.kind not in "iuf":
            raise InputError(
                f"{what} must be numbers of the shape (height, width); it is {raw.dtype} of the shape {raw.shape}"
            )
        height, width = raw.shape
        camera = intrinsics if isinstance(intrinsics, Intrinsics) else Intrinsics.from_matrix(intrinsics, width, height)
        if (camera.width, camera.height) != (width, height):
            raise InputError(
                f"the image has {width} x {height} pixels, the intrinsics are for {camera.width} x {camera.height}; "
                "Intrinsics.scaled() converts them if the whole view was scaled"
            )
        # Depths in metres, and how far off each may be.
        depth = _metres(raw, depth_scale)
        try:
            error = np.array(depth_uncertainty, dtype=float)
        except (TypeError, ValueError) as wrong:
            raise InputError(f"depth_uncertainty is not a number or an array of numbers: {wrong}") from wrong
        if error.shape not in ((), raw.shape) or not (error >= 0).all():
            raise InputError(
                f"depth_uncertainty must be 0 or more, one number or one for each pixel {raw.shape}; its shape is "
                f"{error.shape}"
            )
        measured = depth > 0
        nearest = np.where(measured, np.maximum(depth - error, 0.0), 0.0)
        return cls(depth, nearest, np.where(measured, depth + error, 0.0), error, camera, pose)

    @classmethod
    def from_points(
        cls,
        points: npt.ArrayLike | str | Path,
        intrinsics: Intrinsics,
        camera_pose: SE3 | npt.ArrayLike,
        *,
        cloud_pose: SE3 | npt.ArrayLike | None = None,
        depth_uncertainty: float = DEPTH_UNCERTAINTY,
    ) -> DepthView:
        """Return the view of a point cloud, of which each pixel shows the nearest point.

        Arguments and errors are those of :meth:`pinproof.OccupancyGrid.from_points`.
        """
        if not isinstance(intrinsics, Intrinsics):
            raise InputError(f"intrinsics must be Intrinsics, not {type(intrinsics).__name__}: a cloud has no size")
        require_positive("depth_uncertainty", depth_uncertainty, zero=True)
        root_from_camera = rigid("camera_pose", camera_pose)
        # The finite points (N, 3) of an array or a file, and a sentence on their number.
        what = f"the point cloud {points}" if isinstance(points, (str, Path)) else "the point cloud"
        stated = point_array(what, read_points(points) if isinstance(points, (str, Path)) else points)
        if isinstance(points, np.ma.MaskedArray):
            stated[np.ma.getmaskarray(points)] = np.nan  # masked points are no measurements
        if not stated.size:
            raise InputError(f"{what} is empty")
        cloud = stated[np.isfinite(stated).all(axis=1)]
        if not len(cloud):
            raise InputError(f"none of the points of {what} is finite")
        median = float(np.median(np.linalg.norm(cloud, axis=1)))
        if median > MOST_REACH:
            raise InputError(f"the points of {what} are {median:g} m away (median), which looks like millimetres")
        dropped = f"; {len(stated) - len(cloud)} others are not finite" if len(stated) > len(cloud) else ""
        record = f"its pixels show the nearest points of a cloud of {len(cloud)}{dropped}"
        # Each pixel shows the nearest of its points, and the farthest bounds what was measured in it.
        if cloud_pose is not None:
            cloud = _moved(rigid("cloud_pose", cloud_pose), cloud)
        seen = _moved(root_from_camera.inverse(), cloud)
        front = np.maximum(seen[:, 2], LEAST_DEPTH)
        with np.errstate(over="ignore"):  # beyond all doubles is beyond the picture
            column = np.rint(intrinsics.fx * seen[:, 0] / front + intrinsics.cx)
            row = np.rint(intrinsics.fy * seen[:, 1] / front + intrinsics.cy)
        shown = (seen[:, 2] >= LEAST_DEPTH) & (column >= 0) & (column < intrinsics.width)
        shown &= (row >= 0) & (row < intrinsics.height)
        if not shown.any():
            raise InputError(f"none of the {len(cloud)} points is in the view of the camera; check camera_pose")
        pixels = (row[shown] * intrinsics.width + column[shown]).astype(np.int64)
        nearest = np.full(intrinsics.height * intrinsics.width, np.inf)
        farthest = np.zeros_like(nearest)
        np.minimum.at(nearest, pixels, seen[shown, 2])
        np.maximum.at(farthest, pixels, seen[shown, 2])
        shape, error = (intrinsics.height, intrinsics.width), float(depth_uncertainty)
        depth = np.where(np.isfinite(nearest), nearest, 0.0).reshape(shape)
        farthest = np.where(farthest > 0, farthest + error, 0.0).reshape(shape)
        bound = np.maximum(depth - error, 0.0)
        return cls(depth, bound, farthest, np.array(error), intrinsics, root_from_camera, (), (record,), cloud[~shown])


def _view(
    intrinsics: Intrinsics,
    camera: SE3,
    image: Path | None = None,
    points: Path | None = None,
    pixel_margin: int | None = None,
    **settings: float,
) -> tuple[DepthView, dict[str, int]]:
    """The view that a file states, and the ``pixel_margin`` if it is stated."""
    if (image is None) is (points is None) or (points is not None and "depth_scale" in settings):
        raise InputError("a view needs one of image and points; points have no depth_scale")
    margin = {} if pixel_margin is None else {"pixel_margin": pixel_margin}
    if image is not None:
        return DepthView.read(image, intrinsics, camera, **settings), margin
    return DepthView.from_points(str(points), intrinsics, camera, **settings), margin


VIEW = st.Table(
    "view",
    "A depth image and its camera.",
    st.Key("image", st.file_of(), "the image (NPY, PNG or EXR), relative to the folder of this file"),
    st.Key("points", st.file_of(), "instead of `image`: a point cloud (NPY, PLY or PCD) in the frame of the obstacle"),
    st.required("intrinsics", st.table_of(Intrinsics), "the camera"),
    st.required("camera", st.POSE, "root_from_camera: x to the right, y downwards, z forward"),
    st.Key("depth_scale", st.number(above=0), "metres per unit of the image, which images of integers need", "m"),
    st.Key("depth_uncertainty", st.number(minimum=0), "largest error of a measured depth", "m", DEPTH_UNCERTAINTY),
    st.Key(
        "pixel_margin",
        st.COUNT,
        "pixels around the image of a cell that must be farther than the cell too",
        "",
        PIXEL_MARGIN,
    ),
    rules={
        "oneOf": [
            {"required": ["image"], **st.without("points")},
            {"required": ["points"], **st.without("image", "depth_scale")},
        ]
    },
    make=_view,
)


def _moved(to_from: SE3, points: Array) -> Array:
    """Return points (N, 3) in another frame."""
    transform = matrix(to_from)
    return np.asarray(points @ transform[:3, :3].T + transform[:3, 3])


def _metres(raw: npt.NDArray[Any], depth_scale: float | None) -> Array:
    """Return the depths in metres, 0 where there is no measurement; refuse another unit."""
    whole = raw.dtype.kind in "iu"
    # Cameras of 16 bits mark pixels without a measurement, or beyond their range, by the largest number.
    largest = np.iinfo(raw.dtype).max if whole else SATURATED
    raw = raw.astype(float)  # products of half floats would be rounded by millimetres
    measured = np.isfinite(raw) & (raw != 0) & (raw != SATURATED) & (raw != largest)
    values = raw[measured]
    if len(values) and values.min() < 0:
        raise InputError(f"the depth image holds {int((values < 0).sum())} negative depths")
    if not len(values):
        raise InputError(
            f"the depth image holds no measurement: all of its {raw.size} pixels are 0, not finite or saturated"
        )
    values = values[:: max(1, len(values) // SAMPLES)]
    median = float(np.median(values))
    if depth_scale is None:
        if whole:
            raise InputError(
                f"the depth image holds integers ({raw.dtype}, median {median:g}), whose unit must be stated: "
                "depth_scale=0.001 for millimetres"
            )
        depth_scale = 1.0
    require_positive("depth_scale", depth_scale)
    median *= depth_scale
    whole = whole or bool((values == np.floor(values)).all())
    if median > (LARGEST_WHOLE if whole else MOST_REACH):
        raise InputError(
            f"the depth image has a median depth of {median:g} m, which looks like millimetres: use "
            f"depth_scale={depth_scale * 1e-3:g}"
        )
    if median < LEAST_DEPTH:
        raise InputError(
            f"the depth image has a median depth of {median:g} m, which is too near for a depth camera: use "
            f"depth_scale={depth_scale * 1e3:g} if it is in metres already"
        )
    depth = np.where(measured, raw, 0) * float(depth_scale)
    return np.where(depth <= MOST_REACH, depth, 0.0)
