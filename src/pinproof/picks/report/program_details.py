"""What a program of picks states beside its moves: tool, load, sensor, frame, external axes and remarks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import chain, islice, zip_longest

import numpy as np

from pinproof.errors import InputError, UnknownNameError
from pinproof.model import Arm, Payload
from pinproof.motion import (
    CheckInput,
    JointMove,
    MotionProgram,
    ProgramSegment,
    Remark,
    RobotProgram,
    SetLoad,
    SetOutput,
    Step,
    ToolData,
    UserFrame,
    Wait,
    certificate_id,
    external_joints,
    find_dialect,
    make_program,
)
from pinproof.picks.input.pick import RETURN, Pick
from pinproof.picks.input.picks import Picks, root_from_frame
from pinproof.picks.judging.setup import PickSetup
from pinproof.picks.judging.task import torque_limits_of_tool
from pinproof.picks.judging.verdict import PickMotion
from pinproof.planning import plan, planner_of
from pinproof.spatial import SE3

# Names of links that are flanges by convention.
FLANGES = ("tool0", "flange")


def check_export(arm: Arm, picks: Picks, language: str) -> dict[str, str]:
    """Return the external joints of programs of picks, each with its unit, before anything is planned.

    Raises
    ------
    InputError
        If the language has no outputs, or cannot express the joints of the arm.
    UnknownNameError
        If the language, the flange, the frame, or a joint of ``external_axes`` does not exist.
    """
    dialect = find_dialect(language)
    if not dialect.outputs:
        raise InputError(f"{language}: picks need digital outputs; use urscript, rapid, krl or fanuc")
    if picks.program.main:
        dialect.main(())
    if picks.program.input is not None:
        dialect.checked_signal("input", picks.program.input)
    flange_of(arm, picks)
    if picks.program.frame is not None and picks.program.frame not in picks.frames:
        raise UnknownNameError("frame", picks.program.frame, picks.frames, f"program of {picks.source or 'the picks'}")
    external = external_joints(arm, picks.program.external_axes)
    if reason := dialect.refuses(arm, external):
        raise InputError(reason)
    return external


def flange_of(arm: Arm, picks: Picks) -> str:
    """The link in whose frame the tool of the controller is stated; see :class:`ProgramSettings`."""
    model, joint = arm.model, arm.model.frames[arm.tcp_id].parentJoint
    links = {frame.name: frame.parentJoint for frame in model.frames if str(frame.type) == "BODY"}
    stated = picks.program.flange
    if stated is not None:
        if stated not in links:
            raise UnknownNameError("link", stated, links, f"program.flange of {picks.source or 'the picks'}")
        if links[stated] != joint:
            raise InputError(f"program.flange: the last joint does not move the link {stated!r}")
        return stated
    own = [name for name, parent in links.items() if parent == joint]
    return next((name for name in FLANGES if name in own), own[0])


def controller_tool(arm: Arm, picks: Picks) -> ToolData:
    """The tool of the hand of picks: the tcp of the arm and the stated masses, in the frame of the flange."""
    flange, q = flange_of(arm, picks), arm.home

    def from_flange(link: str) -> SE3:
        return arm.frame_placement(q, flange).inverse() * arm.frame_placement(q, link)

    placed = [each.placed(from_flange(each.frame or arm.tcp)) for each in picks.payload]
    mass = sum(each.mass for each in placed)
    moment = sum((each.mass * np.array(each.center_of_mass) for each in placed), np.zeros(3))
    return ToolData(picks.program.tool, from_flange(arm.tcp), mass, moment / (mass or 1.0))


def user_frame(setup: PickSetup) -> UserFrame | None:
    """The stated frame of programs of picks, in the base of the arm."""
    name, arm = setup.shared.program.frame, setup.checker.arm
    if name is None:
        return None
    pose = root_from_frame(name, setup.shared.frames, setup.checker.scene, arm)
    return UserFrame(name, arm.root_from_base.inverse() * pose)


def after_gripper(setup: PickSetup, tool: ToolData, pick: Pick, member: str, *, grips: bool) -> list[Step]:
    """What a program of a pick states after its gripper has closed or opened: the check of the sensor, and the load.

    The load is the part in the axes of the flange, as it is held. Most languages state the mass of tool and part
    together, so without one of them the controller keeps its own load.
    """
    task, made = setup.made_by(pick, member)
    stated, part, steps = setup.shared.program, task.pick.payload, list[Step]()
    if grips and stated.input is not None:
        steps.append(CheckInput(stated.input, True, stated.timeout, error=stated.error or ""))
    if part is not None and tool.mass:
        center = part.placed(tool.tcp * task.holding(made).pose).center_of_mass
        steps.append(SetLoad(Payload(part.mass, center) if grips else None))
    return steps


def load_faults(setup: PickSetup, picks: Mapping[str, Pick], program: RobotProgram) -> Iterator[str]:
    """Why the loads or the checks of the sensor in a text are not those of the picks file, in a sentence."""
    own = [picks[planned.name] for planned in program.picks]
    tool = controller_tool(setup.checker.arm, setup.shared.for_pick(setup.shared.grasps_of(own[0])[0]))
    # What the picks file states after each output, with the rounded numbers of a text
    number, added = -1, list[list[Step]]()
    for step in program.steps:
        if isinstance(step, SetOutput):
            number = min(number + step.on, len(own) - 1)
            pick, member = own[max(number, 0)], program.picks[max(number, 0)].member
            added.append(after_gripper(setup, tool, pick, member, grips=step.on))
    written = make_program(
        [JointMove(setup.checker.arm.home), *chain(*added)],
        program.joint_names,
        dialect=program.dialect,
        tool=tool,
        external_joints=program.external_joints,
    )
    rounded, counts = iter(written.steps[1:]), iter([len(steps) for steps in added])
    if _masses(written.tool) != _masses(program.tool):
        yield "the mass or the centre of mass of the tool is not that of the picks file"
    # The steps of the text, with those of the picks file after each output and its waiting time
    expected, pending = list[Step](), list[Step]()
    for step in (step for step in program.steps if not isinstance(step, Remark | SetLoad | CheckInput)):
        if not isinstance(step, Wait):
            expected, pending = expected + pending, []
        expected.append(step)
        if isinstance(step, SetOutput):
            pending = list(islice(rounded, next(counts)))
    stated = (step for step in program.steps if not isinstance(step, Remark))
    for found, wanted in zip_longest(stated, expected + pending):
        same = found is wanted
        if isinstance(found, SetLoad) and isinstance(wanted, SetLoad):
            same = _masses(found.payload) == _masses(wanted.payload)
        elif isinstance(found, CheckInput) and isinstance(wanted, CheckInput):
            same = replace(found, line=0) == replace(wanted, line=0)
        if not same:
            what = "check of the sensor" if CheckInput in (type(found), type(wanted)) else "load"
            where = "the end of the text" if found is None else f"line {found.line}"
            yield f"{where}: the {what} is not that of the picks file"
            return


def _masses(body: ToolData | Payload | None) -> list[float]:
    return [] if body is None else [body.mass, *np.array(body.center_of_mass).tolist()]


def with_return(setup: PickSetup, pick: Pick, program: MotionProgram) -> tuple[MotionProgram, str]:
    """The program of a pick with a certified return to home, or unchanged with the reason why it does not return."""
    last = program.segments[-1]
    if last.name != "leave":
        return program, "it ends with the part in the hand, or at it"
    task, member = setup.made_by(pick, program.member)
    checker, torques = task.returning(member), torque_limits_of_tool(task.arm, task.cell.shared)
    motion = plan(
        checker,
        last.trajectory.end,
        setup.home,
        planner=planner_of(setup.budget.planner).limited_to(setup.budget.nodes),
        rate_limits=[] if torques is None else [torques],
        blend=False,
        budget=setup.budget.motion,
    )
    if not motion.ok:
        return program, motion.message
    around = checker.attached, checker.scene, checker.arm.held
    return with_motion(program, PickMotion(RETURN, motion.trajectory, motion.certificate, *around)), ""


def with_motion(program: MotionProgram, motion: PickMotion) -> MotionProgram:
    """The program with a certified return after its last motion."""
    record = motion.certificate.motion_record(RETURN, 0.0, motion.trajectory.duration)
    segment = ProgramSegment(RETURN, program.duration, motion.trajectory, certificate_id(record))
    records = {**program.certificates, segment.certificate: record}
    return replace(program, segments=(*program.segments, segment), certificates=records)
