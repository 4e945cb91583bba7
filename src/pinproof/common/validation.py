"""Checks of settings and of randomness, with messages that name them."""

from __future__ import annotations

import math
from numbers import Integral, Real

import numpy as np

from pinproof.errors import InputError

__all__ = ["Rng", "positive", "random_generator", "seed_sequence", "whole"]

Rng = int | np.random.Generator
"""A seed, or a generator that is drawn from."""


def positive(name: str, value: float, *, zero: bool = False, below: float = math.inf) -> None:
    """Refuse what is not a finite number above 0 (or, with ``zero``, not below) and below ``below``."""
    number = isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
    if not number or value < 0 or (value == 0 and not zero) or value >= below:
        end = "" if below == math.inf else f" and below {below:g}"
        raise InputError(f"{name} must be a finite number {'of at least' if zero else 'above'} 0{end}, not {value!r}")


def whole(name: str, value: int, smallest: int) -> None:
    """Refuse what is not a whole number of at least ``smallest``."""
    if not isinstance(value, Integral) or isinstance(value, bool) or value < smallest:
        raise InputError(f"{name} must be a whole number of at least {smallest}, not {value!r}")


def random_generator(rng: Rng | np.random.SeedSequence) -> np.random.Generator:
    """The generator for a seed; a generator is handed back as it is.

    Raises
    ------
    InputError
        If it is neither.
    """
    if isinstance(rng, np.random.Generator):
        return rng
    if not isinstance(rng, np.random.SeedSequence):
        if not isinstance(rng, Integral) or isinstance(rng, bool) or rng < 0:
            raise InputError(f"rng must be a whole number of at least 0 or a numpy Generator, not {rng!r}")
        rng = np.random.SeedSequence(int(rng))
    return np.random.Generator(np.random.PCG64(rng))


def seed_sequence(rng: Rng) -> np.random.SeedSequence:
    """What independent streams are spawned from: child i is the same however many there are."""
    sequence = random_generator(rng).bit_generator.seed_seq
    if not isinstance(sequence, np.random.SeedSequence):
        raise InputError(
            "this Generator has no SeedSequence to spawn streams from; make it with numpy.random.default_rng"
        )
    return sequence
