from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackfg.datasets.scenarios import Simulation
from trackfg.evaluation.geometry_errors import geometry_errors
from trackfg.evaluation.scores import quantities, score_run
from trackfg.numerics.arrays import Array
from trackfg.numerics.splines import spline_at
from trackfg.smoothing.smoother import SmoothedStates

STEP_M = 0.25


def wave(x: Array, wavelength_m: float = 6.0) -> Array:
    return np.asarray(2.0 * np.sin(2.0 * np.pi * x / wavelength_m))


def truth_table(low: float = 0.0, high: float = 400.0) -> pd.DataFrame:
    x = np.arange(round(low / STEP_M), round(high / STEP_M) + 1) * STEP_M
    table = pd.DataFrame({"chainage_m": x, "twist_mm": wave(x), "cross_level_mm": wave(x, 9.0)})
    table.loc[:19, "twist_mm"] = np.nan  # its base reaches beyond the end
    return table


def run(chainage: Array, error: Array | float = 0.0) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Trajectory and truth at 10 Hz; the estimated chainage is the true one plus ``error``."""
    t = 0.1 * np.arange(len(chainage))
    return pd.DataFrame({"t_s": t, "chainage_m": chainage + error}), pd.DataFrame({"t_s": t, "chainage_m": chainage})


def estimate(chainage: Array, place: Array, bias_mm: float = 0.0) -> pd.DataFrame:
    """What an otherwise perfect estimator writes at ``chainage`` of what it measured at ``place``."""
    columns = {"chainage_m": chainage, "chainage_m_sd": 0.5, "speed_mps": 10.0}
    for name, length in (("twist_mm", 6.0), ("cross_level_mm", 9.0)):
        columns |= {name: wave(place, length) + bias_mm, f"{name}_sd": 0.2}
    return pd.DataFrame(columns)


def grid(low: float, high: float) -> Array:
    return np.arange(round(low / STEP_M), round(high / STEP_M) + 1) * STEP_M


def test_the_place_is_where_the_vehicle_was() -> None:
    true = np.linspace(0.0, 400.0, 2001)
    error = 0.3 + 2e-3 * true  # an offset and a wheel scale
    x = grid(10.0, 390.0)
    measured_at = (x - 0.3) / (1.0 + 2e-3)
    errors = geometry_errors(estimate(x, measured_at, 0.1), *run(true, error), truth_table())
    np.testing.assert_allclose(errors["twist_mm"], 0.1, atol=1e-5)
    np.testing.assert_allclose(errors["twist_mm_sd"], 0.2)
    assert (errors["chainage_m"] == x).all()
    at_the_same_number = x - measured_at
    assert np.abs(wave(x) - wave(x - at_the_same_number)).max() > 1.0  # what would have been an error of twist


def test_a_run_in_falling_chainage_that_rests_on_the_way() -> None:
    true = np.concatenate([np.linspace(400.0, 200.0, 500), np.full(100, 200.0), np.linspace(200.0, 0.0, 500)])
    error = -0.4 + 1e-3 * (400.0 - true)
    x = grid(5.0, 395.0)
    measured_at = (x + 0.4 - 0.4) / (1.0 - 1e-3)
    errors = geometry_errors(estimate(x, measured_at), *run(true, error), truth_table())
    np.testing.assert_allclose(errors["cross_level_mm"], 0.0, atol=1e-5)


def test_an_estimate_that_creeps_back_at_rest() -> None:
    true = np.concatenate([np.linspace(0.0, 200.0, 500), np.full(100, 200.0), np.linspace(200.0, 400.0, 500)])
    error = np.where(np.arange(1100) >= 550, 0.499, 0.5)
    x = grid(10.0, 390.0)
    errors = geometry_errors(estimate(x, x - np.where(x > 200.5, 0.499, 0.5)), *run(true, error), truth_table())
    assert errors["cross_level_mm"].abs().max() < 2e-3


def test_of_several_passes_the_longest_counts() -> None:
    out, back, on = np.linspace(0.0, 150.0, 400), np.linspace(150.0, 100.0, 200), np.linspace(100.0, 400.0, 900)
    rest = np.full(50, 150.0)
    true = np.concatenate([out, rest, back, np.full(50, 100.0), on])
    error = np.repeat([0.5, 0.5, 1.5, 1.5, -0.8], [400, 50, 200, 50, 900])
    x = grid(10.0, 390.0)
    place = np.where(x < 100.0 - 0.8, x - 0.5, x + 0.8)
    errors = geometry_errors(estimate(x, place), *run(true, error), truth_table())
    # Where the last pass has just begun its error is between that of the rest before it and its own.
    far = (x < 99.0) | (x > 103.0)
    np.testing.assert_allclose(errors["cross_level_mm"][far], 0.0, atol=1e-5)


def test_no_error_where_estimate_truth_or_run_are_missing() -> None:
    x = grid(-10.0, 410.0)
    table = estimate(x, x)
    table.loc[table["chainage_m"].between(50.0, 60.0), "cross_level_mm"] = np.nan
    errors = geometry_errors(table, *run(np.linspace(0.0, 380.0, 2000)), truth_table())
    known = errors["cross_level_mm"].notna().to_numpy()
    assert (known == ((x >= 0.0) & (x <= 380.0) & ~((x >= 50.0) & (x <= 60.0)))).all()
    assert (errors["twist_mm"].notna().to_numpy() == ((x >= 5.0) & (x <= 380.0))).all()


def test_only_what_both_tables_hold_is_scored() -> None:
    x = grid(10.0, 390.0)
    table = estimate(x, x).assign(gauge_mm=np.nan, gauge_mm_sd=np.nan)
    assert quantities(table) == ["twist_mm", "cross_level_mm", "gauge_mm"]
    trajectory, truth = run(np.linspace(0.0, 400.0, 2000))
    assert quantities(geometry_errors(table, trajectory, truth, truth_table())) == ["twist_mm", "cross_level_mm"]
    with_gauge = truth_table().assign(gauge_mm=1067.0)
    scores = score_run(geometry_errors(table, trajectory, truth, with_gauge)).set_index("quantity")
    assert scores.loc["gauge_mm", "places"] == 0
    assert np.isnan(scores.loc["gauge_mm", "rms"])


def test_a_run_that_never_moved_has_no_errors() -> None:
    x = grid(10.0, 20.0)
    errors = geometry_errors(estimate(x, x), *run(np.full(100, 15.0)), truth_table())
    assert errors["twist_mm"].isna().all()


def test_the_spline_keeps_the_shortest_waves() -> None:
    x = grid(0.0, 100.0)
    places = np.linspace(1.0, 99.0, 1000)
    assert np.abs(spline_at(x, wave(x, 3.0), places) - wave(places, 3.0)).max() < 2e-3
    linear = np.interp(places, x, wave(x, 3.0))
    assert np.abs(linear - wave(places, 3.0)).max() > 0.05


def test_the_spline_does_not_cross_gaps() -> None:
    x = grid(0.0, 100.0)
    y = np.where((x > 40.0) & (x < 60.0), np.nan, 1.0)
    inside = spline_at(x, y, np.array([-0.1, 0.0, 39.9, 40.0, 40.1, 59.9, 60.0, 100.0, 100.1, np.nan]))
    assert np.isfinite(inside).tolist() == [False, True, True, False, False, False, True, True, False, False]
    assert np.isnan(spline_at(x[:5], y[:5], np.array([0.5]))).all()


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("shunting", {"seed": 1, "duration_s": 240.0}),  # to and fro over one place
        ("shuttle", {"seed": 0, "run": 1, "duration_s": 200.0}),  # in falling chainage
    ],
)
def test_the_smoother_is_scored_at_every_row(
    name: str,
    options: dict[str, Any],
    simulated: Callable[..., Simulation],
    smoothed: Callable[..., SmoothedStates],
) -> None:
    run, estimate = simulated(name, **options), smoothed(name, **options)
    errors = geometry_errors(estimate.geometry, estimate.trajectory, run.truth, run.truth_geometry)
    rows = estimate.geometry.notna()
    assert (errors["twist_mm"].notna() == rows["twist_mm"]).mean() > 0.99
    scores = score_run(errors)
    scores = scores[scores["from_kmh"].isna()].set_index("quantity")
    for quantity in ("twist_mm", "versine_level_mm", "versine_alignment_mm"):
        assert 0.7 < scores.loc[quantity, "ratio"] < 1.4
        assert scores.loc[quantity, "rms"] < 0.25
