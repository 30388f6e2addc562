"""The true track geometry: every geometry column of a track, from its exact functions.

One row per 0.25 m of chainage ``x``, on whole multiples of it, facing increasing chainage whichever way the run went.
With the height ``z`` and the lateral position ``u`` of a path, where ``u'' = d(heading of the path)/dx``:

* ``cross_level = base sin(roll)``, ``twist(x) = cross_level(x) - cross_level(x - B)``;
* ``curvature = (heading(x + b/2) - heading(x - b/2)) / b``, ``gradient = (z(x + g/2) - z(x - g/2)) / g``;
* ``versine(x) = y(x) - (y(x - L/2) + y(x + L/2)) / 2`` of ``y = z`` and ``y = u``;
* ``level`` and ``alignment``: the band D1 of ``z`` and ``u`` (:mod:`trackfg.datasets.line.wavelength_band`) of the
  centre line and of each rail, the level at its top, the alignment at its running edge.

``u`` is the integral of the designed heading, a polynomial, plus that of the deviation from it (two Gauss-Legendre
nodes between rows: too small by 9e-5 for a wave of 2 m, by 2e-5 for one of 3 m).

The band has the gain ``g(W)`` on ``z`` and ``u``, which grow without bound, and so ``-g(W) / (2 - 2 cos(W h))`` on
their second differences over the step ``h``, which do not; it goes to 0 with ``W``, since ``g`` falls like ``W^8``.

A row whose operator reaches beyond the ends of the run is NaN. The band counts as reaching over its longest wavelength,
25 m, each way; but what it takes from there is a tenth of what it takes from nearby, so beyond the ends of the run it
is given the track that is there, and a place has the same value in every run. Beyond the ends of the line itself, the
second differences go on as they were.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pandas as pd
from scipy import fft

from trackfg.datasets.line.track import SimulatedTrack
from trackfg.datasets.line.wavelength_band import LONGEST_M, d1_gain
from trackfg.numerics.arrays import Array

STEP_M = 0.25
"""Step of the table in chainage, m: the default of the smoother's results."""
_SURROUNDINGS_M = 300.0
"""Farther off, nothing matters to the band (1e-10 of its greatest weight for a kink)."""

_NODES = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)
"""Two Gauss-Legendre nodes in a cell from 0 to 1."""


@dataclass(frozen=True)
class _Paths:
    """The track at rows of ``STEP_M``, in the order of chainage and facing it. Shapes (n,), or (n, 3) for paths.

    The three paths are the centre line, the left and the right rail.
    """

    chainage: Array
    heading: Array
    cross_level: Array
    gauge: Array
    height: Array
    lateral: Array


@dataclass(frozen=True)
class OperatorLengths:
    """Bases and chord of the true geometry, m; the defaults are those of a result."""

    twist_base_m: float = 5.0
    chord_m: float = 10.0
    curvature_base_m: float = 10.0
    gradient_base_m: float = 25.0


OPERATOR_LENGTHS = OperatorLengths()
"""The lengths that the recordings' truth has."""


def truth_geometry(
    track: SimulatedTrack,
    *,
    chainage_origin_m: float,
    direction: Literal[1, -1],
    s_from: float,
    s_to: float,
    lengths: OperatorLengths = OPERATOR_LENGTHS,
) -> pd.DataFrame:
    """Return the geometry table of the stretch from ``s_from`` to ``s_to``, where chainage is ``origin + direction s``.

    Columns ``chainage_m, curvature_1pm, gradient_permille, cross_level_mm, twist_mm, level_mm, alignment_mm,
    versine_level_mm, versine_alignment_mm, level_left_mm, level_right_mm, alignment_left_mm, alignment_right_mm,
    gauge_mm``. Raises ``ValueError`` for a twist base that is not a multiple of 0.25 m, and for another base or chord
    that is not one of 0.5 m.
    """
    twist = _rows(lengths.twist_base_m)
    chord = _rows(0.5 * lengths.chord_m)
    bend, slope = _rows(0.5 * lengths.curvature_base_m), _rows(0.5 * lengths.gradient_base_m)
    around = max(s_from - _SURROUNDINGS_M, 0.0), min(s_to + _SURROUNDINGS_M, track.line.length_m)
    paths = _facing_chainage(track, chainage_origin_m, direction, *around)
    z, u = paths.height[:, 0], paths.lateral[:, 0]
    level, alignment = 1e3 * _d1(paths.height).T, 1e3 * _d1(paths.lateral).T
    far = _rows(LONGEST_M)
    # Per column: how many rows its operator reaches back and ahead, and the values.
    columns: dict[str, tuple[int, int, Array]] = {
        "curvature_1pm": (bend, bend, _rise(paths.heading, -bend, bend) / lengths.curvature_base_m),
        "gradient_permille": (slope, slope, 1e3 * _rise(z, -slope, slope) / lengths.gradient_base_m),
        "cross_level_mm": (0, 0, 1e3 * paths.cross_level),
        "twist_mm": (twist, 0, 1e3 * _rise(paths.cross_level, -twist, 0)),
        "level_mm": (far, far, level[0]),
        "alignment_mm": (far, far, alignment[0]),
        "versine_level_mm": (chord, chord, 5e2 * (_rise(z, -chord, 0) - _rise(z, 0, chord))),
        "versine_alignment_mm": (chord, chord, 5e2 * (_rise(u, -chord, 0) - _rise(u, 0, chord))),
        "level_left_mm": (far, far, level[1]),
        "level_right_mm": (far, far, level[2]),
        "alignment_left_mm": (far, far, alignment[1]),
        "alignment_right_mm": (far, far, alignment[2]),
        "gauge_mm": (0, 0, 1e3 * paths.gauge),
    }
    first, last = _whole_rows(chainage_origin_m, direction, s_from, s_to)
    run = slice(*(np.array([first, last + 1]) - round(paths.chainage[0] / STEP_M)))
    quantities = {name: _within(values[run], back, ahead) for name, (back, ahead, values) in columns.items()}
    return pd.DataFrame({"chainage_m": paths.chainage[run]} | quantities)


def _within(values: Array, back: int, ahead: int) -> Array:
    """Return the values, NaN where fewer rows than these are on either side."""
    row = np.arange(len(values))
    return np.where((row >= back) & (row < len(values) - ahead), values, np.nan)


def _whole_rows(origin: float, direction: int, s_from: float, s_to: float) -> tuple[int, int]:
    """Return the first and the last whole multiple of the step of chainage between two places."""
    ends = sorted((origin + direction * s_from, origin + direction * s_to))
    # An end that misses a multiple by rounding has it.
    return int(np.ceil(ends[0] / STEP_M - 1e-6)), int(np.floor(ends[1] / STEP_M + 1e-6))


def _facing_chainage(track: SimulatedTrack, origin: float, direction: int, s_from: float, s_to: float) -> _Paths:
    first, last = _whole_rows(origin, direction, s_from, s_to)
    chainage = STEP_M * np.arange(first, last + 1, dtype=np.float64)
    s = np.asarray((direction * (chainage - origin))[::direction])
    line = track.line
    places = track.at(s)
    rpy, cross_level = places.rpy, places.cross_level
    # At a half base along the axle, whose height is cos(pitch) sin(roll).
    half = 0.5 * np.cos(rpy[:, 1]) * cross_level
    height = places.centre[:, 2, None] + np.stack([np.zeros(len(s)), half, -half], axis=-1)
    cells = STEP_M * np.mean(track.heading_deviations(s[:-1, None] + STEP_M * _NODES), axis=1)
    lateral = np.concatenate([np.zeros((1, 3)), np.cumsum(cells, axis=0)])
    lateral += line.curvature.antiderivative(2)(s)[:, None]
    if direction == 1:
        return _Paths(chainage, rpy[:, 2], cross_level, places.gauge, height, lateral)
    # Who faces the other way has left on the right, and so the rails change places. Height stays, and heading turns by
    # a constant, which no column sees.
    swapped = [0, 2, 1]
    turned = rpy[::-1, 2], -cross_level[::-1], places.gauge[::-1], height[::-1, swapped], -lateral[::-1, swapped]
    return _Paths(chainage, *turned)


def _d1(paths: Array) -> Array:
    """Return the band D1 of each column. Shape (n, c) to (n, c)."""
    bends = np.diff(paths, n=2, axis=0)
    beyond = _rows(_SURROUNDINGS_M) + 1
    size = fft.next_fast_len(len(bends) + 2 * beyond, real=True)
    padded = np.pad(bends, ((beyond, size - len(bends) - beyond), (0, 0)), mode="edge")
    phase = 2 * np.pi * fft.rfftfreq(size)
    # The constant part passes with gain 0 and may be divided by anything.
    gain = -d1_gain(phase / STEP_M) / np.where(phase == 0.0, 1.0, 2.0 - 2.0 * np.cos(phase))
    band = fft.irfft(gain[:, None] * fft.rfft(padded, axis=0), size, axis=0)
    return np.asarray(band[beyond - 1 : beyond - 1 + len(paths)])


def _rise(y: Array, start: int, end: int) -> Array:
    """Return ``y(x + end) - y(x + start)``, in rows; NaN beyond the ends. Shape (n,) to (n,)."""
    out = np.full(len(y), np.nan)
    rows = slice(-start, len(y) - end)
    out[rows] = y[end - start :] - y[: start - end]
    return out


def _rows(length_m: float) -> int:
    """Return a length in rows. Raises ``ValueError`` where that is no whole number."""
    rows = length_m / STEP_M
    if rows < 1 or not rows.is_integer():
        raise ValueError(f"an operator must reach over a multiple of {STEP_M} m, not {length_m} m")
    return int(rows)
