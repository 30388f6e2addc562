"""What the tests of the peers share."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from trackfg.baselines.result import BaselineResult
from trackfg.datasets.scenarios import Simulation
from trackfg.numerics.arrays import Array


def _error(result: BaselineResult, run: Simulation, column: str) -> Array:
    estimate, truth = result.trajectory, run.truth
    error = estimate[column] - np.interp(estimate["t_s"], truth["t_s"], truth[column])
    return error.to_numpy()


@pytest.fixture(scope="session")
def error_of() -> Callable[[BaselineResult, Simulation, str], Array]:
    """The error of a column of the trajectory, at each of its rows."""
    return _error
