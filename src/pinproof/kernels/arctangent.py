r"""The angle of a point, without a conditional branch, so that loops over it are vectorised.

The smaller of \|y\| and \|x\| over the larger is reduced below tan(pi/8) by tan(a - pi/4) = (tan a - 1)/(tan a + 1);
there arctan(r)/r is a polynomial of degree 10 in r^2, interpolated at Chebyshev points with 60 digits: within 3.5e-17.
The octant is then restored. The result agrees with the C library within 5e-16.
"""

from __future__ import annotations

import math
from typing import Any

from pinproof.kernels.compiled import inlined

__all__ = ["angle_of"]

EIGHTH = math.tan(math.pi / 8)
QUARTER_TURN, HALF_TURN = math.pi / 2, math.pi

A0, A1, A2, A3 = 1.0, -0.33333333333328435, 0.19999999998854168, -0.14285714180900647
A4, A5, A6, A7 = 0.11111106177375227, -0.09090773003240828, 0.07689952488233016, -0.066402251735395
A8, A9, A10 = 0.0568830340363325, -0.04347919839046537, 0.021133752033748364


@inlined
def angle_of(y: float, x: float) -> Any:
    """The angle of the point (x, y) in (-pi, pi]; 0 at the origin."""
    up, right = abs(y), abs(x)
    small, large = (right, up) if up > right else (up, right)
    large = 1.0 if large == 0.0 else large
    far = small > EIGHTH * large
    r = (small - large if far else small) / (small + large if far else large)
    z = r * r
    low = A0 + z * (A1 + z * (A2 + z * (A3 + z * (A4 + z * A5))))
    sixth = z * z * z
    sixth = sixth * sixth
    angle = r * (low + sixth * (A6 + z * (A7 + z * (A8 + z * (A9 + z * A10)))))
    angle = angle + (0.5 * QUARTER_TURN if far else 0.0)
    angle = QUARTER_TURN - angle if up > right else angle
    angle = HALF_TURN - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle
