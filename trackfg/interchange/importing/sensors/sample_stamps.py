"""Stamps of samples that repeat, or rows that are not in their order."""

from __future__ import annotations

import numpy as np
import pandas as pd

from trackfg.numerics.arrays import Array

_LINE_ROWS = 2000
"""Rows of one straight line: 10 s at 200 Hz, in which no logger's rate drifts by a sample."""
_LINE_TICKS = 20
"""Least ticks of one straight line, if the clock ticks as coarsely as that."""
_COARSE_TICKS = 100
"""With fewer ticks on a line, the mean of a staircase is not steep enough: its ends were off by q / 2 / ticks."""
_DISPLACED = 0.01
"""Share of rows that buffers of a logger bring out of their order; more is a clock that was set."""
_FIRST_ROWS = 100
"""Rows that show whether stamps repeat with their rows: copies of all of them would take memory."""


def sorted_rows(t: Array) -> np.ndarray | None:
    """Return the order (n,) of rows that brings times (n,), s, into sequence; None where they are, or cannot be.

    A few rows out of their order fit into the gaps that they left, or repeat others. A clock that was set back does
    not: its rows would come between those before.
    """
    step = np.diff(t)
    if not (step < 0).any():
        return None
    order = np.argsort(t, kind="stable")
    usual = float(np.median(step))
    misplaced = float((order != np.arange(t.size)).mean())
    step = np.diff(t[order])
    return order if misplaced < _DISPLACED and ((step == 0.0) | (step >= 0.5 * usual)).all() else None


def repeated_rows(t: Array, frame: pd.DataFrame) -> np.ndarray | None:
    """Return which rows (n,) are written a second time, with times (n,), s, and all cells of the row before.

    None where there are none, or where stamps repeat often, and with other cells: then they are coarse.
    """
    again = np.flatnonzero(np.diff(t) == 0.0) + 1
    coarse = again.size >= _DISPLACED * t.size
    if again.size == 0 or (coarse and not _as_before(frame, again[:_FIRST_ROWS]).all()):
        return None
    same = _as_before(frame, again)
    twice = np.zeros(t.size, dtype=bool)
    twice[again[same]] = True
    return twice if same.all() or (same.any() and not coarse) else None


def _as_before(frame: pd.DataFrame, rows: np.ndarray) -> np.ndarray:
    """Return which of the rows (m,) have all cells of the row before."""
    previous, these = (frame.iloc[some].reset_index(drop=True) for some in (rows - 1, rows))
    same = ((these == previous) | (these.isna() & previous.isna())).all(axis=1)
    return np.asarray(same.to_numpy(dtype=bool, na_value=False))


def spread_stamps(t: Array) -> Array:
    """Return times (n,), s, without the repetitions that coarse stamps have: samples are as far apart as on average.

    Between two breaks (steps of more than 10 usual intervals) the samples of a clock that ticks every q lie on a
    straight line, up to q; a slow change of the rate is followed by lines over some 2000 samples. Times that grow from
    row to row are returned as they are.
    """
    step = np.diff(t)
    if t.size < 3 or (step > 0).all() or (step < 0).any():
        return t  # a clock that runs backwards is not corrected here: `check` names the row
    usual = (t[-1] - t[0]) / (t.size - 1)
    ticks = step[step > 0]
    quantum = float(ticks.min()) if ticks.size else 0.0
    breaks = np.flatnonzero(step > max(10.0 * usual, 3.0 * quantum)) + 1
    rows = max(_LINE_ROWS, int(_LINE_TICKS * quantum / usual) if usual > 0.0 else 0)
    out = t.copy()
    for first, last in zip([0, *breaks], [*breaks, t.size], strict=True):
        for a in range(first, last, rows):
            b = last if last - a < 2 * rows else a + rows
            if b - a >= 3:
                out[a:b] = _line(t[a:b])
            if b == last:
                break
    return out if (np.diff(out) > 0).all() else _strictly(out, usual)


def tick_s(t: Array) -> float | None:
    """Return by how much the clock ticks, s, whose times (n,) repeat in most rows; None where they do not."""
    step = np.diff(t)
    return float(step[step > 0].min()) if (step > 0).any() and (step == 0).mean() > 0.5 else None


def _line(t: Array) -> Array:
    i = np.arange(t.size, dtype=np.float64)
    step = np.diff(t)
    ticks, firsts = step[step > 0], np.flatnonzero(step > 0) + 1
    if 1 < firsts.size < _COARSE_TICKS and ticks.max() < 1.5 * ticks.min():
        # The first rows of the ticks lie on the line up to a sample; the middle of a tick is half of one later.
        slope, offset = np.polyfit(i[firsts], t[firsts], 1)
        offset += 0.5 * (slope - ticks.mean())
    else:
        slope, offset = np.polyfit(i, t, 1)
    return np.asarray(offset + slope * i)


def _strictly(t: Array, usual: float) -> Array:
    """Return times that grow by at least a tenth of the usual step: where two lines meet they may overlap a little."""
    least = 0.1 * usual * np.arange(t.size)
    return np.asarray(np.maximum.accumulate(t - least) + least)
