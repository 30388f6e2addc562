"""A stream doubts what rests on a prior that is far from what its data say."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import simulate
from trackfg.factors.bias import RECTIFICATION
from trackfg.factors.states import Kind, States
from trackfg.results.events import DOUBT, Event
from trackfg.streaming.doubts.far_priors import mounting_doubts, prior_doubts

from ..conftest import setting_off, streamed

SD = 5e-4
"""Declared of the accelerometer, m/s^2 per (m/s^2)^2."""


def doubts(clock: tuple[float, float, float] = (0.0, 0.0, 0.0), along_z: float = 0.0) -> tuple[Event, ...]:
    imu = np.zeros((1, Kind.IMU.dim))
    imu[0, RECTIFICATION] = 0.0, 0.0, along_z
    states = SimpleNamespace(clock=np.array([clock]), imu=imu)
    return prior_doubts(cast(States, states), SmoothConfig(), SD, 60.0)


def test_clocks_within_four_declared_sigmas_are_not_doubted() -> None:
    assert doubts((-0.3, 0.0, 1.1)) == ()
    late, early = doubts((-0.5, 0.0, 1.5))
    assert (late.kind, late.t_s) == (DOUBT, 60.0)
    assert late.detail.startswith("chainage, position, speed: the stamps of tach are 0.50 s late")
    assert "add 1.50 to gnss.time_offset_s" in early.detail


def test_a_clock_that_gains_more_than_declared_is_doubted() -> None:
    assert doubts((0.0, 3e-4, 0.0)) == ()
    (event,) = doubts((0.0, 1e-3, 0.0))
    assert event.detail.startswith(
        "chainage, position, height, speed, pitch, gradient: the clock of the IMU gains 0.1 %"
    )


def test_a_bias_that_grows_with_vibration_by_more_than_declared_is_a_doubt_of_the_attitude() -> None:
    assert doubts(along_z=-3.9 * SD) == ()
    (event,) = doubts(along_z=-4.1 * SD)
    assert event.detail.startswith("roll, pitch, cross_level, gradient: the accelerometer's bias grows with vibration")
    assert "0, 0, -0.002 m/s^2" in event.detail
    assert "declare rectification_sd" in event.detail


@pytest.mark.parametrize(
    ("off_m", "quantities"),
    [
        ((0.0, 0.0, -0.5), "alignment"),
        ((0.0, 0.5, 0.0), "level"),
        ((0.5, 0.0, 0.0), "level, alignment"),
        ((0.19, 0.0, -0.19), None),
        ((0.0, 0.0, -9.0), None),
    ],
)
def test_a_point_far_from_the_declared_one_is_a_doubt_of_what_turns_move(
    off_m: tuple[float, float, float], quantities: str | None
) -> None:
    """Within four sigmas it may be there, and outside of any vehicle it is noise."""
    events = mounting_doubts(np.array([0.0, 0.0, *off_m]), np.full(3, 0.05), 60.0)
    assert [event.detail.partition(":")[0] for event in events] == ([] if quantities is None else [quantities])
    assert all("10.0 sigmas from what was declared or assumed to 0.05" in event.detail for event in events)


@pytest.mark.slow
def test_a_stream_of_late_positions_doubts_its_place() -> None:
    recording = simulate(setting_off("mainline-gnss", 8.0), seed=2, duration_s=38.0).recording
    assert recording.gnss is not None
    late = replace(recording, gnss=recording.gnss.assign(t_s=recording.gnss["t_s"] + 2.0))
    for run, doubts in ((recording, 0), (late, 1)):
        details = [
            event.detail for event in streamed(run, lag_s=5.0, config=SmoothConfig()).events if event.kind == DOUBT
        ]
        assert sum("the stamps of gnss are" in detail for detail in details) == doubts
