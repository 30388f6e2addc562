"""Sigmas that hold are trusted, and those that do not hold are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from trackfg.datasets.catalogue import scenario
from trackfg.datasets.effects.catalogue import effect
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.datasets.sensors.positioning import BaliseModel
from trackfg.evaluation.geometry_errors import geometry_errors
from trackfg.evaluation.trajectory_errors import trajectory_errors
from trackfg.recording.model import Recording
from trackfg.results.result import Result
from trackfg.results.verdict import Quantity, Verdict
from trackfg.smoothing.smoother import smooth

COLUMNS: dict[str, Quantity] = {
    "along_track_m": "chainage",
    "speed_kmh": "speed",
    "roll_mrad": "roll",
    "pitch_mrad": "pitch",
}
FAR_SIGMAS, FAR_SHARE = 4.0, 0.05


def with_balises(name: str | None = None, magnitude: float | None = None, *, seed: int = 1) -> Simulation:
    """Simulate 200 s with a balise every 300 m, with an effect by name."""
    plan = replace(scenario("mainline"), balises=BaliseModel(spacing_m=300.0, sd_m=0.1))
    effects = () if name is None else (effect(name, magnitude),)
    return simulate(replace(plan, effects=effects), seed=seed, duration_s=150.0)


def verdict_of(result: Result, quantity: Quantity) -> Verdict:
    return next(verdict for verdict in result.summary.verdicts if verdict.quantity == quantity)


def failed_silently(result: Result, truth: pd.DataFrame) -> list[str]:
    """Return the trusted quantities of which more than a few rows are far off."""
    errors = trajectory_errors(result.trajectory, truth)
    return [
        quantity
        for column, quantity in COLUMNS.items()
        if verdict_of(result, quantity).status == "trusted"
        and (errors[column].abs() > FAR_SIGMAS * errors[f"{column}_sd"]).mean() > FAR_SHARE
    ]


def with_fixes_scattered(recording: Recording, sd_m: float) -> Recording:
    assert recording.fixes is not None
    noise = sd_m * np.random.default_rng(3).standard_normal(len(recording.fixes))
    return replace(recording, fixes=recording.fixes.assign(chainage_m=recording.fixes["chainage_m"] + noise))


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_clean_runs_are_trusted(seed: int) -> None:
    run = with_balises(seed=seed)
    result = smooth(run.recording)
    assert [verdict for verdict in result.summary.verdicts if verdict.status != "trusted"] == []
    assert failed_silently(result, run.truth) == []
    assert "predictions of the fixes" in " ".join(verdict_of(result, "chainage").checked_by)


def test_fixes_twenty_times_worse_than_declared() -> None:
    run = with_balises()
    result = smooth(with_fixes_scattered(run.recording, 2.0))
    assert failed_silently(result, run.truth) == []


def test_an_inertial_sensor_noisier_than_declared() -> None:
    run = with_balises("imu-noise", 3.0)
    result = smooth(run.recording)
    assert failed_silently(result, run.truth) == []


def test_an_engine_that_idles_under_a_rigid_sensor() -> None:
    run = with_balises("idling", 0.5)
    result = smooth(run.recording)
    assert verdict_of(result, "twist").status != "trusted"
    errors = geometry_errors(result.geometry, result.trajectory, run.truth, run.truth_geometry)
    assert (errors["twist_mm"].abs() > FAR_SIGMAS * errors["twist_mm_sd"]).mean() < FAR_SHARE


def test_a_sensor_that_is_not_of_the_declared_grade() -> None:
    run = with_balises("low-cost-imu", 1.0)
    assert failed_silently(smooth(run.recording), run.truth) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "magnitude"), [("rectification", 1e-3), ("saturation", 60.0), ("weak-creep", 0.01), ("lever-arm", 10.0)]
)
def test_rough_runs_do_not_fail_silently(name: str, magnitude: float) -> None:
    run = with_balises(name, magnitude)
    assert failed_silently(smooth(run.recording), run.truth) == []
