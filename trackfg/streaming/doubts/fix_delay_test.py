"""A stream tests whether its fixes are late or have rounded stamps, as the batch does with those of a run
(:mod:`trackfg.smoothing.doubts.late_fix_doubts`).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from trackfg.checks.diagnosis_positions import FixPassages, delay_of
from trackfg.numerics.arrays import Array
from trackfg.numerics.integrals import trapezoid_integral
from trackfg.results.events import Event
from trackfg.smoothing.doubts.late_fix_doubts import LateFixes, late_fixes, rounded_fixes
from trackfg.smoothing.fixes.fix_level import fix_level
from trackfg.streaming.doubts.reporting import event_of

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

    def events(self, innovations: Array, until_s: float) -> tuple[Event, ...]:
        """Return an event where the fixes are surely late, or have rounded stamps, by more than the chainage is known.

        ``innovations`` (n, 3) of fixes that agreed, m, with their sigmas, m, and the variances of the prediction, m^2.
        """
        t, _, speed, *_, usual = self.passed.T
        delay = delay_of(FixPassages(*self.passed[:, :5].T))
        if delay is not None and delay.is_sure:
            late: LateFixes | None = late_fixes(delay)
        else:
            late = rounded_fixes(t, lambda: fix_level(*innovations.T) if len(innovations) else 1.0)
        return () if late is None else tuple(event_of(doubt, until_s) for doubt in late.doubts(speed, usual**2))
