"""Sensors and the season make runs differ at a place, besides the drift.

Sensors and the vehicles that they are in respond differently to the same track, at one place more than at another, and
frost and heat move a track back and forth within a year. Both are columns of the drift's model at each place:

    y_i = ... + o_s(i) + c cos(2 pi t_i / year) + d sin(2 pi t_i / year)

with an offset o of every sensor but the one with most runs, and the season about its mean over a year. A column is
there where the runs at a place distinguish it from drift and steps, and nowhere else.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackfg.numerics.arrays import Array

FEWEST_TIMES = 3
"""Different times of a sensor's runs, and of the others', from which its offset is distinguished from the drift: each
then shows the drift by itself, with one to spare."""

YEAR_DAYS = 365.25

FEWEST_YEARS = 2.0
"""Years from which a season is distinguished from a drift: over one year the sine of a season and a line have a
correlation of 0.78, over two one of 0.39."""

FEWEST_IN_SEASONS = 8
"""Different times from which there is a season: twice the four numbers of a drift and a season."""


def offset_columns(t_days: Array, sensors: Sequence[str], known: np.ndarray) -> Array:
    """Return columns (n, m, k) of n runs at m places; ``known`` (n, m): where a run says anything."""
    columns = [*_of_sensors(t_days, np.array(sensors), known), *_of_seasons(t_days, known)]
    return np.stack(columns, axis=2) if columns else np.zeros((*known.shape, 0))


def different_times(t: Array, known: np.ndarray) -> Array:
    """Return at how many different times each place has a value, (m,)."""
    _, group = np.unique(t, return_inverse=True)
    return np.asarray(sum(known[group == each].any(axis=0).astype(np.float64) for each in range(group.max() + 1)))


def _of_sensors(t: Array, sensors: np.ndarray, known: np.ndarray) -> list[Array]:
    names, runs = np.unique(sensors, return_counts=True)
    reference = names[runs.argmax()]
    of_reference = known & (sensors == reference)[:, None]
    first, last = _ends(t, of_reference)
    has_reference = different_times(t, of_reference) >= FEWEST_TIMES
    columns = []
    for name in names[names != reference]:
        of_sensor = known & (sensors == name)[:, None]
        own_first, own_last = _ends(t, of_sensor)
        # A sensor that only took another's place cannot be distinguished from work on the track at that time.
        overlaps = (own_first < last) & (own_last > first)
        observable = overlaps & has_reference & (different_times(t, of_sensor) >= FEWEST_TIMES)
        if observable.any():
            columns.append(np.where(observable, sensors[:, None] == name, 0.0))
    return columns


def _of_seasons(t: Array, known: np.ndarray) -> list[Array]:
    first, last = _ends(t, known)
    observable = (last - first >= FEWEST_YEARS * YEAR_DAYS) & (different_times(t, known) >= FEWEST_IN_SEASONS)
    if not observable.any():
        return []
    angle = 2.0 * np.pi * t / YEAR_DAYS
    return [np.outer(wave, observable).astype(np.float64) for wave in (np.cos(angle), np.sin(angle))]


def _ends(t: Array, known: np.ndarray) -> tuple[Array, Array]:
    """Return the first and the last time at which each place has a value, (m,)."""
    return np.where(known, t[:, None], np.inf).min(axis=0), np.where(known, t[:, None], -np.inf).max(axis=0)
