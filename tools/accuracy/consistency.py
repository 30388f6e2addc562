"""Is every sigma honest, and is noise-free data recovered?

Noise-free: each scenario with perfect sensors, error of the smoother against truth (largest, along the run).
Coverage: many seeds of a scenario, the share of samples at which truth lies within 1.96 sigma, and the rms of
error / sigma. Samples of one run are correlated, so the share is given with its standard error over seeds. What a
sensor measures of gravity along z is bias to the smoother and not to the simulation: the biases of the gyro and of the
vertical accelerometer differ by that, and are not covered.

    python tools/consistency.py [--seeds 50] [--duration 600] [--jobs 2]
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np
import pandas as pd

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import simulate
from trackfg.output.trajectory import QUANTITIES
from trackfg.smoothing.smoother import smooth_states

NOISE_FREE = ("mainline", "mainline-gnss", "trolley", "shunting")
COVERED = ("mainline", "mainline-gnss", "trolley", "measuring-car")
STATES = (
    *QUANTITIES,
    "wheel_scale",
    *(f"gyro_bias_{axis}_radps" for axis in "xyz"),
    *(f"accel_bias_{axis}_mps2" for axis in "xyz"),
)


def errors(scenario: str, seed: int, duration_s: float, noise: bool) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """(error, sigma) of every state along one simulated run."""
    run = simulate(scenario, seed=seed, duration_s=duration_s, noise=noise)
    smoothed = smooth_states(run.recording, SmoothConfig())
    calibration = smoothed.calibration(smoothed.trajectory["t_s"].to_numpy())
    estimate = pd.concat([smoothed.trajectory, calibration.drop(columns="t_s")], axis=1)
    # Truth has a row at each whole multiple of its own finer clock.
    truth = run.truth
    row = np.searchsorted(truth["t_s"].to_numpy(), estimate["t_s"].to_numpy() - 1e-6)
    out = {}
    for name in STATES:
        error = estimate[name].to_numpy() - truth[name].to_numpy()[row]
        if name == "yaw_rad":
            error = (error + np.pi) % (2.0 * np.pi) - np.pi
        if name == "chainage_m" and run.recording.fixes is None:
            error = error - error[0]  # counted from where the run starts
        out[name] = (error, estimate[f"{name}_sd"].to_numpy())
    return out


def _statistics(seed: int, scenario: str, duration_s: float) -> dict[str, tuple[float, float]]:
    """Share of covered samples and mean square of error / sigma, per state."""
    z = {name: e / sd for name, (e, sd) in errors(scenario, seed, duration_s, noise=True).items()}
    return {name: (float(np.mean(np.abs(v) < 1.96)), float(np.mean(v * v))) for name, v in z.items()}


def noise_free(duration_s: float) -> pd.DataFrame:
    """Largest errors with perfect sensors: attitude (rad) and distance (mm per km run)."""
    rows = []
    for scenario in NOISE_FREE:
        by_quantity = errors(scenario, 0, duration_s, noise=False)
        chainage = np.abs(by_quantity["chainage_m"][0])
        run = simulate(scenario, seed=0, duration_s=duration_s, noise=False).truth["chainage_m"]
        length_km = np.abs(np.diff(run)).sum() / 1e3
        rows.append(
            {
                "scenario": scenario,
                **{
                    f"{name}": float(np.abs(by_quantity[name][0]).max())
                    for name in ("roll_rad", "pitch_rad", "yaw_rad")
                },
                "distance_mm_per_km": 1e3 * float(chainage.max()) / length_km if length_km > 0.0 else np.nan,
                "speed_mps": float(np.abs(by_quantity["speed_mps"][0]).max()),
            }
        )
    return pd.DataFrame(rows)


def coverage(scenario: str, seeds: int, duration_s: float, jobs: int) -> pd.DataFrame:
    """Per state: per cent of samples within 1.96 sigma, its standard error over seeds, rms of error / sigma."""
    with ProcessPoolExecutor(jobs) as pool:
        runs = list(pool.map(partial(_statistics, scenario=scenario, duration_s=duration_s), range(seeds)))
    rows = []
    for name in STATES:
        share = np.array([run[name][0] for run in runs])
        square = np.array([run[name][1] for run in runs])
        rows.append(
            {
                "state": name,
                "within_1.96_sd_percent": 100.0 * share.mean(),
                "standard_error": 100.0 * share.std(ddof=1) / np.sqrt(seeds),
                "rms_error_per_sd": np.sqrt(square.mean()),
            }
        )
    return pd.DataFrame(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--duration", type=float, default=600.0, help="seconds of each run")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    arguments = parser.parse_args()
    with pd.option_context("display.width", 140, "display.float_format", "{:.3g}".format):
        print("Noise-free: largest error along the run")
        print(noise_free(arguments.duration).to_string(index=False))
        for scenario in COVERED:
            print(f"\n{scenario}: {arguments.seeds} seeds of {arguments.duration:g} s")
            table = coverage(scenario, arguments.seeds, arguments.duration, arguments.jobs)
            print(table.to_string(index=False))
