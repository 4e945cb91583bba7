"""The page of a report: table, a 3D view with every grasp, and the captions and motions of the picks.

The page is one file that opens offline in any browser. As it states, its motions are resampled for display; the proofs
hold for the original motions, which the page does not contain. A pick is captioned FREE only if a
certificate matches exactly what is shown.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from html import escape
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from pinproof import viewer
from pinproof.collision import CheckerSpec, Obstacle, Scene, proven_millimetres
from pinproof.common import theme
from pinproof.common.files import write_text_whole
from pinproof.common.results import Html, Rows
from pinproof.errors import InputError, MeshError, ViewerError
from pinproof.model import Arm, guess_mark, guess_note
from pinproof.picks.input.picks import Picks, root_from_frame
from pinproof.picks.judging.verdict import PickVerdict
from pinproof.picks.report.live_picks import LivePicks
from pinproof.spatial import Array, matrix, pose

PROVEN = "Proven at every instant, not at samples: no checked pair comes closer than the clearance below."

MOST_ROWS = 5000
"""Largest number of rows, so that a browser scrolls and sorts the table without delay. Further rows are omitted, which
the page states."""

MOST_DETAILS = 2_000_000
"""Largest number of characters of all captions with stages, so that a page with thousands of rows opens quickly."""

COLUMNS = ("Pick", "Verdict", "Failed at", "Clearance", "Duration", "Reason and remedy")

PageRow = tuple[dict[str, Any], "PickVerdict | None"]
"""A row of plain values, and its verdict if it is known."""

CARD = """<section class="side card" id="card" aria-label="The chosen pick"{hidden}><div id="choice">
<button type="button" id="before" aria-label="Pick before">&#8249;</button>
<select id="chosen" aria-label="Choose a pick">{options}</select>
<button type="button" id="after" aria-label="Next pick">&#8250;</button></div>
<div id="caption" aria-live="polite"></div><div id="captions" hidden>{captions}</div></section>"""


def write_page(
    path: str | Path,
    result: Any,
    rows: Iterable[PageRow],
    counts: Mapping[str, int],
    *,
    arm: Arm | None = None,
    scene: Scene | None = None,
    picks: Picks | None = None,
    title: str | None = None,
    columns: Mapping[str, Sequence[object]] | None = None,
    live: bool | None = None,
) -> None:
    """Write the page of a report or of a campaign, completely or not at all.

    The arm, the scene, and the tool and home that the picks share are by default those of the setup with which the
    picks were judged. ``result`` has them as its ``setup``, and states its summary, notes and source of acceleration
    limits. ``counts`` are the numbers of rows with each verdict. The default of the title is the name of the
    robot. ``columns`` are further columns of the table, with a value for each row. ``live`` is that of
    :meth:`PickReport.save`.

    InputError if there is no setup and one of ``arm``, ``scene`` and ``picks`` is missing; ViewerError if the robot has
    nothing to draw, or meshcat's viewer is not installed; FileError if the file cannot be written.
    """
    # What is drawn
    source = result.acceleration_source
    if result.setup is not None:
        checker, shared = result.setup.checker, result.setup.shared
        arm, scene, picks = arm or checker.arm, checker.scene if scene is None else scene, picks or shared
    if arm is None or scene is None or picks is None:
        missing = [name for name, value in {"arm": arm, "scene": scene, "picks": picks}.items() if value is None]
        raise InputError(
            f"{path}: this result does not contain the {', '.join(missing)} of the 3D view; add to save(): "
            f"{', '.join(f'{name}=...' for name in missing)}"
        )
    # The film of all rows that are shown
    shown = list(islice(rows, MOST_ROWS))
    stage = viewer.simplified(viewer.set_stage(arm, scene, picks.tool))
    if not stage.links:
        raise ViewerError(f"robot {arm.robot.name!r} has nothing to draw: no link has geometry")
    settings, commands, remarks = _animated(shown, stage, arm, scene, picks)
    is_own = result.setup is not None and arm is result.setup.checker.arm and scene is result.setup.checker.scene
    # The rows of a campaign have no picks: they are those of the same names, if these are stated
    named = {pick.name: pick for pick in picks.picks}
    again = [named.get(values["name"]) if verdict is None else verdict.pick for values, verdict in shown]
    own_setup = result.setup if is_own else None
    computing = LivePicks.of(
        [None if own_setup is None or pick is None else (own_setup, pick) for pick in again], stage.links, live
    )
    settings |= computing.settings
    kinds = [values["verdict"] for values, _ in shown]
    colours = [theme.VERDICTS.get(kind, theme.COLOURS["muted"]) for kind in kinds]
    known = {pick.name: pick.object_name for pick in (*picks.picks, *filter(None, again))}
    parts = stage.nodes(known.get(values["name"]) for values, _ in shown)
    settings["picks"] = viewer.panels.linked((values["name"] for values, _ in shown), colours, parts)
    # The captions, without stages and parts once they are too long in total
    budget, captions, shortened = MOST_DETAILS, [], 0
    for values, verdict in shown:
        caption = _caption(values, verdict, arm, scene, picks, source=source)
        text = caption.html()
        budget -= len(text)
        if budget < 0 and (caption.steps or caption.lists):
            text, shortened = replace(caption, steps=(), lists=()).html(), shortened + 1
        captions.append(f"<template>{text}</template>")
    # What the page leaves out or the verdicts do not cover
    total = sum(counts.values())
    if len(shown) < total:
        remarks.append(f"This page shows the first {len(shown):,} of {total:,} rows.")
    remarks += [f"Not covered: {note}" for note in result.notes]
    remarks.append(guess_note(source) or f"Acceleration limits: {source}")
    if shortened:
        reason = "are omitted to limit the size of the page; JSON and CSV have them."
        remarks.append(f"The stages and parts of {shortened:,} rows {reason}")
    # The table
    cells = []
    columns = columns or {}
    for k, (values, _) in enumerate(shown):
        why = escape(values.get("reason", ""))
        if values.get("remedy"):
            why += f'<span class="try">Suggestion: {escape(values["remedy"])}</span>'
        figures = (_proven_text(values), seconds_text(values.get("duration")))
        own = ("" if texts[k] is None else str(texts[k]) for texts in columns.values())
        cells.append((values["name"], values["verdict"], values.get("failed_at") or "", *figures, Html(why), *own))
    options = "".join(
        f'<option value="{k}">{escape(values["name"])} ({escape(kind)})</option>'
        for k, ((values, _), kind) in enumerate(zip(shown, kinds, strict=True))
    )
    # The page
    card = CARD.format(hidden="" if shown else " hidden", options=options, captions="".join(captions))
    text = viewer.panels.page(
        title or f"Picks of {arm.robot.name}",
        "picks",
        card
        + viewer.panels.table(
            "below",
            Rows((*COLUMNS, *columns), cells, numbers=("Clearance", "Duration"), colours=colours),
            [*remarks, *stage.notes],
        ),
        settings,
        commands,
        label="The robot in its scene, with an arrow at every grasp in the colour of its verdict",
        summary=escape(result.summary),
        head=viewer.panels.chips({name: counts.get(name, 0) for name in (*theme.VERDICTS, *counts)}, theme.VERDICTS),
        script=viewer.panels.part("page.js", __package__) + computing.script,
        texts=computing.texts,
    )
    write_text_whole(path, text)


def _caption(
    row: dict[str, Any], verdict: PickVerdict | None, arm: Arm, scene: Scene, picks: Picks, *, source: str
) -> viewer.panels.Caption:
    """The caption of a row; ``source`` is that of the acceleration limits."""
    # The headline: FREE only if a certificate matches exactly what is shown
    tone, reason = row["verdict"], row.get("reason", "")
    headline = tone.upper() + (f" at {row['failed_at']}" if row.get("failed_at") else "")
    if tone == "good" and verdict is None:
        reason = "Judged good, with its motion proven. The rows of a campaign keep no motions, so none is played."
    elif tone == "good" and verdict is not None and _proven(verdict, arm, scene, picks):
        headline, tone, reason = "FREE", "free", PROVEN
    elif tone == "good":
        headline, tone = "NOT VALIDATED", "open"
        reason = "The certificate belongs to another motion, arm, scene or tool than those of this page."
    # The figures, and the stages after the parts of the motion
    duration = row.get("duration")
    figures = {
        "Proven clearance": _proven_text(row),
        "Duration": seconds_text(duration) + ("" if duration is None else guess_mark(source)),
        "Grasp at": seconds_text(row.get("grasp_time")),
        "Release at": seconds_text(row.get("release_time")),
        "Grasp": ", ".join(f"{value:.3f}" for value in row["xyz"]) + " m" if "xyz" in row else "",
        "In the frame": row.get("frame", ""),
        "Grasp of the part": row.get("grasp") or "",
        "Tool": row.get("tool") or "",
        "Member": row.get("member", ""),
    }
    steps = [
        (viewer.panels.TICK if stage["ok"] else viewer.panels.CROSS, stage["stage"], stage["message"])
        for stage in row.get("stages", ())
    ]
    if len(motions := row.get("motions", ())) > 1:
        parts = [
            ("\u25b8", motion["name"], seconds_text(motion["duration"]), _proven_text(motion)) for motion in motions
        ]
        steps = [(mark, name, f"{seconds}, {clearance}") for mark, name, seconds, clearance in parts] + steps
    lists = {"refuted configurations": row.get("refuted"), "other grasps that failed": row.get("grasps_failed")}
    shown = [(f"{len(texts)} {name}", tuple(texts)) for name, texts in lists.items() if texts]
    if (pairs := row.get("pairs_proven")) is not None:
        what = f"{pairs:,} pairs of bodies: the robot, its tool and parts with each other and with every obstacle."
        shown.insert(0, ("What is proven not to collide", (what,)))
    return viewer.panels.Caption(
        headline,
        reason,
        tone if tone in theme.TONES else "still",
        tuple((name, text) for name, text in figures.items() if text),
        tuple(shown),
        row.get("remedy", ""),
        tuple(steps),
    )


def seconds_text(value: float | None) -> str:
    """A duration (s) as text; empty if there is none."""
    return "" if value is None else f"{value:.2f} s"


def _proven_text(row: dict[str, Any]) -> str:
    """The proven clearance of a row or of one of its motions as text; empty without a proof."""
    clearance = row.get("clearance_proven")
    if clearance is not None:
        return proven_millimetres(clearance)
    return "" if row.get("pairs_proven") is None else "unbounded"


def _proven(verdict: PickVerdict, arm: Arm, scene: Scene, picks: Picks) -> bool:
    """Whether the motion starts with this arm, tool and scene, and each of its parts has a matching FREE certificate.

    The scenes of the parts may differ only by the carried objects.
    """

    def without(scene: Scene, names: set[str]) -> str:
        """The hash of the arm and the scene without the named obstacles."""
        return CheckerSpec(arm, scene.remove(*names.intersection(scene))).setup_hash()

    motions = verdict.motions
    if not verdict.ok or not motions:
        return False
    hand = picks.for_pick(verdict.pick)
    first, own, holding = motions[0], {thing.name for thing in hand.open_tool}, arm.with_held(hand.held)
    if not first.certificate.matches(first.trajectory, holding, scene, hand.open_tool, movers=first.movers):
        return False
    carried = {thing.name for motion in motions for thing in motion.attached} - own
    around = without(scene, carried)
    return all(
        motion.certificate.free
        and motion.certificate.matches(
            motion.trajectory, arm.with_held(motion.held), motion.scene, motion.attached, movers=motion.movers
        )
        and without(motion.scene, carried) == around
        for motion in motions
    )


FRAMED = 1.3
"""Grasps within this multiple of the extent of the robot are framed; a distant one would make all others too small."""

GROUPS, A_GROUP = 6, 30
"""Number of groups of adjacent grasps whose visibility counts like that of a link, and of grasps drawn per group."""


RATE, MIN_RATE = 30.0, 5.0
"""Largest and smallest number of key frames per second; fewer are used if the motions would exceed the size limit."""

MOST_BYTES = 5e6
"""Largest size of all motions together, as text."""

BYTES_A_POSE = 28 * 4 / 3
"""Size of a pose: seven numbers of four bytes in base64."""

BYTES_A_LINK = 450
"""Size of the data of a link in a motion, without its poses."""

SHOWN_POSES = 40
"""Number of moments of all motions together that the camera frames."""


SHOWN_POINTS = 4000
"""Number of points of all paths together that the camera frames."""


@dataclass(frozen=True, eq=False)
class PageMotions:
    """The motions of a page: one film per verdict, None without a motion, and the carried bodies of each film by name.

    A carried body that is an obstacle of the scene is animated in place, not drawn twice. ``notes`` state what was
    changed for display, in sentences.
    """

    stage: viewer.Drawing
    scene: Scene
    films: tuple[viewer.Film | None, ...]
    bodies: tuple[dict[str, Obstacle], ...]
    notes: tuple[str, ...]

    @classmethod
    def of(
        cls, stage: viewer.Drawing, scene: Scene, tool: Sequence[Obstacle], verdicts: Sequence[PickVerdict | None]
    ) -> PageMotions:
        """The motions of verdicts; ``tool`` are the bodies that the stage always draws attached to the tcp."""
        always = {thing.name for thing in tool}
        parts = [
            [
                viewer.FilmPhase(
                    part.trajectory, tuple(t for t in part.attached if t.name not in always), movers=part.movers
                )
                for part in (() if verdict is None else verdict.motions)
            ]
            for verdict in verdicts
        ]
        # As many poses a second as fit into the page, and the motions that fit at all
        seconds = [sum(phase.trajectory.duration for phase in phases) for phases in parts]
        budget = MOST_BYTES / max(len(stage.links), 1)
        overhead = BYTES_A_LINK * np.array([bool(phases) for phases in parts])
        fits = np.cumsum(np.array(seconds) * MIN_RATE * BYTES_A_POSE + overhead) <= budget
        spare = budget - overhead[fits].sum()  # bytes left for poses
        rate = min(RATE, spare / (BYTES_A_POSE * max(float(np.array(seconds)[fits].sum()), 1e-9)))
        films = tuple(
            viewer.film(stage, phases, rate=rate) if phases and fit else None
            for phases, fit in zip(parts, fits, strict=True)
        )
        bodies = tuple({thing.name: thing for phase in phases for thing in phase.attached} for phases in parts)
        notes = []
        if any(films):
            notes.append(
                f"Motions are resampled for display at {rate:.0f} poses per second; proofs cover the original motions."
            )
        if left := sum(bool(phases) and not fit for phases, fit in zip(parts, fits, strict=True)):
            notes.append(f"The motions of {left} more good picks are omitted to limit the size of this page.")
        return cls(stage, scene, films, bodies, tuple(notes))

    def camera(self, rest: viewer.Film, grasps: Array) -> viewer.View:
        """The view that frames the robot at rest and during the motions, and the grasps (G, 4, 4).

        The tool, the carried parts and the obstacles near them are in the picture.
        """
        # Poses of the links at some moments, points on the paths of tcp and carried bodies, points around these
        stage, films = self.stage, [each for each in self.films if each is not None]
        chosen = films[:: max(1, len(films) * 2 // SHOWN_POSES)]
        poses = np.concatenate([rest.poses, *(each.poses[[len(each.times) // 2, -1]] for each in chosen)])
        carried = [path[:, :3, 3] for each in films for path in each.riders.values()]
        paths = np.concatenate([np.empty((0, 3)), *(each.tcps[:, 0] for each in films), *carried])
        paths = paths[:: -(-len(paths) // SHOWN_POINTS) or 1]
        tool = [viewer.tool_points(stage, rest.poses)]
        for shown, bodies in zip(self.films, self.bodies, strict=True):
            if shown is not None:
                points = [viewer.tool_points(stage, shown.poses)]
                for name, path in shown.riders.items():
                    if surfaces := surfaces_of(bodies[name]):
                        points.append(viewer.placed_points(viewer.box_corners(surfaces), path))
                tool.append(viewer.extremes(np.concatenate(points)))
        # Grasps within an upper bound of the distance of any point of the robot from its root
        parts = [[float(np.linalg.norm(part.vertices, axis=1).max()) for part in link.surfaces] for link in stage.links]
        extent = float((np.linalg.norm(poses[:, :, :3, 3], axis=2) + [max(sizes) for sizes in parts]).max())
        near = grasps[np.linalg.norm(grasps[:, :3, 3], axis=1) <= FRAMED * extent]
        # Arrows at grasps adjacent in angle about the root are bodies whose visibility counts like that of links
        groups = []
        order = np.argsort(np.arctan2(near[:, 1, 3], near[:, 0, 3]), kind="stable")
        for number, group in enumerate(group for group in np.array_split(near[order], GROUPS) if len(group)):
            few = group[:: -(-len(group) // A_GROUP)]
            surfaces = viewer.merge_by_colour([viewer.arrow(viewer.LONGEST).moved(grasp) for grasp in few])
            groups.append(viewer.DrawnLink(f"grasps {number}", tuple(surfaces)))
        at_rest = np.broadcast_to(np.eye(4), (len(poses), len(groups), 4, 4))
        seen = replace(stage, links=(*stage.links, *groups))
        tails = near[:, :3, 3] - viewer.LONGEST * near[:, :3, 2]
        framed = np.concatenate([rest.tcps[:, 0], paths, near[:, :3, 3], tails])
        return viewer.choose_view(seen, np.concatenate([poses, at_rest], axis=1), framed, tool=np.concatenate(tool))

    def add_to(self, commands: viewer.Commands) -> list[dict[str, Any] | None]:
        """The tracks of each motion. Carried bodies are drawn, but hidden until their pick is selected."""
        drawn: dict[tuple[str, bytes], str] = {}
        motions: list[dict[str, Any] | None] = []
        for shown, bodies in zip(self.films, self.bodies, strict=True):
            if shown is None:
                motions.append(None)
                continue
            places = {name: self._place(thing, commands, drawn) for name, thing in bodies.items()}
            motions.append(
                {
                    "duration": float(shown.times[-1]),
                    "tracks": viewer.tracks(commands, self.stage, shown, places),
                    "path": commands.array(shown.tcps[:, 0].astype(np.float32).ravel()),
                    "riders": {
                        **{places[name]: poses[0].T.ravel().tolist() for name, poses in shown.riders.items()},
                        **{
                            viewer.node_path("scene", name): poses[0].T.ravel().tolist()
                            for name, poses in shown.moved.items()
                        },
                    },
                }
            )
        return motions

    def at_rest(self, rest: viewer.Film) -> list[dict[str, Any]]:
        """Commands that restore the pose of everything that a motion has moved."""
        names = {name for bodies in self.bodies for name in bodies}
        names |= {name for shown in self.films if shown is not None for name in shown.moved}
        back = [
            viewer.transform_command(viewer.node_path("robot", link.name), at)
            for link, at in zip(self.stage.links, rest.poses[0], strict=True)
        ]
        things = (thing for thing in self.stage.obstacles if thing.name in names)
        return back + [viewer.transform_command(viewer.node_path("scene", thing.name), thing.pose) for thing in things]

    def _place(self, thing: Obstacle, commands: viewer.Commands, drawn: dict[tuple[str, bytes], str]) -> str:
        """The node of a carried body; identical bodies of several picks are drawn once."""
        if thing.name in self.scene:
            return viewer.node_path("scene", thing.name)
        surfaces = surfaces_of(thing)
        key = (thing.name, b"".join(surface.vertices.tobytes() for surface in surfaces))
        if key not in drawn:
            drawn[key] = path = viewer.node_path("riders", str(len(drawn)), thing.name)
            for number, surface in enumerate(surfaces):
                commands.set_surface(f"{path}/{number}", surface)
            commands.set_property(path, "visible", False)
        return drawn[key]


def surfaces_of(thing: Obstacle) -> list[viewer.Surface]:
    """The surfaces of a body for display; empty if its mesh cannot be read."""
    try:
        return viewer.obstacle_surfaces(thing)
    except MeshError:  # a missing mesh must not prevent the page
        return []


OPEN_HAND = "open hand"
"""The node of the fingers at home; the script of the page refers to this name."""


def _animated(
    rows: Sequence[PageRow], stage: viewer.Drawing, arm: Arm, scene: Scene, picks: Picks
) -> tuple[dict[str, Any], viewer.Commands, list[str]]:
    """The settings and commands of the film of all rows, and notes on what was changed for display."""
    verdicts = [verdict for _, verdict in rows]
    home = next(
        (v.trajectory.start for v in verdicts if v is not None and v.trajectory is not None),
        np.array(picks.home_configuration(arm.joint_names, arm.home)),
    )
    motions, rest = PageMotions.of(stage, scene, picks.tool, verdicts), viewer.still(stage, home)
    # The chosen grasp of a good pick, otherwise the nominal grasp of the row; a row may have no pose
    placed: list[Array | None] = []
    for values, _ in rows:
        root_from_tip = None
        if values.get("q_grasp") is not None:
            tip = picks.with_tool(values.get("tool")).tip
            root_from_tip = arm.root_from_base * arm.forward_kinematics(np.array(values["q_grasp"])) * tip
        elif "xyz" in values and "rpy" in values:
            with suppress(InputError):  # the reason in the row names the unknown frame
                root = root_from_frame(values.get("frame", ""), picks.frames, scene, arm)
                root_from_tip = root * pose(xyz=values["xyz"], rpy=values["rpy"])
        placed.append(None if root_from_tip is None else matrix(root_from_tip))
    grasps = np.array([grasp for grasp in placed if grasp is not None]).reshape(-1, 4, 4)
    view = motions.camera(rest, grasps)
    commands = viewer.stage_commands(stage, rest, view)
    # The open fingers at home, which the page shows unless a motion with its own fingers is played
    for thing in picks.fingers.apart() if picks.fingers is not None else ():
        path = viewer.node_path(OPEN_HAND, thing.name)
        for number, surface in enumerate(surfaces_of(thing)):
            commands.set_surface(f"{path}/{number}", surface)
        commands.set_transform(path, stage.tcp_poses(home)[0] @ matrix(thing.pose))
    # An arrow at every grasp
    marked = [k for k, grasp in enumerate(placed) if grasp is not None]
    index_of = {name: index for index, name in enumerate(theme.VERDICTS)}
    colour_of = np.array([index_of.get(rows[k][0]["verdict"], -1) for k in marked], dtype=np.int64)
    markers = viewer.PoseMarkers(grasps, colour_of, tuple(map(theme.rgb, theme.VERDICTS.values())))
    settings = {
        **view.settings(),
        "tools": stage.tools,
        "marked": marked,
        "markers": markers.settings(commands),
        "motions": motions.add_to(commands),
        "rest": motions.at_rest(rest),
    }
    return settings, commands, list(motions.notes)
