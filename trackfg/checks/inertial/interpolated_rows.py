"""Interpolated rows of the IMU are numbers on straight lines, by which a logger or a notebook has filled a hole.

They look like measurements of a very quiet sensor, and are none: a curve that began within the hole is not in them.
A row is *in line* where each of its six channels is, with the two rows before, on one line in time, up to a hundredth
of the noise of a sample. Noise does so once in 10^14 rows. Three such rows and more, a run, were interpolated where
they keep to one line all the way, and where four channels or more change by three times as much: the change is that
between two noisy samples, and of the motion between them. The noise is the declared one, or less where the distances
of rows from such lines are less, as the medians of blocks show them; before the first block all rows pass.

The first row of a run is seen to be one only by the second: it passes. So does the last, which was measured. How rows
are grouped makes no difference.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import true_runs
from trackfg.numerics.units import to_si
from trackfg.recording.description import Imu

_IN_LINE = 0.01
"""Distance from a line, in sigmas of a sample: that of rounding."""

_CHANGED = 3.0
"""Least change of a channel from the beginning on, in such distances."""

_FEWEST_CHANGED = 4
"""So many of the six channels change: a sensor with coarse steps, or without noise, does so in a few at most."""

_JUDGED_S = (0.0, 0.05, 0.1, 0.2, 0.4, 0.8)
"""A run is judged as soon as it can be, and again when it is as long, s: in a hole of seconds values change slowly."""

_FEWEST_ROWS = 3
"""Runs of fewer rows pass."""

_MOST = 0.5
"""Share of rows in line above which nothing was filled: the rows of a slow sensor were brought to a higher rate."""

_BLOCK_ROWS = 256
"""Rows of a block that shows the noise."""

_PERIOD_ROWS = 16384
"""One block in so many rows is looked at."""

_AT_ONCE = 4096
"""Rows of a record that are looked at in one piece, so that they stay in the cache."""

_TINY = float(np.finfo(float).tiny)
"""Least interval of two rows, s: one with the time of the row before divides nothing by 0."""

_OF_NOISE = 0.6745 * np.sqrt(6.0)
"""Median distance of a row from the line through the two before, in sigmas: it is x_k - 2 x_k-1 + x_k-2."""


@dataclass
class InterpolatedRows:
    """The detector separates measurements from interpolated rows, as they come. ``white`` (6,): densities of the noise,
    in the units of the rows per sqrt(Hz), the declared ones at first.

    ``newest`` (2, 7) or less: the newest rows. ``waiting`` (w, 7): rows of a run that is not judged yet, after the row
    ``begin`` (7,); of one that was interpolated its newest row, which may be a measurement. ``interpolated``: what the
    run of the newest row was found to be; None where it is in no run, or that is not judged yet. ``count``: how many
    rows came, and how many of them were in line. ``block`` (b, 7): rows so far of one that will show the noise.
    """

    white: Array
    newest: Array = field(default_factory=lambda: np.empty((0, 7)))
    begin: Array = field(default_factory=lambda: np.empty(7))
    waiting: Array = field(default_factory=lambda: np.empty((0, 7)))
    interpolated: bool | None = None
    count: tuple[int, int] = (0, 0)
    block: Array = field(default_factory=lambda: np.empty((0, 7)))

    @classmethod
    def of(cls, imu: Imu, *, is_canonical: bool) -> InterpolatedRows:
        """Return the detector before the first row; ``is_canonical``: rows are in SI."""
        white = np.array([imu.noise.gyro_white, imu.noise.accel_white])
        if not is_canonical:
            white /= to_si("angular rate", imu.gyro_unit), to_si("acceleration", imu.accel_unit)
        return cls(np.repeat(white, 3))

    def take(self, rows: Array) -> tuple[Array, Array]:
        """Take the next rows (n, 7), in order: return those that are measurements, and the times of others (m,), s."""
        pieces = []
        while len(rows):
            place = self.count[0] % _PERIOD_ROWS
            room = (_BLOCK_ROWS if place < _BLOCK_ROWS else _PERIOD_ROWS) - place
            pieces.append(self._take(rows[:room]))
            if place < _BLOCK_ROWS:
                self._learn(rows[:room])
            rows = rows[room:]
        if len(pieces) == 1:
            return pieces[0]
        measurements, interpolated = zip((rows, np.empty(0)), *pieces, strict=True)
        return np.concatenate(measurements), np.concatenate(interpolated)

    def _take(self, rows: Array) -> tuple[Array, Array]:
        with_newest = np.concatenate([self.newest, rows])
        matches, start, verdict = self._in_line(with_newest), with_newest[len(self.newest) - 1], None
        self.newest = with_newest[-2:]
        count, count_in_line = self.count
        self.count = count + len(rows), count_in_line + int(np.count_nonzero(matches))
        if not (len(self.waiting) or matches.any()):
            self.interpolated = None
            return rows, np.empty(0)
        in_line = np.zeros(len(self.waiting) + len(rows), dtype=bool)
        in_line[: len(self.waiting)] = True
        in_line[len(in_line) - len(matches) :] = matches
        if len(self.waiting) or (self.interpolated is not None and in_line[0]):
            start, verdict = self.begin, self.interpolated
        rows = np.concatenate([self.waiting, rows])
        counts = np.arange(1, len(rows) + 1) + count - len(self.waiting)
        mostly = count_in_line - len(self.waiting) + np.cumsum(in_line) > _MOST * counts
        self.waiting, self.interpolated = rows[:0], None
        lost, passing = np.zeros(len(rows), dtype=bool), len(rows)
        for first, end in true_runs(in_line).tolist():
            if first:
                start, verdict = rows[first - 1], None
            is_newest = end == len(rows)
            if verdict is None and (is_newest or end - first >= _FEWEST_ROWS):
                verdict = self._judged(start, rows[first:end], mostly[first:end])
            if verdict:
                lost[first : end - 1] = True
            if is_newest:
                self.begin, self.interpolated = start, verdict
                passing = first if verdict is None else end - 1 if verdict else end
                self.waiting = rows[passing:]
        return rows[:passing][~lost[:passing]], rows[lost, 0]

    def finish(self) -> Array:
        """Return the rows that wait, at the end."""
        rest, self.waiting = self.waiting, self.waiting[:0]
        return rest

    @property
    def waiting_since_s(self) -> float:
        """Time of the first row that waits, s; infinite where none does."""
        return float(self.waiting[0, 0]) if len(self.waiting) else np.inf

    def _learn(self, rows: Array) -> None:
        """Learn from rows of a block how small the noise is, once it is whole."""
        self.block = np.concatenate([self.block, rows])
        if len(self.block) < _BLOCK_ROWS:
            return
        block, self.block = self.block, self.block[:0]
        dt, step = np.diff(block[:, 0]), np.diff(block[:, 1:], axis=0)
        distance = np.abs(step[1:] - step[:-1])[~self._in_line(block)]
        if 2 * len(distance) > _BLOCK_ROWS:
            self.white = np.minimum(self.white, np.median(distance, axis=0) / _OF_NOISE * np.sqrt(np.median(dt)))

    def _in_line(self, rows: Array) -> np.ndarray:
        """Return which rows from the third of n on are in line with the two before. Shape (n - 2,), or (0,)."""
        t = rows[:, 0]
        dt = np.maximum(t[1:] - t[:-1], _TINY)
        ratio, limit = dt[1:] / dt[:-1], _IN_LINE / np.sqrt(dt[1:])
        in_line = np.ones(len(ratio), dtype=bool)
        for channel, white in enumerate(self.white.tolist(), 1):
            step = rows[1:, channel] - rows[:-1, channel]
            in_line &= np.abs(step[1:] - ratio * step[:-1]) <= white * limit
            if not in_line.any():  # one row in 300 is, by its first channel
                break
        return in_line

    def _judged(self, begin: Array, run: Array, mostly: np.ndarray) -> bool | None:
        """Return whether a run (n, 7) after the row ``begin`` was interpolated; None where it is too short for that.

        ``mostly`` (n,): whether most rows up to each were in line.
        """
        offsets = run - begin  # times and values from the beginning on
        for least_s in _JUDGED_S:
            length = max(int(np.searchsorted(offsets[:, 0], least_s)) + 1, _FEWEST_ROWS)
            if length > len(run):
                return None
            duration, change = offsets[length - 1, 0], offsets[length - 1, 1:]
            tolerance = _IN_LINE * self.white / np.sqrt(duration / length)
            distance = offsets[:length, 1:] - offsets[:length, :1] / duration * change
            if self.count[0] <= _BLOCK_ROWS or mostly[length - 1] or (np.abs(distance) > tolerance).any():
                return False
            if np.count_nonzero(np.abs(change) > _CHANGED * tolerance) >= _FEWEST_CHANGED:
                return True
        return False


def interpolated_times(imu: Imu, parts: Iterable[Array]) -> Array:
    """Return the times (m,), s, of rows that were interpolated, of a whole record in SI: ``parts`` (n, 7) in order."""
    detector, times = InterpolatedRows.of(imu, is_canonical=True), [np.empty(0)]
    for rows in parts:
        times += [detector.take(rows[first : first + _AT_ONCE])[1] for first in range(0, len(rows), _AT_ONCE)]
    return np.concatenate(times)
