"""Maps of simulated runs against the line they ran on."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackfg.errors import BadInputError
from trackfg.mapping import build_map, with_runs
from trackfg.maps.feature_map import FeatureMap
from trackfg.numerics.arrays import Array
from trackfg.numerics.splines import spline_at, spline_through
from trackfg.recording.line_kilometrage import LineKilometrage
from trackfg.results.official_places import kilometrage_of_map
from trackfg.results.result import Result
from trackfg.smoothing.smoother import smooth

Ride = Callable[..., Any]
"""``ride(run, seed=3, gnss=False)``: simulation and result."""


def test_landmarks_are_where_the_line_has_them(line_map: FeatureMap, ride: Ride) -> None:
    curvature = ride(0).simulation.track.line.curvature
    kinks = curvature.x[np.abs(np.diff(curvature.c[-2], prepend=0.0, append=0.0)) > 1e-9]
    landmarks = line_map.landmarks
    assert (landmarks["observations"] == 4).all()
    place, sd = landmarks["chainage_m"].to_numpy(), landmarks["chainage_m_sd"].to_numpy()
    apart = np.abs(place[:, None] - kinks[None, :]).min(axis=1)
    assert (apart < 4.0 * sd + 0.05).all()
    assert np.median(sd) < 0.5
    first = landmarks[landmarks["curve_id"] == landmarks["curve_id"].iloc[0]]
    assert list(first["kind"]) == ["BTC", "BCC", "ECC", "ETC"]


@pytest.fixture(scope="module")
def true_places(line_map: FeatureMap, ride: Ride) -> Array:
    """Return where the map's places truly are, m.

    The map's own chainage errs, smoothly: the shift at which the sharpest profile agrees best takes that out.
    """
    truth, grid = ride(0).simulation.truth_geometry, line_map.grid
    x, level = (grid[name].to_numpy() for name in ("chainage_m", "versine_level_mm"))
    true_level = spline_through(truth["chainage_m"].to_numpy(), truth["versine_level_mm"].to_numpy())
    places = np.linspace(200.0, 1800.0, 7)
    shifts = np.arange(-0.6, 0.601, 0.01)
    best = []
    for place in places:
        near = np.abs(x - place) < 60.0
        apart = np.nanmean((level[near] - true_level(x[near] + shifts[:, None])) ** 2, axis=1)
        best.append(shifts[int(np.argmin(apart))])
    assert np.abs(best).max() < 4.0 * grid["chainage_m_sd"].max()
    return np.asarray(x + np.interp(x, places, best))


@pytest.mark.parametrize("quantity", ["curvature_1pm", "cross_level_mm", "versine_level_mm", "versine_alignment_mm"])
def test_the_grid_is_the_track_within_its_sigmas(
    line_map: FeatureMap, ride: Ride, true_places: Array, quantity: str
) -> None:
    truth, grid = ride(0).simulation.truth_geometry, line_map.grid
    true = spline_at(truth["chainage_m"].to_numpy(), truth[quantity].to_numpy(), true_places)
    error = (grid[quantity] - true) / grid[f"{quantity}_sd"]
    known = error[np.isfinite(error)]
    assert len(known) > 0.9 * len(true_places)
    assert np.sqrt(np.mean(known**2)) < (3.0 if quantity == "cross_level_mm" else 1.8)


def test_sensors_rolls_are_distinguished_from_the_track(line_map: FeatureMap, ride: Ride) -> None:
    runs = line_map.runs.set_index("run_id")
    assert list(runs["direction"]) == [1, -1, 1, -1]
    for number, (_, row) in enumerate(runs.iterrows()):
        run = ride(number)
        geometry, truth = run.result.geometry, run.simulation.truth_geometry
        true = spline_at(
            truth["chainage_m"].to_numpy(),
            truth["cross_level_mm"].to_numpy(),
            run.true_place(geometry["chainage_m"].to_numpy()),
        )
        effective = row["direction"] * np.nanmean(geometry["cross_level_mm"] - true)
        assert abs(row["cross_level_bias_mm"] - effective) < 3.0 * row["cross_level_bias_mm_sd"]
        assert row["cross_level_bias_mm_sd"] < 0.4


def test_runs_added_later_make_the_same_map(line_map: FeatureMap, ride: Ride) -> None:
    first = build_map([ride(0).result, ride(1).result], name="short line")
    later = with_runs(first, [ride(2).result, ride(3).result])
    both = later.landmarks.merge(line_map.landmarks, on="landmark_id", suffixes=("", "_at_once"))
    assert len(both) == len(line_map.landmarks)
    apart = (both["chainage_m"] - both["chainage_m_at_once"]) / both["chainage_m_sd"]
    assert np.abs(apart).max() < 0.2
    np.testing.assert_allclose(both["chainage_m_sd"], both["chainage_m_sd_at_once"], rtol=0.05)
    grids = later.grid.merge(line_map.grid, on="chainage_m", suffixes=("", "_at_once"))
    assert len(grids) > 0.99 * len(line_map.grid)
    difference = (grids["cross_level_mm"] - grids["cross_level_mm_at_once"]).abs()
    assert difference.quantile(0.99) < 0.02
    assert list(later.runs["run_id"]) == list(line_map.runs["run_id"])


def test_more_runs_know_more(line_map: FeatureMap, ride: Ride) -> None:
    alone = build_map([ride(0).result], name="short line")
    assert line_map.grid["chainage_m_sd"].median() < 0.7 * alone.grid["chainage_m_sd"].median()
    assert line_map.grid["versine_level_mm_sd"].median() < 0.6 * alone.grid["versine_level_mm_sd"].median()
    assert (alone.grid["observations"] == 1).all()


def test_a_run_without_any_fix_joins(ride: Ride) -> None:
    run = ride(2)
    lost = smooth(replace(run.simulation.recording, fixes=None))
    assert lost.summary.run is not None
    assert not lost.summary.run.anchored
    joined = build_map([lost, ride(0).result], name="short line")
    row = joined.runs.set_index("recording_id").loc[lost.summary.recording_id]
    start = run.true_chainage(np.array([0.0]))[0]
    assert abs(row["offset_m"] - start) < 4.0 * row["offset_m_sd"]
    assert row["offset_m_sd"] < 0.3


def test_a_map_without_any_fix_counts_from_its_first_run(ride: Ride) -> None:
    lost = [smooth(replace(ride(run).simulation.recording, fixes=None)) for run in (0, 2)]
    joined = build_map(lost, name="somewhere")
    assert abs(joined.grid["chainage_m"].iloc[0]) < 5.0
    assert abs(joined.runs["offset_m"].iloc[0]) < 1.0


def test_the_kilometrage_is_that_of_the_first_run_with_fixes(ride: Ride) -> None:
    """That of a run without any counts from its start, which the map no longer does."""

    def of_km(result: Result, km: str) -> Result:
        assert result.summary.run is not None
        line = LineKilometrage.model_validate({"equation": [{"chainage_m": 0.0, "km": km}]})
        facts = result.summary.run.model_copy(update={"kilometrage": line})
        return replace(result, summary=result.summary.model_copy(update={"run": facts}))

    lost = of_km(smooth(replace(ride(2).simulation.recording, fixes=None)), "100+000")
    begun = build_map([lost], name="somewhere")
    for joined, km in ((begun, "100+000"), (with_runs(begun, [of_km(ride(0).result, "20+000")]), "20+000")):
        kilometrage = kilometrage_of_map(joined.name, joined.configuration)
        assert kilometrage is not None
        assert kilometrage.equation[0].km == km


def test_the_same_run_is_not_joined_twice(line_map: FeatureMap, ride: Ride) -> None:
    with pytest.raises(BadInputError, match="in the map already"):
        with_runs(line_map, [ride(0).result])


def test_a_run_over_other_track_is_refused(line_map: FeatureMap, ride: Ride) -> None:
    with pytest.raises(BadInputError, match="not recognised"):
        with_runs(line_map, [ride(0, seed=4).result])


def test_a_run_smoothed_with_a_map_is_refused(line_map: FeatureMap, ride: Ride) -> None:
    located = smooth(ride(4).simulation.recording, feature_map=line_map)
    with pytest.raises(BadInputError, match="smoothed with a map"):
        with_runs(line_map, [located])


@pytest.mark.parametrize("rows", [0, 1])
def test_a_run_with_one_place_of_track_is_refused(ride: Ride, rows: int) -> None:
    run = ride(0).result
    with pytest.raises(BadInputError, match="no track geometry, or one row of it"):
        build_map([replace(run, geometry=run.geometry[:rows])], name="short")
    unmeasured = run.geometry.iloc[:10].assign(**dict.fromkeys(run.geometry.columns[1:], np.nan))
    with pytest.raises(BadInputError, match="no track geometry, or one row of it"):
        build_map([replace(run, geometry=unmeasured)], name="short")


def test_other_conventions_are_refused(line_map: FeatureMap, ride: Ride) -> None:
    result = ride(4).result
    base_m = line_map.conventions.cross_level_base_m
    refusals = {
        "curvature_base_m": (
            20.0,
            "expected that of the map, 10. Hint: smooth it with geometry.curvature_base_m = 10 in",
        ),
        "cross_level_base_m": (1.234, f"Hint: if it is the same track, set track.cross_level_base_m = {base_m:g} in"),
    }
    for name, (length, expected) in refusals.items():
        meaning = result.summary.geometry.model_copy(update={name: length})
        other = replace(result, summary=result.summary.model_copy(update={"geometry": meaning}))
        with pytest.raises(BadInputError, match=re.escape(expected)):
            with_runs(line_map, [other])


def test_gnss_places_the_line_on_the_earth(ride: Ride) -> None:
    runs = [ride(number, gnss=True) for number in (0, 2)]
    placed = build_map([run.result for run in runs], name="on earth")
    assert placed.origin is not None
    line = placed.line.dropna()
    truth: pd.DataFrame = runs[0].simulation.truth
    moving = truth.drop_duplicates("chainage_m").sort_values("chainage_m")
    for axis in ("east_m", "north_m"):
        true = np.interp(line["chainage_m"], moving["chainage_m"], moving[axis])
        inside = line["chainage_m"].between(100.0, 1900.0)
        assert np.abs((line[axis] - true)[inside] / line[f"{axis}_sd"][inside]).max() < 4.5
    assert placed.landmarks["east_m_sd"].notna().all()
    nowhere = replace(runs[0].result, trajectory=runs[0].result.trajectory[:1])
    assert np.isfinite(build_map([nowhere], name="drawn").line["east_m"]).all()


def test_a_run_whose_fixes_are_off_all_along_is_refused(line_map: FeatureMap, ride: Ride) -> None:
    """No sighting by itself shows it. Without them the run is joined by its track, and moves nothing."""
    recording = ride(4).simulation.recording
    off = recording.fixes.assign(chainage_m=recording.fixes["chainage_m"] + 5.0)
    with pytest.raises(BadInputError, match=r"its fixes place it [45]\.\d+ m ahead of where the map has it"):
        with_runs(line_map, [smooth(replace(recording, fixes=off))])
    joined = with_runs(line_map, [smooth(replace(recording, fixes=None))])
    moved = joined.landmarks["chainage_m"] - line_map.landmarks["chainage_m"]
    assert moved.abs().max() < 0.2
