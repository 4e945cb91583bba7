"""XML read with care: every complaint names file and line, and nothing outside the file is ever fetched."""

from __future__ import annotations

import difflib
import math
from collections.abc import Collection
from io import BytesIO
from pathlib import Path
from typing import Any

from pinproof.common.files import read_bytes
from pinproof.errors import FileError, UrdfError

__all__ = [
    "Element",
    "number",
    "numbers",
    "only",
    "parse_file",
    "parse_text",
    "place",
    "refuse_doctype",
    "required",
    "spelt",
    "spelt_attributes",
]

NEAR = 0.8
"""Likeness (difflib's ratio) above which an unknown tag is taken for a misspelt one; 'collison' has 0.94."""

LONGEST_TAG = 64
"""Characters that are compared: the time grows with their square."""

Element = Any  # lxml.etree._Element; lxml is typed only by its private names


def parse_file(path: Path) -> Element:
    """The root element of an XML file.

    Raises
    ------
    UrdfError
        If it cannot be read or is not well-formed, with the line.
    """
    return parse_text(read_bytes(path, UrdfError), path)


def parse_text(text: str | bytes, path: str | Path) -> Element:
    """The root element of XML text; ``path`` is only named in errors. A DOCTYPE (entities) is refused."""
    from lxml import etree

    data = text.encode() if isinstance(text, str) else text
    refuse_doctype(data, path, UrdfError)
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True, remove_pis=True
    )
    try:
        return etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        reason = str(error.msg).partition("\n")[0]
        raise UrdfError(path, f"is not well-formed XML: {reason}", f"line {error.lineno}") from error


def refuse_doctype(data: bytes, path: str | Path, error: type[FileError]) -> None:
    """Refuse XML with a DOCTYPE before any entity is met: it could swell to any size, or fetch other files."""
    from lxml import etree

    try:
        _, root = next(etree.iterparse(BytesIO(data), events=("start",), resolve_entities=False, no_network=True))
    except (etree.XMLSyntaxError, StopIteration):
        return  # who reads it says why it is no XML
    if root.getroottree().docinfo.doctype:
        raise error(path, "holds a DOCTYPE, which nothing here needs and which can hide entity bombs")


def place(element: Element) -> str:
    """``line 12``."""
    return f"line {element.sourceline}"


def spelt(element: Element, known: Collection[str], path: str | Path) -> None:
    """Refuse a child element that is nearly a known one, such as ``<collison>``: it would be skipped in silence."""
    for child in element:
        if child.tag not in known and (near := _near(str(child.tag), known)):
            raise UrdfError(path, f"<{element.tag}> holds <{child.tag}>; is <{near[0]}> meant?", place(child))


def spelt_attributes(element: Element, known: Collection[str], path: str | Path) -> None:
    """The same for attributes, such as ``uper``."""
    for name in element.attrib:
        if name not in known and (near := _near(str(name), known)):
            raise UrdfError(path, f"<{element.tag}> has the attribute {name!r}; is {near[0]!r} meant?", place(element))


def _near(name: str, known: Collection[str]) -> list[str]:
    return difflib.get_close_matches(name[:LONGEST_TAG].lower(), known, 1, NEAR)


def only(element: Element, known: Collection[str], path: str | Path) -> None:
    """Refuse attributes that are not known: what they say would be lost."""
    for attribute in element.attrib:
        if attribute not in known:
            what = f"<{element.tag}> has the attribute {attribute!r}; known ones: {', '.join(known)}"
            raise UrdfError(path, what, place(element))


def required(element: Element, attribute: str, path: str | Path) -> str:
    """The text of an attribute that must be there and not be empty."""
    value = element.get(attribute)
    if value is None or not value.strip():
        raise UrdfError(path, f"<{element.tag}> needs the attribute {attribute!r}", place(element))
    return str(value).strip()


def numbers(
    element: Element, attribute: str, count: int, path: str | Path, default: str | None = None
) -> tuple[float, ...]:
    """``count`` finite numbers, separated by blanks; ``default`` is taken when the attribute is absent."""
    text = element.get(attribute, default)
    if text is None:
        raise UrdfError(path, f"<{element.tag}> needs the attribute {attribute!r}", place(element))
    try:
        if "_" in text or not text.isascii():  # digit separators and other scripts' digits: Python alone reads them
            raise ValueError(text)
        values = tuple(float(part) for part in text.split())
    except ValueError as error:
        raise UrdfError(path, f"<{element.tag} {attribute}={text!r}> is not numeric", place(element)) from error
    if len(values) != count or not all(math.isfinite(v) for v in values):
        wanted = "one finite number" if count == 1 else f"{count} finite numbers"
        raise UrdfError(path, f"<{element.tag} {attribute}={text!r}> must hold {wanted}", place(element))
    return values


def number(element: Element, attribute: str, path: str | Path, default: str | None = None) -> float:
    """One finite number."""
    return numbers(element, attribute, 1, path, default)[0]
