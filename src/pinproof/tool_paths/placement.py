"""Base placement for a job of tool paths: where the robot is placed so that all strokes are followed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pinproof.cell import GraspTable, PlacementRegion, PlacementResult, place_base
from pinproof.collision import CollisionChecker, Scene
from pinproof.model import Arm
from pinproof.picks import PickBudget, PickCell, Picks, PickWeights, root_from_frame
from pinproof.spatial import Array
from pinproof.tool_paths.files import ToolJob
from pinproof.tool_paths.report import FollowReport, follow_job
from pinproof.tool_paths.search import NOMINAL
from pinproof.tool_paths.suggestions import screening_grid

# Number of places of all strokes that are screened, and the least number of each stroke.
SCREENED, LEAST = 24, 4


def place_job(
    job: ToolJob, region: PlacementRegion, *, arm: Arm | None = None, scene: Scene | None = None, **settings: Any
) -> PlacementResult:
    """Search for the placement of the robot's base at which all strokes of a job are followed.

    Many placements are screened: whether some configuration without contact exists at each of some places of the
    strokes. At the best ones the whole job is followed; the result is the one with the best certified motion.

    Parameters
    ----------
    job
        The job, in the frame of the cell.
    region
        The placements of the root link that are searched.
    arm, scene
        The arm without its tool and the obstacles in the frame of the cell; by default those that the job states.
    **settings
        As for :func:`pinproof.place_base`, such as ``placement_budget`` and ``workers``.

    Raises
    ------
    InputError, RunInterrupted
        As :func:`pinproof.place_base`.
    """
    arm = job.settings.load_arm() if arm is None else arm
    return place_base(arm, job.load_scene() if scene is None else scene, JobWork(job), region, **settings)


@dataclass(frozen=True, eq=False)
class JobWork:
    """A job of tool paths as the work of a robot whose base is placed."""

    job: ToolJob
    checker: CollisionChecker | None = None
    rng: int = 0

    parts, poses, success = "strokes", "poses", "followed by one certified motion"

    @property
    def settings(self) -> Picks:
        """The settings of the job."""
        return self.job.settings

    @property
    def names(self) -> Sequence[str]:
        """The job, which is judged as a whole."""
        return ("the job",)

    def changed(self, settings: Picks) -> JobWork:
        """The job with other settings."""
        return JobWork(replace(self.job, settings=settings))

    def frames(self) -> Iterator[tuple[str, str]]:
        """The frame of the strokes."""
        source, place = self.job.source, self.settings.places.get("frame")
        yield "the job" if source is None or place is None else f"the job of {source} ({place})", self.job.frame

    def table(self, cell: PickCell) -> GraspTable:
        """The poses of the tcp at places of the strokes, at rotations of the tool."""
        job, checker = self.job, cell.checker
        root_from_paths = root_from_frame(job.frame, job.settings.frames, checker.scene, checker.arm).homogeneous
        poses = np.array([root_from_paths @ pose for _, _, pose in self._places()])
        turns = screening_grid(job.free_rotation).turns
        rows = (poses[:, None] @ turns[None]).reshape(-1, 4, 4) @ job.settings.tip.inverse().homogeneous
        stations = np.full((6, len(rows), 4, 4), np.nan)
        stations[:3] = rows
        # There and back, and along the paths at their speeds
        speeds = [NOMINAL if own.path.speed is None else own.path.speed for own in job.strokes]
        seconds = sum(float((own.path.lengths / v).sum()) for own, v in zip(job.strokes, speeds, strict=True))
        return GraspTable(
            tuple(name for name, _, _ in self._places()), np.repeat(np.arange(len(poses)), len(turns)), stations,
            np.tile(np.arange(len(turns)) % 2 == 1, len(poses)), poses, {}, 2.0 / len(poses), seconds,
        )  # fmt: skip

    def _places(self) -> list[tuple[str, str, Array]]:
        """The places that are screened: the name, the stroke and the pose in the frame of the paths."""
        job, found = self.job, list[tuple[str, str, Array]]()
        departure = job.approach if job.departure is None else job.departure
        for stroke in job.strokes:
            last = len(stroke.path) - 1
            at = np.linspace(0.0, last, max(LEAST, SCREENED // len(job.strokes)) if last else 1)
            poses = stroke.path.at(at)
            found += [
                (f"{stroke.name} at {100.0 * place / max(last, 1):.0f} %", stroke.name, pose)
                for place, pose in zip(at, poses, strict=True)
            ]
            for name, length, end in (("approach", job.approach, 0), ("departure", departure, -1)):
                if length:
                    lifted = np.array(poses[end])
                    lifted[:3, 3] -= length * lifted[:3, 2]
                    found.append((f"the {name} of {stroke.name}", stroke.name, lifted))
        return found

    def at(self, arm: Arm, scene: Scene, home: Array, rng: int, weights: PickWeights, budget: PickBudget) -> JobWork:
        """The job with the arm at a placement; a home is part of the motion only if the job states one."""
        del weights, budget
        job = self.job
        if job.settings.home:
            stated = dict(zip(arm.joint_names, home.tolist(), strict=True))
            job = replace(job, settings=replace(job.settings, home=stated))
        return JobWork(job, job.load_checker(job.at_tip(arm), scene), rng)

    def fresh(self) -> JobWork:
        """The same: nothing is kept."""
        return self

    def judge(self, index: int) -> FollowReport:
        """The report on the job."""
        del index
        return follow_job(self.job, checker=self.checker, suggestions=0, rng=self.rng)

    def row(self, verdict: FollowReport) -> dict[str, Any]:
        """The outcome, with the first stroke that is not followed."""
        failed = next((own.stroke.name for own in verdict.strokes if not own.plan.ok), verdict.motion.status.name)
        return {"ok": verdict.ok, "failed_at": "" if verdict.ok else failed, "duration": verdict.total_time}

    def report(self, verdicts: Sequence[FollowReport]) -> FollowReport:
        """The report on the job."""
        return verdicts[0]

    def score(self, report: FollowReport, objective: str) -> float:
        """The value of the objective for the motion of the job."""
        if objective == "manipulability":
            q = [piece.q for own in report.good for piece in own.plan.pieces]
            return -float(report.checker.arm.manipulability_batch(np.concatenate(q)).min()) if q else np.nan
        return report.total_time if objective == "cycle_time" else -report.clearance

    def reason(self, report: FollowReport, index: int) -> str | None:
        """Why the stroke of a screened place is not followed."""
        name = self._places()[index][1]
        failed = {own.stroke.name: own.plan.message for own in report.strokes if not own.plan.ok}
        return failed.get(name)
