"""The kit of results: what a value shows is declared once, and its ``repr``, HTML and Markdown follow from it.

A class of the kind :class:`Shown` declares a :class:`View`: a headline, and tables, notes and other values below it.
:class:`Saved` adds files: JSON with the keys of the struct, and tables as Markdown and CSV. :class:`Answer` is a result
that is a solution, or the reason why no solution exists or was found.

The HTML is for notebooks: it needs no style sheet, script or network connection, and every text in it is escaped.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from functools import cached_property, partial
from html import escape
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar, overload

import numpy as np
import numpy.typing as npt

from pinproof.common.files import json_text, save_as
from pinproof.common.theme import COLOURS, SERIES
from pinproof.errors import NoAnswer

Own = TypeVar("Own", bound="Answer")
Value = TypeVar("Value")


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

RIGHT = ' style="text-align:right"'


@dataclass(frozen=True)
class Rows:
    """A table that is shown as HTML or Markdown.

    Parameters
    ----------
    columns
        The headings.
    rows
        The cells of each row: numbers are shown with six significant digits and aligned at the right, None as an empty
        cell, and :class:`Html` in HTML as it is.
    total
        The number of rows, if ``rows`` is an iterator; only as many as are shown are then read.
    numbers
        The headings of columns of texts that are quantities, which are also aligned at the right.
    colours
        The CSS colour of a dot in the second cell of each row; empty for none.
    """

    columns: Sequence[str]
    rows: Iterable[Sequence[object]]
    total: int | None = None
    numbers: Collection[str] = ()
    colours: Sequence[str] = ()

    def html(self, most: int = MOST_ROWS) -> str:
        """The table with at most ``most`` rows, and a line that states how many more exist."""
        # An iterator is read only as far as it is shown
        rows = self.rows if self.total is not None else tuple(self.rows)
        total = self.total if self.total is not None else len(rows)  # type: ignore[arg-type]  # a tuple
        styles = [RIGHT if column in self.numbers else "" for column in self.columns]
        head = "".join(f"<th{style}>{escape(name)}</th>" for name, style in zip(self.columns, styles, strict=True))
        body = []
        for number, row in enumerate(islice(rows, most)):
            cells = []
            for column, (value, style) in enumerate(zip(row, styles, strict=True)):
                text = value if isinstance(value, Html) else escape(_cell(value))
                style = RIGHT if isinstance(value, (float, np.floating)) else style
                dot = column == 1 and self.colours
                dot = f'<span style="color:{self.colours[number]}">&#9679;&nbsp;</span>' if dot else ""
                cells.append(f"<td{style}>{dot}{text}</td>")
            body.append(f"<tr>{''.join(cells)}</tr>")
        more = f"<p>{total - most:,} more rows are not shown.</p>" if total > most else ""
        return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(body)}</tbody></table>{more}"

    def text(self) -> list[str]:
        """The lines of the complete table, with the columns below each other."""
        lines = [self.columns, *([_cell(value) for value in row] for row in self.rows)]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in lines]

    def markdown(self) -> str:
        """The complete table; vertical bars in cells are escaped, because they separate the columns."""
        marks = ["---:" if column in self.numbers else "---" for column in self.columns]
        lines = [self.columns, marks, *([_cell(value) for value in row] for row in self.rows)]
        escaped = ([cell.replace("|", "\\|").replace("\n", " ") for cell in line] for line in lines)
        return "\n".join(f"| {' | '.join(cells)} |" for cells in escaped)


def _cell(value: object) -> str:
    """A cell of a table as text."""
    return "" if value is None else f"{float(value):.6g}" if isinstance(value, (float, np.floating)) else str(value)


@dataclass(frozen=True)
class View:
    """What is shown of a value.

    Parameters
    ----------
    head
        The headline: the ``repr`` is that of a call with it, and it is the title of the HTML unless ``title`` is given.
    parts
        What is below the headline in HTML and Markdown: tables, lists of texts, HTML, and other values, each shown by
        its own HTML; None is left out.
    lines
        The further lines of the ``repr``.
    total
        The number of ``lines``, if they are an iterator; only as many as are shown are then read.
    title
        The title of the HTML.
    """

    head: str
    parts: Iterable[object] = ()
    lines: Iterable[str] = ()
    total: int | None = None
    title: str = ""


class ByValue:
    """A dataclass that equals another of its class with the same values, those of arrays and poses included.

    Declared with ``eq=False``, because a comparison of arrays is an array.
    """

    not_pickled: ClassVar[Sequence[str]] = ()
    """Fields that are large and not a part of the value: a pickle has None in their place."""

    def _values(self) -> tuple[object, ...] | None:
        """What is compared; None for a class that is compared by identity."""
        if not is_dataclass(self):
            return None
        return tuple(
            self.__dict__.get(each.name) for each in fields(self) if each.compare and each.name not in self.not_pickled
        )

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        values = self._values() if type(self) is type(other) else None
        return values is not None and same_values(values, other._values())  # type: ignore[attr-defined]

    def __hash__(self) -> int:
        values = self._values()
        if values is None:
            return object.__hash__(self)
        return hash((type(self), *(each for each in values if isinstance(each, (str, int, Enum)))))

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | dict.fromkeys(self.not_pickled)

    def __setstate__(self, state: dict[str, Any]) -> None:
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)  # a pickle does not keep it
        self.__dict__.update(state)


def same_values(one: object, other: object) -> bool:
    """Whether two values are equal, with equal types, arrays, poses and dataclasses in them; NaN equals NaN."""
    if one is other:
        return True
    if type(one) is not type(other):
        return False
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    if isinstance(one, (tuple, list)) and isinstance(other, (tuple, list)):
        return len(one) == len(other) and all(map(same_values, one, other))
    if isinstance(one, ByValue):
        return one == other
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(same_values(value, other[name]) for name, value in one.items())
    if hasattr(one, "homogeneous"):  # an SE3
        return np.array_equal(one.homogeneous, getattr(other, "homogeneous"))  # noqa: B009
    if is_dataclass(one):
        return all(same_values(vars(one).get(each.name), vars(other).get(each.name)) for each in fields(one))
    return one == other or (one != one and other != other)


class Shown(ByValue):
    """A value whose ``repr`` and HTML follow from its view."""

    def __init_subclass__(cls, **named: Any) -> None:
        super().__init_subclass__(**named)
        if "__repr__" not in cls.__dict__:  # otherwise the decorator of dataclasses would write its own
            cls.__repr__ = Shown.__repr__  # type: ignore[method-assign]

    def _view(self) -> View:
        """What is shown of the value."""
        raise NotImplementedError

    def __repr__(self) -> str:
        view = self._view()
        return outline(f"{type(self).__name__}({view.head})", view.lines, total=view.total)

    def to_text(self) -> str:
        """The headline and the further lines of the ``repr``, complete."""
        view = self._view()
        return "\n".join([view.head, *view.lines])

    def _repr_html_(self) -> str:
        view = self._view()
        parts = "".join(map(html_of, view.parts))
        return f"<div><p><strong>{escape(view.title or view.head)}</strong></p>{parts}</div>"


class Identified(Shown):
    """A value that is compared by the hash of all its values, which is made once.

    Robots and arms are keys of caches: comparing equal ones value by value takes a millisecond. Unlike in other values,
    zeros of different signs differ.
    """

    @cached_property
    def _digest(self) -> str:
        return hashlib.sha256(repr(_written(self._values())).encode()).hexdigest()

    def __eq__(self, other: object) -> bool:
        return self is other or (
            isinstance(other, Identified) and type(self) is type(other) and self._digest == other._digest
        )

    def __hash__(self) -> int:
        return hash(self._digest)


def _written(value: object) -> object:
    """Plain values whose text contains all numbers of a value exactly."""
    if isinstance(value, Identified):
        return type(value).__name__, value._digest
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, (tuple, list)):
        return type(value).__name__, [_written(each) for each in value]
    if isinstance(value, Mapping):
        return sorted((repr(name), _written(each)) for name, each in value.items())
    if hasattr(value, "homogeneous"):  # an SE3
        return value.homogeneous.tobytes()
    if is_dataclass(value):
        return type(value).__name__, [_written(vars(value).get(each.name)) for each in fields(value) if each.compare]
    return value


class Written:
    """A struct that is written as JSON."""

    def to_dict(self) -> dict[str, Any]:
        """The values for JSON; the keys are those of the schema."""
        from pinproof.common.structs import table_of  # loads Pinocchio, which the help of a command does not need

        return table_of(type(self)).write(self)


CONTENTS = {".json": "to_json", ".csv": "to_csv", ".md": "to_markdown", ".npz": "_npz", ".png": "_png"}
"""The method that returns the content of a file, by suffix; pages are written by ``_write_page``."""


class Saved(Shown):
    """A value that is shown, and written to files in some formats, for which it has the methods."""

    formats: ClassVar[Sequence[str]] = (".json", ".csv", ".md")
    """The suffixes of :meth:`save`."""

    indent: ClassVar[int] = 1

    def to_json(self: Any) -> str:
        """The text of ``to_dict`` in JSON."""
        return json_text(self.to_dict(), self.indent)

    def to_markdown(self) -> str:
        """The result in one line, and the tables and notes that are shown."""
        view = self._view()
        return markdown(view.head, *view.parts)

    def save(self, path: str | Path) -> None:
        """Write the value in the format that the suffix of the path names, which must be one of ``formats``.

        The file is written completely or not at all.

        Raises
        ------
        InputError
            For another suffix, or if there is nothing to write in this format.
        FileError
            If the file cannot be written.
        """
        self._save(path)

    def _save(self: Any, path: str | Path, **page: Any) -> None:
        """Write a file; ``page`` are the arguments of the page."""
        # Methods are looked up only for the formats of the class
        writers = {suffix: getattr(self, CONTENTS[suffix]) for suffix in self.formats if suffix != ".html"}
        if ".html" in self.formats:
            writers[".html"] = partial(self._write_page, path, **page)
        save_as(path, writers)


class Answer(Shown):
    """A result that states whether it is a solution (``ok``), and the outcome as text (``message``), which it shows."""

    failure: ClassVar[type[NoAnswer]] = NoAnswer

    if TYPE_CHECKING:  # stated by the subclasses as fields or properties

        @property
        def ok(self) -> bool:
            """Whether it is a solution."""

        @property
        def message(self) -> str:
            """The outcome as text."""

    def or_raise(self: Own) -> Own:
        """Return the result itself if it is a solution (``.ok``).

        Raises
        ------
        NoAnswer
            Otherwise, with the message; ``.result`` of the error is this result. Results of inverse kinematics raise
            ``IkFailed`` and results of planning ``PlanFailed``, which are subclasses.
        """
        if not self.ok:
            raise self.failure(self._why_not(), self)
        return self

    def _why_not(self) -> str:
        """The message of the exception of :meth:`or_raise`."""
        return self.message

    def _values(self) -> tuple[object, ...] | None:
        self._make_solutions()
        return super()._values()

    def __getstate__(self) -> dict[str, Any]:
        self._make_solutions()
        return super().__getstate__()

    def _make_solutions(self) -> None:
        """Make the fields that are made when they are first read."""
        for name in [name for name, value in self.__dict__.items() if isinstance(value, partial)]:
            getattr(self, name)

    def changed(self: Own, **values: object) -> Own:
        """Return a copy with other values of fields; :func:`dataclasses.replace` would read those that are None."""
        other = object.__new__(type(self))  # not by its pickle, which may leave out what can be made again
        other.__dict__.update({**vars(self), **values})
        return other

    def _view(self) -> View:
        return View(self.message)


class Solution(Generic[Value]):
    """A field that an answer has if it is a solution; its constructor accepts None, which is the default.

    Reading the field where it is None raises the exception of :meth:`Answer.or_raise`. Its type is therefore without
    None, also where a type checker does not know that the result is a solution. A ``functools.partial`` makes the value
    when the field is first read.
    """

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, result: None, owner: type) -> Any: ...
    @overload
    def __get__(self, result: Answer, owner: type | None = None) -> Value: ...
    def __get__(self, result: Answer | None, owner: type | None = None) -> Any:
        if result is None:  # read from the class: the default of the field
            return None
        value = result.__dict__.get(self._name)
        if isinstance(value, partial):
            value = result.__dict__[self._name] = value()
        if value is None:
            raise result.failure(result.message if not result.ok else f"this result has no {self._name}", result)
        return value

    def __set__(self, result: Answer, value: Value | None) -> None:
        result.__dict__[self._name] = None if isinstance(value, Solution) else value  # the default of a declared field


def markdown(*parts: Any) -> str:
    """Paragraphs, tables and lists of texts in Markdown, separated by empty lines; empty ones are left out."""
    texts = []
    for part in parts:
        if isinstance(part, Rows):
            texts.append(part.markdown())
        elif isinstance(part, str) or part is None:
            texts.append(part or "")
        else:
            texts.append("\n".join(f"- {text}" for text in part))
    return "\n\n".join(filter(None, texts)) + "\n"


def html_of(value: object) -> str:
    """The HTML of a part of a view; empty for None."""
    if value is None or isinstance(value, Html):
        return value or ""
    if isinstance(value, Rows):
        return value.html()
    show = getattr(value, "_repr_html_", None)
    if callable(show):
        return str(show())
    return html_list(value if isinstance(value, Iterable) and not isinstance(value, str) else repr(value).splitlines())


def html_list(texts: Iterable[object]) -> str:
    """A list of texts; empty without texts."""
    items = "".join(f"<li>{escape(str(text))}</li>" for text in texts)
    return f"<ul>{items}</ul>" if items else ""


def shortened(text: str, width: int = MOST_WIDTH) -> str:
    """The text in one line of at most ``width`` characters; an ellipsis replaces the rest."""
    line = " ".join(text.split())
    return line if len(line) <= width else f"{line[: width - 3]}..."


def outline(head: str, lines: Iterable[str] = (), *, total: int | None = None) -> str:
    """A head line and indented lines, at most :data:`MOST_LINES` in all, of which the last states how many are left."""
    if total is None:
        lines = tuple(lines)
        total = len(lines)
    # The last line states how many are left out
    available = MOST_LINES - 1
    shown = list(islice(lines, available if total <= available else available - 1))
    more = [f"... and {total - len(shown)} more"] if total > len(shown) else []
    return "\n".join([shortened(head), *(f"  {shortened(line)}" for line in (*shown, *more))])


def html_plot(times: npt.ArrayLike, lines: Mapping[str, npt.ArrayLike], unit: str) -> Html:
    """A plot of values over times (m,) as inline SVG, with a legend; ``lines`` are (m,) values by name."""
    # As many points as the plot can show, scaled to its size; equal values are drawn at the bottom
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
    return Html(
        f'<svg role="img" aria-label="{label}" width="{width + 8:.0f}" height="{height + 8:.0f}" '
        f'viewBox="-4 -4 {width + 8:.0f} {height + 8:.0f}"><rect width="{width:.0f}" height="{height:.0f}" fill="none" '
        f'stroke="{COLOURS["line"]}"/>{"".join(drawn)}</svg><p>{", ".join(legend)}: {label}</p>'
    )
