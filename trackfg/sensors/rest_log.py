"""The longest rest of a log that was made to show a sensor's noise.

Over hours a bias may drift further than a gentle start turns the vehicle. So a rest is not recognised by its mean, as
:mod:`trackfg.sensors.standstills` does for the seconds of a stop, but by what changes from one second to the next.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import median_interval, true_runs
from trackfg.recording.model import Recording
from trackfg.sensors.standstills import SWAY
from trackfg.sensors.tach_rests import tach_rests

_BLOCK_S = 1.0
"""Means and scatter are those of blocks of this length, s: several periods of an idling engine's vibration."""

_FEWEST = 10
"""Samples of a block, at least."""


_SIGMAS = 5.0
"""Of the difference of two means: of a day's blocks of six channels 0.3 differ by more."""

_LOUDER = 3.0
"""A block is no rest where its scatter is this many times that of the quietest quarter: an engine, or people. Besides,
it may be half a step in each channel: values that change between two neighbours, where others' do not change at all.
"""

_WHOLE = 0.99
"""Share of a block's samples that have to be there."""


@dataclass(frozen=True)
class RestLog:
    """Samples (n, 6) of rate and force every ``dt`` s during the longest rest, which lasts from ``begin_s`` to
    ``end_s``; ``whole_s`` is how long the log is, ``rows`` where the samples are in it.
    """

    samples: Array
    dt: float
    begin_s: float
    end_s: float
    whole_s: float
    rows: slice

    @property
    def is_whole(self) -> bool:
        """Return whether all of the log is rest, up to a hundredth at its ends."""
        return self.end_s - self.begin_s >= 0.99 * self.whole_s


def longest_rest(recording: Recording) -> RestLog | None:
    """Return the longest rest of a recording; None where it has none of a few seconds."""
    t = recording.imu["t_s"].to_numpy()
    samples = np.hstack([recording.gyro, recording.accel])
    block = max(_BLOCK_S, _FEWEST * median_interval(t))
    edges = t[0] + block * np.arange(int((t[-1] - t[0]) / block) + 1)
    if len(edges) < 4:
        return None
    still = _steady(t, samples, edges)
    if recording.tach is not None and len(recording.tach) > 1:
        still &= _tach_rests(recording, edges)
    runs = true_runs(still)
    if not len(runs):
        return None
    first, last = max(runs, key=lambda run: run[1] - run[0])
    rows = slice(*np.searchsorted(t, edges[[first, last]]).tolist())
    inside = t[rows]
    dt = float(inside[-1] - inside[0]) / (len(inside) - 1)
    return RestLog(samples[rows], dt, float(edges[first]), float(edges[last]), float(t[-1] - t[0]), rows)


def steps_of(samples: Array) -> Array:
    """Return the step of each channel of ``samples`` (n, c), which is the least change of its value; 0 without any."""
    changes = np.abs(np.diff(samples, axis=0))
    least = np.min(changes, axis=0, where=changes > 0.0, initial=np.inf)
    return np.where(np.isfinite(least), least, 0.0)


def _steady(t: Array, samples: Array, edges: Array) -> np.ndarray:
    """Return which blocks between ``edges`` are complete, no louder than others, and like both neighbours."""
    at = np.searchsorted(t, edges)
    number = np.diff(at)
    level = samples[: at[-1]] - samples.mean(axis=0)
    total, square = (np.add.reduceat(values, np.minimum(at[:-1], at[-1] - 1)) for values in (level, level**2))
    count = np.maximum(number, 1)[:, None]
    mean = total / count
    variance = np.maximum(square / count - mean**2, 0.0)
    complete = number >= _WHOLE * np.median(number)
    scatter = np.sqrt(variance.reshape(-1, 2, 3).sum(axis=2))
    half_step = 0.5 * np.sqrt((steps_of(samples).reshape(2, 3) ** 2).sum(axis=1))
    calm = np.all(scatter <= np.maximum(_LOUDER * np.quantile(scatter, 0.25, axis=0), 1.001 * half_step), axis=1)
    of_mean = variance / count
    near = np.all(np.abs(np.diff(mean, axis=0)) <= SWAY[:6] + _SIGMAS * np.sqrt(of_mean[1:] + of_mean[:-1]), axis=1)
    return np.asarray(complete & calm & np.append(True, near) & np.append(near, True))


def _tach_rests(recording: Recording, edges: Array) -> np.ndarray:
    """Return which blocks lie in a rest of the tach."""
    assert recording.tach is not None
    description = recording.description.tach
    integrates = description is not None and description.integrates_speed
    t = recording.imu["t_s"].to_numpy()
    spans = tach_rests(
        recording.tach, (float(t[0]), float(t[-1])), integrates_speed=integrates, silent_at_rest=None
    ).spans
    begins = np.searchsorted(spans[:, 0], edges[:-1], side="right") - 1
    inside = begins >= 0
    inside &= edges[1:] <= spans[np.maximum(begins, 0), 1] if len(spans) else inside
    return np.asarray(inside)
