"""Balises and GNSS."""

import numpy as np
import pytest

from trackfg.datasets.sensors.positioning import BaliseModel, GnssModel, balise_table, gnss_table
from trackfg.datasets.vehicle.motion import Limits, motion, rest, reverse, run
from trackfg.datasets.vehicle.ride import Ride


@pytest.fixture
def long_ride(make_line):
    """20 km in 1000 s."""
    return Ride(make_line([0, 30_000], [0, 0]), motion(rest(1000.0), 0.0, 20.0))


def _chainage_error(fixes, ride):
    return (fixes["chainage_m"] - ride.chainage(ride.motion.distance(fixes["t_s"]))).to_numpy()


def _enu(table):
    return table[["east_m", "north_m", "up_m"]].to_numpy()


def test_balises_are_met_where_they_are_both_ways(make_line):
    leg = run(np.array([1000.0]), np.array([15.0]), (0.0, 0.0), Limits(0.7, 0.5))
    ride = Ride(make_line([0, 1200], [0, 0]), motion([*leg, *rest(5.0), *reverse(leg)], 50.0), chainage_origin_m=700.0)
    fixes = balise_table(ride, BaliseModel(spacing_m=400.0, sd_m=0.3), 1e9, None)
    assert fixes["chainage_m"].tolist() == [1100.0, 1500.0, 1500.0, 1100.0]
    np.testing.assert_allclose(ride.chainage(ride.motion.distance(fixes["t_s"])), fixes["chainage_m"], atol=1e-9)
    assert (fixes["chainage_sd_m"] == 0.3).all()
    some = balise_table(ride, BaliseModel(spacing_m=400.0, sd_m=0.3), fixes["t_s"].iloc[1], None)
    assert len(some) == 2


def test_balise_errors_have_their_sigma(long_ride):
    fixes = balise_table(long_ride, BaliseModel(spacing_m=20.0, sd_m=0.3), 900.0, np.random.default_rng(0))
    assert abs(_chainage_error(fixes, long_ride).std() / 0.3 - 1) < 0.1


def test_balises_are_missed_and_misread_as_often_as_asked(long_ride):
    right = BaliseModel(spacing_m=20.0, sd_m=0.3)
    bad = BaliseModel(spacing_m=20.0, sd_m=0.3, miss_probability=0.2, wrong_probability=0.05, wrong_m=(30.0, 200.0))
    all_of_them = balise_table(long_ride, right, 1000.0, np.random.default_rng(0))
    errors, met = [], []
    for seed in range(20):
        fixes = balise_table(long_ride, bad, 1000.0, np.random.default_rng(seed))
        met.append(len(fixes) / len(all_of_them))
        errors.append(_chainage_error(fixes, long_ride))
    error = np.concatenate(errors)
    wrong = np.abs(error) > 10.0
    assert np.mean(met) == pytest.approx(0.8, abs=0.01)
    assert wrong.mean() == pytest.approx(0.05, abs=0.006)
    assert np.abs(error[wrong]).min() > 28.0
    assert np.abs(error[wrong]).max() < 202.0
    assert (error[wrong] > 0).mean() == pytest.approx(0.5, abs=0.06)
    assert error[~wrong].std() == pytest.approx(0.3, rel=0.03)
    # What is read rightly is what a better reader reads.
    fixes = balise_table(long_ride, bad, 1000.0, np.random.default_rng(0))
    both = all_of_them.merge(fixes, on="t_s")
    difference = (both["chainage_m_x"] - both["chainage_m_y"]).abs()
    assert ((difference == 0) | (difference > 28.0)).all()


def test_gnss_is_the_antenna_with_noise_and_outages(winding_ride):
    model = GnssModel(rate_hz=10.0, sd_m=(0.5, 1.0, 2.0), antenna_m=(3.0, 0.0, 4.0), outages_s=((20.0, 40.0),))
    exact = gnss_table(winding_ride, model, 120.0, None)
    assert not exact["t_s"].between(20.0, 39.99).any()
    t = exact["t_s"].to_numpy()
    enu = _enu(exact)
    back = enu - winding_ride.rotation(t) @ np.array(model.antenna_m)
    np.testing.assert_allclose(back, winding_ride.position(t), atol=1e-9)
    noisy = gnss_table(winding_ride, model, 120.0, np.random.default_rng(0))
    error = _enu(noisy) - enu
    np.testing.assert_allclose(error.std(axis=0), model.sd_m, rtol=0.1)
    np.testing.assert_allclose(noisy[["east_sd_m", "north_sd_m", "up_sd_m"]].to_numpy()[0], model.sd_m)


def test_multipath_has_its_sigma_and_its_time(long_ride):
    sd, tau = np.array([2.0, 3.0, 4.0]), 5.0
    model = GnssModel(rate_hz=1.0, sd_m=(1e-9, 1e-9, 1e-9), multipath_sd_m=tuple(sd), multipath_time_s=tau)
    exact = _enu(gnss_table(long_ride, model, 1000.0, None))
    tables = [gnss_table(long_ride, model, 1000.0, np.random.default_rng(seed)) for seed in range(30)]
    errors = np.stack([_enu(table) - exact for table in tables])
    np.testing.assert_allclose(errors.std(axis=(0, 1)), sd, rtol=0.08)
    np.testing.assert_allclose(errors[:, 0].std(axis=0), sd, rtol=0.4)
    for lag in (1, 5, 10):
        product = np.mean(errors[:, lag:] * errors[:, :-lag], axis=(0, 1)) / sd**2
        np.testing.assert_allclose(product, np.exp(-lag / tau), atol=0.08)
    np.testing.assert_allclose(tables[0][["east_sd_m", "north_sd_m", "up_sd_m"]].to_numpy()[0], sd, rtol=1e-9)


def test_outliers_are_as_many_and_as_far_as_asked(long_ride):
    model = GnssModel(rate_hz=10.0, sd_m=(0.1, 0.1, 0.1), outlier_probability=0.02, outlier_m=(10.0, 50.0))
    exact = _enu(gnss_table(long_ride, model, 1000.0, None))
    error = _enu(gnss_table(long_ride, model, 1000.0, np.random.default_rng(0))) - exact
    off = np.hypot(error[:, 0], error[:, 1])
    out = off > 5.0
    assert out.mean() == pytest.approx(0.02, abs=0.004)
    assert off[out].min() > 9.5
    assert off[out].max() < 50.5
    assert error[~out].std() == pytest.approx(0.1, rel=0.02)
    assert np.abs(error[:, 2]).max() < 1.0


def test_random_outages_come_at_their_rate(long_ride):
    model = GnssModel(rate_hz=10.0, outages_per_hour=18.0, outage_s=(5.0, 15.0))
    gaps = []
    for seed in range(40):
        steps = np.diff(gnss_table(long_ride, model, 1000.0, np.random.default_rng(seed))["t_s"])
        gaps.append(steps[steps > 0.15])
    assert np.mean([len(found) for found in gaps]) == pytest.approx(1000 / (200 + 10), rel=0.2)
    lengths = np.concatenate(gaps)
    assert lengths.min() > 4.9
    assert lengths.max() < 15.2


def test_the_receivers_clock_is_late_by_what_must_be_added(long_ride):
    right = gnss_table(long_ride, GnssModel(), 100.0, np.random.default_rng(0))
    late = gnss_table(long_ride, GnssModel(clock_offset_s=0.2), 100.0, np.random.default_rng(0))
    np.testing.assert_allclose(late["t_s"] + 0.2, right["t_s"], atol=1e-12)
    assert late["east_m"].equals(right["east_m"])


def test_a_seed_repeats_two_differ_and_a_longer_run_begins_alike(long_ride):
    gnss = GnssModel(outages_per_hour=30.0, multipath_sd_m=(1.0, 1.0, 1.0), outlier_probability=0.1)
    balises = BaliseModel(spacing_m=100.0, sd_m=0.3, miss_probability=0.3, wrong_probability=0.2)
    for make, model in ((gnss_table, gnss), (balise_table, balises)):
        long = make(long_ride, model, 800.0, np.random.default_rng(1))
        assert make(long_ride, model, 800.0, np.random.default_rng(1)).equals(long)
        assert not make(long_ride, model, 800.0, np.random.default_rng(2)).equals(long)
        short = make(long_ride, model, 500.0, np.random.default_rng(1))
        np.testing.assert_allclose(long[: len(short)], short, atol=1e-9)
