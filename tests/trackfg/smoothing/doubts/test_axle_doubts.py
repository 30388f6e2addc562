"""A frame on two axles, on straight track whose heights and cross-level are known sums of waves."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pandas as pd
import pytest

import trackfg
from trackfg.datasets.catalogue import scenario
from trackfg.datasets.effects.catalogue import effect
from trackfg.datasets.scenarios import simulate
from trackfg.numerics.arrays import Array
from trackfg.recording.description import RecordingDescription
from trackfg.recording.model import IMU_COLUMNS, Recording
from trackfg.results.events import DOUBT
from trackfg.sensors.imu_filters.axles import Axles
from trackfg.smoothing.doubts.axle_doubts import Bends
from trackfg.smoothing.leaning_body import OF_TRACK
from trackfg.streaming.fixed_lag import FixedLagSmoother
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.sources.source import RecordingSource

_SPEED_MPS, _DURATION_S, _RATE_HZ, _BASE_M = 20.0, 150.0, 100.0, 1.5
_GYRO_WHITE, _ACCEL_WHITE = 2e-5, 5e-4


class Waves:
    """Heights (m) and rolls (rad) of a track: 60 waves of 4 to 60 m each, of which short ones are smaller."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.k = 2.0 * np.pi / rng.uniform(4.0, 60.0, 60)
        self.phase = rng.uniform(0.0, 2.0 * np.pi, (2, 60))
        self.amplitude = 1e-4 / self.k * np.array([[1.0], [1.0]])

    def of(self, what: int, x: Array, gain: Array, derivative: int = 0) -> Array:
        angle = np.outer(x, self.k) + self.phase[what] + 0.5 * np.pi * derivative
        return np.asarray(np.sin(angle) @ (self.amplitude[what] * gain * self.k**derivative))


def ride(apart_m: float, force_white: float = _ACCEL_WHITE) -> tuple[Recording, Waves]:
    """A ride at one speed on axles so far apart: its middle is their mean, it points along their chord. ``force_white``
    is the noise of the force upwards.
    """
    waves, rng = Waves(0), np.random.default_rng(1)
    half = 0.5 * waves.k * apart_m
    mean, chord = np.cos(half), np.sinc(half / np.pi)
    t = np.arange(0.5 / _RATE_HZ, _DURATION_S, 1.0 / _RATE_HZ)
    x, v, g = _SPEED_MPS * t, _SPEED_MPS, 9.80665
    pitch, roll = -waves.of(0, x, chord, 1), waves.of(1, x, mean)
    samples = np.column_stack([
        *(v * waves.of(1, x, mean, 1), -v * waves.of(0, x, chord, 2), np.zeros(len(t))),
        *(-g * np.sin(pitch), g * np.sin(roll), g + v**2 * waves.of(0, x, mean, 2)),
    ])  # fmt: skip
    white = np.array([*[_GYRO_WHITE] * 3, *[_ACCEL_WHITE] * 2, force_white])
    samples += rng.standard_normal(samples.shape) * np.sqrt(_RATE_HZ) * white
    imu = pd.DataFrame(np.column_stack([t, samples]), columns=list(IMU_COLUMNS))
    at = np.arange(0.0, _DURATION_S, 0.05)
    names = {"gyro": ["wx", "wy", "wz"], "accel": ["fx", "fy", "fz"]}
    description = RecordingDescription.model_validate(
        {
            "format": "trackfg-recording/1",
            "id": "a frame",
            "track": {"gauge_m": 1.435, "cross_level_base_m": _BASE_M},
            "imu": {"file": "imu.parquet", **names, "rigid": True, "lever_arm_m": [0.0, 0.0, 0.0]}
            | {"noise": {"gyro_white": _GYRO_WHITE, "accel_white": _ACCEL_WHITE}},
            "tach": {"file": "tach.parquet", "column": "distance_m", "kind": "distance", "unit": "m"},
        }
    )
    tach = pd.DataFrame({"t_s": at, "distance_m": np.round(_SPEED_MPS * at / 0.01) * 0.01})
    return Recording(description, imu, tach), waves


@lru_cache(maxsize=2)
def smoothed(apart_m: float, force_white: float = _ACCEL_WHITE) -> tuple[trackfg.Result, Waves]:
    recording, waves = ride(apart_m, force_white)
    return trackfg.smooth(recording), waves


@pytest.mark.parametrize(("apart_m", "force_white"), [(1.0, _ACCEL_WHITE), (2.5, _ACCEL_WHITE), (2.5, 0.02)])
def test_short_waves_that_a_frame_misses_are_in_the_sigmas(apart_m: float, force_white: float) -> None:
    """The last one has more noise in its force than motion of the track: that of the gyro alone looks like axles."""
    result, waves = smoothed(apart_m, force_white)
    verdicts = {verdict.quantity: verdict for verdict in result.summary.verdicts}
    assert verdicts["twist"].status == "widened"
    (reason,) = [reason for reason in verdicts["twist"].reasons if "axles" in reason]
    found = float(reason.partition("axles are ")[2].partition(" m")[0])
    assert found == pytest.approx(apart_m, rel=0.25)
    geometry = result.geometry.dropna()
    t, chainage = result.trajectory[["t_s", "chainage_m"]].to_numpy().T
    place, one = _SPEED_MPS * np.interp(geometry["chainage_m"], chainage, t), np.ones(len(waves.k))
    true = 1e3 * _BASE_M * (np.sin(waves.of(1, place, one)) - np.sin(waves.of(1, place - 5.0, one)))
    errors = (geometry["twist_mm"] - true) / geometry["twist_mm_sd"]
    assert 0.5 < np.sqrt(np.mean(errors**2)) < 2.0


def test_one_axle_misses_nothing() -> None:
    result, _ = smoothed(0.0)
    reasons = [reason for verdict in result.summary.verdicts for reason in verdict.reasons]
    assert not any("axles" in reason for reason in reasons)


@pytest.mark.parametrize("force_white", [_ACCEL_WHITE, 0.02])
def test_noise_of_the_force_is_no_motion_of_its_own(force_white: float) -> None:
    result, _ = smoothed(0.0, force_white)
    assert not any("force upwards" in reason for verdict in result.summary.verdicts for reason in verdict.reasons)


def test_vibration_is_no_frame() -> None:
    """What the samples show of it is no white noise: several times what there is on waves of 8 to 30 m."""
    plan = replace(scenario("mainline"), effects=(effect("rectification", 0.001),))
    verdicts = trackfg.smooth(simulate(plan, seed=2, duration_s=400.0).recording).summary.verdicts
    reasons = [reason for verdict in verdicts for reason in verdict.reasons]
    assert any("vibrates" in reason for reason in reasons)
    assert not any("axles" in reason for reason in reasons)


def test_a_body_that_moves_otherwise_than_the_track_has_no_geometry_to_trust() -> None:
    """A coach: on waves of 17 m its middle rises where it does not on an axle, and it points along a chord of 0."""
    result, _ = smoothed(17.0)
    verdicts = {verdict.quantity: verdict for verdict in result.summary.verdicts}
    for quantity in OF_TRACK:
        assert verdicts[quantity].status == "not_trusted"
        assert any("force upwards" in reason for reason in verdicts[quantity].reasons)
    assert verdicts["chainage"].status != "not_trusted"


def test_sigmas_in_holes_do_not_hide_what_is_missing() -> None:
    place = np.arange(0.0, 500.0, 0.25)
    columns = ["cross_level_mm", "twist_mm", "versine_level_mm", "versine_alignment_mm", "curvature_1pm"]
    geometry = pd.DataFrame({"chainage_m": place, **{name: np.sin(place) for name in columns}})
    geometry[[f"{name}_sd" for name in columns]] = 0.1
    holed = geometry.copy()
    holed.loc[holed["chainage_m"] < 50.0, [f"{name}_sd" for name in columns]] = 100.0
    whole, with_hole = (next(Bends.of(table, 0.25).doubts(Axles(2.5))).factor for table in (geometry, holed))
    assert with_hole == pytest.approx(np.sqrt(0.9) * whole, rel=0.01)


def streamed(recording: Recording) -> list[str]:
    source = RecordingSource(recording, batch_s=5.0)
    intake, smoother = Intake.of(source), FixedLagSmoother(recording.description, lag_s=10.0)
    pieces = [smoother.put(intake.push(batch)[0]) for batch in source]
    pieces += [smoother.put(intake.finish()[0]), smoother.finish()]
    return [event.detail for piece in pieces for event in piece.events if event.kind == DOUBT]


@pytest.mark.parametrize(("apart_m", "named"), [(0.0, set()), (2.5, {"twist", "level"})])
def test_a_stream_says_so(apart_m: float, named: set[str]) -> None:
    recording, _ = ride(apart_m)
    details = streamed(recording)
    assert {detail.partition(":")[0] for detail in details if "axles" in detail} >= named
    assert named or not any("axles" in detail for detail in details)


def test_a_stream_says_that_its_sensor_does_not_follow_the_track() -> None:
    details = streamed(ride(17.0)[0])
    assert any(detail.startswith(f"{', '.join(OF_TRACK)}: of the force upwards") for detail in details)
