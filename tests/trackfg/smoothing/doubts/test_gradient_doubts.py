"""A solution that makes a line steeper than any is not trusted, unless positions show the heights."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from trackfg.results.verdict import QUANTITIES
from trackfg.smoothing.doubts.gradient_doubts import gradient_doubts
from trackfg.smoothing.smoother import SmoothedStates


def tilted(run: SmoothedStates, pitch_rad: float) -> SmoothedStates:
    """The same run, its sensor pointing upwards, and its line climbing, by as much."""
    states = run.solution.states
    mount = states.mount + np.array([pitch_rad, 0.0, 0.0, 0.0, 0.0])
    return replace(run, solution=replace(run.solution, states=replace(states, mount=mount)))


@pytest.mark.parametrize("pitch_rad", [0.3, -0.3])
def test_a_line_of_300_permille_is_doubted_in_all(smoothed: Callable[..., Any], pitch_rad: float) -> None:
    run = smoothed("mainline", seed=0, duration_s=150.0)
    (doubt,) = gradient_doubts(tilted(run, pitch_rad))
    assert doubt.quantities == QUANTITIES
    assert "gradient of 3" in doubt.reason
    assert not gradient_doubts(tilted(run, np.copysign(0.1, pitch_rad)))
    assert not gradient_doubts(run)


def test_positions_show_that_a_line_is_steep(smoothed: Callable[..., Any]) -> None:
    assert not gradient_doubts(tilted(smoothed("mainline-gnss", seed=0, duration_s=100.0), 0.3))
