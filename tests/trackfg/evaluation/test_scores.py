"""The scores by which every estimator is judged."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest

from trackfg.evaluation.scores import rms, score_bands, score_run, score_runs
from trackfg.numerics.arrays import Array

STEP_M = 0.25


def errors_table(error: Array, sd: Array | float, speed_kmh: Array | float) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "chainage_m": STEP_M * np.arange(len(error)),
            "speed_mps": np.asarray(speed_kmh) / 3.6,
            "twist_mm": error,
            "twist_mm_sd": sd,
        }
    )


def test_scores_of_a_run_and_by_speed() -> None:
    errors = errors_table(np.array([1.0, -1.0, 3.0, np.nan, 5.0]), 2.0, np.array([5.0, 9.9, 10.0, 15.0, 12.0]))
    scores = score_run(errors)
    assert scores["from_kmh"].fillna(-1.0).tolist() == [-1.0, 0.0, 10.0]
    assert scores["places"].tolist() == [4, 2, 2]
    np.testing.assert_allclose(scores["rms"], np.sqrt([9.0, 1.0, 17.0]))
    # About the mean of the whole run, 2, in the bands too.
    np.testing.assert_allclose(scores["sd"], np.sqrt([5.0, 5.0, 5.0]))
    np.testing.assert_allclose(scores["max"], [5.0, 1.0, 5.0])
    np.testing.assert_allclose(scores["ratio"], np.sqrt([9.0, 1.0, 17.0]) / 2.0)
    np.testing.assert_allclose(scores["coverage"], [0.75, 1.0, 0.5])
    np.testing.assert_allclose(scores["mean_sd"], 2.0)


@pytest.fixture
def honest() -> Callable[[int, float], pd.DataFrame]:
    def score(seed: int, offset: float) -> pd.DataFrame:
        rng = np.random.default_rng(seed)
        sd = rng.uniform(0.1, 0.4, 4000)
        return score_run(errors_table(sd * rng.standard_normal(4000) + offset, sd, np.linspace(0.0, 40.0, 4000)))

    return score


def test_honest_sigmas_cover_and_an_offset_shows(honest: Callable[[int, float], pd.DataFrame]) -> None:
    sound = score_runs(pd.concat([honest(seed, 0.0) for seed in range(10)])).iloc[0]
    assert sound["runs"] == 10
    assert sound["coverage"] == pytest.approx(0.95, abs=0.01)
    assert sound["ratio"] == pytest.approx(1.0, abs=0.02)
    assert 0.0 < sound["coverage_margin"] < 0.01
    offset = score_runs(pd.concat([honest(seed, (-1.0) ** seed) for seed in range(10)])).iloc[0]
    assert offset["sd"] == pytest.approx(sound["sd"], rel=0.02)
    assert offset["rms"] > 3.0 * sound["rms"]
    assert offset["coverage"] < 0.2


def test_one_run_has_no_margin_and_an_absent_quantity_no_scores(honest: Callable[[int, float], pd.DataFrame]) -> None:
    one = score_runs(honest(0, 0.0)).iloc[0]
    assert np.isnan(one["rms_margin"])
    nothing = score_run(errors_table(np.full(10, np.nan), 1.0, 20.0))
    absent = score_runs(nothing).iloc[0]
    assert absent["runs"] == 0
    assert np.isnan(absent["rms"])
    assert np.isnan(absent["ratio"])
    assert score_bands(nothing).empty


def test_bands_weigh_every_place_alike() -> None:
    short = score_run(errors_table(np.full(10, 3.0), 1.0, 25.0))
    long = score_run(errors_table(np.full(30, 1.0), 1.0, 25.0))
    band = score_bands(pd.concat([short, long])).iloc[0]
    assert (band["from_kmh"], band["places"], band["max"]) == (20.0, 40, 3.0)
    assert band["rms"] == pytest.approx(np.sqrt((90.0 + 30.0) / 40.0))
    assert band["coverage"] == pytest.approx(0.75)


def test_what_claims_no_sigma_is_scored_all_the_same() -> None:
    errors = errors_table(np.array([1.0, -3.0, np.nan]), np.nan, 25.0)
    whole = score_run(errors, band_kmh=None)
    assert len(whole) == 1
    row = whole.iloc[0]
    assert (row["places"], row["mean_abs"], row["max"]) == (2, 2.0, 3.0)
    assert np.isnan([row["mean_sd"], row["ratio"], row["coverage"]]).all()


@pytest.mark.parametrize("kind", [np.array, pd.Series])
def test_the_rms_of_what_is_partly_missing_is_missing(kind: Callable[[list[float]], Array | pd.Series]) -> None:
    assert np.isnan(rms(kind([3.0, np.nan])))
    assert rms(kind([3.0, -3.0])) == 3.0
