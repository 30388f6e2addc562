"""The simulated sensor of the speed over ground."""

from __future__ import annotations

import numpy as np
import pytest

from trackfg.datasets.sensors.speed_over_ground import SpeedModel
from trackfg.datasets.vehicle.ride import Ride


def test_without_noise_it_is_the_speed_of_its_place(winding_ride: Ride) -> None:
    """To the left of the reference point it is slower in a curve to the left."""
    centre, _, scale = SpeedModel().measured(winding_ride, 100.0, None)
    left, *_ = SpeedModel(place_m=(0.0, 1.0, 0.0)).measured(winding_ride, 100.0, None)
    yaw_rate = winding_ride.body_rate(centre["t_s"].to_numpy())[:, 2]
    assert scale == 1.0
    np.testing.assert_allclose(centre["speed_mps"] - left["speed_mps"], yaw_rate, atol=1e-9)


def test_scale_noise_and_silences_are_as_asked_for(winding_ride: Ride) -> None:
    model = SpeedModel(rate_hz=100.0, sd_mps=0.1, scale_sd=0.02, lowest_mps=9.0, dropouts_per_hour=120.0)
    ideal, *_ = SpeedModel(rate_hz=100.0, lowest_mps=0.0).measured(winding_ride, 120.0, None)
    table, _, scale = model.measured(winding_ride, 120.0, np.random.default_rng(1))
    true = np.interp(table["t_s"], ideal["t_s"], ideal["speed_mps"])
    fast = true > 10.0
    assert np.std((table["speed_mps"] - true / scale)[fast]) == pytest.approx(0.1, rel=0.05)
    assert table["speed_mps"].min() >= 9.0
    assert np.diff(table["t_s"]).max() > 1.0


def test_it_is_declared_as_it_is(winding_ride: Ride) -> None:
    part = SpeedModel(sd_mps=0.2, place_m=(1.0, 2.0, 3.0)).measured(winding_ride, 10.0, None).part
    assert (part.sd_mps, part.lever_arm_m) == (0.2, (1.0, 2.0, 3.0))
