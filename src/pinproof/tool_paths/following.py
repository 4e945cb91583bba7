"""The best joint motion along a whole tool path, timed and certified, or why no motion exists."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, certify
from pinproof.common.validation import require_integer, require_number, require_positive, require_type
from pinproof.errors import InputError, NoClosedForm, TimingError
from pinproof.motion import Trajectory, time_parametrise
from pinproof.planning import LinearStatus, MotionPlan, Route, RouteFollower, plan
from pinproof.spatial import SE3, Array, finite, pose, rotation_about
from pinproof.tool_paths.curves import image_deviation
from pinproof.tool_paths.path import LONGEST_LINE, ToolPath
from pinproof.tool_paths.reasons import place_name
from pinproof.tool_paths.result import SHOWN, FollowPlan, FollowStatus, PathPiece
from pinproof.tool_paths.rungs import COSTS, REDUNDANT, FollowCosts, Grid, LadderSettings, PathArm, redundant_axes
from pinproof.tool_paths.search import FollowedPiece, Search
from pinproof.tool_paths.timing import TimedPath, timed_along

# rad and m: largest step of a joint from rung to rung, unless a step of the grid is larger.
JUMP, JUMP_METRES = 0.5, 0.1
# Factor by which joints may move more than the tool rotates, for steps of the grid.
GRID_STEP = 1.2
# The least share of the tool speed to which the tool may slow down from rung to rung, if no tolerance is stated.
SLOWEST = 0.1
# M: a larger allowed deviation is in millimetres.
MOST_DEVIATION = 0.1
# rad or m: largest distance of values between those of the grid from the range of values that are stated for a joint.
BESIDE = 0.2
# Share by which the tool may be slower without a sentence about it, if no tolerance is stated.
TOLERANCE = 0.1
# The names of the parts of a motion.
PARTS, TRANSIT = ("approach", "path", "departure"), "transit"


def follow(
    checker: CollisionChecker,
    path: ToolPath | npt.ArrayLike | Sequence[SE3],
    *,
    frame: str | None = None,
    arm: str | None = None,
    free_rotation: bool | tuple[float, float] = True,
    rotations: int = 24,
    tilts: int = 0,
    redundant: int | Mapping[str, npt.ArrayLike] | None = None,
    deviation: float = 1e-3,
    rotation_deviation: float = math.radians(1.0),
    speed_tolerance: float | None = None,
    approach: float = 0.0,
    departure: float | None = None,
    start: npt.ArrayLike | None = None,
    avoid: npt.ArrayLike | None = None,
    lifts: int = 0,
    cost: FollowCosts | Literal["balanced", "time", "travel", "limits", "singularity", "clearance"] = "balanced",
    step: float = 0.02,
    angle_step: float = 0.2,
    budget: int = 200,
    rng: int = 0,
) -> FollowPlan:
    """Find the best joint motion along a whole tool path, and certify it.

    The motion is optimal over a grid: all branches and windings of the inverse kinematics at every pose, combined with
    the rotations of the tool about its axis, its tilts and the values of a redundant joint. Between the poses, it is a
    smooth curve that is proven to be free of contact, inside the limits and close to the path at every instant.

    Parameters
    ----------
    checker
        The arm in its scene, with its tool.
    path
        The path, or its poses ``base_from_tcp``. The z axis of the tcp is the axis of the tool.
    frame
        The link in whose frame the path is stated, by default the base of the arm. It may move: then the checker is one
        of a :class:`JointGroup` with the joints that move it, such as those of a turntable or of a second arm, and the
        motion is one of all these joints. Deviation and speed of the tool are those relative to the link.
    arm
        The arm of a joint group that holds the tool, by default the first one.
    free_rotation
        Whether the tool may rotate about its axis, or the range (rad) of its rotation away from the pose of the path.
    rotations
        Number of rotations on the grid, evenly over a full revolution or over the range.
    tilts
        Number of directions in which the grid tilts the tool by half of ``rotation_deviation``, in addition to none.
    redundant
        Number of values of the redundant joint of an arm of seven joints, such as a rail, of both of an arm of eight,
        and of each joint that moves ``frame``; by default 24, and 72 for an arm of seven if the rotation is not free.
        Or the values of these joints by name, and 24 of the others; finer values leave their range by at most 0.2.
    deviation, rotation_deviation
        Allowed distance (m) of the tool from the path and angle (rad) from its orientation, at every instant. If the
        rotation is free, the angle is that of the tool axis, and a range of the rotation is kept to the same angle.
        Corners are rounded by less; the tool stops where the path reverses its direction, and at sharp corners if their
        roundings cannot be timed.
    speed_tolerance
        Share by which the tool may be slower than the speed of the path, for example 0.1, except where it starts and
        stops. By default, it may be slower where a joint does not permit the speed, and the result states the speed.
    approach, departure
        Length (m) of straight moves along the tool axis to the first pose and away from the last one; by default, the
        departure is as long as the approach.
    start
        (n,) the configuration from which a straight line leads to the first pose, instead of an approach. Joints that
        are more than 0.2 outside the range that ``redundant`` states would jump.
    avoid
        (k, n) configurations, such as the starts of other motions along the path: the motion does not start within
        1 rad and 0.1 m of one of them in every joint, multiples of a revolution apart.
    lifts
        Largest number of lifts of the tool, with motions planned to where it continues, if the path cannot be followed
        in one piece.
    cost
        The weights of the cost, or their name: ``balanced``, ``time``, ``travel``, ``limits``, ``singularity``,
        ``clearance``.
    step, angle_step
        Largest distance (m) and angle (rad) between poses of the grid; poses are added where the path has larger ones.
    budget
        Largest number of edges at which the grid is refined.
    rng
        Seed of the search for IK solutions of an arm without a closed form, and of motions between pieces.

    Returns
    -------
    FollowPlan
        With ``trajectory`` and ``certificate``; or with the poses that are blocked and the reasons, and with the fewest
        lifts by which the path can be followed in pieces.

    Raises
    ------
    InputError
        If a shape is wrong, a number is not finite, or a setting is out of its range.

    Notes
    -----
    S. Edwards, J. Meyer (2014), "Descartes: a path planning library for semi-constrained trajectories", ROSCon. The
    page "Tool paths" describes the method and its figures.
    """
    require_type("checker", checker, CollisionChecker)
    given = path if isinstance(path, ToolPath) else ToolPath(path)
    path_arm = PathArm.of(checker.group, frame, arm)
    if redundant is None:
        redundant = 72 if free_rotation is False and path_arm.arm.dof == 7 else REDUNDANT
    for name, value, least in (
        ("rotations", rotations, 1), ("tilts", tilts, 0), ("lifts", lifts, 0), ("budget", budget, 0),
        ("redundant", 2 if isinstance(redundant, Mapping) else redundant, 2),
    ):  # fmt: skip
        require_integer(name, value, least)
    for name, length in (("step", step), ("angle_step", angle_step)):
        require_positive(name, length)
    require_number("deviation", deviation, "m", above=0, below=MOST_DEVIATION)
    require_number("rotation_deviation", rotation_deviation, "rad", above=0, below=0.5 * math.pi)
    approach = require_number("approach", approach, "m", minimum=0, maximum=LONGEST_LINE)
    departure = (
        approach if departure is None else require_number("departure", departure, "m", minimum=0, maximum=LONGEST_LINE)
    )
    if speed_tolerance is not None:
        require_number("speed_tolerance", speed_tolerance, minimum=0.01, below=1)
    if isinstance(cost, str):
        if cost not in COSTS:
            raise InputError(f"cost is {cost!r}; it must be FollowCosts, or one of {', '.join(COSTS)}")
        cost = COSTS[cost]
    if start is not None and avoid is not None:
        raise InputError("start and avoid exclude each other; state the configuration, or those that are avoided")
    require_type("cost", cost, FollowCosts)
    own, spin = path_arm.arm, None
    image, image_rotation = image_deviation(own)
    if not deviation > 2.0 * image or not rotation_deviation > 2.0 * image_rotation:
        raise InputError(
            f"deviation = {deviation:g} m and rotation_deviation = {rotation_deviation:g} rad must be above "
            f"{2.0 * image:.2g} m and {2.0 * image_rotation:.2g} rad, twice the accuracy of timed curves of this arm"
        )
    # The grid, and what the tool keeps to
    if isinstance(free_rotation, bool | np.bool_):
        free_rotation = bool(free_rotation)
    elif isinstance(free_rotation, str) or np.shape(free_rotation) != (2,):
        raise InputError(f"free_rotation must be True, False or a range (low, high) in rad, not {free_rotation!r}")
    if free_rotation is True:
        angles = 2.0 * np.pi * np.arange(rotations) / rotations
    elif free_rotation is False:
        angles = np.zeros(1)
    else:
        low, high = (require_number("free_rotation", each, "rad") for each in free_rotation)
        if not low <= high or high - low > 2.0 * np.pi:
            raise InputError(f"free_rotation = ({low:g}, {high:g}) rad must be a range of at most a full revolution")
        spin, angles = (
            (low, high),
            np.linspace(low, high, rotations) if rotations > 1 else np.array([0.5 * (low + high)]),
        )
    path_arm = path_arm if free_rotation is False else path_arm.with_spin(spin)
    angles = angles if path_arm.spun is None else np.zeros(1)
    around = 2.0 * np.pi * np.arange(tilts) / max(tilts, 1)
    leans = [rotation_about(np.array([np.cos(a), np.sin(a), 0.0]), 0.5 * rotation_deviation) for a in around]
    joints, values, others = tuple[int, ...](), tuple[Array, ...](), tuple[Array, ...]()
    with contextlib.suppress(NoClosedForm):
        joints, values, others = redundant_axes(path_arm, redundant)
    grid, axes = Grid(angles, np.array([np.eye(3), *leans]), values, others, path_arm.spun is not None), values + others
    # The least time of a step: the slowest joint makes a step of the grid
    speed = np.where(np.isfinite(own.limits.velocity), own.limits.velocity, 1.0)
    jump = np.where(own.angular, JUMP, JUMP_METRES)
    finest = 0.0 if len(angles) < 2 else GRID_STEP * float(angles[1] - angles[0])
    steps = finest / float(speed[own.angular].min(initial=np.inf))
    for joint, axis in zip(joints, axes, strict=True):
        width = GRID_STEP * float(np.diff(axis).max(initial=0.0))
        steps = max(steps, width / float(speed[joint]))
        jump[joint] = max(jump[joint], width)
        finest = max(finest, width * own.angular[joint])
    jump = np.where(own.angular, np.maximum(jump, finest), jump)
    lower, upper = own.limits.lower.copy(), own.limits.upper.copy()
    stated = redundant if isinstance(redundant, Mapping) else {}
    for joint, axis in zip(joints, axes, strict=True):
        if own.joint_names[joint] in stated:
            lower[joint], upper[joint] = max(lower[joint], axis[0] - BESIDE), min(upper[joint], axis[-1] + BESIDE)
    slowest = SLOWEST if speed_tolerance is None else 1.0 - speed_tolerance
    search = Search(
        checker=checker, path_arm=path_arm, path=given, grid=grid,
        free=free_rotation is not False, whole=free_rotation is True, spin=spin,
        deviation=(deviation, rotation_deviation), image=(image, image_rotation),
        approach=approach, departure=departure, settings=LadderSettings(cost, steps, slowest, jump, finest),
        bounds=(lower, upper), spacing=(step, angle_step), budget=budget, rng=rng,
        avoided=finite("avoid", np.empty((0, own.dof)) if avoid is None else avoid, (None, own.dof)),
        start=None if start is None else own.limits.snap(own.configuration(start, "start")),
    )  # fmt: skip
    found = _result(search, speed_tolerance, lifts)
    # What no value of the grid passes may be possible between them
    if (found.blocked or found.cuts) and (finer := search.finer(found.blocked)) is not None:
        other = _result(finer, speed_tolerance, lifts)
        if other.ok and (not found.ok or len(other.cuts) < len(found.cuts)):
            return other
    return found


def _result(search: Search, speed_tolerance: float | None, lifts: int) -> FollowPlan:
    """The timed pieces, with transits between them, and the certificate of the whole motion."""
    followed, blocked = search.run()
    checker, path, names = search.checker, search.path, search.path.names
    tolerance = TOLERANCE if speed_tolerance is None else speed_tolerance
    pieces: list[PathPiece] = []
    parts: list[list[tuple[str, Trajectory]]] = []
    untimed = ""
    for piece in followed:
        timed: list[TimedPath | None] = [None, None, None]
        for number, group in enumerate(piece.groups):
            try:
                timed[number] = timed_along(search.arm, group, tolerance) if group else None
            except (TimingError, InputError) as error:
                if not search.stops:  # once more, with stops at sharp corners, whose roundings bend too sharply
                    return _result(search.again(stops=True), speed_tolerance, lifts)
                untimed = str(error)
        named = zip(PARTS, timed, strict=True)
        parts.append([(name, part.trajectory) for name, part in named if part is not None])
        pieces.append(_piece(search, piece, timed[1]))
    cuts = tuple(piece.first for piece in pieces[1:])
    figures: dict[str, Any] = {
        "path": path, "path_arm": search.path_arm,
        "pieces": tuple(pieces), "blocked": tuple(blocked), "cuts": cuts, "checker": checker,
        "nodes": sum(len(rung.rates) for rung in search.rungs), "removed": search.removed, "rungs": len(search.rungs),
    }  # fmt: skip
    # Poses that no configuration can pass, more lifts than permitted, or no motion
    if search.exhausted and not blocked:
        message = f"the budget of {search.budget} refinements was used up, the last for: {search.unproven}"
        return FollowPlan(FollowStatus.NOT_PROVEN, message, **figures)
    if blocked:
        more = f"; and {len(blocked) - SHOWN} more" if len(blocked) > SHOWN else ""
        shown = "; ".join(each.message for each in blocked[:SHOWN])
        return FollowPlan(FollowStatus.BLOCKED, f"{shown}{more}", **figures)
    if len(cuts) > lifts:
        places = ", ".join(place_name(search.rungs[piece.first], names) for piece in followed[1:])
        needed = (
            f"{len(cuts)} lift{'s' if len(cuts) > 1 else ''} of the tool needed, at {places}, and {lifts} permitted"
        )
        message = f"{needed}: {search.jump(followed[0]).message}; set lifts={len(cuts)}"
        return FollowPlan(FollowStatus.LIFTS_NEEDED, message, **figures)
    if untimed:
        return FollowPlan(FollowStatus.NOT_PROVEN, f"the motion cannot be timed: {untimed}", **figures)
    # Transits from piece to piece, lifted along the tool axis where that is possible
    motion: list[tuple[str, Trajectory]] = [*parts[0]]
    transits: list[MotionPlan] = []
    for (before, after), rest in zip(pairwise(followed), parts[1:], strict=True):
        leave = _line(search, before.course.q[-1], search.departure, away=True)
        enter = _line(search, after.course.q[0], search.approach, away=False)
        begin = before.course.q[-1] if leave is None else leave.end
        transit = plan(checker, begin, after.course.q[0] if enter is None else enter.start, rng=search.rng)
        transits.append(transit)
        if not transit.ok:
            message = f"no transit from {place_name(search.rungs[before.last], names)}: {transit.message}"
            return FollowPlan(FollowStatus.NO_TRANSIT, message, transits=tuple(transits), **figures)
        between = zip((PARTS[2], TRANSIT, PARTS[0]), (leave, transit.trajectory, enter), strict=True)
        motion += [*((name, part) for name, part in between if part is not None), *rest]
    figures |= {"transits": tuple(transits), "motions": tuple(motion)}
    whole = Trajectory.at_rest(followed[0].course.q[0], search.arm.joint_names)
    if motion:
        whole = Trajectory.join(*(part for _, part in motion))
    certificate = certify(whole, checker)
    if not certificate.free:
        return FollowPlan(FollowStatus.NOT_PROVEN, certificate.message, certificate=certificate, **figures)
    share = min(piece.speed_share for piece in pieces)
    slow = f"the tool slows down to {100.0 * share:.0f} % of the speed of the path" if share < 1.0 - tolerance else ""
    if slow and speed_tolerance is not None:
        return FollowPlan(FollowStatus.TOO_SLOW, slow, **figures)
    lifted = f" with {len(cuts)} lift{'s' if len(cuts) != 1 else ''}" if cuts else ""
    within = f"within {max(piece.deviation for piece in pieces) * 1e3:.3f} mm of the path{'; ' if slow else ''}{slow}"
    message = f"follows {len(path)} poses{lifted} in {whole.duration:.2f} s, {within}; {certificate.message}"
    return FollowPlan(FollowStatus.FOUND, message, trajectory=whole, certificate=certificate, **figures)


def _piece(search: Search, piece: FollowedPiece, timed: TimedPath | None) -> PathPiece:
    """What the result states of a piece."""
    rungs = search.rungs[piece.first : piece.last + 1]
    deviation, rotation_deviation = (
        max((getattr(curve, name) for curve in piece.curves), default=0.0) + rounding + image
        for name, rounding, image in zip(
            ("deviation", "rotation_deviation"), search.rounding, search.image, strict=True
        )
    )
    own: dict[str, Any] = {}
    if timed is not None:
        own = {name: getattr(timed, name) for name in ("speed", "speed_share", "ramps", "slow")}
    return PathPiece(
        first=max(rungs[0].at, 0.0), last=min(rungs[-1].at, len(search.path) - 1.0), q=piece.q,
        rotations=piece.rotations, poses=np.array([rung.at for rung in rungs]), cost=piece.course.cost,
        grid_cost=piece.grid_cost, trajectory=None if timed is None else timed.trajectory, deviation=deviation,
        rotation_deviation=rotation_deviation, **own,
    )  # fmt: skip


def _line(search: Search, q: Array, length: float, *, away: bool) -> Trajectory | None:
    """A straight motion along the tool axis away from q (n,), or towards it; None if no such motion exists."""
    if length <= 0.0:
        return None
    here = search.arm.forward_kinematics(q)
    line = Route.straight(here, here * pose((0.0, 0.0, -length)))
    followed = RouteFollower(arm=search.arm, least=1.0).follow(line, q)
    if followed.status is not LinearStatus.COMPLETE or not certify(followed.path, search.checker).free:
        return None
    return time_parametrise(followed.path if away else followed.path.reversed(), search.arm.limits)
