"""Samples of the IMU that a logger stamps by the packet: equal stamps, or some microseconds apart, then a jump.

Sensors hand over their samples in packets, by the dozen. A logger that stamps what arrives gives all of a packet one
time, or the times at which it wrote them down. The samples were taken evenly in between. So they are spread again along
straight lines through the stamps of the packets, over some 10 s each, on which single delays do not show.

A constant offset stays unknown. Stamps that differ within a packet are times of arrival, and a packet arrives with its
last sample or later. Equal stamps may also be those of a clock that ticks as seldom, which a packet begins with: the
middle of the packet is taken, which is wrong by half of it at most. The graph estimates the clocks of tach and GNSS
against the IMU's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pandas as pd
from scipy.ndimage import uniform_filter1d

from trackfg.numerics.arrays import Array
from trackfg.numerics.robust import median, robust_sd
from trackfg.recording.description import Imu
from trackfg.recording.findings import Finding
from trackfg.recording.model import IMU_COLUMNS, Recording
from trackfg.sensors.sampling_rate import rate_stretches

_SMALL = 0.2
"""Steps within a packet are shorter than this share of the mean one nearby: rows of 40 bytes of a serial line of 460
kbit/s are 0.9 ms apart, of samples 5 ms apart."""
_MOSTLY = 0.4
"""Share of such steps at least: half of all, less some stray rows, in packets of two samples. Stamps with delays that
scatter as the sampling interval have a fifth (delays that are exponentially distributed)."""
_LONGEST_S = 0.5
"""Packets are no further apart: what is longer is a hole."""
_NEARBY_S = 2.0
"""Over so long the mean step is taken, s: several packets, and a rate that hardly changes."""
_FEWEST = 10
"""Packets: fewer show no clock."""
_LINE_S = 10.0
"""Length of one straight line, s: no logger's rate drifts by a sample meanwhile."""
_BESIDE = 5
"""Packets on either side of a late one that show whether rows are missing there: a delay is made up for by the next."""
_OUTLIERS = 3.0
"""A packet further from the line, in robust sigmas, does not count."""
_LEAST = 0.1
"""Share of the usual interval between any two rows at least, where one line meets the next."""


@dataclass(frozen=True)
class EvenStamps:
    """Times ``t`` (n,), s, of samples spread evenly, of packets of ``rows`` each that last ``packet_s``.

    ``equal``: whether the stamps of a packet were.
    """

    t: Array
    rows: int
    packet_s: float
    equal: bool

    def finding(self, imu: Imu) -> Finding:
        """Say what was done, and what is unknown."""
        off = f"up to {0.5 * self.packet_s:.2g} s early or late"
        if not self.equal:
            off = "late by what a packet takes to arrive"
        message = f"packets of {self.rows} samples have one time each; samples are spread evenly, and may all be {off}"
        expected = "a time for each sample"
        hint = (
            "let the logger stamp each sample. The clocks of tach and GNSS are estimated against these times; places "
            "of fixes, balises and lasers are off by the speed times that, and the times of a result by as much"
        )
        return Finding(
            "warning", "packet-stamps", message, file=imu.file, column=imu.time, expected=expected, hint=hint
        )


def spread_evenly(t: Array, channels: Sequence[Array]) -> EvenStamps | None:
    """Return even stamps of samples at ``t`` (n,), s, none before another; None where they are not in packets.

    ``channels``, (n,) each, are the samples: where rows repeat those before them, they are written twice.
    """
    steps = np.diff(t)
    if len(steps) < 2 * _FEWEST or not (steps >= 0.0).all():
        return None
    usual = np.minimum(steps, _LONGEST_S)
    mean = float(usual.mean())
    if not mean > 0.0 or np.mean(steps < _SMALL * mean) < _MOSTLY:
        return None
    small = steps < _SMALL * uniform_filter1d(usual, 2 * max(round(0.5 * _NEARBY_S / mean), 1) + 1)
    if small.mean() < _MOSTLY or _are_copies(channels, small):
        return None
    first = np.append(0, np.flatnonzero(~small) + 1)
    count, equal = np.diff(np.append(first, len(t))), bool(np.mean(steps[small] == 0.0) > _MOSTLY)
    if len(first) < _FEWEST:
        return None
    place = first + (0.5 * (count - 1) if equal else count - 1)
    spread = _on_lines(place, t[first], count, len(t))
    rows = round(median(count.astype(np.float64)))
    return EvenStamps(spread, rows, rows * median(np.diff(spread)), equal)


def _are_copies(channels: Sequence[Array], small: np.ndarray) -> bool:
    """Return whether rows with the time of the one before have its values, too."""
    again = np.flatnonzero(small) + 1
    same = np.all([channel[again] == channel[again - 1] for channel in channels], axis=0)
    return bool(np.mean(same) > 1.0 - _MOSTLY)


def _on_lines(place: Array, arrival: Array, count: np.ndarray, rows: int) -> Array:
    """Return the times of so many ``rows``, of packets (p,) with a row, in fractions, at the time of ``arrival``, s."""
    step = np.diff(arrival) / np.diff(place)
    starts = [0]
    for first, end in rate_stretches(np.repeat(step, count[1:])):
        packet = np.searchsorted(np.cumsum(count[1:]), [first, end])
        begin, last = int(packet[0]) + (first > 0), int(packet[1])
        usual = median(step[begin : max(last, begin + 1)])
        # By how much each packet is later than the one before and its samples make it: a hole, if it stays so.
        late = np.append(0.0, np.diff(arrival[begin : last + 1]) - usual * np.diff(place[begin : last + 1]))
        level = np.cumsum(late)
        packet_s = usual * median(count.astype(np.float64))
        doubtful = np.flatnonzero(late > 0.5 * packet_s)
        rise = [np.median(level[k : k + _BESIDE]) - np.median(level[max(k - _BESIDE, 0) : k]) for k in doubtful]
        holes = doubtful[np.array(rise) > 0.5 * packet_s]
        starts += [begin, *(begin + int(k) for k in holes)]
    bounds = sorted({*starts, len(place)})
    t, usual_s = np.empty(rows), median(step)
    for first, end in pairwise(bounds):
        begin = 0 if first == 0 else int(np.sum(count[:first]))
        stop = begin + int(np.sum(count[first:end]))
        t[begin:stop] = _line_by_line(np.arange(begin, stop), place[first:end], arrival[first:end], usual_s)
    least = _LEAST * usual_s * np.arange(rows)
    return np.asarray(np.maximum.accumulate(t - least) + least)


def _line_by_line(row: np.ndarray, place: Array, arrival: Array, usual_s: float) -> Array:
    """Return the times of rows (n,) on lines through packets (p,) without a hole between them, s."""
    lines = max(round((arrival[-1] - arrival[0]) / _LINE_S), 1)
    parts = np.array_split(np.arange(len(place)), min(lines, max(len(place) // _FEWEST, 1)))
    ends = [*(int(np.ceil(0.5 * (place[a[-1]] + place[b[0]]))) for a, b in pairwise(parts)), int(row[-1]) + 1]
    out, begin = np.empty(len(row)), int(row[0])
    for part, end in zip(parts, ends, strict=True):
        x, y = place[part], arrival[part]
        slope, centre = median(np.diff(y) / np.diff(x)) if len(part) > 2 else usual_s, (x.mean(), y.mean())
        if len(part) >= _FEWEST:
            good = np.ones(len(part), dtype=bool)
            for _ in range(2):
                centre = x[good].mean(), y[good].mean()
                slope = float((x[good] - centre[0]) @ (y[good] - centre[1]) / np.sum((x[good] - centre[0]) ** 2))
                off = y - centre[1] - slope * (x - centre[0])
                good = np.abs(off - np.median(off)) <= max(_OUTLIERS * robust_sd(off - np.median(off)), 1e-9)
        rows = np.arange(begin, end)
        out[begin - int(row[0]) : end - int(row[0])] = centre[1] + slope * (rows - centre[0])
        begin = end
    return out


def with_even_stamps(recording: Recording) -> Recording:
    """Return a recording in memory with the IMU's samples spread evenly, and a finding where they were not.

    Tables that are none, or that hold no numbers, are left to whoever refuses them.
    """
    imu, wanted = recording.imu, list(IMU_COLUMNS)
    if not isinstance(imu, pd.DataFrame) or not {*wanted} <= {*imu.columns}:
        return recording
    if not all(isinstance(kind, np.dtype) and kind.kind in "fiu" for kind in imu[wanted].dtypes):
        return recording
    even = spread_evenly(imu["t_s"].to_numpy(dtype=np.float64), [imu[name].to_numpy() for name in wanted[1:]])
    if even is None:
        return recording
    findings = (*recording.findings, even.finding(recording.description.imu))
    return replace(recording, imu=imu.assign(t_s=even.t), findings=findings)
