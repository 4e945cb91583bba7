"""The kit of all pages: header, film, caption, table, charts and notes, assembled to one file.

A page needs no network connection: it contains the viewer of meshcat, commands, scripts, styles and texts. The film is
at the left; panels of the class ``side`` are at its right, those of the class ``below`` are below it.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from pinproof.common import theme
from pinproof.common.files import write_text_whole
from pinproof.common.results import Rows, html_list
from pinproof.common.structs import described, key
from pinproof.errors import FileError, ViewerError
from pinproof.viewer.wire import Commands
from pinproof.viewer.wire import script_json as script_json

# The page runs only the scripts that it contains; the browser blocks every network request.
POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'{compute}; style-src 'unsafe-inline'; "
    "img-src data: blob:; worker-src blob:; connect-src {connect}; base-uri 'none'; form-action 'none'"
)


@described()
class Caption:
    """The verdict on a motion, a configuration or a pick, the reason for it, and figures."""

    headline: str = key("such as FREE, NOT VALIDATED or IMPOSSIBLE at grasp")
    reason: str = key("one sentence that states what is proven, or why nothing is proven")
    tone: str = key("the name of the colour of the headline in theme.TONES")
    figures: tuple[tuple[str, str], ...] = key("(name, value) pairs")
    lists: tuple[tuple[str, Sequence[str]], ...] = key(
        "(summary, items) pairs that can be unfolded, such as the body pairs that a proof does not cover", default=()
    )
    remedy: str = key("what to do; empty for nothing", default="")
    steps: tuple[Sequence[str], ...] = key(
        "the stages of the judgement or the parts of the motion, each as some short texts", default=()
    )

    def html(self, remarks: Sequence[str] = ()) -> str:
        """The caption as HTML with escaped texts; ``remarks`` are about the picture."""
        pairs = "".join(
            f"<div{' class=wide' if len(value) > WIDE else ''}><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>"
            for name, value in self.figures
        )
        colour, steps = theme.TONES[self.tone], ""
        for step in self.steps:
            cells = "".join(f"<td>{escape(text)}</td>" for text in step)
            steps += f'<tr class="no" style="color:{colour}">{cells}</tr>' if step[0] == CROSS else f"<tr>{cells}</tr>"
        return (
            f'<p class="verdict" style="background:{colour}" id="verdict">{escape(self.headline)}</p>'
            f'<p id="reason">{escape(self.reason)}</p>'
            + (f'<p class="remedy">Suggestion: {escape(self.remedy)}</p>' if self.remedy else "")
            + (f"<dl>{pairs}</dl>" if pairs else "")
            + (f'<table class="steps">{steps}</table>' if steps else "")
            + "".join(notes(items, summary) for summary, items in self.lists)
            + html_list(remarks).replace("<ul>", '<ul class="remarks" aria-label="Remarks about the picture">')
        )


WIDE = 28
"""Characters of a figure above which it takes the complete width of a caption."""

TICK, CROSS = "\u2713", "\u2717"
"""The first text of a step that is passed, and of one that is not."""


class Bar(NamedTuple):
    """A bar of a Gantt chart from ``start`` for ``duration`` (s), in the lane and the colour of these names."""

    lane: str
    phase: str
    start: float
    duration: float
    title: str


def legend(colours: Iterable[tuple[str, str | Sequence[float]]], label: str = "Meaning of the colours") -> str:
    """The meaning of colours, as (text, CSS colour or components from 0 to 1) pairs; empty without any."""
    entries = []
    for text, colour in colours:
        css = colour if isinstance(colour, str) else f"rgb({','.join(f'{255 * share:.0f}' for share in colour)})"
        entries.append(f'<li><span class="swatch" style="background:{css}"></span>{escape(text)}</li>')
    return f'<ul class="legend" aria-label="{label}">{"".join(entries)}</ul>' if entries else ""


def figures(pairs: Iterable[tuple[str, str]]) -> str:
    """The main figures of a page for its header, as (name, value) pairs."""
    entries = "".join(f"<li><b>{escape(value)}</b> {escape(name)}</li>" for name, value in pairs)
    return f'<ul class="legend" id="figures" aria-label="Figures">{entries}</ul>'


def chips(counts: Mapping[str, int], colours: Mapping[str, str]) -> str:
    """For the header: a button for each value of the second column of the table that filters it, with its count."""
    buttons = "".join(
        f'<button type="button" class="chip" data-value="{escape(name)}" aria-pressed="false">'
        f'<span class="swatch" style="background:{colours.get(name, theme.COLOURS["muted"])}"></span>'
        f"{count:,} {escape(name)}</button>"
        for name, count in counts.items()
        if count
    )
    return f'<div id="chips" role="group" aria-label="Show only rows of one verdict">{buttons}</div>'


def linked(names: Iterable[str], colours: Iterable[str], nodes: Iterable[Sequence[str] | None]) -> list[dict[str, Any]]:
    """The setting ``picks``: for each row of the table its name in links, its colour, and the node of its part."""
    rows = zip(names, colours, nodes, strict=True)
    return [{"name": name, "colour": colour, "body": node} for name, colour, node in rows]


def notes(texts: Sequence[str], summary: str = "Notes") -> str:
    """Texts below a summary, which unfolds them; empty without texts."""
    return f"<details><summary>{escape(summary)}</summary>{html_list(texts)}</details>" if texts else ""


def table(place: str, rows: Rows, texts: Sequence[str]) -> str:
    """A panel with a table that can be sorted and filtered, and with notes; ``place`` is ``side`` or ``below``."""
    cells = rows.html(sys.maxsize).replace("<tbody>", '<tbody id="rows">', 1)
    return (
        f'<section id="list" class="{place}" aria-label="All picks"><div id="tools">'
        '<input type="search" id="find" placeholder="Filter" aria-label="Filter the table">'
        '<span id="count" role="status"></span></div><div id="scroller">'
        f"{cells}"
        f'<p id="none" hidden>No pick to show.</p></div><div id="notes">{notes(texts)}</div></section>'
    )


LANE, SLIM_LANE, HEAD = 28, 16, 20
"""Heights in pixels of the lanes of a Gantt chart with and without their names, and of the line with the times."""


def gantt(bars: Sequence[Bar], lanes: Sequence[str], duration: float, *, named: bool) -> str:
    """A panel with a Gantt chart; ``lanes`` are the names from top to bottom, which ``named`` shows."""
    lanes = [lane for lane in lanes if any(bar.lane == lane for bar in bars)]
    height = LANE if named else SLIM_LANE
    names = "".join(
        f'<b style="top:{HEAD + height * k + 5}px">{escape(lane)}</b>' for k, lane in enumerate(lanes) if named
    )
    drawn = "".join(
        f'<i style="left:{100 * bar.start / duration:.4f}%;width:max({100 * bar.duration / duration:.4f}%,1px);'
        f'top:{HEAD + height * lanes.index(bar.lane) + 2}px;height:{height - 4}px;background:var(--{bar.phase})" '
        f'data-start="{bar.start:.4f}" data-end="{bar.start + bar.duration:.4f}" title="{escape(bar.title)}"></i>'
        for bar in bars
    )
    used = [(name, f"var(--{name})") for name in theme.PHASES if any(bar.phase == name for bar in bars)]
    return (
        '<section id="chart" class="below" aria-label="Gantt chart">'
        '<div class="scroll" tabindex="0" aria-label="Phases over time; click to go to a time">'
        f'<div class="plot" id="gantt" style="height:{HEAD + height * len(lanes) + 4}px">{drawn}{names}</div></div>'
        '<div id="zoomer"><label>Zoom <input type="range" id="zoom" min="0" max="1" step="0.01" value="0"></label>'
        f"{legend(used)}</div></section>"
    )


SCRIPTS = ("page.js", "views.js", "distance.js", "inspect.js")
"""The scripts of every page, in this order."""

MOST_BYTES = 1_000_000
"""A page computes by default if that enlarges it by at most this."""

COMPUTING = ("compute.js", "handle.js", "live_view.js")
"""The scripts of pages that compute, before that of the kind of page."""


def page(
    title: str,
    layout: str,
    panels: str,
    settings: Mapping[str, Any],
    commands: Commands,
    *,
    label: str,
    summary: str = "",
    head: str = "",
    colours: Iterable[tuple[str, str | Sequence[float]]] = (),
    script: str = "",
    texts: Mapping[str, str] | None = None,
    live: bool = False,
) -> str:
    """The HTML of a page with a film.

    The widths and heights depend on the ``layout``: ``motion``, ``picks`` or ``cell``. ``panels``, ``summary`` and
    ``head`` are HTML: of the panels, of the line below the title, and of the right end of the header; ``title`` and
    ``label``, for readers of the screen, are plain text. ``settings`` is an object of the scripts, in which references
    to arrays of ``commands`` become typed arrays; ``script`` runs after :data:`SCRIPTS`. ``texts`` become
    elements with these identifiers, for a page that computes with WebAssembly. A ``live`` page may receive events from
    the server that sent it.
    """
    # The colours that the scripts draw with
    bundle, licences = _viewer_bundle()
    drawing = {**theme.COLOURS, **theme.PICTURE, "axes": theme.AXES, "font": theme.FONT}
    scripts = "\n".join(map(part, SCRIPTS))
    values = {
        "title": escape(title),
        "layout": layout,
        "label": escape(label),
        "summary": summary,
        "head": head,
        "legend": legend(colours),
        "panels": panels,
        "policy": POLICY.format(compute=" 'wasm-unsafe-eval'" if texts else "", connect="'self'" if live else "'none'"),
        "style": theme.css() + part("page.css"),
        "licences": _inside_script(licences),
        "bundle": _inside_script(bundle),
        "settings": script_json({**settings, "theme": drawing}),
        "commands": script_json(commands.items),
        "pictures": script_json([*commands.pictures.items()]),
        "buffers": commands.base64(),
        "texts": "".join(f'<script type="text/plain" id="{n}">{text}</script>' for n, text in (texts or {}).items()),
        "script": f'"use strict";\n(function () {{\n{scripts}\n{script}\nwindow.pinproof.ready = true;\n}})();',
    }
    # In a single pass, so that inserted text is never replaced again
    return re.sub(r"\{\{(\w+)\}\}", lambda place: values[place[1]], part("shell.html"))


def write_page(path: str | Path, text: str) -> None:
    """Write a page completely or not at all; ViewerError if it cannot be written."""
    try:
        write_text_whole(path, text)
    except FileError as error:
        raise ViewerError(str(error)) from error


def part(name: str, package: str = "pinproof.viewer") -> str:
    """The text of a file in a package."""
    return files(package).joinpath(name).read_text(encoding="utf-8")


def _viewer_bundle() -> tuple[str, str]:
    """The viewer of meshcat (MIT licence; it includes three.js and dat.GUI) and the licences to distribute with it."""
    spec = find_spec("meshcat")  # does not import the package; see pinproof.viewer.wire
    if spec is None or spec.origin is None:
        raise ViewerError("meshcat is not installed; pages need its viewer: pip install meshcat")
    folder = Path(spec.origin).parent / "viewer"
    try:
        bundle = (folder / "dist" / "main.min.js").read_text(encoding="utf-8")
        notices = [
            (folder / name).read_text(encoding="utf-8")
            for name in ("LICENSE", "dist/main.min.js.LICENSE.txt", "dist/main.min.js.THIRD_PARTY_LICENSES.json")
            if (folder / name).is_file()
        ]
    except OSError as error:
        raise ViewerError(f"the installed meshcat has no viewer at {error.filename}: reinstall it") from error
    return bundle, "\n\n".join(["The viewer below is meshcat's.", *notices])


def _inside_script(text: str) -> str:
    """Escape a text so that it cannot close the ``<script>`` element that contains it."""
    return re.sub(r"<(?=/script|!--)", r"\\x3c", text, flags=re.IGNORECASE)
