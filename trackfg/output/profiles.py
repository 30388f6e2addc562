"""The smoothed run as profiles over the chainage, one per pass over the track.

On a pass every quantity is a function of the chainage, here on whole multiples of the grid's step, ascending, facing
increasing chainage whichever way the vehicle went (:class:`Shapes`). A sensor that follows the track gives the track's
shape by its own path and attitude; on springs, displacement sensors give it (:mod:`trackfg.output.rail_profiles`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from trackfg.factors.motion import mount_matrix
from trackfg.factors.states import States
from trackfg.geometry.resampling import FEWEST_SAMPLES, resample
from trackfg.graph.run_context import RunContext
from trackfg.numerics.arrays import Array
from trackfg.numerics.passes import Pass, passes
from trackfg.output.dense_motion import DenseMotion
from trackfg.output.profile_samples import Points
from trackfg.sensors.displacement import Side

SHORTEST_PASS_M = 10.0
"""A shorter pass gives no geometry, m: it does not hold the default chord."""


@dataclass(frozen=True)
class Shapes:
    """Functions of the chainage, (..., n) each: values, or many samples of their errors at once.

    ``height`` z and ``lateral`` u of the centre line, m; ``u'' = d(heading of the path)/dx``, so that chords and bands
    of u are those of the alignment, in curves of any length. ``tilt``: the sine of the track's roll, positive with the
    left rail up. ``heading``, rad. ``rails``: height and lateral of each, and ``gauge``, m, where sensors see them.
    """

    height: Array
    lateral: Array
    tilt: Array
    heading: Array
    rails: Mapping[Side, tuple[Array, Array]] = field(default_factory=dict)
    gauge: Array | None = None


@dataclass(frozen=True)
class View:
    """One sight of the track: the points it came from and the white noise that is in it, across and up, m (n,).

    ``side`` is the rail, None for the path of the vehicle itself. ``below``: how much larger the noise is to a filter
    that keeps long waves only, ``slope`` (rad/m): sigma of the heading per sigma across.
    """

    side: Side | None
    points: Points
    across_sd: Array
    up_sd: Array
    below: float = 1.0
    slope: float = 0.0


@dataclass(frozen=True)
class Profile:
    """One pass. ``cell`` (n,) is chainage over step, whole numbers ascending by one; ``speed`` (n,) m/s."""

    cell: np.ndarray
    speed: Array
    shapes: Shapes
    views: tuple[View, ...]

    def __len__(self) -> int:
        return len(self.cell)


def profiles(run: RunContext, motion: DenseMotion, states: States) -> list[Profile]:
    """Return all passes of a sensor that follows the track, but those too short to hold a chord."""
    found = [_profile(run, motion, states, stretch) for stretch in passes(states.odo.distance)]
    return [profile for profile in found if profile is not None]


@dataclass(frozen=True)
class Ascent:
    """A pass's rows of dense motion in order of ascending chainage ``x`` (m,), and how to bring them to the grid."""

    motion: DenseMotion
    stretch: Pass
    x: Array
    rows: slice
    backwards: bool

    @classmethod
    def of(cls, run: RunContext, motion: DenseMotion, stretch: Pass, ahead_m: float = 0.0) -> Ascent:
        """Sort the rows of a pass; the place that is passed lies ``ahead_m`` ahead of the reference point."""
        rows = stretch.rows(run.t, motion.t)
        x = run.direction * (motion.distance[rows] + ahead_m)
        backwards = stretch.sense * run.direction < 0
        return cls(motion, stretch, x[::-1] if backwards else x, rows, backwards)

    def holds_profile(self, step_m: float) -> bool:
        """Return whether the pass is as long as a chord and has rows in as many cells as a spline needs: a clock or a
        tachometer that jumps makes passes of two places far apart.
        """
        long_enough = self.x[-1] - self.x[0] >= SHORTEST_PASS_M
        return bool(long_enough and len(np.unique(np.floor(self.x / step_m))) >= FEWEST_SAMPLES)

    def sorted(self, values: Array) -> Array:
        """Return values of the pass's rows (m, ...) in order of chainage."""
        return values[::-1] if self.backwards else values

    def on(self, grid: Array, values: Array) -> Array:
        """Interpolate slow values of the pass's rows (m, c) linearly at places (n,). Shape (n, c)."""
        place = np.maximum.accumulate(self.x)
        return np.column_stack([np.interp(grid, place, column) for column in self.sorted(values).T])

    def points(self, grid: Array, left: Array, axle: Array, arm: Array, speed: Array) -> tuple[Points, Array]:
        """Return when and where each place of the grid was passed, and how fast; the last three are at the pass's
        rows.
        """
        when = self.motion.keyframe[self.rows] + self.motion.fraction[self.rows]
        at = self.on(grid, np.column_stack([when, speed, axle, arm]))
        k = np.clip(at[:, 0].astype(np.int64), self.stretch.first, self.stretch.last - 1)
        return Points(keyframe=k, fraction=at[:, 0] - k, left=left, axle=at[:, 2:5], arm=at[:, 5:8]), at[:, 1]


def _profile(run: RunContext, motion: DenseMotion, states: States, stretch: Pass) -> Profile | None:
    step_m = run.conventions.step_m
    ascent = Ascent.of(run, motion, stretch)
    if not ascent.holds_profile(step_m):
        return None
    nav, R_bt = motion.nav[ascent.rows], mount_matrix(states.mount)[0]
    forward, axle = nav.R @ R_bt[:, 0], nav.R @ (run.direction * R_bt[:, 1])
    arm = nav.R @ run.lever_arm
    position = nav.p - arm
    heading = np.unwrap(np.arctan2(forward[:, 1], forward[:, 0]))
    shape = np.vstack([position.T, heading, axle[:, 2]])
    grid, (east, north, height, heading, tilt) = resample(ascent.x, ascent.sorted(shape.T).T, step_m)
    lateral, left = lateral_of(east, north, step_m)
    speed = np.abs(np.einsum("mi,mi->m", nav.v, forward))
    points, speed = ascent.points(grid, left, axle, arm, speed)
    none = np.zeros(len(grid))
    return Profile(
        cell=np.rint(grid / step_m).astype(np.int64),
        speed=speed,
        shapes=Shapes(height, lateral, tilt, heading),
        views=(View(None, points, none, none),),
    )


def lateral_of(east: Array, north: Array, step_m: float) -> tuple[Array, Array]:
    """Return u of a path given at every step (n,), NaN where it is NaN, and horizontal unit vectors to its left (n,
    3).
    """
    heading = np.arctan2(np.diff(north), np.diff(east))
    known = np.isfinite(heading)
    heading[known] = np.unwrap(heading[known])
    index = np.arange(len(heading))
    heading = np.interp(index, index[known], heading[known]) if known.any() else np.zeros(len(heading))
    u = np.concatenate([[0.0], np.cumsum((heading - heading.mean()) * step_m)])
    here = np.concatenate([heading[:1], 0.5 * (heading[1:] + heading[:-1]), heading[-1:]])
    left = np.column_stack([-np.sin(here), np.cos(here), np.zeros(len(here))])
    return np.where(np.isfinite(east), u, np.nan), left
