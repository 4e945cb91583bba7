"""One page on many picks: summary, table, the picture with every grasp, and the motions of the good ones.

The page is a file that opens anywhere, offline. Motions in it are for the eye: they are resampled, and say so. What is
proven is said of the motions themselves, which the page does not hold.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from html import escape
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from pinproof.collision import Scene
from pinproof.common.files import write_text_whole
from pinproof.errors import InputError, ViewerError
from pinproof.model import Arm
from pinproof.picks.frames import root_from_frame
from pinproof.picks.pick import Picks
from pinproof.picks.report.entries import KINDS, entry, without_more_details
from pinproof.picks.report.framing import frame_picks
from pinproof.picks.report.motions import Reel, surfaces_of
from pinproof.picks.report.report import PickReport
from pinproof.picks.report.rows import problem_row, verdict_row
from pinproof.picks.verdict import PickVerdict
from pinproof.spatial import matrix, pose
from pinproof.viewer.animation import still
from pinproof.viewer.assembly import assemble, fill, part, view_settings
from pinproof.viewer.overlays import PoseMarkers
from pinproof.viewer.picture import stage_commands
from pinproof.viewer.stage import Stage, set_stage
from pinproof.viewer.wire import Commands, node_path

if TYPE_CHECKING:
    from pinproof.picks.campaign import CampaignResult

__all__ = ["MOST_ROWS", "write_report_page"]

Array = npt.NDArray[np.float64]

OPEN_HAND = "open hand"
"""The node of the fingers at home; the page's script knows it by this name."""

MOST_ROWS = 5000
"""A table that a browser scrolls and sorts without a wait. Of more rows the first are shown, and the page says so."""


@dataclass(frozen=True)
class _Row:
    """A row of plain values, with its verdict if there is one."""

    values: dict[str, Any]
    verdict: PickVerdict | None = None


def write_report_page(
    path: str | Path,
    report: PickReport | CampaignResult,
    arm: Arm,
    scene: Scene,
    picks: Picks,
    *,
    title: str | None = None,
) -> None:
    """Write the page of a report or of a campaign.

    Parameters
    ----------
    path
        The file; written whole or not at all.
    report
        What was found. The rows of a campaign keep no motions: their page has the table and the coloured grasps.
    arm, scene
        What the picks were judged with.
    picks
        What the picks share: their tool and home.
    title
        By default the robot's name.

    Raises
    ------
    ViewerError
        If the robot has nothing to draw, or meshcat's viewer is not installed.
    FileError
        For a place that cannot be written to.
    """
    if isinstance(report, PickReport):
        rows = [_Row(verdict_row(verdict), verdict) for verdict in report.verdicts]
        rows += [_Row(problem_row(problem)) for problem in report.problems]
        total, kinds = len(rows), Counter(row.values["verdict"] for row in rows)
    else:
        rows = [_Row(values) for values in islice(report.rows(), MOST_ROWS)]
        total, kinds = report.total, Counter(report.verdicts)
    shown = rows[:MOST_ROWS]
    notes = [f"Not covered: {note}" for note in report.notes]
    notes.append(f"Acceleration limits: {report.acceleration_source}")
    if len(shown) < total:
        notes.insert(0, f"Of {total:,} rows the first {len(shown):,} are shown.")
    words = {"title": title or f"Picks of {arm.robot.name}", "summary": report.summary}
    text = _render(shown, kinds, arm, scene, picks, words, notes)
    write_text_whole(path, text)


def _render(
    rows: list[_Row],
    kinds: Counter[str],
    arm: Arm,
    scene: Scene,
    picks: Picks,
    words: dict[str, str],
    notes: list[str],
) -> str:
    stage = set_stage(arm, scene, picks.tool)
    if not stage.links:
        raise ViewerError(f"robot {arm.robot.name!r} has nothing to draw: no link has geometry")
    verdicts = [row.verdict for row in rows]
    home = next(
        (v.trajectory.start for v in verdicts if v is not None and v.trajectory is not None),
        np.array(picks.home_configuration(arm.joint_names, arm.home)),
    )
    reel = Reel.of(stage, scene, picks.tool, verdicts)
    rest = still(stage, home)
    placed = [_root_from_tip(row.values, arm, scene, picks) for row in rows]
    grasps = np.array([at for at in placed if at is not None]).reshape(-1, 4, 4)
    poses = np.concatenate([rest.poses, reel.moments])
    view = frame_picks(stage, poses, np.concatenate([rest.tcp, reel.ways]), grasps)
    commands = stage_commands(stage, rest, view)
    _draw_open_hand(commands, stage, home, picks)
    marked = [k for k, at in enumerate(placed) if at is not None]
    names = list(KINDS)
    colour_of = [names.index(rows[k].values["verdict"]) if rows[k].values["verdict"] in KINDS else -1 for k in marked]
    markers = PoseMarkers(grasps, np.array(colour_of, dtype=np.int64), tuple(kind.rgb for kind in KINDS.values()))
    told = (entry(row.values, row.verdict, arm, scene, picks) for row in rows)
    entries, bare = without_more_details(told)
    if bare:
        notes = [
            *notes,
            f"Of {bare:,} rows there is no room here for stages and parts; reports of other kinds have them.",
        ]
    settings = {
        **view_settings(view),
        "entries": entries,
        "kinds": {name: kind.css for name, kind in KINDS.items()},
        "marked": marked,
        "markers": markers.settings(commands),
        "motions": reel.add_to(commands),
        "rest": reel.at_rest(rest),
    }
    body = fill(
        part("page.html", __package__),
        {
            "title": escape(words["title"]),
            "summary": escape(words["summary"]),
            "chips": _chips(kinds),
            "notes": _items([*reel.notes, *notes, *stage.notes]),
        },
    )
    style = part("common.css") + part("page.css", __package__)
    return assemble(words["title"], style, body, part("page.js", __package__), settings, commands)


def _chips(kinds: Counter[str]) -> str:
    """A button for each verdict that occurs: it tells the colour and the number, and filters."""
    known = [name for name in KINDS if kinds[name]] + [name for name in kinds if name not in KINDS]
    return "".join(
        f'<button type="button" class="chip" data-verdict="{escape(name)}" aria-pressed="false">'
        f'<span class="swatch" style="background:{KINDS[name].css if name in KINDS else "#51606f"}"></span>'
        f"{kinds[name]:,} {escape(name)}</button>"
        for name in known
    )


def _items(texts: Iterable[str]) -> str:
    return "".join(f"<li>{escape(text)}</li>" for text in texts)


def _draw_open_hand(commands: Commands, stage: Stage, home: Array, picks: Picks) -> None:
    """Fingers as they stand apart at home; the page shows them while no motion brings its own."""
    for thing in picks.fingers.apart() if picks.fingers is not None else ():
        path = node_path(OPEN_HAND, thing.name)
        for number, surface in enumerate(surfaces_of(thing)):
            commands.set_surface(f"{path}/{number}", surface)
        commands.set_transform(path, stage.tcp_pose(home) @ matrix(thing.pose))


def _root_from_tip(values: dict[str, Any], arm: Arm, scene: Scene, picks: Picks) -> Array | None:
    """(4, 4) where a row grasps: of a good pick the grasp that was chosen, else the nominal one; None if untold."""
    if values.get("q_grasp") is not None:
        return matrix(arm.root_from_base * arm.forward_kinematics(np.array(values["q_grasp"])) * picks.tip)
    if "xyz" not in values or "rpy" not in values:
        return None
    try:
        root = root_from_frame(values.get("frame", ""), picks.frames, scene, arm)
    except InputError:  # the row says which frame there is not
        return None
    return matrix(root * pose(xyz=values["xyz"], rpy=values["rpy"]))
