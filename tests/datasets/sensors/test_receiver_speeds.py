"""The simulated receiver's speeds: of the antenna, late, and too large near rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackfg.datasets.effects.positions import SPEED_PER_M, Canyon
from trackfg.datasets.scenarios import scenario, simulate
from trackfg.datasets.sensors.receiver_speeds import ReceiverSpeeds
from trackfg.recording.model import GNSS_SPEED_TABLE


def test_speeds_are_of_the_antenna_and_as_old_as_their_delay() -> None:
    run = simulate("mainline-gnss", seed=2, duration_s=120.0)
    model, arm = ReceiverSpeeds(antenna_m=(0.0, 3.0, 0.0), delay_s=0.5), np.array([0.0, 3.0, 0.0])
    table = model.measured(run.ride, 120.0, None).table
    t = table["t_s"].to_numpy()[1:] - 0.5
    swing = np.einsum("nij,nj->ni", run.ride.rotation(t), np.cross(run.ride.body_rate(t), arm))
    velocity = run.ride.velocity(t) + swing
    np.testing.assert_allclose(table["speed_mps"][1:], np.hypot(*velocity[:, :2].T), atol=1e-12)


def test_at_rest_a_receiver_sees_the_length_of_its_noise() -> None:
    """Rayleigh's distribution has the mean sqrt(pi / 2)."""
    run = simulate("mainline-gnss", seed=2, duration_s=10.0)
    table = ReceiverSpeeds(rate_hz=1000.0, sd_mps=0.1).measured(run.ride, 2.0, np.random.default_rng(1)).table
    assert run.ride.motion.speed(np.array([2.0])).item() == 0.0
    assert table["speed_mps"].mean() == pytest.approx(0.1 * np.sqrt(np.pi / 2.0), rel=0.05)


def test_between_houses_speeds_err_less_than_positions() -> None:
    plan = replace(scenario("mainline-gnss"), further_sensors=(ReceiverSpeeds(sd_mps=1e-6),))
    worlds = plan, replace(plan, effects=(Canyon(10.0),))
    clean, canyon = (simulate(world, seed=2, duration_s=600.0).recording for world in worlds)
    error = (canyon.others[GNSS_SPEED_TABLE] - clean.others[GNSS_SPEED_TABLE])["speed_mps"]
    inside = error.abs() > 1e-9
    assert 0.2 < inside.mean() < 0.8
    assert np.sqrt(np.mean(error[inside] ** 2)) == pytest.approx(10.0 * SPEED_PER_M, rel=0.25)
