"""The wheel in the graph: how far it is trusted under force, and that slips in a row do not drag the distance along."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from trackfg.config import SmoothConfig, TachConfig
from trackfg.datasets.effects.wheel import LateTach, MiscountedPulses
from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.datasets.sensors.odometer import TachModel, rolled_distance
from trackfg.datasets.vehicle.vehicle import Rigid
from trackfg.evaluation.scores import rms
from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family
from trackfg.factors.odometry import wheel_response
from trackfg.factors.states import Kind
from trackfg.graph.build import build_problem
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.smoothing.smoother import SmoothedStates, smooth, smooth_states


def wheel_of(run: Simulation, **tach: float) -> tuple[Family, np.ndarray]:
    """The factors of the rolling wheel, and the keyframes' times."""
    problem = build_problem(run.recording, SmoothConfig(tach=TachConfig(**tach)))
    family = problem.family(FactorType.TACH_DISTANCE)
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
    expected = 0.1 * np.abs(force) / STANDARD_GRAVITY * distance / np.sqrt(np.diff(t))
    assert expected.max() > 0.05
    np.testing.assert_allclose(added, expected, atol=2e-3)


def test_what_curves_and_force_add_has_the_sign_of_the_way() -> None:
    """20 m to the left under traction of 0.08 g; the same backwards; a curve to the right under the brake."""
    added = wheel_response(np.array([20.0, -20.0, 20.0]), np.array([0.05, -0.05, -0.05]), np.array([0.08, -0.08, -0.1]))
    expected = [[-0.05, 0.05, 1.6, 0.0, 0.0], [0.05, -0.05, -1.6, 0.0, 0.0], [0.05, 0.05, 0.0, -2.0, 0.0]]
    np.testing.assert_allclose(added, expected)


def off_centre(seed: int, offsets: tuple[float, float], noise: bool = True) -> Simulation:
    """A run through curves of R 300-500, its wheel so far to the left and to the outside of the centre line, m."""
    plan = replace(scenario("slippery-line"), adhesion=None, irregularities=None, vehicle=Rigid())
    tach = replace(plan.tach, rail_offset_m=offsets[0], outward_offset_m=offsets[1])
    return simulate(replace(plan, tach=tach), seed=seed, duration_s=750.0 if noise else 400.0, noise=noise)


def wheel_estimate(smoothed: SmoothedStates) -> tuple[np.ndarray, np.ndarray]:
    """The shared WHEEL variable and its sigmas, (5,)."""
    sd = np.sqrt(np.diagonal(smoothed.covariance.of(Kind.WHEEL)[0]))
    return smoothed.solution.states.wheel[0], sd


def test_a_perfect_wheel_beside_the_centre_line_is_placed_exactly() -> None:
    run = off_centre(0, (0.0, 0.0), noise=False)
    assert run.recording.tach is not None
    t = run.recording.tach["t_s"].to_numpy()
    model = TachModel(rail_offset_m=-0.05, outward_offset_m=0.08)
    tach = run.recording.tach.assign(distance_m=rolled_distance(run.ride, model, t))
    # With a prior this wide nothing but the run says where the wheel is.
    config = SmoothConfig(tach=TachConfig(rail_offset_sd_m=100.0))
    smoothed = smooth_states(replace(run.recording, tach=tach), config)
    np.testing.assert_allclose(wheel_estimate(smoothed)[0], [-0.05, 0.08, 0.0, 0.0, 0.0], atol=2e-3)
    error = smoothed.trajectory["chainage_m"] - np.interp(
        smoothed.trajectory["t_s"], run.truth["t_s"], run.truth["chainage_m"]
    )
    assert error.abs().max() < 0.02


def test_a_wheel_on_the_centre_line_that_does_not_creep_is_found_to_be_one(
    smoothed: Callable[..., SmoothedStates],
) -> None:
    estimate, sd = wheel_estimate(smoothed("mainline", seed=2, duration_s=150.0))
    assert (np.abs(estimate) < 3.0 * sd).all()
    assert (sd <= [0.1001, 0.1001, 0.0501, 0.0501, 1.001e-6]).all()


@pytest.mark.slow
def test_the_place_of_the_wheel_is_found_within_its_sigma() -> None:
    z = []
    for seed in range(6):
        offsets = 0.1 * np.random.default_rng(100 + seed).normal(size=2)
        estimate, sd = wheel_estimate(smooth_states(off_centre(seed, tuple(offsets)).recording, SmoothConfig()))
        assert (sd[:2] < 0.06).all()  # of a prior of 0.1 m
        z += list((estimate[:2] - offsets) / sd[:2])
    assert 0.6 < np.sqrt(np.mean(np.square(z))) < 1.5
    assert np.abs(z).max() < 3.5


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


def test_readings_change_with_an_offset_of_the_clock_by_the_vehicles_speed_and_not_by_pulses() -> None:
    base = scenario("mainline-gnss")
    run = simulate(replace(base, effects=(LateTach(0.3), MiscountedPulses(0.01))), seed=1, duration_s=120.0)
    problem = build_problem(run.recording, SmoothConfig())
    readings, wheel = problem.family(FactorType.TACH_READING), problem.wheel
    assert readings is not None
    assert wheel is not None
    t = problem.t[readings.slots[0].index]
    speed = np.interp(t - 0.3, run.truth["t_s"], run.truth["speed_mps"])
    assert rms(readings.data["rate"][:, 0] - speed) < 0.7 * rms(wheel.rate(t) - speed)
