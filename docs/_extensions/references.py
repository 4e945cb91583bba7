"""References to names without a page: the name must exist, and the reference then becomes plain text."""

from __future__ import annotations

import contextlib
import functools
import importlib
import inspect
import re
import sys
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

import pinproof as pp

ROOT = Path(__file__).resolve().parents[2]


def resolve_from_root(_app: Sphinx, document: nodes.document) -> None:
    """Resolve a link of README.md to the page that includes the file; without such a page, keep only its text."""
    for node in list(document.findall(pending_xref)):
        target = node["reftarget"]
        if node["reftype"] != "myst" or not (ROOT / target).is_file():
            continue
        page = Path(target).stem.lower()
        if (ROOT / "docs" / f"{page}.md").exists():
            node.attributes.update(refdomain="doc", reftarget=page, reftargetid=None)
        else:
            node.replace_self(node.children)


def check_name(
    _app: Sphinx, _env: BuildEnvironment, node: pending_xref, content: nodes.Element
) -> nodes.Element | None:
    """The reference as plain code if the name exists; otherwise None, for which Sphinx prints a warning."""
    found = node.get("refdomain") == "py" and exists(node["reftarget"], node.get("py:class"))
    return content if found else None


@functools.cache
def exists(target: str, within: str | None) -> bool:
    """Whether a Python name can be imported, or is an attribute of the class ``within`` or of a module of pinproof."""
    name = target.split("[")[0].rstrip("()")
    if not all(part.isidentifier() for part in name.split(".")):
        return True  # an array shape such as (n + 1, 4, 4), which Sphinx takes for a type
    if imported(name) or (within and has(getattr(pp, within.split(".")[0], None), name)):
        return True
    known = ("builtins", "typing", "pinproof")
    return any(has(module, name) for key, module in list(sys.modules.items()) if key.split(".")[0] in known)


def imported(name: str) -> bool:
    """Whether a dotted name is a module or an attribute of one."""
    parts = name.split(".")
    for n in range(len(parts), 0, -1):
        with contextlib.suppress(ImportError):
            module = importlib.import_module(".".join(parts[:n]))
            return n == len(parts) or has(module, ".".join(parts[n:]))
    return False


def has(value: Any, path: str) -> bool:
    """Whether ``value`` has the dotted path as an attribute; a class also has what its methods assign to ``self``."""
    head, _, rest = path.partition(".")
    if inspect.isclass(value) and not rest and assigns(value, head):
        return True
    return hasattr(value, head) and (not rest or has(getattr(value, head), rest))


def assigns(kind: type, name: str) -> bool:
    """Whether a class lists an attribute in its docstring, or assigns it in its source."""
    listed = re.findall(r"^(\w+(?:, \w+)*)$", inspect.getdoc(kind) or "", re.MULTILINE)
    if any(name in line.split(", ") for line in listed):
        return True
    return re.search(rf"\bself\.{name}\b[^=(\n]*=[^=]", source_of(kind)) is not None


@functools.cache
def source_of(kind: type) -> str:
    """The source of a class, for which Python parses its module; empty for a built-in type."""
    try:
        return inspect.getsource(kind)
    except (OSError, TypeError):
        return ""


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the handlers."""
    app.connect("doctree-read", resolve_from_root)
    app.connect("missing-reference", check_name)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
