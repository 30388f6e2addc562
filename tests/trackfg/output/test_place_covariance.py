"""The joint covariance of places against the tables' sigmas, sampled errors and a dense interpolation."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

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
    known = PlaceCovariance(np.array([0.0, 250.0, 500.0]), root @ root.T)
    at = np.array([-10.0, 0.0, 100.0, 250.0, 600.0])
    weights = np.array([[1, 0, 0], [1, 0, 0], [0.6, 0.4, 0], [0, 1, 0], [0, 0, 1]])
    np.testing.assert_allclose(interpolation_weights(known.chainage_m, at), weights)
    both = np.kron(np.eye(2), weights)
    np.testing.assert_allclose(known.at(at), both @ known.matrix @ both.T)


def test_other_shapes_are_refused() -> None:
    with pytest.raises(ValueError, match="ascending places"):
        PlaceCovariance(np.array([0.0, 0.0]), np.eye(4))
    with pytest.raises(ValueError, match="4 rows"):
        PlaceCovariance(np.array([0.0, 1.0]), np.eye(2))
    with pytest.raises(ValueError, match="expected the columns"):
        PlaceCovariance.from_frame(PlaceCovariance(np.array([0.0]), np.eye(2)).to_frame().iloc[:, 1:])


def test_a_long_run_is_tested_stretch_by_stretch() -> None:
    """Chainage walks at random; one pair of places far along errs together by more than each by itself."""
    places = 250.0 * np.arange(1201)
    walk = 1.0 + 1e-3 * np.minimum(places[:, None], places)
    long = PlaceCovariance(places, np.kron(np.eye(2), walk + 1e-3 * np.eye(len(places))))
    long.refuse_unsound()
    wrong = long.matrix.copy()
    wrong[1180, 1000] = wrong[1000, 1180] = 1.01 * np.sqrt(wrong[1180, 1180] * wrong[1000, 1000])
    with pytest.raises(ValueError, match="positive definite"):
        PlaceCovariance(places, wrong).refuse_unsound()
