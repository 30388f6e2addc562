"""Displacement sensors on the vehicle show where the rails are.

The sensors of one unit (one place along the vehicle) over one rail make a point of that rail in body axes, the middle
of its top: across from the lateral sensor, half a head beyond the running edge, and up from the vertical one; a sensor
that is missing leaves its own place instead. Two units see each place twice: that is the factor
(:mod:`trackfg.factors.rail`), and the mean of both is the rail's profile.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.integrals import trapezoid_integral
from trackfg.recording.description import Laser
from trackfg.recording.model import Recording

Side = Literal["left", "right"]
SIDES: tuple[Side, ...] = ("left", "right")

_NOTHING_M = 1e3
"""Sigma of a direction in which a unit has no sensor."""

_HOLE_READINGS = 3.5
"""A silence of as many readings is a hole."""


@dataclass(frozen=True)
class Channel:
    """One sensor's readings: times (n,), displacements (n,), their integral over time (n,), 1-sigma of one, rate."""

    laser: Laser
    t: Array
    displacement: Array
    integral: Array

    @cached_property
    def rate_hz(self) -> float:
        """Readings a second."""
        return 1.0 / float(np.median(np.diff(self.t)))

    def mean(self, t: Array, window_s: float) -> Array:
        """Return means over ``window_s`` around ``t`` (m,), less near the record's ends; NaN beyond them and in its
        holes.
        """
        half = np.clip(np.minimum(t - self.t[0], self.t[-1] - t), 0.0, 0.5 * window_s)  # the middle stays at t
        low, high = t - half, t + half
        total = np.interp(high, self.t, self.integral) - np.interp(low, self.t, self.integral)
        instant = ~(high > low)
        mean = total / np.where(instant, 1.0, high - low)
        mean[instant] = np.interp(t[instant], self.t, self.displacement)
        near = np.searchsorted(self.t, t).clip(1, len(self.t) - 1)
        lower, upper = self.t[near - 1], self.t[near]
        longest = _HOLE_READINGS / self.rate_hz
        known = (upper - lower <= longest) & (t >= lower - longest) & (t <= upper + longest)
        return np.where(known, mean, np.nan)

    def mean_sd(self, window_s: float) -> float:
        """Return the sigma of such a mean, the noise of the readings being independent, m."""
        return self.laser.sd_m / float(np.sqrt(max(1.0, self.rate_hz * window_s)))


@dataclass(frozen=True)
class RailView:
    """The rail as one unit sees it. ``along_m``: the unit's place in the vehicle, positive ahead.

    ``head_m``: width of the rail's head, whose middle the vertical sensor sees and whose inner edge the lateral one.
    """

    side: Side
    along_m: float
    lateral: Channel | None
    vertical: Channel | None
    head_m: float = 0.0

    def points(self, t: Array, window_s: float) -> Array:
        """Return the middle of the rail's top in vehicle axes at times ``t``, m. Shape (m, 3)."""
        fallback = next(channel.laser.position_m for channel in (self.vertical, self.lateral) if channel is not None)
        place = np.tile(np.array(fallback), (len(t), 1))
        place[:, 0] = self.along_m
        for channel, axis in ((self.lateral, 1), (self.vertical, 2)):
            if channel is not None:
                place[:, axis] = channel.laser.position_m[axis] + channel.mean(t, window_s)
        if self.lateral is not None:
            place[:, 1] += (0.5 if self.side == "left" else -0.5) * self.head_m
        return place

    def sd(self, window_s: float) -> tuple[float, float]:
        """Return sigmas across and up, m."""
        channels = (self.lateral, self.vertical)
        across, up = (_NOTHING_M if channel is None else channel.mean_sd(window_s) for channel in channels)
        return across, up

    @property
    def rate_hz(self) -> float:
        """Readings a second of the slower of its sensors."""
        return min(channel.rate_hz for channel in (self.lateral, self.vertical) if channel is not None)


def rail_views(recording: Recording) -> list[RailView]:
    """Return every unit's view of every rail, the foremost first. Empty without lasers."""
    views = []
    lasers = recording.description.laser
    for along in sorted({laser.position_m[0] for laser in lasers}, reverse=True):
        for side in SIDES:
            by_axis = {laser.axis: laser for laser in lasers if laser.position_m[0] == along and laser.rail == side}
            if by_axis:
                lateral, vertical = (_channel(recording, by_axis.get(axis)) for axis in ("y", "z"))
                views.append(RailView(side, along, lateral, vertical, recording.description.track.head_m))
    return views


def _channel(recording: Recording, laser: Laser | None) -> Channel | None:
    if laser is None:
        return None
    table = recording.lasers[laser.name]
    t, d = table["t_s"].to_numpy(), table["displacement_m"].to_numpy()
    return Channel(laser, t, d, trapezoid_integral(t, d))


def unit_pairs(views: list[RailView]) -> Iterator[tuple[RailView, RailView]]:
    """Neighbouring views of one rail: (the one ahead, the one behind)."""
    for side in SIDES:
        along = [view for view in views if view.side == side]
        yield from pairwise(along)
