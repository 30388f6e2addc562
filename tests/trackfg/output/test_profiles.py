"""Profiles of the track: on rough track without noise they are the truth, whichever way the vehicle went."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.evaluation.geometry_errors import geometry_errors, quantities
from trackfg.output.profiles import lateral_of
from trackfg.results.columns import GEOMETRY_COLUMNS
from trackfg.smoothing.smoother import SmoothedStates, smooth_states

RUNS: dict[str, dict[str, Any]] = {
    "mainline": {"seed": 1, "duration_s": 120.0},
    "trolley": {"seed": 0, "duration_s": 150.0},
    "shunting": {"seed": 0, "duration_s": 120.0},  # out and part of the way back
    "shuttle": {"seed": 1, "run": 1, "duration_s": 100.0},  # in falling chainage
}

LIMITS = {
    "curvature_1pm": 3e-7,
    "gradient_permille": 0.05,  # a constant: of a mounting with a sigma of 0.5 mrad
    "twist_mm": 0.004,
    "level_mm": 0.005,
    "alignment_mm": 0.005,
    "versine_level_mm": 0.005,
    "versine_alignment_mm": 0.005,
}
"""Rms of what is left: a few micrometres, 3e-7 1/m."""

Perfect = Callable[[str], tuple[Simulation, SmoothedStates]]


@pytest.fixture(scope="module")
def perfect(simulated_in_full: Callable[..., Simulation], smoothed_in_full: Callable[..., SmoothedStates]) -> Perfect:
    """Rough track, perfect sensors."""

    def run(name: str) -> tuple[Simulation, SmoothedStates]:
        options = {**RUNS[name], "noise": False}
        return simulated_in_full(name, **options), smoothed_in_full(name, **options)

    return run


def errors(run: Simulation, smoothed: SmoothedStates) -> pd.DataFrame:
    return geometry_errors(smoothed.geometry, smoothed.trajectory, run.truth, run.truth_geometry)


def rms(values: pd.Series) -> float:
    return float(np.sqrt(np.nanmean(values.to_numpy() ** 2)))


@pytest.mark.parametrize("name", ["mainline", "shunting", "shuttle"])
def test_noise_free_run_gives_the_truth(perfect: Perfect, name: str) -> None:
    run, smoothed = perfect(name)
    error = errors(run, smoothed)
    # The truth itself has irregularities of millimetres.
    assert run.truth_geometry["level_mm"].std() > 0.5
    for quantity, limit in LIMITS.items():
        assert rms(error[quantity]) < limit, quantity
    # A constant part of the tilt is what the accelerometer's bias may be, at its prior.
    cross_level = error["cross_level_mm"]
    assert (cross_level - cross_level.mean()).std() < 0.01
    assert abs(cross_level.mean()) < 0.1


def test_geometry_is_that_of_the_point_that_follows_the_track() -> None:
    """A sensor over one rail and 0.5 m high, of which the recording does not say so, rises where the track rolls."""
    plan = scenario("mainline")
    plan = replace(plan, imu=replace(plan.imu, lever_arm_m=(0.2, 0.6, 0.5)))
    run = simulate(plan, seed=1, duration_s=120.0, noise=False)
    imu = run.recording.description.imu.model_copy(update={"lever_arm_m": (0.0, 0.0, 0.0)})
    description = run.recording.description.model_copy(update={"imu": imu})
    smoothed = smooth_states(replace(run.recording, description=description), SmoothConfig())
    error = errors(run, smoothed)
    for quantity in ("level_mm", "alignment_mm", "versine_level_mm", "versine_alignment_mm"):
        assert rms(error[quantity]) < 0.05, quantity  # at the sensor's own place 0.4 to 0.8 mm


def test_trolley_on_two_axles_gives_the_truth_but_for_what_its_wheelbase_averages(perfect: Perfect) -> None:
    """0.5 m between axles: waves of 3 m lose (0.5 pi / 3)^2 / 6 of their height, 5 %."""
    run, smoothed = perfect("trolley")
    error = errors(run, smoothed)
    assert run.truth_geometry["twist_mm"].std() > 1.0
    for quantity in ("twist_mm", "versine_level_mm", "versine_alignment_mm"):
        assert rms(error[quantity]) < 0.05, quantity
    assert rms(error["curvature_1pm"]) < 5e-6


@pytest.mark.parametrize("name", RUNS)
def test_nothing_is_missing_but_at_the_ends(perfect: Perfect, name: str) -> None:
    """An operator reaches at most 2 m (resampling) plus half of its base beyond a place, the band two wavelengths."""
    geometry = perfect(name)[1].geometry
    reach_m = {"cross_level_mm": 2.5, "twist_mm": 7.5, "curvature_1pm": 7.5, "gradient_permille": 15.0}
    reach_m |= dict.fromkeys(("versine_level_mm", "versine_alignment_mm"), 7.5)
    reach_m |= dict.fromkeys(("level_mm", "alignment_mm"), 53.0)
    x = geometry["chainage_m"].to_numpy()
    for quantity, reach in reach_m.items():
        known = geometry[quantity].notna().to_numpy()
        inside = (x >= x[0] + reach) & (x <= x[-1] - reach)
        assert known[inside].all(), quantity
        np.testing.assert_array_equal(geometry[f"{quantity}_sd"].notna(), known)
    assert geometry[["chainage_m", "chainage_m_sd", "speed_mps"]].notna().all().all()


@pytest.mark.parametrize("name", RUNS)
def test_rows_are_places_on_the_grid_that_were_passed(perfect: Perfect, name: str) -> None:
    run, smoothed = perfect(name)
    geometry = smoothed.geometry
    assert tuple(geometry.columns) == GEOMETRY_COLUMNS
    np.testing.assert_allclose(geometry["chainage_m"] / 0.25, np.rint(geometry["chainage_m"] / 0.25), atol=1e-9)
    np.testing.assert_allclose(np.diff(geometry["chainage_m"]), 0.25, atol=1e-9)
    chainage = run.truth["chainage_m"]
    offset = 0.0 if run.recording.fixes is not None else chainage.iloc[0]
    assert geometry["chainage_m"].iloc[0] == pytest.approx(chainage.min() - offset, abs=0.5)
    assert geometry["chainage_m"].iloc[-1] == pytest.approx(chainage.max() - offset, abs=0.5)
    assert geometry["speed_mps"].min() >= 0.0
    assert geometry["speed_mps"].max() == pytest.approx(run.truth["speed_mps"].abs().max(), rel=0.01)


def test_both_ways_over_the_track_say_the_same(
    simulated_in_full: Callable[..., Simulation], smoothed_in_full: Callable[..., SmoothedStates]
) -> None:
    """Left is left when facing increasing chainage: a yard run over twice, the shorter pass against the longer."""
    run, smoothed = (f("shunting", **RUNS["shunting"], noise=False) for f in (simulated_in_full, smoothed_in_full))
    backwards = run.truth["speed_mps"] < -0.1
    assert backwards.mean() > 0.05
    # The whole table is the truth's, those places included that were passed in both directions.
    error = errors(run, smoothed)
    for quantity in quantities(error):
        if quantity in LIMITS:
            assert np.nanmax(np.abs(error[quantity])) < 10 * LIMITS[quantity], quantity


def test_lateral_profile_is_the_heading_summed_up() -> None:
    """On a circle of any length u is a parabola, whose second derivative is the curvature; and left is left."""
    step, radius = 0.25, 300.0
    x = step * np.arange(1200)
    east, north = radius * np.sin(x / radius), radius * (1 - np.cos(x / radius))
    u, left = lateral_of(east, north, step)
    np.testing.assert_allclose(np.diff(u, 2) / step**2, 1.0 / radius, rtol=1e-6)
    np.testing.assert_allclose(
        left[5:-5], np.column_stack([-np.sin(x / radius), np.cos(x / radius), 0 * x])[5:-5], atol=1e-6
    )
    versine = u[600] - 0.5 * (u[580] + u[620])
    assert 1e3 * versine == pytest.approx(-12_500 / radius, rel=1e-4)


def test_lateral_profile_bears_holes() -> None:
    """What is not known stays unknown, what is known does not feel it."""
    x = 0.25 * np.arange(400)
    north = 1e-3 * np.sin(x)
    holed = north.copy()
    holed[:7] = holed[200:210] = np.nan
    east = np.where(np.isnan(holed), np.nan, x)
    u, left = lateral_of(east, holed, 0.25)
    np.testing.assert_array_equal(np.isnan(u), np.isnan(holed))
    whole = lateral_of(x, north, 0.25)[0]
    for part in (slice(7, 200), slice(210, 400)):
        np.testing.assert_allclose(np.diff(u[part], 2), np.diff(whole[part], 2), atol=1e-12)
    assert np.isfinite(left).all()
