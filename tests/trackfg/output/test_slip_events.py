"""The wheel's excess where the clocks differ and the wheel has a scale: worked out by hand."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from trackfg.factors.odometry import tach_distance
from trackfg.factors.states import Kind, Nav, Odo, States
from trackfg.output.event_sources import EventSources
from trackfg.output.slip_events import Excess, wheel_excess
from trackfg.sensors.tach import Wheel

ACCELERATION_MPS2 = 0.5
DURATION_S, MIDDLE_S = 60.0, 30.0
OFFSET_S, DRIFT, SCALE = 0.4, 2e-3, 1.02


def excess_of(offset_s: float, drift: float) -> Excess:
    """A run that gains speed from rest, D = t^2 / 4, by a wheel of scale 1.02 that never slips.

    To the tach's stamps T = 0.4 s + 2e-3 (t - 30 s) is to be added: what bears the stamp t - T was counted at t.
    ``offset_s`` and ``drift`` are what the states believe of it.
    """
    at = np.linspace(0.0, DURATION_S, 601)
    keyframes = np.linspace(0.0, DURATION_S, 61)

    def distance(t: np.ndarray) -> np.ndarray:
        return 0.5 * ACCELERATION_MPS2 * np.maximum(t, 0.0) ** 2

    true = np.linspace(-2.0, DURATION_S + 2.0, 6401)
    stamps = true - OFFSET_S - DRIFT * (true - MIDDLE_S)
    wheel = Wheel(stamps, distance(true) / SCALE, 1e-3, 0.0, False, np.zeros((0, 2)))
    n = len(keyframes)
    rolled = tach_distance(np.arange(n - 1), np.zeros((n - 1, Kind.WHEEL.dim)), np.full((n - 1, 1), 1e-3), None)
    odo = Odo.of(distance(keyframes), np.full(n, SCALE), distance(keyframes) / SCALE, np.zeros(n))
    nav = Nav(np.tile(np.eye(3), (n, 1, 1)), *np.zeros((2, n, 3)))
    clock = np.array([[offset_s, drift, 0.0]])
    states = States(nav, np.zeros((n, 6)), odo, np.zeros((1, 5)), clock, np.zeros((1, Kind.IMU.dim)))
    nothing = np.zeros((0, 2))
    sources = EventSources(keyframes, 1, nothing, nothing, wheel, MIDDLE_S, (rolled,))
    trajectory = pd.DataFrame(
        {"t_s": at, "chainage_m": distance(at), "speed_mps": ACCELERATION_MPS2 * at, "speed_mps_sd": 1e-3}
    )
    excess = wheel_excess(sources, states, trajectory)
    assert excess is not None
    return excess


def test_a_wheel_that_rolls_has_no_excess_whatever_its_clock() -> None:
    excess = excess_of(OFFSET_S, DRIFT)
    assert np.abs(excess.excess - excess.excess[0]).max() < 1e-3
    inner = (excess.t > 1.0) & (excess.t < DURATION_S - 1.0)
    assert np.abs(excess.rate[inner]).max() < 1e-4


def test_what_is_wrong_of_the_offset_shows_as_an_excess_that_grows_with_the_speed() -> None:
    """Believed 0.1 s less than it is, counts are taken from 0.1 s later, where the wheel has rolled 0.1 s v further,
    less what it had at the beginning: at 50 s, where v is 25 m/s, 2.5 m, and the rate is 0.1 s times 0.5 m/s^2.
    """
    excess = excess_of(OFFSET_S - 0.1, DRIFT)
    assert np.interp(50.0, excess.t, excess.excess) == pytest.approx(2.5, abs=0.02)
    assert np.interp(50.0, excess.t, excess.rate) == pytest.approx(0.05, abs=1e-3)


def test_what_is_wrong_of_the_drift_counts_from_the_middle_of_the_run() -> None:
    """Believed 2e-3 less than it is, counts are taken from 2e-3 x (50 - 30) = 0.04 s later at 50 s: 1 m at 25 m/s; from
    as much earlier at 10 s: -0.2 m at 5 m/s.
    """
    excess = excess_of(OFFSET_S, DRIFT - 2e-3)
    np.testing.assert_allclose(np.interp([10.0, 30.0, 50.0], excess.t, excess.excess), [-0.2, 0.0, 1.0], atol=0.01)
