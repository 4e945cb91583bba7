"""What a page needs to judge picks again at the grasp: the cell of each hand as numbers, and the grasps of picks."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from pinproof import viewer
from pinproof.errors import InputError, PinproofError
from pinproof.picks.input.pick import TIP, GraspTolerance, Pick, family
from pinproof.picks.judging.configurations import has_closed_form, sweep
from pinproof.picks.judging.setup import PickSetup
from pinproof.picks.judging.task import PickCell, PickTask, limits_torque
from pinproof.picks.judging.verdict import Stage
from pinproof.spatial import SE3, Array, matrix

STARTS = 24
"""Starts of the search of a page for a configuration at a pose, if the arm has no closed form."""


class LivePicks(NamedTuple):
    """The settings, the texts and the scripts that a page has in addition; empty if it does not compute."""

    settings: dict[str, Any]
    texts: dict[str, str] | None
    script: str

    @classmethod
    def of(
        cls, picks: Sequence[tuple[PickSetup, Pick] | None], links: Sequence[viewer.DrawnLink], wanted: bool | None
    ) -> LivePicks:
        """Describe the picks of the rows of a table, None for rows without one, in the setups of their verdicts.

        Several setups are those of several arms in one scene. ``links`` are drawn. If ``wanted`` is None, the page
        computes if that enlarges it by 1 MB at most; without the meshes of the links, if they are too large.

        Raises
        ------
        InputError
            If it is wanted but there is no setup, or the picks are on a conveyor.
        """
        nothing = cls({}, None, "")
        setups = list({id(row[0]): row[0] for row in picks if row is not None}.values())
        belt = any(setup.shared.conveyor is not None for setup in setups)
        if wanted is False or (wanted is None and (not setups or belt)):
            return nothing
        if not setups:
            raise InputError("a page can only judge proven picks again, in the setup in which they were judged")
        for setup in setups:
            setup.shared.refuse_conveyor("judging in a page")
        cells: dict[Hashable, PickCell] = {}
        families: dict[Hashable, int] = {}
        described: list[dict[str, Any]] = []
        rows: list[dict[str, Any] | None] = []
        for row in picks:
            try:
                tasks = [] if row is None else [PickTask(own, row[0].cell) for own in row[0].shared.grasps_of(row[1])]
            except InputError:
                tasks = []
            if row is None or not tasks:
                rows.append(None)
                continue
            setup, pick = row
            grasps = []
            for task in tasks:
                own, key = task.pick, (id(setup), setup.shared.hand_key(task.pick))
                cells.setdefault(key, task.cell)
                axis = own.axis_in(own.pose)
                same = own.spin.angles, own.tolerance, axis.tobytes() if len(own.spin.angles) > 1 else b""
                if same not in families:
                    families[same] = len(described)
                    described.append(_family(own, axis))
                grasps.append(
                    {
                        "hand": list(cells).index(key),
                        "pose": _rows(own.pose),
                        "family": families[same],
                        "rooted": own.approach_frame != TIP,
                    }
                )
            anchor = _ends(setup, pick.frame)
            rows.append(
                {
                    "name": pick.name,
                    "frame": pick.frame,
                    "frameAt": _rows(tasks[0].root_from(pick.frame)),
                    "anchor": anchor,
                    "onRobot": bool(anchor) and anchor not in setup.checker.scene,
                    "object": tasks[0].name if tasks[0].from_scene else None,
                    "stated": not pick.by_part,
                    "grasps": grasps,
                }
            )
        if not cells:
            return nothing
        # The cell of each hand, with the meshes of links if the page does not become too large
        drawn = tuple(link.name for link in links if link.name in setups[0].checker.arm.robot.urdf.links)
        try:
            made = [_hand(cell, drawn) for cell in cells.values()]
        except PinproofError:
            if wanted is None:
                return nothing
            raise
        shared = [setup.shared for setup in setups]
        later = list(Stage)[list(Stage).index(Stage.GRASP) + 1 :]
        unjudged = [stage.value for stage in later if stage is not Stage.CHECK or any(own.checks for own in shared)]
        if any(map(limits_torque, shared)) or any(row is not None and row[1].payload is not None for row in picks):
            unjudged.insert(0, "torque at rest")
        source = shared[0].source
        again = {
            "hands": [hand for hand, _, _ in made],
            "families": described,
            "rows": rows,
            "unjudged": unjudged,
            "file": "PICKS" if source is None else source.name,
            "arms": len(setups),
        }
        texts = {"core": made[0][1]["core"], **{f"cell{k}": own["cell"] for k, (_, own, _) in enumerate(made)}}
        exact = {f"exact{k}": finer for k, (_, _, finer) in enumerate(made) if finer}
        size = len(viewer.panels.script_json(again)) + sum(map(len, texts.values()))
        if wanted or size + sum(map(len, exact.values())) <= viewer.panels.MOST_BYTES:
            texts |= exact
        elif size > viewer.panels.MOST_BYTES:
            return nothing
        scripts = [viewer.panels.part(name) for name in viewer.panels.COMPUTING]
        return cls({"livePicks": again}, texts, "\n".join([*scripts, viewer.panels.part("live_picks.js", __package__)]))


def _ends(setup: PickSetup, frame: str) -> str:
    """The obstacle or link in whose frame a named frame is stated at last; empty for the root of the robot."""
    while frame in setup.shared.frames:
        frame = setup.shared.frames[frame].frame
    return "" if frame == setup.checker.arm.robot.urdf.root else frame


def _rows(pose: SE3) -> list[float]:
    return [float(value) for value in matrix(pose).ravel()]


def _family(pick: Pick, axis: Array) -> dict[str, Any]:
    """The rotations about the axis, and the displacements in groups; a grasp is displaced after it is rotated."""
    turned = next(family(pick.spin, GraspTolerance(), axis))
    return {
        "turns": [_rows(member.nominal_from_tip) for member in turned],
        "groups": [[_rows(shift) for _, shift in group] for group in pick.tolerance.groups()],
    }


def _hand(cell: PickCell, links: tuple[str, ...]) -> tuple[dict[str, Any], dict[str, str], str]:
    """A cell for a page: its settings, its texts, and its block with meshes as text, empty if all links are convex."""
    arm, home = cell.arm, cell.home
    web = viewer.WebCell.of(cell.checker, links, home, wide=cell.wide_arm)
    surfaces = cell.checker.with_spec(replace(cell.checker.spec, link_meshes="surface"))
    exact = viewer.WebCell.of(surfaces, links, home, wide=cell.wide_arm)
    hulls = exact.texts["cell"] != web.texts["cell"]
    # The joint values at which the closed form is evaluated, or starts of a search without one
    swept, starts = None, None
    if not has_closed_form(arm, most=7):
        starts = [
            home.tolist(),
            *np.random.default_rng(0).uniform(*arm.limits.sampling_range(), (STARTS, arm.dof)).tolist(),
        ]
    elif (grid := sweep(arm).redundant_grid(arm, home)) is not None:
        swept = {"joint": grid[0], "values": grid[1].tolist()}
    hand = {
        **web.settings,
        "home": home.tolist(),
        "tip": _rows(cell.shared.tip),
        "hand": cell.hand,
        "hulls": hulls,
        "exactOwners": exact.settings["owners"],
        "sweep": swept,
        "starts": starts,
    }
    return hand, web.texts, exact.texts["cell"] if hulls else ""
