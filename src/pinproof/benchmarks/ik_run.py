"""A run of the table of inverse kinematics: every method on the same targets, ours and what else is installed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from pinproof.benchmarks.ik_measure import IkRow, measure
from pinproof.benchmarks.ik_methods import RESTARTS, TOLERANCE, IkMethod, Unsuitable, choose
from pinproof.benchmarks.ik_own import OWN
from pinproof.benchmarks.ik_peers import PEERS
from pinproof.benchmarks.ik_problems import PERIOD, Targets, narrowed, random_targets, smooth_targets
from pinproof.benchmarks.ik_table import PARTS, IkTable
from pinproof.benchmarks.provenance import provenance
from pinproof.errors import InputError, PinproofError
from pinproof.model import Arm, load_robot

__all__ = ["ik_benchmark"]

NARROWED = "ranges of more than one turn narrowed to +-pi about their middle"


def ik_benchmark(
    robots: Sequence[str] = ("ur5",),
    *,
    points: int = 10_000,
    methods: Sequence[str] | None = None,
    peers: bool = True,
    limits_pi: bool = True,
    seed: int = 0,
    on_progress: Callable[[str], None] | None = None,
) -> IkTable:
    """Run the table.

    Parameters
    ----------
    robots
        Catalogue names or robot files.
    points
        Targets of each part.
    methods
        The keys of the methods to run, ours and peers; by default all.
    peers
        Whether peers that happen to be installed join; those that cannot are named with the reason.
    limits_pi
        Narrow ranges of more than one turn to the one in their middle (the UR5's to +-pi).
    seed
        Of the targets.
    on_progress
        Called with what is being run.

    Raises
    ------
    InputError
        For fewer than one point, an unknown method or robot.
    """
    if points < 1:
        raise InputError(f"points must be at least 1, not {points}")
    chosen = choose(None if methods is None else tuple(methods), (*OWN, *(PEERS if peers else ())))
    rows: list[IkRow] = []
    left_out: dict[str, dict[str, str]] = {}
    limits: dict[str, Any] = {}
    origin = provenance(seed)
    for name in robots:
        arm = load_robot(name).arm()
        arm = narrowed(arm) if limits_pi else arm
        limits[name] = {
            "tcp": arm.tcp,
            "joints": list(arm.joint_names),
            "lower": _finite(arm.limits.lower),
            "upper": _finite(arm.limits.upper),
        }
        targets = {"random": random_targets(arm, points, seed), "trajectory": smooth_targets(arm, points, seed)}
        left_out[name] = {}
        for method in chosen:
            if on_progress is not None:
                on_progress(f"{name}: {method.label}")
            made, reason = _rows(arm, name, method, targets)
            rows.extend(made)
            if reason:
                left_out[name][method.key] = reason
    settings = {
        "robots": list(robots),
        "points": points,
        "peers": peers,
        "limits": NARROWED if limits_pi else "as declared",
        "chains": limits,
        "restarts": RESTARTS,
        "tolerance": TOLERANCE,
        "trajectory_period_s": PERIOD,
        "peer_versions": {method.key: _version(method) for method in chosen if method.distribution is not None},
    }
    return IkTable(settings, tuple(_with_ratio(row, rows) for row in rows), left_out, origin)


def _rows(arm: Arm, robot: str, method: IkMethod, targets: dict[str, Targets]) -> tuple[list[IkRow], str]:
    """The rows of a method for all parts, and why some or all are missing."""
    made: list[IkRow] = []
    try:
        for asked in PARTS:
            row = measure(arm, robot, method, asked, targets[asked.problem])
            made += [] if row is None else [row]
    except ImportError as error:
        return made, f"not installed ({error})"
    except (Unsuitable, PinproofError) as error:
        return made, str(error)
    except Exception as error:  # whatever somebody else's library raises must not end the run
        if method.rival is None:
            raise
        return made, f"{type(error).__name__}: {error}"
    return made, "" if made else "answers no part of this table"


def _with_ratio(row: IkRow, rows: list[IkRow]) -> IkRow:
    """A peer's row with its mean in units of its rival's, where that was run."""
    for other in rows:
        same = (other.robot, other.problem, other.task) == (row.robot, row.problem, row.task)
        if same and other.method == row.rival and other.restarts == row.restarts:
            return replace(row, ratio=row.mean_ms / other.mean_ms)
    return row


def _version(method: IkMethod) -> str | None:
    try:
        return version(str(method.distribution))
    except PackageNotFoundError:
        return None


def _finite(values: Any) -> list[float | None]:
    """Numbers as JSON knows them: None for a joint without a bound."""
    return [float(value) if np.isfinite(value) else None for value in values]
