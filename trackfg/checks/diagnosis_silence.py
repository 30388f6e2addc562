"""Spans in which the tach shows no motion although the IMU does: a wheel sensor that is dead, frozen or absent.

The tach says nothing before its first row and after its last (holes are found by their length alone); it says "at
rest" where its distance does not change. A vehicle that stands has the same mean rates and forces in all blocks of 2 s,
up to the sensor's drift and to what scatter within the blocks makes of their means, however its engine shakes it. One
that moves has not: gradient, cant, curves and acceleration change. A start shows in two blocks at least: it leaves a
speed of half a metre per second or more, where a knock leaves none.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pandas as pd

from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import true_runs
from trackfg.recording.model import IMU_COLUMNS

SHORTEST_S = 20.0
"""Wheels lock or slide for less; the smoother bridges shorter holes, s."""
_MARGIN_S = 5.0
"""Left out at both ends of a span, s: with one pulse per revolution a start shows when 3 m have been rolled."""
_BLOCK_S = 2.0
"""Length of the blocks whose means are compared, s: vibration is averaged out, and motion is not."""
_FEWEST_BLOCKS = 5
"""Fewer blocks have no range between quantiles of 0.1 and 0.9."""
_FEWEST_ROWS = 10
"""Fewer rows at rest give no noise to hold the range against."""
_LEAST_RANGE = np.array([0.01, 0.01, 0.01, 0.15, 0.15, 0.15])
"""rad/s, m/s^2: the drift of a poor sensor over hours (0.5 deg/s, 15 mg: data sheets of phones' IMUs) and people on
board stay below."""
_NOISE_RANGES = 2.0
"""The range must be so many times that of white noise."""
_QUANTILES = (0.1, 0.9)
"""Quantiles between which the range of block means is taken: a knock does not widen it."""
_WHITE_RANGE = 2.563
"""Distance of these quantiles of a normal distribution in standard deviations."""


@dataclass(frozen=True)
class SilentSpan:
    """The IMU moves in this span, the tach does not: it has no rows (``absent``) or one value (``constant``)."""

    start_s: float
    end_s: float
    kind: Literal["absent", "constant"]

    @property
    def seconds(self) -> float:
        """Its length, s."""
        return self.end_s - self.start_s


def silent_spans(imu: pd.DataFrame, tach: pd.DataFrame) -> tuple[SilentSpan, ...]:
    """Return the spans of 20 s or more, in order."""
    t, distance = tach["t_s"].to_numpy(), tach["distance_m"].to_numpy()
    begin, end = float(imu["t_s"].iloc[0]), float(imu["t_s"].iloc[-1])
    spans = [SilentSpan(begin, float(t[0]), "absent"), SilentSpan(float(t[-1]), end, "absent")]
    constant = t[true_runs(np.diff(distance) == 0.0)]
    lasting = constant[constant[:, 1] - constant[:, 0] >= SHORTEST_S]
    spans += [SilentSpan(start, stop, "constant") for start, stop in lasting.tolist()]
    rows, times = imu[list(IMU_COLUMNS[1:])].to_numpy(), imu["t_s"].to_numpy()
    moving = []
    for span in sorted(spans, key=lambda silence: silence.start_s):
        first, last = np.searchsorted(times, [span.start_s + _MARGIN_S, span.end_s - _MARGIN_S])
        if span.seconds >= SHORTEST_S and is_moving(times[first:last], rows[first:last]):
            moving.append(span)
    return tuple(moving)


def without_silence(tach: pd.DataFrame, spans: Iterable[SilentSpan]) -> pd.DataFrame | None:
    """Return a tach table without its rows in the spans, None if hardly any are left."""
    t = tach["t_s"].to_numpy()
    silent = np.zeros(t.size, dtype=np.bool_)
    for span in spans:
        silent |= (t > span.start_s) & (t <= span.end_s)
    rest = tach[~silent].reset_index(drop=True)
    return rest if len(rest) >= _FEWEST_ROWS else None


def is_moving(t: Array, rows: Array) -> bool:
    """Return whether rates and forces (n, 6) at times (n,) vary between blocks as only a moving vehicle's do."""
    if t.size < _FEWEST_BLOCKS:
        return False
    block = ((t - t[0]) // _BLOCK_S).astype(np.int64)
    counts = np.bincount(block)
    full = counts >= max(2, int(0.5 * np.median(counts)))
    if np.count_nonzero(full) < _FEWEST_BLOCKS:
        return False
    n = counts[full][:, None]
    means, squares = (
        np.column_stack([np.bincount(block, column) for column in values.T])[full] / n for values in (rows, rows**2)
    )
    within = np.maximum(squares - means**2, 0.0) / n
    low, high = np.quantile(means, _QUANTILES, axis=0)
    noise = _NOISE_RANGES * _WHITE_RANGE * np.sqrt(np.median(within, axis=0))
    least = np.maximum(noise, _LEAST_RANGE)
    off = 0.5 * (means[1:] + means[:-1]) - np.median(means, axis=0)
    return bool(np.any(high - low > least) or np.any(np.abs(off[:, :5]) > least[:5]))
