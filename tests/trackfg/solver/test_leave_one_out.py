"""Leave-one-out residuals are those of a solve without the measurement."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import SmoothConfig, SolverConfig
from trackfg.datasets.scenarios import scenario, simulate
from trackfg.datasets.sensors.positioning import BaliseModel
from trackfg.factors.factor_type import FactorType
from trackfg.graph.build import build_problem
from trackfg.solver.covariance import posterior_covariance
from trackfg.solver.gauss_newton import solve
from trackfg.solver.leave_one_out import left_out

TIGHT = SolverConfig(step_tolerance=1e-5, cost_tolerance=1e-9)


@pytest.mark.parametrize(("kind", "which"), [(FactorType.ABSOLUTE_FIX, 2), (FactorType.GNSS_POSITION, 30)])
def test_left_out_is_left_out(kind: FactorType, which: int) -> None:
    """The error of one measurement, and its sigma, are those of a solve without it."""
    run = simulate(replace(scenario("mainline-gnss"), balises=BaliseModel(300.0, 0.3)), seed=3, duration_s=90.0)
    problem = build_problem(run.recording, SmoothConfig())
    problem = replace(problem, families=tuple(replace(f, loss=None) for f in problem.families))
    family = problem.family(kind)
    assert family is not None
    solution = solve(problem, TIGHT)
    one = left_out(family, solution.states, posterior_covariance(solution.root))
    rest = family.take(np.arange(len(family)) != which)
    others = (f for f in problem.families if f is not family)
    without = solve(replace(problem, initial=solution.states, families=(*others, rest)), TIGHT)
    alone = left_out(family, without.states, posterior_covariance(without.root), used=False)
    np.testing.assert_allclose(one.error[which], alone.error[which], rtol=0.02, atol=1e-3)
    np.testing.assert_allclose(one.covariance[which], alone.covariance[which], rtol=0.02, atol=1e-4)
