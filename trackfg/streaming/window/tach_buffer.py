"""The tachometer of a stream: the newest rows as a :class:`~trackfg.sensors.tach.Wheel`, signed as the vehicle was
moving.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, changed
from trackfg.numerics.arrays import Array
from trackfg.recording.description import Tach
from trackfg.sensors.tach import CRAWL_MPS, Wheel, longest_silence_s, silences
from trackfg.streaming.window.tach_resolution import TachResolution

_KEPT_S = 3.0


@dataclass
class Odometer:
    """``wheel``: that of the first seconds, with the resolution as it is known. ``rows`` (m, 2): times and signed
    distances of the newest rows that were taken, ``raw`` the last one's distance as recorded. ``sense`` of an unsigned
    tach's counting. A silence of more than ``longest_silence_s`` is a gap. ``resolution``: None where the tach gives
    speeds.
    """

    wheel: Wheel
    rows: Array
    raw: float
    signed: bool
    longest_silence_s: float
    resolution: TachResolution | None = None
    sense: float = 1.0

    @classmethod
    def of(cls, wheel: Wheel, rows: Array, tach: Tach, *, max_gap_s: float) -> Odometer:
        """From the first seconds: their wheel, and the rows it was read from (n, 2)."""
        known = np.column_stack([wheel.t, wheel.distance])
        resolution = None if wheel.integrates_speed else TachResolution.of(tach)
        signed = tach.signed or wheel.integrates_speed
        longest = longest_silence_s(wheel.t, max_gap_s)
        odometer = cls(wheel, known, float(rows[len(known) - 1, 1]), signed, longest, resolution)
        odometer._learn(rows[: len(known)])
        return odometer

    def counting_on(self, t: float, count: float) -> Odometer:
        """Return the same, with distances shifted so that the count at ``t`` (s) is ``count`` (m)."""
        shift = np.array([0.0, count - float(self.wheel.at(np.array([t]))[0])])
        return replace(self, rows=self.rows + shift)

    def rounded(self, families: tuple[Family, ...]) -> tuple[Family, ...]:
        """The families of the first seconds, with readings as exact as they are known to be."""
        sigma = self.wheel.rounding_sd
        return changed(
            families, FactorType.TACH_READING, lambda family: replace(family, sigma=np.full_like(family.sigma, sigma))
        )

    @property
    def silent_at_rest(self) -> bool:
        """Whether rows may come at the pulses' own times, and so none at rest."""
        return self.resolution is not None and (self.resolution.at_pulses or not self.resolution.has_turned)

    def _learn(self, rows: Array) -> None:
        if self.resolution is not None and self.resolution.learning:
            self.resolution.learn(rows)
            quantum, rounding = self.resolution.quantum, self.resolution.rounding_sd
            self.wheel = replace(self.wheel, quantum=quantum, rounding_sd=rounding)

    def about(self, rows: Array, here: float, until: float, speed: float, uncounted: Array) -> Wheel:
        """The wheel up to ``until``; ``rows`` (n, 2) as recorded, none left out since the last call. In the spans
        ``uncounted`` (u, 2), s, it did not count.

        What is older than ``here``, where the vehicle's forward ``speed`` is known, is settled with its sign.
        """
        if not self.signed and abs(speed) > CRAWL_MPS:
            self.sense = float(np.sign(speed))
        fresh = rows[(rows[:, 0] > self.rows[-1, 0]) & (rows[:, 0] <= until)]
        self._learn(fresh)
        signed = self.rows[-1, 1] + self.sense * (fresh[:, 1] - self.raw)
        every = np.concatenate([self.rows, np.column_stack([fresh[:, 0], signed])])
        raw = np.concatenate([np.full(len(self.rows), self.raw), fresh[:, 1]])
        settled = max(int(np.searchsorted(every[:, 0], here, side="right")), 1)
        first = min(max(int(np.searchsorted(every[:, 0], here - _KEPT_S)) - 1, 0), settled - 1)
        self.rows, self.raw = every[first:settled], float(raw[settled - 1])
        return self._wheel(every, until, uncounted)

    def over(self, rows: Array, t: Array, count: Array, uncounted: Array) -> Wheel:
        """The wheel over keyframes at ``t`` (n,), s, in the sense in which their ``count`` (n,), m, goes; ``rows``
        (m, 2) as recorded.
        """
        way = np.ones(max(len(rows) - 1, 0))
        if not self.signed:
            middle = 0.5 * (rows[1:, 0] + rows[:-1, 0])
            way[np.interp(middle + 1e-3, t, count) < np.interp(middle - 1e-3, t, count)] = -1.0
        signed = rows[0, 1] + np.concatenate([[0.0], np.cumsum(way * np.diff(rows[:, 1]))])
        return self._wheel(np.column_stack([rows[:, 0], signed]), float(t[-1]), uncounted)

    def _wheel(self, rows: Array, until: float, uncounted: Array) -> Wheel:
        """From signed rows (n, 2) up to a time."""
        if self.resolution is not None and self.resolution.at_pulses and rows[-1, 0] < until:
            rows = np.concatenate([rows, [[until, rows[-1, 1]]]])  # a wheel that says nothing does not roll
        t, distance = rows.T
        gaps = silences(t, distance, self.wheel.quantum, self.longest_silence_s)
        return replace(self.wheel, t=t, distance=distance, gaps=gaps, uncounted=uncounted)
