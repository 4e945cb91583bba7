"""Picks of two arms over one bin: allocated, certified on a common clock, and audited on exact meshes at all times."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import process_time

import pinproof as pp
from pinproof.cell import AllocationResult
from pinproof.collision import audit

FILE = Path(__file__).resolve().parents[1] / "robots" / "two_ur5" / "picks.yaml"

AUDIT_STEP = 0.01
"""Largest motion of a joint in rad between common times at which the exact meshes of both arms are checked."""

SUPPORT = 1e-3
"""Metres: a part rests on what is at most this far from it."""


@dataclass(frozen=True)
class SharedBinRow:
    """One cell: times in seconds, and the result of the independent check."""

    cell: str
    picks: int
    makespan: float
    one_arm: float
    waiting: tuple[float, ...]
    utilisation: tuple[float, ...]
    status: str
    clearance: float
    intervals: int
    seconds: float
    samples: int
    unsafe: tuple[str, ...]

    @property
    def ratio(self) -> float:
        """The makespan divided by the time of one arm."""
        return self.makespan / self.one_arm


def measure_shared_bin(seed: int, on_progress: Callable[[str], None]) -> SharedBinRow:
    """Allocate the picks of the shipped cell, and audit the motion of both arms."""
    picks = pp.read_picks(FILE)
    begin = process_time()
    scene = pp.Scene() if picks.scene is None else pp.Scene.load(picks.scene)
    result = pp.cell.allocate(picks.load_cell(), scene, picks, rng=seed)
    seconds = process_time() - begin
    on_progress(result.message)
    samples, unsafe = audit_allocation(result, on_progress)
    one = result.one_arm
    return SharedBinRow(
        FILE.parent.name,
        sum(len(each.picks) for each in result),
        result.makespan,
        float("nan") if one is None or one.duration is None else one.duration,
        tuple(each.waiting for each in result),
        tuple(each.utilisation for each in result),
        "FREE" if result.ok else result.message,
        result.clearance,
        len(result.intervals),
        seconds,
        samples,
        tuple(unsafe),
    )


def audit_allocation(result: AllocationResult, on_progress: Callable[[str], None]) -> tuple[int, list[str]]:
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
        found = audit(interval.trajectory, checker, step=AUDIT_STEP, measure=False)
        samples += found.samples
        unsafe += [] if found.clean else [f"{interval.start:.3f} s: {found.message}"]
        if number % 20 == 0:
            on_progress(f"audit: {number + 1} of {len(result.intervals)} intervals, {len(unsafe)} unsafe")
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
