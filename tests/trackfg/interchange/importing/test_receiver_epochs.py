"""A table that is written faster than its receiver measures has each measurement once, and at rest none is lost."""

from __future__ import annotations

import numpy as np
import pytest

from trackfg.interchange.importing.receiver_epochs import held_rows
from trackfg.numerics.arrays import Array

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
