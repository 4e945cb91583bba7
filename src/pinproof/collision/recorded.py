"""Whether a motion is judged with what its file records: attached bodies, held joints, obstacles."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pinproof.collision.scene import Obstacle
from pinproof.collision.shapes import Mesh
from pinproof.errors import FileError
from pinproof.spatial import matrix

if TYPE_CHECKING:
    from pinproof.collision.checker import CollisionChecker
    from pinproof.motion import MotionRecord

__all__ = ["body_digest", "changes_since", "missing_since"]

DIGITS = 9
"""Decimals of a pose, in metres for positions, that a digest distinguishes: files state rotations to rounding."""

HELD_TOLERANCE = 1e-9
"""rad or m: two values of a held joint that differ by less are the same."""


def body_digest(body: Obstacle) -> str:
    """A hash of name, shape and pose of an attached body; of a mesh file its content counts, not where it is.

    Raises
    ------
    FileError
        If a mesh file cannot be read.
    """
    shape, digest = body.shape, hashlib.sha256()
    if isinstance(shape, Mesh) and shape.path is not None:
        try:
            digest.update(hashlib.sha256(Path(shape.path).read_bytes()).digest())
        except OSError as error:
            raise FileError(shape.path, f"cannot be read: {error.strerror or error}") from error
        digest.update(repr((shape.scale, shape.hull, shape.hollow)).encode())
    else:
        digest.update(repr(shape).encode())
    digest.update(repr(body.name).encode() + (np.round(matrix(body.pose), DIGITS) + 0.0).tobytes())
    return digest.hexdigest()


def missing_since(records: tuple[MotionRecord, ...], checker: CollisionChecker) -> tuple[str, ...]:
    """What a motion was certified with and a checker lacks, in sentences; without it, FREE would mean less.

    Attached bodies, positions of held joints, and the obstacles if the checker has none at all.
    """
    if not records:
        return ()
    first = records[0]
    if not all(first.same_setup(other) for other in records):
        names = ", ".join(record.name for record in records)
        return (f"its parts ({names}) were certified with different attached bodies, held joints or scenes",)
    found = []
    now = {body.name: body for body in checker.attached}
    if absent := [name for name in first.attached if name not in now]:
        found.append(f"it was certified with {_listed(absent)} attached, now missing")
    if other := [name for name, told in first.attached.items() if name in now and body_digest(now[name]) != told]:
        found.append(f"{_listed(other)} had another shape or pose on the tcp when it was certified")
    held = checker.arm.held
    for name, value in first.held.items():
        if name in held and abs(held[name] - value) > HELD_TOLERANCE:
            found.append(f"it was certified with {name} held at {value:.9g}, now at {held[name]:.9g}")
    if first.obstacles and not checker.scene.obstacles:
        found.append(f"it was certified among the obstacles {_listed(first.obstacles)}, now there is none")
    return tuple(found)


def changes_since(records: tuple[MotionRecord, ...], checker: CollisionChecker, curve: str, setup: str) -> list[str]:
    """What differs from how a motion was certified, in sentences: what is missing, and what else is not the same."""
    found = list(missing_since(records, checker))
    if len(records) != 1:
        return found
    record = records[0]
    if record.curve != curve:
        found.append("it was changed after it was certified")
    if record.margin > checker.margin:
        found.append(f"it was certified with a margin of {record.margin * 1e3:.9g} mm")
    if not found and record.setup != setup:
        found.append("it was certified with another robot, another scene or more bodies, or their files were moved")
    return found


def _listed(names: tuple[str, ...] | list[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))
