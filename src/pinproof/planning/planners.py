"""What a planner is, and how the paths of planners of other packages are proven.

Any object with the method of :class:`Planner` is a planner, wherever one is used: in :func:`pinproof.plan`, in picks
and cells, in libraries of motions, and on the command line, which names it ``module:Class``.
"""

from __future__ import annotations

import inspect
import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, PathConstraint, certify, check_constraints
from pinproof.common.validation import require_type
from pinproof.errors import InputError, UnknownNameError
from pinproof.motion import JointPath, TorqueLimits
from pinproof.planning.plan_results import PlanResult, PlanStatus
from pinproof.planning.problem import no_path, read_ends
from pinproof.planning.rrt_connect import SAME_GOAL, RrtConnect
from pinproof.spatial import Array

DEFAULT_PLANNER = "rrt_connect"


class Planner(Protocol):
    """What every planner provides: the method :meth:`plan`.

    It is called with a start and goals that are valid, and its path is never trusted: it is certified, and its ends are
    compared with the start and the goals. More is used if the planner provides it:

    - ``plan`` accepts the keyword ``constraints``: a tuple of constraints of the tcp that hold on the whole path;
    - ``plan`` accepts the keyword ``torque_limits``: :class:`~pinproof.motion.TorqueLimits` with which the arm can rest
      at each configuration of the path;
    - a method ``limited_to(nodes)`` returns the planner with a budget of work instead of time, so that the verdicts of
      picks do not depend on the clock.

    Tasks with constraints or torque limits are refused if the planner does not accept the keyword.
    """

    def plan(self, checker: CollisionChecker, start: Array, goals: Array, *, rng: int = 0) -> PlanResult:
        """Plan from ``start`` (n,) to any of ``goals`` (g, n) with the seed ``rng``.

        Returns
        -------
        PlanResult
            With a ``path`` and the status FOUND; or another status, and a message that states the reason.
        """
        ...


@dataclass(frozen=True)
class CertifiedPlanner:
    """A planner of another package, whose paths are certified; its calls are those of :class:`~pinproof.RrtConnect`."""

    planner: Planner

    def limited_to(self, nodes: int) -> CertifiedPlanner:
        """Return the planner with a budget of work instead of time, or the same planner if it cannot be limited."""
        limit = getattr(self.planner, "limited_to", None)
        return self if limit is None else CertifiedPlanner(limit(nodes))

    def supports(self, keyword: str) -> bool:
        """Whether the planner accepts ``constraints`` or ``torque_limits``."""
        return not _misfit(self.planner.plan, keyword)

    def plan(
        self,
        checker: CollisionChecker,
        start: npt.ArrayLike,
        goals: npt.ArrayLike,
        *,
        turns: bool = False,
        constraints: Sequence[PathConstraint] = (),
        torque_limits: TorqueLimits | None = None,
        rng: int = 0,
    ) -> PlanResult:
        """Plan as :meth:`RrtConnect.plan` does; the path is certified, and IMPOSSIBLE is stated only if it is proven.

        Raises
        ------
        InputError
            If a shape is wrong, the planner does not support constraints or torque limits, or it does not return a
            :class:`PlanResult` with a :class:`~pinproof.JointPath`.
        """
        # What the task demands beside the ends
        constraints = check_constraints(constraints)
        demands: dict[str, Any] = {"constraints": constraints} if constraints else {}
        demands |= {} if torque_limits is None else {"torque_limits": torque_limits}
        for keyword in demands:
            if not self.supports(keyword):
                raise InputError(
                    f"the planner {self._name} does not support {keyword}: its method plan lacks this keyword; use "
                    f"{DEFAULT_PLANNER} for this task"
                )
        ends = read_ends(checker, start, goals, turns=turns, constraints=constraints, torque_limits=torque_limits)
        if isinstance(ends, PlanResult):
            return ends
        checker, began = ends.checker, time.monotonic()
        answer = self.planner.plan(checker, ends.start.copy(), ends.goals.copy(), rng=rng, **demands)
        seconds = time.monotonic() - began
        if not isinstance(answer, PlanResult):
            raise InputError(f"{self._name}.plan must return a PlanResult, not {type(answer).__name__}")
        require_type(f"the status of the result of {self._name}.plan", answer.status, PlanStatus)

        def result(status: PlanStatus, message: str, **known: Any) -> PlanResult:
            work = {"nodes": answer.nodes, "samples": answer.samples, "gap": answer.gap, "seconds": seconds}
            return PlanResult(status, message=message, checker=checker, **{**work, **known})

        # A failure: only barriers prove that no path exists
        if not answer.ok:
            reason = answer.message or f"no path was found ({answer.status.name})"
            if answer.status is PlanStatus.CANCELLED:
                return result(PlanStatus.CANCELLED, reason)
            if barriers := ends.barriers():
                return result(**no_path(barriers))
            return result(PlanStatus.OUT_OF_BUDGET, reason)
        # A path: from the start to a goal, through the joints of the arm
        if vars(answer)["path"] is None:
            raise InputError(f"{self._name}.plan returned the status FOUND without a path; add path=JointPath(...)")
        require_type(f"the path of {self._name}", answer.path, JointPath)
        names, q = answer.path.joint_names, answer.path.q
        if names != checker.group.joint_names:
            raise InputError(f"the path of {self._name} has the joints {names}, not {checker.group.joint_names}")
        from_goals = np.abs(ends.goals - q[-1]).max(axis=1)
        row = int(from_goals.argmin())
        apart = {"starts": float(np.abs(ends.start - q[0]).max()), "ends": float(from_goals[row])}
        wrong = [f"{verb} {distance:.3g} (rad or m)" for verb, distance in apart.items() if not distance <= SAME_GOAL]
        if wrong:
            message = f"the path of {self._name} {' and '.join(wrong)} from the given configuration"
            return result(PlanStatus.NOT_PROVEN, message)
        # Its ends are those given, exactly, and it is proven
        same = len(q) <= 2 and bool((ends.start == ends.goals[row]).all())
        path = JointPath(np.array([ends.start] if same else [ends.start, *q[1:-1], ends.goals[row]]), names)
        certificate = certify(path, checker, constraints=constraints)
        if not certificate.free:
            contact = certificate.first_contact
            contacts = () if contact is None else checker.check(contact.q).contacts
            message = f"the path of {self._name} fails the proof: {certificate.message}"
            return result(PlanStatus.NOT_PROVEN, message, contacts=contacts)
        message = answer.message or f"{self._name} found a path with {len(path)} waypoints and length {path.length:.3g}"
        known = {"path": path, "certificate": certificate, "goal": ends.indices[row], "gap": 0.0}
        return result(PlanStatus.FOUND, f"{message}; {certificate.message}", **known)

    @property
    def _name(self) -> str:
        return type(self.planner).__name__


def planner_of(given: Planner | str | None = None, **settings: Any) -> RrtConnect | CertifiedPlanner:
    """Return a planner with certified paths.

    Parameters
    ----------
    given
        An object with the method of :class:`Planner`; ``"rrt_connect"``, which is the default; or the class of another
        package as ``"module:Class"``.
    settings
        Settings of a planner that is named; the others are its defaults.

    Raises
    ------
    UnknownNameError
        If there is no planner with this name, or its module cannot be imported.
    InputError
        If a setting is invalid, or the object lacks what a planner needs.
    """
    planner: object = given
    if planner is None or planner == DEFAULT_PLANNER:
        return RrtConnect(**settings)
    if isinstance(planner, str):
        module, _, attribute = planner.partition(":")
        valid = (DEFAULT_PLANNER, "MODULE:CLASS")
        if not module or not attribute:
            raise UnknownNameError("planner", planner, valid)
        try:
            planner = getattr(import_module(module), attribute)(**settings)
        except (ImportError, AttributeError) as error:
            raise UnknownNameError("planner", str(given), valid, str(error)) from error
    if isinstance(planner, CertifiedPlanner) or type(planner) is RrtConnect:  # a subclass may return other paths
        return planner
    method = getattr(planner, "plan", None)
    if isinstance(planner, type):
        raise InputError(f"planner is the class {planner.__name__}; give an object of it: {planner.__name__}()")
    if not callable(method):
        raise InputError(
            f"planner must have the method plan(checker, start, goals, *, rng=0); {planner!r:.80} lacks it"
        )
    if reason := _misfit(method):
        kind = type(planner).__name__
        raise InputError(f"the method plan of {kind} cannot be called as plan(checker, start, goals, rng=0): {reason}")
    return CertifiedPlanner(planner)  # type: ignore[arg-type]  # checked


def _misfit(method: Any, *keywords: str) -> str:
    """Why a method cannot be called as that of a planner, with further keywords; empty if it can or is not readable."""
    try:
        signature = inspect.signature(method)
    except (TypeError, ValueError):  # a compiled method
        return ""
    try:
        signature.bind(None, None, None, rng=0, **dict.fromkeys(keywords))
    except TypeError as error:
        return str(error)
    return ""
