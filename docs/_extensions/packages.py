"""The directive ``package``: documents every public name of a package of pinproof from its docstring."""

from __future__ import annotations

import ast
import enum
import functools
import importlib
import inspect
import itertools
import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective
from sphinx.util.parsing import nested_parse_to_nodes
from sphinx.util.typing import stringify_annotation

import pinproof as pp

MEMBERS = "   :members:"
SPELLED_OUT = {
    stringify_annotation(npt.ArrayLike, "smart"): "~numpy.typing.ArrayLike",
    stringify_annotation(npt.NDArray[np.float64], "smart"): "~numpy.ndarray",
}
"""NumPy types whose definition autodoc would print, each with the name to print instead."""


class Package(SphinxDirective):
    """``package:: pinproof.ik`` documents the public names of that package.

    Names that the top level exports are documented as ``pinproof.NAME``, the others as ``pinproof.ik.NAME``.
    """

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Document each name with autodoc."""
        lines = [line for name in public_names(self.arguments[0]) for line in documented(name)]
        return nested_parse_to_nodes(self.state, rest(lines), source=f"<{self.arguments[0]}>")


def public_names(package: str) -> list[str]:
    """The full names of what a package exports: those of the top level first, then its own."""
    top = pp._HOME.get(package, "").split()
    own = [name for name in importlib.import_module(package).__all__ if name not in top]
    return [*(f"pinproof.{name}" for name in top), *(f"{package}.{name}" for name in own)]


def rest(lines: list[str]) -> StringList:
    """The lines as a block of reStructuredText inside a Markdown page."""
    return StringList(["```{eval-rst}", *lines, "```"], source="<package>")


MADE_HERE = re.compile(
    "(Audit|Check)Result|(Program)?Certificate|ProgramPart|(First)?Contact|ExcludedPair|Parting|MotionTube|Undecided.*|"
    "Constraint(Proof|Violation)|LimitViolation|LinkOverlap|OverlapReport|TimedScene|SurfacePoints|"
    "Pick(Verdict|Report|Motion)|StageResult|Intercept|GripResult|(Finger|Cup)Contact|CampaignResult|ScreenResult|"
    "BeltSequence|PicksProgram|ProgramCheck"
)
"""Results of checks, proofs and picks, which are shown without a signature because their constructors are not
public."""


def documented(path: str) -> list[str]:
    """The autodoc directive of a name, with the options for its kind."""
    parent, _, name = path.rpartition(".")
    value = getattr(importlib.import_module(parent), name)
    if inspect.isclass(value) and issubclass(value, BaseException):
        return [f".. autoexception:: {path}", "   :show-inheritance:", ""]
    if inspect.isclass(value) and issubclass(value, enum.Enum):
        return [f".. autoclass:: {path}()", MEMBERS, "   :undoc-members:", ""]
    if inspect.isclass(value):
        own = all(base is object or base.__module__.startswith("pinproof") for base in value.__mro__)
        if not value.__module__.startswith("pinproof"):
            return [f".. autodata:: {path}", "   :no-value:", ""]
        made = "()" if MADE_HERE.fullmatch(name) else ""
        return [f".. autoclass:: {path}{made}", MEMBERS, *(["   :inherited-members:"] if own else []), ""]
    return [f".. autofunction:: {path}" if callable(value) else f".. autodata:: {path}", ""]


def text_of_constant(path: str) -> str:
    """The string below the assignment of a constant, in the module of the package that defines it."""
    package, _, name = path.rpartition(".")
    home = Path(inspect.getfile(importlib.import_module(package)))
    files = sorted(home.parent.rglob("*.py")) if home.name == "__init__.py" else [home]
    return next((texts[name] for texts in map(texts_of_constants, files) if name in texts), "")


@functools.cache
def texts_of_constants(file: Path) -> dict[str, str]:
    """The string below the assignment of each constant of a module, empty where there is none."""
    texts: dict[str, str] = {}
    for statement, below in itertools.pairwise(ast.parse(file.read_text(encoding="utf-8")).body):
        stated = below.value.value if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant) else ""
        targets = statement.targets if isinstance(statement, ast.Assign) else [getattr(statement, "target", None)]
        for target in targets:
            if isinstance(target, ast.Name):
                texts.setdefault(target.id, stated if isinstance(stated, str) else "")
    return texts


def prepare_docstring(_app: Sphinx, what: str, name: str, value: Any, _options: Any, lines: list[str]) -> None:
    """Adapt a docstring to Napoleon, which reads two things in its own way.

    It takes the text before a colon in the first line of an attribute for its type, and ``x, y`` in a section of
    attributes for one name, of which Sphinx then takes ``x,`` for the type. A constant has the text below its
    assignment, not that of its type.
    """
    if what == "data" and not inspect.isclass(value) and inspect.getdoc(value) == inspect.getdoc(type(value)):
        lines[:] = [*inspect.cleandoc(text_of_constant(name)).splitlines(), ""]
    if what in ("attribute", "property", "data"):
        lines[:0] = ["..", ""]
    elif what == "class":
        lines[:] = one_attribute_each(lines)


def one_attribute_each(lines: list[str]) -> list[str]:
    """The lines of a docstring, with one entry for each of several attributes that share a description."""
    separate: list[str] = []
    section = ""
    for number, line in enumerate(lines):
        if number + 1 < len(lines) and re.fullmatch(r"-{3,}", lines[number + 1]):
            section = line
        if section == "Attributes" and re.fullmatch(r"\w+(, \w+)+", line):
            rest = lines[number + 1 :]
            description = list(itertools.takewhile(lambda text: text.startswith(" "), rest))
            for name in line.split(", ")[:-1]:
                separate += [name, *description]
            line = line.split(", ")[-1]
        separate.append(line)
    return separate


def shorten_types(
    _app: Sphinx, _what: str, _name: str, _value: Any, _options: Any, signature: str | None, returned: str | None
) -> tuple[str | None, str | None]:
    """The signature with the names of types instead of their definitions."""
    for long, short in SPELLED_OUT.items():
        signature, returned = (text and text.replace(long, short) for text in (signature, returned))
    return signature, returned


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directive and the handlers."""
    app.add_directive("package", Package)
    app.connect("autodoc-process-docstring", prepare_docstring, priority=100)  # before Napoleon's 500
    app.connect("autodoc-process-signature", shorten_types)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
