"""Dead reckoning: what it gives back on a made run, and what it makes of simulated ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from trackfg.baselines import dead_reckoning
from trackfg.datasets.scenarios import Simulation
from trackfg.errors import BadInputError
from trackfg.recording.description import Fixes, Gnss, Imu, RecordingDescription, Tach, Track
from trackfg.recording.model import Recording

G = 9.80665
RATE_HZ, REST_S, RATE, SPEED = 100.0, 10.0, 0.05, 8.0


def circle(duration_s: float = 60.0, pitch: float = 0.0, heading_deg: float | None = None) -> Recording:
    """Ten seconds of rest, and then a circle at constant speed; a gyro with a bias, nose-down by ``pitch``."""
    t = (np.arange(round(duration_s * RATE_HZ)) + 0.5) / RATE_HZ
    speed = SPEED * np.clip((t - REST_S) / 5.0, 0.0, 1.0)
    turning = RATE * speed / SPEED
    imu = {
        "t_s": t,
        "wx_radps": 0.01 - turning * np.sin(pitch),
        "wy_radps": -0.02 + 0.0 * t,
        "wz_radps": 0.015 + turning * np.cos(pitch),
        "fx_mps2": np.gradient(speed, t) * np.cos(pitch) - G * np.sin(pitch),
        "fy_mps2": speed * turning,
        "fz_mps2": np.gradient(speed, t) * np.sin(pitch) + G * np.cos(pitch),
    }
    description = RecordingDescription(
        id="made",
        track=Track(heading_deg=heading_deg),
        imu=Imu(file="imu.csv", gyro=("wx", "wy", "wz"), accel=("fx", "fy", "fz")),
        tach=Tach(file="tach.csv", column="d", kind="distance", unit="m"),
    )
    tach = pd.DataFrame({"t_s": t, "distance_m": np.cumsum(speed) / RATE_HZ})
    return Recording(description, pd.DataFrame(imu), tach)


def true_place(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Return the place, east + i north, m, and the yaw, rad, at the samples of :func:`circle`."""
    t = recording.imu["t_s"].to_numpy()
    speed = SPEED * np.clip((t - REST_S) / 5.0, 0.0, 1.0)
    yaw = np.cumsum(RATE * speed / SPEED) / RATE_HZ
    return np.cumsum(speed * np.exp(1j * yaw)) / RATE_HZ, yaw


@pytest.mark.parametrize("pitch", [0.0, 0.12])
def test_a_circle_is_followed_however_the_sensor_is_mounted(pitch: float) -> None:
    recording = circle(pitch=pitch)
    place, yaw = true_place(recording)
    trajectory = dead_reckoning.run(recording).trajectory
    t = recording.imu["t_s"]
    np.testing.assert_allclose(trajectory["yaw_rad"], np.interp(trajectory["t_s"], t, yaw), atol=2e-3)
    np.testing.assert_allclose(trajectory["east_m"], np.interp(trajectory["t_s"], t, place.real), atol=0.3)
    np.testing.assert_allclose(trajectory["north_m"], np.interp(trajectory["t_s"], t, place.imag), atol=0.3)
    np.testing.assert_allclose(trajectory["pitch_rad"], pitch, atol=1e-2)
    np.testing.assert_allclose(trajectory["roll_rad"], 0.0, atol=1e-2)
    np.testing.assert_allclose(trajectory["speed_mps"].iloc[-1], SPEED, atol=1e-6)


def test_it_starts_with_the_declared_heading() -> None:
    assert dead_reckoning.run(circle(heading_deg=0.0)).trajectory["yaw_rad"].iloc[0] == pytest.approx(np.pi / 2.0)


def test_chainage_is_that_of_the_first_fix() -> None:
    recording = circle()
    fixes = pd.DataFrame({"t_s": [40.0, 50.0], "chainage_m": [500.0, 700.0], "chainage_sd_m": [0.1, 0.1]})
    described = recording.description.model_copy(update={"fixes": Fixes(file="fixes.csv")})
    trajectory = dead_reckoning.run(replace(recording, description=described, fixes=fixes)).trajectory
    assert np.interp(40.0, trajectory["t_s"], trajectory["chainage_m"]) == pytest.approx(500.0, abs=1e-6)


def test_the_path_is_put_onto_positions() -> None:
    recording = circle()
    place, yaw = true_place(recording)
    seen = (place * np.exp(1.2j) + 300.0 - 50.0j)[::100]
    gnss = pd.DataFrame({"t_s": recording.imu["t_s"][::100], "east_m": seen.real, "north_m": seen.imag})
    described = recording.description.model_copy(
        update={"gnss": Gnss(file="gnss.csv", position=("e", "n", "u"), sd=("a", "b", "c"), frame="local")}
    )
    gnss = gnss.assign(up_m=0.0, east_sd_m=1.0, north_sd_m=1.0, up_sd_m=1.0)
    trajectory = dead_reckoning.run(replace(recording, description=described, gnss=gnss)).trajectory
    error = np.interp(gnss["t_s"], trajectory["t_s"], trajectory["east_m"]) - gnss["east_m"]
    assert np.abs(error[1:-1]).max() < 0.5
    assert trajectory["yaw_rad"].iloc[-1] == pytest.approx(yaw[-1] + 1.2, abs=0.01)


def test_a_mainline_run_comes_out_to_a_per_cent(simulated: Callable[..., Simulation]) -> None:
    run = simulated("mainline", seed=1, duration_s=300.0)
    result = dead_reckoning.run(run.recording)
    t, travelled = result.trajectory["t_s"], run.ride.motion.path(300.0)
    place = run.ride.motion.distance(t.to_numpy())
    reckoned = result.trajectory["chainage_m"].to_numpy()
    assert np.abs((reckoned - reckoned[0]) - (place - place[0])).max() < 0.02 * travelled
    assert result.parameters["rests"] == 2.0
    assert result.trajectory["chainage_m_sd"].isna().all()


def test_without_a_tach_it_says_so() -> None:
    recording = circle()
    described = recording.description.model_copy(update={"tach": None})
    with pytest.raises(BadInputError, match="no tachometer"):
        dead_reckoning.run(replace(recording, description=described, tach=None))
