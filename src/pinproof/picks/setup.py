"""What all picks of a list are judged with, made and checked once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, Scene
from pinproof.errors import InputError
from pinproof.ik.settings import Rng, seed_sequence
from pinproof.model import Arm
from pinproof.picks.identity import digest
from pinproof.picks.judge import contact_words, judge
from pinproof.picks.pick import Pick, Picks
from pinproof.picks.verdict import PickVerdict
from pinproof.spatial import xyz_rpy

__all__ = ["PickSetup"]


@dataclass(frozen=True, eq=False)
class PickSetup:
    """What the verdict on a pick depends on beside the pick; it pickles, geometry included, so it needs no files.

    Parameters
    ----------
    checker
        The arm in its scene, with the tool attached.
    shared
        What the picks share; it lists none itself.
    home
        (n,) where transits start; free and inside the limits.
    seeds
        The random stream of pick i is the child ``first_stream + i`` of it.
    """

    checker: CollisionChecker
    shared: Picks
    home: npt.NDArray[np.float64]
    seeds: np.random.SeedSequence
    first_stream: int = 0

    @classmethod
    def make(cls, arm: Arm, scene: Scene, picks: Picks, *, home: npt.ArrayLike | None, rng: Rng) -> PickSetup:
        """Bring it all together; ``home`` is by default the one of the picks, else the arm's.

        Raises
        ------
        InputError
            If home is outside the limits or in contact (with what), or names joints the arm does not have; or if a
            joint has no velocity limit, without which no motion can be timed.
        """
        _refuse_untimed(arm)
        checker = CollisionChecker(arm, scene, margin=picks.margin, attached=picks.tool)
        start = arm.configuration(picks.home_configuration(arm.joint_names, arm.home) if home is None else home, "home")
        trouble = [*arm.limits.violations(start, arm.joint_names), *contact_words(checker.check(start))]
        if trouble:
            raise InputError(f"home cannot be a start: {'; '.join(trouble)}")
        seeds = seed_sequence(rng)
        return cls(checker, replace(picks, picks=(), problems=()), start, seeds, seeds.n_children_spawned)

    def rng(self, index: int) -> np.random.Generator:
        """The random stream of the pick at ``index``: its own, wherever and whenever it is judged."""
        key = (*self.seeds.spawn_key, self.first_stream + index)
        return np.random.default_rng(
            np.random.SeedSequence(self.seeds.entropy, spawn_key=key, pool_size=self.seeds.pool_size)
        )

    def judge(self, index: int, pick: Pick) -> PickVerdict:
        """The verdict on the pick that stands at ``index``."""
        return judge(pick, self.shared, self.checker, self.home, self.rng(index))

    def not_covered(self) -> tuple[str, ...]:
        """What a yes says nothing about, so that nobody takes it for more than it is."""
        checker = self.checker
        urdf = checker.arm.robot.urdf
        solid = {geometry.link for geometry in urdf.collisions}
        ghosts = [link for link in dict.fromkeys(geometry.link for geometry in urdf.visuals) if link not in solid]
        notes = ["what is picked is not carried: the way from the grasp on is judged for the empty tool"]
        if not solid:
            notes.append("the robot has no collision geometry: its links touch nothing whatever they meet")
        elif ghosts:
            notes.append(f"links that are drawn but have no collision geometry: {', '.join(ghosts)}")
        if not checker.scene.obstacles:
            notes.append("there is no obstacle: the robot was only judged against itself")
        if checker.hollow:
            notes.append(f"not watertight, so being wholly inside is not seen: {', '.join(checker.hollow)}")
        return tuple(notes)

    def identity(self) -> dict[str, Any]:
        """What tells it from others, part by part, as plain values for JSON; long things by a hash."""
        arm = self.checker.arm
        words = (arm.robot.urdf.kinematics, arm.base, arm.tcp, arm.joint_names, arm.held)
        carried = {each.name for each in self.checker.attached}
        obstacles = [body.content() for body in self.checker.bodies if body.link is None]
        tool = [body.content() for body in self.checker.bodies if body.owner in carried]
        return {
            "robot": f"{arm.robot.name} {digest(words)}",
            "limits": digest(arm.limits),
            "scene": f"{len(self.checker.scene.obstacles)} obstacles {digest(obstacles)}",
            "tool": f"{len(self.checker.attached)} bodies {digest(tool)}",
            "tip": (xyz_rpy(self.shared.tip) + 0.0).tolist(),
            "margin": self.checker.margin,
            "collision checks": self.checker.fingerprint()[:16],
            "home": self.home.tolist(),
            "seed": str(self.seeds.entropy),
        }


def _refuse_untimed(arm: Arm) -> None:
    unknown = [
        name
        for name, *rates in zip(arm.joint_names, arm.limits.velocity, arm.limits.acceleration, strict=True)
        if not np.isfinite(rates).all()
    ]
    if unknown:
        raise InputError(
            f"no motion can be timed: {', '.join(unknown)} states no velocity or acceleration limit; "
            "give the arm limits (robot.arm(limits=JointLimits(...)))"
        )
