"""The geometry table: its columns and what they mean, when there is one, and whether its sigmas are honest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import GeometryConfig, SmoothConfig
from trackfg.datasets.scenarios import Simulation
from trackfg.evaluation.geometry_errors import geometry_errors
from trackfg.geometry.twist import twist
from trackfg.graph.run_context import geometry_conventions
from trackfg.results.columns import GEOMETRY_COLUMNS
from trackfg.smoothing.smoother import SmoothedStates, smooth, smooth_states

OPTIONS = {"seed": 3, "duration_s": 150.0}


@pytest.fixture(scope="module")
def run(simulated_in_full: Callable[..., Simulation]) -> Simulation:
    return simulated_in_full("mainline", **OPTIONS)


@pytest.fixture(scope="module")
def smoothed(smoothed_in_full: Callable[..., SmoothedStates]) -> SmoothedStates:
    return smoothed_in_full("mainline", **OPTIONS)


def test_conventions_are_the_settings_and_the_track(run: Simulation) -> None:
    track = run.recording.description.track
    meaning = geometry_conventions(GeometryConfig(twist_base_m=3.0), track)
    assert meaning.twist_base_m == 3.0
    assert meaning.chord_m == 10.0
    assert (meaning.gauge_m, meaning.cross_level_base_m) == (track.gauge_m, track.cross_level_base_m)
    assert meaning.facing == "increasing chainage"


def test_columns_are_the_contracts(smoothed: SmoothedStates) -> None:
    geometry = smoothed.geometry
    assert tuple(geometry.columns) == GEOMETRY_COLUMNS
    assert (geometry.dtypes == np.float64).all()
    assert (np.diff(geometry["chainage_m"]) > 0).all()
    sigmas = geometry[[name for name in geometry if name.endswith("_sd")]]
    assert (sigmas.dropna() > 0).all().all()


def test_columns_belong_together(smoothed: SmoothedStates) -> None:
    geometry = smoothed.geometry
    expected = twist(geometry["cross_level_mm"].to_numpy(), 0.25, 5.0)
    np.testing.assert_allclose(geometry["twist_mm"], expected, atol=1e-9)


def test_settings_change_the_columns(run: Simulation) -> None:
    """A twist over 2.5 m and a chord of 5 m: what the settings say, in the summary too."""
    config = SmoothConfig(geometry=GeometryConfig(twist_base_m=2.5, chord_m=5.0, band_m=(5.0, 15.0)))
    result = smooth(run.recording, config)
    geometry = result.geometry
    assert result.summary.geometry.twist_base_m == 2.5
    assert result.summary.geometry.band_m == (5.0, 15.0)
    np.testing.assert_allclose(geometry["twist_mm"], twist(geometry["cross_level_mm"].to_numpy(), 0.25, 2.5), atol=1e-9)
    known = geometry["versine_level_mm"].notna().to_numpy()
    assert np.flatnonzero(known)[0] == 10 + np.flatnonzero(geometry["cross_level_mm"].notna())[0]


def test_sigmas_repeat(run: Simulation) -> None:
    """They are sampled, from a generator of their own."""
    one, other = (smooth_states(run.recording, SmoothConfig()).geometry for _ in range(2))
    np.testing.assert_array_equal(one.to_numpy(), other.to_numpy())


@pytest.mark.parametrize(
    ("name", "without"),
    [("mainline", ("tach",)), ("parked", ()), ("measuring-car", ("lasers",)), ("slippery-line", ())],
    ids=["nothing measures speed", "never moves", "on springs, lasers gone", "on springs"],
)
def test_table_is_empty_where_the_track_is_not_seen(
    simulated_in_full: Callable[..., Simulation], name: str, without: tuple[str, ...]
) -> None:
    recording = simulated_in_full(name, seed=0, duration_s=60.0).recording
    if "tach" in without:
        recording = replace(recording, tach=None)
    if "lasers" in without:
        description = recording.description.model_copy(update={"laser": ()})
        recording = replace(recording, lasers={}, description=description)
    geometry = smooth_states(recording, SmoothConfig()).geometry
    assert geometry.empty
    assert tuple(geometry.columns) == GEOMETRY_COLUMNS
    assert (geometry.dtypes == np.float64).all()


def test_sigmas_are_finite_and_small_near_stops(
    simulated_in_full: Callable[..., Simulation], smoothed_in_full: Callable[..., SmoothedStates]
) -> None:
    """Standing still takes time, and inertial noise grows with time: the path is held by what follows the track."""
    smoothed = smoothed_in_full("mainline", seed=0, duration_s=420.0)
    geometry, problem = smoothed.geometry, smoothed.problem
    assert len(problem.rests) >= 2
    stops = [smoothed.solution.states.odo.distance[np.searchsorted(problem.t, end)] for _, end in problem.rests]
    x = geometry["chainage_m"].to_numpy()
    for quantity in ("twist_mm", "level_mm", "alignment_mm", "versine_level_mm", "versine_alignment_mm"):
        sd, known = geometry[f"{quantity}_sd"].to_numpy(), geometry[quantity].notna().to_numpy()
        assert np.isfinite(sd[known]).all()
        for stop in stops:
            near = known & (np.abs(x - stop) < 60.0)
            assert sd[near].max(initial=0.0) < 5.0, quantity


def test_slower_is_less_sure(smoothed_in_full: Callable[..., SmoothedStates]) -> None:
    """Along one run the sigma of the versines falls with speed: the inertial noise has less time."""
    known = smoothed_in_full("mainline", seed=0, duration_s=420.0).geometry.dropna()
    slow, fast = (known["speed_mps"] < 6.0, known["speed_mps"] > 18.0)
    assert slow.sum() > 40
    assert fast.sum() > 40
    assert known["versine_level_mm_sd"][slow].median() > 1.5 * known["versine_level_mm_sd"][fast].median()


@pytest.mark.slow
def test_sigmas_are_honest_over_seeds(simulated_in_full: Callable[..., Simulation]) -> None:
    """The rms of error over sigma, over eight lines and all speeds."""
    ratios: dict[str, list[np.ndarray]] = {}
    for seed in range(8):
        run = simulated_in_full("mainline", seed=seed, duration_s=110.0)
        smoothed = smooth_states(run.recording, SmoothConfig())
        error = geometry_errors(smoothed.geometry, smoothed.trajectory, run.truth, run.truth_geometry)
        for name in ("twist_mm", "versine_level_mm", "versine_alignment_mm", "level_mm", "alignment_mm"):
            ratios.setdefault(name, []).append((error[name] / error[f"{name}_sd"]).dropna().to_numpy())
    for name, parts in ratios.items():
        ratio = np.concatenate(parts)
        assert 0.85 < np.sqrt(np.mean(ratio**2)) < 1.15, name
        assert 0.93 < np.mean(np.abs(ratio) < 1.96) < 0.975, name
