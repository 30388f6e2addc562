"""Slips and slides of the wheel: the distance that it rolled against the smoothed distance, on a clock of its own.

With the smoothed distance D(t), wheel scale S(t) and the tach's count W(t), both on the IMU's clock, the wheel's excess

    E(t) = integral of S dW - D(t)

grows by the creep. Its rate over a window of half a second, less what curves and force explain, is noise while the
wheel rolls. An event is a span in which it leaves the noise, and 1.5 % of the speed, one way; it is reported if the
creep reaches 2 % in it and its whole distance leaves the noise. Spans that only a release of the brake divides are one.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family
from trackfg.factors.odometry import tach_excess
from trackfg.factors.states import Kind, Odo, States, offset_in_keyframe
from trackfg.numerics.arrays import Array
from trackfg.numerics.hermite import hermite_at
from trackfg.numerics.spans import true_runs
from trackfg.output.event_sources import EventSources
from trackfg.sensors.tach import Wheel
from trackfg.solver.covariance import Covariance

_STEP_S = 0.1
"""Step of the clock of the excess, s: a fifth of the window."""

_WINDOW_S = 0.5
"""The rate of the excess is taken over this, s; slips shorter than it are not resolved."""

_LEAST_CREEP = 0.02
"""An event reaches this creep. Rolling wheels creep below 1-2 % at the adhesion that is used (Kalker; Polach 2005)."""

_EDGE_CREEP = 0.015
"""An event begins and ends at this creep, between the usual creep and :data:`_LEAST_CREEP`."""

_EDGE_SIGMAS = 2.5
"""An event begins and ends where the rate leaves its noise by so many sigmas."""

_LEAST_SIGMAS = 4.0
"""An event's distance is beyond its noise by so many sigmas: 6e-5 of spans without slip are."""

_WAYS = (1.0, -1.0)
"""Slip, where the wheel rolls too far, and slide."""

_RELEASE_S = 0.7
"""Slide protection holds a brake released for no longer."""


class SlipEvent(NamedTuple):
    """Times, s; the distance (m) that the wheel rolled too far (slip) or not far enough (slide, < 0), and its sigma."""

    start_s: float
    end_s: float
    removed_m: float
    removed_m_sd: float


class Excess(NamedTuple):
    """The wheel's excess E at times ``t`` (n,), s: the ``excess`` (m), the ``rate`` (m/s) at which it grows beyond what
    curves and force explain, the ``speed`` (m/s), the 1-sigma of the rate while the wheel rolls, and whether there are
    readings.
    """

    t: Array
    excess: Array
    rate: Array
    speed: Array
    noise: Array
    known: np.ndarray

    def spans(self, way: float) -> list[tuple[int, int]]:
        """Return first rows and rows after the last of the spans in which the rate leaves the noise ``way`` 1 or -1."""
        edge = np.maximum(_EDGE_CREEP * self.speed, _EDGE_SIGMAS * self.noise)
        return _joined(true_runs((way * self.rate > edge) & self.known))

    def open_since(self) -> float:
        """Return the time before which later rows change nothing: the start of a span that may go on, or the end."""
        last = len(self.t) - 1 - round((_RELEASE_S + _WINDOW_S) / _STEP_S)
        starts = [i for way in _WAYS for i, j in self.spans(way) if j > last]
        return float(self.t[max(min([last, *starts]), 0)])


def wheel_excess(
    sources: EventSources, states: States, trajectory: pd.DataFrame | Mapping[str, Array]
) -> Excess | None:
    """Return E over the span of a trajectory, of which the columns of time, chainage and speed are needed; None without
    a tach, and for a span too short for a rate.
    """
    wheel, rolled = sources.wheel, sources.family(FactorType.TACH_DISTANCE)
    at, chainage, speed, speed_sd = (
        np.asarray(trajectory[name]) for name in ("t_s", "chainage_m", "speed_mps", "speed_mps_sd")
    )
    if wheel is None or rolled is None or len(at) < 2:
        return None
    t = np.arange(at[0], at[-1], _STEP_S)
    distance = hermite_at(t, at, sources.direction * chainage, speed)
    excess = _excess(wheel, sources, states, t, distance)
    explained = np.concatenate([[0.0], np.cumsum(rolled.data["response"] @ states.wheel[0])])
    rate = _rate(t, excess - np.interp(t, sources.t, explained))
    known = wheel.covers(t - 0.5 * _WINDOW_S) & wheel.covers(t + 0.5 * _WINDOW_S)
    count_sd = _count_sd(wheel, _noise_density(wheel, rolled, sources.t), _WINDOW_S)
    noise = np.hypot(count_sd / _WINDOW_S, np.interp(t, at, speed_sd))
    return Excess(t, excess, rate, np.abs(_rate(t, distance)), noise, known)


def slip_events(sources: EventSources, states: States, covariance: Covariance, grown: Excess | None) -> list[SlipEvent]:
    """Return slips and slides in order of time; none without a tach. ``grown`` is the run's :func:`wheel_excess`."""
    wheel, rolled = sources.wheel, sources.family(FactorType.TACH_DISTANCE)
    if wheel is None or rolled is None or grown is None:
        return []
    t, excess, rate, speed = grown.t, grown.excess, grown.rate, grown.speed
    density = _noise_density(wheel, rolled, sources.t)
    events = []
    for way in _WAYS:
        for i, j in grown.spans(way):
            j = min(j, len(t) - 1)
            if not (way * rate[i:j] > _LEAST_CREEP * speed[i:j]).any():
                continue
            removed = float(excess[j] - excess[i])
            variance = _moved_variance(sources, states, covariance, t[i], t[j])
            sd = float(np.sqrt(variance + _count_sd(wheel, density, t[j] - t[i]) ** 2))
            if way * removed > _LEAST_SIGMAS * sd:
                # Where it begins and ends is known to half the window, and up to the edge's creep is added there.
                ends = _EDGE_CREEP * 0.5 * _WINDOW_S * float(np.linalg.norm(speed[[i, j]]))
                events.append(SlipEvent(float(t[i]), float(t[j]), removed, float(np.hypot(sd, ends))))
    return sorted(events)


def _excess(wheel: Wheel, sources: EventSources, states: States, t: Array, distance: Array) -> Array:
    """Return E at times ``t`` (n,), less its value at the first one, for distances (n,) along the track."""
    offset, drift = states.clock[0, :2]
    count = wheel.at(t - offset - drift * (t - sources.clock_origin))
    scale = np.interp(t, sources.t, states.odo.scale)
    steps = tach_excess(0.5 * (scale[1:] + scale[:-1]), np.diff(count), np.diff(distance))
    return np.concatenate([[0.0], np.cumsum(steps)])


def _rate(t: Array, x: Array) -> Array:
    half = 0.5 * _WINDOW_S
    return np.asarray((np.interp(t + half, t, x) - np.interp(t - half, t, x)) / _WINDOW_S)


def _joined(runs: np.ndarray) -> list[tuple[int, int]]:
    """Join runs that only a short stretch divides."""
    joined: list[tuple[int, int]] = []
    for i, j in runs.tolist():
        if joined and (i - joined[-1][1]) * _STEP_S <= _RELEASE_S:
            joined[-1] = (joined[-1][0], j)
        else:
            joined.append((i, j))
    return joined


def _moved_variance(sources: EventSources, states: States, covariance: Covariance, start: float, end: float) -> float:
    """Return the variance of ``S (W_j - W_i) - (D_j - D_i)`` for known counts; keyframes i and j enclose the event."""
    i = max(int(np.searchsorted(sources.t, start, side="right")) - 1, 0)
    j = min(int(np.searchsorted(sources.t, end)), len(sources.t) - 1)
    odo = offset_in_keyframe(Kind.ODO)
    at_i, at_j = np.zeros((2, covariance.of_keyframes.shape[2]))
    at_i[odo + Odo.DISTANCE], at_j[odo + Odo.DISTANCE] = 1.0, -1.0
    at_j[odo + Odo.SCALE] = states.odo.count[j] - states.odo.count[i]
    cross = at_i @ covariance.between(i, j) @ at_j
    variance = at_i @ covariance.at(i) @ at_i + at_j @ covariance.at(j) @ at_j + 2.0 * cross
    return max(float(variance), 0.0)


def _noise_density(wheel: Wheel, rolled: Family, t: Array) -> float:
    """Return how fast the variance of a noisy distance grows (m^2/s); 0 for a count that misses nothing."""
    noisy = wheel.integrates_speed or wheel.grown is not None
    return float(np.median(rolled.sigma[:, 0] ** 2 / np.diff(t))) if noisy else 0.0


def _count_sd(wheel: Wheel, density: float, duration_s: float) -> float:
    """Return the 1-sigma of the tach's distance over that time, m."""
    return float(np.sqrt(2.0 * wheel.rounding_sd**2 + density * duration_s))
