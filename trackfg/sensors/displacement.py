"""Where the rails are, as displacement sensors on the vehicle see them.

The sensors of one unit (one place along the vehicle) over one rail make a point of that rail in body axes: across from
the lateral sensor, up from the vertical one; a sensor that is missing leaves its own place instead. Two units see each
place twice: that is the factor (:mod:`trackfg.factors.rail`), and the mean of both is the rail's profile.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from trackfg.config import LaserConfig
from trackfg.factors.family import Family, Loss
from trackfg.factors.rail import same_rail
from trackfg.factors.states import States
from trackfg.graph.build import Problem
from trackfg.numerics.frames import Array
from trackfg.numerics.hermite import hermite_weights
from trackfg.numerics.passes import Pass, passes
from trackfg.numerics.spans import within
from trackfg.output.dense_motion import DenseMotion, dense_motion
from trackfg.recording.description import Laser
from trackfg.recording.model import Recording

Side = Literal["left", "right"]
SIDES: tuple[Side, ...] = ("left", "right")

_DENSE_STEP_S = 0.02
_NOTHING_M = 1e3
"""Sigma of a direction in which a unit has no sensor."""

_HOLE_READINGS = 3.5
"""A silence of as many readings is a hole."""

_APART_M = 0.2
"""Keyframes closer than this see the same place again."""


@dataclass(frozen=True)
class Channel:
    """One sensor's readings: times (n,), displacements (n,), their integral over time (n,), 1-sigma of one, rate."""

    laser: Laser
    t: Array
    displacement: Array
    integral: Array

    @property
    def rate_hz(self) -> float:
        """Readings a second."""
        return 1.0 / float(np.median(np.diff(self.t)))

    def mean(self, t: Array, window_s: float) -> Array:
        """Means over ``window_s`` around ``t`` (m,), less near the record's ends; NaN beyond them and in its holes."""
        half = np.clip(np.minimum(t - self.t[0], self.t[-1] - t), 0.0, 0.5 * window_s)  # the middle stays at t
        low, high = t - half, t + half
        total = np.interp(high, self.t, self.integral) - np.interp(low, self.t, self.integral)
        at = np.interp(t, self.t, self.displacement)
        mean = np.where(high > low, total / np.where(high > low, high - low, 1.0), at)
        near = np.searchsorted(self.t, t).clip(1, len(self.t) - 1)
        before, after = self.t[near - 1], self.t[near]
        longest = _HOLE_READINGS / self.rate_hz
        known = (after - before <= longest) & (t >= before - longest) & (t <= after + longest)
        return np.where(known, mean, np.nan)

    def mean_sd(self, window_s: float) -> float:
        """Sigma of such a mean, the noise of the readings being independent, m."""
        return self.laser.sd_m / float(np.sqrt(max(1.0, self.rate_hz * window_s)))


@dataclass(frozen=True)
class RailView:
    """What one unit sees of one rail. ``along_m``: the unit's place in the vehicle, positive ahead."""

    side: Side
    along_m: float
    lateral: Channel | None
    vertical: Channel | None

    def points(self, t: Array, window_s: float) -> Array:
        """The rail in vehicle axes at times ``t``, m. Shape (m, 3)."""
        fallback = next(channel.laser.position_m for channel in (self.vertical, self.lateral) if channel is not None)
        place = np.tile(np.array(fallback), (len(t), 1))
        place[:, 0] = self.along_m
        for channel, axis in ((self.lateral, 1), (self.vertical, 2)):
            if channel is not None:
                place[:, axis] = channel.laser.position_m[axis] + channel.mean(t, window_s)
        return place

    def sd(self, window_s: float) -> tuple[float, float]:
        """Sigmas across and up, m."""
        channels = (self.lateral, self.vertical)
        across, up = (_NOTHING_M if channel is None else channel.mean_sd(window_s) for channel in channels)
        return across, up

    @property
    def rate_hz(self) -> float:
        """Readings a second of the slower of its sensors."""
        return min(channel.rate_hz for channel in (self.lateral, self.vertical) if channel is not None)


def rail_views(recording: Recording) -> list[RailView]:
    """Every unit's view of every rail, the foremost first. Empty without lasers."""
    views = []
    lasers = recording.description.laser
    for along in sorted({laser.position_m[0] for laser in lasers}, reverse=True):
        for side in SIDES:
            here = {laser.axis: laser for laser in lasers if laser.position_m[0] == along and laser.rail == side}
            if here:
                lateral, vertical = (_channel(recording, here.get(axis)) for axis in ("y", "z"))
                views.append(RailView(side, along, lateral, vertical))
    return views


def _channel(recording: Recording, laser: Laser | None) -> Channel | None:
    if laser is None:
        return None
    table = recording.lasers[laser.name]
    t, d = table["t_s"].to_numpy(), table["displacement_m"].to_numpy()
    integral = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(t) * (d[1:] + d[:-1]))])
    return Channel(laser, t, d, integral)


def unit_pairs(views: list[RailView]) -> Iterator[tuple[RailView, RailView]]:
    """Neighbouring views of one rail: (the one ahead, the one behind)."""
    for side in SIDES:
        along = [view for view in views if view.side == side]
        yield from pairwise(along)


def tied_by_rails(problem: Problem, states: States, views: list[RailView], config: LaserConfig) -> Problem:
    """The problem with the lasers' factors, places matched and directions taken at ``states``."""
    others = tuple(family for family in problem.families if family.name not in ("rail within", "rail apart"))
    motion = dense_motion(problem, states, _DENSE_STEP_S)
    families = [
        family
        for ahead, behind in unit_pairs(views)
        for stretch in passes(states.odo[:, 0])
        for family in _pair(problem, states, motion, stretch, ahead, behind, config)
        if len(family)
    ]
    families += [family for view in views for family in _held(problem, states, view, config) if len(family)]
    return replace(problem, families=(*others, *families))


def _pair(
    problem: Problem,
    states: States,
    motion: DenseMotion,
    stretch: Pass,
    ahead: RailView,
    behind: RailView,
    config: LaserConfig,
) -> tuple[Family, ...]:
    leading, trailing = (ahead, behind) if stretch.sense > 0 else (behind, ahead)
    rows = stretch.rows(problem.t, motion.t)
    gone = np.maximum.accumulate(stretch.sense * motion.distance[rows])
    own = np.arange(stretch.first, stretch.last + 1)
    place = stretch.sense * states.odo[own, 0] + (ahead.along_m - behind.along_m)
    fresh = np.concatenate([[True], np.floor(place[1:] / _APART_M) > np.floor(place[:-1] / _APART_M)])
    t = np.interp(place, gone, motion.t[rows], right=np.nan)
    seen = np.isfinite(t) & fresh
    k, t = own[seen], t[seen]
    j = np.clip(np.searchsorted(problem.t, t, side="right") - 1, 0, len(problem.t) - 2)
    window = config.window_s
    lead, trail = leading.points(problem.t[k], window), trailing.points(t, window)
    kept = (j - k < config.max_keyframes) & np.isfinite(lead).all(axis=1) & np.isfinite(trail).all(axis=1)
    k, t, j, lead, trail = k[kept], t[kept], j[kept], lead[kept], trail[kept]
    if k.size == 0:
        return ()
    h, T = (t - problem.t[j]) / (problem.t[j + 1] - problem.t[j]), problem.t[j + 1] - problem.t[j]

    at = motion.at(t)
    start, end = states.nav[j], states.nav[j + 1]
    # Detail and turning are those of the motion at these states, which closes at both ends.
    back = np.swapaxes(start.R, 1, 2)
    w0, w1, u0, u1 = hermite_weights(h[:, None], T[:, None])
    cubic = w0 * start.p + w1 * end.p + u0 * start.v + u1 * end.v
    arm = problem.lever_arm
    pinned = problem.noise.accel * T**1.5 * np.sqrt((h * (1.0 - h)) ** 3 / 3.0)
    sigma = np.column_stack(
        [
            np.sqrt(a**2 + b**2 + config.match_sd_m**2 + pinned**2)
            for a, b in zip(leading.sd(window), trailing.sd(window), strict=True)
        ]
    )
    return same_rail(
        first=k,
        start=j,
        across=_across(at.nav.p - states.nav.p[k]),
        lead=lead - arm,
        trail=trail - arm,
        fraction=h,
        interval=T,
        turned=back @ at.nav.R,
        turn=back @ end.R,
        detail=at.nav.p - cubic,
        sigma=sigma,
        loss=Loss("huber", config.robust_width),
    )


def _held(problem: Problem, states: States, view: RailView, config: LaserConfig) -> tuple[Family, ...]:
    """At rest a unit goes on seeing one place: what the body shifts on its springs shows."""
    inside = [k[:-1] for k in (np.flatnonzero(within(problem.t, rest[None])) for rest in problem.rests) if k.size > 1]
    k = np.concatenate([np.zeros(0, dtype=np.int64), *inside])
    window = config.window_s
    points = view.points(problem.t, window)
    k = k[np.isfinite(points[k]).all(axis=1) & np.isfinite(points[k + 1]).all(axis=1)]
    if k.size == 0:
        return ()
    start, end = states.nav[k], states.nav[k + 1]
    back, m = np.swapaxes(start.R, 1, 2), len(k)
    noise = np.sqrt(2.0) * np.array(view.sd(window))
    return same_rail(
        first=k,
        start=k,
        across=_across(start.R[:, :, 0]),
        lead=points[k] - problem.lever_arm,
        trail=points[k + 1] - problem.lever_arm,
        fraction=np.ones(m),
        interval=problem.t[k + 1] - problem.t[k],
        turned=back @ end.R,
        turn=back @ end.R,
        detail=np.zeros((m, 3)),
        sigma=np.tile(np.hypot(noise, config.match_sd_m), (m, 1)),
        loss=Loss("huber", config.robust_width),
    )


def _across(along: Array) -> Array:
    """Unit vectors to the side and upwards, both square to ``along`` (m, 3). Shape (m, 2, 3)."""
    forward = along / np.linalg.norm(along, axis=1, keepdims=True)
    level = np.hypot(forward[:, 0], forward[:, 1])
    side = np.stack([-forward[:, 1] / level, forward[:, 0] / level, np.zeros(len(level))], axis=1)
    return np.stack([side, np.cross(forward, side)], axis=1)
