"""The vehicle is at rest where its tach may be, and where the inertial sensor confirms it.

A candidate is a span in which the tach may be at rest (:mod:`trackfg.sensors.tach_rests`); where there is no tach, one
in which the inertial sensor is about as quiet as it ever is, without a change of mean rate or force from one block of
0.5 s to those of the 2 s before: each rest has a tilt of its own. Of two such spans with nothing but a change of force
between them one is the start or the stop of the other, since a tilt changes on the move only: the one that surely
shakes more is not the rest.

A candidate holds only as long as the inertial sensor confirms it. An idling engine shakes a vehicle at rest as much as
a smooth line does one that moves, so that the level of its samples says little; but the means of blocks stay where they
are. The candidate itself shows how much they vary by vibration alone: a block's mean is that of five pieces, and has
their variance over 5, whatever the spectrum (batch means; Law, *Simulation Modeling and Analysis* (2015), 9.5.3). A
block that is far from the candidate's median, or far noisier than its quietest blocks, moves.

On a smooth straight a moving vehicle is as steady as one at rest. A candidate that the tach enters or leaves faster
than anything brakes, or by a change of speed of which the accelerometer measured less than a quarter, is therefore a
tach that fell silent, and no standstill. Without a tach, rests have one rate, the gyro's bias, unlike curves; and where
GNSS alone measures the speed, it must have seen the rest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pandas as pd
from numpy.lib.stride_tricks import sliding_window_view

from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import Span, subtract, true_runs
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.recording.model import IMU_COLUMNS, Recording
from trackfg.sensors.counted_rests import Pieces, counted_rests
from trackfg.sensors.tach_rests import Candidates, tach_rests

SHORTEST_S = 1.0
"""Shortest rest that is returned, s: a stop of 1.5 s less a quarter of a second at either end."""

_ALONE_S = 3.0
"""Without a tach no rest is shorter than this, s: a moving vehicle is steady for a second or two as well."""

_BLOCK_S = 0.5
"""Scatter and means are those of blocks at least this long, s: several periods of an idling engine's vibration."""

_RAMP_S = 2.0
"""Brakes and traction of a gentle driver take this long to build up, s: means are compared so far apart."""

_LOUDER = 3.0
"""Sigmas by which one span shakes more than another to be the motion beside its rest: 1 in 700 does by chance."""

_PIECES = 5
"""Pieces of a block, whose scatter gives the error of its mean: 0.1 s, so that brakes do not pass for vibration."""

_MARGIN_S = 1.5
"""A gentle start takes this long to show where only the inertial sensor measures it, s: trimmed from both ends."""

_PART = 6000
"""So many pieces at a time are averaged, ten minutes, so that a day's samples need not be in memory."""

_FEWEST_BLOCKS = 6
"""A rest of so many blocks has the median force of a standstill, even if the vehicle brakes in the first two of them
and starts in the last two."""

_QUIET_RATIO = 5.0
"""A block whose scatter is this many times that of the quietest fifth of its candidate is not at rest: a knock."""

_SIGMAS = 4.0
"""Of a block's mean, that it may differ by: 6e-5 of good ones differ by more."""

SWAY = np.array([2e-3] * 3 + [0.05] * 3 + [0.02])
"""A body at rest sways by this much besides noise, rad/s and m/s^2: wind, passengers; its tach's speed varies by the
last, m/s. A body that brakes or starts at 0.05 m/s^2 moves by more. Chosen on simulated runs.
"""

_CRAWL_MPS = 1.0
"""Slowest motion that positions have to separate from a rest, m/s: walking pace, which may be as steady as a rest."""

_SCATTER_LIMITS = (0.02, 0.3)
"""rad/s, m/s^2: without a tach nothing that shakes more than this is called at rest."""

_SPEED_CHANGE_S = 2.0
"""The accelerometer must have measured the change of the tach's speed within this time of a rest, s."""

_LATENCY_S = 1.0
"""It may have measured it this much earlier or later, s: a speed that a bus brings may be a second old."""

_SETTLED_S = 0.5
"""So much of the rest itself is looked at besides, s."""

_CONFIRMED = 0.25
"""Share of the change which must have been measured: a wheel slips, a driver eases off the brake before the end."""

_CONFIRMED_MPS = 0.75
"""What is enough in any case, m/s: a gradient that changes by 20 per mille feigns 0.7 m/s in those 3.5 s."""

_LEAST_CHANGE_MPS = 1.5
"""A smaller change of speed is not looked for, m/s: it is twice what a gradient feigns."""


def find_standstills(
    recording: Recording,
    min_duration_s: float = SHORTEST_S,
    *,
    silent_at_rest: bool | None = None,
    quantum_m: float | None = None,
) -> Array:
    """Return spans of rest as rows (start, end), s, in order, each at least ``min_duration_s`` long. Shape (m, 2).

    ``silent_at_rest`` and ``quantum_m`` are as for :func:`tach_rests`.
    """
    samples = _Samples.of(recording)
    tach, gnss = recording.tach, recording.gnss
    if tach is None or len(tach) < 2:
        min_duration_s = max(min_duration_s, _ALONE_S)
        blocks = _Blocks.between(samples, float(samples.t[0]), float(samples.t[-1]))
        candidates = _quiet_spans(blocks, min_duration_s)
        spans = [span for span in _of_one_rate(samples, _confirmed(samples, candidates)) if _gnss_stays(gnss, span)]
    else:
        description = recording.description.tach
        integrates_speed = description is not None and description.integrates_speed
        record = (float(samples.t[0]), float(samples.t[-1]))
        tach_spans = tach_rests(
            tach,
            record,
            integrates_speed=integrates_speed,
            silent_at_rest=silent_at_rest,
            quantum_m=quantum_m,
        )
        spans = _confirmed(
            samples, tach_spans.spans[_with_measured_change(samples, tach_spans)], noise_hides_starts=integrates_speed
        )
    lasting = [(begin, end) for begin, end in spans if end - begin >= min_duration_s]
    return np.array(lasting, dtype=np.float64).reshape(-1, 2)


def counted_standstills(recording: Recording, standstills: Array, clock_sd_s: float) -> tuple[Array, Array]:
    """Return spans of rest beside ``standstills`` (m, 2), s, in which the tach goes on counting, and spans where it may
    be so. Shape (k, 2) each.

    :mod:`trackfg.sensors.counted_rests` says what distinguishes them from motion. ``clock_sd_s``: sigma of the tach's
    clock, s.
    """
    nothing, tach = np.zeros((0, 2)), recording.tach
    if tach is None or len(tach) < 2:
        return nothing, nothing
    samples = replace(_Samples.of(recording), wheel=None)  # what counts at rest is never steady
    edges = _piece_edges(float(samples.t[0]), float(samples.t[-1]))
    parts = [edges[i : i + _PART + 1] for i in range(0, len(edges) - 1, _PART)]
    means, variances = (np.concatenate(of) for of in zip(*(samples.means(part) for part in parts), strict=True))
    quiet = _quiet_spans(_Blocks.of_pieces(edges, means, variances), _ALONE_S)
    others = subtract(quiet, standstills + _MARGIN_S * np.array([-1.0, 1.0]))
    spans = [span for span in _of_one_rate(samples, _confirmed(samples, others)) if span[1] - span[0] >= _ALONE_S]
    if not spans:
        return nothing, nothing
    candidates = np.array(spans)
    rolled = np.interp(edges, tach["t_s"].to_numpy(), tach["distance_m"].to_numpy())
    counted = counted_rests(Pieces(edges, means[:, :3], means[:, 3:6], rolled), candidates, clock_sd_s)
    stays = np.array([recording.gnss is None or _positions_stay(recording.gnss, span) for span in candidates])
    return candidates[counted.rests & stays], candidates[counted.doubtful & stays]


@dataclass(frozen=True)
class _Samples:
    """Inertial samples at ``t`` (n,), s, and what the tach shows are looked at only where a rest may be.

    ``wheel``: times, s, and distances, m, of the tach; None where there are fewer than two.
    """

    t: Array
    wheel: tuple[Array, Array] | None
    recording: Recording

    @classmethod
    def of(cls, recording: Recording) -> _Samples:
        tach = recording.tach
        wheel = None if tach is None or len(tach) < 2 else (tach["t_s"].to_numpy(), tach["distance_m"].to_numpy())
        return cls(recording.imu["t_s"].to_numpy(), wheel, recording)

    def means(self, times: Array) -> tuple[Array, Array]:
        """Return mean and variance (m - 1, 7) of rate, force and the tach's speed between neighbouring times (m,), s.

        Where there are no samples between two, those of the next.
        """
        at = np.searchsorted(self.t, times)
        at[1:] = np.maximum(at[1:], at[:-1] + 1)
        at = np.minimum(at, len(self.t))
        signals = self._signals(slice(at[0], at[-1]))
        level = signals.mean(axis=0) if len(signals) else np.zeros(7)
        signals -= level  # keeps the digits of a variance
        count, begins, nothing = np.diff(at)[:, None], at[:-1] - at[0], np.zeros((1, 7))
        total, square = (np.add.reduceat(np.concatenate([x, nothing]), begins) for x in (signals, signals**2))
        total, square = (np.where(count > 0, x, 0.0) / np.maximum(count, 1) for x in (total, square))
        return total + level, np.maximum(square - total**2, 0.0)

    def _signals(self, rows: slice) -> Array:
        """Return rates, forces and the tach's speed of some samples, (m, 7)."""
        t, imu = self.t, self.recording.imu
        signals = np.zeros((len(t[rows]), 7))
        for column, name in enumerate(IMU_COLUMNS[1:]):
            signals[:, column] = imu[name].to_numpy()[rows]
        if self.wheel is not None and len(t) > 1 and len(signals):
            near = t[max(rows.start - 1, 0) : rows.stop + 1]
            edges = np.concatenate([near[:1], 0.5 * (near[1:] + near[:-1]), near[-1:]])
            first = min(rows.start, 1)
            edges = edges[first : first + len(signals) + 1]
            tach_t, distance = self.wheel
            first_tach, last_tach = np.searchsorted(tach_t, edges[[0, -1]], side="right").tolist()
            rows_near = slice(max(first_tach - 1, 0), last_tach + 1)  # interp copies a table's columns for every span
            signals[:, 6] = np.diff(np.interp(edges, tach_t[rows_near], distance[rows_near])) / np.diff(edges)
        return signals


@dataclass(frozen=True)
class _Blocks:
    """Blocks between ``edges`` (b + 1,), s: ``mean`` (b, 6) of rate and force, its variance by the pieces of the block
    ``of_mean`` (b, 6), the samples' ``scatter`` (b, 2), of rate and of force, and the mean force of the ``pieces``
    (b, 5, 3).
    """

    edges: Array
    mean: Array
    of_mean: Array
    scatter: Array
    pieces: Array

    @classmethod
    def between(cls, samples: _Samples, begin: float, end: float) -> _Blocks:
        """Divide a span into equal blocks, at least ``_BLOCK_S`` long where it is that long itself."""
        times = _piece_edges(begin, end)
        return cls.of_pieces(times, *samples.means(times))

    @classmethod
    def of_pieces(cls, times: Array, pieces: Array, variance: Array) -> _Blocks:
        """Return the blocks of pieces between ``times``, with the means and variances of their samples (n, 7)."""
        count = len(pieces) // _PIECES
        of_block = pieces.reshape(count, _PIECES, -1)
        mean, within = of_block.mean(axis=1), of_block.var(axis=1)
        total = (variance.reshape(count, _PIECES, -1).mean(axis=1) + within)[:, :6].reshape(count, 2, 3).sum(axis=2)
        return cls(times[::_PIECES], mean, within / (_PIECES - 1), np.sqrt(total), of_block[:, :, 3:6])

    def error(self, first: int = 0, end: int | None = None) -> Array:
        """Return the sigma of the mean of a block, (6,), as most blocks from ``first`` to before ``end`` show it."""
        return np.asarray(np.sqrt(np.median(self.of_mean[first:end], axis=0)))

    def at_rest(self, first: int, end: int) -> Span:
        """Return the span, s, of the blocks from ``first`` to before ``end`` without what begins to move at its ends.

        The force beyond the median is summed over the last two blocks towards either end, which gives the speed that
        the vehicle gains there. Up to :data:`_SIGMAS` that is noise. Beyond, the vehicle moves, and began to move
        within the block before: at the limit of a usual noise it has gained 1 cm/s, with a jerk of 0.5 m/s^3 in 0.2 s.
        """
        begin, stop = float(self.edges[first]), float(self.edges[end])
        if end - first < _FEWEST_BLOCKS:
            return begin, stop
        centre, sigma = np.median(self.mean[first:end, 3:6], axis=0), self.error()[3:6] * np.sqrt(_PIECES)
        ends = np.stack([self.pieces[first : first + 2][::-1, ::-1], self.pieces[end - 2 : end]]).reshape(2, -1, 3)
        count = np.arange(1, 2 * _PIECES + 1)[:, None]
        gained = np.abs(np.cumsum(ends - centre, axis=1)) > _SIGMAS * sigma * np.sqrt(count)
        moves = gained.any(axis=2)
        block = float(self.edges[first + 1] - self.edges[first])
        kept = np.where(moves.any(axis=1), block * (moves.argmax(axis=1) / _PIECES - 1.0), 2.0 * block)
        head, tail = (2.0 * block - kept).tolist()
        return begin + head, stop - tail


def _confirmed(samples: _Samples, candidates: Array, *, noise_hides_starts: bool = False) -> list[Span]:
    """Return the parts of candidate spans (m, 2), s, that the inertial sensor confirms.

    Where noise of a speed hides how it starts, the accelerometer says when; the pulses of a count are silent before.
    """
    spans = []
    for begin, end in candidates:
        blocks = _Blocks.between(samples, begin, end)
        calm = np.all(blocks.scatter <= _QUIET_RATIO * np.quantile(blocks.scatter, 0.2, axis=0) + 1e-6, axis=1)
        steady = _near(blocks.mean, np.median(blocks.mean[calm], axis=0), blocks.error())
        runs = true_runs(calm & steady).tolist()
        if noise_hides_starts:
            spans += [blocks.at_rest(i, j) for i, j in runs]
        else:
            spans += [(float(blocks.edges[i]), float(blocks.edges[j])) for i, j in runs]
    return spans


def _near(mean: Array, centre: Array, error: Array) -> np.ndarray:
    """Return whether blocks' means (b, 7) are those at ``centre``, up to noise. Shape (b,)."""
    near: np.ndarray = np.all(np.abs(mean - centre) <= SWAY + _SIGMAS * error, axis=1)
    return near


def _with_measured_change(samples: _Samples, candidates: Candidates) -> np.ndarray:
    """Return which candidates (m,) the vehicle came to by a change of speed that the accelerometer measured.

    A tach that spins as the wheels slip is excused by what was measured at all; and where its record begins at rest,
    the end must have been measured. The scale is that of gravity as the sensor shows it.
    """
    confirmed = np.ones(len(candidates.spans), dtype=bool)
    for k, (span, speeds) in enumerate(zip(candidates.spans, candidates.speeds, strict=True)):
        side = 0 if span[0] > samples.t[0] else 1
        edge, way = span[side], (-1.0, 1.0)[side]
        window = np.sort(edge + way * np.array([-_SETTLED_S, _SPEED_CHANGE_S + _LATENCY_S]))
        ((rest,), _), ((moving,), _) = samples.means(span), samples.means(window)
        gravity = max(float(np.linalg.norm(rest[3:6])), 1e-6)
        change = float(np.linalg.norm(moving[3:6] - rest[3:6])) * (window[1] - window[0]) * STANDARD_GRAVITY / gravity
        confirmed[k] = speeds[side] < _LEAST_CHANGE_MPS or change > min(_CONFIRMED * speeds[side], _CONFIRMED_MPS)
    return confirmed


def _piece_edges(begin: float, end: float) -> Array:
    """Return the edges of the pieces of whole blocks, as many as a span is long."""
    return np.linspace(begin, end, max(1, int((end - begin) / _BLOCK_S + 1e-9)) * _PIECES + 1)


def _quiet_spans(blocks: _Blocks, duration_s: float) -> Array:
    """Return where the inertial sensor is steady, and as quiet as anywhere for ``duration_s``, s, shape (m, 2)."""
    width = min(max(1, round(duration_s / _BLOCK_S)), len(blocks.scatter))
    level = sliding_window_view(blocks.scatter, width, axis=0).max(axis=2).min(axis=0)
    calm = np.all(blocks.scatter <= np.minimum(_QUIET_RATIO * level + 1e-6, _SCATTER_LIMITS), axis=1)
    steady = [piece for run in true_runs(calm).tolist() for piece in _steady(blocks, *run)]
    quiet = [piece for k, piece in enumerate(steady) if not _is_start_or_stop(blocks, steady, k)]
    pieces = np.array(quiet, dtype=np.int64).reshape(-1, 2)
    spans = blocks.edges[pieces]
    spans[pieces[:, 0] > 0, 0] += _MARGIN_S
    spans[pieces[:, 1] < len(blocks.scatter), 1] -= _MARGIN_S
    return spans[spans[:, 1] - spans[:, 0] >= duration_s]


def _steady(blocks: _Blocks, first: int, end: int) -> list[tuple[int, int]]:
    """Return the parts, of two blocks and more, of those from ``first`` to before ``end`` without a change of mean."""
    mean, error = blocks.mean[first:end], blocks.error(first, end) * np.sqrt(2.0)
    same = np.ones(len(mean), dtype=bool)
    for lag in range(1, min(round(_RAMP_S / _BLOCK_S), len(mean) - 1) + 1):
        same[lag:] &= _near(mean[lag:], mean[:-lag], error)
    cuts = [first, *(first + np.flatnonzero(~same)).tolist(), end]
    return [(i, j) for i, j in pairwise(cuts) if j - i > 1]


def _is_start_or_stop(blocks: _Blocks, steady: list[tuple[int, int]], k: int) -> bool:
    """Return whether steady part ``k`` shakes more than one beside it, as far off as brakes take to build up."""
    first, end = steady[k]
    gap = 2 * round(_RAMP_S / _BLOCK_S)
    beside = [(i, j) for i, j in steady[max(k - 1, 0) : k + 2] if i != first and max(i - end, first - j) <= gap]
    return any(_shakes_more(blocks.scatter[first:end], blocks.scatter[i:j]) for i, j in beside)


def _shakes_more(scatter: Array, than: Array) -> bool:
    """Return whether rate or force surely scatters more in the blocks of one span (b, 2) than of another (c, 2).

    The variance from block to block is that of both spans: two blocks alone do not determine it.
    """
    m, n = len(scatter), len(than)
    pooled = (m * scatter.var(axis=0) + n * than.var(axis=0)) / (m + n - 2)
    error = np.sqrt(pooled * (1.0 / m + 1.0 / n))
    return bool(np.any(scatter.mean(axis=0) - than.mean(axis=0) > _LOUDER * error))


def _of_one_rate(samples: _Samples, spans: list[Span]) -> list[Span]:
    """Return the spans whose mean rate is that of half of them, by duration: a steady curve turns, a rest does not."""
    if not spans:
        return spans
    rates = np.vstack([samples.means(np.array(span))[0][:, :3] for span in spans])
    duration = np.diff(np.array(spans), axis=1)[:, 0]
    order = np.argsort(rates, axis=0)
    middle = (np.cumsum(duration[order], axis=0) < 0.5 * duration.sum()).sum(axis=0)
    usual = np.take_along_axis(rates, order, axis=0)[middle, np.arange(3)]
    near = np.all(np.abs(rates - usual) < SWAY[:3], axis=1)
    return [span for span, kept in zip(spans, near, strict=True) if kept]


def _gnss_stays(gnss: pd.DataFrame | None, span: Span) -> bool:
    """Return whether half of the positions of a span or more lie within 3 sigma of their median, and a crawl of
    :data:`_CRAWL_MPS` would differ from 0 by 3 sigma of the speed that they give; True without GNSS.
    """
    if gnss is None:
        return True
    fixes = gnss[gnss["t_s"].between(*span)]
    if len(fixes) < 2:
        return False
    sd, t = fixes[["east_sd_m", "north_sd_m"]].to_numpy(), fixes["t_s"].to_numpy()
    # least squares: the speed of a line through the positions has the variance 1 / sum((t - mean t)^2 / sd^2)
    if np.linalg.norm((t - t.mean()) / sd.max(axis=1)) < 3.0 / _CRAWL_MPS:
        return False
    return _positions_stay(fixes, span)


def _positions_stay(gnss: pd.DataFrame, span: Span | Array) -> bool:
    """Return whether half of the positions of a span or more lie within 3 sigma of their median; True without any."""
    inside = gnss[gnss["t_s"].between(*span)]
    place, sd = inside[["east_m", "north_m"]].to_numpy(), inside[["east_sd_m", "north_sd_m"]].to_numpy()
    if not len(place):
        return True
    return bool((np.median(np.abs(place - np.median(place, axis=0)) / sd, axis=0) < 3.0).all())
