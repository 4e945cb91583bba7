"""Results of benchmarks: rows with their settings and provenance as JSON, and tables in the pages of docs/benchmarks.

A page is written by hand, except for what is between two comments with the name of a block; its benchmark writes these
blocks. So texts are in the page, and figures come from the run.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import datetime, timezone
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from time import process_time
from types import SimpleNamespace
from typing import Any

import numpy as np
from generated_files import with_tables

from pinproof.errors import FileError, InputError

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "benchmarks"
ROBOTS = FOLDER.parents[1] / "robots"

PACKAGES = ("pinproof", "pin", "coal", "numpy")
"""Packages whose versions are part of the provenance."""

NO_RUN = ("settings", "provenance")


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


class Row(SimpleNamespace):
    """One row: its values by name, which are plain values for JSON."""


@dataclass
class Results:
    """The results of a run: ``parts`` are lists of rows by name, and other values for JSON.

    ``settings`` state what was run; for ``provenance`` see :func:`provenance`, which is called before the run.
    """

    settings: dict[str, Any]
    provenance: dict[str, Any]
    parts: dict[str, Any] = field(default_factory=dict)

    def __getitem__(self, part: str) -> Any:
        return self.parts.get(part, [])

    @property
    def faults(self) -> list[str]:
        """Wrong verdicts, and faults that the independent check found in a motion that was stated to be safe."""
        rows = [row for part in self.parts.values() if isinstance(part, list) for row in part]
        return [text for row in rows for text in getattr(row, "wrong", ())]

    def save(self, path: Path) -> None:
        """Write JSON with one line for each row."""
        texts = [f"{json.dumps(key)}: {json.dumps(getattr(self, key), indent=1)}" for key in NO_RUN]
        for key, part in self.parts.items():
            rows = [json.dumps(vars(row) if isinstance(row, Row) else row, allow_nan=False) for row in part]
            text = "[\n" + ",\n".join(rows) + "\n]" if isinstance(part, list) else json.dumps(part, indent=1)
            texts.append(f"{json.dumps(key)}: {text}")
        path.write_text("{\n" + ",\n".join(texts) + "\n}\n", encoding="utf-8")

    @classmethod
    def load(cls, path: Path) -> Results:
        """Read what :meth:`save` wrote; FileError if the file does not hold results."""
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
            head = [data.pop(key) for key in NO_RUN]
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise FileError(path, f"does not hold the results of a benchmark: {error!r}") from error
        parts = {k: [Row(**row) for row in part] if isinstance(part, list) else part for k, part in data.items()}
        return cls(*head, parts)

    def added_to(self, stored: Results, keys: Sequence[str]) -> Results:
        """The stored results with these: rows of equal ``keys`` are replaced, parts that were not measured are kept.

        With ``keys``, entries of parts and settings that are dictionaries are kept too. ``settings["measured"]`` has
        the commit of each part.
        """
        parts = dict(stored.parts)
        measured = dict.fromkeys(stored.parts, stored.provenance["commit"]) | stored.settings.get("measured", {})
        for name, part in self.parts.items():
            if not part:
                continue
            measured[name] = self.provenance["commit"]
            if isinstance(part, list) and keys:
                rows = {tuple(getattr(row, key, None) for key in keys): row for row in (*stored[name], *part)}
                parts[name] = list(rows.values())
            else:
                parts[name] = _merged(stored[name], part) if keys else part
        settings = {**stored.settings, **self.settings}
        if keys:
            settings = {key: _merged(stored.settings.get(key), value) for key, value in settings.items()}
        settings["measured"] = measured
        return Results(settings, self.provenance, parts)


def _merged(old: Any, new: Any) -> Any:
    return {**old, **new} if isinstance(old, dict) and isinstance(new, dict) else new


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
        found[name] = None
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def version_in(python: str, distribution: str) -> str | None:
    """The version of a distribution in the environment of another Python; None if it is not installed there."""
    command = [python, "-c", f"from importlib.metadata import version; print(version({distribution!r}))"]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip() or None


def _cpu() -> str:
    lines: list[str] = []
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or platform.machine()


def _commit() -> str | None:
    root = FOLDER.parents[1]
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


def provenance_text(results: Results) -> list[str]:
    """One paragraph with versions, machine, seed, commit and date, and the parts measured at another commit."""
    origin = results.provenance
    versions = {**origin["versions"], **results.settings.get("peer_versions", {})}
    packages = ", ".join(f"{name} {number}" for name, number in versions.items() if number is not None)
    text = (
        f"Measured with {packages} on {origin['cpu']} ({origin['cores']} cores, load average {origin['load']}); seed "
        f"{origin['seed']}, commit {origin['commit']}, {origin['date']}."
    )
    measured = results.settings.get("measured", {})
    other = [f"{part}: {commit}" for part, commit in measured.items() if commit != origin["commit"]]
    return wrapped(text, f"Tables that were measured at another commit: {'; '.join(other)}." if other else "")


# -- Markdown and plots ------------------------------------------------------------------------------------------------


def wrapped(*sentences: str) -> list[str]:
    """The lines of one paragraph."""
    return textwrap.wrap(" ".join(filter(None, sentences)), 120)


def quantiles(
    values: Iterable[float | None],
    text: str | Callable[[float], str],
    shares: Sequence[float] = (0.5,),
    scale: float = 1.0,
) -> str:
    """Quantiles, by default the median, of the values that are not None in a format; empty without such values."""
    known = [scale * value for value in values if value is not None]
    shown = text.format if isinstance(text, str) else text
    return " / ".join(map(shown, np.quantile(known, shares).tolist())) if known else ""


def markdown_table(columns: Sequence[str], rows: Iterable[Sequence[str]], *, text_columns: int = 1) -> list[str]:
    """The lines of a table; columns without any content are left out.

    The first ``text_columns`` columns are aligned to the left, the others, which hold numbers, to the right.
    """
    rows = list(rows)
    shown = [k for k in range(len(columns)) if any(row[k] for row in rows)]
    rule = ["---" if k < text_columns else "--:" for k in range(len(columns))]
    return [f"| {' | '.join(cells[k] for k in shown)} |" for cells in (columns, rule, *rows)]


Columns = Mapping[str, "str | Callable[[Any], str]"]
"""The columns of a table: each title with a format of the row, which is empty for None, or a function of the row."""


def row_table(columns: Columns, rows: Iterable[Any], *, text_columns: int = 1) -> list[str]:
    """The lines of a table with one line for each row; no lines without rows."""

    def cell(column: str | Callable[[Any], str], row: Any) -> str:
        if not isinstance(column, str):
            return column(row)
        try:
            return column.format(row)
        except TypeError:  # None has no format
            return ""

    cells = [[cell(column, row) for column in columns.values()] for row in rows]
    return markdown_table(tuple(columns), cells, text_columns=text_columns) if cells else []


def bullet_section(title: str, entries: Iterable[str]) -> list[str]:
    """The lines of a section with a list; no lines without entries."""
    lines = [f"- {entry}" for entry in entries]
    return [f"## {title}", "", *lines, ""] if lines else []


def new_figure(rows: int, columns: int, *, width: float, height: float) -> tuple[Any, Any]:
    """A figure made without pyplot, and its axes (rows, columns), each ``width`` by ``height`` inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width * columns, height * rows), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False)


def log_panel(panel: Any, title: str, x_label: str, y_label: str, *, percent: bool = True) -> None:
    """Label axes with a logarithmic x axis and a grid; ``percent``: the y axis shows 0 to 100 %."""
    panel.set_title(title, fontsize=10)
    panel.set_xscale("log")
    panel.set_xlabel(x_label)
    panel.set_ylabel(y_label)
    panel.grid(alpha=0.3)
    if percent:
        panel.set_ylim(-2, 104)


# -- runs --------------------------------------------------------------------------------------------------------------

Blocks = Mapping[str, Sequence[str]]
"""The lines of the blocks of a page by name."""


@dataclass(frozen=True)
class Benchmark:
    """A benchmark: its page ``docs/benchmarks/<name>.md`` with ``<name>.json``, what it runs, and what it shows.

    ``figures`` are plots for the page by file name. Rows with equal ``keys`` replace those that are stored; without
    keys, a part that was measured replaces the stored one.
    """

    name: str
    measure: Callable[[argparse.Namespace], Results]
    blocks: Callable[[Results], Blocks]
    figures: Callable[[Results], Mapping[str, Any]] = lambda _: {}
    keys: tuple[str, ...] = ()
    page: str = ""

    @property
    def stored(self) -> Results:
        """The results that the page shows."""
        return Results.load(FOLDER / f"{self.name}.json")

    def all_blocks(self, results: Results) -> Blocks:
        """The blocks, with that of the provenance and that of what is wrong."""
        wrong = bullet_section("Wrong verdicts", results.faults)
        return {"provenance": provenance_text(results), **self.blocks(results), "wrong": wrong}

    def page_text(self, results: Results) -> str:
        """The page with the blocks of these results."""
        text = (FOLDER / f"{self.page or self.name}.md").read_text(encoding="utf-8")
        prefix = f"{self.name}: " if self.page else ""
        blocks = {f"{prefix}{name}": "\n".join(["", *lines, ""]) for name, lines in self.all_blocks(results).items()}
        return with_tables(text, "benchmark", blocks)

    def write(self, results: Results) -> None:
        """Write the page, its data and its plots."""
        results.save(FOLDER / f"{self.name}.json")
        (FOLDER / f"{self.page or self.name}.md").write_text(self.page_text(results), encoding="utf-8")
        for name, figure in self.figures(results).items():
            figure.savefig(FOLDER / name, dpi=min(110.0, 1150.0 / figure.get_figwidth()), format="png")

    def run(self, parser: argparse.ArgumentParser) -> None:
        """Measure, or read what is stored with ``--render``; exit code 1 if a verdict is wrong."""
        options = parser.parse_args()
        results = self.stored if options.render else self.measure(options)
        if options.docs:
            results = results.added_to(self.stored, self.keys)
        if options.docs or options.render:
            self.write(results)
        else:
            blocks = self.all_blocks(results)
            print("\n\n".join("\n".join([f"{name}:", "", *lines]) for name, lines in blocks.items() if lines))
        sys.exit(1 if results.faults else 0)


def page_parser(text: str | None, name: str) -> argparse.ArgumentParser:
    """A parser with the options of every benchmark; ``text`` is the docstring of the module."""
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--docs", action="store_true", help=f"write what was measured to docs/benchmarks/{name}.*")
    parser.add_argument("--render", action="store_true", help=f"rewrite the page from {name}.json")
    return parser


def report(text: str) -> None:
    """Print progress."""
    print(text, file=sys.stderr)


def seconds(call: Callable[[], object], clock: Callable[[], float] = process_time) -> float:
    """The time of a call in s, by default processor time."""
    begin = clock()
    call()
    return clock() - begin


def fastest(call: Callable[[], object], runs: int, clock: Callable[[], float] = process_time) -> float:
    """The time in s of the fastest of several calls, which reduces the influence of other processes."""
    return min(seconds(call, clock) for _ in range(runs))
