"""Both rails' profiles over the chainage, from displacement sensors on a vehicle on springs.

Each unit's points of a rail are brought from the body into n by the smoothed motion, and to the grid by the unit's own
chainage, which is the vehicle's plus its place along the vehicle. Where several units saw a rail their mean counts.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from trackfg.factors.states import States
from trackfg.geometry.curvature import heading_noise, heading_of_lateral, heading_walk
from trackfg.geometry.resampling import resample
from trackfg.graph.run_context import RunContext
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.passes import Pass, passes
from trackfg.numerics.spans import median_interval
from trackfg.output.dense_motion import DenseMotion
from trackfg.output.profiles import (
    SHORTEST_PASS_M,
    Ascent,
    Profile,
    Rows,
    Shapes,
    View,
    lateral_of,
    profiles,
    rows_between_draws,
)
from trackfg.sensors.displacement import SIDES, RailView, Side

if TYPE_CHECKING:
    from trackfg.recording.description import RecordingDescription

_KEPT = 0.78
"""Variance of resampled independent readings times their number per step, as measured: the low-pass has 0.81 of the
band that the grid can show."""

_SLOWEST_MPS = 0.05
"""At a crawl readings per step count as at this speed, m/s, lest a stop average the noise away."""

_SLOPE_M = 1.0
"""The heading is the slope of a cubic fitted within this to either side."""


def seen_profiles(
    description: RecordingDescription,
    views: list[RailView],
    run: RunContext,
    motion: DenseMotion,
    states: States,
) -> list[Profile]:
    """Return the track's profiles from a run whose speed is measured; none where the only sensor is on springs."""
    if {view.side for view in views} == set(SIDES):
        return rail_profiles(run, motion, states, views)
    return profiles(run, motion, states) if description.imu.rigid else []


def rail_profiles(run: RunContext, motion: DenseMotion, states: States, views: list[RailView]) -> list[Profile]:
    """Return all passes on which both rails were seen, but those too short to hold a chord."""
    candidates = [
        _profile(run, motion, views, stretch)
        for stretch in passes(states.odo.distance)
        if run.t[stretch.last] > run.t[stretch.first]
    ]
    return [profile for profile in candidates if profile is not None]


def _profile(run: RunContext, motion: DenseMotion, views: list[RailView], stretch: Pass) -> Profile | None:
    step_m = run.conventions.step_m
    ascents = {along_m: Ascent.of(run, motion, stretch, along_m) for along_m in {view.along_m for view in views}}
    if not all(ascent.holds_profile(step_m) for ascent in ascents.values()):
        return None
    sights = [_Sight.of(run, motion, view, ascents[view.along_m]) for view in views]
    first = max(sight.cell[0] for sight in sights)
    last = min(sight.cell[-1] for sight in sights)
    if (last - first) * step_m < SHORTEST_PASS_M:
        return None
    cell = np.arange(first, last + 1)
    by_side: dict[Side, Array] = {}
    for side in SIDES:
        of_side = [
            sight.points[:, first - sight.cell[0] :][:, : len(cell)] for sight in sights if sight.view.side == side
        ]
        by_side[side] = np.mean(of_side, axis=0)
    # Facing increasing chainage: against it, what is left of the vehicle is right.
    left, right = by_side["left"], by_side["right"]
    if run.direction < 0:
        left, right = right, left
    centre, apart = 0.5 * (left + right), left - right
    distance = np.linalg.norm(apart, axis=0)
    lateral, leftward = lateral_of(centre[0], centre[1], step_m)
    rails: dict[Side, tuple[Array, Array]] = {
        "left": (left[2], lateral_of(left[0], left[1], step_m)[0]),
        "right": (right[2], lateral_of(right[0], right[1], step_m)[0]),
    }
    units = (list(unit) for _, unit in groupby(sights, key=lambda sight: sight.view.along_m))
    grid = cell * step_m
    keyframe, fraction, speed = sights[0].passed(grid)
    every = rows_between_draws(run.conventions, keyframe)
    return Profile(
        cell=cell,
        keyframe=keyframe,
        fraction=fraction,
        speed=speed,
        shapes=Shapes(
            height=centre[2],
            lateral=lateral,
            tilt=apart[2] / distance,
            heading=heading_of_lateral(lateral, step_m, _SLOPE_M),
            rails=rails,
            gauge=distance - views[0].head_m,
        ),
        views=tuple(view for unit in units for view in _views(run, unit, grid[::every], leftward[::every])),
        every=every,
    )


@dataclass(frozen=True)
class _Sight:
    """One unit's sight of one rail on a pass: in vehicle axes at the pass's rows, less the IMU's place (m, 3); in n on
    the grid: cells (n,), points (3, n).
    """

    view: RailView
    ascent: Ascent
    body: Array
    cell: np.ndarray
    points: Array

    @classmethod
    def of(cls, run: RunContext, motion: DenseMotion, view: RailView, ascent: Ascent) -> _Sight:
        step_m = run.conventions.step_m
        nav, t = motion.nav[ascent.rows], motion.t[ascent.rows]
        # A row of dense motion stands for as long as this: the mean over it uses every reading.
        body = view.points(t, median_interval(motion.t)) - run.lever_arm
        points = nav.p + np.einsum("mij,mj->mi", nav.R, body)
        grid, values = resample(ascent.x, ascent.sorted(points).T, step_m)
        return cls(view, ascent, body, np.rint(grid / step_m).astype(np.int64), values)

    def passed(self, places: Array) -> tuple[np.ndarray, Array, Array]:
        """Return when the unit passed places, as :meth:`~trackfg.output.profiles.Ascent.passed`, and how fast."""
        nav, forward = self.ascent.motion.nav[self.ascent.rows], self.ascent.motion.forward

        def speed(rows: Rows) -> Array:
            return np.asarray(np.abs(np.sum(nav.v[rows] * (nav.R[rows] @ forward), axis=1)))

        return self.ascent.passed(places, speed)


def _views(run: RunContext, unit: list[_Sight], places: Array, leftward: Array) -> Iterator[View]:
    """Yield the view of each rail under a unit, which are passed at the same time."""
    ascent, step_m = unit[0].ascent, run.conventions.step_m
    nav = ascent.motion.nav[ascent.rows]
    bodies = [np.where(np.isfinite(sight.body), sight.body, np.nanmedian(sight.body, axis=0)) for sight in unit]

    def seen(rows: Rows) -> tuple[Array, Array]:
        R = nav.R[rows]
        arms = [-np.einsum("mij,mj->mi", R, body[rows]) for body in bodies]
        return R[:, :, 1] * run.direction, np.concatenate(arms, axis=1)

    keyframe, fraction, speed = unit[0].passed(places)
    points = ascent.points(places, (keyframe, fraction), leftward, seen)
    slope, walk = heading_noise(step_m, _SLOPE_M), heading_walk(step_m, _SLOPE_M)
    for sight, passed in zip(unit, points, strict=True):
        view = sight.view
        across, up = view.sd(0.0)
        readings = np.maximum(view.rate_hz * step_m / np.maximum(speed, _SLOWEST_MPS), 1.0)
        share = np.sqrt(_KEPT / readings)
        side: Side = view.side if run.direction > 0 else ("right" if view.side == "left" else "left")
        yield View(side, passed, across * share, up * share, _KEPT**-0.5, slope, walk, view.along_m)
