"""Runs whose clocks are off by more than the graph's variables cover."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.smoothing.smoother import smooth


@pytest.fixture(scope="module")
def run() -> Simulation:
    return simulate(scenario("mainline-gnss"), seed=2, duration_s=300.0)


def test_positions_that_are_late_are_moved(run: Simulation) -> None:
    gnss = run.recording.gnss
    assert gnss is not None
    prompt = smooth(run.recording)
    late = smooth(replace(run.recording, gnss=gnss.assign(t_s=gnss["t_s"] + 1.5)))
    assert not any(finding.code == "gnss-clock" for finding in prompt.summary.findings)
    (finding,) = (finding for finding in late.summary.findings if finding.code == "gnss-clock")
    assert "late" in finding.message
    for name in ("east_m", "north_m", "speed_mps", "pitch_rad"):
        off = (late.trajectory[name] - prompt.trajectory[name]) / prompt.trajectory[f"{name}_sd"]
        assert np.sqrt(np.mean(off**2)) < 1.0
