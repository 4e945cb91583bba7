"""Coordination of several arms: each keeps its own motion, and arms wait so that all of them together are certified.

The arms are coordinated in the order of their priority: the motion of an arm starts as early as the certificate of all
motions so far allows. Delays are searched on a grid, so that the result is not the best one that exists.

Sources: M. Erdmann, T. Lozano-Perez (1987), "On multiple moving objects", Algorithmica 2 (prioritised planning); K.
Kant, S. W. Zucker (1986), "Toward efficient trajectory planning: the path-velocity decomposition", IJRR 5(3).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pinproof.collision import Certificate, CertificateStatus, CollisionChecker, certify
from pinproof.common.display import outline
from pinproof.errors import InputError
from pinproof.motion import Trajectory, synchronise

__all__ = ["CoordinationResult", "coordinate"]

STEP = 0.05
"""Seconds between the delays that are tried: a small part of a usual motion."""


@dataclass(frozen=True, eq=False)
class CoordinationResult:
    """The motion of all arms; result of :func:`coordinate`.

    Parameters
    ----------
    trajectory
        The motion of the joint group; None if no delays were found.
    certificate
        The certificate of it; otherwise that of the last delays that were tried.
    delays
        Seconds by which each arm starts later, by name.
    message
        The result as a sentence.
    """

    trajectory: Trajectory | None
    certificate: Certificate
    delays: dict[str, float]
    message: str

    @property
    def ok(self) -> bool:
        """Whether the motion of all arms together is proven."""
        return self.trajectory is not None

    def __repr__(self) -> str:
        return outline(f"CoordinationResult({self.message})", [])


def coordinate(
    checker: CollisionChecker, trajectories: Mapping[str, Trajectory], *, step: float = STEP
) -> CoordinationResult:
    """Find start times of given motions of several arms such that all of them together are proven collision-free.

    Parameters
    ----------
    checker
        The checker of the joint group.
    trajectories
        For each arm of the group its motion, at rest at both ends. The first has the highest priority and starts at
        once; the others wait. An arm that has not started rests at the start of its motion, and one that has arrived at
        its end.
    step
        Seconds between the delays that are tried.

    Raises
    ------
    UnknownNameError
        If the group has no arm of a name.
    InputError
        If an arm is missing, a motion does not rest at its ends, or ``step`` is not positive.
    """
    if not 0.0 < step < np.inf:
        raise InputError(f"step = {step!r}; it must be above 0 s")
    for name, each in trajectories.items():
        _require_rest(name, each)
    group, delays = checker.group, dict.fromkeys(trajectories, 0.0)
    placed: dict[str, Trajectory] = {}
    whole = certificate = None
    for name, each in trajectories.items():
        waiting = {other: _resting(later) for other, later in trajectories.items() if other not in (*placed, name)}
        busy = max((motion.duration for motion in placed.values()), default=0.0)
        # At a delay of `busy` all arms before it have arrived; a longer one changes nothing.
        tried = [0.0] if not placed else [*np.arange(0.0, busy, step).tolist(), busy]
        for delay in tried:
            motion = _delayed(each, delay)
            whole = synchronise({**placed, name: motion, **waiting}, group, wait=True)
            certificate = certify(whole, checker)
            if certificate.status is CertificateStatus.FREE:
                placed[name], delays[name] = motion, motion.duration - each.duration
                break
        else:
            if certificate is None:
                raise InputError("there is no trajectory")
            message = f"arm {name!r} is not free of collisions at any delay up to {busy:.3g} s: {certificate.message}"
            return CoordinationResult(None, certificate, delays, message)
    if whole is None or certificate is None:
        raise InputError("there is no trajectory")
    waits = ", ".join(f"{name} waits {delay:.3g} s" for name, delay in delays.items() if delay > 0.0)
    message = f"{len(delays)} arms in {whole.duration:.3g} s; {waits or 'none waits'}; {certificate.message}"
    return CoordinationResult(whole, certificate, delays, message)


def _require_rest(name: str, trajectory: Trajectory) -> None:
    ends = [trajectory.velocities[[0, -1]]]
    if trajectory.accelerations is not None:
        ends.append(trajectory.accelerations[[0, -1]])
    if any(values.any() for values in ends):
        raise InputError(f"the motion of arm {name!r} does not rest at its ends, so that the arm cannot wait there")


def _resting(trajectory: Trajectory) -> Trajectory:
    """The arm at rest at the start of its motion."""
    return Trajectory([0.0], trajectory.q[:1], np.zeros_like(trajectory.q[:1]), trajectory.joint_names)


def _delayed(trajectory: Trajectory, delay: float) -> Trajectory:
    """The same motion after a rest of ``delay`` seconds at its start."""
    if delay == 0.0 or len(trajectory.times) == 1:
        return trajectory
    still = np.zeros_like(trajectory.q[:1])
    second = trajectory.accelerations
    return Trajectory(
        np.concatenate([[0.0], trajectory.times + delay]),
        np.concatenate([trajectory.q[:1], trajectory.q]),
        np.concatenate([still, trajectory.velocities]),
        trajectory.joint_names,
        trajectory.limits_note,
        accelerations=None if second is None else np.concatenate([still, second]),
    )
