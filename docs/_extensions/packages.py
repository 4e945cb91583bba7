"""The directive ``room``: every public name of a room of pinproof, from its docstrings."""

from __future__ import annotations

import enum
import inspect
from typing import Any

import numpy as np
import numpy.typing as npt
from docutils import nodes
from docutils.parsers.rst import directives
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
"""Types of NumPy whose definition says less than their name."""


class Room(SphinxDirective):
    """``room:: pinproof.ik`` documents what ``import pinproof`` hands on of that room, as ``pinproof.NAME``.

    Names in the option ``also`` are those of the room itself that others point to, such as a base class.
    """

    required_arguments = 1
    option_spec = {"also": directives.unchanged}  # noqa: RUF012 - docutils' own way

    def run(self) -> list[nodes.Node]:
        """Let autodoc document each name."""
        room = self.arguments[0]
        names = [f"pinproof.{name}" for name in pp._HOME[room]]
        names += [f"{room}.{name}" for name in self.options.get("also", "").split()]
        lines = [line for name in names for line in documented(name)]
        return nested_parse_to_nodes(self.state, rest(lines), source=f"<{room}>")


def rest(lines: list[str]) -> StringList:
    """The lines, as a block that a page in Markdown can hold."""
    return StringList(["```{eval-rst}", *lines, "```"], source="<room>")


def documented(path: str) -> list[str]:
    """The autodoc directive of a name, and how much of it is shown."""
    parent, _, name = path.rpartition(".")
    value = getattr(__import__(parent, fromlist=[name]), name)
    if inspect.isclass(value) and issubclass(value, BaseException):
        return [f".. autoexception:: {path}", "   :show-inheritance:", ""]
    if inspect.isclass(value) and issubclass(value, enum.Enum):
        return [f".. autoclass:: {path}()", MEMBERS, "   :undoc-members:", ""]
    if inspect.isclass(value):
        return [f".. autoclass:: {path}", MEMBERS, "   :inherited-members:", ""]
    return [f".. autofunction:: {path}" if callable(value) else f".. autodata:: {path}", ""]


def keep_first_line(_app: Sphinx, what: str, _name: str, _value: Any, _options: Any, lines: list[str]) -> None:
    """Napoleon takes what stands before a colon in the first line about an attribute for its type; ours are prose."""
    if what in ("attribute", "property"):
        lines[:0] = ["..", ""]


def name_types(
    _app: Sphinx, _what: str, _name: str, _value: Any, _options: Any, signature: str | None, answer: str | None
) -> tuple[str | None, str | None]:
    """The signature with the names of types in place of their definitions."""
    for long, short in SPELLED_OUT.items():
        signature, answer = (text and text.replace(long, short) for text in (signature, answer))
    return signature, answer


def setup(app: Sphinx) -> dict[str, Any]:
    """Join Sphinx."""
    app.add_directive("room", Room)
    app.connect("autodoc-process-docstring", keep_first_line, priority=100)  # before Napoleon's 500
    app.connect("autodoc-process-signature", name_types)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
