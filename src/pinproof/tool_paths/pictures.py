"""What pages show of tool paths: the path in colours, and the strip of allowed tool rotations over it.

The strip states which rotations of the tool about its axis have a free configuration, and where on the path.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker
from pinproof.common import theme
from pinproof.common.results import Html, Rows, Shown, View
from pinproof.common.structs import described, key
from pinproof.common.validation import require_integer
from pinproof.errors import InputError, NoClosedForm
from pinproof.ik import IkTask
from pinproof.spatial import Array
from pinproof.tool_paths.path import ToolPath
from pinproof.tool_paths.rungs import FollowCosts, Grid, PathArm, Rung, fill, redundant_axes

if TYPE_CHECKING:
    from pinproof.viewer import ColouredPoints

# What a cell of the strip states, by its code, with its colour in pages.
CELLS: tuple[tuple[str, str], ...] = (
    ("free", theme.CELLS["free"]),
    ("every configuration is in contact", theme.CELLS["contact"]),
    ("only outside the joint limits", theme.CELLS["limit"]),
    ("out of reach", theme.CELLS["unreachable"]),
)
# Size of the picture in SVG units.
WIDTH, HEIGHT = 720.0, 150.0
# Number of points of a path in colours, and their diameter (m) and the clearance (mm) at the end of the scale.
POINTS, SIZE, WIDE = 240, 0.012, 50.0
# Largest number of strips on a page.
STRIPS = 12
# Values of the redundant joint of an arm of seven joints at which a cell is checked.
REDUNDANT = 12


@described(eq=False)
class RotationStrip(Shown):
    """For each pose of a path and each rotation of the tool about its axis, whether the arm has a free configuration.

    A cell that is not free is proven for arms with a closed form of up to six joints. A row of free cells is no proof
    of a motion.
    """

    places: Array = key("(k,) indices of poses of the path; a fraction between two poses", hidden=True)
    rotations: Array = key("(m,) rotations (rad) away from the poses of the path, in [-pi, pi)", hidden=True)
    cells: npt.NDArray[np.int64] = key(
        "(k, m) 0 for a free configuration, 1 if all are in contact, 2 if all leave the limits, 3 if out of reach",
        hidden=True,
    )
    chosen: tuple[Array, ...] = key(
        "(p, 2) place and rotation of the motion, for each piece of it", default=(), hidden=True
    )

    @property
    def free(self) -> Array:
        """(k,) the share of the rotations that are free at each place."""
        return np.asarray((self.cells == 0).mean(axis=1))

    def svg(self) -> Html:
        """The strip as a picture: the path from left to right, the rotation upwards, and the line of the motion."""
        across = WIDTH / len(self.places)
        up = HEIGHT / len(self.rotations)
        drawn = []
        for k, column in enumerate(self.cells.tolist()):
            ends = [0, *(j for j in range(1, len(column)) if column[j] != column[j - 1]), len(column)]
            for first, last in itertools.pairwise(ends):
                drawn.append(
                    f'<rect x="{k * across:.1f}" y="{HEIGHT - last * up:.1f}" width="{across + 0.3:.1f}" '
                    f'height="{(last - first) * up:.1f}" fill="{CELLS[column[first]][1]}"/>'
                )
        # The line of the motion, cut where it leaves the picture at one side and enters it at the other
        for line in self.chosen:
            x = np.interp(line[:, 0], self.places, (np.arange(len(self.places)) + 0.5) * across)
            y = HEIGHT * (0.5 - (np.remainder(line[:, 1] + np.pi, 2.0 * np.pi) - np.pi) / (2.0 * np.pi))
            for part in np.split(np.arange(len(x)), 1 + np.flatnonzero(np.abs(np.diff(y)) > 0.5 * HEIGHT)):
                points = " ".join(f"{x[i]:.1f},{y[i]:.1f}" for i in part.tolist())
                drawn.append(
                    f'<polyline points="{points}" fill="none" stroke="{theme.COLOURS["ink"]}" stroke-width="2"/>'
                )
        label = f"rotation of the tool over the path, {100.0 * self.free.min():.0f} % free at the least"
        return Html(
            f'<svg role="img" aria-label="{escape(label)}" viewBox="0 0 {WIDTH:.0f} {HEIGHT:.0f}" '
            f'preserveAspectRatio="none">{"".join(drawn)}</svg>'
        )

    def _view(self) -> View:
        free = self.free
        worst = int(free.argmin())
        head = (
            f"{len(self.places)} places of the path, {len(self.rotations)} rotations; {100.0 * free[worst]:.0f} % free "
            f"at place {self.places[worst]:g}, the least"
        )
        counts = [(name, int((self.cells == code).sum())) for code, (name, _) in enumerate(CELLS)]
        return View(head, [self.svg(), Rows(("cell", "number"), counts)], (f"{name}: {n}" for name, n in counts if n))


def rotation_strip(
    checker: CollisionChecker,
    path: ToolPath,
    plan: Any | None = None,
    *,
    rotations: int = 72,
    places: int = 120,
) -> RotationStrip:
    """Which rotations of the tool about its axis are free over a path, with the one that a plan has chosen.

    Parameters
    ----------
    checker
        The arm in its scene.
    path
        The path.
    plan
        The :class:`FollowPlan` whose rotation is drawn.
    rotations
        Number of rotations over a full revolution.
    places
        Largest number of places of the path, which are evenly spaced over its length.

    Raises
    ------
    NoClosedForm
        If the arm has no closed form.
    """
    require_integer("rotations", rotations, 2)
    require_integer("places", places, 2)
    # The places: all poses if there are few, otherwise evenly over the length
    count = len(path)
    at = np.arange(count, dtype=float)
    if count > places or count < 30:
        along = np.concatenate([[0.0], np.cumsum(np.maximum(path.lengths, 1e-6))])
        at = np.interp(np.linspace(0.0, along[-1], 1 if count == 1 else places), along, at)
    poses, angles = path.at(at), 2.0 * np.pi * (np.arange(rotations) + 0.5) / rotations - np.pi
    # A rung for each cell, with the pose of the tool rotated
    turns = Grid(angles, np.eye(3)[None]).turns
    rungs = [Rung(0, 0.0, pose @ turn, where) for where, pose in zip(at.tolist(), poses, strict=True) for turn in turns]
    path_arm = PathArm.of(checker.group) if plan is None else plan.path_arm
    alone = Grid(np.zeros(1), np.eye(3)[None], *redundant_axes(path_arm, REDUNDANT)[1:])
    fill(rungs, checker, path_arm, alone, IkTask(), FollowCosts(), 0)
    codes = [0 if len(rung.rates) else 1 if len(rung.q) else 2 if rung.outside else 3 for rung in rungs]
    # The rotation of the motion
    chosen = []
    for piece in () if plan is None else plan.pieces:
        on = (piece.poses >= 0.0) & (piece.poses <= count - 1.0)
        frames = path_arm.arm.forward_kinematics_batch(piece.q[on])[:, :3, :3]
        turned = np.swapaxes(path.at(piece.poses[on])[:, :3, :3], 1, 2) @ frames
        chosen.append(np.column_stack([piece.poses[on], np.arctan2(turned[:, 1, 0], turned[:, 0, 0])]))
    return RotationStrip(at, angles, np.array(codes, dtype=np.int64).reshape(len(at), -1), tuple(chosen))


def pictured(plans: Mapping[str, Any], by: Literal["clearance", "speed"] = "clearance") -> dict[str, Any]:
    """The content of a page with plans by the names of their paths: coloured points, strips, and a reason if one fails.

    The arguments are those of :func:`pinproof.write_html`.
    """
    first = next(iter(plans.values()))
    shown: dict[str, Any] = {"attached": first.checker.attached, "points": coloured_path([*plans.values()], by)}
    with contextlib.suppress(NoClosedForm, InputError):  # or too many external joints
        strips = {name: rotation_strip(own.checker, own.path, own) for name, own in [*plans.items()][:STRIPS]}
        shown |= {"panel": _strip_panel(strips, {name: plans[name].path.names for name in strips})}
    q = next((each.q for own in plans.values() for each in own.blocked if each.q is not None), None)
    return shown if q is None else {**shown, "q": q, "check": first.checker.check(q)}


def _strip_panel(strips: Mapping[str, RotationStrip], names: Mapping[str, tuple[str, ...]]) -> str:
    """The panel of a page with strips by the names of their paths; ``names`` are those of the poses of each path."""
    from pinproof.viewer import legend

    half = "".join(
        f'<span class="tick" style="top:{top}%">{degrees}&deg;</span>'
        for top, degrees in ((6, "180"), (50, "0"), (94, "&minus;180"))
    )
    figures = "".join(
        f'<figure><figcaption>{escape(name)}: rotation of the tool about its axis over the path</figcaption>'
        f'<div class="strip">{strip.svg()}{half}</div><div class="ends"><span>{escape(names[name][0])}</span>'
        f"<span>{escape(names[name][-1])}</span></div></figure>"
        for name, strip in strips.items()
    )  # fmt: skip
    meaning = [*CELLS, ("rotation of the motion", theme.COLOURS["ink"])]
    used = {code for strip in strips.values() for code in np.unique(strip.cells).tolist()}
    shown = [each for code, each in enumerate(meaning) if code in used or code == len(CELLS)]
    return (
        f'<section id="strips" class="below" aria-label="Allowed rotations of the tool">'
        f'{legend(shown, "Meaning of the cells")}<div class="panels">{figures}</div></section>'
    )


def coloured_path(plans: Sequence[Any], by: Literal["clearance", "speed"] = "clearance") -> ColouredPoints:
    """The points of paths, coloured by the clearance of the arm or the speed of the tool on them.

    Paths without a motion are green where they can be followed, and red where they cannot be passed.
    """
    from pinproof.viewer import ColouredPoints

    checker = plans[0].checker
    root, arm = plans[0].root_from_path, plans[0].path_arm.arm
    found = [motion for plan in plans if plan.ok for name, motion in plan.motions if name == "path"]
    if found and all(plan.ok for plan in plans):
        count = max(POINTS // len(found), 40)
        parts = [(motion, np.linspace(0.0, motion.duration, count)) for motion in found]
        q = np.concatenate([motion(times) for motion, times in parts])
        if by == "speed":
            rates = np.concatenate([motion.velocity(times) for motion, times in parts])
            values = np.linalg.norm((arm.jacobian_batch(q)[:, :3] @ rates[:, :, None])[:, :, 0], axis=1) * 1e3
            label, high = "tool [mm/s]", float(values.max())
        else:
            values = checker.clearance_batch(q) * 1e3
            label, high = "clearance [mm]", float(np.clip(values.max(), 1.0, WIDE))
        points = (root @ arm.forward_kinematics_batch(q))[:, :3, 3]
        return ColouredPoints.of_values(points, values, label=label, high=high, size=SIZE)
    places, colours = list[Array](), list[Array]()
    good, bad = (np.array(theme.rgb(theme.COLOURS[name])) for name in ("good", "bad"))
    for plan in plans:
        at = np.linspace(0.0, len(plan.path) - 1.0, POINTS)
        blocked = np.zeros(len(at), dtype=bool)
        for each in plan.blocked:
            blocked |= (at >= each.pose - 0.01) & (at <= each.last + 0.01)
        places.append((root @ plan.path.at(at))[:, :3, 3])
        colours.append(np.where(blocked[:, None], bad, good))
    legend = (("can be passed", tuple(good)), ("cannot be passed", tuple(bad)))
    return ColouredPoints(np.concatenate(places), np.concatenate(colours), SIZE, legend)
