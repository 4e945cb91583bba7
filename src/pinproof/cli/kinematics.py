"""``pinproof fk`` and ``pinproof ik``: where the tcp is, and how it gets somewhere."""

from __future__ import annotations

from enum import Enum
from typing import Annotated

import typer

import pinproof as pp
from pinproof.cli.complete import link_names
from pinproof.cli.console import print_json, say
from pinproof.cli.options import (
    Carried,
    Chain,
    Configuration,
    Json,
    Robot,
    Seed,
    Surroundings,
    numbers,
    parse_configuration,
)
from pinproof.errors import InputError

__all__ = ["fk", "ik"]


class TaskOption(str, Enum):
    """What of the target is to be met."""

    POSE = "pose"
    POSITION = "position"
    ORIENTATION = "orientation"
    SPIN_X = "spin_x"
    SPIN_Y = "spin_y"
    SPIN_Z = "spin_z"


class MethodOption(str, Enum):
    """How it is solved."""

    CLIK = "clik"
    ANALYTIC = "analytic"
    DAMPED_LEAST_SQUARES = "damped-least-squares"
    PSEUDO_INVERSE = "pseudo-inverse"
    FABRIK = "fabrik"


SOLVERS = {
    MethodOption.CLIK: "Clik",
    MethodOption.ANALYTIC: "AnalyticIk",
    MethodOption.DAMPED_LEAST_SQUARES: "DampedLeastSquares",
    MethodOption.PSEUDO_INVERSE: "PseudoInverse",
    MethodOption.FABRIK: "Fabrik",
}


def fk(
    robot: Robot,
    q: Configuration = None,
    frame: Annotated[
        str | None, typer.Option(help="A link to locate instead of the tcp.", autocompletion=link_names)
    ] = None,
    *,
    chain: Chain,
    as_json: Json = False,
) -> None:
    """Print where the tcp (or another frame) is at a configuration.

    Example: pinproof fk ur5 --q "0 -pi/2 pi/2 -pi/2 -pi/2 0"
    """
    arm = chain.arm(robot)
    configuration = parse_configuration(q, arm, "--q")
    placement = arm.frame_placement(configuration, frame or arm.tcp)
    vector = pp.xyz_rpy(placement)
    if as_json:
        named = dict(zip(arm.joint_names, configuration.tolist(), strict=True))
        place = {"xyz": vector[:3].tolist(), "rpy": vector[3:].tolist(), "matrix": placement.homogeneous.tolist()}
        print_json({"base": arm.base, "frame": frame or arm.tcp, "q": named, **place})
        return
    say(f"{arm.base} -> {frame or arm.tcp}")
    say("xyz [m]   " + " ".join(_decimals(value) for value in vector[:3]))
    say("rpy [rad] " + " ".join(_decimals(value) for value in vector[3:]))


def ik(
    robot: Robot,
    xyz: Annotated[
        str, typer.Option(help='Where the tcp, or the tip of the tool, shall be, in metres: "0.4 0.1 0.3".')
    ] = "",
    rpy: Annotated[str, typer.Option(help='How it shall be turned, in radians: "pi 0 0".')] = "0 0 0",
    task: Annotated[TaskOption, typer.Option(help="What of the target is to be met.")] = TaskOption.POSE,
    method: Annotated[MethodOption, typer.Option(help="How it is solved.")] = MethodOption.CLIK,
    every: Annotated[bool, typer.Option("--all", help="Every configuration, in closed form.")] = False,
    q0: Annotated[str | None, typer.Option(help="Where to start; by default home.")] = None,
    seed: Seed = 0,
    *,
    around: Surroundings,
    chain: Chain,
    carried: Carried,
    as_json: Json = False,
) -> None:
    """Find joint values for a pose of the tcp, or of the tip of a tool. Exit code 1 if none is found.

    With --scene, --margin, --tool-of or --attached the configuration is also free of contact.

    Example: pinproof ik ur5 --xyz "0.4 0.1 0.3" --rpy "pi 0 0"
    """
    if not xyz and task is not TaskOption.ORIENTATION:
        raise InputError('--xyz is missing: say where the tcp shall be, such as --xyz "0.4 0.1 0.3"')
    if every and (method not in (MethodOption.CLIK, MethodOption.ANALYTIC) or task is not TaskOption.POSE):
        raise InputError("--all enumerates whole poses in closed form; leave --method and --task out")
    arm, tip = chain.arm(robot, carried=carried), carried.attachments.tip
    target = pp.pose(numbers(xyz, "--xyz") if xyz else (0.0, 0.0, 0.0), numbers(rpy, "--rpy"))
    if not tip.isIdentity():
        if task is not TaskOption.POSE:
            raise InputError("a tool with a tip is brought to whole poses; leave --task out, or remove the tip")
        target = target * tip.inverse()
    # a margin alone is kept between the bodies of the robot
    judged = around.scene is not None or around.margin > 0.0 or any(carried.files)
    accept = None if not judged else around.checker(arm, carried=carried).is_free
    start = parse_configuration(q0, arm, "--q0")
    if every:
        branches = pp.AnalyticIk().solve_all(arm, target, start)
        _print_all(branches if accept is None else branches.free(accept), as_json)
        return
    found = getattr(pp, SOLVERS[method])().solve(arm, target, start, rng=seed, task=task.value, accept=accept)
    if as_json:
        print_json(
            {
                "ok": found.ok,
                "status": found.status.name,
                "q": dict(zip(arm.joint_names, found.q.tolist(), strict=True)),
                "position_error": found.position_error,
                "orientation_error": found.orientation_error,
                "message": found.message,
            }
        )
    else:
        for name, value in zip(arm.joint_names, found.q, strict=True):
            say(f"{name:30s} {_decimals(value)}")
        say(found.message)
    if not found.ok:
        raise typer.Exit(1)


def _print_all(found: pp.IkBranches, as_json: bool) -> None:
    """Distinct configurations, the nearest to where the search started first; whole turns are only counted."""
    names = found.arm.joint_names
    if as_json:
        rows = [dict(zip(names, q.tolist(), strict=True)) for q in found.branches]
        print_json({"ok": found.ok, "branches": rows, "with_whole_turns": len(found), "message": found.message})
    else:
        say("  ".join(f"{name[-14:]:>14s}" for name in names))
        for q in found.branches:
            say("  ".join(f"{_decimals(value):>14s}" for value in q))
        turns = f" ({len(found)} with whole turns)" if len(found) > len(found.branches) else ""
        say(f"{found.message}{turns}")
    if not found.ok:
        raise typer.Exit(1)


def _decimals(value: float) -> str:
    """Six of them; what rounds to zero has no sign."""
    return f"{round(float(value), 6) + 0.0: .6f}"
