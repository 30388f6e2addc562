"""The tach's count shows over a jump of the clocks whether they were set, or rows are missing.

Where the stamps of all tables jump ahead together, either nothing was recorded for a time, or the clocks were set.
With the speeds v before and after, in m of the count a second, and Dt between the readings on either side of a jump by
L, the count c has grown by

    dc = v Dt          rows are missing: the vehicle went on for as long as the stamps say (a gap)
    dc = v (Dt - L)    none are: the clocks were set

With the mean of both speeds the second holds to ``FREE_S`` of rolling and the scatter of the count, whatever the
wheel's scale. A count between both is a gap: the vehicle may have braked. At rest, or without a count, the two cannot
be distinguished, and at rest it hardly matters.

Where the clock restarted, times are contiguous already, and the same is tested with L = 0; if the vehicle stood before
and after, the test is whether the count is the same and gravity has the same direction.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.results.events import Event
from trackfg.streaming.rows import SAME_S

LOOK_S = 1.0
"""The speeds are means over so much of the count before and after a jump, s."""
FREE_S = 0.1
"""A recorder that is interrupted while its clock is set may miss so much, s."""
_APART_S = 0.2
"""The clock of a table may be so far from the IMU's, s."""
_SHARE = 0.3
"""The same as a share of the jump, where that is less."""
_SIGMAS = 4.0
"""Agreement, in sigmas of the scatter."""
_FASTER_MPS2 = 3.0
"""No rail vehicle changes its speed faster, m/s^2, so that a faster one is a gap."""
_LEAST_ROWS = 3
"""Rows on either side of a jump that make a line and its scatter."""
_TILT = 1e-3
"""Change of the direction of gravity, rad, beyond which a vehicle at rest was moved to other track."""


class Jump(NamedTuple):
    """A jump from the last row of the IMU before to the first one after, s; by how much the clock went ahead, s; and
    whether it restarted.
    """

    begin_s: float
    end_s: float
    by_s: float
    restart: bool = False

    @property
    def middle_s(self) -> float:
        """Rows up to this time are before the jump, s."""
        return 0.5 * (self.begin_s + self.end_s)

    def is_of(self, event: Event) -> bool:
        """Return whether this is the event of the jump."""
        return event.t_s is not None and abs(event.t_s - self.begin_s) < SAME_S

    def is_of_all(self, tables: Mapping[str, Array], last_s: Mapping[str, float]) -> bool:
        """Return whether no table has rows within the jump, and all stay in order without it.

        ``last_s``: by table, the time of its last row before these ``tables``, s.
        """
        apart = min(_APART_S, _SHARE * self.by_s)
        for name, table in tables.items():
            if name == "imu" or not len(table):
                continue
            t = table[:, 0]
            if not self.restart and ((t > self.begin_s + apart) & (t < self.end_s - apart)).any():
                return False
            i = int(np.searchsorted(t, self.middle_s, side="right"))
            newest = t[i - 1] if i else last_s.get(name, -np.inf)
            if i < len(t) and t[i] - self.by_s <= newest:
                return False
        return True


class CountAround(NamedTuple):
    """The tach's rows, (n, 2) and (m, 2), s and m, within :data:`LOOK_S` before and after a jump."""

    jump: Jump
    earlier: Array
    later: Array

    @classmethod
    def of(cls, jump: Jump, tach: Array) -> CountAround:
        """Return those of the rows (k, 2) of a tach, in order."""
        near = tach[(tach[:, 0] > jump.begin_s - LOOK_S) & (tach[:, 0] <= jump.end_s + LOOK_S)]
        first = int(np.searchsorted(near[:, 0], jump.middle_s, side="right"))
        return cls(jump, near[:first], near[first:])

    @property
    def reaches_jump(self) -> bool:
        """Return whether there are rows up to the jump, as often as before."""
        return len(self.earlier) >= _LEAST_ROWS and _goes_on(self.earlier, self.jump.begin_s)

    @property
    def leaves_jump(self) -> bool:
        """Return whether there are rows from the jump on, as often as later."""
        return len(self.later) >= _LEAST_ROWS and _goes_on(self.later[::-1], self.jump.end_s)

    @property
    def stands(self) -> bool:
        """Return whether the count is the same in all rows."""
        return not np.ptp(np.concatenate([self.earlier, self.later])[:, 1])

    def is_reset(self, resets: list[Event]) -> bool:
        """Return whether one of the tach's ``resets`` lies among the rows."""
        begin, end = self.earlier[0, 0], self.later[-1, 0]
        return any(end_of(event) >= begin and (event.t_s or 0.0) <= end for event in resets)

    @property
    def shows_gap(self) -> bool:
        """Return whether the count has grown over the jump by what half of it takes, or more; True at rest."""
        rate = _line(self.earlier)[0]
        if rate == 0.0:
            return True
        seconds, counted = (self.later[:1] - self.earlier[-1:]).T
        return bool((counted / rate > seconds - 0.5 * self.jump.by_s).any())

    @property
    def rolled_on(self) -> bool:
        """Return whether the count went on as if no time had passed, and could not have done so in that time."""
        jump = self.jump
        (slow, t0, scatter), (fast, t1, scatter1) = _line(self.earlier), _line(self.later)
        speed = 0.5 * (slow + fast)
        if slow * fast <= 0.0 or abs(fast - slow) > _FASTER_MPS2 * (t1 - t0 - jump.by_s):
            return False
        free = FREE_S if jump.restart else min(FREE_S, _SHARE * jump.by_s)
        allowed = free * abs(speed) + _SIGMAS * max(scatter, scatter1)
        if not jump.restart and abs(speed) * jump.by_s < 2.0 * allowed:
            return False
        seconds, counted = self.later[0] - self.earlier[-1]
        return bool(abs(counted - speed * (seconds - jump.by_s)) <= allowed)


def stands_as_it_did(jump: Jump, imu: Array) -> bool:
    """Return whether gravity has the same direction before and after a jump, by the rows (n, 7) of the IMU."""
    t = imu[:, 0]
    earlier = imu[(t > jump.begin_s - LOOK_S) & (t <= jump.middle_s), 4:7]
    later = imu[(t > jump.middle_s) & (t <= jump.end_s + LOOK_S), 4:7]
    if min(len(earlier), len(later)) < _LEAST_ROWS:
        return False
    noise = np.sqrt(earlier.var(axis=0) / len(earlier) + later.var(axis=0) / len(later))
    turned = np.abs(later.mean(axis=0) - earlier.mean(axis=0))
    return bool((turned <= _TILT * np.linalg.norm(earlier.mean(axis=0)) + _SIGMAS * noise).all())


def end_of(event: Event) -> float:
    """Return the last time of an event, s; minus infinity where it has none."""
    return -np.inf if event.until_s is None else event.until_s


def _goes_on(rows: Array, until: float) -> bool:
    """Return whether rows come as often as before up to a time."""
    return bool(abs(until - rows[-1, 0]) <= 3.0 * np.abs(np.diff(rows[:, 0])).max() + _APART_S)


def _line(rows: Array) -> tuple[float, float, float]:
    """Return rate, middle time and scatter of the straight line through counts (n, 2)."""
    t, count = rows.T - rows.mean(axis=0)[:, None]
    rate = float(t @ count / (t @ t))
    return rate, float(rows[:, 0].mean()), float(np.std(count - rate * t))
