"""Compiled loops over plain arrays (numba). Nothing here knows a robot; nothing compiles before it is called.

Modules of this room import numba at their head, so the others import them where they call them.
"""

__all__ = []
