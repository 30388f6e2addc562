"""With displacement sensors the sigmas of heading and position are those of the errors, over seeds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from trackfg.datasets.scenarios import simulate
from trackfg.smoothing.smoother import smooth

SEEDS = range(6)


@pytest.mark.slow
def test_sigmas_of_heading_and_position_are_true() -> None:
    """Displacement sensors show nothing of the heading itself; a run's errors are correlated, so its end counts."""
    ratios = []
    for seed in SEEDS:
        run = simulate("measuring-car", seed=seed, duration_s=120.0)
        end = smooth(run.recording).trajectory.iloc[-1]
        true = {name: np.interp(end["t_s"], run.truth["t_s"], run.truth[name]) for name in ("east_m", "north_m")}
        true["yaw_rad"] = np.interp(end["t_s"], run.truth["t_s"], np.unwrap(run.truth["yaw_rad"]))
        error = {name: end[name] - value for name, value in true.items()}
        error["yaw_rad"] = (error["yaw_rad"] + np.pi) % (2.0 * np.pi) - np.pi
        ratios.append([error[name] / end[f"{name}_sd"] for name in error])
    total = np.sum(np.square(ratios), axis=0)
    assert (total < stats.chi2.ppf(0.999, len(SEEDS))).all(), total
    assert (total > stats.chi2.ppf(0.001, len(SEEDS))).all(), total
