"""Measurement of picks for the benchmark of several arms: two arms over one bin, and one arm at a conveyor.

All motions are audited on exact meshes: those of two arms on their common clock, those of the other among moving parts.
"""

from __future__ import annotations

from dataclasses import replace
from time import process_time

import pinproof as pp
from benchmarks.tables import ROBOTS, Row, report
from pinproof.cell import AllocationResult
from pinproof.collision import audit
from pinproof.picks import PickMotion, PickSetup, PickVerdict, pick_from_belt

# -- two arms over one bin ---------------------------------------------------------------------------------------------

TWO_ARMS = ROBOTS / "two_ur5" / "picks.yaml"

BIN_STEP = 0.01
"""Largest motion of a joint in rad between common times at which the exact meshes of both arms are checked."""

SUPPORT = 1e-3
"""Metres: a part rests on what is at most this far from it."""


def shared_bin_row(seed: int) -> Row:
    """Allocate the picks of the shipped cell, and audit the motion of both arms; times in s."""
    picks = pp.read_picks(TWO_ARMS)
    begin = process_time()
    scene = pp.Scene() if picks.scene is None else pp.Scene.load(picks.scene)
    result = pp.cell.allocate(picks.load_cell(), scene, picks, rng=seed)
    seconds = process_time() - begin
    report(result.message)
    samples, unsafe = audit_allocation(result)
    one = result.one_arm
    return Row(
        cell=TWO_ARMS.parent.name,
        picks=sum(len(each.picks) for each in result),
        makespan=result.makespan,
        one_arm=None if one is None or one.duration is None else one.duration,
        waiting=[each.waiting for each in result],
        utilisation=[each.utilisation for each in result],
        status="FREE" if result.ok else result.message,
        clearance=result.clearance,
        intervals=len(result.intervals),
        seconds=seconds,
        samples=samples,
        wrong=[f"{TWO_ARMS.parent.name}: {text}" for text in unsafe],
    )


def audit_allocation(result: AllocationResult) -> tuple[int, list[str]]:
    """Check all bodies of all arms on exact meshes, among the parts that are in the scene at each time.

    A carried part may touch what it rests on where it is picked and placed; that it only separates from it is part of
    the certificates.
    """
    samples, unsafe = 0, []
    for number, interval in enumerate(result.intervals):
        scene = result.scene_at((interval.start + interval.end) / 2)
        carried = [result.parts[thing.name] for thing in interval.attached if thing.name in result.parts]
        allowed = [(part.after.name, name) for part in carried for name in supports(result.scene, part)]
        checker = pp.CollisionChecker(
            result.group.with_held(interval.held),
            scene,
            link_meshes="surface",
            attached=interval.attached,
            allowed=allowed,
        )
        found = audit(interval.trajectory, checker, step=BIN_STEP, measure=False)
        samples += found.samples
        unsafe += [] if found.clean else [f"{interval.start:.3f} s: {found.message}"]
        if number % 20 == 0:
            report(f"audit: {number + 1} of {len(result.intervals)} intervals, {len(unsafe)} unsafe")
    return samples, unsafe


def supports(scene: pp.Scene, part: pp.cell.PartState) -> list[str]:
    """The obstacles on which a part rests before its pick and after its release."""
    name = part.after.name
    others = pp.Scene(each for each in scene.obstacles if each.name != name)
    touching = set()
    stand = pp.load_robot("ur5").arm(tcp="tool0")  # any arm, with the part at its tcp, measures the distances
    for placed in (part.before, part.after):
        if placed is None:
            continue
        held = pp.Obstacle(name, placed.shape, stand.forward_kinematics(stand.home).inverse() * placed.pose)
        check = pp.CollisionChecker(stand, others, attached=[held], margin=SUPPORT).check(stand.home)
        touching |= {other for contact in check.contacts if name in contact.bodies for other in contact.bodies}
    return sorted((touching - {name}) & set(others.names))


# -- a conveyor --------------------------------------------------------------------------------------------------------

CONVEYORS = {"UR5, blocks 0.7 m apart": "ur5/conveyor_picks.yaml"}

SPEEDS = (0.1, 0.2, 0.3)
"""Speeds of the belt in m/s."""

BELT_STEP = 0.005
"""rad or m: nothing moves more between two samples of an audit."""


def belt_rows(speeds: tuple[float, ...], seed: int) -> list[Row]:
    """Take the parts of each cell at each speed, and audit every motion; times in s."""
    rows = []
    for name, path in CONVEYORS.items():
        picks = pp.read_picks(ROBOTS / path)
        arm, belt = picks.load_arm(), picks.conveyor
        if picks.scene is None or belt is None:
            raise ValueError(f"{path} states no scene or no conveyor")
        scene = pp.Scene.load(picks.scene)
        for speed in speeds:
            report(f"{name} at {speed:g} m/s")
            moving = replace(picks, conveyor=replace(belt, speed=speed, duration=belt.duration * belt.speed / speed))
            setup = PickSetup.make(arm, scene, moving, home=None, rng=seed)
            begin = process_time()
            result = pick_from_belt(setup, moving.picks)
            seconds = process_time() - begin
            wrong, samples = list[str](), 0
            for verdict in result.taken:
                for motion in verdict.motions:
                    found = audit(
                        motion.trajectory,
                        _exact(arm, verdict, motion, moving),
                        step=BELT_STEP,
                        measure=False,
                        movers=motion.movers,
                    )
                    samples += found.samples
                    wrong += [] if found.clean else [f"{verdict.pick.name}, {motion.name}: {found.message}"]
            cycles, met = result.cycle_times, [each.intercept for each in result.taken if each.intercept is not None]
            rows.append(
                Row(
                    cell=name,
                    speed=speed,
                    parts=len(moving.picks),
                    taken=len(result.taken),
                    mean_cycle=sum(cycles) / max(len(cycles), 1),
                    deviation=max((each.position_deviation for each in met), default=0.0),
                    clearance=min((each.clearance for each in result.taken), default=0.0),
                    seconds=seconds,
                    samples=samples,
                    wrong=wrong,
                    missed=[f"{each.pick.name}: {each.reason}" for each in result.verdicts if not each.ok],
                )
            )
    return rows


def _exact(arm: pp.Arm, verdict: PickVerdict, motion: PickMotion, picks: pp.Picks) -> pp.CollisionChecker:
    """The exact meshes, without the pairs that may touch: the hand and the part, and the part and its supports."""
    part, hand = str(verdict.pick.carried), [body.name for body in picks.open_tool]
    allowed = [(name, part) for name in hand] if motion.name != "transit" else []
    if motion.name in ("retreat", "place", "release"):
        allowed.append((part, "belt" if motion.name == "retreat" else "tray"))
    exact = pp.CollisionChecker(arm, motion.scene, attached=motion.attached, link_meshes="surface")
    return exact.allowing(*allowed)
