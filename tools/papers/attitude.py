"""Papers 000, the complementary filter on a trolley, and 004, the adaptive Kalman filter on an axle box.

000: seeds are lines, on each of which there are three runs, as in the paper. An error is that of the cross-level per
0.25 m, where the trolley was, less its mean over the run; the truth is the cross-level of the trolley's frame, which
the IMU is on. The frame rounds off short waves and kinks of the track, which no estimate can put back.

004: errors of the twist. Two parts of them no estimate of the axle box's roll avoids, and are computed here:

* **noise**: roll is the integral of a gyro of density N (rad/sqrt(s)), and an accelerometer sees it with the density
  ``A = sqrt(a^2 + (v N)^2) / g`` (rad sqrt(s)): its own noise a, and that of ``v omega_z``, which has to be taken out.
  The best smoother of these two, all else known, has the error spectrum ``N^2 / (w^2 + w_c^2)``, ``w_c = N/A``, hence
  between two moments ``tau = 5 m / v`` apart the variance ``(N^2/w_c) (1 - exp(-w_c tau))``; by the gyro alone it is
  ``N^2 tau``. Nothing is assumed of the track: who knows its spectrum may do better.
* **knocks**: where a flange strikes, the axle box rolls and the track does not.

Scale factors, misalignments and biases are taken to be known; they add.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
import pandas as pd
from benchmark import Part
from scipy.signal import detrend

from papers.table import Comparison, mean_of, ratio_met, statistics
from trackfg.baselines import adaptive_ekf, complementary
from trackfg.baselines.result import BaselineResult
from trackfg.config import SmoothConfig
from trackfg.datasets.catalogue import scenario
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.datasets.sensors.imu_grades import ADIS16495_1
from trackfg.datasets.vehicle.flange import Flanging
from trackfg.datasets.vehicle.vehicle import Rigid
from trackfg.evaluation.geometry_errors import geometry_errors
from trackfg.evaluation.scores import rms
from trackfg.geometry.resampling import resample
from trackfg.geometry.twist import twist
from trackfg.numerics.arrays import Array
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.recording.description import ImuNoise
from trackfg.smoothing.smoother import SmoothedStates, smooth_states

TROLLEY_S = 1260.0
"""A minute at rest, then 1100 m in 20 minutes."""
RUNS = 3
DRIFT_S = 180.0
"""The paper shows the drift of the gyro over three minutes."""
WANTED_MM = 1.0
FINER = "ADIS16495-1"

STEP_M, TWIST_BASE_M = 0.25, 5.0
FAST_S = 0.5
FAST = f"sharp knocks, T_c {FAST_S:g} s"
"""A filter that follows the accelerometer fast enough to follow a knock."""
TRUTH_HZ = 100.0
SHARP_KNOCKS = Flanging(Rigid(), seed=0, spacing_m=2.0, length_m=0.1)
"""Flange contact as the patent describes it, a shock prominent at all frequencies: the scenario's knocks are a metre
long, so gentle at its speeds, and ten times as rare.
"""


def trolley(seed: int) -> dict[str, float]:
    """Everything of 000 on one seed, mm; what is not of three runs is of the first."""
    plan = scenario("trolley")
    finer = replace(plan, imu=ADIS16495_1.imu(plan.imu.rate_hz))
    runs = [simulate(plan, seed=seed, run=number, duration_s=TROLLEY_S) for number in range(RUNS)]
    out = _three_runs(runs)
    finer_runs = [simulate(finer, seed=seed, run=number, duration_s=TROLLEY_S) for number in range(RUNS)]
    out |= {f"{FINER} {name}": value for name, value in _three_runs(finer_runs).items()}

    run = runs[0]
    variants = {
        "as printed": complementary.run(run.recording, as_printed=True),
        "accelerometer, low-passed": complementary.run(run.recording, method="accelerometer"),
        "gyro, bias removed, less its line": complementary.run(run.recording, method="gyro"),
    }
    unfiltered = complementary.run(run.recording, method="accelerometer", low_pass_hz=None)
    out["accelerometer, unfiltered"] = _largest(_roll_errors_mm(run, unfiltered))
    for name, removed in (("gyro, bias removed", True), ("gyro, bias left in", False)):
        gyro = complementary.run(run.recording, method="gyro", detrended=False, remove_static_bias=removed)
        variants[name] = gyro
        drift = _roll_errors_mm(run, gyro)[_first_minutes(run, gyro)]
        out[f"drift, {name}"] = float(np.abs(drift - drift[0]).max())
        out[f"straightened, {name}"] = _largest(detrend(drift))
    perfect = simulate(plan, seed=seed, duration_s=TROLLEY_S, noise=False)
    without_noise = _errors(perfect, complementary.run(perfect.recording), "cross_level_mm", _mounted(perfect))
    truth = _mounted(run)
    errors = {name: _errors(run, estimate, "cross_level_mm", truth) for name, estimate in variants.items()}
    errors |= {"perfect sensor": without_noise, "frame against track": _frame_errors(run, "cross_level_mm")}
    return out | {name: _largest(error) for name, error in errors.items()}


def _three_runs(runs: Sequence[Simulation]) -> dict[str, float]:
    """``baseline`` and ``smoother``: the largest error of all runs; with `` sd`` the mean of their standard deviations;
    with `` kept`` the share of runs within the wanted; with `` apart`` the largest difference of two; with
    `` off track`` the largest error where the truth is the track.
    """
    estimates: dict[str, Sequence[BaselineResult | SmoothedStates]] = {
        "baseline": [complementary.run(run.recording) for run in runs],
        "smoother": [_smoothed(run) for run in runs],
    }
    truths = [_mounted(run) for run in runs]
    out = {}
    for name, of_runs in estimates.items():
        pairs = list(zip(runs, of_runs, truths, strict=True))
        errors = [_errors(run, estimate, "cross_level_mm", truth) for run, estimate, truth in pairs]
        off_track = [_errors(run, estimate, "cross_level_mm", run.truth_geometry) for run, estimate, _ in pairs]
        largest = [_largest(error) for error in errors]
        out[name] = max(largest)
        out[f"{name} kept"] = float(np.mean(np.array(largest) <= WANTED_MM))
        out[f"{name} sd"] = float(np.mean([error.std() for error in errors]))
        out[f"{name} apart"] = max(_largest((a - b).dropna()) for a, b in combinations(errors, 2))
        out[f"{name} off track"] = max(_largest(error) for error in off_track)
    return out


def trolley_figures(measured: pd.DataFrame) -> list[Comparison]:
    """The lines of 000."""
    column = measured.to_dict("list")
    lines = []
    for sensor, label in (("", ""), (f"{FINER} ", f"with {FINER}: ")):
        baseline, smoother = column[f"{sensor}baseline"], column[f"{sensor}smoother"]
        within = mean_of(baseline) <= WANTED_MM
        halved = ratio_met(smoother, baseline, 0.5)
        lines += [
            Comparison(f"{label}largest error of 3 runs, mm", "<= 1.0", "baseline <= 1.0", baseline, None, within),
            Comparison(f"{label}the same", "-", "smoother <= 0.5 of it", baseline, smoother, halved),
        ]
        lines += [
            Comparison(f"{label}{text}", paper, "-", column[f"{sensor}baseline {of}"], column[f"{sensor}smoother {of}"])
            for text, paper, of in (
                ("share of runs within 1.0 mm", "1", "kept"),
                ("standard deviation, mm", "-", "sd"),
                ("largest difference of 2 runs, mm", "agree well", "apart"),
                ("against the track: largest error, mm", "-", "off track"),
            )
        ]
    filtered = column["baseline"]
    for name, paper, times in (
        ("as printed", "<= 1.0", None),
        ("perfect sensor", "-", None),
        ("frame against track", "-", None),
        ("accelerometer, unfiltered", "unusable", 3.0),
        ("accelerometer, low-passed", "stable", None),
        ("gyro, bias removed", "drifts", 3.0),
        ("gyro, bias removed, less its line", "-", None),
        ("gyro, bias left in", "drifts", 3.0),
    ):
        target = "-" if times is None else f"> {times:g} x the filter's"
        met = None if times is None else mean_of(column[name]) > times * mean_of(filtered)
        lines.append(Comparison(f"{name}: largest error, mm", paper, target, column[name], None, met))
    for name in ("gyro, bias removed", "gyro, bias left in"):
        lines += [
            Comparison(f"{name}: drift in 3 min, mm", "considerable", "-", column[f"drift, {name}"]),
            Comparison(f"{name}: drift less its line, mm", "runs agree", "-", column[f"straightened, {name}"]),
        ]
    return lines


def axle_box(seed: int) -> dict[str, float]:
    """Everything of 004 on one seed: rms of the twist's error, mm."""
    run = simulate("axle-box", seed=seed, truth_rate_hz=TRUTH_HZ)
    smoothed = _smoothed(run)
    error = _errors(run, smoothed, "twist_mm", run.truth_geometry)
    geometry = smoothed.geometry.set_index("chainage_m").loc[error.index]
    speed = np.abs(geometry["speed_mps"].to_numpy())
    noise, base_m = run.recording.description.imu.noise, run.recording.description.track.cross_level_base_m
    out = {
        "as printed smoother": rms(error),
        "corrected smoother": rms(error),
        "ratio": rms(error / geometry["twist_mm_sd"]),
        "gyro noise": 1e3 * base_m * rms(noise.gyro_white * np.sqrt(TWIST_BASE_M / speed)),
        "noise": 1e3 * base_m * rms(least_twist_sd_rad(noise, speed)),
        "knocks": rms(_frame_errors(run, "twist_mm")),
    }
    out["bound"] = float(np.hypot(out["noise"], out["knocks"]))
    out |= _both_kinds("as printed", run, as_printed=True) | _both_kinds("corrected", run)

    plan = scenario("axle-box")
    struck = replace(plan, vehicle=replace(SHARP_KNOCKS, vehicle=plan.vehicle, seed=seed), flange_knocks=False)
    sharp = simulate(struck, seed=seed)
    out["sharp knocks smoother"] = rms(_errors(sharp, _smoothed(sharp), "twist_mm", sharp.truth_geometry))
    out["sharp knocks peak"] = float(np.abs(sharp.recording.accel[:, 1]).max())
    out["peak"] = float(np.abs(run.recording.accel[:, 1]).max())
    out[f"{FAST} smoother"] = out["sharp knocks smoother"]
    return out | _both_kinds("sharp knocks", sharp) | _both_kinds(FAST, sharp, time_s=FAST_S)


def _both_kinds(name: str, run: Simulation, *, as_printed: bool = False, time_s: float = 12.5) -> dict[str, float]:
    """``NAME adaptive`` and ``NAME fixed``."""
    both = {"adaptive": True, "fixed": False}
    estimates = {
        kind: adaptive_ekf.run(run.recording, adaptive=adaptive, as_printed=as_printed, T_c_s=time_s)
        for kind, adaptive in both.items()
    }
    return {
        f"{name} {kind}": rms(_errors(run, estimate, "twist_mm", run.truth_geometry))
        for kind, estimate in estimates.items()
    }


def least_twist_sd_rad(noise: ImuNoise, speed: Array) -> Array:
    """Standard deviation of the difference of two rolls 5 m apart that white noise leaves at ``speed``, m/s; rad."""
    gyro = noise.gyro_white
    tilt = np.hypot(noise.accel_white, speed * gyro) / STANDARD_GRAVITY
    corner = gyro / tilt
    return np.asarray(gyro * np.sqrt(-np.expm1(-corner * TWIST_BASE_M / speed) / corner))


def axle_box_figures(measured: pd.DataFrame) -> list[Comparison]:
    """The lines of 004."""
    column = measured.to_dict("list")
    lines = []
    for name in ("as printed", "corrected", "sharp knocks", FAST):
        adaptive, fixed, smoother = (column[f"{name} {kind}"] for kind in ("adaptive", "fixed", "smoother"))
        gain = np.subtract(fixed, adaptive)
        of_gain = statistics(gain)
        better = of_gain["mean"] > (0.0 if len(gain) == 1 else of_gain["margin"])
        halved = ratio_met(smoother, adaptive, 0.5)
        lines += [
            Comparison(
                f"{name}: twist rms, mm, adaptive R", "near truth", "smoother <= 0.5 of it", adaptive, smoother, halved
            ),
            Comparison(f"{name}: twist rms, mm, fixed R", "deviates", "-", fixed),
            Comparison(
                f"{name}: fixed less adaptive, mm", "> 0", "interval above 0", gain.tolist(), None, bool(better)
            ),
            Comparison(f"{name}: share of runs where adaptive is better", "-", "-", (gain > 0).astype(float).tolist()),
        ]
    bound = column["bound"]
    return [
        *lines,
        Comparison("largest lateral acceleration, m/s^2", "-", "-", column["peak"]),
        Comparison("the same with sharp knocks, m/s^2", "-", "-", column["sharp knocks peak"]),
        Comparison("least twist rms by both noises, mm", "-", "-", None, column["noise"]),
        Comparison("the same by the gyro's alone, mm", "-", "-", None, column["gyro noise"]),
        Comparison("the axle box's own roll in knocks, mm", "-", "-", None, column["knocks"]),
        Comparison("bound: noises and knocks, mm", "-", "-", None, bound),
        Comparison(
            "twist rms / bound",
            "-",
            "-",
            np.divide(column["corrected adaptive"], bound).tolist(),
            np.divide(column["corrected smoother"], bound).tolist(),
        ),
        Comparison("rms of error / its sigma", "-", "-", None, column["ratio"]),
    ]


def _smoothed(run: Simulation) -> SmoothedStates:
    return smooth_states(run.recording, SmoothConfig())


def _errors(
    run: Simulation, estimate: BaselineResult | SmoothedStates, quantity: str, truth_geometry: pd.DataFrame
) -> pd.Series[float]:
    """The errors of a column of the geometry by chainage, where there are any."""
    errors = geometry_errors(estimate.geometry, estimate.trajectory, run.truth, truth_geometry)
    return errors.set_index("chainage_m")[quantity].dropna()


def _mounted(run: Simulation) -> pd.DataFrame:
    """``chainage_m, cross_level_mm, twist_mm`` of what the IMU is on: the roll of the true trajectory."""
    base_m = run.recording.description.track.cross_level_base_m
    moving = run.truth["speed_mps"] > 0.0
    place, roll = run.truth["chainage_m"][moving].to_numpy(), run.truth["roll_rad"][moving].to_numpy()
    grid, level = resample(place, base_m * np.sin(roll), STEP_M)
    over_base = twist(level, STEP_M, TWIST_BASE_M)
    return pd.DataFrame({"chainage_m": grid, "cross_level_mm": 1e3 * level, "twist_mm": 1e3 * over_base})


def _frame_errors(run: Simulation, quantity: str) -> pd.Series[float]:
    """How what the IMU is on differs from the track."""
    mounted = _mounted(run).assign(speed_mps=np.nan, **{f"{quantity}_sd": np.nan})
    errors = geometry_errors(mounted, run.truth, run.truth, run.truth_geometry)
    return errors[quantity].dropna()


def _largest(error: Array | pd.Series[float]) -> float:
    """The largest distance from the mean."""
    return float(np.abs(error - error.mean()).max())


def _roll_errors_mm(run: Simulation, estimate: BaselineResult) -> Array:
    """The roll's errors, as cross-level, at the trajectory's times."""
    t = estimate.trajectory["t_s"]
    true = np.interp(t, run.truth["t_s"], run.truth["roll_rad"])
    base_m = run.recording.description.track.cross_level_base_m
    return np.asarray(1e3 * base_m * (estimate.trajectory["roll_rad"] - true))


def _first_minutes(run: Simulation, estimate: BaselineResult) -> np.ndarray:
    """Which rows of the trajectory are in the first three minutes of motion."""
    start = float(run.truth["t_s"][run.truth["speed_mps"] > 0.0].iloc[0])
    return estimate.trajectory["t_s"].between(start, start + DRIFT_S).to_numpy()


PAPERS = (
    Part(
        name="000",
        title="Complementary filter, T = 12.5 s: cross-level of scenario trolley, 1100 m in 20 min after a rest",
        measure=trolley,
        figures=trolley_figures,
        notes=(
            "Errors against the trolley's frame, about their mean over the run (the accelerometer's bias). The paper"
            " does not say which IMU it used; the scenario's is like an ADIS16480."
            f" With {FINER}: the same runs with that sensor. Verdicts are on means over seeds."
        ),
    ),
    Part(
        name="004",
        title="Adaptive Kalman filter: twist on 5 m of scenario axle-box, R 100 m, twists to 40 mm",
        measure=axle_box,
        figures=axle_box_figures,
        notes=(
            "K = 1/g^2, R0 = (1 mrad)^2, q = R0 (dt/T_c)^2, T_c = 12.5 s or as named. Sharp knocks: corrected, and with"
            " flanges that strike once in 2 m, each time over 0.1 m. The bound takes biases, scale factors and the"
            " place for known, and assumes nothing of the track; see the module's docstring."
        ),
    ),
)
