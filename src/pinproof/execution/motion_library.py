"""Stored motions with their certificates, for scenes that change between two executions, and their files.

A file has hashes of the motions and of the setup for which they were certified.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from importlib.metadata import version
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.collision import (
    Certificate,
    CollisionChecker,
    Scene,
    SetupChange,
    StoredProof,
    certify,
    checked_margin,
    only_arm,
)
from pinproof.common import structs as st
from pinproof.common.files import read_json, unknown_suffix, write_text_whole
from pinproof.common.results import Answer, Rows, Shown, View
from pinproof.common.validation import require_type
from pinproof.errors import FileError, InputError, UnknownNameError
from pinproof.execution.monitor import per_joint
from pinproof.motion import MOTION, Trajectory, time_parametrise, to_message
from pinproof.planning import Planner, PlanResult, planner_of, shortcut
from pinproof.spatial import SE3, Array, finite, matrix, rigid

JOINTS = 1e-3
"""rad or m: by default, a motion has a given start or goal if no joint differs by more."""

POSITION, ANGLE = 1e-3, 1e-2
"""Metres and radians: the same limits for poses of the tcp."""

RENEWED = 0.5
"""If a larger share of the pairs has changed, new evidence is recorded for the present scene."""

SAMPLES = 400
"""Configurations of a motion at which the part that is in collision is located, before it is replaced and certified."""

MOST_ATTEMPTS = 6
"""Largest number of parts of a motion, in order of length, that a repair tries to replace."""


SCHEMA = "pinproof/library/1"
"""The version of the format, raised by breaking changes."""

STORED = st.Table(
    "stored_motion",
    "A motion of the library.",
    st.required("name", st.ANY_TEXT, "name of the motion"),
    st.required("sha256", st.ANY_TEXT, "hash (SHA-256, hexadecimal) of its curve"),
    st.required("motion", MOTION, "the motion, as in a motion file"),
)

LIBRARY = st.Table(
    "library",
    "A library of motions. A file contains no proofs: the motions are certified again when it is read.",
    st.schema_version(SCHEMA),
    st.required("made_by", st.ANY_TEXT, "the program that wrote the file"),
    st.required("robot", st.ANY_TEXT, "name of the robot"),
    st.required("robot_sha256", st.ANY_TEXT, "hash of kinematics, joints, held joints and link geometry"),
    st.required("tool_sha256", st.ANY_TEXT, "hash of the attached objects"),
    st.required("margin", st.PLAIN_NUMBER, "required distance between any two bodies", "m"),
    st.required(
        "joint_tolerance", st.list_of(st.NOT_NEGATIVE, 1), "deviation of each joint that is covered", "rad or m"
    ),
    st.required("obstacle_tolerance", st.NOT_NEGATIVE, "displacement of obstacles that is covered", "m"),
    st.required("motions", st.list_of(STORED), "the motions"),
)


@st.described(eq=False)
class StoredMotion(Shown):
    """A motion of a library, with its certificate in the scene of the library."""

    name: str = st.key("its name")
    trajectory: Trajectory = st.key("the motion")
    certificate: Certificate = st.key("the certificate for the checker of the library: FREE, COLLIDING or UNDECIDED")
    proof: StoredProof | None = st.key(
        "its latest FREE certificate with evidence, in this scene or in an earlier one; None without one"
    )

    @property
    def free(self) -> bool:
        """Whether the motion is proven collision-free in the scene of the library."""
        return self.certificate.free

    def _view(self) -> View:
        head = f"{self.name!r}: {self.certificate.message}"
        return View(head, [self.certificate, self.trajectory], (repr(self.trajectory),), title=self.name)


@st.described(eq=False)
class RepairResult(Answer):
    """The outcome of a repair."""

    library: MotionLibrary = st.key("the library with the repaired motion; the library itself if the repair failed")
    motion: StoredMotion = st.key("the motion of ``library``: FREE if the repair succeeded")
    replaced: tuple[float, float] | None = st.key(
        "start and end (s) of the part of the former motion that was replaced; None if nothing was replaced"
    )
    plan: PlanResult | None = st.key("the last plan; None if no part was planned again")
    message: str = st.key("the outcome as a sentence")

    @property
    def ok(self) -> bool:
        """Whether the motion is proven collision-free."""
        return self.motion.free

    def _view(self) -> View:
        return View(self.message, [self.motion])


class MotionLibrary(Shown):
    """Motions of one arm that are proven collision-free, and are certified again quickly when the scene changes.

    A library is immutable: :meth:`add`, :meth:`with_scene` and the other methods return new libraries. In a new scene,
    only pairs of bodies with a moved or added obstacle are proven again; the evidence of all other pairs is kept.

    Parameters
    ----------
    checker
        Defines the robot, its attached objects, the margin and the scene. Motions of the library are for this setup.
    joint_tolerance, obstacle_tolerance, tolerance
        As for :func:`pinproof.certify`; they apply to every motion.
    """

    def __init__(
        self,
        checker: CollisionChecker,
        *,
        joint_tolerance: npt.ArrayLike = 0.0,
        obstacle_tolerance: float = 0.0,
        tolerance: float | None = None,
    ) -> None:
        self._checker = checker
        # a copy, because the caller may change its array later
        self._joint_tolerance = per_joint("joint_tolerance", joint_tolerance, checker.group.dof).copy()
        self._obstacle_tolerance = checked_margin("obstacle_tolerance", obstacle_tolerance)
        self._tolerance = tolerance
        self._motions: dict[str, StoredMotion] = {}

    @property
    def checker(self) -> CollisionChecker:
        """The checker for which the motions are certified."""
        return self._checker

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the motions, in order."""
        return tuple(self._motions)

    @property
    def certificates(self) -> Mapping[str, Certificate]:
        """The certificates of the motions, by name."""
        return {name: motion.certificate for name, motion in self._motions.items()}

    def __len__(self) -> int:
        return len(self._motions)

    def __iter__(self) -> Iterator[StoredMotion]:
        return iter(self._motions.values())

    def __contains__(self, name: object) -> bool:
        return name in self._motions

    def __getitem__(self, name: str) -> StoredMotion:
        if name not in self._motions:
            raise UnknownNameError("motion", name, self.names, "the library")
        return self._motions[name]

    def add(self, name: str, trajectory: Trajectory) -> MotionLibrary:
        """Return a library with one more motion, which is certified first.

        Raises
        ------
        InputError
            If the name exists, or the motion is of other joints.
        NotProvenFree
            If the motion is not proven collision-free.
        """
        if not isinstance(name, str) or not name:
            raise InputError(f"the name of a motion is {name!r}; it must be a text that is not empty")
        if not isinstance(trajectory, Trajectory):
            raise InputError(f"the library stores a Trajectory, not a {type(trajectory).__name__}; time it first")
        if name in self._motions:
            raise InputError(f"the library has a motion {name!r} already; choose another name, or remove it first")
        motion = self._new(name, trajectory, self._certify(trajectory).or_raise())
        return self._copy(self._checker, {**self._motions, name: motion})

    def remove(self, *names: str) -> MotionLibrary:
        """Return a library without these motions."""
        removed = {self[name].name for name in names}
        return self._copy(self._checker, {name: m for name, m in self._motions.items() if name not in removed})

    def with_scene(self, scene: Scene) -> MotionLibrary:
        """Return the library for another scene; every motion is certified again as in :meth:`with_checker`."""
        return self.with_checker(self._checker.with_scene(scene))

    def with_checker(self, checker: CollisionChecker) -> MotionLibrary:
        """Return the library for another checker of the same setup; every motion is certified for it.

        Motions that are not FREE are kept: they are certified again for the next scene, or by :meth:`repair`.

        Raises
        ------
        InputError
            If the robot, its attached objects, its held joints or the margin differ.
        """
        require_type("checker", checker, CollisionChecker)
        # Another setup is refused, also for an empty library
        changes = {id(self._checker): SetupChange(self._checker, checker)}
        motions: dict[str, StoredMotion] = {}
        for motion in self:
            name, trajectory, proof = motion.name, motion.trajectory, motion.proof
            if proof is None:
                motions[name] = self._new(name, trajectory, self._certify(trajectory, checker))
                continue
            if id(proof.checker) not in changes:
                changes[id(proof.checker)] = SetupChange(proof.checker, checker)
            change = changes[id(proof.checker)]
            # New evidence is recorded if much of the old one no longer applies
            record = change.changed > RENEWED * len(checker.pairs)
            certificate = proof.certify(change, tolerance=self._tolerance, record=record)
            renewed = record and certificate.free
            motions[name] = (
                self._new(name, trajectory, certificate) if renewed else replace(motion, certificate=certificate)
            )
        return self._copy(checker, motions)

    def find(
        self,
        *,
        start: SE3 | npt.ArrayLike | None = None,
        goal: SE3 | npt.ArrayLike | None = None,
        joints: float = JOINTS,
        position: float = POSITION,
        angle: float = ANGLE,
        free: bool = True,
    ) -> tuple[StoredMotion, ...]:
        """Return the motions with a start and a goal, closest first.

        A motion begins at its own start, which may differ from ``start`` by the tolerance: a robot that is not exactly
        there needs a certificate with this joint tolerance, or a move to the start.

        Parameters
        ----------
        start, goal
            A configuration (n,), or a pose base_from_tcp of the tcp (SE3 or (4, 4)); None for any.
        joints
            rad or m: largest difference of a joint.
        position, angle
            Metres and radians: largest differences of poses.
        free
            Whether only motions are returned that are proven collision-free in the scene of the library.

        Raises
        ------
        InputError
            If a shape is wrong, a pose is not rigid, or a tolerance is not above 0.
        """
        if not min(joints, position, angle) > 0.0:
            raise InputError(f"joints = {joints}, position = {position} and angle = {angle} must be above 0")
        # The differences at both ends as shares of the tolerances; their sum orders what is found
        found = []
        for motion in self:
            if free and not motion.free:
                continue
            parts = [
                self._difference(wanted, q, joints, position, angle)
                for wanted, q in ((start, motion.trajectory.start), (goal, motion.trajectory.end))
                if wanted is not None
            ]
            if max(parts, default=0.0) <= 1.0:
                found.append((sum(parts), motion))
        return tuple(motion for _, motion in sorted(found, key=lambda each: each[0]))

    def _difference(self, wanted: SE3 | npt.ArrayLike, q: Array, joints: float, position: float, angle: float) -> float:
        """The difference of a configuration from a wanted one or a wanted pose, as a share of the tolerances."""
        if not isinstance(wanted, SE3) and np.shape(wanted) != (4, 4):
            target = finite("a start or goal", wanted, (self._checker.group.dof,))
            return float(np.abs(q - target).max()) / joints
        # The angle between two orientations from the sine and the cosine, which is accurate also for small ones
        pose = matrix(rigid("a start or goal", wanted))
        here = matrix(only_arm(self._checker.group).forward_kinematics(q))
        turn = pose[:3, :3].T @ here[:3, :3]
        axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        turned = float(np.arctan2(np.linalg.norm(axis), np.trace(turn) - 1.0))
        return max(float(np.linalg.norm(here[:3, 3] - pose[:3, 3])) / position, turned / angle)

    def repair(
        self,
        name: str,
        *,
        planner: Planner | str | None = None,
        clearance: float = 0.0,
        jerk: npt.ArrayLike | None = None,
        rng: int = 0,
    ) -> RepairResult:
        """Replace the part of a motion that is in collision, and certify the whole motion again.

        The part is that between two points at which the motion rests, such as the corners of a path. If it cannot be
        replaced, a longer part is, at last the complete motion. Start and goal are kept.

        Parameters
        ----------
        planner
            The planner; default :class:`~pinproof.RrtConnect`.
        clearance
            Metres that the new part keeps in addition to the margin where it is planned.
        jerk
            Jerk limit of the new part of a quintic motion, as for :func:`pinproof.time_parametrise`; default: the
            largest jerk of the motion.
        rng
            Seed of the planner.

        Returns
        -------
        RepairResult
            With the new library; not ``ok`` if no free motion was found.
        """
        # A quintic needs a jerk limit where it is timed again
        motion = self[name]
        if motion.free:
            return RepairResult(self, motion, None, None, f"{name} is collision-free; nothing was replaced")
        trajectory, plan, reason = motion.trajectory, None, ""
        if jerk is None and trajectory.accelerations is not None:
            jerk = np.maximum(trajectory.max_jerk(), trajectory.max_jerk().max() * 1e-3)
        # Larger parts are replaced until the whole motion is certified
        for first, last in self._parts(motion):
            ends = trajectory(np.array([first, last]))
            plan = planner_of(planner).plan(self._checker.padded(clearance), ends[0], ends[1], rng=rng)
            if not plan.ok:
                reason = plan.message
                continue
            # The detour begins and ends at rest, as the motion does there
            path = shortcut(plan.path, plan.checker, rng=rng)
            detour = time_parametrise(path, self._checker.group.limits, jerk=jerk)
            parts = [trajectory.split(first)[0]] if first > 0.0 else []
            parts += [detour, *([trajectory.split(last)[1]] if last < trajectory.duration else [])]
            fixed = Trajectory.join(*parts)
            certificate = self._certify(fixed)
            if certificate.free:
                repaired = self._new(name, fixed, certificate)
                text = f"{name}: replaced from {first:.4g} s to {last:.4g} s; {certificate.message}"
                return RepairResult(
                    self._copy(self._checker, {**self._motions, name: repaired}), repaired, (first, last), plan, text
                )
            reason = certificate.message
        return RepairResult(self, motion, None, plan, f"{name}: no collision-free replacement was found; {reason}")

    def _parts(self, motion: StoredMotion) -> Iterator[tuple[float, float]]:
        """Parts of a motion that contain all collisions, between points of rest that are free, shortest first."""
        # The times between which something is in collision or undecided
        trajectory, certificate = motion.trajectory, motion.certificate
        times = np.linspace(0.0, trajectory.duration, SAMPLES)
        bad = list(times[~self._checker.is_free_batch(trajectory(times))])
        if certificate.first_contact is not None:
            bad.append(certificate.first_contact.time)
        if certificate.undecided is not None:
            bad += [certificate.undecided.start, certificate.undecided.end]
        first, last = min(bad, default=0.0), max(bad, default=trajectory.duration)
        # A part begins and ends where the motion rests in a free configuration
        rests = [
            float(t)
            for t, v, q in zip(trajectory.times, trajectory.velocities, trajectory.q, strict=True)
            if not v.any() and self._checker.is_free(q)
        ]
        before = [t for t in rests if t <= first][::-1] or [0.0]
        after = [t for t in rests if t >= last] or [trajectory.duration]
        spans = sorted(product(before, after), key=lambda span: span[1] - span[0])
        chosen = [span for span in spans if span[0] < span[1]][: MOST_ATTEMPTS - 1]
        whole = (0.0, trajectory.duration)
        yield from chosen
        if whole not in chosen:
            yield whole

    def save(self, path: str | Path) -> None:
        """Write the motions to a ``.json`` file, with hashes of the robot, the tool and each motion.

        The format is described in docs/formats/library.md. Evidence is not written: :meth:`load` certifies every
        motion, so that no proof depends on the file.

        Raises
        ------
        FileError
            If the file cannot be written.
        """
        path = Path(path)
        if path.suffix != ".json":
            raise FileError(path, unknown_suffix(path, [".json"]))
        head = {
            "schema": SCHEMA,
            "made_by": f"pinproof {version('pinproof')}",
            **_setup(self._checker),
            "joint_tolerance": self._joint_tolerance.tolist(),
            "obstacle_tolerance": self._obstacle_tolerance,
        }
        rows = []
        for name, motion in self._motions.items():
            message = to_message(motion.trajectory.record(motion.trajectory.certified))
            rows.append({"name": name, "sha256": motion.trajectory.digest(), "motion": message})
        # One line for each motion, so that files can be compared
        text = json.dumps(head, allow_nan=False)[:-1] + ',\n "motions": [\n  '
        write_text_whole(path, text + ",\n  ".join(json.dumps(row, allow_nan=False) for row in rows) + "\n ]}\n")

    @classmethod
    def load(cls, path: str | Path, checker: CollisionChecker, *, tolerance: float | None = None) -> MotionLibrary:
        """Read a file of :meth:`save` and certify its motions for a checker, whose scene may be another one.

        Motions that are not collision-free in the scene of the checker are kept, as in :meth:`with_checker`.

        Raises
        ------
        FileError
            If the file cannot be read or was changed, or is for another robot, other attached objects or another
            margin.
        """
        path = Path(path)
        content = read_json(path, FileError)
        with st.errors_of(path, FileError):
            data = LIBRARY.parse("the file", content, path)
        # The setup must be the same
        own, group = _setup(checker), checker.group
        what = {
            "robot_sha256": (
                f"the robot {data['robot']!r} with other kinematics, link geometry or held joints than yours"
            ),
            "tool_sha256": "other attached objects than your checker has",
            "margin": f"a margin of {data['margin'] * 1e3:.9g} mm; your checker has {checker.margin * 1e3:.9g} mm",
        }
        for name, other in what.items():
            if data[name] != own[name]:
                raise FileError(path, f"its motions were certified for {other}; certify and store them again", name)
        if len(data["joint_tolerance"]) != group.dof:
            raise FileError(path, f"must have {group.dof} numbers, one for each joint", "joint_tolerance")
        # Each motion must be the one that was written
        motions: dict[str, Trajectory] = {}
        for i, row in enumerate(data["motions"]):
            name, place = row["name"], f"motions[{i}]"
            if name in motions:
                raise FileError(path, f"has two motions named {name!r}", place)
            motions[name] = trajectory = Trajectory.of_record(row["motion"])
            if trajectory.digest() != row["sha256"]:
                raise FileError(path, f"the motion {name!r} was changed: its hash differs from sha256", place)
            if trajectory.joint_names != group.joint_names:
                raise FileError(path, f"the motion {name!r} has the joints {', '.join(trajectory.joint_names)}", place)
        tolerances = {key: data[key] for key in ("joint_tolerance", "obstacle_tolerance")}
        library = cls(checker, **tolerances, tolerance=tolerance)
        stored = {name: library._new(name, motion, library._certify(motion)) for name, motion in motions.items()}
        return library._copy(checker, stored)

    def _certify(self, trajectory: Trajectory, checker: CollisionChecker | None = None) -> Certificate:
        return certify(
            trajectory,
            checker or self._checker,
            tolerance=self._tolerance,
            joint_tolerance=self._joint_tolerance,
            obstacle_tolerance=self._obstacle_tolerance,
            record=True,
        )

    def _new(self, name: str, trajectory: Trajectory, certificate: Certificate) -> StoredMotion:
        """A motion with a recorded certificate; the evidence is kept in the proof only."""
        proof = StoredProof(certificate) if certificate.free else None
        return StoredMotion(name, trajectory, certificate, proof)

    def _copy(self, checker: CollisionChecker, motions: dict[str, StoredMotion]) -> MotionLibrary:
        other = MotionLibrary(
            checker,
            joint_tolerance=self._joint_tolerance,
            obstacle_tolerance=self._obstacle_tolerance,
            tolerance=self._tolerance,
        )
        other._motions = motions
        return other

    def _view(self) -> View:
        rows = ((m.name, m.trajectory.duration, m.certificate.status.name, m.certificate.message) for m in self)
        lines = (f"{m.name}: {m.trajectory.duration:.4g} s, {m.certificate.status.name}" for m in self)
        table = Rows(("motion", "duration [s]", "status", "certificate"), rows)
        motions = "1 motion" if len(self) == 1 else f"{len(self)} motions"
        free = f"{sum(motion.free for motion in self)} proven collision-free"
        return View(f"{motions} of {self._checker.group.robot.name}, {free}", [table], lines, len(self))


def _setup(checker: CollisionChecker) -> dict[str, Any]:
    """What must agree between the checkers that write and read a library."""
    group = checker.group
    robot, tool = hashlib.sha256(), hashlib.sha256()
    robot.update(repr((group.robot.urdf.kinematics, dict(group.ends), group.joint_names, dict(group.held))).encode())
    for body in checker.bodies:
        if body.link is not None:
            (robot if body.owner == body.link else tool).update(body.content())
    hashes = {"robot_sha256": robot.hexdigest(), "tool_sha256": tool.hexdigest()}
    return {"robot": group.robot.name, **hashes, "margin": checker.margin}
