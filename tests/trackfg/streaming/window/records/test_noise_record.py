"""A stream learns from residuals how noisy its sensors, the motion and the wheel are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pandas as pd
import pytest

from trackfg.config import NoiseConfig, SmoothConfig
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.factors.imu import Preintegration, PreintegrationNoise
from trackfg.factors.motion import non_holonomic
from trackfg.factors.states import States
from trackfg.recording.model import Recording
from trackfg.results.events import DOUBT
from trackfg.sensors.imu_intervals import Intervals
from trackfg.solver.variance_components import Residuals
from trackfg.streaming.window.records.noise_record import NoiseRecord, _with_more
from trackfg.streaming.window.sample_buffer import SampleBuffer
from trackfg.streaming.window.window import Window

from ...conftest import setting_off

N = 60
"""Intervals of the windows here."""


def window(begin: float = 0.0) -> Window:
    """A window of intervals of 1 s with unit noise, and sideways motion of 1 cm/s."""
    noise = PreintegrationNoise.alike(1.0, 1.0)
    measured = Preintegration(noise, 9.81, np.zeros(3), np.zeros(6), np.zeros(1), np.zeros((1, 3)), np.zeros((1, 3)))
    n = N + 1
    speed, growth = np.zeros(n), np.zeros((n, 2))
    motion = non_holonomic(np.arange(n), np.zeros((n, 3)), np.zeros(3), speed, growth, np.full((n, 2), 0.01), None)
    return Window(begin + np.arange(n), cast(States, None), (measured,) * N, np.zeros((n, 6, 0)), (motion,))


def residuals(size: np.ndarray) -> Residuals:
    """Three residuals of each factor of this size (m,), alternating in sign, which the rest of the graph checks."""
    signs = np.where(np.arange(len(size)) % 2, 1.0, -1.0)
    return Residuals(np.arange(len(size)), np.repeat((signs * size)[:, None], 3, axis=1), np.ones((len(size), 3)))


def test_noise_as_declared_changes_nothing() -> None:
    record, one = NoiseRecord(), window()
    assert record.weigh(one, {"gyro": residuals(np.ones(N)), "motion": residuals(np.ones(N))}, 10) is one
    assert record.events(60.0) == ()


def test_inertial_noise_has_a_level_where_it_is_and_the_newest_for_what_comes() -> None:
    size = np.ones(N)
    size[40:] = 5.0
    record, one = NoiseRecord(), window()
    weighed = record.weigh(one, {"gyro": residuals(size)}, 10)
    gyro = np.array([measured.noise.gyro[0] for measured in weighed.measured])
    np.testing.assert_allclose(gyro[:25], 1.0)
    np.testing.assert_allclose(gyro[50:], 5.0, rtol=0.2)
    assert all((measured.noise.accel == 1.0).all() for measured in weighed.measured)
    np.testing.assert_allclose(record.newest, [gyro[-1], 1.0])
    np.testing.assert_allclose(record.at(np.array([5.0, 55.0, 300.0])), [[1.0, 1.0], [gyro[55], 1.0], [gyro[-1], 1.0]])


def test_a_noisy_sensor_that_little_checks_is_known_after_some_windows() -> None:
    """Ten times the noise, of which the graph sees a hundredth part: each window alone shows 1.6 times."""
    record = NoiseRecord()
    for k in range(8):
        seen = replace(residuals(np.full(N, 1.0 / record.newest[0])), redundancy=np.full((N, 3), 0.01))
        record.weigh(window(N * k), {"gyro": seen}, N)
    assert record.newest[0] > 5.0


def test_levels_come_down_again() -> None:
    """Residuals in sigmas of the level are smaller: the level is that of the declared sigmas still."""
    record, one = NoiseRecord(), window()
    again = record.weigh(one, {"gyro": residuals(np.full(N, 4.0))}, 0)
    level = record.newest[0]
    assert level == pytest.approx(4.0, rel=0.15)
    assert record.weigh(again, {"gyro": residuals(np.full(N, 4.0 / level))}, 0) is again  # the same noise
    calm = record.weigh(again, {"gyro": residuals(np.full(N, 1.0 / level))}, 0)
    np.testing.assert_allclose([measured.noise.gyro[0] for measured in calm.measured], 1.0)


def test_motion_has_one_level_from_all_that_was_seen_and_an_event_says_so() -> None:
    record, one = NoiseRecord(), window()
    weighed = record.weigh(one, {"motion": residuals(np.full(N, 3.0))}, N)
    (motion,) = weighed.families
    np.testing.assert_allclose(motion.sigma, 0.03, rtol=0.1)
    (event,) = record.events(60.0)
    assert event.kind == "noise-raised"
    assert event.detail == "sideways motion of the vehicle: residuals show 2.9 times what is declared, " + (
        "and sigmas are of that"
    )
    level = record.others[0]
    assert record.weigh(weighed, {"motion": residuals(np.full(N, 3.0 / level))}, 0) is weighed


@pytest.mark.parametrize(
    ("group", "size", "says"),
    [
        ("accel", 5.0, "residuals of the accelerometer are 5.0 times its noise"),
        ("accel", 1.5, None),
        ("path", 12.0, "the path leaves the direction in which the vehicle points by 12 times"),
        ("path", 8.0, None),
        ("gyro", 5.0, None),
    ],
)
def test_a_sensor_that_does_not_move_as_the_track_does_is_a_doubt_of_the_geometry(
    group: str, size: float, says: str | None
) -> None:
    record = NoiseRecord()
    record.weigh(window(), {group: residuals(np.full(N, size))}, 40)
    events = record.track_doubts(60.0)
    if says is None:
        assert events == ()
    else:
        (event,) = events
        assert (event.kind, event.t_s) == (DOUBT, 60.0)
        assert event.detail.startswith(f"cross_level, twist, level, alignment, curvature: {says}")
        assert "rigid = false" in event.detail


def test_noise_of_long_ago_is_forgotten() -> None:
    """Ten minutes of three times the noise outweigh half an hour without."""
    record = NoiseRecord()
    for k in range(40):
        size = (1.0 if k < 30 else 3.0) / record.others[0]
        record.weigh(window(N * k), {"motion": residuals(np.full(N, size))}, N)
    assert record.others[0] > 2.2


def test_groups_that_nothing_checks_have_no_level() -> None:
    record, one = NoiseRecord(), window()
    unchecked = replace(residuals(np.full(N, 9.0)), redundancy=np.full((N, 3), 0.01))
    assert record.weigh(one, {"path": unchecked}, 0) is one


def test_gnss_is_not_judged_where_others_are_further_off() -> None:
    record = NoiseRecord()
    assert not record.is_worse_than_gnss({"gnss": 2.0, "motion": 1.4}, "gnss", 1.0)
    assert record.is_worse_than_gnss({"gnss": 2.0, "motion": 2.4}, "gnss", 1.0)
    record.weigh(window(), {"motion": residuals(np.full(N, 3.0))}, N)
    assert record.is_worse_than_gnss({"gnss": 1.4, "motion": 1.0}, "gnss", 1.0)  # three times the declared ones
    assert not record.is_worse_than_gnss({"gnss": 1.4, "motion": 1.0}, "gnss", 4.0)  # but positions are five times


def test_a_group_noisier_than_declared_is_seen() -> None:
    record = NoiseRecord()
    assert not record.has_risen
    record.weigh(window(), {"motion": residuals(np.ones(N))}, N)
    assert not record.has_risen
    record.weigh(window(N), {"motion": residuals(np.full(N, 3.0))}, N)
    assert record.has_risen


def test_rests_show_noise_below_the_keyframe_rate() -> None:
    """Turns that are new in each half second, of 2 rad/s, have a density of sqrt(2): with the declared 1, sqrt(3)."""
    rng = np.random.default_rng(1)
    gyro = 1e-3 * rng.standard_normal((6000, 3)) + np.repeat(2.0 * rng.standard_normal((120, 3)), 50, axis=0)
    data = Intervals(np.arange(6001) / 100.0, gyro, 1e-3 * rng.standard_normal((6000, 3)), np.zeros(6000, dtype=bool))

    class Buffer:
        def intervals(self, begin: float, end: float) -> Intervals:
            return data.take(slice(round(100.0 * begin), round(100.0 * end)))

    record, one, buffer = NoiseRecord(), window(), cast(SampleBuffer, Buffer())
    shown = record.with_rests(one, buffer, np.array([[0.0, 30.0]]))
    assert all(measured.noise.gyro == pytest.approx(np.sqrt(3.0), rel=0.25) for measured in shown.measured)
    assert all(measured.noise.accel == pytest.approx(1.0, rel=1e-3) for measured in shown.measured)
    np.testing.assert_allclose(record.shown.excess[:3] + 1.0, shown.measured[0].noise.gyro ** 2)
    assert record.with_rests(shown, buffer, np.array([[0.0, 31.0]])) is shown  # too little is new
    later = record.with_rests(shown, buffer, np.array([[0.0, 60.0]]))
    np.testing.assert_allclose(record.shown.excess[:3] + 1.0, later.measured[0].noise.gyro ** 2)
    assert len(record.at_rest.off) == 120


def test_an_interval_that_never_had_the_noise_of_rests_keeps_its_own_when_later_rests_show_less() -> None:
    """By hand: of a density squared of 1, at a level of 2, nothing is left to take 0.3 or more off."""
    (measured, *_), more = window().measured, np.array([-0.2, -0.3, 0.5, 0.0, 0.0, 0.0])
    noise = _with_more(measured, more, np.array([2.0, 1.0])).noise
    np.testing.assert_allclose(noise.gyro**2, [0.2, 1.0, 3.0])
    np.testing.assert_allclose(noise.accel, 1.0)


def settings(*, adapt: bool) -> SmoothConfig:
    return SmoothConfig(noise=NoiseConfig(adapt=adapt))


def train(seed: int, start_rest_s: float) -> Simulation:
    """A rest, then a hundred seconds on its way, with GNSS."""
    return simulate(setting_off("mainline-gnss", start_rest_s), seed=seed, duration_s=start_rest_s + 100.0)


def with_noise(run: Simulation, *, at_rest: bool) -> Recording:
    """The accelerometer errs by 0.05 m/s^2, anew in each half second, which no spectrum of its samples shows."""
    imu, rng = run.recording.imu.copy(), np.random.default_rng(1)
    t = imu["t_s"].to_numpy()
    step, size = (t // 0.5).astype(int), np.full(len(t), 0.05)
    if not at_rest:
        size[np.interp(t, run.truth["t_s"], run.truth["speed_mps"]) < 0.1] = 0.0
    for name in ("fx_mps2", "fy_mps2", "fz_mps2"):
        imu[name] += size * rng.standard_normal(step.max() + 1)[step]
    return replace(run.recording, imu=imu)


def excess_of(ours: Any, run: Simulation) -> list[float]:
    """Return errors over their sigmas, rms, of filtered rows from 50 s on."""
    table = ours.filtered[ours.filtered["t_s"] > 50.0]
    names = ("east_m", "north_m", "speed_mps", "roll_rad", "pitch_rad")
    errors = (table[name] - np.interp(table["t_s"], run.truth["t_s"], run.truth[name]) for name in names)
    return [
        float(np.sqrt(np.mean((error / table[f"{name}_sd"]) ** 2))) for name, error in zip(names, errors, strict=True)
    ]


@pytest.mark.slow
def test_sigmas_of_a_stream_hold_with_noise_of_motion_that_nobody_declared(stream: Callable[..., Any]) -> None:
    run = train(4, 12.0)
    excess = {}
    for adapt in (True, False):
        ours = stream(with_noise(run, at_rest=False), lag_s=10.0, config=settings(adapt=adapt))
        excess[adapt] = excess_of(ours, run)
        details = [event.detail for event in ours.events if event.kind == "noise-raised"]
        assert any("white noise of the accelerometer" in detail for detail in details) == adapt
    assert max(excess[True]) < 1.6
    assert min(excess[False]) > 2.5


@pytest.mark.slow
def test_a_rest_shows_noise_that_nobody_declared(stream: Callable[..., Any]) -> None:
    """By residuals alone such streams were off by 10 to 15 m: those of the start do not show which sensor errs."""
    run = train(2, 20.0)
    ours = stream(with_noise(run, at_rest=True), lag_s=10.0, config=settings(adapt=False))
    assert max(excess_of(ours, run)) < 2.5


@pytest.mark.slow
def test_a_stream_with_noise_as_declared_is_as_without_levels(stream: Callable[..., Any]) -> None:
    run = simulate(setting_off("mainline"), seed=3, duration_s=80.0).recording
    with_levels, without = (stream(run, lag_s=10.0, config=settings(adapt=adapt)).smoothed for adapt in (True, False))
    pd.testing.assert_frame_equal(with_levels, without)
