"""A stream doubts attitudes where biases walk faster than declared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.effects.catalogue import effect
from trackfg.datasets.scenarios import simulate
from trackfg.results.events import DOUBT, Event
from trackfg.solver.variance_components import Residuals
from trackfg.streaming.window.walk_test import WalkTest

from ..conftest import setting_off, streamed

PASSES, N, LEAVING = 60, 30, 10


def doubted(accel: float, gyro: float) -> tuple[Event, ...]:
    """Put windows of one error per axis, whose residuals are so many times what the declared walk leads to.

    What is not marginalised next is a hundred times as large.
    """
    rng, test = np.random.default_rng(3), WalkTest()
    redundancy = np.full((N, 6), 1e-3)
    shape = np.sqrt(redundancy) * np.repeat([accel, gyro], 3)
    shape[LEAVING:] *= 100.0
    for _ in range(PASSES):
        test.put(Residuals(np.arange(N), shape * rng.standard_normal(6), redundancy), LEAVING)
    return test.events(600.0)


def test_biases_that_walk_nearly_as_declared_are_not_doubted() -> None:
    assert doubted(1.0, 1.0) == ()
    assert doubted(1.5, 1.5) == ()
    assert WalkTest().events(600.0) == ()


def test_biases_that_walk_faster_are_a_doubt_of_the_attitude() -> None:
    (event,) = doubted(1.0, 3.0)
    assert (event.kind, event.t_s) == (DOUBT, 600.0)
    assert event.detail.startswith("roll, pitch, cross_level, gradient: biases of the gyro walk 3.")
    assert "gyro_bias_walk" in event.detail
    (event,) = doubted(3.0, 1.0)
    assert "biases of the accelerometer walk 3." in event.detail


def test_few_passes_may_be_chance() -> None:
    test, walk = WalkTest(), Residuals(np.arange(1), np.full((1, 6), 2.2), np.ones((1, 6)))
    test.put(walk, 1)
    assert test.events(600.0) == ()
    for _ in range(9):
        test.put(walk, 1)
    assert len(test.events(600.0)) == 2


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
