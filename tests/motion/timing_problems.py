"""Paths and limits for the tests of timing, and what every timed motion must hold."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pinproof.motion import BlendedPath, CubicPath, JointPath

RELATIVE = 1 + 1e-9


def limits_of(velocity, acceleration, **others):
    return SimpleNamespace(velocity=np.array(velocity, float), acceleration=np.array(acceleration, float), **others)


def names(n):
    return tuple(f"joint_{i}" for i in range(n))


TWO_TO_SIX = st.integers(2, 6)
SIZES = st.sampled_from([1e-3, 1.0, 1e3])  # hair, arm, gantry


@st.composite
def problems(draw, points=TWO_TO_SIX, size=SIZES):
    """Waypoints (m, n) of 1 to 8 joints, each joint with its own scale, and limits that differ between joints."""
    n, m = draw(st.integers(1, 8)), draw(points)
    scale = np.array(draw(st.lists(size, min_size=n, max_size=n)))
    q = draw(arrays(float, (m, n), elements=st.floats(-3, 3, allow_subnormal=False))) * scale
    rate = arrays(float, n, elements=st.floats(0.1, 10))
    return JointPath(q, names(n)), limits_of(draw(rate) * scale, draw(rate) * scale)


@st.composite
def smooth_problems(draw):
    n, m = draw(st.integers(1, 8)), draw(st.integers(2, 12))
    size = draw(st.sampled_from([1e-4, 0.03, 0.5]))
    phase, weight = (draw(arrays(float, n, elements=st.floats(-3, 3))) for _ in range(2))
    s = np.linspace(0, 1, m)
    q = size * (np.sin(2 * s[:, None] + phase) + (1 + weight) * s[:, None])
    rate = arrays(float, n, elements=st.floats(0.3, 5))
    return CubicPath.through(q, names(n), s), limits_of(draw(rate), draw(rate))


@st.composite
def rounded_problems(draw):
    """A path of straight stretches, the same with some of its corners rounded, and limits."""
    n, m = draw(st.integers(2, 8)), draw(st.integers(3, 7))
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    steps = rng.normal(size=(m - 1, n))
    length = rng.uniform(0.05, 2, m - 1)
    q = np.concatenate(
        [np.zeros((1, n)), np.cumsum(steps / np.linalg.norm(steps, axis=1)[:, None] * length[:, None], 0)]
    )
    direction = np.diff(q, axis=0) / np.linalg.norm(np.diff(q, axis=0), axis=1)[:, None]
    reach = np.zeros(m)
    reach[1:-1] = rng.uniform(0, 0.5, m - 2) * np.minimum(length[:-1], length[1:]) * (rng.random(m - 2) < 0.8)
    reach[1:-1][np.linalg.norm(direction[:-1] + direction[1:], axis=1) < 0.2] = 0.0
    path = JointPath(q, names(n))
    return path, BlendedPath.rounded(path, reach), limits_of(rng.uniform(0.5, 4, n), rng.uniform(1, 15, n))


def assert_within(trajectory, limits, jerk=None):
    assert (trajectory.max_velocity() <= limits.velocity * RELATIVE).all()
    assert (trajectory.max_acceleration() <= limits.acceleration * RELATIVE).all()
    if jerk is not None:
        assert trajectory.interpolant == "quintic"
        assert (trajectory.max_jerk() <= jerk * RELATIVE).all()
    if trajectory.duration > 1e-3:  # finite differences, which know nothing of the polynomials
        t = np.linspace(0, trajectory.duration, 2001)
        step = t[1] - t[0]
        q = trajectory(t)
        rounding = 8 * np.finfo(float).eps * np.abs(q).max(axis=0)
        assert (np.abs(np.diff(q, axis=0)) / step <= limits.velocity * RELATIVE + rounding / step).all()
        second = np.abs(np.diff(q, 2, axis=0)) / step**2
        assert (second <= limits.acceleration * 1.000001 + 4 * rounding / step**2).all()
        if jerk is not None:
            third = np.abs(np.diff(q, 3, axis=0)) / step**3
            assert (third <= jerk * 1.000001 + 8 * rounding / step**3).all()


def distance_to_polyline(points, q):
    """(N,) largest coordinate's distance of each point to the nearest segment."""
    a, d = q[:-1].T, np.diff(q, axis=0).T
    square = np.maximum((d * d).sum(axis=0), np.finfo(float).tiny)
    columns = list(zip(points.T[:, :, None], a, d, strict=True))  # joint by joint, which fits into a cache
    s = np.clip(sum((p - own) * step for p, own, step in columns) / square, 0, 1)
    farthest = np.zeros_like(s)
    for p, own, step in columns:
        np.maximum(farthest, np.abs(p - (own + s * step)), out=farthest)
    return farthest.min(axis=1)


def assert_on_path(trajectory, path, tolerance):
    fine = path(np.linspace(*path.domain, 3000))
    samples = trajectory(np.linspace(0, trajectory.duration, 120))
    chord = np.abs(np.diff(fine, n=2, axis=0)).max()  # how far the fine polyline itself is from the path
    # the tolerance is one a joint; the nearest point in the Euclidean sense may be off by sqrt(n) of it in one
    assert distance_to_polyline(samples, fine).max() <= tolerance * np.sqrt(len(path.joint_names)) + chord
