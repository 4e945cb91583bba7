"""The HTML page of a report: summary, table, a 3D view with every grasp, and the motions of the good picks.

The page is one file that opens offline in any browser. As it states, its motions are resampled for display; the proofs
hold for the original motions, which the page does not contain. A pick is captioned FREE only if a
certificate matches exactly what is shown.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from pinproof.collision import Obstacle, Scene
from pinproof.collision.certificates.certificate import proven_millimetres
from pinproof.collision.checking.spec import CheckerSpec
from pinproof.common import theme
from pinproof.common.files import write_text_whole
from pinproof.errors import InputError, MeshError, ViewerError
from pinproof.model import Arm, guess_mark, guess_note
from pinproof.picks.input.pick import Picks, root_from_frame
from pinproof.picks.judging.setup import PickSetup
from pinproof.picks.judging.verdict import PickVerdict
from pinproof.spatial import Array, matrix, pose
from pinproof.viewer.animation import Film, Phase, film, still, tracks
from pinproof.viewer.camera import View, choose_view, extremes, placed_points, tool_points
from pinproof.viewer.overlays import LONGEST, PoseMarkers, arrow
from pinproof.viewer.page import assemble, fill, part
from pinproof.viewer.picture import stage_commands
from pinproof.viewer.stage import DrawnLink, Stage, box_corners, set_stage, simplified
from pinproof.viewer.surfaces import Surface, merge_by_colour, obstacle_surfaces
from pinproof.viewer.wire import Commands, node_path, transform_command

DETAILS = ("stages", "motions", "refuted")

MOST_DETAILS = 2_000_000
"""Largest total number of characters of the details of entries, so that a page with thousands of rows opens quickly."""

PROVEN = "Proven at every instant, not at samples: no checked pair comes closer than the clearance below."


def entry(
    row: dict[str, Any], verdict: PickVerdict | None, arm: Arm, scene: Scene, picks: Picks, *, source: str = ""
) -> dict[str, Any]:
    """The entry of a row for the table and the caption of the page; ``source`` of acceleration limits."""
    kind = row["verdict"]
    headline, tone, text = kind.upper(), kind.replace(" ", "-"), row.get("reason", "")
    if kind == "good" and verdict is None:
        text = "Judged good, with its motion proven. The rows of a campaign keep no motions, so none is played."
    elif kind == "good" and verdict is not None:
        if _proven(verdict, arm, scene, picks):
            headline, tone, text = "FREE", "free", PROVEN
        else:
            headline, tone = "NOT VALIDATED", "open"
            text = "The certificate belongs to another motion, arm, scene or tool than those of this page."
    clearance, duration = row.get("clearance_proven"), row.get("duration")
    proven = _proven_text(row)
    figures = {
        "Proven clearance": proven,
        "Duration": _seconds(duration) + ("" if duration is None else guess_mark(source)),
        "Grasp at": _seconds(row.get("grasp_time")),
        "Release at": _seconds(row.get("release_time")),
        "Grasp": ", ".join(f"{value:.3f}" for value in row["xyz"]) + " m" if "xyz" in row else "",
        "In the frame": row.get("frame", ""),
        "Member": row.get("member", ""),
    }
    return {
        "name": row["name"],
        "verdict": kind,
        "failed": row.get("failed_at") or "",
        "clearance": clearance,
        "clearanceText": proven,
        "duration": duration,
        "reason": row.get("reason", ""),
        "remedy": row.get("remedy", ""),
        "headline": headline,
        "tone": tone,
        "said": text,
        "figures": [[name, text] for name, text in figures.items() if text],
        "stages": [[stage["stage"], stage["ok"], stage["message"]] for stage in row.get("stages", ())],
        "motions": [[each["name"], _seconds(each["duration"]), _proven_text(each)] for each in row.get("motions", ())],
        "refuted": list(row.get("refuted", ())),
    }


def without_more_details(entries: Iterable[dict[str, Any]]) -> tuple[list[dict[str, Any]], int]:
    """The entries, without details once :data:`MOST_DETAILS` is exceeded, and the number of entries without details."""
    kept, budget, shortened = [], MOST_DETAILS, 0
    for each in entries:
        budget -= len(json.dumps([each[name] for name in DETAILS]))
        if budget < 0:
            each, shortened = {**each, **dict.fromkeys(DETAILS, ())}, shortened + 1
        kept.append(each)
    return kept, shortened


def _seconds(value: float | None) -> str:
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
    motions = verdict.motions
    if not verdict.ok or not motions:
        return False
    first, own = motions[0], {thing.name for thing in picks.open_tool}
    if not first.certificate.matches(first.trajectory, arm, scene, picks.open_tool, movers=first.movers):
        return False
    carried = {thing.name for motion in motions for thing in motion.attached} - own
    around = _without(scene, carried, arm)
    return all(
        each.certificate.free
        and each.certificate.matches(
            each.trajectory, arm.with_held(each.held), each.scene, each.attached, movers=each.movers
        )
        and _without(each.scene, carried, arm) == around
        for each in motions
    )


def _without(scene: Scene, names: set[str], arm: Arm) -> str:
    """The hash of the arm and the scene without the named obstacles."""
    return CheckerSpec(arm, scene.remove(*names.intersection(scene))).setup_hash()


FRAMED = 1.3
"""Grasps within this multiple of the extent of the robot are framed; a distant one would make all others too small."""

GROUPS, A_GROUP = 6, 30
"""Number of groups of adjacent grasps whose visibility counts like that of a link, and of grasps drawn per group."""


def frame_picks(stage: Stage, poses: Array, tcp: Array, grasps: Array, tool: Array) -> View:
    """The view of a stage with links at poses (F, L, 4, 4), points of tcp paths (N, 3), and grasps (G, 4, 4).

    ``tool`` (M, 3) are points of the tool and of carried parts; they and the obstacles near them are in the picture.
    """
    near = grasps[np.linalg.norm(grasps[:, :3, 3], axis=1) <= FRAMED * _extent(stage, poses)]
    tails = near[:, :3, 3] - LONGEST * near[:, :3, 2]
    groups = _groups(near)
    at_rest = np.broadcast_to(np.eye(4), (len(poses), len(groups), 4, 4))
    seen = replace(stage, links=(*stage.links, *groups))
    points = np.concatenate([tcp, near[:, :3, 3], tails])
    return choose_view(seen, np.concatenate([poses, at_rest], axis=1), points, tool=tool)


def _extent(stage: Stage, poses: Array) -> float:
    """Metres: upper bound of the distance of any point of the robot from its root."""
    sizes = [max(float(np.linalg.norm(each.vertices, axis=1).max()) for each in link.surfaces) for link in stage.links]
    return float((np.linalg.norm(poses[:, :, :3, 3], axis=2) + sizes).max())


def _groups(grasps: Array) -> list[DrawnLink]:
    """Arrows at grasps, as bodies whose visibility counts like that of links in the choice of the view."""
    order = np.argsort(np.arctan2(grasps[:, 1, 3], grasps[:, 0, 3]), kind="stable")  # adjacent in angle about the root
    parts = [group for group in np.array_split(grasps[order], GROUPS) if len(group)]
    bodies = []
    for number, group in enumerate(parts):
        few = group[:: -(-len(group) // A_GROUP)]
        surfaces = merge_by_colour([arrow(LONGEST).moved(each) for each in few])
        bodies.append(DrawnLink(f"grasps {number}", tuple(surfaces)))
    return bodies


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

    stage: Stage
    scene: Scene
    films: tuple[Film | None, ...]
    bodies: tuple[dict[str, Obstacle], ...]
    notes: tuple[str, ...]

    @classmethod
    def of(
        cls, stage: Stage, scene: Scene, tool: Sequence[Obstacle], verdicts: Sequence[PickVerdict | None]
    ) -> PageMotions:
        """The motions of verdicts; ``tool`` are the bodies that the stage always draws attached to the tcp."""
        always = {thing.name for thing in tool}
        parts = [_phases(verdict, always) for verdict in verdicts]
        seconds = [sum(phase.trajectory.duration for phase in phases) for phases in parts]
        budget = MOST_BYTES / max(len(stage.links), 1)
        overhead = BYTES_A_LINK * np.array([bool(phases) for phases in parts])
        fits = np.cumsum(np.array(seconds) * MIN_RATE * BYTES_A_POSE + overhead) <= budget
        spare = budget - overhead[fits].sum()  # bytes left for poses
        rate = min(RATE, spare / (BYTES_A_POSE * max(float(np.array(seconds)[fits].sum()), 1e-9)))
        films = tuple(
            film(stage, phases, rate=rate) if phases and fit else None for phases, fit in zip(parts, fits, strict=True)
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

    @property
    def _shown(self) -> list[Film]:
        return [each for each in self.films if each is not None]

    @property
    def shown_poses(self) -> Array:
        """(M, L, 4, 4) poses of the links at some moments of the motions, for the camera."""
        films, none = self._shown, np.empty((0, len(self.stage.links), 4, 4))
        chosen = films[:: max(1, len(films) * 2 // SHOWN_POSES)]
        return np.concatenate([none, *(each.poses[[len(each.times) // 2, -1]] for each in chosen)])

    @property
    def shown_points(self) -> Array:
        """(N, 3) points on the paths of the tcp and of carried bodies, for the camera."""
        carried = [poses[:, :3, 3] for each in self._shown for poses in each.riders.values()]
        points = np.concatenate([np.empty((0, 3)), *(each.tcps[:, 0] for each in self._shown), *carried])
        return points[:: -(-len(points) // SHOWN_POINTS) or 1]

    @property
    def tool(self) -> Array:
        """(N, 3) points around the tool and the carried bodies at all moments of the motions, for the camera."""
        found = [np.empty((0, 3))]
        for shown, bodies in zip(self.films, self.bodies, strict=True):
            if shown is None:
                continue
            points = [tool_points(self.stage, shown.poses)]
            for name, poses in shown.riders.items():
                if surfaces := surfaces_of(bodies[name]):
                    points.append(placed_points(box_corners(surfaces), poses))
            found.append(extremes(np.concatenate(points)))
        return np.concatenate(found)

    def add_to(self, commands: Commands) -> list[dict[str, Any] | None]:
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
                    "tracks": tracks(commands, self.stage, shown, places),
                    "path": commands.array(shown.tcps[:, 0].astype(np.float32).ravel()),
                    "riders": {
                        **{places[name]: _column(poses[0]) for name, poses in shown.riders.items()},
                        **{node_path("scene", name): _column(poses[0]) for name, poses in shown.moved.items()},
                    },
                }
            )
        return motions

    def at_rest(self, rest: Film) -> list[dict[str, Any]]:
        """Commands that restore the pose of everything that a motion has moved."""
        names = {name for bodies in self.bodies for name in bodies}
        names |= {name for shown in self._shown for name in shown.moved}
        back = [
            transform_command(node_path("robot", link.name), at)
            for link, at in zip(self.stage.links, rest.poses[0], strict=True)
        ]
        things = (thing for thing in self.stage.obstacles if thing.name in names)
        return back + [transform_command(node_path("scene", thing.name), thing.pose) for thing in things]

    def _place(self, thing: Obstacle, commands: Commands, drawn: dict[tuple[str, bytes], str]) -> str:
        """The node of a carried body; identical bodies of several picks are drawn once."""
        if thing.name in self.scene:
            return node_path("scene", thing.name)
        surfaces = surfaces_of(thing)
        key = (thing.name, b"".join(surface.vertices.tobytes() for surface in surfaces))
        if key not in drawn:
            drawn[key] = path = node_path("riders", str(len(drawn)))
            for number, surface in enumerate(surfaces):
                commands.set_surface(f"{path}/{number}", surface)
            commands.set_property(path, "visible", False)
        return drawn[key]


def _phases(verdict: PickVerdict | None, always: set[str]) -> list[Phase]:
    if verdict is None:
        return []
    return [
        Phase(each.trajectory, tuple(t for t in each.attached if t.name not in always), movers=each.movers)
        for each in verdict.motions
    ]


def surfaces_of(thing: Obstacle) -> list[Surface]:
    """The surfaces of a body for display; empty if its mesh cannot be read."""
    try:
        return obstacle_surfaces(thing)
    except MeshError:  # a missing mesh must not prevent the page
        return []


def _column(a_from_b: Array) -> list[float]:
    return [float(value) for value in a_from_b.T.ravel()]


OPEN_HAND = "open hand"
"""The node of the fingers at home; the script of the page refers to this name."""

MOST_ROWS = 5000
"""Largest number of rows, so that a browser scrolls and sorts the table without delay. Further rows are omitted, which
the page states."""


@dataclass(frozen=True)
class PageRow:
    """A row of plain values, and its verdict if it is known."""

    values: dict[str, Any]
    verdict: PickVerdict | None = None


@dataclass(frozen=True)
class PageContent:
    """What a page shows: the rows in order, their total number, and the number with each verdict.

    ``summary`` is one line on all rows, ``notes`` state what the verdicts do not cover, and ``acceleration_source`` is
    the origin of the acceleration limits of the timing.
    """

    rows: Iterable[PageRow]
    total: int
    verdicts: Mapping[str, int]
    summary: str
    notes: tuple[str, ...]
    acceleration_source: str


def write_page(
    path: str | Path,
    content: PageContent,
    setup: PickSetup | None,
    *,
    arm: Arm | None = None,
    scene: Scene | None = None,
    picks: Picks | None = None,
    title: str | None = None,
) -> None:
    """Write the page of a report or of a campaign, completely or not at all.

    The arm, the scene, and the tool and home that the picks share are by default those of ``setup``, with which the
    picks were judged. The default of the title is the name of the robot.

    Raises
    ------
    InputError
        If ``setup`` is not given and one of ``arm``, ``scene`` and ``picks`` is missing.
    ViewerError
        If the robot has nothing to draw, or meshcat's viewer is not installed.
    FileError
        If the file cannot be written.
    """
    if setup is not None:
        checker = setup.checker
        arm, scene, picks = arm or checker.arm, checker.scene if scene is None else scene, picks or setup.shared
    if arm is None or scene is None or picks is None:
        missing = [name for name, value in {"arm": arm, "scene": scene, "picks": picks}.items() if value is None]
        raise InputError(
            f"{path}: this result does not contain the {', '.join(missing)} of the 3D view; add to save(): "
            f"{', '.join(f'{name}=...' for name in missing)}"
        )
    shown = list(islice(content.rows, MOST_ROWS))
    notes = [f"Not covered: {note}" for note in content.notes]
    notes.append(guess_note(content.acceleration_source) or f"Acceleration limits: {content.acceleration_source}")
    if len(shown) < content.total:
        notes.insert(0, f"This page shows the first {len(shown):,} of {content.total:,} rows.")
    words = {"title": title or f"Picks of {arm.robot.name}", "summary": content.summary}
    write_text_whole(
        path, _render(shown, content.verdicts, arm, scene, picks, words, notes, source=content.acceleration_source)
    )


def _render(
    rows: list[PageRow],
    kinds: Mapping[str, int],
    arm: Arm,
    scene: Scene,
    picks: Picks,
    words: dict[str, str],
    notes: list[str],
    *,
    source: str,
) -> str:
    stage = simplified(set_stage(arm, scene, picks.tool))
    if not stage.links:
        raise ViewerError(f"robot {arm.robot.name!r} has nothing to draw: no link has geometry")
    verdicts = [row.verdict for row in rows]
    home = next(
        (v.trajectory.start for v in verdicts if v is not None and v.trajectory is not None),
        np.array(picks.home_configuration(arm.joint_names, arm.home)),
    )
    motions = PageMotions.of(stage, scene, picks.tool, verdicts)
    rest = still(stage, home)
    placed = [_root_from_tip(row.values, arm, scene, picks) for row in rows]
    grasps = np.array([at for at in placed if at is not None]).reshape(-1, 4, 4)
    poses = np.concatenate([rest.poses, motions.shown_poses])
    tool = np.concatenate([tool_points(stage, rest.poses), motions.tool])
    view = frame_picks(stage, poses, np.concatenate([rest.tcps[:, 0], motions.shown_points]), grasps, tool)
    commands = stage_commands(stage, rest, view)
    _draw_open_hand(commands, stage, home, picks)
    marked = [k for k, at in enumerate(placed) if at is not None]
    index_of = {name: index for index, name in enumerate(theme.VERDICTS)}
    colour_of = np.array([index_of.get(rows[k].values["verdict"], -1) for k in marked], dtype=np.int64)
    markers = PoseMarkers(grasps, colour_of, tuple(map(theme.rgb, theme.VERDICTS.values())))
    details = (entry(row.values, row.verdict, arm, scene, picks, source=source) for row in rows)
    entries, shortened = without_more_details(details)
    if shortened:
        reason = "are omitted to limit the size of the page; JSON and CSV have them."
        notes = [*notes, f"The stages and parts of {shortened:,} rows {reason}"]
    settings = {
        **view.settings(),
        "entries": entries,
        "kinds": theme.VERDICTS,
        "marked": marked,
        "markers": markers.settings(commands),
        "motions": motions.add_to(commands),
        "rest": motions.at_rest(rest),
    }
    body = fill(
        part("page.html", __package__),
        {
            "title": escape(words["title"]),
            "summary": escape(words["summary"]),
            "chips": _chips(kinds),
            "notes": _items([*motions.notes, *notes, *stage.notes]),
        },
    )
    style = part("common.css") + part("page.css", __package__)
    for name, colour in theme.VERDICTS.items():
        style += f"#card .verdict.{name.replace(' ', '-')} {{ background: {colour}; }}\n"
    return assemble(words["title"], style, body, part("page.js", __package__), settings, commands)


def _chips(kinds: Mapping[str, int]) -> str:
    """A button for each verdict that occurs, with its colour and number of rows; it filters the table."""
    known = [name for name in dict.fromkeys((*theme.VERDICTS, *kinds)) if kinds.get(name)]
    return "".join(
        f'<button type="button" class="chip" data-verdict="{escape(name)}" aria-pressed="false">'
        f'<span class="swatch" style="background:{theme.VERDICTS.get(name, theme.COLOURS["muted"])}"></span>'
        f"{kinds[name]:,} {escape(name)}</button>"
        for name in known
    )


def _items(texts: Iterable[str]) -> str:
    return "".join(f"<li>{escape(text)}</li>" for text in texts)


def _draw_open_hand(commands: Commands, stage: Stage, home: Array, picks: Picks) -> None:
    """Draw the open fingers at home; the page shows them unless a motion with its own fingers is played."""
    for thing in picks.fingers.apart() if picks.fingers is not None else ():
        path = node_path(OPEN_HAND, thing.name)
        for number, surface in enumerate(surfaces_of(thing)):
            commands.set_surface(f"{path}/{number}", surface)
        commands.set_transform(path, stage.tcp_poses(home)[0] @ matrix(thing.pose))


def _root_from_tip(values: dict[str, Any], arm: Arm, scene: Scene, picks: Picks) -> Array | None:
    """(4, 4) the chosen grasp of a good pick, otherwise the nominal grasp of the row; None if the row has no pose."""
    if values.get("q_grasp") is not None:
        return matrix(arm.root_from_base * arm.forward_kinematics(np.array(values["q_grasp"])) * picks.tip)
    if "xyz" not in values or "rpy" not in values:
        return None
    try:
        root = root_from_frame(values.get("frame", ""), picks.frames, scene, arm)
    except InputError:  # the reason in the row names the unknown frame
        return None
    return matrix(root * pose(xyz=values["xyz"], rpy=values["rpy"]))
