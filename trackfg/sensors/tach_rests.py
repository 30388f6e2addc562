"""The rows of a tach show when it may be at rest.

**Counts.** Between two pulses the wheel moves by less than one. A vehicle that comes to a stop with constant jerk
stands at the latest after 3.85 times the interval between its last two pulses (these lie x + q and x before the stop,
x < q, and times are as the cubic roots of distances: the worst is x = q), and starts alike; with constant deceleration
it is 2.42 times. So much is taken off both ends of a silence: one that creeps along at constant speed is never at rest,
however few pulses the wheel has. A count that goes to and fro over the edge at which the wheel happens to stand does
not move.

**Speeds.** A speed signal may have noise at rest. It is at rest where its mean over a second is what its own noise
there makes of zero: the sigma s of a row is that of second differences, in which no constant acceleration is left,
of that second or of all such seconds, the larger.
Where the signal has a sign the mean of the noise is far less than s; where it has none it is 1.3 s, the mean of a
folded normal distribution over its standard deviation.

Such a span begins before the speed is zero, for two reasons, and is trimmed by the longer of both times. A second whose
mean z passes for zero may hold the last u seconds of a motion, in which the wheel rolls z times 1 s; at constant jerk
it rolls r = z ((1 + u)^3 - u^3) / u^3 in the second before. And a signal in steps q that is cut off is zero below one
of them. A speed that reaches q after u seconds of constant jerk rolls r = q ((1 + u)^3 - u^3) / (3 u^2) in the second
beyond, so that with x = 1/u

    x + x^2 / 3 = r / q - 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import median_interval, true_runs
from trackfg.sensors.tach_rows import rows_are_pulses, tach_quantum_m

_MARGIN_S = 0.25
"""The least that is taken off both ends, s: a body swings back on its springs, clocks are a little off."""

_STOPPED_AFTER = 1.0 / (np.cbrt(2.0) - 1.0)
"""Intervals of the last two pulses after which a vehicle stands, at constant jerk (see above)."""

_GENTLEST_MPS2 = 0.05
"""No vehicle is stopped, or starts, more gently, m/s^2: ten times less than a train's usual braking."""

_CRAWL_MPS = 0.02
"""A slower speed counts as zero, m/s: in the shortest rest that makes 2 cm."""

_LAST_SECOND_M = 4.0
"""No vehicle rolls further in its last second before a stop, m: 8 m/s^2."""

_WINDOW_S = 1.0
"""The mean of a speed signal is taken over this, s."""

_FEWEST_ROWS = 5
"""It is taken over so many rows at least: fewer do not determine their noise."""

_SPARSE_S = 0.25
"""Rows further apart, s, do not distinguish noise from stop and go: at rest they have to be zero."""

_NOISE_S = 0.1
"""Second differences are taken over this, s: by then a signal differs that is filtered or repeated row by row."""

_OF_SIGNED = 1.0
"""Mean of a signed speed's noise, in sigmas of a row, that is still zero: of five independent rows it is 0.45."""

_OF_UNSIGNED = 2.0
"""The same of a speed without a sign, 1.3 on average, with as much for the scatter of five rows."""

_NO_MPS = 1e-6
"""Smaller speeds are roundings of the distance that a speed was integrated to, m/s."""

_LONGEST_TRIM_S = 2.0
"""At most so much is taken off a span of a speed signal, s: the inertial sensor measures what is left of the motion."""

_OUTWARDS = np.array([-1.0, 1.0])
"""Before the start and after the end of a span."""

_BEYOND_S = 2.0
"""The speed at which a rest is entered and left is that of this much earlier and later, s."""


@dataclass(frozen=True)
class Candidates:
    """Spans (m, 2) in which the tach may be at rest, s, and the speeds (m, 2), m/s, 2 s before and after the tach fell
    silent; 0 beyond the ends of its record.
    """

    spans: Array
    speeds: Array


def tach_rests(
    tach: pd.DataFrame,
    record: tuple[float, float],
    *,
    integrates_speed: bool,
    silent_at_rest: bool | None = None,
    quantum_m: float | None = None,
) -> Candidates:
    """Return where the tach may be at rest within the inertial ``record`` (start, end), s.

    A rest at the first or the last row reaches to that end of ``record`` where that is within 2 s, or where the tach
    has no rows at rest (``silent_at_rest``). ``quantum_m`` is the distance of a count. By default the rows show both;
    those of a distance without its slips do not.
    """
    t, distance = tach["t_s"].to_numpy(), tach["distance_m"].to_numpy()
    quantum = 0.0 if integrates_speed else tach_quantum_m(tach) if quantum_m is None else quantum_m
    if silent_at_rest is None:
        silent_at_rest = rows_are_pulses(t, distance, quantum)
    t0, t1 = record
    if not silent_at_rest:
        t0 = t0 if t[0] < t0 + _BEYOND_S else float(t[0])
        t1 = t1 if t[-1] > t1 - _BEYOND_S else float(t[-1])
    edges, trim = _slow_spans(t, distance) if integrates_speed else _silences(t, distance, quantum)
    at_end = np.stack([edges[:, 0] <= t[0], edges[:, 1] >= t[-1]], axis=1)
    spans = np.where(at_end, [t0, t1], edges + np.maximum(trim, _MARGIN_S) * -_OUTWARDS)
    stops = (_rolled(t, distance, edges) < _LAST_SECOND_M).all(axis=1) & (spans[:, 1] > spans[:, 0])
    return Candidates(spans[stops], _rolled(t, distance, edges + (_BEYOND_S - 0.5) * _OUTWARDS)[stops])


def _rolled(t: Array, distance: Array, edges: Array) -> Array:
    """Return how far the wheel rolls in the second before each start and after each end of spans (m, 2), m, (m, 2)."""
    return np.asarray(np.abs(np.interp(edges + _OUTWARDS, t, distance) - np.interp(edges, t, distance)))


def _silences(t: Array, distance: Array, quantum: float) -> tuple[Array, Array]:
    """Return the spans (m, 2), s, in which a count does not move, and what is to be taken off their ends (m, 2), s."""
    step = np.diff(distance)
    moved = np.flatnonzero(step)
    following, preceding = step[moved][1:], step[moved][:-1]
    # To and fro: one of the neighbours takes it back, and none of them goes on.
    back, onwards = np.abs(following + preceding) < 1e-3 * quantum, following * preceding > 0.0
    moved = moved[~_either(back, len(moved)) | _either(onwards, len(moved))]
    # From the end of one row interval with motion to the start of the next.
    edges = np.stack([np.append(t[0], t[moved + 1]), np.append(t[moved], t[-1])], axis=1)
    interval = np.diff(t[moved], prepend=-np.inf, append=np.inf) if moved.size else np.full(1, np.inf)
    pulse = np.stack([np.append(0.0, interval[:-1]), np.append(interval[1:], 0.0)], axis=1)
    trim = _STOPPED_AFTER * pulse
    slow = np.maximum(quantum, 1e-6) < _CRAWL_MPS * (edges[:, 1] - edges[:, 0])
    trim[slow] = np.minimum(trim[slow], np.sqrt(2.0 * quantum / _GENTLEST_MPS2))
    return edges, trim


def _either(of_neighbours: np.ndarray, count: int) -> np.ndarray:
    """Return which of ``count`` entries a mask of neighbouring pairs (count - 1,) holds for, with either neighbour."""
    either = np.zeros(count, dtype=bool)
    either[1:] |= of_neighbours
    either[:-1] |= of_neighbours
    return either


def _slow_spans(t: Array, distance: Array) -> tuple[Array, Array]:
    """Return the spans (m, 2), s, in which a speed is zero up to its noise, and what is to be taken off (m, 2), s."""
    dt = median_interval(t)
    speed = np.diff(distance) / np.diff(t)
    dense = dt <= _SPARSE_S
    window = max(round(_WINDOW_S / dt), _FEWEST_ROWS if dense else 1)
    if len(speed) < window:
        return np.zeros((0, 2)), np.zeros((0, 2))
    lag = max(1, round(_NOISE_S / dt))
    bend = np.zeros_like(speed)
    if dense:
        bend[lag:-lag] = speed[2 * lag :] - 2.0 * speed[lag:-lag] + speed[: -2 * lag]
    # A speed between two rows is their mean: bends of neighbours hold the variance of a row once, of others 3 times.
    variance = uniform_filter1d(bend**2 / (1.0 if lag == 1 else 3.0), window, mode="nearest")
    variance = np.maximum(variance, 0.0)
    mean = np.abs(uniform_filter1d(speed, window, mode="nearest"))
    bound = _OF_SIGNED if speed.min() < 0.0 else _OF_UNSIGNED
    zero = np.maximum(bound * np.sqrt(variance), _CRAWL_MPS)
    # A second of rows determines their noise to a quarter, all rests together determine it well.
    at_rest = variance[mean <= zero]
    zero = np.maximum(zero, bound * np.sqrt(at_rest.mean() if at_rest.size else 0.0))
    runs = true_runs(maximum_filter1d(mean <= zero, window))
    is_exact, runs = _exactly_zero(np.abs(speed) < _NO_MPS, runs)
    edges = t[runs]
    moving = np.abs(speed[np.abs(speed) > _NO_MPS])
    step = 2.0 * float(np.min(moving, initial=np.inf)) if moving.size else 0.0
    # The seconds at both ends passed for zero by what the noise seemed to be then.
    ends = np.clip(runs + np.array([window // 2, -1 - window // 2]), 0, len(zero) - 1)
    passing = np.where(is_exact[:, None], 0.0, zero[ends])
    rolled = _rolled(t, distance, edges)
    return edges, np.minimum(np.maximum(_in_motion(passing, rolled), _below_a_step(step, rolled)), _LONGEST_TRIM_S)


def _exactly_zero(is_zero: np.ndarray, runs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return in which of ``runs`` (m, 2) at least half of the rows are exactly zero, (m,), and the runs (m, 2), those
    from their first to their last zero.

    Such a signal has no noise at rest: what seems to be noise as the vehicle starts are steps of its speed.
    """
    zeros = np.append(np.flatnonzero(is_zero), len(is_zero))
    first, end = np.searchsorted(zeros, runs[:, 0]), np.searchsorted(zeros[:-1], runs[:, 1])
    is_exact = 2 * (end - first) >= np.diff(runs, axis=1)[:, 0]
    exact = np.stack([zeros[first], zeros[np.maximum(end - 1, 0)] + 1], axis=1)
    return is_exact, np.where(is_exact[:, None], exact, runs)


def _below_a_step(step: float, rolled: Array) -> Array:
    """Return how long a motion shows no ``step`` of a speed, m/s, at constant jerk, s (see above). Shape (m, 2).

    ``rolled`` is what the wheel rolls in the second beyond, m, by a speed that is cut off: half a step less than it is.
    """
    if step == 0.0:
        return np.zeros_like(rolled)
    x = 1.5 * (np.sqrt(1.0 + np.maximum(rolled / step - 0.5, 0.0) / 0.75) - 1.0)
    return np.asarray(1.0 / np.maximum(x, 1.0 / _LONGEST_TRIM_S))


def _in_motion(mean: Array, rolled: Array) -> Array:
    """Return how much of a second with this mean speed is the end of a motion, s, (m, 2) all of them.

    ``rolled`` is what the wheel rolls in the second before, m (see above).
    """
    share = mean / np.maximum(rolled, _CRAWL_MPS)
    u = np.cbrt(share)
    for _ in range(20):  # a contraction where the wheel rolls further than it does in the second itself
        u = np.minimum(np.cbrt(share * (1.0 + 3.0 * u + 3.0 * u * u)), _LONGEST_TRIM_S)
    return np.asarray(u)
