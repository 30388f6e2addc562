"""A stream tests whether its fixes are late, as :mod:`trackfg.smoothing.doubts.late_fix_doubts` does of a run."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from trackfg.checks.diagnosis_positions import FixPassages, delay_of
from trackfg.numerics.arrays import Array
from trackfg.numerics.integrals import trapezoid_integral
from trackfg.results.events import Event, doubt_event
from trackfg.smoothing.doubts.late_fix_doubts import late_in_words, moved_in_sigmas
from trackfg.smoothing.doubts.usual_sigmas import LEAST_WIDENING

_MOST = 300
"""So many of the newest fixes are kept: readers do not change."""


@dataclass
class FixDelayTest:
    """The test keeps the newest fixes.

    ``passed`` (n, 6) has of each of the newest fixes the time, s, the way since the start of the stream, m, the
    speed, m/s, the chainage and its sigma, m, and the sigma of the stream's chainage, m. ``last`` (1, 3): time, way and
    speed of the newest row, none before the first.
    """

    passed: Array = field(default_factory=lambda: np.zeros((0, 6)))
    last: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def put(self, smoothed: pd.DataFrame, fixes: pd.DataFrame | None) -> None:
        """Take the next rows of the trajectory, and the fixes of their time."""
        if not len(smoothed):
            return
        rows = np.stack([smoothed["t_s"].to_numpy(), smoothed["speed_mps"].to_numpy()])
        t, speed = np.concatenate([self.last[:, [0, 2]].T, rows], axis=1)
        way = (self.last[0, 1] if len(self.last) else 0.0) + trapezoid_integral(t, speed)
        self.last = np.array([[t[-1], way[-1], speed[-1]]])
        if fixes is None or not len(fixes):
            return
        at, chainage, sd = fixes[["t_s", "chainage_m", "chainage_sd_m"]].to_numpy().T
        usual = np.interp(at, smoothed["t_s"], smoothed["chainage_m_sd"])
        new = np.column_stack([at, np.interp(at, t, way), np.interp(at, t, speed), chainage, sd, usual])
        self.passed = np.concatenate([self.passed, new[(at > t[0]) & (at <= t[-1])]])[-_MOST:]

    def events(self, until_s: float) -> tuple[Event, ...]:
        """Return an event where the fixes are surely late, by more than the chainage is known."""
        delay = delay_of(FixPassages(*self.passed[:, :5].T))
        if delay is None or not delay.is_sure:
            return ()
        factor = moved_in_sigmas(delay.delay_s, self.passed[:, 2], self.passed[:, 5] ** 2)
        if factor < LEAST_WIDENING:
            return ()
        advice = f"multiply its sigmas by {factor:.1f}, or add {-delay.delay_s:.2f} to fixes.time_offset_s"
        return (doubt_event(("chainage",), late_in_words(delay), advice, t_s=until_s),)
