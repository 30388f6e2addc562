"""A recording with everything wrong at once is smoothed, and its errors stay those of its positions."""

from __future__ import annotations

import numpy as np
import pytest

from trackfg.datasets.scenarios import simulate
from trackfg.evaluation.scores import rms
from trackfg.smoothing.smoother import smooth


@pytest.mark.slow
def test_a_rough_ride_is_smoothed_to_better_than_its_positions() -> None:
    run = simulate("rough-ride", seed=1, duration_s=600.0)
    result = smooth(run.recording)
    table, truth = result.trajectory, run.truth
    assert result.summary.solver.converged
    assert np.isfinite(table.to_numpy()).all()
    error = {
        name: table[name] - np.interp(table["t_s"], truth["t_s"], truth[name]) for name in ("chainage_m", "speed_mps")
    }
    # A fix in ten is hundreds of metres off, positions among houses err by 5 m.
    assert rms(error["chainage_m"]) < 2.5
    assert rms(error["speed_mps"]) < 0.25
    assert [finding.code for finding in result.summary.findings if finding.code == "fixes-withheld"]
