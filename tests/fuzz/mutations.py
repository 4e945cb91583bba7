"""Files that are nearly right: trees, tables and texts with a few things in them changed for the worse."""

from __future__ import annotations

import copy
import math
from typing import Any

from hypothesis import strategies as st
from lxml import etree

__all__ = ["bytes_of", "worse_lines", "worse_tree", "worse_xml"]

ODD_NUMBERS = (
    math.nan, math.inf, -math.inf, 1e308, -1e308, 1e200, 1e9, 1e-320, -1.0, 0, -1, 3, 2**31, 2**63, 2**64, 10**400, 0.5,
    180.0, 1000,
)  # fmt: skip
ODD_TEXTS = (
    "", " ", "abc", "nan", "inf", "-Infinity", "1e999", "pi", "1,5", "1_0", "\u0663", "0x10", "\ud7ff\uffff", "a b",
    "\t", "x\ny", "\x00", "é" * 300, "a" * 5000, "/", ".", "..", "../../../../etc/passwd", "package://x/../../etc/passwd",
    "file:///etc/passwd", "package://", "://", "a/" * 3000, "free", "true", "universe", "world", "*", "{i}", "[1, 2]",
    "-pi/0", "1e400*pi",
)  # fmt: skip


def deep(depth: int) -> list[Any]:
    """A list in a list in a list."""
    made: list[Any] = []
    for _ in range(depth):
        made = [made]
    return made


ODD_OTHERS = (
    None, True, False, [], {}, [[]], [{}], {"": None}, [math.nan] * 3, [1, 2, 3], [1, 2], [0, 0, 0, 0], [None], ["a"],
    {"xyz": [1]}, {"a": {"b": []}}, deep(5), deep(300), {1: 2}, {None: None}, [1e308] * 3, [1e308] * 4,
    list(range(500)), [2**40, 2**40, 1], [10**400] * 3, [True, True, True], [[1, 2, 3]] * 4, "true",
)  # fmt: skip

odd_values = st.one_of(
    st.sampled_from(ODD_NUMBERS), st.sampled_from(ODD_TEXTS), st.sampled_from(ODD_OTHERS), st.text(max_size=8),
    st.integers(), st.floats(),
)  # fmt: skip
odd_words = st.one_of(st.sampled_from([str(n) for n in ODD_NUMBERS]), st.sampled_from(ODD_TEXTS), st.text(max_size=8))


def _holders(tree: Any) -> list[Any]:
    """All mappings and lists with something in them."""
    found, edge = [], [tree]
    while edge:
        node = edge.pop()
        if isinstance(node, (dict, list)) and node:
            found.append(node)
            edge.extend(node.values() if isinstance(node, dict) else node)
    return found


@st.composite
def worse_tree(draw: st.DrawFn, tree: Any, most: int = 3) -> Any:
    """A copy of a tree of mappings and lists in which up to ``most`` things are other than they were."""
    tree = copy.deepcopy(tree)
    for _ in range(draw(st.integers(1, most))):
        holders = _holders(tree)
        if not holders:
            break
        holder = draw(st.sampled_from(holders))
        key = draw(st.sampled_from(list(holder) if isinstance(holder, dict) else range(len(holder))))
        how = draw(st.sampled_from(["odd", "odd", "odd", "drop", "double", "rename", "swap", "number"]))
        if how == "odd":
            holder[key] = copy.deepcopy(draw(odd_values))
        elif how == "number":
            holder[key] = draw(st.sampled_from(ODD_NUMBERS))
        elif how == "drop":
            del holder[key]
        elif how == "swap":
            other = draw(st.sampled_from(holders))
            if not _holds(other, holder):
                holder[key] = copy.deepcopy(other)
        elif isinstance(holder, list):
            holder.append(copy.deepcopy(holder[key]))
        elif how == "rename":
            new = draw(st.one_of(odd_words, st.integers(), st.none(), st.sampled_from(list(holder))))
            holder[new] = holder.pop(key)
        else:
            holder[f"{key}2"] = copy.deepcopy(holder[key])
    return tree


def _holds(outer: Any, inner: Any) -> bool:
    return any(node is inner for node in _holders(outer))


@st.composite
def worse_xml(draw: st.DrawFn, text: str, most: int = 3) -> bytes:
    """The XML, with attributes and elements changed, dropped, doubled, renamed or moved."""
    root = etree.fromstring(text.encode())
    for _ in range(draw(st.integers(1, most))):
        element = draw(st.sampled_from([e for e in root.iter() if isinstance(e.tag, str)]))
        how = draw(
            st.sampled_from(["attribute"] * 5 + ["words"] * 3 + ["drop", "double", "rename", "move", "unset", "deep"])
        )
        if how in ("attribute", "unset", "words") and element.attrib:
            name = draw(st.sampled_from(sorted(element.attrib)))
            if how == "unset":
                del element.attrib[name]
            elif how == "attribute":
                _set(element, name, draw(odd_words))
            else:
                words = element.get(name).split() or [""]
                words[draw(st.integers(0, len(words) - 1))] = draw(odd_words)
                _set(element, name, " ".join(words))
        elif how == "drop" and element.getparent() is not None:
            element.getparent().remove(element)
        elif how == "double" and element.getparent() is not None:
            element.addnext(copy.deepcopy(element))
        elif how == "rename":
            element.tag = draw(st.sampled_from(sorted({e.tag for e in root.iter()} | {"x", "{ns}box", "macro"})))
        elif how == "move":
            target = draw(st.sampled_from([e for e in root.iter() if isinstance(e.tag, str)]))
            target.append(copy.deepcopy(element))
        elif how == "deep":
            for _ in range(draw(st.sampled_from([3, 200]))):
                element = etree.SubElement(element, element.tag, dict(element.attrib))
    return bytes(etree.tostring(root))


def _set(element: Any, name: str, text: str) -> None:
    try:
        element.set(name, text)
    except ValueError:  # what XML cannot hold
        element.set(name, ascii(text))


@st.composite
def worse_lines(draw: st.DrawFn, text: str, separator: str = ",", most: int = 3) -> str:
    """The table, with cells, columns and lines changed, dropped or doubled."""
    rows = [line.split(separator) for line in text.splitlines()]
    for _ in range(draw(st.integers(1, most))):
        row = draw(st.sampled_from(rows))
        at = draw(st.integers(0, len(row) - 1))
        how = draw(st.sampled_from(["cell", "cell", "cell", "drop", "double", "lines", "drop line", "quote", "more"]))
        if how == "cell":
            row[at] = draw(odd_words)
        elif how == "drop" and len(row) > 1:
            del row[at]
        elif how == "double":
            row.insert(at, row[at])
        elif how == "lines":
            rows.insert(draw(st.integers(0, len(rows))), list(row))
        elif how == "drop line" and len(rows) > 1:
            rows.remove(row)
        elif how == "quote":
            row[at] = '"' + row[at]
        elif how == "more":
            row.extend([draw(odd_words)] * 3)
    return "\n".join(separator.join(row) for row in rows) + "\n"


@st.composite
def bytes_of(draw: st.DrawFn, text: str) -> bytes:
    """The text as bytes: mostly UTF-8 as it should be, else in another encoding, cut, spliced or with bytes changed."""
    how = draw(
        st.sampled_from(["whole"] * 8 + ["bom", "utf-16", "utf-32", "latin-1", "cut", "splice", "flip", "crlf", "tabs"])
    )
    if how in ("utf-16", "utf-32", "latin-1"):
        return text.encode(how, "replace" if how == "latin-1" else "surrogatepass")
    data = text.encode("utf-8", "surrogatepass")
    if how == "bom":
        return b"\xef\xbb\xbf" + data
    if how == "crlf":
        return data.replace(b"\n", draw(st.sampled_from([b"\r\n", b"\r", b"\n\n", b"\x00\n"])))
    if how == "tabs":
        return data.replace(b"  ", b"\t")
    at = draw(st.integers(0, max(len(data) - 1, 0)))
    if how == "cut":
        return data[:at]
    if how == "splice":
        return data[:at] + draw(st.one_of(st.binary(max_size=20), st.sampled_from(SPLICES))) + data[at:]
    if how == "flip":
        return data[:at] + bytes([draw(st.integers(0, 255))]) + data[at + 1 :]
    return data


SPLICES = (
    b"&a ", b"*a ", b"!!python/object/apply:os.system [x]", b"!!int ''", b"!!bool x", b"!!timestamp x", b"!!float ''",
    b"!!set {a, b}", b"!!binary '%%'", b"!!omap [a: 1]", b"<<: *a", b"? ", b"- ", b": ", b"{", b"[", b"'", b'"',
    b"\x00", b"\xff\xfe", b"---\n", b"...\n", b"%YAML 9.9\n", b"&a [*a]", b"2001-99-99", b"0x" + b"f" * 5000,
    b"9" * 5000, b"<", b"]]>", b"<![CDATA[", b"<!DOCTYPE a>", b"&#0;", b"&#10;", b"&x;", b"NaN",
    b"\\ud800", b"[" * 2000, b"{" * 2000,
    b"1:2:3", b"=",
)  # fmt: skip
