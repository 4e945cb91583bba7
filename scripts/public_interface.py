"""Write docs/api/interface.txt, the names that docs/versions.md promises to keep; ``--check`` only compares them.

A line is a function with the names of its parameters, a class with those of its constructor, one of its public members,
or a constant. A parameter with a default value ends in ``=``.
"""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from generated_files import main

import pinproof as pp

PAGE = Path(__file__).parents[1] / "docs" / "api" / "interface.txt"


def interface() -> str:
    """One line for each public name of the package and of its packages, in the order of the alphabet."""
    lines = []
    for module in ("pinproof", *(f"pinproof.{name}" for name in sorted(pp._PACKAGES))):
        content = importlib.import_module(module)
        for name in sorted(content.__all__):
            lines += lines_of(f"{module}.{name}", getattr(content, name))
    return "\n".join(lines) + "\n"


def lines_of(name: str, value: Any) -> Iterator[str]:
    """The lines of a name; of a class whose home is another public name, only the first."""
    yield f"{name}{parameters(value)}"
    if inspect.isclass(value) and name.count(".") > 1:  # the names of the top level are members of a package, too
        for member in sorted(each for each in dir(value) if not each.startswith("_")):
            owner = next((base for base in value.__mro__ if member in vars(base)), None)
            if owner is not None and owner.__module__.startswith("pinproof"):
                found = inspect.getattr_static(value, member)
                callable_one = getattr(found, "__func__", found)
                yield f"{name}.{member}{parameters(callable_one) if inspect.isfunction(callable_one) else ''}"


def parameters(value: Any) -> str:
    """The parameters of a function or of the constructor of a class, as ``(arm, target, *, rng=)``; else nothing."""
    if not callable(value):
        return ""
    try:
        signature = inspect.signature(value)
    except (TypeError, ValueError):  # of the compiled core
        return "(...)"
    listed: list[str] = []
    for each in signature.parameters.values():
        if each.name in ("self", "cls"):
            continue
        if each.kind is each.KEYWORD_ONLY and "*" not in listed and not any(one.startswith("*") for one in listed):
            listed.append("*")
        star = {each.VAR_POSITIONAL: "*", each.VAR_KEYWORD: "**"}.get(each.kind, "")
        listed.append(f"{star}{each.name}{'' if each.default is each.empty else '='}")
    return f"({', '.join(listed)})"


if __name__ == "__main__":
    main(__doc__, lambda: {PAGE: interface()})
