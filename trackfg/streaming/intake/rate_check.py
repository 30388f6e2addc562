"""Angular rates of a feed have to be those of a vehicle, as those of a whole recording: else their unit is another one.

Rates are averaged over half a second. In deg/s, declared as rad/s, curves turn faster than any vehicle does, or need
more lateral force than wheels can hold. Unlike gravity this shows in curves only, when much has been estimated already,
and a device that is moved by hand turns so fast, too: it is an event, once, from :data:`LEAST_S` of such rates on.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from trackfg.checks.columns import too_fast_hint
from trackfg.checks.limits import CheckLimits
from trackfg.numerics.arrays import Array
from trackfg.recording.description import Imu
from trackfg.results.events import Event, doubt_event

BLOCK_S = 0.5
"""Rates are averaged over as much, s: longer than blows and vibration."""
LEAST_S = 5.0
"""Time with impossible rates that says something of the unit, s: a curve lasts longer."""
LEAST_SHARE = 0.005
"""Share of all time likewise, as ``trackfg check`` asks of a recording."""


@dataclass
class RateCheck:
    """Counts half seconds: ``blocks`` of them in all, ``beyond`` what a vehicle does, ``since_s`` the first of these.

    ``waiting`` (n, 4): time and rates of one that is not complete; ``last`` and ``speed_mps``: time and distance of the
    newest row of the tach, and its speed. ``largest``: the largest mean rate. ``reported``: whether the event is out.
    """

    limits: CheckLimits
    waiting: Array = field(default_factory=lambda: np.empty((0, 4)))
    last: tuple[float, float] | None = None
    speed_mps: float = 0.0
    blocks: int = 0
    beyond: int = 0
    largest: float = 0.0
    since_s: float | None = None
    reported: bool = False

    def take(self, rows: Array, tach: Array | None, imu: Imu) -> Event | None:
        """Take the next rows of the IMU (n, 7) and of the tach (m, 2), canonical; return an event when it is due."""
        if self.reported:
            return None
        if tach is not None and len(tach):
            self._keep_speed(tach)
        rows = np.concatenate([self.waiting, rows[:, :4]])
        first = np.flatnonzero(np.diff(np.floor(rows[:, 0] / BLOCK_S), prepend=np.nan) != 0.0)
        self.waiting = rows[first[-1] :].copy() if first.size else rows
        if first.size < 2:
            return None
        sums = np.add.reduceat(rows[: first[-1]], first[:-1], axis=0)
        mean = np.abs(sums[:, 1:] / np.diff(first)[:, None])
        fastest, lateral = mean.max(axis=1), self.speed_mps * mean[:, 2]
        beyond = (fastest > self.limits.rate_error_radps) | (lateral > self.limits.lateral_error_mps2)
        self.blocks += beyond.size
        if not beyond.any():
            return None
        self.beyond += int(np.count_nonzero(beyond))
        self.largest = max(self.largest, float(fastest[beyond].max()))
        self.since_s = float(rows[first[:-1][beyond][0], 0]) if self.since_s is None else self.since_s
        if self.beyond * BLOCK_S < LEAST_S or self.beyond < LEAST_SHARE * self.blocks:
            return None
        self.reported = True
        reason = f"angular rates of {self.largest:.3g} rad/s as declared ({imu.gyro_unit}), which no vehicle holds"
        advice, last_s = f"{too_fast_hint(imu)}, and begin anew", float(rows[-1, 0])
        return doubt_event(("all quantities",), reason, advice, table="imu", t_s=self.since_s, until_s=last_s)

    def _keep_speed(self, tach: Array) -> None:
        """Keep the speed over the newest rows of the tach."""
        begin, end = self.last or (float(tach[0, 0]), float(tach[0, 1])), (float(tach[-1, 0]), float(tach[-1, 1]))
        if end[0] > begin[0]:
            self.last, self.speed_mps = end, abs(end[1] - begin[1]) / (end[0] - begin[0])
        elif self.last is None:
            self.last = end
