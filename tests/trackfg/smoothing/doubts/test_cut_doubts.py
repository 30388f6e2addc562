"""A body on two bogies, on a level line of straights and circles that are known."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

import trackfg
from trackfg.numerics.arrays import Array
from trackfg.recording.description import RecordingDescription
from trackfg.recording.model import IMU_COLUMNS, Recording
from trackfg.results.events import DOUBT
from trackfg.smoothing.doubts.cut_doubts import CELLS, cut_per_cell
from trackfg.smoothing.passage import STEP_M
from trackfg.streaming.fixed_lag import FixedLagSmoother
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.sources.source import RecordingSource

_SPEED_MPS, _DURATION_S, _RATE_HZ, _RADIUS_M, _HALF_M = 15.0, 240.0, 100.0, 250.0, 9.0


def line(s: Array) -> tuple[Array, Array]:
    """The track's middle (n, 2): left and right circles of 200 m with straights of 100 m between; and its heading."""
    x = np.arange(-50.0, _SPEED_MPS * _DURATION_S + 50.0, 0.05)
    part = np.floor(x / 300.0)
    curvature = np.where((x > 0.0) & (x - 300.0 * part > 100.0), (-1.0) ** part / _RADIUS_M, 0.0)
    smooth = np.convolve(curvature, np.hanning(801) / np.hanning(801).sum(), mode="same")
    heading = np.cumsum(smooth) * 0.05
    place = np.cumsum(np.column_stack([np.cos(heading), np.sin(heading)]), axis=0) * 0.05
    return np.column_stack([np.interp(s, x, one) for one in place.T]), np.asarray(np.interp(s, x, heading))


def ride() -> Recording:
    """A body whose pivots are 18 m apart, with positions of its middle."""
    rng, step = np.random.default_rng(0), 1.0 / _RATE_HZ
    t = np.arange(0.0, _DURATION_S, step)
    front, rear = (line(_SPEED_MPS * t + ahead)[0] for ahead in (_HALF_M, -_HALF_M))
    middle, chord = 0.5 * (front + rear), front - rear
    yaw = np.unwrap(np.arctan2(chord[:, 1], chord[:, 0]))
    velocity = np.gradient(middle, step, axis=0)
    force = np.gradient(velocity, step, axis=0)
    c, s, zero = np.cos(yaw), np.sin(yaw), np.zeros(len(t))
    along, across = c * force[:, 0] + s * force[:, 1], c * force[:, 1] - s * force[:, 0]
    samples = np.column_stack([zero, zero, np.gradient(yaw, step), along, across, zero + 9.80665])
    samples += rng.standard_normal(samples.shape) * np.sqrt(_RATE_HZ) * np.repeat([2e-5, 5e-4], 3)
    imu = pd.DataFrame(np.column_stack([t, samples])[5:-5], columns=list(IMU_COLUMNS))
    rows = slice(50, -50, 100)
    positions = np.column_stack([t, middle, zero])[rows] + rng.normal(0.0, 0.05, (len(t[rows]), 4)) * [
        0.0,
        1.0,
        1.0,
        1.0,
    ]
    gnss = pd.DataFrame(positions, columns=["t_s", "east_m", "north_m", "up_m"])
    gnss[["east_sd_m", "north_sd_m", "up_sd_m"]] = 0.05
    description = RecordingDescription.model_validate(
        {
            "format": "trackfg-recording/1",
            "id": "a body",
            "imu": {"file": "imu.parquet", "gyro": ["wx", "wy", "wz"], "accel": ["fx", "fy", "fz"], "rigid": False}
            | {"lever_arm_m": [0.0, 0.0, 0.0], "noise": {"gyro_white": 2e-5, "accel_white": 5e-4}},
            "gnss": {"file": "gnss.csv", "position": ["e", "n", "u"], "sd": ["a", "b", "c"], "frame": "local"},
        }
    )
    return Recording(description, imu, gnss=gnss)


def test_a_radian_of_r_300_is_cut_by_an_eighth_of_a_metre() -> None:
    heading = np.concatenate([np.zeros(10), np.arange(0.0, 1.0, STEP_M / 300.0)])
    cuts = cut_per_cell(heading)
    assert cuts is not None
    assert len(cuts) == len(heading) - 2 * CELLS
    assert cuts.sum() == pytest.approx(0.135, rel=0.15)
    assert cut_per_cell(10.0 * heading) is None
    assert cut_per_cell(heading[:3]) is not None


def test_a_way_that_is_cut_is_in_the_sigma_of_the_chainage() -> None:
    result = trackfg.smooth(ride())
    (verdict,) = [verdict for verdict in result.summary.verdicts if verdict.quantity == "chainage"]
    assert verdict.status == "widened"
    assert any("cut curves" in reason for reason in verdict.reasons)
    t, chainage, sd = result.trajectory[["t_s", "chainage_m", "chainage_m_sd"]].to_numpy().T
    error = chainage - _SPEED_MPS * (t - t[0])
    assert -2.0 < error[-1] < -0.4
    assert np.sqrt(np.mean((error[20:] / sd[20:]) ** 2)) < 1.5


def test_a_stream_says_so() -> None:
    recording = ride()
    source = RecordingSource(recording, batch_s=5.0)
    intake, smoother = Intake.of(source), FixedLagSmoother(recording.description, lag_s=10.0)
    pieces = [smoother.put(intake.push(batch)[0]) for batch in source]
    pieces += [smoother.put(intake.finish()[0]), smoother.finish()]
    details = [event.detail for piece in pieces for event in piece.events if event.kind == DOUBT]
    assert any(detail.startswith("chainage: a body on bogies 18 m apart would cut curves by") for detail in details)
