"""How values are displayed: a ``repr`` of a few lines, and small HTML tables and plots for notebooks.

The HTML needs no style sheet, script or network connection, and every text in it is escaped.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from itertools import islice

import numpy as np
import numpy.typing as npt

from pinproof.common.theme import COLOURS, SERIES


class Html(str):
    """Text that is HTML already, so that it is not escaped."""

    __slots__ = ()


MOST_LINES = 10
"""Largest number of lines of a ``repr``."""

MOST_WIDTH = 160
"""Largest number of characters of a line of a ``repr``."""

MOST_ROWS = 100
"""Largest number of rows of an HTML table; the table states how many more exist."""

PLOT_POINTS = 120
"""Number of points of each line of a plot, which is 400 pixels wide."""

PLOT_SIZE = (400.0, 160.0)
"""Width and height of a plot in pixels."""


def shortened(text: str, width: int = MOST_WIDTH) -> str:
    """The text in one line of at most ``width`` characters; an ellipsis replaces the rest."""
    line = " ".join(text.split())
    return line if len(line) <= width else f"{line[: width - 3]}..."


def outline(head: str, lines: Iterable[str] = (), *, total: int | None = None) -> str:
    """A head line and indented lines, at most :data:`MOST_LINES` in all.

    Parameters
    ----------
    head
        The first line.
    lines
        The further lines; only as many as are shown are read if ``total`` is given.
    total
        The number of ``lines``.
    """
    if total is None:
        lines = tuple(lines)
        total = len(lines)
    available = MOST_LINES - 1
    shown = list(islice(lines, available if total <= available else available - 1))
    more = [f"... and {total - len(shown)} more"] if total > len(shown) else []
    return "\n".join([shortened(head), *(f"  {shortened(line)}" for line in (*shown, *more))])


def html_block(title: str, *parts: str) -> str:
    """A title, which is escaped, and parts that are HTML already."""
    return f"<div><p><strong>{escape(title)}</strong></p>{''.join(parts)}</div>"


def html_of(value: object) -> str:
    """The HTML of a value that has one, otherwise its ``repr`` as a list; empty for None."""
    if value is None:
        return ""
    show = getattr(value, "_repr_html_", None)
    return str(show()) if callable(show) else html_list(repr(value).splitlines())


def html_list(texts: Iterable[str]) -> str:
    """A list of texts; empty without texts."""
    items = "".join(f"<li>{escape(text)}</li>" for text in texts)
    return f"<ul>{items}</ul>" if items else ""


def markdown_table(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    """The lines of a table in Markdown; a vertical bar in a cell becomes a space."""
    cells = [[str(cell).replace("|", " ") for cell in row] for row in rows]
    return [f"| {' | '.join(columns)} |", f"|{'---|' * len(columns)}", *(f"| {' | '.join(row)} |" for row in cells)]


def html_table(
    columns: Sequence[str],
    rows: Iterable[Sequence[object]],
    *,
    total: int | None = None,
    colours: Sequence[str] = (),
    numbers: Sequence[str] = (),
    most: int = MOST_ROWS,
) -> str:
    """A table of at most ``most`` rows.

    Parameters
    ----------
    columns
        The headings.
    rows
        The cells of each row: numbers are shown with six significant digits, None as an empty cell, and :class:`Html`
        as it is.
    total
        The number of rows, if ``rows`` is an iterator.
    colours
        The CSS colour of a dot in the second cell of each row; empty for none.
    numbers
        The headings of columns with numbers or quantities, which are aligned at the right.
    """
    if total is None:
        rows = tuple(rows)
        total = len(rows)
    right = ' style="text-align:right"'
    styles = [right if column in numbers else "" for column in columns]
    head = "".join(f"<th{style}>{escape(column)}</th>" for column, style in zip(columns, styles, strict=True))
    body = []
    for number, row in enumerate(islice(rows, most)):
        cells = []
        for column, (value, style) in enumerate(zip(row, styles, strict=True)):
            if isinstance(value, (float, np.floating)):
                text, style = f"{float(value):.6g}", right
            else:
                text = value if isinstance(value, Html) else "" if value is None else escape(str(value))
            dot = f'<span style="color:{colours[number]}">&#9679;&nbsp;</span>' if column == 1 and colours else ""
            cells.append(f"<td{style}>{dot}{text}</td>")
        body.append(f"<tr>{''.join(cells)}</tr>")
    more = f"<p>{total - most:,} more rows are not shown.</p>" if total > most else ""
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(body)}</tbody></table>{more}"


def html_plot(times: npt.ArrayLike, lines: Mapping[str, npt.ArrayLike], unit: str) -> str:
    """A plot of values over times (m,) as inline SVG, with a legend; ``lines`` are (m,) values by name."""
    x = np.asarray(times, dtype=float)
    keep = np.unique(np.linspace(0, len(x) - 1, PLOT_POINTS).astype(int))
    x, curves = x[keep], {name: np.asarray(values, dtype=float)[keep] for name, values in lines.items()}
    low, high = min(map(np.min, curves.values())), max(map(np.max, curves.values()))
    width, height = PLOT_SIZE
    across = (x - x[0]) / max(float(x[-1] - x[0]), 1e-12) * width
    drawn, legend = [], []
    for number, (name, values) in enumerate(curves.items()):
        colour = SERIES[number % len(SERIES)]
        up = height - (values - low) / max(float(high - low), 1e-12) * height
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(across, up, strict=True))
        drawn.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.5"/>')
        legend.append(f'<span style="color:{colour}">{escape(name)}</span>')
    label = escape(f"{float(low):.4g} to {float(high):.4g} {unit} over {float(x[-1] - x[0]):.4g} s")
    return (
        f'<svg role="img" aria-label="{label}" width="{width + 8:.0f}" height="{height + 8:.0f}" '
        f'viewBox="-4 -4 {width + 8:.0f} {height + 8:.0f}"><rect width="{width:.0f}" height="{height:.0f}" fill="none" '
        f'stroke="{COLOURS["line"]}"/>{"".join(drawn)}</svg><p>{", ".join(legend)}: {label}</p>'
    )
