"""Rail factors of a run: two units of displacement sensors see the same place of a rail."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trackfg.config import LaserConfig
from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family
from trackfg.factors.loss import Huber
from trackfg.factors.rail import RailSightings, same_rail
from trackfg.factors.states import States
from trackfg.graph.build import Problem
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.passes import Pass, passes
from trackfg.numerics.hermite import hermite_weights
from trackfg.numerics.spans import within
from trackfg.output.dense_motion import DenseMotion, dense_motion
from trackfg.sensors.displacement import RailView, unit_pairs

_DENSE_STEP_S = 0.02
"""Step of the motion that places are matched by, s: 0.6 m at 30 m/s, where the match is interpolated."""

_RAIL = (FactorType.RAIL_WITHIN, FactorType.RAIL_APART)

_APART_M = 0.2
"""Keyframes closer than this see the same place again."""


def with_rail_factors(problem: Problem, states: States, views: list[RailView], config: LaserConfig) -> Problem:
    """Return the problem with the lasers' factors, places matched and directions taken at ``states``."""
    others = tuple(family for family in problem.families if family.type not in _RAIL)
    motion = dense_motion(problem.run, states, _DENSE_STEP_S)
    families = [
        family
        for units in unit_pairs(views)
        for stretch in passes(states.odo.distance)
        for family in _rail_factors(
            problem, states, motion, _matches(problem.t, states, motion, stretch, units, config), config
        )
        if len(family)
    ]
    families += [
        family for view in views for family in _rail_factors_at_rest(problem, states, view, config) if len(family)
    ]
    return replace(problem, families=(*others, *families))


class _Matches(NamedTuple):
    """Places that both units of a pair saw: the leading one at ``keyframe`` (m,), the trailing one at ``t`` (m,), s.

    ``start`` (m,) is the keyframe before ``t``; ``lead`` and ``trail`` (m, 3) are the sights in vehicle axes, m, and
    ``noise`` their sigmas across and up, each unit's.
    """

    keyframe: np.ndarray
    t: Array
    start: np.ndarray
    lead: Array
    trail: Array
    noise: tuple[tuple[float, float], tuple[float, float]]


def _matches(
    t: Array,
    states: States,
    motion: DenseMotion,
    stretch: Pass,
    units: tuple[RailView, RailView],
    config: LaserConfig,
) -> _Matches:
    """Match the sights of two units, the first ahead of the second, by the distance along a pass."""
    ahead, behind = units
    leading, trailing = (ahead, behind) if stretch.sense > 0 else (behind, ahead)
    rows = stretch.rows(t, motion.t)
    distance = np.maximum.accumulate(stretch.sense * motion.distance[rows])
    keyframe = np.arange(stretch.first, stretch.last + 1)
    place = stretch.sense * states.odo.distance[keyframe] + (ahead.along_m - behind.along_m)
    fresh = np.concatenate([[True], np.floor(place[1:] / _APART_M) > np.floor(place[:-1] / _APART_M)])
    later = np.interp(place, distance, motion.t[rows], right=np.nan)
    used = np.isfinite(later) & fresh
    keyframe, later = keyframe[used], later[used]
    start = np.clip(np.searchsorted(t, later, side="right") - 1, 0, len(t) - 2)
    window = config.window_s
    lead, trail = leading.points(t[keyframe], window), trailing.points(later, window)
    used = (start - keyframe < config.max_keyframes) & np.isfinite(lead).all(axis=1) & np.isfinite(trail).all(axis=1)
    noise = leading.sd(window), trailing.sd(window)
    return _Matches(keyframe[used], later[used], start[used], lead[used], trail[used], noise)


def _rail_factors(
    problem: Problem, states: States, motion: DenseMotion, matches: _Matches, config: LaserConfig
) -> tuple[Family, ...]:
    """Return the factors of matched sights."""
    k, j = matches.keyframe, matches.start
    if k.size == 0:
        return ()
    T = problem.t[j + 1] - problem.t[j]
    h = (matches.t - problem.t[j]) / T
    at = motion.at(matches.t)
    start, end = states.nav[j], states.nav[j + 1]
    # Detail and turning are those of the motion at these states, which closes at both ends.
    back = np.swapaxes(start.R, 1, 2)
    w0, w1, u0, u1 = hermite_weights(h[:, None], T[:, None])
    cubic = w0 * start.p + w1 * end.p + u0 * start.v + u1 * end.v
    arm = problem.run.lever_arm
    pinned = problem.run.noise.accel[j, 1:].max(axis=1) * T**1.5 * np.sqrt((h * (1.0 - h)) ** 3 / 3.0)
    sigma = np.column_stack(
        [
            np.sqrt(leading**2 + trailing**2 + config.match_sd_m**2 + pinned**2)
            for leading, trailing in zip(*matches.noise, strict=True)
        ]
    )
    sightings = RailSightings(
        first=k,
        start=j,
        across=_across(at.nav.p - states.nav.p[k]) @ states.nav.R[k],
        lead=matches.lead - arm,
        trail=matches.trail - arm,
        fraction=h,
        interval=T,
        turned=back @ at.nav.R,
        turn=back @ end.R,
        detail=at.nav.p - cubic,
    )
    return same_rail(sightings, sigma, Huber(config.robust_width))


def _rail_factors_at_rest(problem: Problem, states: States, view: RailView, config: LaserConfig) -> tuple[Family, ...]:
    """Return the factors of rests: a unit goes on seeing one place, so that the body's shift on its springs shows."""
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
    sightings = RailSightings(
        first=k,
        start=k,
        across=_across(start.R[:, :, 0]) @ start.R,
        lead=points[k] - problem.run.lever_arm,
        trail=points[k + 1] - problem.run.lever_arm,
        fraction=np.ones(m),
        interval=problem.t[k + 1] - problem.t[k],
        turned=back @ end.R,
        turn=back @ end.R,
        detail=np.zeros((m, 3)),
    )
    return same_rail(sightings, np.tile(np.hypot(noise, config.match_sd_m), (m, 1)), Huber(config.robust_width))


def _across(along: Array) -> Array:
    """Return unit vectors to the side and upwards, both square to ``along`` (m, 3). Shape (m, 2, 3)."""
    forward = along / np.linalg.norm(along, axis=1, keepdims=True)
    level = np.hypot(forward[:, 0], forward[:, 1])
    side = np.stack([-forward[:, 1] / level, forward[:, 0] / level, np.zeros(len(level))], axis=1)
    return np.stack([side, np.cross(forward, side)], axis=1)
