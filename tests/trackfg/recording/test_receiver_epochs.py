"""A table that is written faster than its receiver measures has each measurement once, and at rest none is lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from trackfg.checks.contradictions.all_contradictions import diagnose
from trackfg.datasets.scenarios import simulate
from trackfg.numerics.arrays import Array
from trackfg.recording.model import GNSS_SPEED_TABLE
from trackfg.recording.receiver_epochs import held_rows
from trackfg.recording.unmeasured_rows import held_in
from trackfg.smoothing.smoother import smooth

END_S = 120.0


def way_at(t: Array) -> Array:
    """A rest of 30 s, a drive with 10 m/s, and another rest from 90 s on."""
    return np.clip(t - 30.0, 0.0, 60.0) * 10.0


def table(rate_hz: float, receiver_hz: float, digits: int = 6) -> tuple[Array, Array, np.ndarray]:
    """Return times, places that are held between measurements, and which row is the first of each measurement."""
    t = np.arange(0.0, END_S, 1.0 / rate_hz)
    measurement = np.floor(t * receiver_hz + 1e-6)
    place = np.round(np.stack([way_at(measurement / receiver_hz), 0.2 * way_at(measurement / receiver_hz)], 1), digits)
    return t, place, np.append(True, np.diff(measurement) > 0.0)


@pytest.mark.parametrize(("rate_hz", "receiver_hz"), [(10.0, 1.0), (10.0, 5.0), (10.0, 4.0), (100.0, 10.0), (5.0, 1.0)])
def test_each_measurement_counts_once_and_at_rest_as_well(rate_hz: float, receiver_hz: float) -> None:
    t, place, first = table(rate_hz, receiver_hz)
    kept = ~held_rows(t, place, place)
    moving = (t > 31.0) & (t < 89.0)
    np.testing.assert_array_equal(kept[moving], first[moving])
    assert np.count_nonzero(kept) == pytest.approx(END_S * receiver_hz, rel=0.2)  # rests, too, once an interval


@pytest.mark.parametrize("rate_hz", [1.0, 10.0, 20.0])
def test_a_receiver_that_is_written_as_it_measures_loses_nothing_at_rest(rate_hz: float) -> None:
    t, place, _ = table(rate_hz, rate_hz)
    assert not held_rows(t, place, place).any()


def test_a_receiver_at_rest_all_the_time_loses_nothing() -> None:
    t = np.arange(0.0, END_S, 0.1)
    assert not held_rows(t, np.zeros((t.size, 2)), np.zeros((t.size, 2))).any()


def test_a_clock_that_jitters_changes_nothing() -> None:
    rng = np.random.default_rng(2)
    t, _, _ = table(10.0, 1.0)
    measured_s = np.floor(t + 0.15 * rng.standard_normal(t.size))
    measured_s = np.maximum.accumulate(measured_s)
    place = np.stack([way_at(measured_s), 0.0 * t], axis=1)
    kept = t[~held_rows(t, place, place)]
    assert np.count_nonzero((kept > 31.0) & (kept < 89.0)) == pytest.approx(58, abs=1)


@pytest.mark.parametrize(("rate_hz", "receiver_hz"), [(1.0, 1.0), (10.0, 1.0), (10.0, 10.0)])
def test_the_last_position_before_a_tunnel_is_none_within_it(rate_hz: float, receiver_hz: float) -> None:
    t, place, _ = table(rate_hz, receiver_hz)
    tunnel = (t >= 50.0) & (t < 70.0)
    place[tunnel] = place[np.flatnonzero(tunnel)[0]]
    kept = ~held_rows(t, place, place)
    assert np.count_nonzero(kept[tunnel]) == 1
    assert np.count_nonzero(kept[t < 30.0]) == pytest.approx(30.0 * receiver_hz, rel=0.1)


def test_speeds_alone_are_held_by_those_in_motion() -> None:
    t = np.arange(0.0, END_S, 0.1)
    speed = np.round(np.clip(5.0 + 4.0 * np.sin(np.floor(t) / 9.0), 0.0, None), 3)
    speed[t < 30.0] = 0.0
    kept = ~held_rows(t, speed[:, None])
    assert np.count_nonzero(kept) == pytest.approx(END_S, rel=0.05)


def test_a_recording_whose_table_holds_positions_is_smoothed_as_if_it_did_not() -> None:
    run = simulate("mainline-gnss", seed=5, duration_s=90.0)
    gnss = run.recording.gnss
    assert gnss is not None
    t = np.arange(gnss["t_s"].iloc[0], gnss["t_s"].iloc[-1], 0.1)
    row = np.searchsorted(gnss["t_s"].to_numpy(), t + 1e-6) - 1
    held = replace(run.recording, gnss=gnss.iloc[row].reset_index(drop=True).assign(t_s=t))

    assert held_in(run.recording) == {}
    _, findings = diagnose(held)
    assert [finding.code for finding in findings if finding.code.endswith("held")] == ["gnss-held"]
    once, again = (smooth(recording) for recording in (run.recording, held))
    assert "gnss-held" in [finding.code for finding in again.summary.findings]
    for name in ("east_m", "north_m"):
        apart = (again.trajectory[name] - once.trajectory[name]).abs() / once.trajectory[f"{name}_sd"]
        assert apart.iloc[: 10 * 80].max() < 0.5
    np.testing.assert_allclose(again.trajectory["east_m_sd"], once.trajectory["east_m_sd"], rtol=0.3)


def test_speeds_beside_held_positions_are_held_unless_they_change() -> None:
    run = simulate("mainline-gnss", seed=5, duration_s=60.0)
    gnss = run.recording.gnss
    assert gnss is not None
    moving = gnss[gnss["t_s"] > 35.0].iloc[np.repeat(np.arange(20), 5)].reset_index(drop=True)
    moving["t_s"] = 36.0 + 0.2 * np.arange(len(moving))
    speeds = pd.DataFrame({"t_s": moving["t_s"], "speed_mps": 10.0, "speed_sd_mps": 0.1})
    held = held_in(replace(run.recording, gnss=moving, others={GNSS_SPEED_TABLE: speeds}))
    assert np.count_nonzero(held[GNSS_SPEED_TABLE]) == np.count_nonzero(held["gnss"]) == 80
    changing = speeds.assign(speed_mps=10.0 + 0.01 * np.arange(len(speeds)))
    assert GNSS_SPEED_TABLE not in held_in(replace(run.recording, gnss=moving, others={GNSS_SPEED_TABLE: changing}))
