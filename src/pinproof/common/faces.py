"""What a package exports: the names that its ``__init__`` imports, each declared once, as ``import Name as Name``."""

from __future__ import annotations

from collections.abc import Mapping
from types import ModuleType


def exported(face: Mapping[str, object]) -> list[str]:
    """The ``__all__`` of a package from the globals of its ``__init__``: constants, then classes, then functions."""
    names = [name for name, value in face.items() if not name.startswith("_") and not isinstance(value, ModuleType)]
    return sorted(names, key=lambda name: (not name.isupper(), not name[:1].isupper(), name))
