"""Rows of a receiver that its table holds: the last value again, since the table is written faster than it measures.

A table of 10 Hz beside a receiver of 1 Hz repeats each position nine times, and none of these nine is a measurement.
How often the receiver measures, the values themselves show: those of a vehicle in motion change once per measurement,
so that the usual run of equal rows lasts as long as the receiver's interval. In a table that is written as often as its
receiver measures, it is one row.

A run that lasts longer is of a vehicle at rest, whose receiver measures the same again, or of a receiver that measures
nothing. A vehicle at rest is at the same place when the values change again: one row per interval is kept. A vehicle in
a tunnel is elsewhere by then: only the first row of the run is kept.
"""

from __future__ import annotations

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import median_interval

LONGER = 1.5
"""Intervals from which on a run of equal rows is longer than one: between one and two."""
FEWEST_RUNS = 5
"""Runs below which nothing shows how often the receiver measures."""
_FASTEST_S, SLOWEST_S = 0.04, 1.0
"""Then a table that is written faster than the fastest receivers measure (20 Hz, and some with 25 Hz) is taken for one
beside the slowest, s."""
IN_MOTION_MPS = 1.0
"""Speed over a run from which on its vehicle was in motion, m/s: at rest receivers drift by some metres in ten
seconds."""


def held_rows(t: Array, measured: Array, place: Array | None = None) -> np.ndarray:
    """Return which rows (n,) at times t (n,), s, hold values ``measured`` (n, k) of a row before.

    ``place`` (n, 2) is where the vehicle is in plan, m. Without it values are speeds, which are 0 at rest only.
    """
    new = np.append(True, (measured[1:] != measured[:-1]).any(axis=1))[: len(t)]
    if new.all() or t[-1] <= t[0]:
        return np.zeros(len(t), dtype=bool)
    step_s = median_interval(t) or float(t[-1] - t[0]) / len(t)  # of a clock that ticks more seldom than rows come
    first = np.flatnonzero(new)
    lasts_s = np.diff(np.append(t[first], t[-1] + step_s))
    if place is None:
        moving, gone_on = measured[first, 0] > 0.0, np.zeros(len(first), dtype=bool)
    else:
        way = np.append(np.linalg.norm(np.diff(place[first], axis=0), axis=1), 0.0)
        moving = gone_on = way > IN_MOTION_MPS * lasts_s
    interval_s = _interval_s(lasts_s, moving, step_s)
    at_rest = (lasts_s > LONGER * interval_s) & ~gone_on
    run = np.cumsum(new) - 1
    measurement = np.floor((t - t[first][run] + 0.5 * step_s) / interval_s)
    again = np.append(True, measurement[1:] != measurement[:-1]) | (interval_s < LONGER * step_s)
    held: np.ndarray = ~new & ~(at_rest[run] & again)
    return held


def _interval_s(lasts_s: Array, moving: np.ndarray, step_s: float) -> float:
    """Return how often the receiver measures, s, by how long runs of equal rows last, in motion if there are enough."""
    runs = lasts_s[moving] if np.count_nonzero(moving) >= FEWEST_RUNS else lasts_s
    if len(runs) >= FEWEST_RUNS:
        return max(float(np.median(runs)), step_s)
    return SLOWEST_S if step_s < _FASTEST_S else step_s
