"""The search before the fine match compares its positions fairly."""

from __future__ import annotations

import numpy as np
import pytest

from trackfg.mapping.recognition.profiles import CROSS_LEVEL, FeatureProfile
from trackfg.mapping.recognition.section_fit import searched_positions, section_feature

STEP_M = 0.25
ROWS = 400
X = STEP_M * np.arange(ROWS) - 50.0


def profile(values: np.ndarray) -> FeatureProfile:
    return FeatureProfile(STEP_M, 0, {CROSS_LEVEL: values}, {CROSS_LEVEL: np.full(len(values), np.nan)})


def searched(run: np.ndarray, reference: np.ndarray, about_m: float) -> float:
    """The position of the section of 100 m from the run's first row on, searched about ``about_m``."""
    feature = section_feature(profile(run), profile(reference), CROSS_LEVEL, np.array([0]), ROWS, by_curves=False)
    return float(searched_positions([feature], np.array([about_m]), np.zeros(1))[0])


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("shift_m", [-1.5, 0.0, 1.0])
def test_the_unit_does_not_matter_at_the_end_of_the_reference(unit: float, shift_m: float) -> None:
    rng = np.random.default_rng(1)
    wave = unit * np.convolve(rng.standard_normal(ROWS + 40), np.ones(8) / 8.0, mode="same")
    run = wave[:ROWS] + unit * rng.standard_normal(ROWS)
    assert searched(run, wave[: ROWS // 2], 50.0 + shift_m) == 50.0


def test_where_nothing_can_be_compared_the_position_stays() -> None:
    wave = np.sin(X)
    assert searched(wave, wave, 950.0) == 950.0
