"""What a page computes with: the core as WebAssembly, a cell as one block of numbers, and the names of its parts.

The block has its only writer and its only reader in the core (``src/core/web/cell.h``); this module names what the
numbers describe.
"""

from __future__ import annotations

import zlib
from base64 import b64encode
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.resources import files
from typing import Any

import numpy as np

from pinproof._core import cell_block
from pinproof.collision import CollisionChecker, certify
from pinproof.description import catalogue_names, find_robot
from pinproof.errors import InputError, PinproofError
from pinproof.ik import web_arm
from pinproof.model import Arm, Robot
from pinproof.motion import Trajectory
from pinproof.spatial import Array, matrix
from pinproof.viewer.panels import MOST_BYTES
from pinproof.viewer.picture import Picture, RenderedPicture
from pinproof.viewer.wire import script_json

MOST_MOMENTS = 600
"""Moments of a motion at which a page knows the configuration; it interpolates in between."""


@dataclass(frozen=True, eq=False)
class WebCell:
    """A checker as a page needs it.

    ``block`` is the block of numbers, ``settings`` are the names, ``links`` the frames whose poses a check returns.
    """

    block: Array
    settings: dict[str, Any]
    links: tuple[str, ...]

    @classmethod
    def of(
        cls, checker: CollisionChecker, links: tuple[str, ...] = (), q: Array | None = None, *, wide: Arm | None = None
    ) -> WebCell:
        """Describe a checker; a page also places ``links``, and opens at the configuration q (n,).

        ``wide`` is the only arm of the checker with wider limits, which follows the arms in the block.
        """
        group, world = checker.group, checker.world
        ends = [link for base_and_tcp in group.ends.values() for link in base_and_tcp]
        frames = tuple(dict.fromkeys((*links, *ends)))
        arms = [web_arm(arm, frames.index(arm.base), group.indices(name).tolist()) for name, arm in group.arms.items()]
        if wide is not None:
            arms.append(web_arm(wide, frames.index(wide.base), range(wide.dof)))
        block = np.asarray(cell_block(world, *checker.joints_of_links(frames), arms))
        # The numbers of the bodies of each obstacle among those of all obstacles
        obstacles: dict[str, list[int]] = {}
        own = sum(body.link is not None for body in checker.bodies)
        for number, body in enumerate(checker.bodies[own:]):
            obstacles.setdefault(body.owner, [number, 0])[1] = number + 1
        lower, upper = group.limits.sampling_range()
        limits = np.stack([group.limits.lower, group.limits.upper], axis=1).tolist()
        poses = {thing.name: matrix(thing.pose) for thing in checker.scene.obstacles}
        settings = {
            "joints": [
                {
                    "name": name,
                    "lower": low,  # of the slider
                    "upper": high,
                    "limits": [end if np.isfinite(end) else None for end in ends],
                    "unit": "rad" if angular else "m",
                }
                for name, low, high, ends, angular in zip(
                    group.joint_names, lower.tolist(), upper.tolist(), limits, group.angular.tolist(), strict=True
                )
            ],
            "q": (group.home if q is None else q).tolist(),
            "arms": [
                {"name": name, "tcp": frames.index(arm.tcp), "base": arm.base, "joints": group.indices(name).tolist()}
                for name, arm in group.arms.items()
            ],
            "frames": frames,
            "owners": [body.owner for body in checker.bodies],
            "obstacles": [
                {"name": name, "bodies": numbers, "pose": poses[name].ravel().tolist()}
                for name, numbers in obstacles.items()
            ],
            "margin": checker.margin,
            "robot": _word_for(group.robot),
            "attached": [thing.name for thing in checker.attached],
        }
        return cls(block, settings, frames)

    @cached_property
    def texts(self) -> dict[str, str]:
        """The module and the block in base64, compressed, for the elements of a page with these identifiers."""
        numbers = self.block.astype("<f8").tobytes()
        return {"core": _module(), "cell": b64encode(zlib.compress(numbers, 9)).decode("ascii")}


def _word_for(robot: Robot) -> str:
    """The name of a robot of the catalogue, or of the file of another one, for a command."""
    file = robot.urdf.path
    for name in (robot.name, *([] if file is None else [file.stem])):
        if name in catalogue_names() and find_robot(name).urdf == file:
            return name
    return robot.name if file is None else file.name


@cache
def _module() -> str:
    module = files("pinproof.viewer").joinpath("core.wasm").read_bytes()
    return b64encode(zlib.compress(module, 9)).decode("ascii")


def web_cell_of(picture: Picture, rendered: RenderedPicture, wanted: bool | None) -> WebCell | None:
    """Return what a page computes with; None if that is not wanted, or too large where it is only the default.

    A picture whose cell cannot be checked, for example because a mesh is missing, is a page that does not compute.
    """
    if wanted is False:
        return None
    certificate, proven, checker = picture.certificate, rendered.caption.headline == "FREE", picture.checker
    try:
        if checker is None and certificate is not None and proven and certificate.subject is not None:
            # The checker of a recorded proof, which may have margins of single pairs
            recorded = certificate.subject[1]
            checker = None if isinstance(recorded, str) else recorded
        known = checker is not None or certificate is None
        if checker is None:
            # What the proof does not cover is not shown as a contact either
            margin = 0.0 if certificate is None else certificate.margin
            allowed = [] if certificate is None else [pair.owners for pair in certificate.excluded]
            arm, scene, attached = picture.arm, picture.scene, picture.attached
            checker = CollisionChecker(arm, scene, margin=margin, attached=attached, allowed=allowed)
        if checker.group.joint_names != picture.arm.joint_names:
            raise InputError(f"checker has the joints {checker.group.joint_names}, arm has {picture.arm.joint_names}")
        q = picture.arm.home if picture.q is None else picture.arm.configuration(picture.q)
        links = tuple(link.name for link in rendered.stage.links if link.name in picture.arm.robot.urdf.links)
        cell = WebCell.of(checker, tuple(dict.fromkeys((*links, *rendered.frames))), q)
    except PinproofError:
        if wanted is None:
            return None
        raise
    settings: dict[str, Any] = {"proven": proven, "knownMargins": known, "motion": None, "proof": None}
    found = None if picture.trajectory is None else moments(picture.trajectory)
    if rendered.curve is not None:
        found = rendered.curve.values - rendered.curve.lower, rendered.curve.q
    if found is not None:
        times, configurations = found
        settings["q"] = configurations[0].tolist()
        settings["motion"] = {"times": times.tolist(), "q": configurations.ravel().tolist()}
    cell.settings.update(settings)
    size = sum(map(len, cell.texts.values())) + len(script_json(cell.settings))
    if wanted is None and size > MOST_BYTES:
        return None
    # The proof, which the page verifies again where it is not too large
    proof = _proof_of(picture, checker) if proven else None
    if proof is not None:
        included = len(proof) <= MOST_BYTES - (size if wanted is None else 0)
        cell.settings["proof"] = {"bytes": len(proof), "included": included}
        cell.texts.update({"proof-file": proof} if included else {})
    return cell


def _proof_of(picture: Picture, checker: CollisionChecker) -> str | None:
    """Return the proof of the motion shown, compressed, in base64; None if it has parts that proof files do not have.

    Such parts are pairs that may touch at the start.
    """
    certificate, motion = picture.certificate, picture.trajectory
    if certificate is None or motion is None:
        return None
    try:
        if certificate.evidence is None:
            tolerances: dict[str, Any] = {}
            if (tube := certificate.tube) is not None:
                tolerances = {"joint_tolerance": tube.joints, "obstacle_tolerance": tube.obstacles}
            constraints = [each.constraint for each in certificate.constraints]
            certificate = certify(motion, checker, constraints=constraints, record=True, **tolerances)
        return b64encode(zlib.compress(certificate.proof_text().encode(), 9)).decode("ascii")
    except PinproofError:
        return None


def moments(motion: Trajectory) -> tuple[Array, Array]:
    """Times (F,) and configurations (F, n) of a motion, close enough to each other for a page to interpolate."""
    times = np.unique(np.concatenate([motion.times, np.linspace(0.0, motion.duration, MOST_MOMENTS // 2)]))
    times = np.unique(np.append(times[:: len(times) // MOST_MOMENTS + 1], motion.duration))
    return times, np.asarray(motion(times), dtype=float)
