"""Which limits of a curve are compared, and with which tolerance."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp
from pinproof.motion import CubicPath, check_limits

NAMES = tuple(f"j{k}" for k in range(5))
WAVE = np.sin(np.arange(20.0).reshape(4, 5))


def motion(*, quintic: bool = False) -> pp.Trajectory:
    rates = {"accelerations": np.cos(WAVE)} if quintic else {}
    return pp.Trajectory([0.0, 0.5, 0.8, 1.5], WAVE, np.tan(WAVE), NAMES, **rates)


@pytest.mark.parametrize("seed", range(40))
def test_every_limit_that_is_known_is_compared_and_no_other(seed: int) -> None:
    """All limits are far exceeded, except those that are infinite, unknown, or a default value."""
    rng = np.random.default_rng(seed)
    chance = rng.choice([0.0, 0.3, 1.0], 3)[:, None]
    finite, velocity, acceleration = rng.random((3, 5)) < chance
    lower = np.where(finite & (rng.random(5) < 0.7), -1e-3, -np.inf)
    upper = np.where(finite & (rng.random(5) < 0.7), 1e-3, np.inf)
    guessed = rng.random(5) < rng.choice([0.0, 0.5])
    limits = pp.JointLimits(
        lower, upper, np.where(velocity, 1e-3, np.nan), np.where(acceleration | guessed, 2e-3, np.nan), guessed=guessed
    )
    for curve in (motion(), motion(quintic=True), CubicPath.through(WAVE, NAMES), pp.JointPath(WAVE, NAMES)):
        timed = isinstance(curve, pp.Trajectory)
        rates = {
            "velocity": velocity & timed,
            "acceleration": np.isfinite(limits.acceleration) & ~limits.guessed & timed,
        }
        found = check_limits(curve, limits)
        assert found.checked == ("position", *(name for name, known in rates.items() if known.any()))
        expected = [("position", name, -1e-3) for name, low in zip(NAMES, lower, strict=True) if np.isfinite(low)]
        expected += [("position", name, 1e-3) for name, high in zip(NAMES, upper, strict=True) if np.isfinite(high)]
        for kind, known in rates.items():
            bound = 1e-3 if kind == "velocity" else 2e-3
            expected += [(kind, NAMES[j], bound) for j in np.flatnonzero(known)]
            np.testing.assert_array_equal(getattr(found, kind), np.where(known, bound, np.inf))
        assert sorted((each.quantity, each.joint, each.limit) for each in found.violations) == sorted(expected)


@pytest.mark.parametrize(("excess", "count"), [(5e-7, 0), (2e-6, 5)])
@pytest.mark.parametrize("quintic", [False, True])
def test_the_tolerance_is_absolute_for_positions_and_relative_for_rates(
    excess: float, count: int, quintic: bool
) -> None:
    curve = motion(quintic=quintic)
    low, high = curve.range()
    wide, inf = np.full(5, 1e6), np.full(5, np.inf)
    rates = [top / (1 + excess) for top in (curve.max_velocity(), curve.max_acceleration())]
    for limits in (
        pp.JointLimits(low + excess, inf, wide, wide),
        pp.JointLimits(-inf, high - excess, wide, wide),
        pp.JointLimits(-inf, inf, rates[0], wide),
        pp.JointLimits(-inf, inf, wide, rates[1]),
    ):
        assert len(check_limits(curve, limits).violations) == count


class Polyline:
    """A motion of one joint with constant speeds, of another package."""

    joint_names = ("a",)

    def __init__(self, speeds: tuple[float, ...]) -> None:
        self.speeds, self.duration = np.array(speeds), float(len(speeds))

    def bezier(self) -> tuple[np.ndarray, np.ndarray]:
        q = np.concatenate([[0.0], np.cumsum(self.speeds)])
        return np.arange(len(q), dtype=float), np.stack([q[:-1], q[1:]], axis=1)[:, :, None]

    def __call__(self, t: float) -> np.ndarray:
        return np.interp(np.atleast_1d(t), self.bezier()[0], [0.0, *np.cumsum(self.speeds)])

    def velocity(self, t: float) -> np.ndarray:
        return np.atleast_1d(self.speeds[int(t)])

    @property
    def start(self) -> np.ndarray:
        return self(0.0)

    @property
    def end(self) -> np.ndarray:
        return self(self.duration)

    @property
    def domain(self) -> tuple[float, float]:
        return 0.0, self.duration


@pytest.mark.parametrize(("step", "ok"), [(0.0, True), (0.9e-6, True), (-0.9e-6, True), (1.1e-6, False), (-0.3, False)])
def test_a_jump_of_the_velocity_is_an_infinite_acceleration(step: float, ok: bool) -> None:
    limits = pp.JointLimits([-10.0], [10.0], [5.0], [1.0])
    found = check_limits(Polyline((0.5, 0.5, 0.5 + step, 0.5 + step)), limits)
    assert found.checked == ("position", "velocity", "acceleration")
    assert bool(found.violations) != ok
    for violation in found.violations:
        assert (violation.quantity, violation.joint, violation.time) == ("acceleration", "a", 2.0)
        assert violation.value == np.inf


@pytest.mark.parametrize(("count", "ok"), [(200, True), (4000, False)])
def test_accelerations_that_rounding_explains_are_allowed_while_their_sum_is_negligible(count: int, ok: bool) -> None:
    """Points at 1 rad, a nanosecond apart, speed up with 5000 rad/s^2: after 4 microseconds it is 0.02 rad/s."""
    t = 1e-9 * np.arange(count)
    motion = pp.Trajectory(t, 1.0 + 2500.0 * t[:, None] ** 2, 5000.0 * t[:, None], ("a",))
    found = check_limits(motion, pp.JointLimits([-10.0], [10.0], [5.0], [1.0]))
    assert ("acceleration" in [each.quantity for each in found.violations]) == (not ok)
