"""The wheel's scale: true distance over nominal distance, from chainage fixes or from GNSS positions.

That of a receiver's own speeds likewise, whose integral is such a distance: it shows their unit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pandas as pd

from trackfg.checks.diagnosis_positions import path_of
from trackfg.numerics.arrays import Array
from trackfg.numerics.chi_square import widening_of_few
from trackfg.numerics.robust import robust_sd

_MIN_CHORD_M = 100.0
"""Least distance that shows a scale, m: errors of 1 m at either end are 1.4 % of it, and a scale is unsure by 1 %."""
_MAX_TURN_RAD = 0.5
"""Chords that turn by more are left out, rad: a circle's arc is 1 % longer than such a chord, other curves' are not."""
_MIN_SPEED_MPS = 3.0
"""Chords that are run more slowly are left out, m/s: positions of a vehicle at rest wander, which counts as way."""

_ALIKE = 0.1
"""Stretches between fixes agree if their ratios differ by less than this share. Most wheels creep and slip by less, and
a wrong fix makes them differ by more."""

_ERROR_SIGMAS = 6.0
"""Errors of two fixes allow for so much more."""
_MIN_STRETCH_M = 10.0
"""A shorter stretch between fixes says nothing of the usual ratio, m."""


@dataclass(frozen=True)
class WheelScale:
    """True distance = ``scale`` x nominal distance; ``samples`` is the number of stretches compared."""

    scale: float
    sd: float
    source: Literal["fixes", "gnss", "tach"]
    samples: int


def scale_from_fixes(tach: pd.DataFrame, fixes: pd.DataFrame) -> WheelScale | None:
    """Estimate the scale in ``chainage = constant +- scale * nominal distance`` by weighted least squares.

    Where the vehicle turns back the distances of the ``tach`` need their signs. Each stretch between two fixes that
    does not agree with most starts a new constant, as the two beside a fix with the chainage of another balise. The
    sigma is widened by the residuals where those exceed the declared sigmas, by Student's distribution where they are
    few. None with fewer than two fixes within the tach's time or less than 100 m between them.
    """
    t = tach["t_s"].to_numpy()
    inside = fixes[(fixes["t_s"] >= t[0]) & (fixes["t_s"] <= t[-1])]
    if len(inside) < 2:
        return None
    sd = inside["chainage_sd_m"].to_numpy()
    rolled, counted = np.diff(np.interp(inside["t_s"], t, tach["distance_m"])), np.diff(inside["chainage_m"])
    agrees = _agreeing(rolled, counted, _ERROR_SIGMAS * np.hypot(sd[1:], sd[:-1]))
    if np.abs(rolled[agrees]).sum() < _MIN_CHORD_M:
        return None
    part = np.cumsum(np.append(False, ~agrees))
    weights = 1.0 / sd**2
    x, y = (_centred(np.append(0.0, np.cumsum(stretch * agrees)), weights, part) for stretch in (rolled, counted))
    information = float(weights @ x**2)
    scale = float(weights @ (x * y)) / information
    freedom = len(inside) - int(part[-1]) - 2
    chi2 = float(weights @ (y - scale * x) ** 2) / freedom if freedom > 0 else 1.0
    few = widening_of_few(max(freedom, 1))
    return WheelScale(abs(scale), float(np.sqrt(max(1.0, chi2 * few**2) / information)), "fixes", int(agrees.sum()))


def _agreeing(rolled: Array, counted: Array, error: Array) -> np.ndarray:
    """Return which stretches (n,) are alike in the ratio of chainage to distance, but for an ``error`` in m.

    They are held against the ratio that most others are near to. One wrong fix spoils two stretches, so that up to a
    quarter of the fixes may be wrong. Where fewer than two, or than half of the stretches, are alike, all are kept.
    """
    long = np.abs(rolled) > _MIN_STRETCH_M
    if not long.any():
        return np.ones(len(rolled), dtype=bool)
    ratio = np.sort(counted[long] / rolled[long])
    far = _ALIKE * np.abs(ratio)
    near = np.searchsorted(ratio, ratio + far, side="right") - np.searchsorted(ratio, ratio - far)
    usual = float(np.median(ratio[near == near.max()]))
    alike = np.abs(counted - usual * rolled) <= _ALIKE * np.abs(usual * rolled) + error
    return np.asarray(alike | (np.count_nonzero(alike) < max(2.0, 0.5 * len(alike))))


def _centred(values: Array, weights: Array, part: np.ndarray) -> Array:
    """Return values (n,) about the weighted mean of their part (n,)."""
    return np.asarray(values - (np.bincount(part, weights * values) / np.bincount(part, weights))[part])


def scale_from_gnss(tach: pd.DataFrame, gnss: pd.DataFrame) -> WheelScale | None:
    """Estimate the scale from distances between positions at least 100 m (and 30 sigma) apart, against the tach's.

    A chord that turns by an angle a is shorter than its arc by the factor ``sin(a/2) / (a/2)``; a is the mean of the
    turns into the chords before and after. Chords that turn by more than 0.5 rad, or that are run slowly, are left out.
    The result is the median of the ratios; its sigma, ``1.25 * 1.48 MAD / sqrt(n)``, sees slip and outliers too. None
    with fewer than five chords.
    """
    t = tach["t_s"].to_numpy()
    inside = gnss[(gnss["t_s"] >= t[0]) & (gnss["t_s"] <= t[-1])]
    if len(inside) < 6:
        return None
    sd = inside[["east_sd_m", "north_sd_m"]].to_numpy()
    chord_m = max(_MIN_CHORD_M, 30.0 * float(np.median(sd)))
    nominal = np.interp(inside["t_s"], t, tach["distance_m"])
    picked = _picked(nominal, chord_m)
    if picked.size < 7:
        return None
    position = inside[["east_m", "north_m", "up_m"]].to_numpy()[picked]
    chords = np.diff(position, axis=0)
    length, distance = np.linalg.norm(chords, axis=1), np.diff(nominal[picked])
    speed = distance / np.diff(inside["t_s"].to_numpy()[picked])
    heading = np.unwrap(np.arctan2(chords[:, 1], chords[:, 0]))
    turn = np.gradient(heading)
    arc = length * _arc_over_chord(turn)
    good = (np.abs(turn) < _MAX_TURN_RAD) & (speed > _MIN_SPEED_MPS)
    good[[0, -1]] = False  # the turn at the ends is known from one side only
    if np.count_nonzero(good) < 5:
        return None
    ratio = arc[good] / distance[good]
    scale = float(np.median(ratio))
    spread = robust_sd(ratio - scale)
    return WheelScale(scale, max(1.25 * spread / float(np.sqrt(ratio.size)), 1e-5), "gnss", int(ratio.size))


def receiver_speed_scale(
    speeds: pd.DataFrame | None, gnss: pd.DataFrame | None, tach: pd.DataFrame | None
) -> WheelScale | None:
    """Return true speed over the receiver's own, from its positions, or without any from the tach's distance.

    None where neither shows it, or without such speeds. Of the tach's, the sigma is the whole scale: it shows the unit
    of the speeds alone.
    """
    if speeds is None or len(speeds) < 2:
        return None
    path = path_of(speeds)
    if gnss is not None:
        return scale_from_gnss(path, gnss)
    t, driven = path["t_s"].to_numpy(), path["distance_m"].to_numpy()
    if tach is None or driven[-1] < _MIN_CHORD_M:
        return None
    inside = (t >= tach["t_s"].iloc[0]) & (t <= tach["t_s"].iloc[-1])
    rolled = np.interp(t, tach["t_s"], tach["distance_m"])
    whole = [float(np.abs(np.diff(way[inside])).sum()) for way in (rolled, driven)]
    return WheelScale(whole[0] / whole[1], whole[0] / whole[1], "tach", 1) if whole[1] > _MIN_CHORD_M else None


def _picked(distance: Array, step_m: float) -> np.ndarray:
    """Return the indices of rows at least ``step_m`` of distance apart, from the first on."""
    steps = np.floor((distance - distance[0]) / step_m)
    return np.flatnonzero(np.diff(np.maximum.accumulate(steps), prepend=-1.0) > 0)


def _arc_over_chord(turn: Array) -> Array:
    """Return the length of arcs over that of their chords, by the angles by which they turn (n,), rad."""
    half = np.maximum(np.abs(turn) / 2.0, 1e-9)
    return np.asarray(half / np.sin(half), dtype=np.float64)
