"""Measurement of sequences: time, gap to the lower bound, other orders, and an audit on exact meshes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time
from typing import Any, ClassVar

import numpy as np
from picks_measurements import unsafe_motions

import pinproof as pp
from pinproof.benchmarks.tables import BenchmarkTable, provenance
from pinproof.description import robots_folder
from pinproof.picks import PickSetup

AUDIT_STEP = 0.04
"""Rad: no joint moves farther between two samples of the audit."""

HEIGHTS, APPROACH = (0.15, 0.45), 0.03
"""Range of heights (m) of random points above the base, and the length (m) of their approach and retreat."""

DISTANCES = {"ur5": (0.3, 0.75), "panda": (0.35, 0.65)}
"""Horizontal distances (m) of random points from the base."""

CELLS: dict[str, tuple[str, int, int]] = {
    "palletising, 200 boxes": ("ur10/pallet_picks.yaml", 0, 0),
    "ur5, 200 points": ("ur5/picks.yaml", 200, 1),
    "panda, 200 points": ("panda/picks.yaml", 200, 2),
    "ur5, 8 points": ("ur5/picks.yaml", 8, 3),
    "ur5, 8 other points": ("ur5/picks.yaml", 8, 4),
    "panda, 8 points": ("panda/picks.yaml", 8, 5),
    "palletising, 8 boxes": ("ur10/pallet_picks.yaml", 8, 0),
}
"""Each cell with its picks file, the number of picks (0: those of the file), and a seed of random points (0: none)."""


@dataclass(frozen=True)
class SequenceRow:
    """A sequence: times in s, shares relative to the lower bounds of other orders, and the audit."""

    cell: str
    picks: int
    left_out: int
    cpu_s: float
    motions_s: float
    bound_s: float
    file_order_s: float
    nearest_s: float
    motions: int
    proven_mm: float
    audited: int
    unsafe: int


@dataclass(frozen=True)
class SequenceTable(BenchmarkTable):
    """The sequences of all cells."""

    topic: ClassVar[str] = "sequences"
    row_types: ClassVar[Mapping[str, Callable[..., Any]]] = {"rows": SequenceRow}
    rows: tuple[SequenceRow, ...] = ()


def setup_of(file: str, count: int, seed: int) -> tuple[PickSetup, list[pp.Pick]]:
    """The cell of a picks file with the first of its picks, or with random points above it."""
    picks = pp.read_picks(robots_folder() / file)
    arm, scene = picks.load_arm(), pp.Scene.load(picks.scene or Path())
    setup = PickSetup.make(arm, scene, picks, home=None, rng=0)
    if not seed:
        return setup, list(picks.picks[: count or None])
    rng = np.random.default_rng(seed)
    low, high = DISTANCES[arm.robot.name]
    found = []
    for number in range(count):
        radius, angle = rng.uniform(low, high), rng.uniform(-np.pi / 2, np.pi / 2)
        at = radius * np.cos(angle), radius * np.sin(angle), rng.uniform(*HEIGHTS)
        place = pp.pose(at, (np.pi, 0.0, rng.uniform(-np.pi, np.pi)))
        found.append(pp.Pick(f"p{number}", place, approach=APPROACH, retreat=APPROACH))
    return setup, found


def measure(cell: str) -> SequenceRow:
    """The sequence of one of :data:`CELLS`."""
    setup, picks = setup_of(*CELLS[cell])
    warm, few = setup_of("ur5/picks.yaml", 2, 1)
    pp.sequence(warm, few)  # loads libraries
    start = process_time()
    result = pp.sequence(setup, picks)
    seconds = process_time() - start
    unsafe = unsafe_motions(setup, result.motions, AUDIT_STEP)
    return SequenceRow(
        cell,
        len(result.steps),
        len(result.left_out),
        seconds,
        result.moving,
        result.lower_bound,
        result.file_order,
        result.nearest_neighbour,
        len(result.motions),
        1e3 * result.clearance,
        len(result.motions),
        unsafe,
    )


def sequence_benchmark(cells: list[str], done: Callable[[SequenceTable], object]) -> SequenceTable:
    """Measure cells one after another; ``done`` is called after each."""
    table = SequenceTable({"cells": cells}, provenance(0))
    for cell in cells:
        table = replace(table, rows=(*table.rows, measure(cell)))
        done(table)
    return table
