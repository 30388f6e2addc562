"""A frame on two axles that goes over the same waves forwards and backwards."""

from __future__ import annotations

import numpy as np
import pytest

from trackfg.numerics.arrays import Array
from trackfg.sensors.imu_filters.axles import MEANS, STEP_S, axles, own_motion, track_sums

_DURATION_S = 100.0


def over_waves(apart_m: float, sense: float) -> Array:
    """The means of a frame on axles so far apart, at 12 to 18 m/s over the same 1500 m: backwards for a sense of -1."""
    rng = np.random.default_rng(0)
    k = 2.0 * np.pi / rng.uniform(6.0, 40.0, 50)
    phase = rng.uniform(0.0, 2.0 * np.pi, (2, 50))
    t = np.arange(0.0, _DURATION_S, STEP_S)
    v = sense * (15.0 + 3.0 * np.sin(2.0 * np.pi * t / 40.0))
    x = np.cumsum(v) * STEP_S
    half = 0.5 * k * apart_m
    height, roll_slope = np.sin(np.outer(x, k) + phase[0]), np.sin(np.outer(x, k) + phase[1])
    turned, lifted = -1e-4 * height @ (k * np.sinc(half / np.pi)), -1e-4 * height @ (k * np.cos(half))
    means = np.zeros((len(t), MEANS))
    means[:, 0], means[:, -1] = v, 1.0
    means[:, 1], means[:, 2] = 1e-4 * v * (roll_slope @ np.cos(half)), -v * turned
    means[:, 3] = 9.8 + v**2 * lifted
    means[:, 4:6] = 1e-12
    return means


def test_a_way_there_and_back_shows_the_axles_of_each_way() -> None:
    there, back = (track_sums(over_waves(2.0, sense)) for sense in (1.0, -1.0))
    for sums in (there, back, there + back):
        found = axles(sums)
        assert found is not None
        assert found.apart_m == pytest.approx(2.0, rel=0.1)


def test_turning_back_is_no_motion_of_its_own() -> None:
    both = track_sums(np.concatenate([over_waves(0.0, 1.0), over_waves(0.0, -1.0)]))
    assert len(both) > 20
    assert own_motion(both) is None
    assert axles(both) is None
