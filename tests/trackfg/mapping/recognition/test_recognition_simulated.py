"""Runs of the simulator, smoothed: the true shift between two runs is known at every place."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest

from trackfg import smooth
from trackfg.datasets.scenarios import Simulation
from trackfg.mapping.recognition.recognition import SURE, recognise
from trackfg.numerics.arrays import Array
from trackfg.results.result import Result

pytestmark = pytest.mark.slow

LONG_ENOUGH_S = 660.0
"""From one end of the line to the other."""


def true_place(run: tuple[Simulation, Result], reference: tuple[Simulation, Result], run_m: Array) -> Array:
    """Where on the reference's chainage the run is at its own."""

    def course(simulation: Simulation, result: Result) -> tuple[Array, Array]:
        t, estimated = (result.trajectory[name].to_numpy() for name in ("t_s", "chainage_m"))
        true = np.interp(t, simulation.truth["t_s"], simulation.truth["chainage_m"])
        order = np.argsort(estimated)
        return estimated[order], true[order]

    estimated, true = course(*run)
    reference_estimated, reference_true = course(*reference)
    order = np.argsort(reference_true)
    return np.interp(np.interp(run_m, estimated, true), reference_true[order], reference_estimated[order])


@pytest.fixture(scope="module")
def runs(simulated_in_full: Callable[..., Simulation]) -> list[tuple[Simulation, Result]]:
    simulations = [simulated_in_full("shuttle", seed=4, run=run, duration_s=LONG_ENOUGH_S) for run in range(3)]
    return [(simulation, smooth(simulation.recording)) for simulation in simulations]


@pytest.mark.parametrize("number", [1, 2])
def test_matches_are_centimetres_and_their_sigmas_hold(runs: list[tuple[Simulation, Result]], number: int) -> None:
    reference, run = runs[0], runs[number]
    geometry = run[1].geometry
    found = recognise(
        geometry,
        reference[1].geometry,
        place_sd_m=np.hypot(geometry["chainage_m_sd"].to_numpy(), 0.3),
        rate_sd=1e-5,
        direction=-1 if number % 2 else 1,
    )
    sections = found.sections
    assert sections["used"].mean() > 0.97
    used = sections[sections["used"]]
    error = used["reference_m"].to_numpy() - true_place(run, reference, used["run_m"].to_numpy())
    assert np.sqrt(np.mean(error**2)) < 0.02
    assert 0.6 < np.sqrt(np.mean((error / used["match_sd_m"]) ** 2)) < 1.8


def test_a_run_started_anywhere_on_it(runs: list[tuple[Simulation, Result]]) -> None:
    reference, run = runs[0], runs[1]
    rows = run[1].geometry["chainage_m"].between(2000.0, 6000.0)
    geometry = run[1].geometry[rows]
    stripped = geometry.assign(chainage_m=geometry["chainage_m"] + 3000.0)
    found = recognise(stripped, reference[1].geometry, place_sd_m=None, rate_sd=0.01, direction=-1)
    assert found.probability > SURE
    assert found.found_after_m <= 500.0
    used = found.sections[found.sections["used"]]
    error = used["reference_m"].to_numpy() - true_place(run, reference, used["run_m"].to_numpy() - 3000.0)
    assert np.abs(error).max() < 0.1


def test_another_line_is_not_this_one(
    runs: list[tuple[Simulation, Result]], simulated_in_full: Callable[..., Simulation]
) -> None:
    other: pd.DataFrame = smooth(
        simulated_in_full("shuttle", seed=5, run=0, duration_s=LONG_ENOUGH_S).recording
    ).geometry
    found = recognise(other, runs[0][1].geometry, place_sd_m=None, rate_sd=0.01, direction=1)
    assert found.probability < 0.2
    assert not found.sections["used"].any()
