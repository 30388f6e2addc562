"""Balises and GNSS."""

import numpy as np

from trackfg.datasets.motion import Limits, motion, rest, reverse, run
from trackfg.datasets.positioning import BaliseModel, GnssModel, balise_table, gnss_table
from trackfg.datasets.ride import Ride


def test_balises_are_met_where_they_are_both_ways(make_line):
    leg = run(np.array([1000.0]), np.array([15.0]), (0.0, 0.0), Limits(0.7, 0.5))
    ride = Ride(make_line([0, 1200], [0, 0]), motion([*leg, *rest(5.0), *reverse(leg)], 50.0), chainage_origin_m=700.0)
    fixes = balise_table(ride, BaliseModel(spacing_m=400.0, sd_m=0.3), 1e9, None)
    assert fixes["chainage_m"].tolist() == [1100.0, 1500.0, 1500.0, 1100.0]
    np.testing.assert_allclose(ride.chainage(ride.motion.distance(fixes["t_s"])), fixes["chainage_m"], atol=1e-9)
    assert (fixes["chainage_sd_m"] == 0.3).all()
    some = balise_table(ride, BaliseModel(spacing_m=400.0, sd_m=0.3), fixes["t_s"].iloc[1], None)
    assert len(some) == 2


def test_balise_errors_have_their_sigma(make_line):
    ride = Ride(make_line([0, 20_000], [0, 0]), motion(rest(900.0), 0.0, 20.0))
    fixes = balise_table(ride, BaliseModel(spacing_m=20.0, sd_m=0.3), 900.0, np.random.default_rng(0))
    error = fixes["chainage_m"] - ride.chainage(ride.motion.distance(fixes["t_s"]))
    assert abs(error.std() / 0.3 - 1) < 0.1


def test_gnss_is_the_antenna_with_noise_and_outages(winding_ride):
    model = GnssModel(rate_hz=10.0, sd_m=(0.5, 1.0, 2.0), antenna_m=(3.0, 0.0, 4.0), outages_s=((20.0, 40.0),))
    exact = gnss_table(winding_ride, model, 120.0, None)
    assert not exact["t_s"].between(20.0, 39.99).any()
    t = exact["t_s"].to_numpy()
    enu = exact[["east_m", "north_m", "up_m"]].to_numpy()
    back = enu - winding_ride.rotation(t) @ np.array(model.antenna_m)
    np.testing.assert_allclose(back, winding_ride.position(t), atol=1e-9)
    noisy = gnss_table(winding_ride, model, 120.0, np.random.default_rng(0))
    error = noisy[["east_m", "north_m", "up_m"]].to_numpy() - enu
    np.testing.assert_allclose(error.std(axis=0), model.sd_m, rtol=0.1)
    np.testing.assert_allclose(noisy[["east_sd_m", "north_sd_m", "up_sd_m"]].to_numpy()[0], model.sd_m)
