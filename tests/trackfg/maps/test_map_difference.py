"""What moved, by how many sigmas, and that these sigmas are right."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest

from trackfg.mapping import difference
from trackfg.maps import FeatureMap

MakeMap = Callable[..., FeatureMap]


def of_runs(feature_map: FeatureMap, *contents: int) -> FeatureMap:
    """The same map, made from runs with these contents."""
    template = feature_map.runs.iloc[[0]]
    runs = pd.concat([template] * len(contents), ignore_index=True)
    hashes = pd.Series([f"{content:064x}" for content in contents], dtype="str")
    names = pd.Series([f"r{content}" for content in contents], dtype="str")
    return dataclasses.replace(feature_map, runs=runs.assign(content_sha256=hashes, run_id=names), information={})


def moved_landmarks(feature_map: FeatureMap, shift: np.ndarray, sd: float) -> FeatureMap:
    """Every landmark's chainage shifted, all with this sigma and no correlation."""
    marks = feature_map.landmarks
    table = marks.assign(chainage_m=marks["chainage_m"] + shift, chainage_m_sd=sd)
    return dataclasses.replace(feature_map, landmarks=table, covariance=np.eye(len(marks)) * sd**2)


@pytest.fixture
def plain(make_map: MakeMap) -> FeatureMap:
    made = make_map(cells=4001)
    evenly = made.landmarks.assign(chainage_m=np.linspace(10.0, 990.0, 13))
    return moved_landmarks(dataclasses.replace(made, landmarks=evenly), np.zeros(13), 0.5)


@pytest.mark.parametrize(
    ("runs_a", "runs_b", "sd_b", "relation", "sd"),
    [
        ((1, 2), (2, 1, 3), 0.3, "extended", 0.4),
        ((1, 2, 3), (1, 2), 1.3, "reduced", 1.2),
        ((1, 2), (3, 4), 1.2, "disjoint", 1.3),
        ((1, 2), (2, 3), 1.2, "overlapping", 1.3),
        ((1, 2), (2, 1), 0.3, "same", 0.3),
        ((1, 2), (1, 2, 3), 0.6, "extended", np.nan),
    ],
)
def test_sigma_by_the_runs_of_both(
    plain: FeatureMap, runs_a: tuple[int, ...], runs_b: tuple[int, ...], sd_b: float, relation: str, sd: float
) -> None:
    found = difference(of_runs(plain, *runs_a), of_runs(moved_landmarks(plain, np.full(13, 0.6), sd_b), *runs_b))
    assert found.relation == relation
    chainage = found.moved[found.moved["quantity"] == "chainage_m"]
    assert len(chainage) == 13
    np.testing.assert_allclose(chainage["difference"], 0.6, rtol=1e-9)
    np.testing.assert_allclose(chainage["difference_sd"], sd)
    np.testing.assert_allclose(chainage["sigmas"], 0.6 / sd)


def test_the_sigmas_of_an_extended_map_are_right(plain: FeatureMap) -> None:
    """Weighted means of the same first run and a second one: (b - a) / sd is standard normal over many landmarks."""
    rng = np.random.default_rng(1)
    plain = dataclasses.replace(plain, grid=plain.grid.iloc[:41])
    ratios = []
    for _ in range(40):
        first, second = rng.normal(0.0, 0.5, 13), rng.normal(0.0, 0.3, 13)
        weight = np.array([0.5, 0.3]) ** -2.0
        both = (weight[0] * first + weight[1] * second) / weight.sum()
        a = of_runs(moved_landmarks(plain, first, 0.5), 1)
        b = of_runs(moved_landmarks(plain, both, float(weight.sum() ** -0.5)), 1, 2)
        moved = difference(a, b).moved
        ratios.append(moved.loc[moved["quantity"] == "chainage_m", "sigmas"].to_numpy())
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(1.0, abs=0.1)


def test_nothing_moved(plain: FeatureMap) -> None:
    """Not one sigma, also where a difference is known exactly, and unknown radii are left out."""
    longer = of_runs(plain, 1, 2)
    found = difference(of_runs(plain, 1), longer)
    assert (found.moved["sigmas"] == 0.0).all()
    assert (found.moved["difference"] == 0.0).all()
    assert len(found.moved) == 13 * 5 - 1
    assert found.moved["landmark_id"].iloc[:5].tolist() == ["C000-BTC"] * 5
    assert found.moved["quantity"].iloc[0] == "chainage_m"
    assert found.sections["largest_sigmas"].max() == 0.0
    assert found.added.empty
    assert found.removed.empty


def test_moved_though_both_are_known_alike(plain: FeatureMap) -> None:
    """A difference that is known exactly, and is not zero, is infinitely many sigmas."""
    found = difference(of_runs(plain, 1), of_runs(moved_landmarks(plain, np.full(13, 0.1), 0.5), 1, 2))
    assert np.isinf(found.moved.loc[found.moved["quantity"] == "chainage_m", "sigmas"]).all()


def test_added_and_removed(plain: FeatureMap) -> None:
    def keep(rows: slice, cells: slice) -> FeatureMap:
        marks = plain.landmarks.iloc[rows].reset_index(drop=True)
        grid = plain.grid.iloc[cells].reset_index(drop=True)
        return dataclasses.replace(plain, landmarks=marks, covariance=plain.covariance[rows, rows], grid=grid)

    a, b = keep(slice(0, 10), slice(0, 3000)), keep(slice(2, 13), slice(100, 4001))
    found = difference(a, b)
    assert found.removed["landmark_id"].tolist() == plain.landmarks["landmark_id"].tolist()[:2]
    assert found.added["landmark_id"].tolist() == plain.landmarks["landmark_id"].tolist()[10:]
    assert set(found.moved["landmark_id"]) == set(plain.landmarks["landmark_id"].tolist()[2:10])
    assert (found.cells_added, found.cells_removed) == (1001, 100)
    assert found.sections["start_m"].min() == 0.0
    assert found.sections["cells"].iloc[0] == 700


def test_sections(plain: FeatureMap) -> None:
    """A defect of 3 mm over 10 cells is seen in its section, at its place, with its sigmas."""
    grid = plain.grid.copy()
    here = (grid["chainage_m"] >= 430.0) & (grid["chainage_m"] < 432.5)
    grid.loc[here, "cross_level_mm"] -= 3.0
    grid.loc[here & (grid["chainage_m"] == 431.0), "cross_level_mm"] -= 0.5
    b = of_runs(dataclasses.replace(plain, grid=grid.assign(cross_level_mm_sd=0.4)), 2)
    a = of_runs(dataclasses.replace(plain, grid=plain.grid.assign(cross_level_mm_sd=0.3)), 1)
    sections = difference(a, b).sections
    assert sections.groupby("quantity").size().eq(6).all()
    changed = sections[sections["rms"] > 0.0]
    assert len(changed) == 1
    row = changed.iloc[0]
    assert (row["quantity"], row["start_m"], row["end_m"], row["cells"]) == ("cross_level_mm", 400.0, 600.0, 800)
    assert row["mean"] == pytest.approx(-(10 * 3.0 + 0.5) / 800)
    assert row["rms"] == pytest.approx(np.sqrt((9 * 9.0 + 3.5**2) / 800))
    assert (row["largest"], row["largest_at_m"]) == (pytest.approx(-3.5), 431.0)
    assert row["largest_sigmas"] == pytest.approx(7.0)
    assert row["rms_sigmas"] == pytest.approx(row["rms"] / 0.5)


def test_unknown_cells_are_left_out(plain: FeatureMap) -> None:
    sections = difference(plain, plain).sections
    assert sections.loc[sections["quantity"] == "cant_mm", "cells"].tolist() == [796, 800, 800, 800, 800, 1]
    blank = dataclasses.replace(plain, grid=plain.grid.assign(cant_mm=np.nan))
    assert "cant_mm" not in set(difference(plain, blank).sections["quantity"])
    nothing = dataclasses.replace(plain, grid=plain.grid.iloc[:0])
    assert list(difference(plain, nothing).sections.columns) == list(sections.columns)


def test_grids_of_other_steps(plain: FeatureMap) -> None:
    conventions = dataclasses.replace(plain.conventions, step_m=0.125)
    with pytest.raises(ValueError, match="expected the same step"):
        difference(plain, dataclasses.replace(plain, conventions=conventions))
