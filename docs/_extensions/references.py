"""References to names without a page: they must name an existing object and are rendered as plain code."""

from __future__ import annotations

import contextlib
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


def point_from_root(_app: Sphinx, document: nodes.document) -> None:
    """Point links of README.md to the page that includes the file, or remove the link if there is no such page."""
    for node in list(document.findall(pending_xref)):
        target = node["reftarget"]
        if node["reftype"] != "myst" or not (ROOT / target).is_file():
            continue
        page = Path(target).stem.lower()
        if (ROOT / "docs" / f"{page}.md").exists():
            node.attributes.update(refdomain="doc", reftarget=page, reftargetid=None)
        else:
            node.replace_self(node.children)


def resolve(_app: Sphinx, _env: BuildEnvironment, node: pending_xref, content: nodes.Element) -> nodes.Element | None:
    """Render a name without a page as plain code; return None (a warning) if the name does not exist."""
    found = node.get("refdomain") == "py" and exists(node["reftarget"], node.get("py:class"))
    return content if found else None


def exists(target: str, within: str | None) -> bool:
    """Whether a name can be imported, is a member of the class where it is used, or is in a module of pinproof."""
    name = target.split("[")[0].rstrip("()")
    if not all(part.isidentifier() for part in name.split(".")):
        return True  # a shape, such as (n + 1, 4, 4), where Sphinx looks for a type
    if imported(name) or (within and has(getattr(pp, within.split(".")[0], None), name)):
        return True
    known = ("builtins", "typing", "pinproof")
    return any(has(module, name) for key, module in list(sys.modules.items()) if key.split(".")[0] in known)


def imported(name: str) -> bool:
    """Whether a dotted name is a module or an attribute of a module."""
    parts = name.split(".")
    for n in range(len(parts), 0, -1):
        with contextlib.suppress(ImportError):
            module = importlib.import_module(".".join(parts[:n]))
            return n == len(parts) or has(module, ".".join(parts[n:]))
    return False


def has(value: Any, path: str) -> bool:
    """Whether a dotted attribute path exists; attributes of instances are looked up in the class docstring."""
    head, _, rest = path.partition(".")
    listed = (
        re.findall(r"^(\w+(?:, \w+)*)$", inspect.getdoc(value) or "", re.MULTILINE) if inspect.isclass(value) else ()
    )
    if not rest and any(head in line.split(", ") for line in listed):
        return True
    return hasattr(value, head) and (not rest or has(getattr(value, head), rest))


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the extension with Sphinx."""
    app.connect("doctree-read", point_from_root)
    app.connect("missing-reference", resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
