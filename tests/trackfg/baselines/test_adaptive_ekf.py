from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from trackfg.baselines import adaptive_ekf
from trackfg.baselines.adaptive_ekf import K_PRINTED, K, kalman_filter, process_noise, propagate, window_samples
from trackfg.baselines.result import BaselineResult
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.errors import BadInputError
from trackfg.evaluation.geometry_errors import geometry_errors
from trackfg.numerics.arrays import Array
from trackfg.numerics.rotations import matrix_from_rpy, rpy_from_matrix, so3_exp
from trackfg.numerics.units import STANDARD_GRAVITY as G
from trackfg.recording.description import Imu, RecordingDescription, Tach, Track
from trackfg.recording.model import Recording
from trackfg.sensors.tilt import force_tilt

RATE_HZ = 500.0
GRAVITY_GAL = 980.665


def twist_rmse(result: BaselineResult, simulation: Simulation) -> float:
    found = geometry_errors(
        result.geometry.assign(twist_mm_sd=1.0), result.trajectory, simulation.truth, simulation.truth_geometry
    )
    return float(np.sqrt(np.mean(found["twist_mm"].dropna() ** 2)))


def vehicle(rpy: Array, speed: float, base_m: float = 1.067, lateral: Array | float = 0.0) -> Recording:
    """A vehicle with attitudes (n + 1, 3) at the edges of its samples, at a steady speed, on a path of given yaw.

    ``lateral``: accelerations across, m/s^2, on top of those of the curve.
    """
    n = len(rpy) - 1
    R = matrix_from_rpy(*rpy.T)
    turned = np.einsum("nji,njk->nik", R[:-1], R[1:])
    gyro = RATE_HZ * 0.5 * np.stack([turned[:, i, j] - turned[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=1)
    force = np.einsum("nji,j->ni", R[:-1], [0.0, 0.0, G]) + np.cross(gyro, [speed, 0.0, 0.0])
    force[:, 1] += lateral
    t = (np.arange(n) + 0.5) / RATE_HZ
    names = ("wx_radps", "wy_radps", "wz_radps", "fx_mps2", "fy_mps2", "fz_mps2")
    imu = pd.DataFrame({"t_s": t, **dict(zip(names, [*gyro.T, *force.T], strict=True))})
    description = RecordingDescription(
        id="made",
        track=Track(gauge_m=1.067, cross_level_base_m=base_m),
        imu=Imu(file="imu.csv", gyro=("wx", "wy", "wz"), accel=("fx", "fy", "fz")),
        tach=Tach(file="tach.csv", column="d", kind="distance", unit="m"),
    )
    return Recording(description, imu, pd.DataFrame({"t_s": t, "distance_m": speed * t}))


def steady(roll: float, pitch: float, seconds: float = 40.0, yaw_rate: float = 0.0, **more: float) -> Recording:
    edges = np.arange(round(seconds * RATE_HZ) + 1) / RATE_HZ
    rpy = np.stack([np.full_like(edges, roll), np.full_like(edges, pitch), yaw_rate * edges], axis=1)
    return vehicle(rpy, more.get("speed", 1.0), more.get("base_m", 1.067))


@pytest.fixture(scope="module")
def axle_box() -> Simulation:
    return simulate("axle-box", seed=0, duration_s=100.0)


def test_coefficient_is_one_over_gravity_squared_in_gal() -> None:
    assert pytest.approx(1.04e-6, rel=1e-3) == 1.0 / GRAVITY_GAL**2
    assert pytest.approx(1.04e-6 / 1.0e-6, rel=1e-3) == K / K_PRINTED
    assert pytest.approx(0.0104, rel=1e-3) == K


def test_window_is_250_samples() -> None:
    assert window_samples(500.0, 1.0) == 250


def test_process_noise_settles_the_filter_at_its_time_constant() -> None:
    """After a step of the measurement the error falls as exp(-t/T_c)."""
    n, dt, T_c = 20_000, 0.002, 4.0
    y = np.zeros((2 * n, 2))
    y[n:] = 1e-3
    R0 = 1e-6
    x, variance = kalman_filter(
        np.zeros((2 * n, 3)), np.full(2 * n, dt), y, np.full((2 * n, 2), R0), process_noise(R0, dt, T_c)
    )
    remaining = 1.0 - x[n + round(T_c / dt) - 1, 0] / 1e-3
    assert remaining == pytest.approx(np.exp(-1.0), rel=0.01)
    assert variance[-1, 0] == pytest.approx(R0 * dt / T_c, rel=0.01)


@pytest.mark.parametrize(("roll", "pitch"), [(0.1, -0.03), (-0.2, 0.05), (0.0, 0.0)])
def test_jacobian_against_numerical(roll: float, pitch: float) -> None:
    w, dt, step = (0.3, -0.5, 0.7), 0.01, 1e-6
    *_, (f, g, h) = propagate(roll, pitch, w, dt)
    numerical = np.zeros((2, 2))
    for column, (d_roll, d_pitch) in enumerate(((step, 0.0), (0.0, step))):
        ahead = np.array(propagate(roll + d_roll, pitch + d_pitch, w, dt)[:2])
        behind = np.array(propagate(roll - d_roll, pitch - d_pitch, w, dt)[:2])
        numerical[:, column] = (ahead - behind) / (2.0 * step)
    np.testing.assert_allclose([[f, g], [h, 1.0]], numerical, atol=1e-9)


def test_prediction_is_that_of_rotation_matrices() -> None:
    rpy, w, dt = np.array([0.1, -0.05, 0.4]), np.array([0.02, -0.03, 0.05]), 1e-4
    turned = rpy_from_matrix(matrix_from_rpy(*rpy) @ so3_exp(w * dt))
    np.testing.assert_allclose(propagate(rpy[0], rpy[1], tuple(w), dt)[:2], turned[:2], atol=1e-10)


def test_filter_is_the_textbooks() -> None:
    rng = np.random.default_rng(0)
    n, q = 200, 1e-6
    gyro, dt = rng.normal(0.0, 0.5, (n, 3)), rng.uniform(0.01, 0.02, n)
    y, R = rng.normal(0.0, 0.2, (n, 2)), rng.uniform(1e-6, 1e-3, (n, 2))
    x, P, angles, variances = y[0].copy(), 1e-4 * np.eye(2), [], []
    for k in range(n):
        theta, phi, (f, g, h) = propagate(x[0], x[1], gyro[k].tolist(), dt[k])
        F = np.array([[f, g], [h, 1.0]])
        P = F @ P @ F.T + q * np.eye(2)
        gain = P @ np.linalg.inv(P + np.diag(R[k]))
        x = np.array([theta, phi]) + gain @ (y[k] - [theta, phi])
        P = (np.eye(2) - gain) @ P
        angles.append(x)
        variances.append(np.diag(P))
    found, variance = kalman_filter(gyro, dt, y, R, q)
    np.testing.assert_allclose(found, angles, rtol=1e-9)
    np.testing.assert_allclose(variance, variances, rtol=1e-7)


def test_tilt_at_rest() -> None:
    rest = matrix_from_rpy(np.array(0.1), np.array(-0.03), np.array(0.7)).T @ [0.0, 0.0, G]
    np.testing.assert_allclose(force_tilt(rest[None]), [[0.1, -0.03]], atol=1e-12)


@pytest.mark.parametrize(("cant_mm", "base_m", "over_mm"), [(105.0, 1.067, 0.51), (200.0, 1.5, 1.8)])
def test_printed_tangent_overstates_the_cant(cant_mm: float, base_m: float, over_mm: float) -> None:
    canted = steady(float(np.arcsin(1e-3 * cant_mm / base_m)), 0.0, 20.0, base_m=base_m)
    corrected = adaptive_ekf.run(canted).geometry["cross_level_mm"].dropna()
    printed = adaptive_ekf.run(canted, as_printed=True).geometry["cross_level_mm"].dropna()
    np.testing.assert_allclose(corrected, cant_mm, atol=1e-3)
    assert printed.mean() - cant_mm == pytest.approx(over_mm, abs=0.02)


def test_constant_roll_and_pitch() -> None:
    result = adaptive_ekf.run(steady(0.05, -0.01))
    np.testing.assert_allclose(result.trajectory["roll_rad"], 0.05, atol=1e-9)
    np.testing.assert_allclose(result.trajectory["pitch_rad"], -0.01, atol=1e-9)
    np.testing.assert_allclose(result.geometry["twist_mm"].dropna(), 0.0, atol=1e-4)


def test_circle_with_cant() -> None:
    """R = 100 m at 1 m/s: ``v^2/R`` looks like 1 mrad, 1.1 mm of cross-level, unless it is taken out."""
    circle = steady(0.05, 0.0, 60.0, yaw_rate=0.01)
    truth = 1067.0 * np.sin(0.05)
    corrected = adaptive_ekf.run(circle).geometry["cross_level_mm"].dropna()
    printed = adaptive_ekf.run(circle, centripetal=False).geometry["cross_level_mm"].dropna()
    np.testing.assert_allclose(corrected, truth, atol=0.01)
    assert printed.mean() - truth == pytest.approx(1067.0 * 0.01 / G, rel=0.02)


def test_twist_of_a_cant_ramp() -> None:
    edges = np.arange(round(60.0 * RATE_HZ) + 1) / RATE_HZ
    ramp = vehicle(np.stack([0.002 * edges, np.zeros_like(edges), np.zeros_like(edges)], axis=1), 1.0)
    twist = adaptive_ekf.run(ramp).geometry["twist_mm"].dropna()
    np.testing.assert_allclose(twist, 1067.0 * 0.002 * 5.0, rtol=0.01)


def test_vibration_index_is_the_mean_square_between_the_bands() -> None:
    """3 cycles per metre are inside 1-7, whatever the speed; 0.2 and 30 are outside."""
    motion = adaptive_ekf.motion_of(steady(0.0, 0.0, 20.0, speed=2.0), remove_static_bias=True)
    waves = {wave: np.sin(2.0 * np.pi * wave * motion.distance) for wave in (0.2, 3.0, 15.0)}
    along = adaptive_ekf.along_the_track(motion, 1.0)
    index = along.vibration(np.stack(list(waves.values()), axis=1))
    low = along.low_passed(np.stack(list(waves.values()), axis=1))
    inside = slice(2000, -2000)
    assert index[inside, 1].mean() == pytest.approx(0.5, rel=0.05)
    assert index[inside, [0]].max() < 0.005
    assert index[inside, 2].mean() < 0.05
    np.testing.assert_allclose(low[inside, 0], waves[0.2][inside], atol=0.02)
    assert np.abs(low[inside, 1]).max() < 0.05


def test_bands_scale_with_the_speed() -> None:
    """As printed: F = F_space times the mean speed while moving, 1 Hz and 250 samples at 1 m/s and 500 Hz."""
    for speed in (1.0, 2.0):
        motion = adaptive_ekf.motion_of(steady(0.0, 0.0, 20.0, speed=speed), remove_static_bias=True)
        printed = adaptive_ekf.in_time(motion, 1.0)
        assert printed.low * RATE_HZ == pytest.approx(speed, rel=0.02)
        assert printed.high == pytest.approx(7.0 * printed.low)
        assert printed.window == pytest.approx(250 / speed, abs=3)


def test_vibration_makes_the_filter_trust_the_gyro() -> None:
    """A burst across pushes the fixed filter more than the adaptive one."""
    edges = np.arange(round(60.0 * RATE_HZ) + 1) / RATE_HZ
    t = edges[:-1]
    burst = np.where((t > 30.0) & (t < 35.0), 0.3 + 1.0 * np.sin(2.0 * np.pi * 3.0 * t), 0.0)
    shaken = vehicle(np.zeros((len(edges), 3)), 1.0, lateral=burst)
    fixed = adaptive_ekf.run(shaken, adaptive=False).trajectory["roll_rad"].abs().max()
    adaptive = adaptive_ekf.run(shaken).trajectory["roll_rad"].abs().max()
    assert adaptive < 0.3 * fixed


@pytest.mark.parametrize("as_printed", [True, False])
def test_on_an_axle_box_adaptive_is_better_where_curves_feign_tilt(axle_box: Simulation, as_printed: bool) -> None:
    """The patent's claim, for a filter that leaves ``v^2/R`` in its measurement, as the patent's does."""
    how = {"as_printed": as_printed, "centripetal": False}
    adaptive, fixed = (
        twist_rmse(adaptive_ekf.run(axle_box.recording, adaptive=a, **how), axle_box) for a in (True, False)
    )
    assert adaptive < 0.97 * fixed
    assert adaptive < 1.0


def test_on_an_axle_box_without_the_curves_acceleration_little_is_left_to_adapt_to(axle_box: Simulation) -> None:
    adaptive, fixed = (twist_rmse(adaptive_ekf.run(axle_box.recording, adaptive=a), axle_box) for a in (True, False))
    printed = twist_rmse(adaptive_ekf.run(axle_box.recording, as_printed=True), axle_box)
    assert adaptive == pytest.approx(fixed, rel=0.1)
    assert max(adaptive, fixed) < 0.9 * printed


def test_wrong_parameters_are_refused() -> None:
    with pytest.raises(BadInputError, match="T_c_s"):
        adaptive_ekf.run(steady(0.0, 0.0, 5.0), T_c_s=0.0)
