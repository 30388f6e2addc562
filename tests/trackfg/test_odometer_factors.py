"""The wheel in the graph: how far it is trusted under force, and that slips in a row do not drag the distance along."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from trackfg.config import SmoothConfig, TachConfig
from trackfg.datasets.scenarios import Simulation
from trackfg.factors.family import Family
from trackfg.graph import build_problem
from trackfg.smoother import smooth
from trackfg.units import STANDARD_GRAVITY


def wheel_of(run: Simulation, **tach: float) -> tuple[Family, np.ndarray]:
    """The factors of the rolling wheel, and the keyframes' times."""
    problem = build_problem(run.recording, SmoothConfig(tach=TachConfig(**tach)))
    family = problem.family("tach distance")
    assert family is not None
    return family, problem.t


def test_a_wheel_under_force_may_creep_by_its_share_of_the_distance(simulated: Callable[..., Simulation]) -> None:
    run = simulated("mainline", seed=2, duration_s=150.0, noise=False)
    family, t = wheel_of(run, creep_per_traction=0.1)
    free, _ = wheel_of(run, creep_per_traction=1e-9)
    added = np.sqrt(family.sigma[:, 0] ** 2 - free.sigma[:, 0] ** 2)
    distance = np.diff(np.interp(t, run.truth["t_s"], run.truth["chainage_m"]))
    accel_t, accel = run.recording.imu["t_s"].to_numpy(), run.recording.accel[:, 0]
    force = [accel[(accel_t > a) & (accel_t < b)].mean() for a, b in pairwise(t)]
    expected = 0.1 * np.abs(force) / STANDARD_GRAVITY * distance
    assert expected.max() > 0.05
    np.testing.assert_allclose(added, expected, atol=2e-3)


@pytest.mark.slow
def test_distance_survives_slides_in_a_row_to_two_thousandths(simulated_in_full: Callable[..., Simulation]) -> None:
    """24 slips and slides in a run, the wheel creeping by up to 1 % between them."""
    run = simulated_in_full("slippery-line-leaves", seed=0)
    assert run.slips is not None
    assert run.recording.fixes is not None
    result = smooth(run.recording, SmoothConfig())

    def errors(spans: np.ndarray) -> np.ndarray:
        found, true = (
            np.diff(np.interp(spans, table["t_s"], table["chainage_m"]), axis=1)[:, 0]
            for table in (result.trajectory, run.truth)
        )
        return np.abs(np.asarray(found / true - 1.0))

    passed = run.recording.fixes["t_s"].to_numpy()
    assert errors(np.column_stack([passed[:-1], passed[1:]])).max() < 0.002
    slips = errors(run.slips[["start_s", "end_s"]].to_numpy(dtype=float))
    assert np.sqrt(np.mean(slips**2)) < 0.003
    events = result.events[result.events["kind"].isin(["slip", "slide"])]
    for slip in run.slips.itertuples():
        if abs(slip.peak_creep) > 0.05 and slip.end_s - slip.start_s >= 1.0:
            assert ((events["start_s"] < slip.end_s) & (events["end_s"] > slip.start_s)).any()
