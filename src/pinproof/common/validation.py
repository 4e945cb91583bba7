"""Validation of settings, of random seeds and of the installed modules."""

from __future__ import annotations

import functools
import importlib
import inspect
import math
import operator
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from numbers import Integral, Real
from typing import Any, NoReturn, TypeVar

import numpy as np

from pinproof.errors import InputError
from pinproof.units import hint_at_unit

Key = TypeVar("Key")
Value = TypeVar("Value")
Kind = TypeVar("Kind", bound=type)

Rng = int | np.random.Generator
"""A seed, or a generator whose state advances."""


def named_arguments(kind: Kind) -> Kind:
    """Make a class raise InputError, with the names of its arguments, if arguments are missing or unknown.

    A decorator of dataclasses whose calls are mistaken easily, such as ``Box([1, 1, 1])`` for ``Box(1, 1, 1)``.
    """
    create: Any = kind.__init__  # type: ignore[misc]  # of the class, not of an instance
    signature = inspect.signature(kind)

    @functools.wraps(create)
    def checked(self: Any, *args: Any, **kwargs: Any) -> None:
        try:
            create(self, *args, **kwargs)
        except TypeError:
            try:
                signature.bind(*args, **kwargs)
            except TypeError as error:
                call = f"{kind.__name__}({', '.join(signature.parameters)})"
                raise InputError(f"{kind.__name__}: {error}; write {call}") from None
            raise

    kind.__init__ = checked  # type: ignore[misc]
    return kind


def require_number(name: str, value: Any, unit: str = "", **bounds: float) -> float:
    """Return a finite number within ``bounds``: ``minimum``, ``above`` (exclusive), ``maximum``, ``below`` (exclusive).

    InputError for anything else; for numbers that are too large it mentions degrees or millimetres.
    """
    beyond = isinstance(value, int) and abs(value) > sys.float_info.max  # math.isfinite raises OverflowError
    number = isinstance(value, Real) and not isinstance(value, bool) and not beyond and math.isfinite(value)
    if number and all(_WITHIN[bound](value, limit) for bound, limit in bounds.items()):
        return float(value)
    valid = " and ".join(
        f"{_BOUND_WORDS[bound]} {limit:.5g}" for bound, limit in bounds.items() if abs(limit) < math.inf
    )
    too_large = number and value > min(bounds.get("maximum", math.inf), bounds.get("below", math.inf))
    hint = hint_at_unit(value, unit) if too_large else ""
    raise InputError(f"{name} must be a finite number{valid and f' {valid}'}, not {value!r}{hint and f'; {hint}'}")


_WITHIN: dict[str, Callable[[float, float], bool]] = {
    "minimum": operator.ge, "above": operator.gt, "maximum": operator.le, "below": operator.lt,
}  # fmt: skip
_BOUND_WORDS = {"minimum": "of at least", "above": "above", "maximum": "at most", "below": "below"}


def require_positive(name: str, value: float, *, zero: bool = False, below: float = math.inf) -> None:
    """Raise InputError unless ``value`` is finite, above 0 (with ``zero`` at least 0) and below ``below``."""
    if type(value) is float and 0.0 < value < below:  # the common case, without the general rules of numbers
        return
    if zero:
        require_number(name, value, minimum=0.0, below=below)
    else:
        require_number(name, value, above=0.0, below=below)


def require_type(name: str, value: object, *kinds: type) -> None:
    """Raise InputError unless ``value`` is an instance of one of the classes."""
    if not isinstance(value, kinds):
        valid = " or ".join("None" if kind is type(None) else kind.__name__ for kind in kinds)
        given = repr(value) if value is None or isinstance(value, (str, int, float)) else type(value).__name__
        raise InputError(f"{name} must be of type {valid}, not {given:.80}")


def require_integer(name: str, value: int, smallest: int | None, largest: int | None = None) -> int:
    """Return an integer from ``smallest`` to ``largest``, where they are stated; InputError for anything else."""
    integer = type(value) is int or (isinstance(value, Integral) and not isinstance(value, bool))
    low, high = -math.inf if smallest is None else smallest, math.inf if largest is None else largest
    if not integer or not low <= value <= high:
        valid = (
            ""
            if smallest is None
            else f" of at least {smallest}"
            if largest is None
            else f" from {smallest} to {largest}"
        )
        raise InputError(f"{name} must be an integer{valid}, not {value!r}")
    return int(value)


def unique_names(what: str, stated: object) -> tuple[str, ...]:
    """Return the names of a name or a list of names; raise InputError for anything else, or if a name is repeated."""
    names = (stated,) if isinstance(stated, str) else tuple(stated) if isinstance(stated, (list, tuple)) else ()
    if not names or not all(isinstance(name, str) and name for name in names):
        raise InputError(f"{what} is {stated!r}; it must be the name of an obstacle or a list of names")
    if len(set(names)) < len(names):
        raise InputError(f"{what} names an obstacle twice: {', '.join(names)}")
    return names


def refuse_repeated(what: str, names: Iterable[str]) -> None:
    """Raise InputError, which lists the names that occur more than once, unless all names are different."""
    if repeated := sorted(name for name, count in Counter(names).items() if count > 1):
        raise InputError(f"the names of {what} must differ; repeated: {', '.join(repeated)}")


def freeze_arrays(owner: object, *names: str) -> None:
    """Replace the array fields ``names`` of a frozen dataclass by read-only copies; None stays None."""
    for name in names:
        value = getattr(owner, name)
        if value is not None:
            array = np.array(value)
            array.setflags(write=False)
            object.__setattr__(owner, name, array)


def random_generator(rng: Rng | np.random.SeedSequence) -> np.random.Generator:
    """Return the generator for a seed; a generator is returned unchanged. InputError for anything else."""
    if isinstance(rng, np.random.Generator):
        return rng
    if not isinstance(rng, np.random.SeedSequence):
        if not isinstance(rng, Integral) or isinstance(rng, bool) or rng < 0:
            raise InputError(f"rng must be an integer of at least 0 or a numpy Generator, not {rng!r}")
        rng = np.random.SeedSequence(int(rng))
    return np.random.Generator(np.random.PCG64(rng))


def seed_sequence(rng: Rng) -> np.random.SeedSequence:
    """Return the seed sequence for independent streams; stream i does not depend on the number of streams."""
    sequence = random_generator(rng).bit_generator.seed_seq
    if not isinstance(sequence, np.random.SeedSequence):
        raise InputError(
            "this Generator has no SeedSequence for independent streams; create it with numpy.random.default_rng"
        )
    return sequence


def optional_module(name: str, use: str, extra: str = "") -> Any:
    """Import a module that not every installation has; InputError states what ``use`` needs, and how to install it."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        need = f"the extra {extra!r}: pip install 'pinproof[{extra}]'" if extra else f"{name}: pip install {name}"
        raise InputError(f"{use} needs {need}") from error


class ReadOnlyDict(dict[Key, Value]):
    """A copy of a mapping that cannot be changed; unlike ``types.MappingProxyType`` it can be pickled.

    Parameters
    ----------
    content
        The mapping.
    remedy
        What to do instead of changing it, for the message of the exception.
    """

    def __init__(self, content: Mapping[Key, Value], remedy: str) -> None:
        super().__init__(content)
        self._remedy = remedy

    def _refuse(self, *_args: object, **_named: object) -> NoReturn:
        raise TypeError(self._remedy)

    __setitem__ = __delitem__ = __ior__ = clear = pop = popitem = setdefault = update = _refuse

    def __reduce__(self) -> tuple[Any, ...]:
        return ReadOnlyDict, (dict(self), self._remedy)
