"""Reading XML, where every error states file and line and no external resources are loaded, and elements of URDF."""

from __future__ import annotations

import difflib
import math
from collections.abc import Collection, Iterable
from io import BytesIO
from pathlib import Path
from typing import Any

from pinproof.common.files import read_bytes
from pinproof.errors import FileError, UrdfError
from pinproof.spatial import Array

NEAR = 0.8
"""Similarity (``difflib`` ratio) above which an unknown tag is considered misspelt; 'collison' has 0.94."""

LONGEST_TAG = 64
"""Characters that are compared; the time grows with their square."""

Element = Any  # lxml.etree._Element; lxml is typed only by its private names


def parse_file(path: Path) -> Element:
    """Return the root element of an XML file.

    UrdfError if the file cannot be read or is not well-formed; the message states the line.
    """
    return parse_text(read_bytes(path, UrdfError), path)


def parse_text(
    text: str | bytes, path: str | Path, error: type[FileError] = UrdfError, *, huge: bool = False
) -> Element:
    """Return the root element of XML text without a DOCTYPE; ``path`` is used in errors only.

    ``huge`` allows texts of more than 10 MB in an element.
    """
    from lxml import etree

    data = text.encode() if isinstance(text, str) else text
    refuse_doctype(data, path, error)
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True, remove_pis=True, huge_tree=huge
    )
    try:
        return etree.fromstring(data, parser)
    except etree.XMLSyntaxError as caught:
        reason = str(caught.msg).partition("\n")[0]
        raise error(path, f"is not well-formed XML: {reason}", f"line {caught.lineno}") from caught


def refuse_doctype(data: bytes, path: str | Path, error: type[FileError]) -> None:
    """Raise ``error`` for XML with a DOCTYPE, whose entities could expand without limit or load other files."""
    from lxml import etree

    try:
        _, root = next(etree.iterparse(BytesIO(data), events=("start",), resolve_entities=False, no_network=True))
    except (etree.XMLSyntaxError, StopIteration):
        return  # the parser reports the error
    if root.getroottree().docinfo.doctype:
        raise error(path, "contains a DOCTYPE, which is not allowed (entities can expand without limit); remove it")


def place(element: Element) -> str:
    """Return the position of an element for messages: ``line 12``."""
    return f"line {element.sourceline}"


def spelt(element: Element, known: Collection[str], path: str | Path) -> None:
    """Raise UrdfError for a misspelt child element such as ``<collison>``, which would otherwise be ignored."""
    for child in element:
        if child.tag not in known and (near := _near(str(child.tag), known)):
            raise UrdfError(path, f"<{element.tag}> contains <{child.tag}>; did you mean <{near[0]}>?", place(child))


def spelt_attributes(element: Element, known: Collection[str], path: str | Path) -> None:
    """Raise UrdfError for a misspelt attribute such as ``uper``."""
    for name in element.attrib:
        if name not in known and (near := _near(str(name), known)):
            reason = f"<{element.tag}> has the attribute {name!r}; did you mean {near[0]!r}?"
            raise UrdfError(path, reason, place(element))


def _near(name: str, known: Collection[str]) -> list[str]:
    return difflib.get_close_matches(name[:LONGEST_TAG].lower(), known, 1, NEAR)


def only(element: Element, known: Collection[str], path: str | Path) -> None:
    """Raise UrdfError for an unknown attribute, which would otherwise be ignored."""
    for attribute in element.attrib:
        if attribute not in known:
            what = f"<{element.tag}> has the unknown attribute {attribute!r}; valid: {', '.join(known)}"
            raise UrdfError(path, what, place(element))


def required(element: Element, attribute: str, path: str | Path) -> str:
    """Return the text of a required attribute, which must not be empty."""
    value = element.get(attribute)
    if value is None or not value.strip():
        raise UrdfError(path, f"<{element.tag}> needs the attribute {attribute!r}", place(element))
    return str(value).strip()


def numbers(
    element: Element, attribute: str, count: int, path: str | Path, default: str | None = None
) -> tuple[float, ...]:
    """Return ``count`` finite numbers separated by spaces; ``default`` is used if the attribute is missing."""
    text = element.get(attribute, default)
    if text is None:
        raise UrdfError(path, f"<{element.tag}> needs the attribute {attribute!r}", place(element))
    try:
        if "_" in text or not text.isascii():  # digit separators and non-ASCII digits are valid in Python only
            raise ValueError(text)
        values = tuple(float(part) for part in text.split())
    except ValueError as error:
        raise UrdfError(path, f"<{element.tag} {attribute}={text!r}> is not numeric", place(element)) from error
    if len(values) != count or not all(math.isfinite(v) for v in values):
        wanted = "one finite number" if count == 1 else f"{count} finite numbers"
        raise UrdfError(path, f"<{element.tag} {attribute}={text!r}> must be {wanted}", place(element))
    return values


def number(element: Element, attribute: str, path: str | Path, default: str | None = None) -> float:
    """Return one finite number."""
    return numbers(element, attribute, 1, path, default)[0]


# -- elements of URDF -------------------------------------------------------------------------------------------------


def rpy_of(rotation: Array) -> tuple[float, float, float]:
    """Roll, pitch, yaw of Rz(yaw) Ry(pitch) Rx(roll), exact up to rounding for every rotation (3, 3).

    Yaw is computed first, and roll from the rotation without that yaw. At a pitch of +-pi/2 yaw is arbitrary, and roll
    then compensates for it (Shoemake, Graphics Gems IV, 1994, refined as in Eigen's eulerAngles).
    """
    r = rotation
    yaw = math.atan2(r[1, 0], r[0, 0])
    s, c = math.sin(yaw), math.cos(yaw)
    pitch = math.atan2(-r[2, 0], c * r[0, 0] + s * r[1, 0])
    roll = math.atan2(s * r[0, 2] - c * r[1, 2], c * r[1, 1] - s * r[0, 1])
    return roll, pitch, yaw


def numbers_text(values: Iterable[float]) -> str:
    """The numbers separated by spaces, with all digits."""
    return " ".join(repr(float(value) + 0.0) for value in values)  # + 0.0 converts -0.0 to 0.0


def origin_attributes(pose: Array) -> dict[str, str]:
    """The attributes of the ``<origin>`` element of a pose (4, 4)."""
    return {"xyz": numbers_text(pose[:3, 3]), "rpy": numbers_text(rpy_of(pose[:3, :3]))}


def add_joint(robot: Element, name: str, kind: str, parent: str, child: str) -> Element:
    """Add a ``<joint>`` element between two links, without origin, axis and limits."""
    from lxml import etree

    joint = etree.SubElement(robot, "joint", name=name, type=kind)
    etree.SubElement(joint, "parent", link=parent)
    etree.SubElement(joint, "child", link=child)
    return joint
