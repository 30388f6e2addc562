"""When the vehicle is at rest.

A candidate is a span in which the tach does not move (less than one pulse, or a speed of zero); where there is no tach,
one in which the inertial sensor is about as quiet as it ever is, without a change of mean rate or force from one block
of 0.5 s to the next: each rest has a tilt of its own. A candidate holds only as long as the inertial sensor is quiet
too: the blocks' mean angular rate stays near the candidate's median and the scatter of rate and specific force near
that of its quietest blocks.

On a smooth straight a moving vehicle is as quiet as one at rest. A candidate that the tach enters or leaves faster
than anything brakes is therefore a tach that fell silent, and no standstill; before the first and after the last row of
a tach nobody knows, unless its rows are its pulses; and where GNSS alone tells the speed, it must have seen the rest.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pandas as pd
from numpy.lib.stride_tricks import sliding_window_view

from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import true_runs
from trackfg.recording.model import Recording
from trackfg.sensors.tach_rows import rows_are_pulses, tach_quantum_m

_BLOCK_S = 0.5
"""Scatter and means are those of blocks this long, s: several periods of an idling engine's or a body's vibration."""

_MARGIN_S = 1.5  # a gentle start takes this long to show: trimmed from both ends of a candidate
_LAST_SECOND_M = 4.0  # no vehicle rolls further in its last second before a stop: 8 m/s^2
_QUIET_RATIO = 5.0  # scatter of a block against the quiet level of its candidate
_RATE_TOLERANCE = 2e-3  # rad/s: a block's mean rate against the candidate's median
_FORCE_TOLERANCE = 0.05  # m/s^2: a block's mean specific force against the candidate's median
_SCATTER_LIMITS = (0.02, 0.3)  # rad/s, m/s^2: nothing on rails that shakes more than this is called at rest


def find_standstills(recording: Recording, min_duration_s: float = 3.0, *, silent_at_rest: bool | None = None) -> Array:
    """Spans of rest as rows (start, end), s, in order, each at least ``min_duration_s`` long. Shape (m, 2).

    ``silent_at_rest``: whether the tach has no rows at rest; told from its rows unless it is given.
    """
    t = recording.imu["t_s"].to_numpy()
    block = np.floor((t - t[0]) / _BLOCK_S).astype(np.int64)
    first = np.flatnonzero(np.diff(block, prepend=-1))
    counts = np.diff(np.append(first, t.size))
    starts, ends = t[first], t[np.append(first[1:], t.size) - 1]
    signals = np.hstack([recording.gyro, recording.accel])
    mean = np.add.reduceat(signals, first, axis=0) / counts[:, None]
    variance = np.maximum(np.add.reduceat(signals**2, first, axis=0) / counts[:, None] - mean**2, 0.0)
    scatter = np.sqrt(np.stack([variance[:, :3].sum(axis=1), variance[:, 3:].sum(axis=1)], axis=1))

    if recording.tach is None or len(recording.tach) < 2:
        steady = _steady(mean, scatter, max(1, round(min_duration_s / _BLOCK_S)))
        candidates = np.stack([starts[steady[:, 0]], ends[steady[:, 1] - 1]], axis=1)
        candidates[candidates[:, 0] > starts[0], 0] += _MARGIN_S
        candidates[candidates[:, 1] < ends[-1], 1] -= _MARGIN_S
    else:
        candidates = _tach_at_rest(recording.tach, float(t[0]), float(t[-1]), silent_at_rest)
    spans = []
    for begin, end in candidates:
        inside = np.flatnonzero((starts >= begin) & (ends <= end))
        if inside.size == 0:
            continue
        for i, j in true_runs(_quiet(mean[inside], scatter[inside])):
            span = (max(begin, starts[inside[i]]), min(end, ends[inside[j - 1]]))
            if span[1] - span[0] >= min_duration_s and (
                recording.tach is not None or _gnss_stays(recording.gnss, span)
            ):
                spans.append(span)
    return np.array(spans, dtype=np.float64).reshape(-1, 2)


def _quiet(mean: Array, scatter: Array) -> np.ndarray:
    """Which blocks of a candidate are at rest. Shapes (b, 6), (b, 2) to (b,) of bool."""
    calm = _calm(scatter, np.quantile(scatter, 0.2, axis=0))
    if not calm.any():
        return calm
    quiet: np.ndarray = calm & _near(mean, np.median(mean[calm], axis=0), scatter)
    return quiet


def _steady(mean: Array, scatter: Array, blocks: int) -> np.ndarray:
    """Runs of blocks without a change, as quiet as any ``blocks`` in a row are at least once. Rows (first, end)."""
    width = min(blocks, len(scatter))
    calm = _calm(scatter, sliding_window_view(scatter, width, axis=0).max(axis=2).min(axis=0))
    changes = np.append(False, ~_near(mean[1:], mean[:-1], scatter[1:]))
    pieces = [
        list(pairwise([i, *(i + 1 + np.flatnonzero(changes[i + 1 : j])).tolist(), j])) for i, j in true_runs(calm)
    ]
    return np.array([piece for run in pieces for piece in run], dtype=np.int64).reshape(-1, 2)


def _calm(scatter: Array, level: Array) -> np.ndarray:
    calm: np.ndarray = np.all(scatter <= np.minimum(_QUIET_RATIO * level + 1e-6, _SCATTER_LIMITS), axis=1)
    return calm


def _near(mean: Array, centre: Array, scatter: Array) -> np.ndarray:
    """Return whether blocks' means are those at ``centre``, up to noise."""
    noise = 4.0 * scatter / np.sqrt(5.0)
    rate = np.abs(mean - centre)[:, :3].max(axis=1) <= _RATE_TOLERANCE + noise[:, 0]
    force = np.abs(mean - centre)[:, 3:].max(axis=1) <= _FORCE_TOLERANCE + noise[:, 1]
    near: np.ndarray = rate & force
    return near


def _gnss_stays(gnss: pd.DataFrame | None, span: tuple[float, float]) -> bool:
    """Return whether the positions of a span, half of them at least, lie within 3 sigma of their median; True without
    GNSS.
    """
    if gnss is None:
        return True
    seen = gnss[gnss["t_s"].between(*span)]
    if len(seen) < 2:
        return False
    place, sd = seen[["east_m", "north_m"]].to_numpy(), seen[["east_sd_m", "north_sd_m"]].to_numpy()
    return bool((np.median(np.abs(place - np.median(place, axis=0)) / sd, axis=0) < 3.0).all())


def _tach_at_rest(tach: pd.DataFrame, t0: float, t1: float, silent_at_rest: bool | None) -> Array:
    """Spans without tach motion, trimmed where motion ends or begins. Shape (m, 2)."""
    t, distance = tach["t_s"].to_numpy(), tach["distance_m"].to_numpy()
    if silent_at_rest is None:
        silent_at_rest = rows_are_pulses(t, distance, tach_quantum_m(tach))
    if not silent_at_rest:
        t0 = t0 if t[0] < t0 + _MARGIN_S else float(t[0])
        t1 = t1 if t[-1] > t1 - _MARGIN_S else float(t[-1])
    moved = np.flatnonzero(np.diff(distance) != 0.0)
    # From the end of one row interval with motion to the start of the next.
    begins = np.concatenate([[t0], t[moved + 1] + _MARGIN_S])
    ends = np.concatenate([t[moved] - _MARGIN_S, [t1]])
    last = np.abs(distance[moved + 1] - np.interp(t[moved + 1] - 1.0, t, distance))
    first = np.abs(np.interp(t[moved] + 1.0, t, distance) - distance[moved])
    stops = (np.append(0.0, last) < _LAST_SECOND_M) & (np.append(first, 0.0) < _LAST_SECOND_M)
    return np.stack([begins, ends], axis=1)[stops & (ends > begins)]
