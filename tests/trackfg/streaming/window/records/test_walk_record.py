"""A stream learns how fast biases walk, and doubts attitudes where that is faster than declared."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.effects.catalogue import effect
from trackfg.datasets.scenarios import simulate
from trackfg.factors.states import Kind, States
from trackfg.graph.inertial import walk_of
from trackfg.recording.description import ImuNoise
from trackfg.results.events import DOUBT
from trackfg.solver.variance_components import Residuals
from trackfg.streaming.window.records.walk_record import WalkRecord
from trackfg.streaming.window.window import Window

from ...conftest import setting_off, streamed

PASSES, N, LEAVING = 60, 30, 10
NOT_FAR_OFF = np.zeros(2, dtype=bool)
NOISE = ImuNoise(accel_bias_walk=1.0, gyro_bias_walk=1.0)


def window() -> Window:
    """A window of intervals of 1 s with a walk of 1 in all axes."""
    n = N + 1
    walk = walk_of(np.arange(float(n)), np.zeros((n, 6, Kind.IMU.dim)), NOISE)
    return Window(np.arange(float(n)), cast(States, None), (), np.zeros((n, 6, Kind.IMU.dim)), (walk,))


def record(accel: float, gyro: float, far_off: np.ndarray = NOT_FAR_OFF) -> WalkRecord:
    """The record after windows of one error per axis, whose residuals are so many times what a declared walk leads to.

    What is not marginalised next is a hundred times as large.
    """
    rng, one = np.random.default_rng(3), WalkRecord()
    redundancy = np.full((N, 6), 1e-3)
    shape = np.sqrt(redundancy) * np.repeat([accel, gyro], 3)
    shape[LEAVING:] *= 100.0
    for _ in range(PASSES):
        assumed = shape / np.repeat(one.level, 3)
        one.weigh(window(), Residuals(np.arange(N), assumed * rng.standard_normal(6), redundancy), LEAVING, far_off)
    return one


def test_biases_that_walk_nearly_as_declared_are_not_doubted() -> None:
    assert record(1.0, 1.0).events(600.0) == ()
    assert record(1.0, 1.0).of(NOISE) is NOISE
    assert record(1.5, 1.5).events(600.0) == ()
    assert WalkRecord().events(600.0) == ()


def test_biases_that_walk_faster_are_a_doubt_of_the_attitude() -> None:
    details = [event.detail for event in record(1.0, 3.0).events(600.0)]
    assert details[-1].startswith("roll, pitch, cross_level, gradient: biases of the gyro walk 3.")
    assert "gyro_bias_walk" in details[-1]
    (event,) = record(3.0, 1.0).events(600.0)
    assert (event.kind, event.t_s) == (DOUBT, 600.0)
    assert "biases of the accelerometer walk 3.1 times" in event.detail


def test_what_comes_walks_as_fast_as_residuals_show() -> None:
    one = record(3.0, 1.0)
    noise = one.of(NOISE)
    assert noise.accel_bias_walk == pytest.approx(3.0, rel=0.2)
    assert noise.gyro_bias_walk == 1.0
    assert noise.accel_white == NOISE.accel_white


def test_the_walk_of_a_sensor_whose_samples_show_motion_beyond_the_model_is_only_doubted() -> None:
    one = record(3.0, 3.0, np.array([True, False]))
    noise = one.of(NOISE)
    assert noise.accel_bias_walk == 1.0
    assert noise.gyro_bias_walk == pytest.approx(3.0, rel=0.2)
    assert len(one.events(600.0)) == 2


def test_a_window_has_the_levels_of_its_residuals_and_is_itself_where_they_stay() -> None:
    one, given = WalkRecord(), window()
    quiet = Residuals(np.arange(N), np.full((N, 6), 0.03), np.full((N, 6), 1e-3))
    assert one.weigh(given, quiet, LEAVING, NOT_FAR_OFF) is given
    loud = Residuals(np.arange(N), np.full((N, 6), 3.0), np.full((N, 6), 1e-3))
    for _ in range(20):
        weighed = one.weigh(given, loud, LEAVING, NOT_FAR_OFF)
        if weighed is not given:
            break
    np.testing.assert_allclose(weighed.families[0].sigma, np.tile(np.repeat(one.level, 3), (N, 1)))
    assert (one.level > 1.5).all()


def test_few_passes_may_be_chance() -> None:
    one = WalkRecord()

    def add_pass() -> None:
        size = np.full((1, 6), 2.2) / np.repeat(one.level, 3)
        one.weigh(window(), Residuals(np.arange(1), size, np.ones((1, 6))), 1, NOT_FAR_OFF)

    add_pass()
    assert one.events(600.0) == ()
    for _ in range(9):
        add_pass()
    assert len(one.events(600.0)) == 2


@pytest.mark.slow
@pytest.mark.parametrize(("warms", "doubts"), [(False, 0), (True, 2)])
def test_a_stream_of_a_sensor_that_warms_up_doubts_its_attitude(warms: bool, doubts: int) -> None:
    plan = setting_off("mainline")
    plan = replace(plan, effects=(effect("warming", 40.0),)) if warms else plan
    recording = simulate(plan, seed=1, duration_s=300.0).recording
    details = [
        event.detail
        for event in streamed(recording, lag_s=20.0, batch_s=5.0, config=SmoothConfig()).events
        if event.kind == DOUBT and event.t_s > 290.0
    ]
    assert sum("times as fast as declared" in detail for detail in details) == doubts
