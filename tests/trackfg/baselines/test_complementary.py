from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from trackfg.baselines import complementary
from trackfg.baselines.complementary import accelerometer_roll, complementary_roll, smoothing
from trackfg.baselines.result import BaselineResult
from trackfg.datasets.catalogue import scenario
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.datasets.sensors.imu_grades import ADIS16495_1
from trackfg.errors import BadInputError
from trackfg.evaluation.geometry_errors import geometry_errors
from trackfg.numerics.arrays import Array
from trackfg.numerics.units import STANDARD_GRAVITY as G
from trackfg.recording.description import Imu, RecordingDescription, Tach, Track
from trackfg.recording.model import Recording

RATE_HZ = 200.0
BASE_M = 1.5


def recording(roll: Array, rate: Array, speed: Array, lateral: Array | float = 0.0, direction: int = 1) -> Recording:
    """A vehicle on a level line with this roll, rate of roll, speed and centripetal acceleration at 200 Hz."""
    n = len(roll)
    t = (np.arange(n) + 0.5) / RATE_HZ
    yaw_rate = np.broadcast_to(lateral, n) / np.where(speed > 0.0, speed, 1.0)
    imu = pd.DataFrame(
        {
            "t_s": t,
            "wx_radps": rate,
            "wy_radps": yaw_rate * np.sin(roll),
            "wz_radps": yaw_rate * np.cos(roll),
            "fx_mps2": np.zeros(n),
            "fy_mps2": G * np.sin(roll) + lateral * np.cos(roll),
            "fz_mps2": G * np.cos(roll) - lateral * np.sin(roll),
        }
    )
    tach = pd.DataFrame({"t_s": t, "distance_m": np.cumsum(speed) / RATE_HZ})
    description = RecordingDescription(
        id="made",
        track=Track(cross_level_base_m=BASE_M, direction=1 if direction > 0 else -1),
        imu=Imu(file="imu.csv", gyro=("wx", "wy", "wz"), accel=("fx", "fy", "fz")),
        tach=Tach(file="tach.csv", column="d", kind="distance", unit="m"),
    )
    return Recording(description, imu, tach)


def steady(roll_rad: float, seconds: float = 60.0, **more: float | int) -> Recording:
    n = round(seconds * RATE_HZ)
    lateral, direction = float(more.get("lateral", 0.0)), int(more.get("direction", 1))
    return recording(np.full(n, roll_rad), np.zeros(n), np.full(n, 1.0), lateral, direction)


def errors(result: BaselineResult, simulation: Simulation) -> pd.DataFrame:
    geometry = result.geometry.assign(cross_level_mm_sd=1.0, twist_mm_sd=1.0)
    return geometry_errors(geometry, result.trajectory, simulation.truth, simulation.truth_geometry)


def largest(error: pd.Series[float]) -> float:
    """Largest magnitude about the mean: the accelerometer's bias is a constant that nothing on board shows."""
    known = error.dropna()
    return float((known - known.mean()).abs().max())


def roll_error(result: BaselineResult, simulation: Simulation) -> Array:
    truth = np.interp(result.trajectory["t_s"], simulation.truth["t_s"], simulation.truth["roll_rad"])
    error = result.trajectory["roll_rad"].to_numpy() - truth
    return np.asarray(error - error.mean())


@pytest.fixture(scope="module")
def trolley() -> Simulation:
    return simulate("trolley", seed=2)


def test_alpha_is_the_papers() -> None:
    assert smoothing(12.5, 1.0 / RATE_HZ) == pytest.approx(0.99960, abs=5e-6)


def test_filter_is_the_papers_recursion() -> None:
    r, turned = np.random.default_rng(0).normal(0.0, 0.1, (2, 50))
    theta, alpha, expected = 0.3, 0.9, []
    for r_k, turned_k in zip(r, turned, strict=True):
        theta = alpha * (theta + turned_k) + (1.0 - alpha) * r_k
        expected.append(theta)
    np.testing.assert_allclose(complementary_roll(r, turned, alpha, 0.3), expected, rtol=1e-12)


def test_low_and_high_pass_add_up_to_one() -> None:
    """A true angle in both channels comes back, whatever the crossover; backward differences make it exact."""
    angle = 0.1 * np.sin(np.linspace(0.0, 20.0, 4000))
    turned = np.diff(angle, prepend=angle[0])
    np.testing.assert_allclose(complementary_roll(angle, turned, 0.9996, angle[0]), angle, atol=1e-14)


def test_accelerometer_roll_is_the_inclination_of_the_lateral_axis() -> None:
    tilted = G * np.array([-np.sin(0.03), np.cos(0.03) * np.sin(0.1), np.cos(0.03) * np.cos(0.1)])
    assert np.sin(accelerometer_roll(tilted)) == pytest.approx(np.cos(0.03) * np.sin(0.1))


@pytest.mark.parametrize("method", ["complementary", "accelerometer"])
@pytest.mark.parametrize("direction", [1, -1])
def test_constant_roll(method: complementary.Method, direction: int) -> None:
    result = complementary.run(steady(0.1, direction=direction), method=method)
    np.testing.assert_allclose(result.trajectory["roll_rad"], 0.1, atol=1e-9)
    known = result.geometry.dropna(subset=["cross_level_mm"])
    assert len(known) > 200
    # Left is left when looking towards greater chainage: the other rail to a run that goes down.
    np.testing.assert_allclose(known["cross_level_mm"], direction * 1500.0 * np.sin(0.1), atol=1e-5)
    np.testing.assert_allclose(known["twist_mm"].dropna(), 0.0, atol=1e-5)
    assert ((known["chainage_m"] / 0.25) % 1.0 == 0.0).all()
    assert (np.sign(known["chainage_m"].iloc[-1]) == direction) or known["chainage_m"].iloc[-1] == 0.0


def test_constant_roll_rate() -> None:
    """A cant ramp: cross-level rises with the chainage, twist is its rise over 5 m."""
    n, rate, level_s = round(60.0 * RATE_HZ), 0.002, 2.0
    t = (np.arange(n) + 0.5) / RATE_HZ
    ramp = recording(rate * np.maximum(t - level_s, 0.0), np.where(t > level_s, rate, 0.0), np.full(n, 1.0))
    for result in (complementary.run(ramp), complementary.run(ramp, method="gyro", detrended=False)):
        rolled = rate * np.maximum(result.trajectory["t_s"] - level_s, 0.0)
        np.testing.assert_allclose(result.trajectory["roll_rad"], rolled, atol=1.1e-5)  # one sample's turn
        assert result.geometry["twist_mm"].median() == pytest.approx(1500.0 * rate * 5.0, rel=5e-3)


def test_detrended_gyro_has_no_straight_line_left() -> None:
    n = round(60.0 * RATE_HZ)
    ramp = recording(np.zeros(n), np.full(n, 0.002), np.full(n, 1.0))
    np.testing.assert_allclose(complementary.run(ramp, method="gyro").trajectory["roll_rad"], 0.0, atol=1e-9)


def test_circle_with_cant_needs_the_centripetal_correction() -> None:
    """At the paper's 0.92 m/s and R = 400 m, ``v^2/R`` looks like 0.32 mm of cross-level over 1500 mm."""
    roll, lateral = 0.1, 0.92**2 / 400.0
    n = round(120.0 * RATE_HZ)
    circle = recording(np.full(n, roll), np.zeros(n), np.full(n, 0.92), lateral)
    corrected = complementary.run(circle).geometry["cross_level_mm"].dropna()
    printed = complementary.run(circle, as_printed=True).geometry["cross_level_mm"].dropna()
    np.testing.assert_allclose(corrected, 1500.0 * np.sin(roll), atol=1e-3)
    assert printed.mean() - corrected.mean() == pytest.approx(0.32, abs=0.01)


def test_static_bias_at_the_start_is_removed() -> None:
    n, bias = round(120.0 * RATE_HZ), 3e-3
    speed = np.where(np.arange(n) < 30.0 * RATE_HZ, 0.0, 1.0)
    noise = np.random.default_rng(0).normal(0.0, 1e-6, n)
    biased = recording(np.full(n, 0.05), bias + noise, speed)
    result = complementary.run(biased)
    np.testing.assert_allclose(result.trajectory["roll_rad"], 0.05, atol=1e-5)
    assert result.parameters["static_bias_x_radps"] == pytest.approx(bias, rel=1e-3)
    left_in = complementary.run(biased, remove_static_bias=False)
    assert left_in.trajectory["roll_rad"].iloc[-1] - 0.05 == pytest.approx(12.5 * bias, rel=1e-3)  # 0.2 deg/s: 65 mm


def test_what_a_standstill_shows_of_the_accelerometers_bias_is_removed() -> None:
    """0.05 m/s^2 on the vertical axis scales the roll by 0.5 %; across, it is a roll like any other."""
    n, roll = round(120.0 * RATE_HZ), 0.12
    speed = np.where(np.arange(n) < 30.0 * RATE_HZ, 0.0, 1.0)
    true = recording(np.full(n, roll), np.zeros(n), speed)
    up = replace(true, imu=true.imu.assign(fz_mps2=true.imu["fz_mps2"] + 0.05))
    result = complementary.run(up)
    np.testing.assert_allclose(result.trajectory["roll_rad"], roll, atol=1e-5)
    assert result.parameters["static_excess_z_mps2"] == pytest.approx(0.05, rel=0.02)
    left_in = complementary.run(up, remove_static_bias=False).trajectory["roll_rad"]
    np.testing.assert_allclose(left_in, roll * (1.0 - 0.05 / G), rtol=2e-4)
    across = replace(true, imu=true.imu.assign(fy_mps2=true.imu["fy_mps2"] + 0.05))
    np.testing.assert_allclose(complementary.run(across).trajectory["roll_rad"], roll + 0.05 / G, rtol=1e-3)


def test_on_a_trolley_the_gyro_alone_drifts_and_its_straight_line_takes_the_cant_too(trolley: Simulation) -> None:
    filtered = complementary.run(trolley.recording)
    drifting = complementary.run(trolley.recording, method="gyro", detrended=False)
    line = complementary.run(trolley.recording, method="gyro")
    largest_filtered = largest(errors(filtered, trolley)["cross_level_mm"])
    assert largest(errors(drifting, trolley)["cross_level_mm"]) > 10.0 * largest_filtered
    assert largest(errors(line, trolley)["cross_level_mm"]) > 10.0 * largest_filtered


def test_on_a_trolley_the_accelerometer_alone_is_unusable_unfiltered(trolley: Simulation) -> None:
    """Sample by sample: what the geometry's grid averages over half a second is a low-pass already."""
    raw = roll_error(complementary.run(trolley.recording, method="accelerometer", low_pass_hz=None), trolley)
    low = roll_error(complementary.run(trolley.recording, method="accelerometer"), trolley)
    filtered = roll_error(complementary.run(trolley.recording), trolley)
    assert 1500.0 * np.std(raw) > 2.0
    assert 1500.0 * np.abs(raw).max() > 5.0
    assert np.std(low) < 0.3 * np.std(raw)
    assert np.std(filtered) < 0.3 * np.std(raw)


def test_on_a_trolley_with_a_steady_sensor_the_largest_error_is_below_a_millimetre() -> None:
    """The paper's 1.0 mm, for a gyro whose noise and bias walk are the finer grade's."""
    plan = scenario("trolley")
    fine = replace(plan, imu=replace(plan.imu, noise=ADIS16495_1.noise, response=ADIS16495_1.response))
    simulation = simulate(fine, seed=2)
    found = errors(complementary.run(simulation.recording), simulation)
    assert largest(found["cross_level_mm"]) <= 1.0
    assert float(found["twist_mm"].abs().max()) <= 1.0


def test_on_a_trolley_the_errors_are_those_of_the_error_budget(trolley: Simulation) -> None:
    """Sigma of the gyro's noise alone, ``1500 mm * 8.73e-5 * sqrt(T/2)`` = 0.33 mm, and the walk of its bias."""
    found = errors(complementary.run(trolley.recording), trolley)
    assert 0.3 < float(found["cross_level_mm"].std()) < 1.5
    assert float(found["twist_mm"].abs().max()) <= 1.5


@pytest.mark.parametrize("wrong", [{"T_s": 0.0}, {"low_pass_hz": 200.0}, {"low_pass_hz": -1.0}, {"method": "magic"}])
def test_wrong_parameters_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(BadInputError, match=next(iter(wrong))):
        complementary.run(steady(0.0, 5.0), **wrong)  # type: ignore[arg-type]


def test_without_a_tachometer_there_is_no_place() -> None:
    lacking = replace(steady(0.0, 5.0), tach=None)
    with pytest.raises(BadInputError, match="tachometer"):
        complementary.run(lacking)


def test_parked_vehicle_has_an_empty_geometry() -> None:
    n = round(20.0 * RATE_HZ)
    result = complementary.run(recording(np.zeros(n), np.zeros(n), np.zeros(n)))
    assert result.geometry.empty
    assert len(result.trajectory) == 200
