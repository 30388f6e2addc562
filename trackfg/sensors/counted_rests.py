"""A vehicle may rest although its tach goes on counting.

A pick-up at the edge of a tooth counts the vibration of an engine, and a worn one counts by itself. A candidate is a
span in which the inertial sensor is as steady as at rest, while the tach says that the wheel rolls. Two hypotheses are
compared, rest and motion as the tach has it, by the probability that each gives to

- **the change of speed** before and after. From a time at which the vehicle surely moves, with the tach's speed v0, to
  the candidate the accelerometer measures the change dv; r = v0 + dv is the speed that is left. It is 0 at rest, and
  otherwise that of the tach, less what a candidate that gains speed all the way is taken for. Gravity's part of the
  force is that in the candidate, turned by what the gyro's pitch has changed since. The other end of the candidate is
  the same with time reversed.
- **the track** that would have passed beneath. A vehicle that moves by d rolls and pitches by the structure function
  D(d) = E (angle(x + d) - angle(x))^2 of its track, so that the means of the force across and along over blocks at x_i
  have the covariance -g^2 D(|x_i - x_j|) / 2, up to a constant, besides their noise; at rest they have their noise
  alone (Cressie, *Statistics for Spatial Data* (1993), 2.3). D is that of the smoothest tenth of the way of the same
  run, by the gyro, less the gyro's own noise: a station may lie on smoother track than the line.

A tach that counts at rest does so at more than one. With the ratio L_k of both probabilities for candidate k, and as
many rests as motions a priori, the odds that it is such a tach are those of all tachs times the product of
(1 + L_k) / 2.

Beside a stop or start a speed of less than 0.25 m/s may stay hidden, and one of a tach that counts at other rests may
not be there: all of that distance may be wrong. Else, as on a way without any irregularity, the tach is believed.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.special import expit

from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import within
from trackfg.numerics.units import STANDARD_GRAVITY

_ODDS = 1000.0
"""Of so many tachs one counts at rest: their makers exclude it."""

_DOUBTFUL = 20.0
"""What is not so many times as likely as its contrary is not certain."""

_HIDDEN = 5.0
"""A change of speed shows from so many of its sigmas on; a speed below as many of :data:`_SPEED_SD` may stay hidden."""

APPROACH_S = 6.0
"""The change of speed is looked at over this long before and after a candidate, s."""

_SETTLED_S = 0.5
"""So much of the candidate itself counts as its beginning or end, s."""

_SPEED_SD = 0.05
"""Sigma of the speed that is left, m/s: a body swings on its springs, and the gyro does not show all of a gradient."""

_SCALE_SD = 0.02
"""Its part in proportion to the change of speed: scales of wheel and accelerometer."""

_OUTLIER, _OUTLIER_MPS = 0.1, 20.0
"""Probability that the tach's speed before or after says nothing, as of a wheel that slides; range of r then, m/s."""

_LAGS_M = np.array([0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0])
"""Distances for which the structure function is known, m."""

_STRETCH_M = 50.0
"""It is taken over stretches of this length, m."""

_SMOOTHEST = 0.1
"""Quantile of the stretches."""

_FEWEST_STRETCHES = 10
"""So many stretches show what a smooth one is: half a kilometre."""

_MOVES_MPS = 1.0
"""The way counts where the tach is faster, m/s."""

_BLOCK = 5
"""Pieces of a block, whose means are independent: 0.5 s."""

_MOST_BLOCKS = 60
"""Longer candidates have longer blocks."""


@dataclass(frozen=True)
class Pieces:
    """Means over ``step_s`` between uniform ``edges`` (n + 1,), s: ``gyro`` (n, 3), ``accel`` (n, 3); and what the
    wheel has ``rolled`` at the edges, m, (n + 1,).
    """

    edges: Array
    gyro: Array
    accel: Array
    rolled: Array

    @property
    def step_s(self) -> float:
        """Length of a piece, s."""
        return float(self.edges[1] - self.edges[0])

    def speed_about(self, piece: int, pieces: int) -> float:
        """Return the mean speed of the wheel over so many pieces before and after the start of one, m/s."""
        first, last = max(piece - pieces, 0), min(piece + pieces, len(self.rolled) - 1)
        return float(self.rolled[last] - self.rolled[first]) / ((last - first) * self.step_s)

    def rows(self, span: Array) -> slice:
        """Return the pieces of a span (2,), s."""
        first, last = np.searchsorted(self.edges, span + np.array([-1e-6, 1e-6])).tolist()
        return slice(first, max(first, last - 1))


@dataclass(frozen=True)
class CountedRests:
    """Which of candidates (m,) are ``rests`` though the tach counts, and where that is ``doubtful``: the wheel may as
    well roll, as slowly as nothing else shows.
    """

    rests: np.ndarray
    doubtful: np.ndarray


def counted_rests(pieces: Pieces, candidates: Array, clock_sd_s: float) -> CountedRests:
    """Return where the vehicle rests though its tach counts, of candidates (m, 2), s, in order.

    Candidates without a change of speed between them are one rest, or one motion. ``clock_sd_s``: sigma of the tach's
    clock, s.
    """
    rows = [pieces.rows(span) for span in candidates]
    track = _structure(pieces, candidates)
    evidence, of_changes, hidden = np.zeros(len(rows)), np.zeros(len(rows)), np.zeros(len(rows), dtype=bool)
    faulty = -np.log(_ODDS)
    for first, end in _of_one_speed(pieces, rows):
        together = rows[first:end]
        duration = sum(part.stop - part.start for part in together) * pieces.step_s
        speed = sum(float(pieces.rolled[part.stop] - pieces.rolled[part.start]) for part in together) / duration
        sides = [_of_change(pieces, together[k], way, clock_sd_s) for k, way in ((0, -1), (-1, 1))]
        changes = [side for side in sides if side is not None]
        beneath = 0.0 if track is None else sum(_of_track(pieces, part, track) for part in together)
        of_changes[first:end] = sum(changes)
        evidence[first:end] = of_both = sum(changes) + beneath
        hidden[first:end] = bool(changes) and track is not None and 0.0 < abs(speed) < _HIDDEN * _SPEED_SD
        faulty += np.logaddexp(0.0, of_both) - np.log(2.0)
    # A way may be smoother than all others of a run: a start or a stop has to show the rest as well.
    rests = (expit(faulty) * expit(evidence) > 1.0 - 1.0 / _DOUBTFUL) & (of_changes > np.log(_DOUBTFUL))
    if expit(faulty) > 1.0 - 1.0 / _DOUBTFUL:
        hidden |= of_changes > 0.0
    return CountedRests(rests, ~rests & hidden & (evidence > -np.log(_DOUBTFUL)))


def _of_one_speed(pieces: Pieces, rows: list[slice]) -> list[tuple[int, int]]:
    """Return first and end of the groups of candidates between which the accelerometer measures no change of speed."""
    cuts = [0]
    for k, (earlier, later) in enumerate(pairwise(rows)):
        changes = _changes(pieces, earlier, slice(earlier.stop, later.stop))
        if np.abs(changes).max() > _HIDDEN * _SPEED_SD:
            cuts.append(k + 1)
    return list(pairwise([*cuts, len(rows)])) if rows else []


def _changes(pieces: Pieces, candidate: slice, outwards: slice) -> Array:
    """Return the change of speed since a candidate, m/s, at the ends of the pieces ``outwards`` of it; those before it
    have a step of -1.
    """
    way = outwards.step or 1
    rate, force = (np.mean(of[candidate], axis=0) for of in (pieces.gyro, pieces.accel))
    pitch = way * np.cumsum(pieces.gyro[outwards, 1] - rate[1]) * pieces.step_s  # nose down, since the candidate
    forward = pieces.accel[outwards, 0] - force[0] + STANDARD_GRAVITY * pitch
    return np.asarray(way * np.cumsum(forward) * pieces.step_s)


def _of_change(pieces: Pieces, candidate: slice, way: int, clock_sd_s: float) -> float | None:
    """Return the log of how much likelier a rest makes the change of speed before (``way`` -1) or after (1); None where
    there is none.
    """
    count, inside = round(APPROACH_S / pieces.step_s), round(_SETTLED_S / pieces.step_s)
    start, at = (
        (candidate.start + inside - 1, candidate.start - count)
        if way < 0
        else (candidate.stop - inside, candidate.stop + count - 1)
    )
    at = min(max(at, 0), len(pieces.accel) - 1)
    if abs(at - start) < count // 2 + inside:
        return None
    stop = at + way
    changes = _changes(pieces, candidate, slice(start, stop if stop >= 0 else None, way))
    left = pieces.speed_about(at, inside) - float(changes[-1])
    late = clock_sd_s * abs(float(changes[-1] - changes[-1 - inside])) / (inside * pieces.step_s)
    sd = np.sqrt(_SPEED_SD**2 + (_SCALE_SD * changes[-1]) ** 2 + late**2)
    if abs(changes[-1]) < _HIDDEN * sd:
        return None  # what is before or after may be the same rest
    # A motion that gains speed all the time has as steady a force as a rest: it differs by the acceleration.
    half = (candidate.stop - candidate.start) // 2
    first, second = (pieces.speed_about(candidate.start + half + k * half // 2, half // 2) for k in (-1, 1))
    rolling = 0.5 * (first + second) + (second - first) / half * (at - candidate.start - half)
    at_rest, in_motion = (
        (1.0 - _OUTLIER) * np.exp(-0.5 * ((left - v) / sd) ** 2) / (np.sqrt(2.0 * np.pi) * sd) + _OUTLIER / _OUTLIER_MPS
        for v in (0.0, rolling)
    )
    return float(np.log(at_rest / in_motion))


def _structure(pieces: Pieces, candidates: Array) -> Array | None:
    """Return the structure functions (lags, 2), rad^2, of roll and pitch at :data:`_LAGS_M`; None on a short way."""
    step_s, rolled = pieces.step_s, pieces.rolled
    speed = np.diff(rolled) / step_s
    middle = 0.5 * (pieces.edges[1:] + pieces.edges[:-1])
    moves = (speed > _MOVES_MPS) & ~within(middle, candidates)
    if moves.sum() < 2 * _BLOCK:
        return None
    rate = pieces.gyro[:, :2] - np.median(pieces.gyro[moves, :2], axis=0)
    way = np.concatenate([[0.0], np.cumsum(np.where(moves, speed, 0.0)) * step_s])
    angle = np.concatenate([np.zeros((1, 2)), np.cumsum(np.where(moves[:, None], rate, 0.0), axis=0)]) * step_s
    places = np.arange(way[0], way[-1], _LAGS_M[0])
    stretch = round(_STRETCH_M / _LAGS_M[0])
    if len(places) < _FEWEST_STRETCHES * stretch:
        return None
    at = np.stack([np.interp(places, way, angle[:, j]) for j in range(2)], axis=1)
    quiet = [pieces.gyro[rows, :2] for rows in map(pieces.rows, candidates) if rows.stop - rows.start > 1]
    density = np.max([0.5 * np.mean(np.diff(values, axis=0) ** 2, axis=0) * step_s for values in quiet], axis=0)
    seconds = float(moves.sum()) * step_s / way[-1]  # per metre
    structure = np.zeros((len(_LAGS_M), 2))
    for j, lag in enumerate(_LAGS_M):
        change = at[round(lag / _LAGS_M[0]) :] - at[: -round(lag / _LAGS_M[0])]
        squares = change[: len(change) // stretch * stretch].reshape(-1, stretch, 2) ** 2
        structure[j] = np.quantile(squares.mean(axis=1), _SMOOTHEST, axis=0) - density * lag * seconds
    return np.maximum(structure, 0.0)


def _of_track(pieces: Pieces, rows: slice, structure: Array) -> float:
    """Return the log of how much likelier a rest makes the forces of a candidate than the track beneath a motion."""
    length = max(_BLOCK, (rows.stop - rows.start) // _MOST_BLOCKS)
    count = (rows.stop - rows.start) // length
    inside = slice(rows.start, rows.start + count * length)
    of_block = pieces.accel[inside, :2].reshape(count, length, 2)
    noise = np.median(of_block.var(axis=1), axis=0) / (length - 1)
    places = pieces.rolled[inside].reshape(count, length)[:, :: length // _BLOCK]
    within_blocks = places.shape[1]
    apart = np.abs(places.ravel()[:, None] - places.ravel())
    contrasts = np.linalg.svd(np.ones((1, count)))[2][1:]  # orthonormal, and orthogonal to a constant
    log_ratio = 0.0
    for axis, angle in ((1, 0), (0, 1)):  # roll shows across, pitch along
        change = np.interp(apart, np.append(0.0, _LAGS_M), np.append(0.0, structure[:, angle]))
        change = change.reshape(count, within_blocks, count, within_blocks).mean(axis=(1, 3))
        track = -0.5 * STANDARD_GRAVITY**2 * contrasts @ change @ contrasts.T
        values, turned = np.linalg.eigh(0.5 * (track + track.T))
        values = np.maximum(values, 0.0)
        seen = (turned.T @ contrasts @ of_block[:, :, axis].mean(axis=1)) ** 2
        of_noise = max(float(noise[axis]), 1e-12)
        log_ratio += float(0.5 * np.sum(np.log1p(values / of_noise) + seen / (of_noise + values) - seen / of_noise))
    return log_ratio
