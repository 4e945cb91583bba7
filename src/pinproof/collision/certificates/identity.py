"""What a certificate is for: hashes of its curve and setup, the notes about the setup, and changes since a motion file.

The setup is the arm, its attached objects, the scene and the movers, see :class:`pinproof.collision.CheckerSpec`.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from pinproof.collision.certificates.path_constraints import PathConstraint, exact_text
from pinproof.collision.checking.spec import EXAMINED, present_stamp
from pinproof.collision.geometry.bodies import FileStamp
from pinproof.collision.geometry.occupancy import OccupancyGrid
from pinproof.collision.geometry.shapes import Mesh, Obstacle
from pinproof.common.files import os_errors
from pinproof.description import GENERATED_BODIES
from pinproof.motion import Curve, MotionRecord
from pinproof.spatial import matrix
from pinproof.verifier import curve_digest

if TYPE_CHECKING:
    from pinproof.collision.checking.checker import CollisionChecker

DIGITS = 9
"""Decimals of a pose (metres for positions) that a digest distinguishes: files round rotations."""

HELD_TOLERANCE = 1e-9
"""rad or m: two values of a held joint that differ by less are the same."""

NAMED = 6
"""Number of names that a note lists; more are counted."""


def curve_hash(curve: Curve) -> str:
    """Return a hash of the joints, knots and polynomial pieces of a curve, exact to the last bit."""
    return curve_digest(tuple(curve.joint_names), *curve.bezier())


class Identity(NamedTuple):
    """The hashes of a curve and of the setup of its checker, and the notes about the setup."""

    curve: str
    setup: str
    notes: tuple[str, ...]


def identity_of(curve: Curve, checker: CollisionChecker) -> Identity:
    """Return what a certificate of a curve states about the curve and the setup."""
    examined = EXAMINED.get()
    known = None if examined is None else examined.setups.get(checker)
    if known is None:
        files = mesh_files(checker)
        known = checked_hash(checker, files), notes_of(checker, files)
        if examined is not None:
            examined.setups[checker] = known
    return Identity(curve_hash(curve), *known)


class MeshFiles(NamedTuple):
    """The present state of the mesh files of a checker."""

    stamps: tuple[FileStamp | None, ...]
    """Of the meshes of the robot, the attached objects and the obstacles; None for a mesh without a file."""
    changed: tuple[FileStamp, ...]
    """The files, as the checker read them, that were changed since then."""


_meshes: WeakKeyDictionary[CollisionChecker, tuple[list[str | None], list[FileStamp]]] = WeakKeyDictionary()
"""The paths of the meshes of each checker, and the stamps of the files that it read."""

_setups: WeakKeyDictionary[CollisionChecker, tuple[tuple[FileStamp | None, ...], str]] = WeakKeyDictionary()
"""The hash of the setup of each checker, with the mesh files for which it holds: one motion may need many proofs."""


def mesh_files(checker: CollisionChecker) -> MeshFiles:
    """Return the present state of the mesh files of a checker; each file is examined once."""
    known = _meshes.get(checker)
    if known is None:
        urdf, objects = checker.group.robot.urdf, (*checker.attached, *checker.scene.obstacles)
        paths: list[str | Path | None] = [each.mesh.path for each in urdf.collisions if each.mesh is not None]
        paths += [each.shape.path for each in objects if isinstance(each.shape, Mesh)]
        read = dict.fromkeys(body.file for body in checker.bodies if body.file is not None)
        known = _meshes[checker] = [None if path is None else os.fspath(path) for path in paths], list(read)
    named, read_files = known
    now = {path: present_stamp(path) for path in {*named, *(file.path for file in read_files)} if path is not None}
    stamps = tuple(None if path is None else now[path] for path in named)
    return MeshFiles(stamps, tuple(file for file in read_files if now[file.path] != file))


def checked_hash(checker: CollisionChecker, files: MeshFiles) -> str:
    """Return the hash of the setup of a checker, whose present files are given.

    If a mesh file was changed after the checker read it, the hash matches no setup.
    """
    known = _setups.get(checker)
    if known is None or known[0] != files.stamps:
        known = _setups[checker] = files.stamps, checker.spec.setup_hash()
    digest, changed = known[1], files.changed
    return hashlib.sha256(repr((digest, changed)).encode()).hexdigest() if changed else digest


def notes_of(checker: CollisionChecker, files: MeshFiles | None = None) -> tuple[str, ...]:
    """Return the assumptions of a checker's verdicts as sentences: replaced meshes, held joints, unchecked links.

    Excluded pairs are listed in the attribute ``excluded`` of the checker, each with its reason. ``files`` are the
    present mesh files, which are examined by default.
    """
    before, after = _unchanging_notes(checker)
    changed = [Path(file.path).name for file in (files or mesh_files(checker)).changed]
    about_files = [f"{_some(changed)}: changed after the checker read it; create a new checker"] if changed else []
    return tuple(dict.fromkeys((*before, *about_files, *after)))


_notes: WeakKeyDictionary[CollisionChecker, tuple[list[str], list[str]]] = WeakKeyDictionary()


def _unchanging_notes(checker: CollisionChecker) -> tuple[list[str], list[str]]:
    """Return the notes that precede and follow the notes about changed files."""
    if checker in _notes:
        return _notes[checker]
    arm, notes = checker.group, list(checker.scene.notes)
    by_remark: dict[str, dict[str, None]] = {}
    for body in checker.bodies:
        if body.remark:
            by_remark.setdefault(body.remark, {})[body.owner] = None
    for thing in checker.scene.obstacles:  # a grid without an occupied cell has no body
        if isinstance(thing.shape, OccupancyGrid):
            by_remark.setdefault(thing.shape.remark, {})[thing.name] = None
    notes += [f"{_some(tuple(owners))}: {remark}" for remark, owners in by_remark.items()]
    how: dict[str, list[str]] = {}
    for pair in checker.finer:
        how.setdefault(f"checked with {pair.by}, because {pair.reason}", []).append(" and ".join(pair.owners))
    notes += [f"{_some(pairs)}: {judged}" for judged, pairs in how.items()]
    solid = {body.link for body in checker.bodies if body.owner == body.link}
    if not solid:
        notes.append("the robot has no collision geometry, so its links are not checked")
    elif arm.robot.has_generated_bodies:
        notes.append(GENERATED_BODIES)
    elif drawn := [link for link in dict.fromkeys(g.link for g in arm.robot.urdf.visuals) if link not in solid]:
        notes.append(f"{_some(drawn)}: visible, but without collision geometry, so not checked")
    held = [f"{name} = {value:g}" for name, value in arm.held.items()]
    _notes[checker] = notes, [f"joints outside the arm are held fixed: {_some(held)}"] if held else []
    return _notes[checker]


def _some(names: Sequence[str]) -> str:
    more = f", ... ({len(names)} in all)" if len(names) > NAMED else ""
    return ", ".join(names[:NAMED]) + more


def body_digest(body: Obstacle) -> str:
    """Return a hash of name, shape and pose of an attached body; FileError if a mesh file cannot be read.

    A mesh file is hashed by content, not by path.
    """
    shape, digest = body.shape, hashlib.sha256()
    if isinstance(shape, Mesh) and shape.path is not None:
        with os_errors(shape.path):
            digest.update(hashlib.sha256(Path(shape.path).read_bytes()).digest())
        digest.update(repr((shape.scale, shape.hull, shape.hollow)).encode())
    else:
        digest.update(repr(shape).encode())
    digest.update(repr(body.name).encode() + (np.round(matrix(body.pose), DIGITS) + 0.0).tobytes())
    return digest.hexdigest()


def missing_since(records: tuple[MotionRecord, ...], checker: CollisionChecker) -> tuple[str, ...]:
    """List, in sentences, which parts of the setup of a certified motion the checker does not have.

    Compared are attached bodies, positions of held joints, and the obstacles if the checker has none.
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
        found.append(f"it was certified with {_listed(absent)} attached, which is missing now")
    if other := [name for name, known in first.attached.items() if name in now and body_digest(now[name]) != known]:
        found.append(f"{_listed(other)} had another shape or pose on the tcp when it was certified")
    held = checker.group.held
    for name, value in first.held.items():
        if name in held and abs(held[name] - value) > HELD_TOLERANCE:
            found.append(f"it was certified with {name} held at {value:.9g}, now at {held[name]:.9g}")
    if first.obstacles and not checker.scene:
        found.append(
            f"it was certified among the obstacles {_listed(first.obstacles)}, but the scene has no obstacles now"
        )
    return tuple(found)


def changes_since(
    records: tuple[MotionRecord, ...],
    checker: CollisionChecker,
    curve: str,
    setup: str,
    constraints: Sequence[PathConstraint] = (),
) -> list[str]:
    """List, in sentences, all differences between the certification recorded with a motion and the present one."""
    found = list(missing_since(records, checker))
    required = set(map(exact_text, constraints))
    lost = dict.fromkeys(text for record in records for text in record.constraints if text not in required)
    found += [f"it was certified with the constraint {text}, which is not required now" for text in lost]
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
