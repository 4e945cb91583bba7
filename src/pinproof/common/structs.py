"""Structs of files: a class declares each key once, with its type, unit, range, default and meaning.

::

    @struct("cup", kw_only=True)
    class SuctionCup:
        '''The face of a suction cup.'''

        radius: float = key("radius of the face", "m", above=0)
        gap: float = key("largest distance of its rim from the surface", "m", default=1e-3, above=0)

From the declaration follow the reader with line and column (:meth:`Table.read`), the JSON Schema for editors and the
manual (:func:`json_schema`), the checks of the constructor, and the docstring. The type of a field is its annotation;
``Annotated[type, kind]`` or ``key(kind=...)`` states a :class:`Kind` where the type does not say enough. A
:class:`Table` may also be made of keys without a class; :meth:`Table.write` writes a result as such a mapping. A module
that declares a file with many kinds of values imports this one as ``st``.
"""

from __future__ import annotations

import inspect
import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from enum import Enum
from functools import cached_property
from operator import attrgetter
from pathlib import Path, PurePath
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Annotated, Any, Generic, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from pinproof.common.files import NUMBER_PATTERN, is_file, parse_number
from pinproof.common.validation import require_integer, require_number, require_type
from pinproof.errors import FileError, InputError, UnknownNameError
from pinproof.spatial import SE3, finite, frozen, pose, rigid, unit_vector
from pinproof.units import MOST_TURN, refuse_degrees

Read = TypeVar("Read")
Stated = TypeVar("Stated")

if TYPE_CHECKING:
    from typing_extensions import dataclass_transform

    class Accepting(Generic[Read, Stated]):
        """The type of a field that reads as one type, and that the constructor makes of values of another."""

        def __get__(self, made: object, owner: type | None = None) -> Read: ...
        def __set__(self, made: object, stated: Stated) -> None: ...

    class Reported(Generic[Read]):
        """The type of a property that :func:`reported` declares."""

        fget: Any
        declared: _Declared

        def __init__(self, function: Callable[[Any], Read], *, doc: str | None) -> None: ...
        def __get__(self, made: object, owner: type | None = None) -> Read: ...

else:  # Python 3.10 has no dataclass_transform

    class Accepting:
        """At run time, the type as which the field is read."""

        def __class_getitem__(cls, types: tuple[Any, Any]) -> Any:
            return types[0]

    class Reported(property):
        """A property that is written as a key, with what is stated of it."""

        declared: _Declared

    def dataclass_transform(**_: Any) -> Callable[[Any], Any]:
        """Nothing, at run time."""
        return lambda decorated: decorated


SHOWN = 4
"""Largest number of keys of a mapping that a message shows as they are written."""

DIALECT = "https://json-schema.org/draft/2020-12/schema"

Schema = Mapping[str, Any]
Class = TypeVar("Class", bound=type)


# -- errors with the way to a value -----------------------------------------------------------------------------------


class Misread(InputError):
    """A value of a file that cannot be used.

    Parameters
    ----------
    reason
        What is wrong and what is valid.
    steps
        The keys and indices from the outermost mapping to the value.
    position
        The innermost known position, such as ``"line 3, column 5"``.
    """

    def __init__(self, reason: str, steps: tuple[str | int, ...] = (), position: str = "") -> None:
        self.reason, self.steps, self.position = reason, steps, position
        super().__init__(": ".join(filter(None, (self.place, reason))))

    @property
    def place(self) -> str:
        """The position and the key, such as ``line 3, column 5, key tool[1].box``."""
        key = "".join(f"[{step!r}]" if isinstance(step, int) else step for step in self.steps).lstrip(".")
        return ", ".join(filter(None, (self.position, f"key {key}" if key else "")))


def position(holder: Any, key: object = None) -> str:
    """The line and column of a mapping, or of one of its keys, as far as they are known."""
    return holder.at(key) if hasattr(holder, "at") else ""


def step(name: str | int, where: str, read: Callable[..., Any], *arguments: Any) -> Any:
    """Read a value below another one; an error names the way to it (``.key`` or an index) and its position."""
    try:
        return read(*arguments)
    except Misread as error:
        raise Misread(error.reason, (name, *error.steps), error.position or where) from error
    except InputError as error:
        own = str(name).rpartition(".")[2]
        raise Misread(str(error).removeprefix(f"{own}: "), (name,), where) from error


@contextmanager
def errors_of(path: Path, error: type[FileError], *, keys: bool = True) -> Iterator[None]:
    """Turn errors about values into ``error`` with the file and the place of the value, or its position only."""
    try:
        yield
    except Misread as caught:
        raise error(path, caught.reason, caught.place if keys else caught.position) from caught
    except InputError as caught:
        raise error(path, str(caught)) from caught


def short(value: Any) -> str:
    """A value in a message."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


# -- kinds of values --------------------------------------------------------------------------------------------------

Check = Callable[[str, Any], Any]


@dataclass(frozen=True, eq=False)
class Kind:
    """A kind of value.

    Parameters
    ----------
    schema
        Its JSON Schema, in which tables and definitions may occur.
    check
        The value in Python, checked and normalised; InputError, with the text that names it, if it is refused.
    parse
        The value of a file at a path as a value to check.
    write
        The value in Python as a value for JSON.
    """

    schema: Any
    check: Check
    parse: Callable[[str, Any, Path], Any] = lambda _, stated, __: stated
    write: Callable[[Any], Any] = lambda value: plain(value)

    def read(self, name: str, stated: Any, path: Path) -> Any:
        """The checked value of a value of a file at a path."""
        return self.check(name, self.parse(name, stated, path))


@dataclass(frozen=True, eq=False)
class Definition:
    """A schema with a name, under which it is listed once in ``$defs``."""

    title: str
    value: Schema

    def schema(self) -> Schema:
        """The schema, in which further definitions may occur."""
        return {"title": self.title, **self.value}


def simple(schema: Any, check: Check = lambda _, value: value, parse: Callable[[Any], Any] | None = None) -> Kind:
    """A kind whose values are parsed, if files state them otherwise than Python does, and then checked."""
    return Kind(schema, check) if parse is None else Kind(schema, check, lambda _, stated, __: parse(stated))


def parsed(stated: Any) -> Any:
    """One number, or nested lists of numbers, each as :func:`~pinproof.common.files.parse_number` reads it."""
    try:
        return [parsed(part) for part in stated] if isinstance(stated, list) else parse_number(stated)
    except InputError:
        raise
    except ValueError as error:
        raise InputError(str(error)) from error


BOUNDS = {"minimum": "minimum", "above": "exclusiveMinimum", "maximum": "maximum", "below": "exclusiveMaximum"}
"""The bounds of :func:`~pinproof.common.validation.require_number` in JSON Schema."""

_NUMBER = Definition("number", {"type": ["number", "string"], "pattern": NUMBER_PATTERN})


def number(unit: str = "", *, plain: bool = False, **bounds: float) -> Kind:
    """A number, in YAML also as a text such as ``pi/2`` or ``-3*pi/4``, unless it is ``plain``."""
    limited = {BOUNDS[bound]: value for bound, value in bounds.items()}
    schema: Any = {"type": "number", **limited} if plain else {"$ref": _NUMBER, **limited} if limited else _NUMBER

    def check(name: str, value: Any) -> float:
        return require_number(name, value, unit, **bounds)

    return simple(schema, check, None if plain else parsed)


def integer(smallest: int | None = None, largest: int | None = None) -> Kind:
    """An integer within a range; files may state it as 2.0."""
    limited = {"minimum": smallest, "maximum": largest}
    schema = {"type": "integer", **{bound: value for bound, value in limited.items() if value is not None}}
    whole = lambda stated: int(stated) if isinstance(stated, float) and stated.is_integer() else stated  # noqa: E731
    return simple(schema, lambda name, value: require_integer(name, value, smallest, largest), whole)


def vector(count: int = 3, item: Any = _NUMBER) -> Kind:
    """``count`` finite numbers, as a tuple."""
    schema = {"type": "array", "items": item, "minItems": count, "maxItems": count}
    return simple(schema, lambda name, value: tuple(finite(name, value, (count,)).tolist()), parsed)


def array_of(kind: Kind, shape: tuple[int | None, ...], check: Callable[..., Any] = finite) -> Kind:
    """Nested lists of numbers as a read-only array of a shape; ``check`` makes the array."""

    def frozen_array(name: str, value: Any) -> Any:
        array = check(name, value, shape)
        array.setflags(write=False)
        return array

    return simple(kind.schema, frozen_array, parsed)


def choice(*valid: Any) -> Kind:
    """One of several texts."""

    def check(name: str, value: Any) -> Any:
        if value not in valid:
            raise UnknownNameError(name, value, map(str, valid))
        return value

    return simple({"enum": list(valid)} if len(valid) > 1 else {"const": valid[0]}, check)


def _text(name: str, value: Any) -> str:
    if not isinstance(value, str):
        raise InputError(f"{name} is {short(value)}, not a text; put it in quotes")
    return value


def _name(name: str, value: Any) -> str:
    if not isinstance(value, str) or not value:
        quotes = "; put it in quotes" if isinstance(value, (int, float)) else ""
        raise InputError(f"{name} is {short(value)}, which is not a name{quotes}")
    return value


def _truth(name: str, value: Any) -> bool:
    if not isinstance(value, (bool, np.bool_)):
        raise InputError(f"{name} is {short(value)}; it must be true or false")
    return bool(value)


NUMBER, PLAIN_NUMBER, NOT_NEGATIVE = number(), number(plain=True), number(plain=True, minimum=0)
INTEGER, COUNT = integer(), integer(0)
ANY_TEXT = simple({"type": "string"}, _text)
TEXT = Kind({"type": "string", "minLength": 1}, _name, lambda name, stated, _: _name(name, stated))
BOOLEAN = simple({"type": "boolean"}, _truth)
ANYTHING, NULL = simple({}), simple({"type": "null"})
ANGLE = Definition("angle", {"$ref": _NUMBER, "minimum": -MOST_TURN, "maximum": MOST_TURN})
"""The schema of an angle of an orientation in radians; larger numbers are in degrees."""

DIRECTION = simple({**vector().schema, "contains": {"not": {"enum": [0, "0"]}}}, unit_vector, parsed)
Direction = Annotated[tuple[float, float, float], DIRECTION]
"""The direction of a vector, as a unit vector."""


def list_of(item: Kind | Table, least: int = 0, most: int | None = None, *, named: str = "") -> Kind:
    """A list of values of one kind, as a tuple; ``named``: what they are, if their names must differ."""

    def check(name: str, value: Any) -> tuple[Any, ...]:
        if isinstance(value, str) or not isinstance(value, Iterable):
            raise InputError(f"{name} is {short(value)}, not a list")
        found = tuple(item.check(f"{name}[{index}]", part) for index, part in enumerate(value))
        if not least <= len(found) <= (math.inf if most is None else most):
            valid = str(least) if least == most else f"at least {least}" if most is None else f"{least} to {most}"
            raise InputError(f"{name} has {len(found)} items; it must have {valid}")
        if named:
            twice = [own for own, count in Counter(part.name for part in found).items() if count > 1]
            if twice:
                raise InputError(f"a second {named} is named {twice[0]!r}; their names must differ")
        return found

    def parse(name: str, stated: Any, path: Path) -> list[Any]:
        if not isinstance(stated, list):
            how = "; write '- ' before each element" if isinstance(stated, dict) else ""
            raise InputError(f"{name} is {short(stated)}, not a list{how}")
        found, names = [], set()
        for index, part in enumerate(stated):
            own = part.get("name") if isinstance(part, dict) else None
            where = f"[{own!r}]" if isinstance(own, str) else index
            found.append(step(where, position(part), item.parse, f"{name}[{index}]", part, path))
            if named and own in names:
                raise Misread(f"a second {named} is named {own!r}; their names must differ", (where,), position(part))
            names.add(own)
        return found

    ends = {"minItems": least or None, "maxItems": most}
    limited = {end: count for end, count in ends.items() if count is not None}
    return Kind({"type": "array", "items": item, **limited}, check, parse, lambda value: [item.write(v) for v in value])


def mapping_to(item: Kind | Table, what: str = "names to values") -> Kind:
    """A mapping of names to values of one kind; ``what`` describes it in messages."""

    def check(name: str, value: Any) -> dict[str, Any]:
        require_type(name, value, Mapping)
        return {own: item.check(f"{name}.{own}", part) for own, part in value.items()}

    def parse(name: str, stated: Any, path: Path) -> dict[str, Any]:
        if not isinstance(stated, dict):
            raise InputError(f"{name} holds {short(stated)}, not a mapping of {what}")
        return {
            str(own): step(f".{own}", position(stated, own), item.read, str(own), part, path)
            for own, part in stated.items()
        }

    return Kind(
        {"type": "object", "additionalProperties": item},
        check,
        parse,
        lambda value: {str(own): item.write(part) for own, part in value.items()},
    )


def any_of(*kinds: Kind | Table, check: Check = lambda _, value: value) -> Kind:
    """A value of one of several kinds, in a file the first one whose JSON type it has; ``check`` unites them."""
    texts = [
        kind.schema["const"]
        for kind in kinds
        if isinstance(kind, Kind) and isinstance(kind.schema, dict) and "const" in kind.schema
    ]

    def parse(name: str, stated: Any, path: Path) -> Any:
        kind = next((kind for kind in kinds if _has_type(kind, stated)), kinds[0])
        try:
            return kind.read(name, stated, path)
        except Misread:
            raise
        except InputError as error:
            raise InputError(f"{error}; or write {name}: {texts[0]}" if texts else str(error)) from error

    return Kind({"anyOf": list(kinds)}, check, parse)


def optional(kind: Kind | Table) -> Kind:
    """A value of a kind, or null, as which numbers that are not finite are written."""
    inner: Any = kind.schema if isinstance(kind, Kind) else kind
    simple_type = isinstance(inner, Mapping) and isinstance(inner.get("type"), str)
    schema = {**inner, "type": [inner["type"], "null"]} if simple_type else {"anyOf": [inner, {"type": "null"}]}
    return Kind(
        schema,
        lambda name, value: None if value is None else kind.check(name, value),
        lambda name, stated, path: None if stated is None else kind.parse(name, stated, path),
        lambda value: (
            None if value is None or (isinstance(value, float) and not math.isfinite(value)) else kind.write(value)
        ),
    )


OPTIONAL_NUMBER = optional(PLAIN_NUMBER)

_TYPES: Mapping[str, type | tuple[type, ...]] = {
    "string": str, "number": (int, float), "integer": int, "boolean": bool, "array": list, "object": dict,
    "null": NoneType,
}  # fmt: skip


def _has_type(schema: Any, value: Any) -> bool:
    """Whether a value is of one of the types of JSON of a kind or a schema."""
    if isinstance(schema, Table):
        return isinstance(value, dict)
    if isinstance(schema, (Kind, Definition)):
        return _has_type(schema.schema if isinstance(schema, Kind) else schema.value, value)
    if "anyOf" in schema or "$ref" in schema:
        return any(_has_type(part, value) for part in schema.get("anyOf", [schema.get("$ref")]))
    if "const" in schema or "enum" in schema:
        return value in schema.get("enum", [schema.get("const")])
    kinds = schema.get("type", list(_TYPES))
    return any(isinstance(value, _TYPES[kind]) for kind in ([kinds] if isinstance(kinds, str) else kinds))


def file_of(what: str = "file") -> Kind:
    """The path of a file or folder that exists; relative paths start at the folder of the file that states them."""

    def parse(name: str, stated: Any, path: Path) -> Path:
        found = path.parent / _name(name, stated)
        if not (is_file(found) if what == "file" else found.is_dir()):
            raise InputError(f"there is no {what} {found}; paths are relative to this file")
        return found

    return Kind(TEXT.schema, lambda _, value: Path(value), parse)


# -- keys and tables --------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Key:
    """One key of a mapping in a file.

    Parameters
    ----------
    name
        The key.
    kind
        The kind of its values.
    text
        What the value means, as a phrase or in sentences.
    unit
        Its unit, such as ``"m"``; empty if it has none.
    default
        The value that applies if the key is omitted; None without one.
    required
        Whether the key must be stated.
    argument
        The argument of the class that it becomes; by default that of its name.
    inline
        Whether ``kind`` is a table whose keys belong to the outer mapping; it makes the arguments of the class.
    get
        How its value is taken from a result, for mappings that are written; by default the attribute of its name.
    """

    name: str
    kind: Any
    text: str
    unit: str = ""
    default: Any = None
    required: bool = False
    argument: str = ""
    inline: bool = False
    get: Callable[[Any], Any] | None = None

    def schema(self) -> Schema:
        """The schema of the value, with its description; ``x-unit`` is the unit."""
        value = self.kind.schema if isinstance(self.kind, Kind) else self.kind
        value = {"$ref": value} if isinstance(value, (Table, Definition)) else dict(value)
        value["description"] = self.text
        if self.unit:
            value["x-unit"] = self.unit
        if self.default is not None:
            value["default"] = self.default
        return value


def required(name: str, kind: Any, text: str, unit: str = "", get: Callable[[Any], Any] | None = None) -> Key:
    """A key that must be stated, and is always written."""
    return Key(name, kind, text, unit, required=True, get=get)


def without(*names: str) -> Schema:
    """The rule of a schema that excludes some keys."""
    return {"not": {"anyOf": [{"required": [name]} for name in names]}}


class Table:
    """The keys of one kind of mapping.

    Parameters
    ----------
    title
        Its name, such as ``"obstacle"``.
    text
        What it describes.
    keys
        The keys in the order of the manual.
    rules
        Further rules of JSON Schema, such as ``oneOf``.
    more
        Whether other keys are allowed, as additions of the same version.
    make
        What is made of the values by argument: the class, or a dictionary.
    """

    def __init__(
        self,
        title: str,
        text: str,
        *keys: Key,
        rules: Schema | None = None,
        more: bool = False,
        make: Callable[..., Any] = dict,
    ) -> None:
        self.title, self.text, self.keys, self.more, self.make = title, text, keys, more, make
        self.rules: Schema = rules or {}
        flat: dict[str, Key] = {}  # a key that becomes two arguments is described once
        for key in keys:
            for each in key.kind.flat if key.inline else (key,):
                flat.setdefault(each.name, each)
        self.flat = tuple(flat.values())
        self.names, self.required = tuple(flat), tuple(key.name for key in self.flat if key.required)

    def schema(self) -> Schema:
        """The schema of the mapping, in which further tables may occur."""
        stated: dict[str, Any] = {"description": self.text, "type": "object"}
        if self.required:
            stated["required"] = list(self.required)
        stated["properties"] = {key.name: key.schema() for key in self.flat}
        if not self.more:
            stated["additionalProperties"] = False
        for rules in (*(key.kind.rules for key in self.keys if key.inline), self.rules):
            stated |= rules
        return stated

    def check(self, name: str, value: Any) -> Any:
        """The value, which is of the class that is made."""
        if isinstance(self.make, type):
            require_type(name, value, self.make)
        return value

    def parse(self, name: str, stated: Any, path: Path) -> Any:
        """What is made of a mapping of the file at a path; InputError, with the position if it is known."""
        return self.made(stated, self.values(name, stated, path))

    read = parse

    def made(self, stated: Any, values: Mapping[str, Any]) -> Any:
        """What is made of the values of a mapping; errors about an argument name its key and position."""
        try:
            return self.make(**values)
        except Misread:
            raise
        except InputError as error:
            key = next((key.name for key in self.keys if key.argument and key.argument == error.argument), "")
            if not key or key not in stated:
                raise
            raise Misread(str(error), (f".{key}",), position(stated, key)) from error

    def values(self, name: str, stated: Any, path: Path, *, part: bool = False) -> dict[str, Any]:
        """The values that a mapping states, by argument; ``part``: other keys of the mapping are ignored.

        The constructor of a struct checks them; others are checked here.
        """
        if not isinstance(stated, dict):
            how = f"write {name}: {{{', '.join(f'{key}: ...' for key in self.names)}}}"
            how = how if len(self.names) <= SHOWN else f"valid keys: {', '.join(self.names)}"
            raise InputError(f"{name} holds {short(stated)}, not a mapping; {how}")
        if not part:
            self.refuse_unknown(stated)
        if missing := [key for key in self.flat if key.required and key.name not in stated]:
            meaning = f" ({missing[0].text})" if len(missing) == 1 else ""
            raise InputError(f"{name} does not state {' and '.join(key.name for key in missing)}{meaning}")
        # The constructor of a struct checks its values; those of other tables are checked while they are read
        values: dict[str, Any] = {}
        checks = hasattr(getattr(self.make, "func", self.make), "_struct")
        for key in self.keys:
            # An inline table reads several keys of this mapping, and makes one or several arguments of them
            if key.inline:
                made = key.kind.make(**key.kind.values(name, stated, path, part=True))
                values |= made if isinstance(made, dict) else {key.argument: made}
            elif key.name in stated:
                read = key.kind.parse if checks else key.kind.read
                where = position(stated, key.name)
                values[key.argument or key.name] = step(f".{key.name}", where, read, key.name, stated[key.name], path)
        return values

    def refuse_unknown(self, stated: Mapping[Any, Any]) -> None:
        """Raise Misread for the first key of a mapping that is not in the table."""
        for key in () if self.more else stated:
            if key not in self.names:
                comma = "; use a decimal point, not a comma" if isinstance(key, int) else ""
                reason = f"{UnknownNameError('key', key, self.names or ('none',))}{comma}"
                raise Misread(reason, (f".{key}",), position(stated, key))

    def write(self, result: Any) -> dict[str, Any]:
        """The values of a result as a mapping for JSON."""
        written: dict[str, Any] = {}
        for key in self.keys:
            value = key.kind.write(key.get(result) if key.get else getattr(result, key.argument or key.name))
            written |= value if key.inline else {key.name: value}
        return written


def report_table(title: str, text: str, *keys: Key, rules: Schema | None = None) -> Table:
    """The keys of a mapping in a report of this program, in which a later release may add keys."""
    return Table(title, text, *keys, rules=rules, more=True)


def schema_version(name: str) -> Key:
    """The key that states the version of a format."""
    return required("schema", choice(name), "version of the format", get=lambda _: name)


def plain(value: Any) -> Any:
    """A value for JSON: structs as mappings, arrays and tuples as lists."""
    if value is None or isinstance(value, (bool, str, int)):
        return value
    if isinstance(value, float):
        return float(value)
    if isinstance(value, (Enum, PurePath)):
        return value.value if isinstance(value, Enum) else value.as_posix()
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(name): plain(part) for name, part in value.items()}
    if isinstance(value, Iterable):
        return [plain(part) for part in value]
    return table_of(type(value)).write(value)


def pose_of(xyz: Any = (0.0, 0.0, 0.0), rpy: Any = None, quat_xyzw: Any = None) -> SE3:
    """The pose of the keys that a file states, unless the angles are clearly in degrees."""
    refuse_degrees("rpy", rpy or ())
    return pose(xyz, rpy, quat_xyzw=quat_xyzw)


ONE_ORIENTATION: Schema = {"not": {"required": ["rpy", "quat_xyzw"]}}

POSE = Table(
    "pose",
    "A position and an orientation.",
    Key("xyz", vector(), "position x, y, z", "m", [0, 0, 0]),
    Key(
        "rpy", vector(item=ANGLE), "roll, pitch, yaw about fixed axes: R = Rz(yaw) Ry(pitch) Rx(roll)", "rad", [0, 0, 0]
    ),
    Key("quat_xyzw", vector(4), "a quaternion, scalar last, instead of `rpy`; it is normalised"),
    rules=ONE_ORIENTATION,
    make=pose_of,
)

TRANSFORM = Kind(POSE, lambda name, value: frozen(rigid(name, value)), POSE.parse)
"""A rigid transform, which files state as a pose."""


# -- classes ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Declared:
    """What a class states of a field beside its type and its default; see :func:`key`."""

    text: str
    unit: str
    name: str
    kind: Any
    inline: Table | None
    hidden: bool
    required: bool
    shown: Any
    bounds: Mapping[str, Any]
    added: bool = False


def key(
    text: str,
    unit: str = "",
    *,
    default: Any = MISSING,
    default_factory: Any = MISSING,
    kw_only: Any = MISSING,
    name: str = "",
    kind: Kind | Table | None = None,
    inline: Table | None = None,
    hidden: bool = False,
    required: bool = False,
    shown: Any = MISSING,
    added: bool = False,
    compare: bool = True,
    **bounds: Any,
) -> Any:
    """Declare a field of a :func:`struct`, and the key of files that states it.

    Parameters
    ----------
    text, unit
        What it means, as a phrase or in sentences, and its unit.
    default, default_factory, kw_only, compare
        As for a field of a dataclass.
    required
        Whether files must state it although it has a default; without one, they must.
    shown
        The default in the manual, if it is not that of the class; None for none.
    added
        Whether files of the same version that were written before may lack it.
    name
        The key, by default the name of the field.
    kind
        The kind of its values, by default that of its type.
    inline
        A table of several keys beside the others, from which the field is made.
    hidden
        Whether no key of a file states it; it is then checked only if its ``kind`` is stated.
    **bounds
        The range of a number (``minimum``, ``above``, ``maximum``, ``below``), or of the length of a list (``least``,
        ``most``).
    """
    declared = _Declared(text, unit, name, kind, inline, hidden, required, shown, bounds, added)
    options = {"default": default, "default_factory": default_factory, "kw_only": kw_only, "compare": compare}
    return field(metadata={"declared": declared}, **options)


def reported(
    unit: str = "", *, name: str = "", kind: Kind | Table | None = None, **bounds: Any
) -> Callable[[Callable[[Any], Read]], Reported[Read]]:
    """Declare a property of a :func:`struct` that is written as a key, whose text is the docstring.

    The parameters are those of :func:`key`.
    """

    def decorated(function: Callable[[Any], Read]) -> Reported[Read]:
        text = " ".join(inspect.cleandoc(function.__doc__ or "").split()).removesuffix(".")
        text = text if text[1:2].isupper() else text[:1].lower() + text[1:]
        made: Any = Reported(function, doc=f"{unit}: {function.__doc__}" if unit else function.__doc__)
        made.declared = _Declared(text.replace("``", "`"), unit, name, kind, None, False, True, MISSING, bounds)
        return made

    return decorated


@dataclass(frozen=True, eq=False)
class Rule:
    """A relation of several keys.

    Parameters
    ----------
    keys
        The fields; errors are reported at the first.
    broken
        The reason for which a value breaks it; empty if it is kept.
    schema
        The rule in JSON Schema, as far as it can be stated there.
    """

    keys: tuple[str, ...]
    broken: Callable[[Any], str]
    schema: Schema = field(default_factory=dict)


@dataclass_transform(frozen_default=True, field_specifiers=(key, field))
def struct(
    title: str = "",
    *,
    rules: Sequence[Rule | Schema] = (),
    first: Sequence[str] = (),
    written: bool = False,
    version: str = "",
    **options: Any,
) -> Callable[[Class], Class]:
    """Make a class a frozen dataclass whose fields are declared with :func:`key`.

    The constructor checks and normalises every value, then the rules. The docstring describes the mapping; the
    meaning of the fields is appended to it.

    Parameters
    ----------
    title
        The name of the mapping in schemas and in the manual.
    rules
        Relations of several keys, or rules of JSON Schema only.
    first
        Keys that come first in the manual, in this order.
    written
        Whether such mappings are only written, in JSON; values are then not checked, and a later release may add keys.
        Properties may be :func:`reported` as well.
    version
        The value of the key ``schema``, which comes first; empty for none.
    **options
        Those of :func:`dataclasses.dataclass`.
    """

    def decorated(cls: Class) -> Class:
        further = cls.__dict__.get("__post_init__")
        # A subclass that states another default of a field keeps its declaration
        for name, inherited in getattr(cls, "__dataclass_fields__", {}).items():
            default = cls.__dict__.get(name, MISSING)
            if name in inspect.get_annotations(cls) and not isinstance(default, Field | type(MISSING)):
                setattr(cls, name, field(default=default, metadata=inherited.metadata))

        def __post_init__(self: Any) -> None:
            own = getattr(self, "name", None)
            of = f" of {title.replace('_', ' ')} {own!r}" if isinstance(own, str) and own else ""
            for name, kind, label in made._struct.labelled:
                given = getattr(self, name)
                try:
                    value = kind.check(f"{name}{of}" if of else label, given)
                except InputError as error:
                    error.argument = name
                    raise
                if value is not given:
                    object.__setattr__(self, name, value)
            # Relations of several keys come after the keys themselves, so that they compare valid values
            for rule in rules:
                if isinstance(rule, Rule) and (reason := rule.broken(self)):
                    broken = InputError(f"{cls.__name__}{of} {reason}")
                    broken.argument = rule.keys[0]
                    raise broken
            if further:
                further(self)

        # Results that are only written are made by this program, so their values are not checked
        if not written:
            cls.__post_init__ = __post_init__  # type: ignore[attr-defined]
        made: Any = dataclass(frozen=True, **options)(cls)
        about, made.__doc__ = _documented(made)
        made._struct = _Struct(made, title, about, rules, first, version, written)
        return made

    return decorated


@dataclass_transform(frozen_default=True, field_specifiers=(key, field))
def described(**options: Any) -> Callable[[Class], Class]:
    """Make a class a frozen dataclass that no file contains; the docstring lists the fields as :func:`key` states them.

    The options are those of :func:`dataclasses.dataclass`.
    """
    return struct(written=True, **options)


@dataclass(frozen=True, eq=False)
class _Struct:
    """What follows from the declaration of a class; made when needed, because annotations may name later classes."""

    cls: Any
    title: str
    about: str
    rules: Sequence[Rule | Schema]
    first: Sequence[str]
    version: str
    written: bool

    @cached_property
    def kinds(self) -> dict[str, Any]:
        """The kind of each field."""
        hints, kinds = get_type_hints(self.cls, include_extras=True), {}
        for each in fields(self.cls):
            own = each.metadata.get("declared")
            if own is None or (not own.kind and (own.hidden or (own.inline and self.written))):
                continue
            kind = _kind_of(hints[each.name], own, written=self.written)
            if each.default == "" and kind is TEXT:  # files omit a text that a class has as empty
                kind = Kind(TEXT.schema, ANY_TEXT.check, TEXT.parse)
            kinds[each.name] = kind
        return kinds

    @cached_property
    def labelled(self) -> list[tuple[str, Any, str]]:
        """The name and the kind of each field, and how messages name it."""
        return [(name, kind, f"{self.cls.__name__}.{name}") for name, kind in self.kinds.items()]

    @cached_property
    def table(self) -> Table:
        """The keys of the mappings that state it."""
        keys = []
        # The fields that are keys
        for each in fields(self.cls):
            own = each.metadata.get("declared")
            if own is None or own.hidden:
                continue
            made = each.default_factory() if each.default_factory is not MISSING else each.default
            needed = made is MISSING or own.required or (self.written and not own.added)
            shown = None if needed or self.written or (isinstance(made, str) and not made) else _shown(made)
            key = Key(
                own.name or each.name, own.inline or self.kinds[each.name], own.text, own.unit,
                shown if own.shown is MISSING else own.shown, needed, each.name, own.inline is not None,
            )  # fmt: skip
            keys.append(key)
        named = {name: value for base in self.cls.__mro__[::-1] for name, value in vars(base).items()}
        for name, value in named.items():
            if isinstance(value, Reported):
                hint = get_type_hints(value.fget, include_extras=True)["return"]
                own = value.declared
                kind = _kind_of(hint, own, written=True)
                keys.append(required(own.name or name, kind, own.text, own.unit, attrgetter(name)))
        # The order of the manual
        keys.sort(key=lambda key: self.first.index(key.name) if key.name in self.first else len(self.first))
        # Rules of the schema; a later one of the same name replaces an earlier one
        schemas = [rule.schema if isinstance(rule, Rule) else rule for rule in self.rules]
        rules = {name: rule for schema in schemas for name, rule in schema.items()}
        text = " ".join(self.about.replace("``", "`").split())
        if self.version:
            keys.insert(0, schema_version(self.version))
        return Table(self.title, text, *keys, rules=rules, more=self.written, make=self.cls)


def table_of(struct: Any) -> Table:
    """The keys of the mappings that state a struct."""
    table: Table = struct._struct.table
    return table


def _kind_of(hint: Any, own: _Declared, *, written: bool) -> Any:
    """The kind of the values of a type."""
    # A stated kind applies; the kind of an optional value is that of the other type, or null
    origin, inner = get_origin(hint), get_args(hint)
    if own.kind is not None and (written or NoneType not in inner):
        return own.kind
    if origin in (Union, UnionType) and NoneType in inner:
        found = _kind_of(Union[tuple(set(inner) - {NoneType})], own, written=written)  # noqa: UP007
        if written:
            return optional(found)
        schema = found if isinstance(found, Table) else found.schema
        return Kind(schema, lambda name, value: None if value is None else found.check(name, value), found.parse)
    # Types that state their kind, structs, and collections of them
    if origin is Annotated:
        return next(each for each in inner[1:] if isinstance(each, (Kind, Table)))
    if hasattr(hint, "_struct"):
        return table_of(hint)
    if origin is tuple and inner[-1] is Ellipsis:
        return list_of(_kind_of(inner[0], own, written=written), **own.bounds)
    if origin is tuple:
        return vector(len(inner), {"type": "number"} if written else _NUMBER)
    if origin is Mapping:
        return mapping_to(_kind_of(inner[1], own, written=written))
    if origin is Literal:
        return choice(*inner)
    # Plain types
    if isinstance(hint, type) and issubclass(hint, Enum):
        return choice(*(member.value for member in hint))
    if hint is float:
        return number(own.unit, plain=written, **own.bounds)
    kinds = {SE3: TRANSFORM, bool: BOOLEAN, str: ANY_TEXT if written else TEXT, int: integer(own.bounds.get("minimum"))}
    return kinds[hint]


def _shown(default: Any) -> Any:
    """A default as a value of JSON."""
    if isinstance(default, tuple):
        return [_shown(each) for each in default]
    return {} if isinstance(default, (Mapping, SE3)) or is_dataclass(default) else default


def _documented(cls: Any) -> tuple[str, str]:
    """The description of a struct, and its docstring with the meaning of the fields."""
    # The sections that the class states itself follow the list of fields
    heads = r"\n(?=(?:Attributes|Raises|Notes|References)\n---)"
    about, *sections = re.split(heads, inspect.cleandoc(cls.__doc__), maxsplit=1)
    lines = [about.rstrip(), "", "Parameters", "----------"]
    for each in fields(cls):
        if own := each.metadata.get("declared"):
            text = re.sub(r"\[([^\]]+)\]\([^)]*\)", r"\1", own.text)  # links of the manual
            text = re.sub(r"(:\w+:`[^`]*`|``[^`]*``)|`([^`]+)`", lambda code: code[1] or f"``{code[2]}``", text)
            text = f"{own.unit}: {text}" if own.unit else text[:1].upper() + text[1:]
            lines += [each.name, f"    {text}{'' if text.endswith('.') else '.'}"]
    return about, "\n".join([*lines, *(f"\n{section}" for section in sections)])


# -- JSON Schema ------------------------------------------------------------------------------------------------------


def json_schema(table: Table) -> dict[str, Any]:
    """The complete JSON Schema (draft 2020-12) of the files that a table describes."""
    definitions: dict[str, Any] = {}

    def resolved(value: Any) -> Any:
        """The value with references in place of the tables and definitions in it, which are listed once."""
        if isinstance(value, Kind):
            value = value.schema
        if isinstance(value, (Table, Definition)):
            if value.title not in definitions:
                definitions[value.title] = {}  # a table may contain itself
                definitions[value.title] = resolved(value.schema())
            return {"$ref": f"#/$defs/{value.title}"}
        if isinstance(value, Mapping):
            found = {key: resolved(part) for key, part in value.items()}
            return {**found, **found["$ref"]} if isinstance(found.get("$ref"), dict) else found
        return [resolved(part) for part in value] if isinstance(value, (list, tuple)) else value

    # The definitions are complete only after the root is resolved
    root = resolved(table.schema())
    return {"$schema": DIALECT, "title": table.title, **root, "$defs": dict(sorted(definitions.items()))}
