"""The colours and fonts of all pages, plots and tables; in CSS each colour is a variable, such as ``var(--bad)``."""

from __future__ import annotations

FONT = 'system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif'

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

PHASES = {
    "transit": "#5b7aa8",
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


def css() -> str:
    """The variables of CSS with all colours and the font."""
    values = {**COLOURS, "font": FONT}
    return f":root {{ {' '.join(f'--{name}: {value};' for name, value in values.items())} }}\n"


def rgb(colour: str) -> tuple[float, float, float]:
    """The red, green and blue components of a colour ``#rrggbb``, each from 0 to 1."""
    red, green, blue = (int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return red, green, blue
