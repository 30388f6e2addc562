"""Runs count as much as they agree with each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from trackfg.mapping.joining.agreement import disagreements, in_agreement
from trackfg.mapping.joining.anchors import Sightings, information_on_anchors
from trackfg.mapping.joining.survey import Survey, SurveyedRun
from trackfg.numerics.arrays import Array
from trackfg.results.place_covariance import PlaceCovariance
from trackfg.results.summary import RunFacts

PLACES = 250.0 * np.arange(40)
WALK_M = 0.02
"""Sigma of what a chainage gains in error over the root of a metre, as runs state it."""
RUNS = 8


def survey_of(errors: Sequence[Array], *, anchored: Sequence[bool] | None = None) -> Survey:
    """Runs whose chainages err by a walk from 1 m on, and say so; those without a fix count from elsewhere."""
    stated = WALK_M**2 * np.minimum.outer(PLACES, PLACES) + 1.0
    zeros = np.zeros(len(PLACES))
    covariance = np.block([[stated, np.zeros_like(stated)], [np.zeros_like(stated), np.eye(len(PLACES))]])
    survey = Survey("line")
    for i, error in enumerate(errors):
        run_id, has_fixes = f"run{i}", anchored is None or anchored[i]
        seen = Sightings(tuple(f"{x:.0f}" for x in PLACES), PLACES + error, zeros, np.full(len(PLACES), np.nan))
        rows = information_on_anchors(
            run_id, seen, PlaceCovariance.of(PLACES + error, covariance), None, anchored=has_fixes
        )
        facts = RunFacts(content_sha256=run_id, direction=1, anchored=has_fixes, mount_roll_sd_rad=0.0)
        survey = survey.with_information({run_id: SurveyedRun(run_id, facts)}, {run_id: rows})
    return survey


def walks(rng: np.random.Generator, factors: Sequence[float]) -> list[Array]:
    """Errors (m,) of runs whose sigmas are too small by factors."""
    steps = WALK_M * np.sqrt(np.diff(PLACES, prepend=PLACES[0]))
    return [factor * (rng.standard_normal() + np.cumsum(steps * rng.standard_normal(len(steps)))) for factor in factors]


def sigmas(survey: Survey) -> Array:
    """Errors of the anchors in their sigmas, (m,)."""
    at = survey.chainages
    return (at.place - PLACES) / np.sqrt(np.diag(at.covariance))


def test_runs_that_agree_are_weighted_as_before_to_the_last_bit() -> None:
    survey = survey_of(walks(np.random.default_rng(1), np.ones(RUNS)))
    weighted, agreement = in_agreement(survey)
    assert np.isinf(agreement.degrees)
    assert set(agreement.scales.values()) == {1.0}
    assert np.array_equal(weighted.pooled.R, survey.pooled.R)
    assert np.array_equal(weighted.pooled.d, survey.pooled.d)


def test_a_run_whose_sigmas_are_too_small_counts_less() -> None:
    survey = survey_of(walks(np.random.default_rng(2), [4.0, *np.ones(RUNS - 1)]))
    weighted, agreement = in_agreement(survey)
    scales = list(agreement.scales.values())
    assert scales[0] == pytest.approx(4.0, rel=0.25)
    assert scales[1:] == [1.0] * (RUNS - 1)
    (message,) = disagreements(survey, agreement, set(survey.runs))
    assert message.startswith("run run0: its chainages differ from those of other runs by 3.7 times")
    assert disagreements(survey, agreement, {"run1", "run2"}) == []
    assert np.abs(weighted.chainages.place - PLACES).mean() < np.abs(survey.chainages.place - PLACES).mean()


def test_errors_that_some_stretches_have_leave_the_sigmas_of_the_map_right() -> None:
    """Two steps of 2 m in each run, where the sigma of a step is 0.3 m."""
    before, after = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        errors = walks(rng, np.ones(RUNS))
        for error in errors:
            for k in rng.integers(1, len(PLACES), 2):
                error[k:] += rng.choice([-2.0, 2.0])
        survey = survey_of(errors)
        weighted, agreement = in_agreement(survey)
        assert agreement.degrees <= 10.0
        before.append(sigmas(survey))
        after.append(sigmas(weighted))
    assert np.std(before) > 1.6
    assert np.std(after) < 1.25


def test_the_offset_of_a_run_without_fixes_is_no_disagreement() -> None:
    errors = walks(np.random.default_rng(3), np.ones(RUNS))
    errors[5] += 700.0
    _, agreement = in_agreement(survey_of(errors, anchored=[i != 5 for i in range(RUNS)]))
    assert set(agreement.scales.values()) == {1.0}


def test_a_run_alone_agrees() -> None:
    survey = survey_of(walks(np.random.default_rng(4), [5.0]))
    weighted, agreement = in_agreement(survey)
    assert agreement.scales == {"run0": 1.0}
    assert np.array_equal(weighted.pooled.R, survey.pooled.R)
