"""Offsets of sensors and seasons are distinguished from drifts where runs show them, and left alone elsewhere."""

from __future__ import annotations

import numpy as np

from trackfg.mapping.trends.drift import drift
from trackfg.mapping.trends.offsets import YEAR_DAYS, offset_columns

PLACES, SD = 400, 0.3


def made_up(t: np.ndarray, rate: float, seed: int) -> np.ndarray:
    noise = SD * np.random.default_rng(seed).standard_normal((t.size, PLACES))
    return 1.0 + rate * t[:, None] + noise


def inside(rate: np.ndarray, rate_sd: np.ndarray, true: float) -> float:
    """Share of rates within two sigmas of the true one."""
    return float(np.mean(np.abs(rate - true) < 2.0 * rate_sd))


def test_a_sensor_that_reads_otherwise_does_not_tilt_the_drift() -> None:
    t, rate = 30.0 * np.arange(14), 0.01
    sensors = ["a", "b", "a", "a", "b", "b", "a", "b", "b", "a", "b", "b", "a", "b"]
    y = made_up(t, rate, 1) + np.outer([2.0 * (sensor == "a") for sensor in sensors], np.ones(PLACES))
    known = np.ones(y.shape, dtype=bool)
    columns = offset_columns(t, sensors, known)
    assert columns.shape == (14, PLACES, 1)
    found = drift(t, y, np.full(y.shape, SD), threshold=6.0, offsets=columns)
    assert 0.9 < inside(found.rate, found.rate_sd, rate) <= 0.99
    assert abs(found.scale - 1.0) < 0.1
    assert not found.steps.any()
    # The value is that of the sensor with most runs.
    assert abs(np.mean(found.value) - (1.0 + rate * t[-1])) < 0.1
    without = drift(t, y, np.full(y.shape, SD), threshold=6.0)
    assert np.median(without.rate_sd) > 2.0 * np.median(found.rate_sd)


def test_a_season_is_distinguished_from_a_drift_after_two_years() -> None:
    t, rate = 30.0 * np.arange(30), 0.003
    y = made_up(t, rate, 2) + 1.5 * np.cos(2.0 * np.pi * (t - 40.0) / YEAR_DAYS)[:, None]
    columns = offset_columns(t, [""] * 30, np.ones(y.shape, dtype=bool))
    assert columns.shape == (30, PLACES, 2)
    found = drift(t, y, np.full(y.shape, SD), threshold=6.0, offsets=columns)
    assert 0.9 < inside(found.rate, found.rate_sd, rate) <= 0.99
    assert not found.steps.any()
    assert offset_columns(t[:20], [""] * 20, np.ones((20, 3), dtype=bool)).shape == (20, 3, 0)


def test_what_runs_cannot_show_has_no_column() -> None:
    t = 30.0 * np.arange(10)
    known = np.ones((10, 2), dtype=bool)
    replaced = ["a"] * 5 + ["b"] * 5
    assert offset_columns(t, replaced, known).shape == (10, 2, 0), "it might be work on the track"
    turns = ["a", "b"] * 5
    known[1:5, 1] = False  # of b three runs are left at the second place, of a three
    assert offset_columns(t, turns, known)[:, :, 0].any(axis=0).tolist() == [True, True]
    known[8:, 1] = False  # of a two
    assert offset_columns(t, turns, known)[:, :, 0].any(axis=0).tolist() == [True, False]
    y = np.where(known, made_up(t, 0.0, 3)[:, :2], np.nan)
    found = drift(t, y, np.full(y.shape, SD), threshold=6.0, offsets=offset_columns(t, turns, known))
    assert np.isfinite(found.rate).tolist() == [True, True]
