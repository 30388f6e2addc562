"""The joint covariance of places against the tables' sigmas, sampled errors and a dense interpolation."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from trackfg.files.parquet import write_parquet
from trackfg.numerics.chained_covariance import Block, ChainedCovariance
from trackfg.results.place_covariance import PlaceCovariance, interpolation_weights
from trackfg.smoothing.smoother import SmoothedStates


@pytest.mark.parametrize("scenario", ["mainline", "measuring-car", "shuttle"])
def test_its_diagonal_is_what_the_geometry_table_says(smoothed: Callable[..., SmoothedStates], scenario: str) -> None:
    run = smoothed(scenario, seed=1, duration_s=120.0)
    places = run.places
    geometry = run.geometry.set_index(run.geometry["chainage_m"].round(6))
    sd = np.sqrt(np.diag(places.matrix))
    p = len(places.chainage_m)
    assert p >= 4
    at = geometry.loc[places.chainage_m.round(6)]
    # Where it grows from nothing, at the start, the two interpolate it differently between keyframes.
    np.testing.assert_allclose(sd[:p], at["chainage_m_sd"], rtol=0.02, atol=2e-5)
    if scenario == "mainline":  # without lasers, and with a mounting whose roll is known
        known = at["cross_level_mm_sd"].notna().to_numpy()
        np.testing.assert_allclose(sd[p:][known], at["cross_level_mm_sd"][known], rtol=0.02)


def test_errors_nearby_are_more_alike(smoothed: Callable[..., SmoothedStates]) -> None:
    run = smoothed("mainline", seed=1, duration_s=120.0)
    p = len(run.places.chainage_m)
    sd = np.sqrt(np.diag(run.places.matrix))
    correlation = run.places.matrix / np.outer(sd, sd)
    beside, far = np.diag(correlation[:p, :p], 1)[2:-1], correlation[2, p - 2]
    assert (beside > 0.9).all()
    assert far < beside.min()


def test_in_between_it_is_interpolated() -> None:
    rng = np.random.default_rng(1)
    root = rng.standard_normal((6, 6))
    known = PlaceCovariance.of(np.array([0.0, 250.0, 500.0]), root @ root.T)
    at = np.array([-10.0, 0.0, 100.0, 250.0, 600.0])
    weights = np.array([[1, 0, 0], [1, 0, 0], [0.6, 0.4, 0], [0, 1, 0], [0, 0, 1]])
    np.testing.assert_allclose(interpolation_weights(known.chainage_m, at), weights)
    both = np.kron(np.eye(2), weights)
    np.testing.assert_allclose(known.at(at), both @ known.matrix @ both.T)


def test_other_shapes_are_refused() -> None:
    with pytest.raises(ValueError, match="ascending places"):
        PlaceCovariance.of(np.array([0.0, 0.0]), np.eye(4))
    with pytest.raises(ValueError, match="4 rows"):
        PlaceCovariance.of(np.array([0.0, 1.0]), np.eye(2))
    with pytest.raises(ValueError, match="expected the columns"):
        PlaceCovariance.from_frame(PlaceCovariance.of(np.array([0.0]), np.eye(2)).to_frame().iloc[:, 1:])


def test_a_long_run_is_tested_stretch_by_stretch() -> None:
    """Chainage walks at random; one pair of places far along errs together by more than each by itself."""
    places = 250.0 * np.arange(1201)
    walk = 1.0 + 1e-3 * np.minimum(places[:, None], places)
    long = PlaceCovariance.of(places, np.kron(np.eye(2), walk + 1e-3 * np.eye(len(places))))
    long.refuse_unsound()
    wrong = long.matrix.copy()
    wrong[1180, 1000] = wrong[1000, 1180] = 1.01 * np.sqrt(wrong[1180, 1180] * wrong[1000, 1000])
    with pytest.raises(ValueError, match="positive definite"):
        PlaceCovariance.of(places, wrong).refuse_unsound()


def test_that_of_a_long_run_is_kept_by_blocks(tmp_path: Path) -> None:
    """Two random walks, passed from the far end: the file has what the matrix has, and grows in proportion to it."""
    places = 250.0 * np.arange(1200)[::-1]
    variance = 1.0 + 1e-3 * np.arange(1200)
    blocks = []
    for begin in range(0, 1200, 8):
        rows = np.arange(begin, begin + 8)
        start, end, walk = variance[max(begin - 1, 0)], variance[rows[-1]], variance[rows]
        eye = np.eye(2)
        between = np.kron(np.minimum(walk[:, None], walk) + 1e-3 * np.eye(8), eye)
        by_end = np.kron((walk / end)[:, None], eye)
        with_start = np.kron(np.full((1, 8), start), eye)
        blocks.append(Block(np.arange(2 * begin, 2 * begin + 16), between, by_end, eye * start / end, with_start))
    ours = PlaceCovariance.in_order_of_time(places, ChainedCovariance(tuple(blocks)))
    dense = np.minimum(variance[::-1, None], variance[::-1]) + 1e-3 * np.eye(1200)
    np.testing.assert_allclose(ours.matrix, np.kron(np.eye(2), dense), rtol=1e-9, atol=1e-12)
    ours.refuse_unsound()
    write_parquet(ours.to_frame(), tmp_path / "covariance.parquet")
    back = PlaceCovariance.from_frame(pd.read_parquet(tmp_path / "covariance.parquet"))
    np.testing.assert_array_equal(back.matrix, ours.matrix)
    at = np.array([-10.0, 100.0, 1234.5, 2e5, 4e5])
    as_matrix = PlaceCovariance.of(ours.chainage_m, ours.matrix)
    np.testing.assert_allclose(back.at(at), as_matrix.at(at), rtol=1e-12)
    assert (tmp_path / "covariance.parquet").stat().st_size < 1200 * 1000
    with pytest.raises(ValueError, match="expected the columns"):
        PlaceCovariance.from_frame(ours.to_frame().drop(columns="own"))
    first = ours.errors.blocks[0]
    lopsided = first._replace(own=np.triu(first.own))
    with pytest.raises(ValueError, match="symmetric"):
        PlaceCovariance(ours.chainage_m, ChainedCovariance((lopsided, *ours.errors.blocks[1:]))).refuse_unsound()
