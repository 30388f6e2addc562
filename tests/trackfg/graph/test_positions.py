"""Fixes and GNSS positions in the graph: carried to their keyframes with the right signs and sigmas."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from trackfg.config import PositionConfig, SmoothConfig
from trackfg.datasets.scenarios import Simulation
from trackfg.factors.family import Family
from trackfg.factors.states import Odo
from trackfg.graph.build import Problem, build_problem


def family_of(problem: Problem, name: str) -> Family:
    return next(family for family in problem.families if family.name == name)


def test_a_fix_is_carried_back_to_the_keyframe_before_it(simulated: Callable[..., Simulation]) -> None:
    """It was passed 0.4 of a sample's time after the keyframe, at the speed v: at the keyframe the vehicle was v times
    that short of the place.
    """
    run = simulated("mainline", seed=2, duration_s=60.0)
    edges = build_problem(run.recording, SmoothConfig()).t
    sample_s = float(np.median(np.diff(run.recording.imu["t_s"])))
    at = float(edges[np.argmin(np.abs(edges - 50.0))])
    fixes = pd.DataFrame({"t_s": [at + 0.4 * sample_s], "chainage_m": [1234.0], "chainage_sd_m": [0.5]})
    problem = build_problem(replace(run.recording, fixes=fixes), SmoothConfig())
    fix = family_of(problem, "absolute fix")
    assert problem.t[fix.first_keyframe].item() == pytest.approx(at)
    # The residual D - d of a vehicle at D = 0.
    nowhere = replace(problem.initial, odo=Odo(np.zeros((len(problem.t), 4))))
    speed = float(run.ride.motion.speed(np.array([at]))[0])
    assert speed > 5.0
    expected = -(1234.0 - speed * 0.4 * sample_s)
    assert fix.residual(nowhere).item() == pytest.approx(expected, abs=0.05 * speed * sample_s)


def test_gnss_is_the_place_of_its_antenna_at_its_time(simulated: Callable[..., Simulation]) -> None:
    """The antenna is at (3, 0, 2) m in the vehicle and the sensor at (1, 0.5, 1) m, so that it is (2, -0.5, 1) m from
    the sensor. At rest positions have no keyframe of their own; those in motion are moved by the velocity, for at most
    half a sample.
    """
    recording = simulated("mainline-gnss", seed=2, duration_s=40.0).recording
    description = recording.description
    assert description.gnss is not None
    assert recording.gnss is not None
    placed = description.model_copy(
        update={
            "imu": description.imu.model_copy(update={"lever_arm_m": (1.0, 0.5, 1.0)}),
            "gnss": description.gnss.model_copy(update={"lever_arm_m": (3.0, 0.0, 2.0)}),
        }
    )
    late = recording.gnss.assign(t_s=recording.gnss["t_s"] + 0.002)
    problem = build_problem(replace(recording, description=placed, gnss=late), SmoothConfig())
    gnss, nav = (
        family_of(problem, "GNSS position"),
        problem.initial.nav[family_of(problem, "GNSS position").first_keyframe],
    )
    inside = late[late["t_s"].between(problem.t[0], problem.t[-1])]
    after = inside["t_s"].to_numpy() - problem.t[gnss.first_keyframe]
    moving = np.linalg.norm(nav.v, axis=1) > 5.0
    assert np.abs(after[moving]).max() > 1e-3
    antenna = nav.p + nav.R @ [2.0, -0.5, 1.0] + nav.v * after[:, None]
    expected = antenna - inside[["east_m", "north_m", "up_m"]].to_numpy()
    np.testing.assert_allclose(gnss.residual(problem.initial), expected, atol=1e-9)


def test_errors_that_last_make_positions_count_less(simulated: Callable[..., Simulation]) -> None:
    """One position a second with errors that last 10 s: n of them are worth n / 20 independent ones."""
    recording = simulated("mainline-gnss", seed=2, duration_s=40.0).recording
    alone, lasting = (
        family_of(
            build_problem(recording, SmoothConfig(position=PositionConfig(gnss_correlation_s=tau))), "GNSS position"
        )
        for tau in (0.0, 10.0)
    )
    np.testing.assert_allclose(lasting.sigma, np.sqrt(20.0) * alone.sigma)
