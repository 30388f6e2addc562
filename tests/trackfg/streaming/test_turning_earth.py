"""A stream without a latitude is of a railway on the Earth, which turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.effects.catalogue import effect
from trackfg.datasets.scenarios import simulate
from trackfg.evaluation.trajectory_errors import from_the_true_start, trajectory_errors
from trackfg.factors.bias import EARTH
from trackfg.factors.factor_type import FactorType
from trackfg.graph.build import build_problem
from trackfg.graph.priors import with_turning_earth
from trackfg.numerics.geodesy import EARTH_RATE
from trackfg.results.events import DOUBT

from .conftest import setting_off, streamed


def test_the_prior_of_the_earths_rate_alone_is_wide() -> None:
    run = simulate(setting_off("mainline"), seed=0, duration_s=30.0)
    families = build_problem(run.recording, SmoothConfig()).families
    narrow, wide = (
        next(family for family in each if family.type is FactorType.PRIOR_IMU).sigma[0]
        for each in (families, with_turning_earth(families))
    )
    np.testing.assert_allclose(wide[EARTH], EARTH_RATE / np.sqrt(2.0))
    np.testing.assert_array_equal(np.delete(wide, EARTH), np.delete(narrow, EARTH))
    assert (narrow[EARTH] < 0.01 * wide[EARTH]).all()


@pytest.mark.slow
def test_a_line_with_loops_on_the_turning_earth() -> None:
    """With an Earth that does not turn the chainage errs by 31 m in ten minutes, half of it beyond 3 sigmas."""
    plan = replace(setting_off("mainline", 20.0), balises=None, effects=(effect("earth-undeclared", 35.0),))
    run = simulate(plan, seed=2, duration_s=600.0)
    smoothed = streamed(run.recording, lag_s=20.0, batch_s=5.0, config=SmoothConfig()).smoothed
    errors = trajectory_errors(from_the_true_start(smoothed, run.truth), run.truth)
    along = errors["along_track_m"]
    assert np.sqrt(np.mean(along**2)) < 10.0
    assert np.mean(np.abs(along) < 3.0 * errors["along_track_m_sd"]) > 0.95


@pytest.mark.slow
def test_a_latitude_without_a_heading() -> None:
    """Without the Coriolis force the accelerometer's bias seems to walk, and the pitch errs by two of its sigmas."""
    plan = replace(setting_off("mainline", 20.0), balises=None, effects=(effect("earth-no-heading", 35.0),))
    run = simulate(plan, seed=2, duration_s=600.0)
    out = streamed(run.recording, lag_s=20.0, batch_s=5.0, config=SmoothConfig())
    assert not any(event.kind == DOUBT for event in out.events)
    errors = trajectory_errors(out.smoothed, run.truth)
    assert np.sqrt(np.mean((errors["pitch_mrad"] / errors["pitch_mrad_sd"]) ** 2)) < 1.5
