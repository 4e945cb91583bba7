"""Campaigns of tool paths: many strokes, each followed by itself in worker processes, with their results on disk."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from pinproof.collision import CollisionChecker
from pinproof.common import theme
from pinproof.common.content_hash import digest
from pinproof.common.results import Rows
from pinproof.common.validation import require_integer
from pinproof.ik import prove_unreachable
from pinproof.picks import CampaignResult, ItemCampaign, PickStatus
from pinproof.spatial import Array
from pinproof.tool_paths.files import ToolJob
from pinproof.tool_paths.following import follow
from pinproof.tool_paths.pictures import SIZE
from pinproof.tool_paths.result import Obstruction
from pinproof.tool_paths.rungs import PathArm
from pinproof.tool_paths.search import ROUNDED
from pinproof.tool_paths.strokes import Stroke

# Largest numbers of blocked poses of a path that are tried to be proven out of reach, and of boxes of each proof.
PROVEN, BOXES = 4, 2000
# Numbers of paths and of points of all paths on a page.
SHOWN, POINTS = 500, 8000


class PathCampaign(ItemCampaign):
    """A campaign over strokes, each of which is followed by itself; see :func:`path_campaign`."""

    def __init__(self, setup: PathSetup, source: StrokeList) -> None:
        super().__init__(setup, source, judge_path, items="paths")
        self._settings = setup.settings

    def write_page(self, result: CampaignResult, path: str | Path, *, live: bool | None = None) -> None:
        """Write an HTML page with the paths, red where they cannot be passed, and a table of the first rows."""
        from pinproof.viewer import ColouredPoints, write_html

        checker, strokes = self._setup.checker, self._source.part(0, SHOWN)
        arm = PathArm.of(checker.group, *(self._settings.get(name) for name in ("frame", "arm"))).arm
        root = checker.group.root_from_frame(checker.group.home, arm.base).homogeneous
        colours = {name: np.array(theme.rgb(theme.COLOURS[name])) for name in ("good", "bad")}
        points, shades, rows = list[Array](), list[Array](), list[list[object]]()
        for row, stroke in zip(result.rows(), strokes, strict=False):
            at = np.linspace(0.0, len(stroke.path) - 1.0, max(POINTS // min(len(self), SHOWN), 8))
            bad = np.full(len(at), row["verdict"] != PickStatus.GOOD.value and not row.get("blocked"))
            for part in row.get("blocked", ()):
                bad |= (at >= part["pose"] - 0.5) & (at <= part["last"] + 0.5)
            points.append((root @ stroke.path.at(at))[:, :3, 3])
            shades.append(np.where(bad[:, None], colours["bad"], colours["good"]))
            rows.append([row["name"], row["verdict"], row.get("duration"), row["reason"]])
        legend = (("can be passed", tuple(colours["good"])), ("cannot be passed", tuple(colours["bad"])))
        shown = ColouredPoints(np.concatenate(points), np.concatenate(shades), SIZE, legend)
        table = Rows(("path", "verdict", "duration [s]", "reason"), rows, result.total).html(SHOWN)
        panel = f'<section class="below"><p>{escape(result.summary)}</p>{table}</section>'
        write_html(path, checker.group, checker.scene, attached=checker.attached, points=shown, panel=panel,
                   title=result.summary, live=live)  # fmt: skip


def path_campaign(job: ToolJob, *, checker: CollisionChecker | None = None, rng: int = 0) -> PathCampaign:
    """A campaign over the strokes of a job, each of which is followed by itself, in its direction and from its start.

    Parameters
    ----------
    job
        The job; its settings are those of each path.
    checker
        The arm in its scene with the tool; by default as :meth:`ToolJob.load_checker` loads it.
    rng
        The seed.

    Raises
    ------
    InputError, PicksError
        As :meth:`ToolJob.load_checker`.
    """
    require_integer("rng", rng, 0)
    checker = job.load_checker() if checker is None else checker
    setup = PathSetup(checker, {**job.options, "rng": rng})
    return PathCampaign(setup, StrokeList(job.placed(checker)))


@dataclass(frozen=True, eq=False)
class PathSetup:
    """What each path is followed with: the arm in its scene, and the settings of :func:`pinproof.follow`."""

    checker: CollisionChecker
    settings: dict[str, Any]

    def identity(self) -> dict[str, Any]:
        """What the rows depend on, as plain values by name."""
        group, scene = self.checker.group, self.checker.scene
        return {
            "robot": f"{group.robot.name} {digest((group.robot.urdf.kinematics, group.ends, group.held))}",
            "limits": digest(group.limits),
            "scene": f"{len(scene)} obstacles {self.checker.fingerprint()[:16]}",
            "margin": self.checker.margin,
            "settings": digest(sorted(self.settings.items())),
        }

    def not_covered(self, with_object: Collection[bool]) -> tuple[str, ...]:
        """What the verdicts do not cover."""
        del with_object
        return ("motions between the paths, their order and other directions",)


@dataclass(frozen=True, eq=False)
class StrokeList:
    """Strokes as the source of a campaign."""

    strokes: tuple[Stroke, ...]
    with_object: frozenset[bool] = frozenset()

    def __len__(self) -> int:
        return len(self.strokes)

    def part(self, start: int, stop: int) -> Iterable[Stroke]:
        """The strokes from index ``start`` to ``stop``."""
        return self.strokes[start:stop]

    def digest(self) -> str:
        """A hash of all paths."""
        return digest([(own.name, own.path.poses, own.path.speed) for own in self.strokes])


def judge_path(setup: PathSetup, index: int, stroke: Stroke) -> dict[str, Any]:
    """The row of a path. It is impossible only if one of its poses is proven to be out of reach by its tolerances."""
    del index
    plan, settings = follow(setup.checker, stroke.path, **setup.settings), setup.settings
    proven = False
    if settings["free_rotation"] is False:
        # The tool may be this far from a blocked pose, which is itself on a rounding of the path
        tolerances = {
            f"{name}_tolerance": (1.0 + ROUNDED) * settings[key]
            for name, key in (("position", "deviation"), ("orientation", "rotation_deviation"))
        }
        far = [own for own in plan.blocked if own.proven and own.obstruction is Obstruction.OUT_OF_REACH]
        proven = any(
            prove_unreachable(setup.checker.arm, own.place, **tolerances, budget=BOXES, search=False).proven
            for own in far[:PROVEN]
        )
    verdict = PickStatus.GOOD if plan.ok else PickStatus.IMPOSSIBLE if proven else PickStatus.NOT_FOUND
    row = {"name": stroke.name, "verdict": verdict.value, "failed_at": None if plan.ok else plan.status.name.lower()}
    return {**row, "reason": "" if plan.ok else plan.message, **plan.to_dict()}
