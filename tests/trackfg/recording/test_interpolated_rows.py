"""Rows between a receiver's measurements are known by straight lines, and what a receiver measures never is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackfg.checks.contradictions.all_contradictions import diagnose
from trackfg.datasets.scenarios import simulate
from trackfg.numerics.arrays import Array
from trackfg.recording.interpolated_rows import interpolated_rows
from trackfg.recording.unmeasured_rows import unmeasured_in
from trackfg.smoothing.smoother import smooth

END_S = 140.0
DEGREE_M = 111e3


def places(t: Array) -> Array:
    """A rest of 30 s, 20 s of acceleration, a curve with 10 m/s, and another rest from 110 s on."""
    way = 0.25 * np.clip(t - 30.0, 0.0, 20.0) ** 2 + 10.0 * np.clip(t - 50.0, 0.0, 60.0)
    return 300.0 * np.stack([np.sin(way / 300.0), 1.0 - np.cos(way / 300.0)], axis=1)


def rounded(place: Array, decimals: int | None) -> Array:
    return place if decimals is None else np.round(place / DEGREE_M, decimals) * DEGREE_M


@pytest.mark.parametrize("late_s", [0.0, 0.037])
@pytest.mark.parametrize(
    ("rate_hz", "decimals", "sd_m"),
    [(5.0, None, 0.02), (10.0, None, 0.02), (200.0, None, 2.0), (10.0, 9, 0.02), (10.0, 8, 0.3), (10.0, 7, 2.0)],
)
def test_one_row_stays_of_each_measurement(rate_hz: float, decimals: int | None, sd_m: float, late_s: float) -> None:
    measured_s = np.arange(0.0, END_S + 1.0)
    measured = places(measured_s) + sd_m * np.random.default_rng(1).standard_normal((measured_s.size, 2))
    t = np.arange(late_s, END_S, 1.0 / rate_hz)
    table = np.stack([np.interp(t, measured_s, column) for column in measured.T], axis=1)

    kept = t[~interpolated_rows(t, rounded(table, decimals))]

    assert kept.size == pytest.approx(END_S, rel=0.1)
    nearest = np.abs(kept[1:-1, None] - measured_s).min(axis=1)
    assert np.quantile(nearest, 0.95) <= 1.0 / rate_hz


@pytest.mark.parametrize("rate_hz", [1.0, 5.0, 10.0, 20.0])
@pytest.mark.parametrize("decimals", [None, 8, 7, 6])
@pytest.mark.parametrize("sd_m", [0.0, 0.001, 0.01, 0.3])
def test_measurements_are_not_interpolated(rate_hz: float, decimals: int | None, sd_m: float) -> None:
    t = np.arange(0.0, END_S, 1.0 / rate_hz)
    place = places(t) + sd_m * np.random.default_rng(2).standard_normal((t.size, 2))
    assert not interpolated_rows(t, rounded(place, decimals)).any()
    assert not interpolated_rows(t, np.hypot(*np.gradient(place, t, axis=0).T)[:, None]).any()


def test_an_outage_that_is_bridged_by_a_line_has_no_rows() -> None:
    measured_s = np.setdiff1d(np.arange(0.0, END_S + 1.0), np.arange(60.0, 90.0))
    measured = places(measured_s) + 0.3 * np.random.default_rng(1).standard_normal((measured_s.size, 2))
    t = np.arange(0.0, END_S, 0.1)
    kept = t[~interpolated_rows(t, np.stack([np.interp(t, measured_s, column) for column in measured.T], axis=1))]
    assert not ((kept > 59.5) & (kept < 89.5)).any()


def test_at_rest_a_row_per_interval_stays() -> None:
    t = np.arange(0.0, END_S, 0.1)
    measured_s = np.arange(0.0, END_S + 1.0)
    kept = t[~interpolated_rows(t, np.stack([np.interp(t, measured_s, x) for x in places(measured_s).T], axis=1))]
    assert np.count_nonzero(kept < 30.0) == pytest.approx(30, abs=2)


def test_a_recording_whose_positions_are_interpolated_is_smoothed_as_if_they_were_not() -> None:
    run = simulate("mainline-gnss", seed=5, duration_s=90.0)
    gnss = run.recording.gnss
    assert gnss is not None
    at = gnss["t_s"].to_numpy()
    t = np.arange(at[0], at[-1], 0.1)
    table = gnss.reindex(range(len(t))).assign(**{name: np.interp(t, at, gnss[name]) for name in gnss})
    filled = replace(run.recording, gnss=table)

    assert unmeasured_in(run.recording) == {}
    _, findings = diagnose(filled)
    assert [finding.code for finding in findings if finding.code.endswith("interpolated")] == ["gnss-interpolated"]
    once, again = (smooth(recording) for recording in (run.recording, filled))
    assert "gnss-interpolated" in [finding.code for finding in again.summary.findings]
    np.testing.assert_allclose(again.trajectory["east_m_sd"], once.trajectory["east_m_sd"], rtol=0.3)
