"""The colours and fonts of all pages, plots, tables and pictures; in CSS each is a variable, such as ``var(--bad)``."""

from __future__ import annotations

FONT = 'system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif'
MONOSPACE = "ui-monospace, monospace"

COLOURS = {
    # Text, from dark to light
    "ink": "#1b2530",
    "soft-ink": "#3a4755",
    "muted": "#51606f",
    "faint": "#9aa6b2",
    "note": "#6b3a00",
    # Surfaces and lines
    "paper": "#ffffff",
    "veil": "#ffffffd9",  # over the picture
    "panel": "#f4f6f8",
    "panel-hover": "#e6ebf0",
    "row-hover": "#f4f7fa",
    "head": "#f1f4f7",
    "backdrop": "#c4cbd3",
    "border": "#8c99a6",
    "line": "#c9d1d9",
    "faint-line": "#e5e9ed",
    "warning-paper": "#fff3d6",
    "warning-ink": "#5c3a00",
    # What can be selected
    "accent": "#0b5cad",
    "accent-hover": "#094a8b",
    "selected": "#dbe9f8",
    "accent-paper": "#eef4fb",
    # Verdicts
    "good": "#0b7a43",
    "bad": "#b3191f",
    "open": "#a94f00",
    "crashed": "#7a2aa3",
}

VERDICTS = {
    "good": COLOURS["good"],
    "impossible": COLOURS["bad"],
    "not found": COLOURS["open"],
    "unreadable": COLOURS["muted"],
    "crashed": COLOURS["crashed"],
}
"""The colour of each verdict on a pick, in tables, pages and pictures."""

TONES = {
    "free": COLOURS["good"],
    "colliding": COLOURS["bad"],
    "open": COLOURS["open"],
    "still": COLOURS["muted"],
    **VERDICTS,
}
"""The colour of the headline of a caption: the tones of motions and configurations, and the verdicts on picks."""

CELLS = {"free": "#bfe3cf", "contact": "#e7b1b3", "limit": "#f3d9ad", "unreachable": COLOURS["line"]}
"""The colours of the cells of a strip of tool rotations."""

PHASES = {
    "transit": "#5b7aa8",
    "unwind": "#8a5ba8",
    "approach": "#3f9b6d",
    "grip": COLOURS["bad"],
    "retreat": "#8bbf5a",
    "transfer": "#d98a1f",
    "place": "#3f9b9b",
    "release": COLOURS["crashed"],
    "leave": COLOURS["faint"],
    "wait": COLOURS["faint-line"],
}
"""The colour of each phase of a pick in charts."""

SERIES = (
    COLOURS["accent"], "#c2410c", COLOURS["good"], COLOURS["crashed"], COLOURS["bad"], "#8a6d00", "#0f8b8d", "#c0267e",
    COLOURS["muted"], "#5b7f13",
)  # fmt: skip
"""The colours of the lines of a plot."""

PICTURE = {
    "link": "#b8bdc4",
    "obstacle": "#ccb28c",
    "collision": "#f29e1a",
    "path": "#ed6b0d",
    "start": "#fafafa",
    "contact": "#e60d0d",
    "alarm": "#d01515",  # bodies in contact
    "normal": "#1a0d0d",
    "sky-top": "#d9e0e8",
    "sky-bottom": "#b2bdc9",
    "ground-light": "#8a8378",
    "floor": "#b2bac2",
    "floor-lines": "#5c6978",
    "gloss": "#1c1c1c",
}
"""The colours of what is drawn in the 3D view."""

AXES = ("#d62728", "#2ca02c", "#1f5fd0")
"""The colours of the axes x, y and z of a frame."""

GHOSTS = ("#1f78cc", "#e6731a", "#299447", "#b8388c", "#735cbf", "#bf9e1a", "#1a999e", "#c74038")
"""The colours of transparent copies of an arm, used cyclically."""

COLOUR_MAPS = {
    "viridis": (
        "440154 48186a 472d7b 424086 3b528b 33638d 2c728e 26828e 21918c 1fa088 28ae80 3fbc73 5ec962 84d44b addc30 "
        "d8e219 fde725"
    ),
    "RdBu": "67001f b1182b d6604d f3a481 fddbc7 f6f7f7 d1e5f0 90c4dd 4393c3 2065ab 053061",
}
"""Colours at even steps from the lowest value to the highest, those of the maps of these names in matplotlib (CC0)."""


def css() -> str:
    """The variables of CSS with all colours and fonts."""
    values = {**COLOURS, **PHASES, "font": FONT, "mono": MONOSPACE}
    return f":root {{ {' '.join(f'--{name}: {value};' for name, value in values.items())} }}\n"


def number(name: str) -> int:
    """A colour of :data:`PICTURE` as the number that three.js expects."""
    return int(PICTURE[name][1:], 16)


def rgba(name: str, opacity: float = 1.0) -> tuple[float, float, float, float]:
    """A colour of :data:`PICTURE` with an opacity, each component from 0 to 1."""
    return (*rgb(PICTURE[name]), opacity)


def rgb(colour: str) -> tuple[float, float, float]:
    """The red, green and blue components of a colour ``#rrggbb``, each from 0 to 1."""
    red, green, blue = (int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return red, green, blue
