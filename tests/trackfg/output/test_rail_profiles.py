"""Each rail by itself and the gauge, from two units of lasers on a car body on springs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.line.line import GivenLine, Line, piecewise_linear
from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.evaluation.geometry_errors import geometry_errors
from trackfg.results.columns import GEOMETRY_COLUMNS, RAIL_COLUMNS
from trackfg.smoothing.smoother import SmoothedStates, smooth, smooth_states

OPTIONS = {"seed": 1, "duration_s": 80.0, "noise": False}

LIMITS = {
    "curvature_1pm": 1e-5,  # what a slope over 2 m misses of waves of 3 m
    "twist_mm": 0.04,
    "level_mm": 0.005,
    "alignment_mm": 0.008,
    "versine_level_mm": 0.008,
    "versine_alignment_mm": 0.012,
    "level_left_mm": 0.03,
    "level_right_mm": 0.03,
    "alignment_left_mm": 0.008,
    "alignment_right_mm": 0.008,
    "gauge_mm": 0.005,
}


@pytest.fixture(scope="module")
def run(simulated_in_full: Callable[..., Simulation]) -> Simulation:
    return simulated_in_full("measuring-car", **OPTIONS)


@pytest.fixture(scope="module")
def smoothed(smoothed_in_full: Callable[..., SmoothedStates], run: Simulation) -> SmoothedStates:
    return smoothed_in_full("measuring-car", **OPTIONS)


@pytest.fixture(scope="module")
def error(run: Simulation, smoothed: SmoothedStates) -> pd.DataFrame:
    return geometry_errors(smoothed.geometry, smoothed.trajectory, run.truth, run.truth_geometry)


@pytest.mark.parametrize("quantity", LIMITS)
def test_noise_free_run_gives_both_rails(error: pd.DataFrame, quantity: str) -> None:
    assert np.sqrt(np.nanmean(error[quantity] ** 2)) < LIMITS[quantity]


def test_body_on_springs_is_not_what_is_measured(run: Simulation, smoothed: SmoothedStates) -> None:
    """The car body's own roll differs from the track's by far more than the cross-level's error."""
    sway = smoothed.trajectory["roll_rad"].to_numpy()
    x = smoothed.trajectory["chainage_m"].to_numpy()
    moving = np.diff(x, append=x[-1]) > 1e-3
    base = run.recording.description.track.cross_level_base_m
    geometry = smoothed.geometry.dropna(subset=["cross_level_mm"])
    own = 1e3 * base * np.sin(np.interp(geometry["chainage_m"], x[moving], sway[moving]))
    assert np.abs(own - geometry["cross_level_mm"]).max() > 3.0


def test_columns_hold_the_rails(smoothed: SmoothedStates) -> None:
    geometry = smoothed.geometry
    assert tuple(geometry.columns) == GEOMETRY_COLUMNS + RAIL_COLUMNS
    known = geometry[list(LIMITS)].notna()
    assert known["gauge_mm"].mean() > 0.98
    for quantity in LIMITS:
        np.testing.assert_array_equal(geometry[f"{quantity}_sd"].notna(), known[quantity])


def test_sides_face_increasing_chainage(run: Simulation, error: pd.DataFrame, smoothed: SmoothedStates) -> None:
    """The same run declared to go down the line: the rails change sides, left and right of everything change sign."""
    recording = run.recording
    track = recording.description.track.model_copy(update={"direction": -1})
    assert recording.fixes is None
    description = recording.description.model_copy(update={"track": track})
    down = smooth_states(replace(recording, description=description), SmoothConfig()).geometry
    turned = down.assign(chainage_m=-down["chainage_m"]).set_index("chainage_m")
    up = smoothed.geometry.set_index("chainage_m")
    # An end that falls on a row of the grid may be in or out by rounding.
    both = up.index.intersection(turned.index)
    assert len(both) >= len(up) - 2
    turned, up = turned.loc[both], up.loc[both]
    same = {"level_mm": "level_mm", "gauge_mm": "gauge_mm", "level_left_mm": "level_right_mm"}
    for ours, theirs in same.items():
        np.testing.assert_allclose(turned[ours], up[theirs], atol=5e-3)
    for ours, theirs in {
        "cross_level_mm": "cross_level_mm",
        "alignment_mm": "alignment_mm",
        "alignment_left_mm": "alignment_right_mm",
        "versine_alignment_mm": "versine_alignment_mm",
    }.items():
        np.testing.assert_allclose(turned[ours], -up[theirs], atol=5e-3)
    np.testing.assert_allclose(turned["gradient_permille"], -up["gradient_permille"], atol=1e-3)
    # Turning the way round changes the sign of the heading and of the way it is passed: curvature keeps its size.
    np.testing.assert_allclose(turned["curvature_1pm"], -up["curvature_1pm"], atol=1e-6)


def test_standard_gauge_refers_cross_level_to_the_middles_of_the_rails() -> None:
    """Tops 1.5 m and running edges 1.435 m apart: what the track rolls against the body is not 4.5 % too large."""
    places = np.array([0.0, 300.0, 360.0, 5000.0])
    curvature, cant = (piecewise_linear(places, np.array([0.0, 0.0, most, most])) for most in (1.0 / 500.0, -0.1))
    flat = piecewise_linear(np.array([0.0, 5000.0]), np.zeros(2))
    line = Line(curvature, cant, flat, 5000.0, 1.5, np.zeros(1), np.array([30.0]), np.zeros(0))
    plan = scenario("measuring-car").on(GivenLine("standard gauge", line, 1.435))
    run = simulate(plan, **OPTIONS)
    result = smooth(run.recording)
    errors = geometry_errors(result.geometry, result.trajectory, run.truth, run.truth_geometry)
    for quantity, limit in (LIMITS | {"gauge_mm": 0.02}).items():
        assert np.sqrt(np.nanmean(errors[quantity] ** 2)) < limit, quantity
    assert np.nanstd(errors["cross_level_mm"]) < 0.2


def test_a_run_too_short_for_alignment_has_no_curvature_from_lasers() -> None:
    """What the curvature misses of short waves is judged by the alignment, which needs some 100 m."""
    recording = simulate(scenario("measuring-car"), seed=1, run=46, duration_s=60.0).recording
    result = smooth(recording)
    result.refuse_unsound()
    assert np.ptp(result.geometry["chainage_m"]) < 100.0
    assert result.geometry["versine_alignment_mm"].notna().any()
    assert result.geometry[["alignment_mm", "curvature_1pm"]].isna().all(axis=None)
