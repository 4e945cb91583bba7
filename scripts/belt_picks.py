"""Picks of all parts of a conveyor, one after the other, each motion audited against the moving parts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time

import pinproof as pp
from pinproof.collision import audit
from pinproof.picks import PickMotion, PickSetup, PickVerdict, pick_from_belt

ROBOTS = Path(__file__).resolve().parents[1] / "robots"

CELLS = {"UR5, blocks 0.7 m apart": "ur5/conveyor_picks.yaml"}

SPEEDS = (0.1, 0.2, 0.3)
"""Speeds of the belt in m/s."""

STEP = 0.005
"""rad or m: nothing moves more between two samples of an audit."""


@dataclass(frozen=True)
class BeltRow:
    """The picks of one cell at one speed of the belt."""

    cell: str
    speed: float
    parts: int
    taken: int
    mean_cycle: float
    deviation: float
    clearance: float
    seconds: float
    samples: int
    wrong: tuple[str, ...]
    missed: tuple[str, ...]


def belt_rows(speeds: tuple[float, ...], seed: int, on_progress: Callable[[str], None]) -> list[BeltRow]:
    """Take the parts of each cell at each speed, and audit every motion."""
    rows = []
    for name, path in CELLS.items():
        picks = pp.read_picks(ROBOTS / path)
        arm, belt = picks.load_arm(), picks.conveyor
        if picks.scene is None or belt is None:
            raise ValueError(f"{path} states no scene or no conveyor")
        scene = pp.Scene.load(picks.scene)
        for speed in speeds:
            on_progress(f"{name} at {speed:g} m/s")
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
                        step=STEP,
                        measure=False,
                        movers=motion.movers,
                    )
                    samples += found.samples
                    wrong += [] if found.clean else [f"{verdict.pick.name}, {motion.name}: {found.message}"]
            cycles, met = result.cycle_times, [each.intercept for each in result.taken if each.intercept is not None]
            rows.append(
                BeltRow(
                    name,
                    speed,
                    len(moving.picks),
                    len(result.taken),
                    sum(cycles) / max(len(cycles), 1),
                    max((each.position_deviation for each in met), default=0.0),
                    min((each.clearance for each in result.taken), default=0.0),
                    seconds,
                    samples,
                    tuple(wrong),
                    tuple(f"{each.pick.name}: {each.reason}" for each in result.verdicts if not each.ok),
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
