"""Benchmark tables: rows with their settings and provenance, saved as JSON, rendered as Markdown and PNG plots."""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from datetime import datetime, timezone
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from time import process_time
from typing import Any, ClassVar, TypeVar

import numpy as np

from pinproof.common.files import write_text_whole
from pinproof.errors import FileError, InputError

WIDTH = 120
"""Characters per line of Markdown text."""

PACKAGES = ("pinproof", "pin", "coal", "numpy")
"""Packages whose versions are part of the provenance."""

AnyTable = TypeVar("AnyTable", bound="BenchmarkTable")


class NotApplicableError(Exception):
    """A method cannot be run on this arm or problem; the message states the reason. Caught by the benchmark runs."""


@contextmanager
def leave_out(left_out: dict[str, str], method: str, *, own: bool, where: str = "") -> Iterator[None]:
    """Record why a method cannot be run; unexpected errors end the run only if it is a method of this package."""
    try:
        yield
    except ImportError as error:
        left_out[method] = f"not installed ({error})"
    except (NotApplicableError, InputError) as error:
        left_out[method + where] = str(error)
    except Exception as error:
        if own:
            raise
        left_out[method + where] = f"{type(error).__name__}: {error}"


@dataclass(frozen=True)
class BenchmarkTable:
    """The results of one benchmark run. Subclasses add tuples of rows.

    ``settings`` are plain JSON values that state what was run; see :func:`provenance`.
    """

    settings: dict[str, Any]
    provenance: dict[str, Any]

    topic: ClassVar[str]
    """What the table is about, for error messages."""

    row_types: ClassVar[Mapping[str, Callable[..., Any]]]
    """The fields that hold rows, and what makes a row from its values as keyword arguments."""

    def to_dict(self) -> dict[str, Any]:
        """Return the table as plain values for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls: type[AnyTable], data: Mapping[str, Any]) -> AnyTable:
        """Return the table that :meth:`to_dict` converted; InputError if a field is missing or unknown."""
        try:
            values = {field.name: data[field.name] for field in fields(cls)}
            for name, make in cls.row_types.items():
                values[name] = tuple(make(**_with_tuples(row)) for row in values[name])
            return cls(**values)
        except (AttributeError, KeyError, TypeError) as error:
            raise InputError(f"the data is not a table of {cls.topic}: {error}") from error

    def save(self, path: str | Path) -> None:
        """Write the table as JSON with one line per row."""
        parts = [f"{json.dumps(key)}: {_json(value)}" for key, value in self.to_dict().items()]
        write_text_whole(Path(path), "{\n" + ",\n".join(parts) + "\n}\n")

    @classmethod
    def load(cls: type[AnyTable], path: str | Path) -> AnyTable:
        """Read what :meth:`save` wrote; FileError if the file does not hold such a table."""
        try:
            return cls.from_dict(json.loads(Path(path).read_text(encoding="utf-8")))
        except (OSError, ValueError, TypeError, InputError) as error:
            raise FileError(path, f"does not hold a table of {cls.topic}: {error}") from error

    def write(self, folder: str | Path, name: str, page: str) -> list[Path]:
        """Write ``name.json`` and the Markdown ``name.md`` to an existing folder; return both paths."""
        data, text = Path(folder) / f"{name}.json", Path(folder) / f"{name}.md"
        self.save(data)
        write_text_whole(text, page)
        return [data, text]


def _with_tuples(row: Mapping[str, Any]) -> dict[str, Any]:
    return {key: tuple(value) if isinstance(value, list) else value for key, value in row.items()}


def _json(value: Any) -> str:
    if isinstance(value, (list, tuple)) and value:
        return "[\n" + ",\n".join(json.dumps(entry, allow_nan=False) for entry in value) + "\n]"
    return json.dumps(value, indent=1, allow_nan=False)


# -- provenance --------------------------------------------------------------------------------------------------------


def provenance(seed: int) -> dict[str, Any]:
    """Return versions, machine, commit, date and seed as plain values for JSON.

    ``commit`` ends in ``+`` if tracked files were changed; outside a git checkout it equals None. ``load``
    is the load average of the last minute; call this before the benchmark starts.
    """
    return {
        "versions": {"python": platform.python_version(), **installed_versions(PACKAGES)},
        "cpu": _cpu(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
        "load": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
        "seed": seed,
        "commit": _commit(),
        "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
    }


def installed_versions(distributions: Iterable[str | None]) -> dict[str, str | None]:
    """Return the versions of distributions, None for those that are not installed; a distribution None is left out."""
    found: dict[str, str | None] = {}
    for name in filter(None, distributions):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = None
    return found


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or platform.machine()


def _commit() -> str | None:
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():  # an installed package may be inside the repository of another project
        return None

    def git(*arguments: str) -> str:
        command = ["git", "-C", str(root), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip()

    try:
        changed = git("status", "--porcelain", "--untracked-files=no")
        return git("rev-parse", "--short=12", "HEAD") + ("+" if changed else "")
    except (OSError, subprocess.SubprocessError):
        return None


# -- Markdown and plots ------------------------------------------------------------------------------------------------


def provenance_text(table: BenchmarkTable) -> str:
    """Return one sentence with the versions of the packages and the peers, machine, seed, commit and date."""
    origin = table.provenance
    versions = {**origin["versions"], **table.settings.get("peer_versions", {})}
    packages = ", ".join(f"{name} {number}" for name, number in versions.items() if number is not None)
    return (
        f"Measured with {packages} on {origin['cpu']} ({origin['cores']} cores, load average {origin['load']}); seed "
        f"{origin['seed']}, commit {origin['commit']}, {origin['date']}."
    )


def wrapped(*sentences: str) -> list[str]:
    """Return the lines of one paragraph."""
    return textwrap.wrap(" ".join(sentences), WIDTH)


def quantiles(
    values: Iterable[float | None], text: Callable[[float], str], shares: Sequence[float] = (0.5,), none: str = ""
) -> str:
    """Return quantiles, by default the median, of the values that are not None; ``none`` without such values."""
    known = [value for value in values if value is not None]
    return " / ".join(text(each) for each in np.quantile(known, shares).tolist()) if known else none


def markdown_table(columns: Sequence[str], rows: Iterable[Sequence[str]], *, text_columns: int = 1) -> list[str]:
    """Return the lines of a table; columns without any content are left out.

    The first ``text_columns`` columns are aligned to the left, the others, which hold numbers, to the right.
    """
    rows = list(rows)
    shown = [k for k in range(len(columns)) if any(row[k] for row in rows)]
    rule = ["---" if k < text_columns else "--:" for k in range(len(columns))]
    return [f"| {' | '.join(cells[k] for k in shown)} |" for cells in (columns, rule, *rows)]


def row_table(
    columns: Mapping[str, str | Callable[[Any], str]], rows: Iterable[Any], *, text_columns: int = 1
) -> list[str]:
    """Return the lines of a table with one line for each row.

    ``columns`` maps each title to a format of the row, such as ``"{.edges:,}"``, which is empty for None, or to a
    function of the row.
    """

    def cell(column: str | Callable[[Any], str], row: Any) -> str:
        if not isinstance(column, str):
            return column(row)
        try:
            return column.format(row)
        except TypeError:  # None has no format
            return ""

    cells = [[cell(column, row) for column in columns.values()] for row in rows]
    return markdown_table(tuple(columns), cells, text_columns=text_columns)


def bullet_section(title: str, entries: Iterable[str]) -> list[str]:
    """Return the lines of a section with a list; no lines without entries."""
    lines = [f"- {entry}" for entry in entries]
    return [f"## {title}", "", *lines, ""] if lines else []


def new_figure(rows: int, columns: int, *, width: float, height: float) -> tuple[Any, Any]:
    """Return a figure made without pyplot, and its axes (rows, columns), each ``width`` by ``height`` inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width * columns, height * rows), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False)


def save_figure(figure: Any, path: Path) -> Path:
    """Write a figure as PNG, at most 1,150 pixels wide; return its path."""
    figure.savefig(path, dpi=min(110.0, 1150.0 / figure.get_figwidth()), format="png")
    return path


def log_panel(panel: Any, title: str, x_label: str, y_label: str, *, percent: bool = True) -> None:
    """Label axes with a logarithmic x axis and a grid; ``percent``: the y axis shows 0 to 100 %."""
    panel.set_title(title, fontsize=10)
    panel.set_xscale("log")
    panel.set_xlabel(x_label)
    panel.set_ylabel(y_label)
    panel.grid(alpha=0.3)
    if percent:
        panel.set_ylim(-2, 104)


FOLDER = Path(__file__).resolve().parents[2] / "docs" / "benchmarks"
ROBOTS = FOLDER.parents[1] / "robots"

Table = TypeVar("Table", bound=BenchmarkTable)


def page_parser(text: str | None, name: str) -> argparse.ArgumentParser:
    """Return a parser with the options of every benchmark; ``text`` is the docstring of the script."""
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--docs", action="store_true", help=f"write docs/benchmarks/{name}.*")
    parser.add_argument("--render", action="store_true", help=f"rewrite the page from {name}.json")
    return parser


def run(
    parser: argparse.ArgumentParser,
    name: str,
    kind: type[Table],
    measure: Callable[[argparse.Namespace], Table],
    page: Callable[[Table], str],
    write: Callable[[Table, Path], Any] | None = None,
) -> None:
    """Measure or read a table, write it with ``--docs`` or ``--render``, else print its page.

    ``write`` writes the table to a folder; by default as JSON, with its page as Markdown. The exit code is 1 if the
    table has :func:`faults`.
    """
    options = parser.parse_args()
    table = kind.load(FOLDER / f"{name}.json") if options.render else measure(options)
    if not (options.docs or options.render):
        print(page(table))
    elif write is None:
        table.write(FOLDER, name, page(table))
    else:
        write(table, FOLDER)
    for text in (wrong := faults(table)):
        report(f"wrong: {text}")
    sys.exit(1 if wrong else 0)


def faults(table: BenchmarkTable) -> list[str]:
    """Return the wrong verdicts of a table, and its motions in which the independent check found a fault."""
    unsafe = (f"{row.name}: {'; '.join(row.faults)}" for row in getattr(table, "unsafe", ()))
    return [*getattr(table, "wrong", ()), *unsafe]


def report(text: str) -> None:
    """Print progress."""
    print(text, file=sys.stderr)


def seconds(call: Callable[[], object], clock: Callable[[], float] = process_time) -> float:
    """Return the time of a call in s, by default processor time."""
    begin = clock()
    call()
    return clock() - begin


def fastest(call: Callable[[], object], runs: int, clock: Callable[[], float] = process_time) -> float:
    """Return the time in s of the fastest of several calls, which reduces the influence of other processes."""
    return min(seconds(call, clock) for _ in range(runs))
