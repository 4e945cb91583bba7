"""The directive ``package``: documents the public names of a package of pinproof from their docstrings."""

from __future__ import annotations

import enum
import importlib
import inspect
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
"""Type aliases of NumPy that are shown by name instead of by definition."""


class Package(SphinxDirective):
    """``package:: pinproof.ik`` documents the public names of that package.

    Names that the top level exports are documented as ``pinproof.NAME``, the others as ``pinproof.ik.NAME``.
    """

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Document each name with autodoc."""
        package = self.arguments[0]
        at_top = pp._HOME.get(package, ())
        further = [name for name in importlib.import_module(package).__all__ if name not in at_top]
        names = [*(f"pinproof.{name}" for name in at_top), *(f"{package}.{name}" for name in further)]
        lines = [line for name in names for line in documented(name)]
        return nested_parse_to_nodes(self.state, rest(lines), source=f"<{package}>")


def rest(lines: list[str]) -> StringList:
    """Wrap the lines in an eval-rst block for a Markdown page."""
    return StringList(["```{eval-rst}", *lines, "```"], source="<package>")


def documented(path: str) -> list[str]:
    """Return the autodoc directive and its options for a name."""
    parent, _, name = path.rpartition(".")
    value = getattr(__import__(parent, fromlist=[name]), name)
    if inspect.isclass(value) and issubclass(value, BaseException):
        return [f".. autoexception:: {path}", "   :show-inheritance:", ""]
    if inspect.isclass(value) and issubclass(value, enum.Enum):
        return [f".. autoclass:: {path}()", MEMBERS, "   :undoc-members:", ""]
    if inspect.isclass(value):
        own = all(base is object or base.__module__.startswith("pinproof") for base in value.__mro__)
        if not value.__module__.startswith("pinproof"):
            return [f".. autodata:: {path}", "   :no-value:", ""]
        return [f".. autoclass:: {path}", MEMBERS, *(["   :inherited-members:"] if own else []), ""]
    return [f".. autofunction:: {path}" if callable(value) else f".. autodata:: {path}", ""]


def keep_first_line(_app: Sphinx, what: str, _name: str, _value: Any, _options: Any, lines: list[str]) -> None:
    """Prevent Napoleon from reading the text before a colon in the first line of an attribute as its type."""
    if what in ("attribute", "property"):
        lines[:0] = ["..", ""]


def name_types(
    _app: Sphinx, _what: str, _name: str, _value: Any, _options: Any, signature: str | None, answer: str | None
) -> tuple[str | None, str | None]:
    """Replace the definitions of type aliases in a signature by their names."""
    for long, short in SPELLED_OUT.items():
        signature, answer = (text and text.replace(long, short) for text in (signature, answer))
    return signature, answer


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the extension with Sphinx."""
    app.add_directive("package", Package)
    app.connect("autodoc-process-docstring", keep_first_line, priority=100)  # before Napoleon's 500
    app.connect("autodoc-process-signature", name_types)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
