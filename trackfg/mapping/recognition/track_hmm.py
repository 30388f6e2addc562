"""A hidden Markov model of the passage through switches finds the track of a network that a run is on.

The run, smoothed without the line, is given as points with a joint covariance. The states of a point are: the run is on
one of the tracks that are near, it is on one whose line is wrong there, or it is on none. From one point to the next
the run stays on its track or takes a switch of the network, and its line may turn from right to wrong or back.

On the right track the point is ``across = e - b`` from it, with e the error of the run's position and b that of the
line, whose autocorrelation is ``exp(-d / L)``. So ``across`` has the variance ``s^2 = n' P n + sigma^2``, and from one
point to the next

    across' ~ N(rho (s' / s) across, s'^2 (1 - rho^2)),   rho = (n' C n' + sigma^2 exp(-d / L)) / (s s'),

or anew from N(0, s'^2) where the line jumps. A constant offset counts once per L or per length of the run's own errors,
not once per point, and the shape of the run distinguishes the legs of a switch however bad its position is. Where the
line is wrong the run still has its shape, ``across' ~ N(across, s'^2 (1 - rho^2))`` from anywhere. A hypothesis is
given by track and point alone, so sums over all ways that lead to it (Rabiner, "A tutorial on hidden Markov models"
(1989), forward and backward) give its probability.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from trackfg.numerics.arrays import Array

if TYPE_CHECKING:
    from trackfg.recording.track_network import Feet, TrackNetwork

_WRONG_SD_M = 20.0
"""Where a line is wrong it is off by so much, m: from a neighbouring track to another datum (ED50 and WGS 84 differ by
100 m, but that is seen at once)."""
_RIGHT_M, _WRONG_M = 20e3, 2e3
"""Mean lengths over which a line is right and wrong, m: a line that is wrong here and there, in a station rebuilt since
say. So the prior probability that a line is wrong at a place is 1 in 11."""
_ABSENT = 0.05
"""Probability that a run begins on a track that the file does not have."""
_STEP_SIGMAS = 4.0
"""A step across a track that is larger in sigmas is more likely one off the network."""
_ROUGHNESS = 0.2
"""Share of a line's sigma that changes from place to place: vertices are drawn to some 0.2 m where the line is good to
1 m. Errors 25 m apart differ by 0.27 m in the data of :class:`~trackfg.config.LineConfig`."""
_BEYOND_M = 0.5
"""Sigma of where a track ends, m: its vertices are where the next one begins."""
_WALK_M, _WALK_SHARE = 5.0, 0.3
"""The way between two points along the network may differ from their distance by so much: a foot moves along a track
that bends, and beside a switch."""
_NEVER = -1e30
"""Log density of what cannot be."""
_SAME_PLACE_M = 1.0
"""Hypotheses whose feet are nearer than this are the same place, m: at a joint, and before a switch has opened."""


@dataclass(frozen=True)
class Points:
    """Points of a run, with the errors of their places.

    ``place`` (n, 2) east and north, m; ``variance`` (n, 2, 2), and ``covariance`` (n - 1, 2, 2) with the next, m^2.
    """

    place: Array
    variance: Array
    covariance: Array


@dataclass(frozen=True)
class LineError:
    """The error of a known line: its ``sd_m`` across the track, and the length ``along_m`` over which it changes."""

    sd_m: float
    along_m: float

    def correlation(self, distance_m: Array | float) -> Array:
        """Return the correlation of errors so far apart."""
        return np.asarray(np.exp(-np.asarray(distance_m) / self.along_m))

    @property
    def rough_sd_m(self) -> float:
        """The part of the error that changes from place to place, m."""
        return _ROUGHNESS * self.sd_m

    def step_sd_m(self, distance_m: Array | float) -> Array:
        """Return the sigma of the error given the one so far before it, m."""
        return np.asarray(np.hypot(self.sd_m * np.sqrt(1.0 - self.correlation(distance_m) ** 2), self.rough_sd_m))


@dataclass(frozen=True)
class TrackPosterior:
    """The most probable place at each point, and how probable it is: all arrays have shape (n,).

    ``row``: of the feet, -1 where none is near. ``right``: probability of that place and of a line that is right there;
    ``wrong``: of any track whose line is wrong; ``absent``: of none. ``of_track``: the probability of each track by id.
    """

    row: np.ndarray
    right: Array
    wrong: Array
    absent: Array
    of_track: list[dict[str, float]]


def track_posterior(points: Points, feet: Feet, network: TrackNetwork, error: LineError) -> TrackPosterior:
    """Return where the run is at each point, given all points. ``feet`` are those of the points, in their order."""
    trellis = _Trellis(points, feet, network, error)
    n = len(points.place)
    steps = [trellis.steps(j) for j in range(n - 1)]
    forward = [trellis.start()]
    for step in steps:
        forward.append(_normalised(_log_sum(forward[-1][:, None] + step, axis=0)))
    row, right, wrong, absent = np.full(n, -1), np.zeros(n), np.zeros(n), np.zeros(n)
    of_track: list[dict[str, float]] = [{} for _ in range(n)]
    backward = np.zeros(len(forward[-1]))
    for j in range(n - 1, -1, -1):
        probability = np.exp(_normalised(forward[j] + backward))
        first, stop = trellis.edges[j : j + 2].tolist()
        if_right, if_wrong = probability[: stop - first], probability[stop - first : -1]
        wrong[j], absent[j] = if_wrong.sum(), probability[-1]
        for piece, p in zip(feet.piece[first:stop].tolist(), (if_right + if_wrong).tolist(), strict=True):
            track = network.track[piece]
            of_track[j][track] = of_track[j].get(track, 0.0) + p
        if stop > first:
            best = int(np.argmax(if_right + if_wrong))
            row[j], place = first + best, feet.place[first:stop]
            right[j] = if_right[np.linalg.norm(place - place[best], axis=1) < _SAME_PLACE_M].sum()
        if j:
            backward = _normalised(_log_sum(steps[j - 1] + backward, axis=1))
    return TrackPosterior(row, right, wrong, absent, of_track)


class _Trellis:
    """The hypotheses of all points and the log densities of their steps.

    In order: each foot with a line that is right, each with one that is wrong, and none.
    """

    def __init__(self, points: Points, feet: Feet, network: TrackNetwork, error: LineError) -> None:
        self.points, self.feet, self.network, self.error = points, feet, network, error
        self.edges = np.searchsorted(feet.point, np.arange(len(points.place) + 1))
        of_run = np.einsum("ki,kij,kj->k", feet.normal, points.variance[feet.point], feet.normal)
        self.variance = of_run + error.sd_m**2
        self.end = -0.5 * (feet.beyond / _BEYOND_M) ** 2

    def _entry(self, rows: slice) -> tuple[Array, Array]:
        """Return the log densities of entering a track whose line is right, and wrong, there."""
        across, variance, end = self.feet.across[rows], self.variance[rows], self.end[rows]
        right = _log_normal(across, variance) + np.log(_RIGHT_M / (_RIGHT_M + _WRONG_M))
        wrong = _log_normal(across, variance + _WRONG_SD_M**2) + np.log(_WRONG_M / (_RIGHT_M + _WRONG_M))
        return right + end, wrong + end

    def _absent(self, rows: slice, change: float) -> float:
        """Return the log density of no track, beside steps that change by the share ``change`` of their variance."""
        variance = float(np.min(self.variance[rows], initial=self.error.sd_m**2)) * change
        return -0.5 * _STEP_SIGMAS**2 + float(_log_normal(np.zeros(1), np.array([variance]))[0])

    def start(self) -> Array:
        rows = slice(*self.edges[:2].tolist())
        right, wrong = self._entry(rows)
        none = self._absent(rows, 1.0) + np.log(_ABSENT)
        present = np.log1p(-_ABSENT)
        return _normalised(np.concatenate([right + present, wrong + present, [none]]))

    def steps(self, j: int) -> Array:
        """Return the log densities of steps from the hypotheses at point j to those at the next one."""
        first, second = slice(*self.edges[j : j + 2].tolist()), slice(*self.edges[j + 1 : j + 3].tolist())
        a, b = self.feet.take(np.arange(first.start, first.stop)), self.feet.take(np.arange(second.start, second.stop))
        moved = self.points.place[j + 1] - self.points.place[j]
        distance = float(np.linalg.norm(moved))
        s_a, s_b = np.sqrt(self.variance[first])[:, None], np.sqrt(self.variance[second])[None, :]
        same_side = np.sign(a.normal @ b.normal.T)
        alike = same_side * self.error.sd_m**2 * float(self.error.correlation(distance))
        rho = (a.normal @ self.points.covariance[j] @ b.normal.T + alike) / (s_a * s_b)
        rest = s_b**2 * np.clip(1.0 - rho**2, 0.0, 1.0) + self.error.rough_sd_m**2
        ways = self._ways(a, b, moved) + self.end[second]
        goes_on = _log_normal(b.across - rho * s_b / s_a * a.across[:, None], rest) + ways
        keeps_shape = _log_normal(b.across - same_side * a.across[:, None], rest) + ways
        entry_right, entry_wrong = self._entry(second)
        k, m = len(a.piece), len(b.piece)
        out = np.full((2 * k + 1, 2 * m + 1), _NEVER)
        to_wrong, to_right, to_absent = (distance / length for length in (_RIGHT_M, _WRONG_M, _RIGHT_M))
        stays_right = goes_on + np.log1p(-min(to_wrong + to_absent, 0.5))
        out[:k, :m] = np.logaddexp(stays_right, ways + entry_right + np.log(to_wrong))
        out[:k, m:-1] = ways + entry_wrong + np.log(to_wrong)
        out[k:-1, :m] = ways + entry_right + np.log(to_right)
        stays_wrong = keeps_shape + np.log1p(-min(to_right + to_absent, 0.5))
        out[k:-1, m:-1] = np.logaddexp(stays_wrong, ways + entry_wrong + np.log(to_wrong))
        change = float(self.error.step_sd_m(distance) / self.error.sd_m) ** 2
        none = self._absent(second, change)
        out[:-1, -1] = none + np.log(to_absent)
        out[-1, -1] = none + np.log1p(-min(2.0 * to_right, 0.5))
        out[-1, :m], out[-1, m:-1] = entry_right + np.log(to_right), entry_wrong + np.log(to_right)
        return out

    def _ways(self, a: Feet, b: Feet, moved: Array) -> Array:
        """Return 0 where the network leads from one foot to the next in about the distance moved, else never."""
        distance = float(np.linalg.norm(moved))
        slack = _WALK_M + _WALK_SHARE * distance
        ways = np.full((len(a.piece), len(b.piece)), _NEVER)
        sense = np.where(a.normal @ np.array([-moved[1], moved[0]]) >= 0.0, 1, -1)
        for i in range(len(a.piece)):
            piece, along = int(a.piece[i]), float(a.along[i])
            walked = np.where(b.piece == piece, (b.along - along) * sense[i], np.inf)
            entered = self.network.reached((piece, along, int(sense[i])), distance + slack)
            for m, (at, length) in enumerate(zip(b.piece.tolist(), self.network.length_m[b.piece], strict=True)):
                for end, inwards in ((0, b.along[m]), (1, length - b.along[m])):
                    way = entered.get((at, end), np.inf) + inwards
                    if abs(way - distance) < abs(walked[m] - distance):
                        walked[m] = way
            ways[i, np.abs(walked - distance) <= slack] = 0.0
        return ways


def _log_normal(x: Array, variance: Array) -> Array:
    return np.asarray(-0.5 * (x**2 / variance + np.log(2.0 * np.pi * variance)))


def _log_sum(x: Array, axis: int) -> Array:
    largest = x.max(axis=axis)
    return np.asarray(largest + np.log(np.exp(x - np.expand_dims(largest, axis)).sum(axis=axis)))


def _normalised(x: Array) -> Array:
    return np.asarray(x - _log_sum(x, 0))
