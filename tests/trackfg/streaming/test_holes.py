"""Geometry over holes in the inertial record: its sigmas hold what the body may have done meanwhile."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.evaluation.geometry_errors import geometry_errors
from trackfg.smoothing.smoother import smooth

HOLES_S = ((60.0, 60.6), (70.0, 70.9), (80.0, 80.2))
"""Shorter than the time between keyframes, 1 s or 20 m: nothing is estimated within."""
QUANTITIES = ("twist_mm", "cross_level_mm", "versine_level_mm", "versine_alignment_mm", "curvature_1pm")


@pytest.fixture(scope="module")
def run() -> Simulation:
    """In motion at 25 m/s, with holes."""
    run = simulate("mainline-gnss", seed=3, duration_s=110.0)
    t = run.recording.imu["t_s"]
    kept = ~np.any([t.between(*hole) for hole in HOLES_S], axis=0)
    return replace(run, recording=replace(run.recording, imu=run.recording.imu[kept].reset_index(drop=True)))


@pytest.mark.parametrize("how", ["batch", "stream"])
def test_sigmas_hold_over_holes_without_a_keyframe(run: Simulation, how: str, stream: Callable[..., Any]) -> None:
    if how == "batch":
        result = smooth(run.recording)
        trajectory, geometry = result.trajectory, result.geometry
    else:
        streamed = stream(run.recording, lag_s=10.0, config=SmoothConfig())
        trajectory, geometry = streamed.smoothed, streamed.geometry
    errors = geometry_errors(geometry, trajectory, run.truth, run.truth_geometry)
    for begin, end in HOLES_S:
        place = np.interp([begin, end], trajectory["t_s"], trajectory["chainage_m"])
        near = errors[errors["chainage_m"].between(place[0] - 10.0, place[1] + 10.0)]
        for name in QUANTITIES:
            off = np.abs(near[name] - errors[name].median()) / near[f"{name}_sd"]
            assert off.max() < 4.5, (begin, name)
        within = errors[errors["chainage_m"].between(*place)]
        assert within["twist_mm_sd"].median() > 10.0 * errors["twist_mm_sd"].median()
