"""The motion of a vehicle along a line: distance, speed and acceleration as exact functions of time.

A motion is a chain of phases of constant jerk, so ``s(t)`` is a piecewise cubic with continuous acceleration, and
``v`` and ``a`` are its derivatives. A change of speed is an S-curve: jerk ``+j``, constant acceleration, jerk ``-j``.
For ``dv = |v2 - v1|`` it takes

    T = dv/a + a/j  where dv >= a^2/j,  else  T = 2 sqrt(dv/j),

and, by symmetry, covers the distance ``(v1 + v2)/2 T``. The vehicle turns round only at rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import PPoly

from trackfg.numerics.arrays import Array

Phase = tuple[float, float]
"""A duration in s and a jerk in m/s^3."""

_INSTANT_S = 1e-9
"""A shorter phase is left out, s: rounding."""
_REST_MPS = 1e-9
"""Phases shorter and speeds lower than these are rounding: at rest means exactly at rest."""


@dataclass(frozen=True)
class Limits:
    """The limits that the driver keeps to: acceleration (both ways), m/s^2, and jerk, m/s^3."""

    acceleration_mps2: float
    jerk_mps3: float


@dataclass(frozen=True)
class DrivenMotion:
    """Distance along the line over time. ``distance`` is a piecewise cubic from t = 0; no piece turns round inside."""

    distance: PPoly

    @property
    def duration_s(self) -> float:
        """Return the end of the last phase."""
        return float(self.distance.x[-1])

    @property
    def breaks_s(self) -> Array:
        """Return where the jerk jumps. Shape (n + 1,) for n phases."""
        return np.asarray(self.distance.x)

    @cached_property
    def speed(self) -> PPoly:
        """Return signed speed, m/s, as a function of time."""
        return self.distance.derivative()

    @cached_property
    def acceleration(self) -> PPoly:
        """Return acceleration along the line, m/s^2, as a function of time."""
        return self.distance.derivative(2)

    @cached_property
    def path(self) -> PPoly:
        """Return the distance travelled whichever way, m, from 0 at t = 0."""
        coefficients = self.distance.c.copy()
        ends = self.distance(self.breaks_s)
        coefficients *= np.where(np.diff(ends) < 0, -1.0, 1.0)
        coefficients[3] = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(ends)))[:-1]])
        return PPoly(coefficients, self.distance.x)

    def times_at(self, s: Array) -> tuple[Array, Array]:
        """Return every time at which the vehicle passes one of the places ``s``, and which: (times, indices), sorted by
        time.

        Bisection within each phase, where the distance is monotonic. A place at which the vehicle stands counts once.
        """
        order = np.argsort(s)
        places = np.asarray(s, dtype=np.float64)[order]
        ends = self.distance(self.breaks_s)
        low, high = np.minimum(ends[:-1], ends[1:]), np.maximum(ends[:-1], ends[1:])
        first = np.searchsorted(places, low, side="right")
        count = np.maximum(np.searchsorted(places, high, side="right") - first, 0)
        piece = np.repeat(np.arange(len(count)), count)
        index = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count) + first[piece]
        lower, upper = self.breaks_s[piece], self.breaks_s[piece + 1]
        rising = ends[piece + 1] > ends[piece]
        for _ in range(60 if len(piece) else 0):
            middle = 0.5 * (lower + upper)
            later = (self.distance(middle) < places[index]) == rising
            lower, upper = np.where(later, middle, lower), np.where(later, upper, middle)
        times = 0.5 * (lower + upper)
        by_time = np.argsort(times)
        return times[by_time], order[index[by_time]]


def motion(phases: Sequence[Phase], start_m: float, start_mps: float = 0.0) -> DrivenMotion:
    """Return the motion that goes through ``phases`` from the place ``start_m`` at ``start_mps``, without
    acceleration.
    """
    durations, jerks = np.array([phase for phase in phases if phase[0] > _INSTANT_S]).T
    breaks = np.concatenate([[0.0], np.cumsum(durations)])
    acceleration = np.concatenate([[0.0], np.cumsum(jerks * durations)])[:-1]
    speed_steps = acceleration * durations + jerks * durations**2 / 2
    speed = start_mps + np.concatenate([[0.0], np.cumsum(speed_steps)])[:-1]
    speed[np.abs(speed) < _REST_MPS] = 0.0
    steps = speed * durations + acceleration * durations**2 / 2 + jerks * durations**3 / 6
    place = start_m + np.concatenate([[0.0], np.cumsum(steps)])[:-1]
    return DrivenMotion(PPoly(np.stack([jerks / 6, acceleration / 2, speed, place]), breaks))


def rest(duration_s: float) -> list[Phase]:
    """Return phases of standing still, or of going on at the speed there is."""
    return [(duration_s, 0.0)]


def change_time(v1: float, v2: float, limits: Limits) -> float:
    """Return how long the S-curve from ``v1`` to ``v2`` takes, s."""
    dv, a, j = abs(v2 - v1), limits.acceleration_mps2, limits.jerk_mps3
    return float(dv / a + a / j if dv >= a * a / j else 2.0 * np.sqrt(dv / j))


def change_distance(v1: float, v2: float, limits: Limits) -> float:
    """Return how far the S-curve from ``v1`` to ``v2`` goes, m."""
    return 0.5 * (v1 + v2) * change_time(v1, v2, limits)


def change(v1: float, v2: float, limits: Limits) -> list[Phase]:
    """Return the S-curve from ``v1`` to ``v2``."""
    dv, a, j = abs(v2 - v1), limits.acceleration_mps2, limits.jerk_mps3
    if dv == 0.0:
        return []
    ramp = min(a / j, float(np.sqrt(dv / j)))
    constant = dv / (j * ramp) - ramp
    jerk = j if v2 > v1 else -j
    return [(ramp, jerk), (constant, 0.0), (ramp, -jerk)]


def run(lengths_m: Array, limits_mps: Array, end_speeds: tuple[float, float], limits: Limits) -> list[Phase]:
    """Run along stretches of given lengths (n,) and speed limits (n,), as fast as the limits let.

    ``end_speeds`` are those at the start and at the end. The speed at each boundary is the greatest from which the ones
    around it can be reached (one pass each way); within a stretch the vehicle accelerates, holds, brakes. Raises
    ``ValueError`` where even that does not fit.
    """
    n = len(lengths_m)
    boundary = np.empty(n + 1)
    boundary[0], boundary[-1] = end_speeds
    boundary[1:-1] = np.minimum(limits_mps[:-1], limits_mps[1:])
    for i in range(n - 1, 0, -1):
        boundary[i] = _reachable(boundary[i + 1], boundary[i], lengths_m[i], limits)
    for i in range(n - 1):
        boundary[i + 1] = _reachable(boundary[i], boundary[i + 1], lengths_m[i], limits)
    phases: list[Phase] = []
    for length, limit, v1, v2 in zip(lengths_m, limits_mps, boundary[:-1], boundary[1:], strict=True):
        phases += _stretch(float(length), float(limit), float(v1), float(v2), limits)
    return phases


def reverse(phases: Sequence[Phase]) -> list[Phase]:
    """Return the same motion the other way; only from rest to rest."""
    return [(duration, -jerk) for duration, jerk in phases]


def _stretch(length: float, limit: float, v1: float, v2: float, limits: Limits) -> list[Phase]:
    def needed(peak: float) -> float:
        return change_distance(v1, peak, limits) + change_distance(peak, v2, limits)

    low, high = max(v1, v2), max(limit, v1, v2)
    if needed(low) > length * (1 + 1e-9):
        raise ValueError(f"cannot go from {v1:.2f} to {v2:.2f} m/s within {length:.1f} m")
    if needed(high) > length:
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if needed(middle) <= length else (low, middle)
        high = low
    hold = max(length - needed(high), 0.0) / high if high > 0 else 0.0
    return [*change(v1, high, limits), (hold, 0.0), *change(high, v2, limits)]


def _reachable(v1: float, v2: float, length: float, limits: Limits) -> float:
    """Return the greatest speed up to ``v2`` that the S-curve from (or to) ``v1`` reaches within ``length``."""
    if v2 <= v1 or change_distance(v1, v2, limits) <= length:
        return v2
    low, high = v1, v2
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if change_distance(v1, middle, limits) <= length else (low, middle)
    return low
