"""Quaternions of key frames: equal to SciPy's up to the sign, and without jumps between neighbours."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from pinproof.viewer.stage import quaternions


def test_quaternions_equal_those_of_scipy_up_to_the_sign() -> None:
    rotations = [np.eye(3), np.diag([1.0, -1, -1]), np.diag([-1.0, 1, -1]), np.diag([-1.0, -1, 1])]
    matrices = np.concatenate([rotations, Rotation.random(2000, random_state=0).as_matrix()])
    found, expected = quaternions(matrices), Rotation.from_matrix(matrices).as_quat()
    same = np.sign(np.einsum("ij,ij->i", found, expected))[:, None]
    np.testing.assert_allclose(found * same, expected, atol=1e-12)


def test_neighbouring_quaternions_have_the_same_sign() -> None:
    angles = np.linspace(0, 6 * np.pi, 500)
    matrices = Rotation.from_rotvec(angles[:, None] * np.array([0.6, 0.0, 0.8])).as_matrix()
    found = quaternions(matrices)
    assert np.abs(np.diff(found, axis=0)).max() < 0.05
