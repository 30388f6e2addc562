"""An outage is a time without any rows that is too long to be bridged: the window ends before it and begins anew after.

The inertial sensor's noise over a hole grows with its length. Up to :data:`LONGEST_S` the graph bridges it. Beyond, the
attitude behind the hole is known no better than to half a radian, steps at linearised factors do not converge, and
states become whatever they lead to. What goes on across an outage is the tach's count.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfg.checks.limits import CheckLimits
from trackfg.factors.odometry import MOST_CREEP
from trackfg.results.events import Event
from trackfg.streaming.rows import SAME_S
from trackfg.streaming.window.running_window import RunningWindow
from trackfg.streaming.window.sample_buffer import SampleBuffer
from trackfg.streaming.window.starting_window import KnownDistance

LONGEST_S = 100.0
"""The longest outage that is bridged, s. Chosen on the simulator: on the mainline in motion two outages of 90 s were
bridged well; of two of 120 s one was not, nor was one of 160 s."""
_BESIDE_S = 1.0
"""Rows of the tach that are further from an outage than this, s, do not determine the count at its ends."""


class Outage(NamedTuple):
    """A hole in all tables, from one edge of the inertial record to another, s."""

    begin_s: float
    end_s: float

    @property
    def event(self) -> Event:
        """The event that the estimates begin anew."""
        lasted_s = self.end_s - self.begin_s
        detail = f"no rows for {lasted_s:.1f} s: too long to be bridged; without GNSS heading and position are 0 here"
        return Event("restarted", t_s=self.begin_s, until_s=self.end_s, detail=detail)


def outage_after(buffer: SampleBuffer, t: float) -> Outage | None:
    """Return the outage that begins at a keyframe at ``t``, s, if one does."""
    data = buffer.inertial
    first = int(data.edges.searchsorted(t - SAME_S))
    if first >= len(data.bridged) or not data.bridged[first]:
        return None
    stop = first + int(np.argmin(np.append(data.bridged[first:], False)))
    outage = Outage(t, float(data.edges[stop]))
    if outage.end_s - t <= LONGEST_S:
        return None
    speed_s = buffer.first_speed(t + SAME_S)
    return outage if speed_s is None or speed_s >= outage.end_s - _BESIDE_S else None


def distance_after(outage: Outage, running: RunningWindow) -> KnownDistance:
    """Return the distance along the track after an outage that the newest keyframe of the window precedes.

    It is that before and what the tach has counted since, in the direction in which it went before. Without a count the
    vehicle may have run at any speed.
    """
    previous, counted = running.known_distance, _counted(outage, running)
    if counted is None:
        return KnownDistance(outage.end_s, previous.distance_m, previous.sd_at(outage.end_s))
    way, uncounted_m = (
        float(running.newest.states.odo.scale[-1]) * counted[0],
        CheckLimits().speed_error_mps * counted[1],
    )
    sd = float(np.sqrt(previous.sd_m**2 + (MOST_CREEP * way) ** 2 + uncounted_m**2))
    return KnownDistance(outage.end_s, previous.distance_m + way, sd)


def _counted(outage: Outage, running: RunningWindow) -> tuple[float, float] | None:
    """Return what the tach counted over an outage, m, forwards positive, and for how long beside it there is no row, s.

    None where it measures speeds, has no rows just before and after, or began again.
    """
    tach, rows, breaks = running.tach, running.buffer.tach, running.buffer.uncounted
    next_row = int(np.searchsorted(rows[:, 0], outage.end_s - SAME_S))
    if tach is None or tach.wheel.integrates_speed or not 0 < next_row < len(rows):
        return None
    (before_s, before_m), (after_s, after_m) = rows[next_row - 1], rows[next_row]
    missing_s = max(outage.begin_s - before_s, 0.0) + max(after_s - outage.end_s, 0.0)
    if missing_s > _BESIDE_S or ((breaks[:, 0] < after_s) & (breaks[:, 1] > before_s)).any():
        return None
    return float(tach.sense * (after_m - before_m)), float(missing_s)
