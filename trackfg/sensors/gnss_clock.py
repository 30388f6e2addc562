"""The clock of a GNSS receiver against the vehicle's: the shape of the path shows by how much its stamps are off.

Dead reckoning with the yaw rate w and the wheel's speed v gives the path p in plan as complex numbers, right but for
where it begins, which way it goes, its scale, and a slow change of these. The antenna is l away from it, forward and to
the left. So within a window of a minute the positions z, stamped t, on a clock that is set by T, are

    z = a + b (p + l e)(t + T) + c q(t + T),   e = exp(i integral of w),   p' = v e,   q' = (t - t_middle) p',

a, b, c complex. An antenna ahead of the path looks like a clock that is early. So where no l is declared, ``d = b l``
is another complex parameter of each window, with a prior at 0. For each T on a grid least squares leave the sum of
squares S(T) in each of the windows. Noise differs from one to another, so the sum of ``n log S`` over all is least at
the most likely T. Its sigma is that of M-estimators with errors that are correlated within windows (Huber 1967, the
sandwich; windows are its clusters): with the derivatives g of each window's part and h of second order,
``sd = sqrt(sum g^2) / sum h``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.chi_square import widening_of_few
from trackfg.numerics.spans import median_interval
from trackfg.recording.antenna import is_declared
from trackfg.recording.model import Recording
from trackfg.sensors.averages import averaged

_STEP_S = 0.1
"""Step of the path, s: it resolves a train's motion."""

_WINDOW_S = 60.0
"""A window, s: long enough for a change of speed or a curve, short enough for a gyro that drifts by degrees."""
_WINDOW_POSITIONS = 12
"""Positions of a window at least: it has three or four complex parameters, and the errors shall show."""

_ARM_SD_M = 13.2
"""Sigma of an antenna's place that is not declared, m: half the length of a coach (26.4 m, UIC 567). It is meant to be
wide, since the same error in all windows is not in the sigma of T."""

_SHORTEST_M = 20.0
"""A window with less of a way says nothing, m: the path is within the noise of a receiver."""

_REACH_S = 3.0
"""Offsets are sought as far as this, s; receivers on serial lines are late by up to 2 s."""
_LAG_S = 0.05
"""Step of the offsets, s; a parabola refines the best."""
_RISE = 2.0
"""Rise of the cost on both sides of the least between which a parabola stands for it: that at two sigmas. Errors that
last for seconds make the cost uneven from one lag to the next.
"""

_FEWEST_WINDOWS = 3
"""A sigma from fewer is none."""


@dataclass(frozen=True)
class GnssClock:
    """``offset_s`` is to be added to the receiver's stamps to bring them to the other clock, with its sigma."""

    offset_s: float
    sd_s: float


def gnss_clock(recording: Recording) -> GnssClock | None:
    """Return the receiver's offset; None where the recording does not show it.

    That is without a tach or GNSS, with fewer than three windows in motion, and where the best offset is at an end of
    the range.
    """
    gnss, part, tach = recording.gnss, recording.description.gnss, recording.tach
    if gnss is None or part is None or tach is None or len(gnss) < _FEWEST_WINDOWS * _WINDOW_POSITIONS:
        return None
    motion = averaged(recording.imu, tach, _STEP_S)
    if motion is None:
        return None
    heading = np.cumsum(motion.gyro[:, 2]) * motion.step_s
    velocity = motion.speed * np.exp(1j * (heading - 0.5 * motion.gyro[:, 2] * motion.step_s))
    edges = motion.t_s[0] + motion.step_s * (np.arange(len(motion.t_s) + 1) - 0.5)
    path = np.concatenate([[0.0], np.cumsum(velocity * motion.step_s)])
    change = np.concatenate([[0.0], np.cumsum((motion.t_s - motion.t_s[0]) * velocity * motion.step_s)])
    ahead = np.exp(1j * np.concatenate([[0.0], heading]))
    if is_declared(part):
        forward, left, _ = part.lever_arm_m
        columns, weights = [path + complex(forward, left) * ahead, change], [0.0, 0.0]
    else:
        noise = float(np.median(gnss[["east_sd_m", "north_sd_m"]]))
        columns, weights = [path, change, ahead], [0.0, 0.0, noise / _ARM_SD_M]
    lags = np.arange(-_REACH_S, _REACH_S + 0.5 * _LAG_S, _LAG_S)
    costs = [
        _cost(lags, t, z, edges, columns, weights)
        for t, z in _windows(gnss[["t_s", "east_m", "north_m"]].to_numpy(), edges, path)
    ]
    return _best(lags, np.array(costs)) if len(costs) >= _FEWEST_WINDOWS else None


def _windows(gnss: Array, edges: Array, path: Array) -> list[tuple[Array, Array]]:
    """Return times and positions, as complex numbers, of each window in which the vehicle goes some way."""
    t, z = gnss[:, 0], gnss[:, 1] + 1j * gnss[:, 2]
    length = max(_WINDOW_S, _WINDOW_POSITIONS * median_interval(t))
    windows = []
    for start in np.arange(edges[0] + _REACH_S, edges[-1] - _REACH_S - length, length):
        inside = (t >= start) & (t < start + length)
        if np.count_nonzero(inside) < _WINDOW_POSITIONS - 1:
            continue
        # What the positions see of the path at any of the offsets.
        first, last = t[inside][[0, -1]]
        ends = np.interp([first + _REACH_S, last - _REACH_S], edges, path)
        if first + 2.0 * _REACH_S < last and abs(ends[1] - ends[0]) > _SHORTEST_M:
            windows.append((t[inside], z[inside]))
    return windows


def _cost(lags: Array, t: Array, z: Array, edges: Array, columns: Sequence[Array], weights: Sequence[float]) -> Array:
    """Return ``n log S`` of one window for each lag, (lags,), of columns known at ``edges``.

    ``weights`` are those of priors at 0 of their parameters, of the noise of a position over that of the parameter.
    """
    at = t[None] + lags[:, None]
    samples = [np.interp(at, edges, column) for column in columns]
    A = np.stack([np.ones_like(samples[0]), *(column - column[:, :1] for column in samples)], axis=2)
    priors = np.diag([0.0, *weights])[np.array([0.0, *weights]) > 0.0]
    A = np.concatenate([A, np.broadcast_to(priors, (len(lags), *priors.shape))], axis=1)
    Q, _ = np.linalg.qr(A / np.linalg.norm(A, axis=1, keepdims=True))
    z = np.concatenate([z - z[0], np.zeros(len(priors))])
    centred = np.broadcast_to(z, (len(lags), len(z)))[:, :, None]
    residual = centred - Q @ (np.conj(np.swapaxes(Q, 1, 2)) @ centred)
    return np.asarray(len(t) * np.log(np.sum(np.abs(residual[:, :, 0]) ** 2, axis=1) + 1e-12))


def _best(lags: Array, costs: Array) -> GnssClock | None:
    """Return the least of the sum of costs (windows, lags), with its sigma; None where it has not risen at both ends of
    the lags.
    """
    total = costs.sum(axis=0)
    best = int(np.argmin(total))
    reach = np.arange(1, min(best, len(lags) - 1 - best) + 1)
    wide = reach[np.minimum(total[best - reach], total[best + reach]) - total[best] > _RISE]
    if not len(wide):
        return None
    apart_s = wide[0] * _LAG_S
    around = costs[:, best + wide[0] * np.array([-1, 0, 1])]
    bend = (around[:, 0] - 2.0 * around[:, 1] + around[:, 2]) / apart_s**2
    curvature = float(bend.sum())
    slope = 0.5 * (around[:, 2] - around[:, 0]) / apart_s
    offset = -float(slope.sum()) / curvature
    slope += bend * offset
    # So few windows show their scatter badly: three sigmas shall be as unlikely as they are of a normal variable.
    few = widening_of_few(len(costs) - 1)
    return GnssClock(float(lags[best]) + offset, few * float(np.sqrt(np.sum(slope**2)) / curvature))
