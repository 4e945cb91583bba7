"""YAML files read with care: mappings know their line; a key given twice or not asked for is refused."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from pinproof.errors import FileError, UnknownNameError

__all__ = ["YAML_SUFFIXES", "LinedMapping", "listed", "read_yaml", "refuse_unknown"]

YAML_SUFFIXES = (".yaml", ".yml")

_END_MARK = re.compile(r"\n---\s*\Z")
"""What ``ros2 topic echo`` prints after each message; it would begin a second, empty document."""


def read_yaml(
    path: Path, keys: Iterable[str], error: type[FileError], *, suffixes: tuple[str, ...] = YAML_SUFFIXES
) -> LinedMapping:
    """The mapping a YAML file holds.

    Parameters
    ----------
    path
        The file; its name ends in one of ``suffixes``. JSON is read as the YAML that it is.
    keys
        The keys it may have, for the message when it is no mapping at all.
    error
        What is raised when it cannot be read; names file and line.
    """
    if path.suffix.lower() not in suffixes:
        raise error(path, f"unknown kind of file {path.suffix!r}; valid: {', '.join(suffixes)}")
    try:
        text = _END_MARK.sub("\n", path.read_text(encoding="utf-8-sig"))
        content = yaml.load(text, Loader=_LinedLoader)
    except OSError as caught:
        raise error(path, f"cannot be read: {caught.strerror or caught}") from caught
    except UnicodeDecodeError as caught:
        raise error(path, f"is not UTF-8 text: {caught}") from caught
    except (yaml.YAMLError, ValueError, RecursionError) as caught:  # ValueError: a date such as 2026-99-99
        mark = getattr(caught, "problem_mark", None)
        problem = getattr(caught, "problem", None) or str(caught)
        raise error(path, f"is no valid YAML: {problem}", f"line {mark.line + 1}" if mark else "") from caught
    if not isinstance(content, LinedMapping):
        what = "is empty" if content is None else f"holds {type(content).__name__}"
        raise error(path, f"{what}; wanted are the keys {', '.join(keys)}")
    return content


class LinedMapping(dict[Any, Any]):
    """A YAML mapping that knows on which line it starts."""

    line: int


def listed(error: type[FileError], path: Path, key: str, stated: object) -> list[Any]:
    """A list, which is what must stand under ``key``."""
    if not isinstance(stated, list):
        raise error(path, f"holds {stated!r}, not a list", f"key {key}")
    return stated


def refuse_unknown(
    error: type[FileError], path: Path, kind: str, stated: Mapping[Any, Any], valid: tuple[str, ...], where: str
) -> None:
    """Refuse the first key that is not one of ``valid``, naming those that are."""
    for key in stated:
        if key not in valid:
            raise error(path, str(UnknownNameError(kind, key, valid)), where)


class _LinedLoader(yaml.SafeLoader):
    """A SafeLoader whose mappings know their line, and which refuses a key given twice (YAML would keep the last)."""


def _lined(loader: yaml.SafeLoader, node: yaml.MappingNode) -> Any:
    mapping = LinedMapping()
    mapping.line = node.start_mark.line + 1
    yield mapping
    seen: list[Any] = []
    for key_node, _ in node.value:
        key = loader.construct_object(key_node, deep=True)
        if key in seen:
            raise yaml.constructor.ConstructorError(None, None, f"the key {key!r} is given twice", key_node.start_mark)
        seen.append(key)
    mapping.update(loader.construct_mapping(node, deep=True))


_LinedLoader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _lined)
