"""Compiled loops over plain arrays (numba), without access to robots; they are compiled at their first call.

The modules of this package import numba at the top. Other packages therefore import them inside functions.
"""

__all__ = []
