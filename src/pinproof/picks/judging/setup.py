"""What all picks of a list are judged with; it is built and validated once."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.collision import (
    Certificate,
    CertificateStatus,
    CollisionChecker,
    OccupancyGrid,
    Scene,
    files_examined_once,
    overlap_hint,
)
from pinproof.common.content_hash import describe_code, digest
from pinproof.common.results import outline
from pinproof.common.validation import Rng, require_positive, seed_sequence
from pinproof.description import GENERATED_BODIES, VISUALS_CAN_BE_CHECKED, has_generated_bodies
from pinproof.errors import InputError
from pinproof.model import Arm
from pinproof.motion import MotionProgram
from pinproof.picks.grasps.proposals import with_proposals
from pinproof.picks.input.pick import RETURN, Member, Pick
from pinproof.picks.input.picks import Picks
from pinproof.picks.input.settings import PickBudget, PickWeights
from pinproof.picks.judging.grasp import PickCheck, contact_words, judge_grip
from pinproof.picks.judging.judge import judge
from pinproof.picks.judging.task import (
    CARRYING,
    PickCell,
    PickTask,
    check_held_joints,
    check_windings,
    checker_of_picks,
    gripper_links,
    torque_limits_of_tool,
    with_hand,
)
from pinproof.picks.judging.timing import (
    ExecutedMotion,
    certify_displaced,
    part_again,
    prove_executed,
    prove_part,
)
from pinproof.picks.judging.verdict import PickVerdict, member_of
from pinproof.spatial import twist_size, xyz_rpy

GRASP_TOLERANCE = 1e-4
"""m and rad: by how much the tip of a program may be away from the grasp and the release of its pick. The rounding of
joint values in the languages of controllers, at most 1e-5 rad a joint, moves it by less."""


@dataclass(frozen=True, eq=False)
class PickSetup:
    """Everything that a verdict depends on besides the pick. It pickles with all geometry and needs no files.

    Parameters
    ----------
    checker
        The arm in its scene, with the tool attached.
    shared
        The settings that the picks share; its list of picks is empty.
    home
        (n,) the start of the transits; collision-free and within the limits.
    seeds
        The random stream of pick i is its child ``first_stream + i``.
    """

    checker: CollisionChecker
    shared: Picks
    home: npt.NDArray[np.float64]
    seeds: np.random.SeedSequence
    first_stream: int = 0
    weights: PickWeights = field(default_factory=PickWeights)
    budget: PickBudget = field(default_factory=PickBudget)

    @classmethod
    def make(
        cls,
        arm: Arm,
        scene: Scene,
        picks: Picks,
        *,
        home: npt.ArrayLike | None,
        rng: Rng,
        weights: PickWeights | None = None,
        budget: PickBudget | None = None,
        checks: Iterable[PickCheck] = (),
    ) -> PickSetup:
        """Build and validate the setup; ``home`` is by default that of the picks, otherwise that of the arm.

        ``checks`` are added to those of the picks.

        Raises
        ------
        InputError
            If home is outside the limits, in contact, or for other joints; if a joint has no velocity limit; or if the
            held joints, the gripper links or the gripping values of the picks do not fit the arm; or if no grasp can
            be proposed for a part type that states none.
        """
        # Every joint needs limits, without which no motion can be timed
        unknown = [
            name
            for name, *rates in zip(arm.joint_names, arm.limits.velocity, arm.limits.acceleration, strict=True)
            if not np.isfinite(rates).all()
        ]
        if unknown:
            raise InputError(
                f"motions cannot be timed: {', '.join(unknown)} has no velocity or acceleration limit; "
                "state it in a file of joint limits (`limits` of the picks file, --limits, in Python limits=)"
            )
        picks.check_tools()
        picks.check_parts()
        check_held_joints(arm, picks)
        check_windings(arm, picks)
        torque_limits_of_tool(arm, picks)
        # The arm at rest in its cell, with the open hand
        checker = checker_of_picks(arm, scene, picks)
        stated = picks.home_configuration(arm.joint_names, arm.home) if home is None else home
        start = arm.limits.snap(arm.configuration(stated, "home"))
        for tool in (None, *picks.tools):
            hand = picks.with_tool(tool)
            held = checker if tool is None else with_hand(checker, hand)
            checked = held.check(start)
            trouble = [*arm.limits.violations(start, arm.joint_names), *contact_words(checked)]
            if trouble:
                trouble += filter(None, [overlap_hint(held, start, checked)])
                if home is None and not (picks.home or arm.robot.home):
                    reason = "the robot states no home, and this is the middle of its limits; state one in the picks"
                    trouble.append(reason)
                mounted = "" if tool is None else f" with tool {tool!r}"
                raise InputError(f"home is not a valid start{mounted}: {'; '.join(trouble)}")
            if tool is not None:
                check_held_joints(held.arm, hand)
                torque_limits_of_tool(held.arm, hand)
        # Part types that state no grasps get proposals
        picks = with_proposals(picks, arm)
        # Streams of random numbers that do not depend on earlier calls with this generator
        seeds = seed_sequence(rng)
        return cls(
            checker,
            replace(picks, picks=(), problems=(), checks=(*picks.checks, *checks)),
            start,
            seeds,
            seeds.n_children_spawned,
            weights or PickWeights(),
            budget or (PickBudget() if picks.optimise is None else PickBudget(motion=picks.optimise)),
        )

    def __repr__(self) -> str:
        return outline("PickSetup", (repr(self.checker), repr(self.shared)))

    @cached_property
    def cell(self) -> PickCell:
        """The cell in which every pick is judged."""
        return PickCell(self.checker, self.shared, self.home, self.weights, self.budget)

    def rng(self, index: int) -> np.random.Generator:
        """The random stream of the pick at ``index``, which does not depend on where or when it is judged."""
        key = (*self.seeds.spawn_key, self.first_stream + index)
        return np.random.default_rng(
            np.random.SeedSequence(self.seeds.entropy, spawn_key=key, pool_size=self.seeds.pool_size)
        )

    def judge(self, index: int, pick: Pick) -> PickVerdict:
        """The verdict on the pick at ``index``."""
        with files_examined_once():
            return judge(pick, self.cell, self.rng(index))

    def made_by(self, pick: Pick, member: str) -> tuple[PickTask, Member]:
        """The grasp of a pick with which a program was made, by its name; only that one has its hand.

        Raises
        ------
        InputError
            If the pick has no such grasp.
        """
        grasps = (own for own in self.shared.grasps_of(pick) if member.startswith(own.grasp or ""))
        tasks = (PickTask(own, self.cell) for own in grasps)
        families = ((task, each) for task in tasks for group in task.groups() for each in group)
        for task, each in families:
            if member_of(task.pick.grasp, each.words) == member:
                return task, each
        raise InputError(f"pick {pick.name!r} has no grasp {member!r}, with which the program was made")

    def recertify(
        self,
        program: MotionProgram,
        pick: Pick,
        *,
        deviation: float = 0.0,
        executed: Mapping[str, ExecutedMotion] | None = None,
    ) -> tuple[Certificate, ...]:
        """Certify the motions of a program again in this setup.

        Parameters
        ----------
        program
            The program; its motions may differ from those that were certified (:attr:`MotionProgram.changed`).
        pick
            The pick of the program.
        deviation
            rad or m: the proofs also cover configurations that differ by no more than this in each joint, except on
            motions on which a part is lifted off a support, or put onto it. The depth of bodies of the hand in the
            part is limited without it.
        executed
            What a controller executes instead of the motions, by the keys of their certificates.

        Returns
        -------
        tuple[Certificate, ...]
            The certificate of each motion of the program, in order. A certificate holds for the joint values and times
            of the program; the grasp pose and the joint limits are not checked.

        Raises
        ------
        InputError
            If the program is for another arm, or the pick has no grasp of the program's family, no motion of a name of
            the program, or another object.
        """
        arm = self.checker.arm
        if program.joint_names != arm.joint_names:
            own = ", ".join(arm.joint_names)
            raise InputError(f"the program has the joints {', '.join(program.joint_names)}; the arm has {own}")
        require_positive("deviation", deviation, zero=True)
        task, member = self.made_by(pick, program.member)
        # What is wrong at the events, by the key of the certificate of the motion that ends there: the tip is not where
        # the pick grasps or puts down, the hand does not hold the part there, or the events are not those of the pick
        faults: dict[str, str] = {}
        expected, kinds = ["grip"] if pick.place is None else ["grip", "release"], [e.kind for e in program.events]
        if kinds != expected:
            wanted = f"the program has the events {', '.join(kinds) or 'none'}; the pick has {', '.join(expected)}"
            faults[program.segments[0].certificate] = wanted
        for event in program.events if not faults else ():
            segment = min(program.segments, key=lambda part: abs(part.end - event.time))
            q, grips = segment.trajectory.end, event.kind == "grip"
            target = task.target(task.grasp(member) if grips else task.release(member))
            off, turned = twist_size(target, arm.forward_kinematics(q))
            if off > GRASP_TOLERANCE or turned > GRASP_TOLERANCE:
                away = f"{off * 1e3:.3g} mm and {np.rad2deg(turned):.3g} deg"
                where = "grasp" if grips else "release"
                faults[segment.certificate] = f"the tip is {away} from the {where} of the pick"
            elif grips:
                result = judge_grip(task, [member], q[None], np.zeros(1, dtype=np.int64)).result
                if not result.ok:
                    faults[segment.certificate] = result.message
        # Each motion under the conditions of its part; no deviation is covered where a part is on its support
        found = []
        for key, trajectory in program.motions.items():
            part = part_again(task, member, program.certificates[key].name, trajectory)
            if executed is None:
                proof = prove_part(part, trajectory, 0.0 if part.parting else deviation)
            else:
                proof = prove_executed(part, executed[key])
            timed = (trajectory,) if executed is None else executed[key].timed
            if part.name == RETURN and (off := float(np.abs(trajectory.end - self.home).max())) > GRASP_TOLERANCE:
                faults[key] = f"the return ends {off:.3g} rad or m from home"
            hold = task.hold(member) if part.name in CARRYING else None
            slips = [f"the part {peak}" for each in timed if hold is not None and not (peak := hold.peak(each)).holds]
            if slips:
                faults[key] = "; ".join(filter(None, [faults.get(key), slips[0]]))
            if fault := faults.get(key):
                message = f"{fault}; {proof.message}"
                proof = replace(proof, status=CertificateStatus.VIOLATED, clearance=np.nan, message=message)
            found.append(proof)
        return tuple(found)

    def certify_displaced(self, verdict: PickVerdict, by: float) -> tuple[Certificate, ...]:
        """Certify the unchanged motions of a good pick for a part that is displaced by up to ``by`` metres.

        Every motion is certified until one is not FREE. No point of the part is farther than ``by`` from where the pick
        states it, in the scene and in the hand, and it still rests on its support; without an object every obstacle may
        be displaced. Whether the hand holds the displaced part, and how deep its palm is in it, is not checked.

        Raises
        ------
        InputError
            If the pick is not good and therefore has no motion.
        """
        require_positive("by", by, zero=True)
        self.shared.refuse_conveyor("the certificate for a displaced part")
        task = PickTask(verdict.pick, self.cell)
        member = next(
            (each for group in task.groups() for each in group if each.words == verdict.member and verdict.ok), None
        )
        if member is None:
            raise InputError(f"pick {verdict.pick.name!r} is {verdict.status.value}, so it has no motion")
        found: list[Certificate] = []
        for motion in verdict.motions:
            found.append(certify_displaced(task, member, motion, by))
            if not found[-1].free:
                break
        return tuple(found)

    def not_covered(self, with_object: Collection[bool]) -> tuple[str, ...]:
        """What the verdicts do not cover or assume, one sentence each.

        Parameters
        ----------
        with_object
            Which of True and False occur: picks that state an object, and picks that do not.
        """
        checker = self.checker
        urdf = checker.arm.robot.urdf
        notes = []
        hands = [self.shared.with_tool(name) for name in self.shared.tools] or [self.shared]
        # How picks are held
        if False in with_object:
            notes.append("picks without `object:` are judged with an empty gripper after the grasp")
        for hand in hands if True in with_object else ():
            if hand.grip_limits.hold:
                continue
            if (hand.grip_limits.force if hand.cup is None else hand.cup.force) is not None:
                notes.append("slip of parts in the hand whose mass is not stated (`payload`)")
            elif hand.fingers is not None or hand.grip:
                notes.append(
                    "gripping force and slip of the part; only contact of the fingers on opposite sides of it is "
                    "checked"
                )
            elif hand.cup is not None:
                notes.append(
                    "the holding force of the suction cup; only that its rim lies on the surface of the part is checked"
                )
            else:
                notes.append(
                    "the holding force of a tool without fingers; only a distance of at most "
                    f"{hand.grip_limits.tip * 1e3:g} mm from the tip to the surface of the part is checked"
                )
        # What has other margins
        links = [link for link in gripper_links(checker.arm, self.shared) if link in checker.obstacles_and_links]
        if checker.margin > 0.0 and links:
            notes.append(
                f"the margin between two links of the gripper ({', '.join(links)}), which are checked for contact only"
            )
        # What limits of torque leave out
        for torques in filter(None, (torque_limits_of_tool(checker.arm, hand) for hand in hands)):
            notes.append("joint friction and the inertia of motors, which add to the torques")
            notes += torques.notes
        notes += [f"other arms of this type: {remark}" for remark in checker.arm.robot.remarks]
        # What the geometry of the robot and of the scene leaves out
        can = f"; {VISUALS_CAN_BE_CHECKED}" if urdf.visual_only else ""
        if not urdf.collisions:
            notes.append(f"the robot has no collision geometry, so contact of its links is not detected{can}")
        elif has_generated_bodies(urdf):
            notes.append(GENERATED_BODIES)
        if urdf.collisions and urdf.visual_only:
            notes.append(f"links with visual geometry but no collision geometry: {', '.join(urdf.visual_only)}{can}")
        if not checker.scene:
            notes.append("the scene has no obstacles, so the robot was checked only against itself")
        for thing in checker.scene.obstacles:
            if isinstance(thing.shape, OccupancyGrid):
                notes.append(f"what {thing.name} does not show: {thing.shape.remark}")
        if checker.hollow_meshes:
            notes.append(f"bodies completely inside meshes that are not watertight: {', '.join(checker.hollow_meshes)}")
        return tuple(dict.fromkeys(notes))

    def identity(self) -> dict[str, Any]:
        """The parts that identify this setup, as plain values for JSON; large parts as hashes."""
        arm, shared = self.checker.arm, self.shared
        kinematics = (arm.robot.urdf.kinematics, arm.base, arm.tcp, arm.joint_names, arm.held)
        attached = {each.name for each in self.checker.attached}
        obstacles = [body.content() for body in self.checker.bodies if body.link is None]
        margins = sorted((*sorted(pair), margin) for pair, margin in self.checker.spec.margins.items())
        tool = [body.content() for body in self.checker.bodies if body.owner in attached]
        return {
            "robot": f"{arm.robot.name} {digest(kinematics)}",
            "limits": digest(arm.limits),
            "scene": f"{len(self.checker.scene)} obstacles {digest(obstacles)}",
            "tool": f"{len(self.checker.attached)} bodies {digest(tool)}",
            "tip": (xyz_rpy(shared.tip) + 0.0).tolist(),
            "margin": self.checker.margin,
            "collision checks": self.checker.fingerprint()[:16],
            "home": self.home.tolist(),
            "seed": str(self.seeds.entropy),
            "hand": digest((shared.fingers, shared.cup, shared.gripper, shared.grip, shared.grip_limits)),
            "conveyor": digest(shared.conveyor),
            "payload": digest((shared.payload, shared.torque_limits)),
            "straight": shared.straight,
            "frames": digest(shared.frames),
            **({"margins": digest(margins)} if margins else {}),
            **({"tools": digest((shared.tools, shared.tool_change))} if shared.tools else {}),
            **({"parts": digest(shared.parts)} if shared.parts else {}),
            "judged by": digest((self.weights, self.budget)),
            **({"checks": [describe_code(check) for check in shared.checks]} if shared.checks else {}),
        }
