"""The smoothed run as profiles over the chainage, one per pass over the track.

On a pass every quantity is a function of the chainage, here on whole multiples of the grid's step, ascending, facing
increasing chainage whichever way the vehicle went (:class:`Shapes`). A sensor that follows the track gives the track's
shape by its attitude and by the path of the point that follows the track, which need not be the declared reference
point; on springs, displacement sensors give it (:mod:`trackfg.output.rail_profiles`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from trackfg.factors.motion import mount_matrix, tracking_point
from trackfg.factors.states import Nav, States
from trackfg.geometry.resampling import FEWEST_SAMPLES, resample_computed
from trackfg.graph.run_context import RunContext
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.passes import Pass, passes
from trackfg.numerics.rotations import matrices_times
from trackfg.output.dense_motion import DenseMotion
from trackfg.output.profile_samples import Points
from trackfg.results.summary import GeometryConventions
from trackfg.sensors.displacement import Side

SHORTEST_PASS_M = 10.0
"""A shorter pass gives no geometry, m: it does not hold the default chord."""

_COARSEST_M = 1.25
"""Errors are drawn this far apart at most: below it they are smooth, since the inertial samples' white noise was
integrated."""

_CHUNK = 10_000
"""Places looked up at a time: what is needed on the way stays small."""

Rows = slice | np.ndarray

Seen = Callable[[Rows], tuple[Array, Array]]
"""Returns, at some of a pass's rows, the vehicle's left axis (k, 3) in n and the arms from the places that are seen to
the IMU, one beside the other (k, 3 places)."""


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
    """One sight of the track, at every n-th row of a profile: the points it came from and the white noise that is in
    it, across and up, m (k,).

    ``side`` is the rail, None for the path of the vehicle itself, ``along_m`` where on the vehicle it is seen.
    ``below``: how much larger the noise is to a filter that keeps long waves only, ``slope`` (rad/m): sigma of the
    heading per sigma across, ``walk`` (rad/m^0.5) the same per random walk across.
    """

    side: Side | None
    points: Points
    across_sd: Array
    up_sd: Array
    below: float = 1.0
    slope: float = 0.0
    walk: float = 0.0
    along_m: float = 0.0


@dataclass(frozen=True)
class Profile:
    """One pass. ``cell`` (n,) is chainage over step, whole numbers ascending by one, passed at ``fraction`` (n,) of the
    interval after ``keyframe`` (n,), at ``speed`` (n,) m/s.

    Errors are drawn at every ``every``-th row, from the first one on: ``views`` have only those.
    """

    cell: np.ndarray
    keyframe: np.ndarray
    fraction: Array
    speed: Array
    shapes: Shapes
    views: tuple[View, ...]
    every: int

    def __len__(self) -> int:
        return len(self.cell)


def profiles(run: RunContext, motion: DenseMotion, states: States) -> list[Profile]:
    """Return all passes of a sensor that follows the track, but those too short to hold a chord."""
    candidates = [_profile(run, motion, states, stretch) for stretch in passes(states.odo.distance)]
    return [profile for profile in candidates if profile is not None]


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
        return self._has_cells(FEWEST_SAMPLES, step_m) and bool(self.x[-1] - self.x[0] >= SHORTEST_PASS_M)

    def _has_cells(self, count: int, step_m: float) -> bool:
        """Return whether the rows are in so many cells or more; most passes show it within a few."""
        cells: set[float] = set()
        for begin in range(0, len(self.x), _CHUNK):
            cells.update(np.unique(np.floor(self.x[begin : begin + _CHUNK] / step_m)).tolist())
            if len(cells) >= count:
                return True
        return False

    def rows_of(self, index: Rows) -> Rows:
        """Return which of the pass's rows are those of ``index`` in order of chainage."""
        if not self.backwards:
            return index
        return len(self.x) - 1 - (np.arange(index.start, index.stop) if isinstance(index, slice) else index)

    def sorted(self, values: Array) -> Array:
        """Return values of the pass's rows (m, ...) in order of chainage."""
        return values[::-1] if self.backwards else values

    def on(self, places: Array, values: Callable[[Rows], Array]) -> Array:
        """Interpolate slow values, given at some of the pass's rows (k, c), linearly at ascending places (n,).

        Shape (n, c).
        """
        x = np.maximum.accumulate(self.x)
        out = np.empty((len(places), 0))
        for begin in range(0, len(places), _CHUNK):
            part = places[begin : begin + _CHUNK]
            interval = np.clip(np.searchsorted(x, part, side="right") - 1, 0, len(x) - 2)
            first, last = int(interval[0]), int(interval[-1]) + 1
            ends: Rows = slice(first, last + 1)
            if last - first > 2 * len(part):
                ends = np.unique(np.concatenate([interval, interval + 1]))
            columns = values(self.rows_of(ends)).T
            if begin == 0:
                out = np.empty((len(places), len(columns)))
            for k, column in enumerate(columns):
                out[begin : begin + len(part), k] = np.interp(part, x[ends], column)
        return out

    def passed(self, places: Array, speed: Callable[[Rows], Array]) -> tuple[np.ndarray, Array, Array]:
        """Return the keyframe before each place was passed, the share of the time to the next, and the speed."""
        keyframe, fraction = self.motion.keyframe[self.rows], self.motion.fraction[self.rows]
        at = self.on(places, lambda rows: np.column_stack([keyframe[rows] + fraction[rows], speed(rows)]))
        interval = np.clip(at[:, 0].astype(np.int64), self.stretch.first, self.stretch.last - 1)
        return interval, at[:, 0] - interval, at[:, 1]

    def points(self, places: Array, passed: tuple[np.ndarray, Array], left: Array, seen: Seen) -> list[Points]:
        """Return the points of each arm at places that were ``passed`` after a keyframe and a share of the interval."""
        at = self.on(places, lambda rows: np.column_stack(seen(rows)))
        return [Points(*passed, left, axle=at[:, :3], arm=at[:, k : k + 3]) for k in range(3, at.shape[1], 3)]


def _profile(run: RunContext, motion: DenseMotion, states: States, stretch: Pass) -> Profile | None:
    step_m = run.conventions.step_m
    ascent = Ascent.of(run, motion, stretch)
    if not ascent.holds_profile(step_m):
        return None
    nav, R_bt = motion.nav[ascent.rows], mount_matrix(states.mount)[0]
    ahead, leftward = R_bt[:, 0], run.direction * R_bt[:, 1]
    from_track = run.lever_arm - tracking_point(states.mount)[0]

    def speed(rows: Rows) -> Array:
        return np.asarray(np.abs(np.einsum("mi,mi->m", nav.v[rows], matrices_times(nav.R[rows], ahead))))

    def seen(rows: Rows) -> tuple[Array, Array]:
        R = nav.R[rows]
        return matrices_times(R, leftward), matrices_times(R, from_track)

    heading = _heading(nav, ahead)

    def shape(index: Rows) -> Array:
        rows = ascent.rows_of(index)
        R = nav.R[rows]
        place = nav.p[rows] - matrices_times(R, from_track)
        return np.vstack([place.T, heading[rows], R[:, 2] @ leftward])

    grid, (east, north, height, heading, tilt) = resample_computed(ascent.x, shape, 5, step_m)
    lateral, left = lateral_of(east, north, step_m)
    keyframe, fraction, speeds = ascent.passed(grid, speed)
    every = rows_between_draws(run.conventions, keyframe)
    drawn = grid[::every]
    (points,) = ascent.points(drawn, (keyframe[::every], fraction[::every]), left[::every], seen)
    points = replace(points, body=ascent.on(drawn, lambda rows: nav.R[rows].reshape(-1, 9)).reshape(-1, 3, 3))
    none = np.zeros(len(drawn))
    return Profile(
        cell=np.rint(grid / step_m).astype(np.int64),
        keyframe=keyframe,
        fraction=fraction,
        speed=speeds,
        shapes=Shapes(height, lateral, tilt, heading),
        views=(View(None, points, none, none),),
        every=every,
    )


def rows_between_draws(meaning: GeometryConventions, keyframe: np.ndarray) -> int:
    """Return at every how many-th row of a pass errors are drawn: as coarse as divides all bases and still shows the
    noise between keyframes, of which ``keyframe`` (n,) has the one before each row.
    """
    halves = (meaning.chord_m / 2, meaning.curvature_base_m / 2, meaning.gradient_base_m / 2)
    common = int(np.gcd.reduce([round(length / meaning.step_m) for length in (meaning.twist_base_m, *halves)]))
    apart = len(keyframe) / max(np.ptp(keyframe), 1)
    limit = min(_COARSEST_M / meaning.step_m, 0.5 * apart)
    return max((n for n in range(1, common + 1) if common % n == 0 and n <= limit), default=1)


def _heading(nav: Nav, ahead: Array) -> Array:
    """Return the heading of rows (m,), rad, which does not jump."""
    heading = np.empty(len(nav))
    for begin in range(0, len(nav), _CHUNK):
        R = nav.R[begin : begin + _CHUNK]
        joined = np.append(heading[max(begin - 1, 0) : begin], np.arctan2(R[:, 1] @ ahead, R[:, 0] @ ahead))
        heading[begin : begin + len(R)] = np.unwrap(joined)[-len(R) :]
    return heading


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
    node_heading = np.concatenate([heading[:1], 0.5 * (heading[1:] + heading[:-1]), heading[-1:]])
    left = np.column_stack([-np.sin(node_heading), np.cos(node_heading), np.zeros(len(node_heading))])
    return np.where(np.isfinite(east), u, np.nan), left
