"""What the real recordings say about their own clocks, scales and noise: the figures in docs/datasets.md.

Every figure is a comparison of a recording with its reference; nothing here is used by an estimator.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from pathlib import Path

import gtsam
import numpy as np
import pandas as pd
import scipy.io
from gtsam.symbol_shorthand import B, V, X
from numpy.typing import NDArray
from scipy.optimize import minimize, minimize_scalar

from trackfg.datasets import RealRun
from trackfg.datasets.real import comma2k19, kingston, kitti
from trackfg.numerics.units import KMH

Array = NDArray[np.float64]
GRAVITY = 9.805
GPS_EPOCH_UNIX, LEAP_SECONDS_2018, WEEK_S = 315_964_800, 18, 604_800


def main() -> None:
    """Print the figures of every recording that is there."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = Path(os.environ.get("TRACKFG_DATA", Path(__file__).parents[3] / "shared" / "data"))
    parser.add_argument("--data", type=Path, default=default, help="folder that holds kingston/ and comma2k19/")
    data: Path = parser.parse_args().data
    kitti_facts(kitti.load())
    if (data / "kingston").is_dir():
        kingston_facts(data / "kingston")
    if (data / "comma2k19").is_dir():
        comma_facts(data / "comma2k19")


def kitti_facts(run: RealRun) -> None:
    """When the positions and the IMU fit together best."""
    print("KITTI")
    shifts = np.array([-0.1, -0.05, 0.0])
    costs = np.array([_kitti_cost(run, shift) for shift in shifts])
    for shift, cost in zip(shifts, costs, strict=True):
        print(f"  IMU moved by {1e3 * shift:+5.0f} ms: half chi-square of a batch fit {cost:7.0f}")
    a, b, _ = np.polyfit(shifts, costs, 2)
    print(f"  best (parabola): {-500 * b / a:+.0f} ms")


def kingston_facts(folder: Path) -> None:
    """Stamps, standstill noise, GNSS agreement and the car's speed."""
    print("Kingston")
    run = kingston.load(folder)
    imu, reference = run.recording.imu, run.reference
    t, yaw = reference["t_s"].to_numpy(), reference["yaw_rad"].to_numpy()
    turned = _integral(imu, imu["wz_radps"], 0.1)
    inside = (t > 5) & (t < 3520)

    def spread(shift: float) -> float:
        return float(np.std(np.diff(turned(t[inside] + shift)) - np.diff(yaw[inside])))

    for name, shift in (("start", -0.1), ("centre", -0.05), ("end", 0.0)):
        print(f"  stamps mark the {name:6} of the sample: 1 s turns differ by {1e3 * spread(shift):.2f} mrad")
    best = minimize_scalar(spread, bounds=(-0.15, 0.1), method="bounded")
    print(f"  best: {1e3 * best.x:+.1f} ms from the end ({1e3 * best.fun:.2f} mrad)")

    still = imu[imu["t_s"] < 520]
    for columns in (["wx_radps", "wy_radps", "wz_radps"], ["fx_mps2", "fy_mps2", "fz_mps2"]):
        samples = still[columns].to_numpy()
        print(f"  {columns}: mean at rest {samples.mean(axis=0)}")
        for seconds in (0.1, 1.0, 10.0, 50.0):
            print(f"    density from averages of {seconds:4} s: {_density(samples, round(10 * seconds), 0.1)}")

    for table in ("BESTPOS", "BESTGPSPOS"):
        gnss = kingston.load(folder, gnss=table).recording.gnss
        assert gnss is not None
        error = _gnss_error(gnss, reference, 0.0)
        print(f"  {table} - INSPVA: mean {error.mean(axis=0)}, sd {error.std(axis=0)} m (east, north, up)")
    chip = scipy.io.loadmat(folder / "CarChip_Speed_interpolated.mat", squeeze_me=True)["CarChip_Speed_1HZ"] / KMH
    moving, steps = chip[chip > 0], np.abs(np.diff(chip))
    print(f"  car speed: {np.mean(np.abs(moving - np.rint(moving)) < 1e-3):.1%} of the moving samples are whole km/h")
    step = np.median(steps[np.abs(steps - 1.017) < 0.003])
    print(f"  a step of 1 km/h shows as {step:.4f} km/h per second: a sample every {1 / step:.5f} s")
    _car_speed(run)
    _receiver_speeds(kingston.load(folder, gnss="BESTGPSPOS", speeds=True))


def _car_speed(run: RealRun) -> None:
    """The car's speed against the reference's, both at 1 Hz, with a clock offset that drifts."""
    tach, reference, imu = run.recording.tach, run.reference, run.recording.imu
    assert tach is not None
    t = 0.5 * (tach["t_s"].to_numpy()[1:] + tach["t_s"].to_numpy()[:-1])
    wheel_speed = np.diff(tach["distance_m"]) / KMH
    inside = (t > 540) & (t < 3500)
    t, wheel_speed = t[inside], wheel_speed[inside]
    pitch = np.interp(imu["t_s"], reference["t_s"], reference["pitch_rad"])
    # The reference's speed between its seconds, carried by the accelerometer.
    gained = _integral(imu, imu["fx_mps2"] + GRAVITY * np.sin(pitch), 0.1)
    at = reference["t_s"].to_numpy()
    rest = reference["speed_mps"].to_numpy() - gained(at)
    ends = np.array([-0.5, -0.25, 0.0, 0.25, 0.5])

    def true(offset: Array) -> Array:
        times = (t + offset)[:, None] + ends
        return np.asarray((gained(times) + np.interp(times, at, rest)) @ np.array([1, 4, 2, 4, 1]) / 12 / KMH)

    def fit(p: Array) -> tuple[Array, Array, Array, Array]:
        speed = true(p[0] + p[1] * (t - 2000) / 1000)
        moving = speed > 5
        A = np.column_stack([speed[moving], np.ones(moving.sum())])
        x = np.linalg.lstsq(A, wheel_speed[moving], rcond=None)[0]
        return x, wheel_speed[moving] - A @ x, A, wheel_speed[moving]

    clock = minimize(lambda p: float(np.std(fit(p)[1])), [0.2, -0.2], method="Nelder-Mead").x
    x, residual, A, wheel_speed = fit(clock)
    sd = np.sqrt(np.diag(np.linalg.inv(A.T @ A))) * residual.std()
    speed = A[:, 0]
    print(f"  car speed: to be moved by {clock[0]:+.2f} s at 2000 s, {clock[1]:+.2f} s per 1000 s")
    print(f"  car speed = {x[0]:.4f} (sd {sd[0]:.4f}) x reference {x[1]:+.2f} (sd {sd[1]:.2f}) km/h")
    print(f"  forced through zero: reference / car = {speed @ speed / (speed @ wheel_speed):.4f}")
    for low, high in ((10, 20), (20, 30), (30, 40), (40, 50), (50, 55)):
        rows = (speed > low) & (speed < high)
        ratio = speed[rows].sum() / wheel_speed[rows].sum()
        difference = np.mean(wheel_speed[rows] - speed[rows])
        print(f"    {low}-{high} km/h: reference / car = {ratio:.4f}, car - reference = {difference:+.2f} km/h")


def comma_facts(folder: Path) -> None:
    """Clocks and scales against the pose."""
    print("comma2k19")
    run = comma2k19.load(folder, speeds=True)
    _receiver_speeds(run)
    recording, reference = run.recording, run.reference
    tach, gnss = recording.tach, recording.gnss
    assert tach is not None
    assert gnss is not None
    t = reference["t_s"].to_numpy()[20:-20]
    speed = reference["speed_mps"].to_numpy()[20:-20]
    wheel_t = tach["t_s"].to_numpy()

    def wheel(shift: float) -> Array:
        half = 0.05
        distance = tach["distance_m"].to_numpy()
        return np.asarray(
            np.interp(t + shift + half, wheel_t, distance) - np.interp(t + shift - half, wheel_t, distance)
        ) / (2 * half)

    def misfit(shift: float) -> float:
        w = wheel(shift)
        return float(np.std(w - np.polyval(np.polyfit(speed, w, 1), speed)))

    best = minimize_scalar(misfit, bounds=(-0.3, 0.3), method="bounded")
    scale, offset = np.polyfit(speed, wheel(best.x), 1)
    _comma_imu_clock(run, folder)
    print(f"  wheel stamps are {1e3 * best.x:+.0f} ms late on the pose's (rms {best.fun:.3f} m/s)")
    print(f"  wheel = {scale:.4f} x reference {offset:+.3f} m/s; distances {wheel(0.0).sum() / speed.sum():.4f}")
    moved = minimize_scalar(
        lambda shift: float(_gnss_error(gnss, reference, shift)[:, :2].std(axis=0).sum()),
        bounds=(-0.4, 0.4),
        method="bounded",
    ).x
    print(f"  GNSS stamps are {-1e3 * moved:+.0f} ms late on the pose's by position")
    fixes = np.load(folder / "processed_log/GNSS/live_gnss_ublox/value")
    fix_t = gnss["t_s"].to_numpy()[20:-20]
    by_speed = minimize_scalar(
        lambda shift: float(
            np.std(fixes[20:-20, 2] - np.interp(fix_t + shift, reference["t_s"], reference["speed_mps"]))
        ),
        bounds=(-0.4, 0.4),
        method="bounded",
    ).x
    gps_of_week = (fixes[:, 3] / 1e3 - GPS_EPOCH_UNIX + LEAP_SECONDS_2018) % WEEK_S
    pose_gps = np.load(folder / "global_pose/frame_gps_times")[:, 1] - reference["t_s"]
    by_utc = np.median(gnss["t_s"] - (gps_of_week - pose_gps.median()))
    print(f"    by speed {-1e3 * by_speed:+.0f} ms, by its own UTC {1e3 * by_utc:+.0f} ms")
    for shift in (0.0, moved):
        error = _gnss_error(gnss, reference, shift)
        rms = np.sqrt((error**2).mean(axis=0))
        print(f"    moved by {1e3 * shift:+.0f} ms: mean {error.mean(axis=0)}, sd {error.std(axis=0)}, rms {rms} m")
    samples = recording.imu.iloc[:, 1:].to_numpy()
    print(f"  densities from neighbouring samples: {_density(samples, 1, 0.00958252)}")
    heading = np.interp(recording.imu["t_s"], reference["t_s"], reference["yaw_rad"])
    drift = np.cumsum(recording.imu["wz_radps"]) * 0.00958252 - heading
    print(f"  gyro against pose: yaw drifts {drift.iloc[-100] - drift.iloc[100]:+.3f} rad in 58 s")


def _comma_imu_clock(run: RealRun, folder: Path) -> None:
    """Gains of speed over a window, from the accelerometer, against those of wheels and pose."""
    imu, reference = run.recording.imu, run.reference
    pitch = np.interp(imu["t_s"], reference["t_s"], reference["pitch_rad"])
    gained = _integral(imu, imu["fx_mps2"] + 9.8 * np.sin(pitch), 0.00958252)
    zero = float(np.load(folder / "processed_log/IMU/accelerometer/t")[0])
    wheel_t = np.load(folder / "processed_log/CAN/wheel_speed/t") - zero
    wheels = np.load(folder / "processed_log/CAN/wheel_speed/value")
    t = np.arange(2.0, 56.0, 0.05)
    speeds = {
        "rear wheels": (wheel_t, wheels[:, 2:].mean(axis=1)),
        "four wheels": (wheel_t, wheels.mean(axis=1)),
        "pose": (reference["t_s"].to_numpy(), reference["speed_mps"].to_numpy()),
    }
    for name, (times, speed) in speeds.items():
        late = []
        for window in (0.3, 0.6, 1.0, 2.0):
            force = gained(t + window) - gained(t)

            inputs = (window, force, t, times, speed)
            late.append(minimize_scalar(_clock_misfit, args=inputs, bounds=(-0.2, 0.2), method="bounded").x)
        print(
            f"  {name} late on the accelerometer, ms, by windows of 0.3, 0.6, 1, 2 s: {np.round(1e3 * np.array(late))}"
        )


def _clock_misfit(shift: float, window: float, force: Array, t: Array, times: Array, speed: Array) -> float:
    """Return how far gains of ``speed`` (n,) at ``times`` from ``t`` (m,) on, ``shift`` later, are from a line of
    ``force`` (m,), m/s."""
    change = np.interp(t + window + shift, times, speed) - np.interp(t + shift, times, speed)
    return float(np.std(change - np.polyval(np.polyfit(force, change, 1), force)))


def _integral(imu: pd.DataFrame, rate: Array | pd.Series, interval_s: float) -> Callable[[Array], Array]:
    edges = np.append(imu["t_s"] - interval_s / 2, imu["t_s"].iloc[-1] + interval_s / 2)
    total = np.concatenate([[0.0], np.cumsum(interval_s * np.asarray(rate))])
    return lambda t: np.interp(t, edges, total)


def _density(samples: Array, averaged: int, interval_s: float) -> Array:
    """Allan deviation times the root of the averaging time."""
    blocks = samples[: len(samples) // averaged * averaged].reshape(-1, averaged, samples.shape[1]).mean(axis=1)
    allan = np.sqrt(0.5 * np.mean(np.diff(blocks, axis=0) ** 2, axis=0))
    return np.asarray(allan * np.sqrt(averaged * interval_s))


def _receiver_speeds(run: RealRun) -> None:
    """Print how a receiver's speeds and positions differ from the reference, and when they fit it best."""
    assert run.recording.gnss is not None
    speeds, reference = run.recording.others["gnss_speed"], run.reference

    def errors(shift: float) -> tuple[Array, Array]:
        t = speeds["t_s"].to_numpy() + shift
        inside = (t > reference["t_s"].iloc[0]) & (t < reference["t_s"].iloc[-1])
        true = np.interp(t[inside], reference["t_s"], reference["speed_mps"])
        return true, speeds["speed_mps"].to_numpy()[inside] - true

    def usual(shift: float) -> float:
        true, error = errors(shift)
        return float(np.median(np.abs(error[true > 1.0])))

    shifts = np.arange(-0.5, 0.51, 0.02)
    print(f"  the receiver's speeds fit best {-1e3 * shifts[np.argmin([usual(s) for s in shifts])]:+.0f} ms late")
    true, error = errors(0.0)
    shares = np.percentile(np.abs(error[true > 1.0]), [50, 68, 95, 99])
    print(f"  their errors above 1 m/s: {shares} m/s or less in 50, 68, 95, 99 %")
    ranges = [(true >= low) & (true < high) for low, high in ((0.5, 2.0), (2.0, 4.0), (4.0, 8.0), (8.0, np.inf))]
    medians = [float(np.median(error[inside])) for inside in ranges if inside.sum() > 20]
    print(f"  medians by ranges of speed: {np.round(medians, 4)} m/s")
    residual = np.clip(error[true > 2.0], -1.0, 1.0)
    residual = residual - residual.mean()
    lasting = [float(np.mean(residual[:-k] * residual[k:]) / np.mean(residual**2)) for k in (1, 2, 3, 5, 10)]
    print(f"  autocorrelation after 1, 2, 3, 5, 10 rows: {np.round(lasting, 2)}")
    off = np.linalg.norm(_gnss_error(run.recording.gnss, reference, 0.0)[:, :2], axis=1)
    print(f"  positions: {np.percentile(off, [50, 95])} m or less in 50, 95 %")


def _gnss_error(gnss: pd.DataFrame, reference: pd.DataFrame, shift: float) -> Array:
    t = gnss["t_s"].to_numpy() + shift
    inside = (t > reference["t_s"].iloc[0]) & (t < reference["t_s"].iloc[-1])
    names = ["east_m", "north_m", "up_m"]
    true = np.column_stack([np.interp(t[inside], reference["t_s"], reference[name]) for name in names])
    return np.asarray(gnss[names].to_numpy()[inside] - true)


def _kitti_cost(run: RealRun, shift: float) -> float:
    """Half the chi-square of a batch fit of the IMU, moved by ``shift`` s, to all positions but the first."""
    imu, gnss = run.recording.imu, run.recording.gnss
    assert gnss is not None
    samples = np.column_stack([run.recording.accel, run.recording.gyro])[1:]
    starts = imu["t_s"].to_numpy()[1:] - 0.5 * kitti.SAMPLE_S + shift
    t = gnss["t_s"].to_numpy()
    positions = gnss[["east_m", "north_m", "up_m"]].to_numpy()
    params = gtsam.PreintegrationParams.MakeSharedU(9.8)
    params.setAccelerometerCovariance(np.eye(3) * 0.03**2)
    params.setGyroscopeCovariance(np.eye(3) * 5e-4**2)
    params.setIntegrationCovariance(np.eye(3) * 1e-10)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    bias = gtsam.imuBias.ConstantBias()
    position_noise = gtsam.noiseModel.Isotropic.Sigma(3, kitti.POSITION_SD_M[0])
    for k in range(1, len(t)):
        lower, upper = max(k - 1, 1), min(k + 1, len(t) - 1)
        velocity = (positions[upper] - positions[lower]) / (t[upper] - t[lower])
        values.insert(X(k), gtsam.Pose3(gtsam.Rot3.Yaw(np.arctan2(velocity[1], velocity[0])), positions[k]))
        values.insert(V(k), velocity)
        graph.add(gtsam.GPSFactor(X(k), positions[k], position_noise))
        if k > 1:
            inner = starts[(starts > t[k - 1]) & (starts < t[k])]
            edges = np.concatenate([[t[k - 1]], inner, [t[k]]])
            first = np.searchsorted(starts, t[k - 1], side="right") - 1
            between = gtsam.PreintegratedImuMeasurements(params, bias)
            for sample, dt in zip(samples[first:], np.diff(edges), strict=False):
                if dt > 1e-7:
                    between.integrateMeasurement(sample[:3], sample[3:], dt)
            graph.add(gtsam.ImuFactor(X(k - 1), V(k - 1), X(k), V(k), B(0), between))
    values.insert(B(0), bias)
    bias_noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.5] * 3 + [0.01] * 3))
    graph.add(gtsam.PriorFactorConstantBias(B(0), bias, bias_noise))
    settings = gtsam.LevenbergMarquardtParams()
    settings.setLinearSolverType("SEQUENTIAL_QR")
    settings.setMaxIterations(60)
    settings.setRelativeErrorTol(1e-9)
    optimizer = gtsam.LevenbergMarquardtOptimizer(graph, values, settings)
    optimizer.optimize()
    return float(optimizer.error())
