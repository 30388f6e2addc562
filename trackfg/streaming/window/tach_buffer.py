"""The tach buffer signs the newest rows of a stream's tach by the vehicle's motion, and learns their resolution.

A stream begins at rest, where a count does not show its steps. Until it does, the description gives them, or a coarse
step is assumed: a reading that is trusted too much would hold the wheel where in a step it stood.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, changed
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import median_interval
from trackfg.recording.description import Tach
from trackfg.sensors.tach import CRAWL_MPS, Wheel, longest_silence_s, read_resolution, silences
from trackfg.streaming.window.sample_buffer import AFTER_S

_KEPT_S = 3.0
"""Maximum age of the rows kept, before the newest keyframe, s: rates are means over some tenths."""
_LEARNT_M = 20.0
"""Minimum distance rolled after which the resolution is known, m."""
_MOST_ROWS = 20_000
"""Number of rows since the wheel began to turn after which it is known, too."""
_ASSUMED_STEP_M = 0.05
"""A step of a tach whose description gives none, m: coarser than any of 64 pulses a turn."""
_LATE_INTERVALS = 1.5
"""A row that has not come after so many usual intervals is missing."""
_AT_PULSES = 0.2
"""Rounding, in steps, below which rows are the pulses' own times; of rows at any times it is 0.29 (1/sqrt(12))."""


@dataclass
class TachBuffer:
    """The newest rows of a tach. ``wheel``: that of the first rows, with the resolution as far as it is known.

    ``rows`` (m, 2): times and signed distances, ``raw`` the last one's distance as recorded. ``sense``: in which an
    unsigned tach counts, 1 or -1. A silence longer than ``longest_silence_s`` is a gap; a row later than ``late_s``
    after the one before is missing. ``resolution``: None where the tach gives speeds.
    """

    wheel: Wheel
    rows: Array
    raw: float
    signed: bool
    longest_silence_s: float
    late_s: float = 0.0
    resolution: TachResolution | None = None
    sense: float = 1.0

    @classmethod
    def of(cls, wheel: Wheel, rows: Array, tach: Tach, *, max_gap_s: float) -> TachBuffer:
        """Return the buffer of a first ``wheel`` and of the rows (n, 2) that it was read from."""
        signed_rows = np.column_stack([wheel.t, wheel.distance])
        resolution = None if wheel.integrates_speed else TachResolution.of(tach)
        signed = tach.signed or wheel.integrates_speed
        silence, late = longest_silence_s(wheel.t, max_gap_s), _LATE_INTERVALS * median_interval(wheel.t)
        last = len(signed_rows) - 1
        tach_buffer = cls(wheel, signed_rows, float(rows[last, 1]), signed, silence, late, resolution)
        tach_buffer._learn(rows[: last + 1])
        return tach_buffer

    def counting_on(self, t: float, count: float) -> TachBuffer:
        """Return the same, with distances shifted so that the count at ``t`` (s) is ``count`` (m)."""
        shift = np.array([0.0, count - float(self.wheel.at(np.array([t]))[0])])
        return replace(self, rows=self.rows + shift)

    def with_known_rounding(self, families: tuple[Family, ...]) -> tuple[Family, ...]:
        """Return families of the first window with the sigma of tach readings as far as the rounding is known."""
        sigma = self.wheel.rounding_sd
        return changed(
            families, FactorType.TACH_READING, lambda family: family.with_sigma(np.full_like(family.sigma, sigma))
        )

    @property
    def silent_at_rest(self) -> bool:
        """Return whether rows may come at the pulses' own times, and so none at rest."""
        return self.resolution is not None and (self.resolution.at_pulses or not self.resolution.has_turned)

    def _learn(self, rows: Array) -> None:
        if self.resolution is not None and self.resolution.learning:
            self.resolution.learn(rows)
            quantum, rounding = self.resolution.quantum, self.resolution.rounding_sd
            self.wheel = replace(self.wheel, quantum=quantum, rounding_sd=rounding)

    def rows_end(self, t: float, rows: Array, until: float) -> float | None:
        """Return up to when ``rows`` (n, 2) are needed for a keyframe at ``t``, s; None while one of these may come.

        The rows ``until`` now, s, have come. A tach that is read once a second is waited for; one whose rows are the
        pulses' own times may stand still.
        """
        end, next_row = t + AFTER_S, int(rows[:, 0].searchsorted(t))
        at_pulses = self.resolution is not None and self.resolution.at_pulses
        if not at_pulses and not (next_row < len(rows) and rows[next_row, 0] <= end):
            if next_row < len(rows) and rows[next_row, 0] <= t + self.late_s:
                return float(rows[next_row, 0])
            return end if until >= max(end, t + self.late_s) else None
        return end if until >= end else None

    def wheel_until(
        self, until: float, rows: Array, newest_s: float, speeds: tuple[float, float], uncounted: Array
    ) -> Wheel:
        """Return the wheel up to ``until``, s. ``rows`` (n, 2) as recorded; all since the last call must be among them.

        ``speeds``: forward, m/s, at the newest keyframe, which is at ``newest_s``, and predicted at the next; 0 where
        not known to be another. Rows up to the newest keyframe are signed for good. In the spans ``uncounted`` (u, 2),
        s, the tach did not count.
        """
        fresh = rows[slice(*rows[:, 0].searchsorted([self.rows[-1, 0], until], side="right").tolist())]
        self._learn(fresh)
        raw = np.concatenate([[self.raw], fresh[:, 1]])
        turned = raw[1:] - raw[:-1]
        if not self.signed:
            self.sense = old_sense = self._sense_at(speeds[0])
            turned *= np.where(fresh[:, 0] > newest_s, self._sense_at(speeds[1]), old_sense)
        known = len(self.rows)
        every = np.concatenate([self.rows, fresh])
        every[known:, 1] = self.rows[-1, 1] + turned.cumsum()
        settled = max(int(every[:, 0].searchsorted(newest_s, side="right")), 1)
        first = min(max(int(every[:, 0].searchsorted(newest_s - _KEPT_S)) - 1, 0), settled - 1)
        self.rows, self.raw = every[first:settled], float(raw[max(settled - known, 0)])
        return self._wheel(every, until, uncounted)

    def _sense_at(self, speed: float) -> float:
        """Return the sense in which an unsigned tach counts at a forward ``speed``, m/s."""
        return self.sense if self.signed or abs(speed) <= CRAWL_MPS else float(np.sign(speed))

    def wheel_over(self, rows: Array, t: Array, count: Array, uncounted: Array) -> Wheel:
        """Return the wheel over keyframes at ``t`` (n,), s, from ``rows`` (m, 2) as recorded, at least one.

        An unsigned tach is signed by the keyframes' ``count`` (n,), m.
        """
        way = np.ones(max(len(rows) - 1, 0))
        if not self.signed:
            middle = 0.5 * (rows[1:, 0] + rows[:-1, 0])
            way[np.interp(middle + 1e-3, t, count) < np.interp(middle - 1e-3, t, count)] = -1.0
        signed = rows[0, 1] + np.concatenate([[0.0], np.cumsum(way * np.diff(rows[:, 1]))])
        return self._wheel(np.column_stack([rows[:, 0], signed]), float(t[-1]), uncounted)

    def _wheel(self, rows: Array, until: float, uncounted: Array) -> Wheel:
        """Return the wheel of signed rows (n, 2) up to a time, s."""
        if self.resolution is not None and self.resolution.at_pulses and rows[-1, 0] < until:
            rows = np.concatenate([rows, [[until, rows[-1, 1]]]])  # a wheel without pulses does not roll
        t, distance = rows.T
        gaps = silences(t, distance, self.wheel.quantum, self.longest_silence_s)
        return self.wheel.with_rows(t, distance, gaps, uncounted)


@dataclass
class TachResolution:
    """The resolution of a tach. ``quantum``: the distance of one count, m; ``rounding_sd``: of a reading, m.

    ``rows`` (n, 2): times and distances as recorded since the wheel began to turn, while ``learning``; at rest the
    last one.
    """

    quantum: float
    rounding_sd: float
    rows: Array
    learning: bool = True

    @classmethod
    def of(cls, tach: Tach) -> TachResolution:
        """Return what a description gives before there are rows."""
        step = _ASSUMED_STEP_M
        if tach.kind == "pulses" and tach.pulses_per_rev and tach.wheel_diameter_m:
            step = np.pi * tach.wheel_diameter_m / tach.pulses_per_rev
        return cls(step, step / float(np.sqrt(12.0)), np.zeros((0, 2)))

    @property
    def at_pulses(self) -> bool:
        """Return whether rows are the pulses' own times, as far as they show."""
        return self.rounding_sd < _AT_PULSES * self.quantum

    @property
    def has_turned(self) -> bool:
        """Return whether the wheel has turned since the first row."""
        return not self.learning or len(self.rows) > 1

    def learn(self, rows: Array) -> None:
        """Learn from the next rows (n, 2) as recorded; earlier ones may be among them."""
        if not self.learning:
            return
        new = rows if not len(self.rows) else rows[rows[:, 0] > self.rows[-1, 0]]
        every = np.concatenate([self.rows, new])
        moved = np.flatnonzero(np.diff(every[:, 1]))
        if not moved.size:
            self.rows = every[-1:]
            return
        self.rows = every[moved[0] :]
        self.quantum, self.rounding_sd = read_resolution(*self.rows.T)
        rolled = float(np.abs(np.diff(self.rows[:, 1])).sum())
        if rolled > _LEARNT_M or len(self.rows) > _MOST_ROWS:
            self.learning, self.rows = False, self.rows[:0]
