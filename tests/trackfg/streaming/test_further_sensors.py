"""Further sensors in a stream: rows of their own tables, and a help where the wheel slips."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.recording.model import Recording


def alone(recording: Recording) -> Recording:
    """Without its further sensors."""
    description = recording.description.model_copy(update={"speed": (), "further_tach": ()})
    return replace(recording, description=description, others={})


def over_leaves(name: str) -> Simulation:
    plan = replace(scenario(name), adhesion=scenario("slippery-line-leaves").adhesion)
    return simulate(plan, seed=2, duration_s=400.0)


def rms(run: Simulation, table: Any) -> float:
    """Of the chainage after the second fix, m."""
    assert run.recording.fixes is not None
    table = table[table["t_s"] > run.recording.fixes["t_s"].iloc[1]]
    error = table["chainage_m"] - np.interp(table["t_s"], run.truth["t_s"], run.truth["chainage_m"])
    return float(np.sqrt(np.mean(error**2)))


@pytest.mark.slow
def test_a_stream_holds_its_place_over_slippery_rails_with_further_sensors_and_without(
    stream: Callable[..., Any],
) -> None:
    """Under leaves, between fixes. As measured with seed 2 over 400 s: 0.17 m alone, 0.13 m with a radar, 0.18 m with a
    second axle, which slips as well and leaves it to itself to find creep. The rest of both runs is the same.
    """
    radar, axles = map(over_leaves, ("slippery-line-radar", "slippery-line-two-axles"))
    once_a_second = {"config": SmoothConfig()}
    for run, recording, settings in (
        (radar, radar.recording, once_a_second),
        (axles, axles.recording, once_a_second),
        (axles, alone(axles.recording), {}),
    ):
        assert rms(run, stream(recording, lag_s=10.0, **settings).smoothed) < 0.25


@pytest.mark.slow
def test_a_stream_allows_for_an_antenna_that_is_not_declared_from_the_sensor(stream: Callable[..., Any]) -> None:
    """The sensor is 0.6 m aside of the point from which the antenna was declared."""
    plan = scenario("mainline-gnss")
    run = simulate(replace(plan, imu=replace(plan.imu, lever_arm_m=(0.0, 0.6, 0.0))), seed=2, duration_s=240.0)
    declared = run.recording.description
    imu = type(declared.imu)(**declared.imu.model_dump(exclude={"lever_arm_m"}))
    recording = replace(run.recording, description=declared.model_copy(update={"imu": imu}))
    table = stream(recording, lag_s=10.0, config=SmoothConfig()).smoothed
    error = table["chainage_m"] - np.interp(table["t_s"], run.truth["t_s"], run.truth["chainage_m"])
    in_sigmas = (error - error.iloc[0]) / table["chainage_m_sd"]
    assert np.sqrt(np.mean(in_sigmas**2)) < 1.5
