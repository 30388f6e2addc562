"""A recording with everything wrong at once is smoothed, and its errors stay those of its positions."""

from __future__ import annotations

import numpy as np
import pytest

from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.evaluation.scores import rms
from trackfg.results.result import Result
from trackfg.smoothing.smoother import smooth

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def run() -> Simulation:
    return simulate("rough-ride", seed=6, duration_s=600.0)


@pytest.fixture(scope="module")
def result(run: Simulation) -> Result:
    return smooth(run.recording)


def test_a_rough_ride_is_smoothed_to_better_than_its_positions(run: Simulation, result: Result) -> None:
    table, truth = result.trajectory, run.truth
    assert result.summary.solver.converged
    assert np.isfinite(table.to_numpy()).all()
    error = {
        name: table[name] - np.interp(table["t_s"], truth["t_s"], truth[name]) for name in ("chainage_m", "speed_mps")
    }
    # A fix in seven is some 5 km off, positions among houses err by 5 m.
    assert rms(error["chainage_m"]) < 2.5
    assert rms(error["speed_mps"]) < 0.25
    assert [finding.code for finding in result.summary.findings if finding.code == "fixes-withheld"]


def test_a_right_fix_stays_where_gnss_in_a_street_canyon_leads_the_run_astray(run: Simulation, result: Result) -> None:
    """By 7 m, which is 7 sigmas of what all else predicts. Another fix has the chainage of one that is 5 km away."""
    (withheld,) = (finding for finding in result.summary.findings if finding.code == "fixes-withheld")
    assert withheld.message.startswith("1 of 7 fixes")
    truth = np.interp(result.trajectory["t_s"], run.truth["t_s"], run.truth["chainage_m"])
    off = (result.trajectory["chainage_m"] - truth).abs()
    assert (off < 4.0 * result.trajectory["chainage_m_sd"]).all()
