"""Functions estimated on the way forward are those of the whole solution and of its covariance."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import Simulation
from trackfg.factors.states import KEYFRAME_DIM
from trackfg.graph.build import build_problem
from trackfg.sensors.displacement import rail_views
from trackfg.smoothing.rail_ties import with_rail_factors
from trackfg.solver import elimination
from trackfg.solver.covariance import Functions, times_covariance
from trackfg.solver.elimination import eliminate
from trackfg.solver.forward_functions import estimated


@pytest.mark.usefixtures("kernels")
@pytest.mark.parametrize("scenario", ["mainline-gnss", "measuring-car"])
def test_functions_are_those_of_the_solution(
    scenario: str, simulated: Callable[..., Simulation], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of random functions, none in the first block, two of one keyframe, one across two blocks."""
    recording = simulated(scenario, seed=2, duration_s=60.0).recording
    problem, config = build_problem(recording, SmoothConfig()), SmoothConfig()
    if views := rail_views(recording):
        problem = with_rail_factors(problem, problem.initial, views, config.laser)
    n, states = len(problem.t), problem.initial
    factors = [problem.inertial.linearize(states), *(family.linearize(states) for family in problem.families)]
    monkeypatch.setattr(elimination, "_AT_A_TIME", 7)
    keyframe = np.array([8, 9, 9, 13, n - 2])
    rng, count = np.random.default_rng(0), len(keyframe)
    by_first, by_second = rng.standard_normal((2, count, KEYFRAME_DIM))
    root = eliminate(factors, n)
    by_shared = rng.standard_normal((count, root.size - KEYFRAME_DIM))
    columns, at = np.zeros((n, KEYFRAME_DIM, count)), np.arange(count)
    columns[keyframe, :, at] += by_first
    columns[keyframe + 1, :, at] += by_second
    solution, covariance_times = root.solution(), times_covariance(root, columns.copy(), by_shared.T)
    expected = np.einsum("nkm,nkl->ml", columns, covariance_times[0]) + by_shared @ covariance_times[1]
    value = np.einsum("nkm,nk->m", columns, solution.keyframes) + by_shared @ solution.shared
    estimate, covariance = estimated(factors, n, Functions(keyframe, by_first, by_second, by_shared))
    sd = np.sqrt(np.diagonal(expected))
    np.testing.assert_allclose(estimate / sd, value / sd, atol=1e-8)
    np.testing.assert_allclose(covariance / np.outer(sd, sd), expected / np.outer(sd, sd), atol=1e-8)
