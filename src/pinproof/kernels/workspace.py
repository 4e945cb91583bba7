"""The working arrays of one descent, created once per thread so that no loop allocates.

They are passed as one tuple and unpacked once in each function: an access to a tuple costs an atomic reference count.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pinproof.kernels.chain import whole_vectors
from pinproof.kernels.compiled import compiled

__all__ = [
    "ASKED",
    "BEST",
    "DRIFT",
    "ENDED",
    "HELD",
    "MOVED",
    "PULL",
    "RESIDUAL",
    "STEP",
    "VALUES",
    "Workspace",
    "workspace",
]

# The rows of ``joints``
STEP, MOVED, DRIFT, HELD, BEST, ENDED = range(6)
# The rows of ``errors``
RESIDUAL, PULL, ASKED, VALUES = range(4)


class Workspace(NamedTuple):
    """For m joints on the chain and n numbers in q.

    The rows of ``joints``: the step; its part that is fixed before the rule is evaluated (the step of a goal, and
    joints moved to a limit); the step of the goal; 1 for a joint that is held at a limit; the best q; the result of the
    best attempt. The rows of ``errors``: the residual; the residual passed to the rule; the mask of x, y, z, rx, ry,
    rz; singular values.
    """

    turns: Any  # (3, m or more) values, sines and cosines of the joints
    axes: Any  # (m, 6) their origins and directions
    start: Any  # (3, 4) target_from_base
    end: Any  # (3, 4) target_from_tcp
    jacobian: Any  # (6, n) of the residual; the columns of held joints are zero
    rows: Any  # (6, n) the factor of a decomposition
    square: Any  # (6, 6)
    lower: Any  # (6, 6)
    joints: Any  # (6, n)
    errors: Any  # (4, 6)


@compiled
def workspace(m: int, n: int) -> Any:
    """New arrays."""
    return Workspace(
        np.zeros((3, whole_vectors(m))),
        np.empty((m, 6)),
        np.empty((3, 4)),
        np.empty((3, 4)),
        np.empty((6, n)),
        np.empty((6, n)),
        np.empty((6, 6)),
        np.empty((6, 6)),
        np.empty((6, n)),
        np.empty((4, 6)),
    )
