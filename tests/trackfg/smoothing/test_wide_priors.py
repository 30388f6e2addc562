"""Priors that the data contradict: the wheel's scale, a clock; and how the sensor is mounted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.effects.catalogue import effect
from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.datasets.vehicle.driving import Service
from trackfg.factors.bias import EARTH
from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import family_of
from trackfg.factors.states import Kind, Odo
from trackfg.graph.build import Problem
from trackfg.numerics.geodesy import EARTH_RATE
from trackfg.recording.findings import Finding
from trackfg.recording.model import Recording
from trackfg.smoothing.smoother import SmoothedStates, smooth_states
from trackfg.smoothing.wide_priors import wide_priors
from trackfg.solver.variance_components import Residuals

TOTAL_S = 150.0
ACCEL_Y_SCALE = 4
"""Among the calibrations of an inertial sensor."""


def with_scale(recording: Recording, scale: float) -> Recording:
    assert recording.tach is not None
    return replace(recording, tach=recording.tach.assign(distance_m=scale * recording.tach["distance_m"]))


def far(smoothed: SmoothedStates) -> list[Finding]:
    return [finding for finding in smoothed.findings if finding.code.startswith("far-from-prior")]


@pytest.mark.parametrize(("scale", "text", "speed_mps"), [(1.05, "0.9", 0.03), (3.6, "0.27", 0.06)])
def test_a_wheel_of_another_size_or_unit_is_followed(
    simulated: Callable[..., Simulation],
    smoothed: Callable[..., SmoothedStates],
    scale: float,
    text: str,
    speed_mps: float,
) -> None:
    """Declared to 1 %: the result is as good as with the wheel's own scale, but for the search for slips, which knows
    that only roughly (:func:`smooth` corrects a tach in other units before).
    """
    recording = simulated("mainline", seed=0, duration_s=TOTAL_S).recording
    own, other = (
        smoothed("mainline", seed=0, duration_s=TOTAL_S),
        smooth_states(with_scale(recording, scale), SmoothConfig()),
    )
    (finding,) = far(other)
    assert finding.message.startswith(f"the wheel's scale is {text}")
    assert "wheel_diameter_m" in str(finding)
    prior = family_of(other.problem.families, FactorType.PRIOR_ODO)
    assert prior is not None
    assert prior.sigma[0, Odo.SCALE] == pytest.approx(1.0 - 1.0 / scale, rel=0.1)
    difference = other.trajectory["speed_mps"] - own.trajectory["speed_mps"]
    assert np.sqrt(np.mean(difference**2)) < speed_mps


def test_a_receiver_that_is_late_is_followed(simulated: Callable[..., Simulation]) -> None:
    """By 1.5 s, 30 sigmas."""
    recording = simulated("mainline-gnss", seed=0, duration_s=TOTAL_S).recording
    assert recording.gnss is not None
    gnss = recording.gnss.assign(t_s=recording.gnss["t_s"] + 1.5)
    after = smooth_states(replace(recording, gnss=gnss[gnss["t_s"] < TOTAL_S]), SmoothConfig())
    (finding,) = (one for one in after.findings if one.code == "gnss-clock")
    late_s = float(finding.message.removeprefix("the stamps of gnss are ").split()[0])
    assert "s late" in finding.message
    assert late_s == pytest.approx(1.5, abs=0.1)
    assert after.solution.states.clock[0, 2] == pytest.approx(late_s - 1.5, abs=0.1)
    assert not far(after)


@pytest.mark.parametrize("name", ["mainline", "mainline-gnss", "trolley", "shunting", "parked"])
def test_what_was_known_rightly_stays(smoothed: Callable[..., SmoothedStates], name: str) -> None:
    result = smoothed(name, seed=3, duration_s=100.0)
    assert not far(result)
    kinds = (Kind.MOUNT, Kind.CLOCK, Kind.IMU, Kind.WHEEL)
    for type_ in (FactorType[f"PRIOR_{kind.name}"] for kind in kinds):
        declared, now = (family_of(problem.families, type_) for problem in (result.declared, result.problem))
        assert declared is not None
        assert now is not None
        np.testing.assert_array_equal(now.sigma, declared.sigma)


@pytest.mark.parametrize("name", ["mainline", "slippery-line", "trolley"])
def test_vibration_does_not_pass_for_a_scale_factor(simulated: Callable[..., Simulation], name: str) -> None:
    """As much as an unfiltered sensor samples, in proportion to speed: most of the measured forces are noise then.

    Where the sensor's response was taken to what it measured, the scale of an axis was off by 20-60 %, and roll by as
    many sigmas.
    """
    run = simulated(name, seed=1, duration_s=TOTAL_S)
    imu, rng = run.recording.imu, np.random.default_rng(1)
    speed = np.interp(imu["t_s"], run.truth["t_s"], run.truth["speed_mps"])
    level = 2.0 * speed / speed.max()
    shaken = {axis: imu[axis] + level * rng.normal(size=len(imu)) for axis in ("fx_mps2", "fy_mps2", "fz_mps2")}
    result = smooth_states(replace(run.recording, imu=imu.assign(**shaken)), SmoothConfig())
    assert not [one for one in far(result) if one.code.endswith("imu")]
    assert not [doubt for doubt in result.doubts if "roll" in doubt.quantities]


@pytest.fixture(scope="module")
def ten_metres_ahead() -> Recording:
    """A recording of a sensor 10 m ahead of the point that follows the track, which is not declared."""
    plan = scenario("slippery-line")
    run = simulate(replace(plan, imu=replace(plan.imu, lever_arm_m=(10.0, 0.0, 1.2))), seed=0, duration_s=TOTAL_S)
    return with_imu(run.recording, lever_arm_m=(0.0, 0.0, 0.0))


def with_imu(recording: Recording, **declared: object) -> Recording:
    imu = recording.description.imu.model_copy(update=declared)
    return replace(recording, description=recording.description.model_copy(update={"imu": imu}))


def test_mounting_is_said_in_words(ten_metres_ahead: Recording) -> None:
    recording = with_imu(ten_metres_ahead, lever_arm_sd_m=(5.0, 0.5, 1.0))
    (note,) = (one for one in smooth_states(recording, SmoothConfig()).findings if one.code == "mounting")
    assert "m behind the reference point" in note.message
    assert "lever_arm_m = [10." in str(note) or "lever_arm_m = [9." in str(note)
    assert "mount_rpy_deg" not in str(note)


def test_a_lever_arm_that_is_not_declared_contradicts_that(ten_metres_ahead: Recording) -> None:
    after = smooth_states(ten_metres_ahead, SmoothConfig())
    (finding,) = far(after)
    assert "m behind the reference point" in finding.message
    assert after.solution.states.mount[0, 2] == pytest.approx(-10.0, abs=0.5)


def test_the_turning_of_an_earth_that_is_not_declared_is_found() -> None:
    """At 35 degrees the Earth turns by 12.3 deg/h about north, and the line goes round in loops."""
    plan = scenario("mainline")
    assert isinstance(plan.driver, Service)
    plan = replace(plan, driver=replace(plan.driver, start_rest_s=20.0), effects=(effect("earth-undeclared", 35.0),))
    run = simulate(plan, seed=2, duration_s=TOTAL_S)
    after = smooth_states(run.recording, SmoothConfig())
    assert "the Earth turns about" in far(after)[0].message
    north = EARTH_RATE * np.cos(np.radians(35.0))
    assert np.linalg.norm(after.solution.states.imu[0, EARTH]) == pytest.approx(north, rel=0.15)


@pytest.fixture
def pulled_as_expected(monkeypatch: pytest.MonkeyPatch) -> None:
    """States of which only the mounting was moved: their residuals contradict that, as those of a solution do not."""
    monkeypatch.setattr("trackfg.smoothing.wide_priors.lasting_pull", lambda _, far: np.ones(len(far)))


@pytest.mark.usefixtures("pulled_as_expected")
def test_noise_beyond_the_model_leaves_the_mounting_as_known(smoothed: Callable[..., SmoothedStates]) -> None:
    run = smoothed("mainline", seed=0, duration_s=TOTAL_S)
    far_off = replace(run.solution.states, mount=run.solution.states.mount + np.array([0.0, 0.4, 0.0, 0.0, 0.0]))
    seen = replace(run, solution=replace(run.solution, states=far_off), residuals=noise_of_accel(1.0))
    noisy = replace(seen, residuals=noise_of_accel(3.0))
    assert mounting_sd(wide_priors(seen).problem)[1] == pytest.approx(0.4, rel=0.2)
    assert mounting_sd(wide_priors(noisy).problem)[1] == mounting_sd(run.declared)[1]


@pytest.mark.usefixtures("pulled_as_expected")
def test_a_mounting_with_which_no_line_could_be_climbed_is_not_believed(
    smoothed: Callable[..., SmoothedStates],
) -> None:
    run = smoothed("mainline", seed=0, duration_s=TOTAL_S)
    climbing = replace(run.solution.states, mount=run.solution.states.mount + np.array([0.4, 0.0, 0.0, 0.0, 0.0]))
    steep = replace(run, solution=replace(run.solution, states=climbing), residuals=noise_of_accel(1.0))
    assert mounting_sd(wide_priors(steep).problem)[0] == mounting_sd(run.declared)[0]


@pytest.mark.usefixtures("pulled_as_expected")
def test_a_point_outside_of_every_vehicle_is_not_believed(smoothed: Callable[..., SmoothedStates]) -> None:
    run = smoothed("mainline", seed=0, duration_s=TOTAL_S)
    believed = []
    for up_m in (3.0, 5.0):
        moved = replace(run.solution.states, mount=run.solution.states.mount + np.array([0.0, 0.0, 0.0, 0.0, up_m]))
        seen = replace(run, solution=replace(run.solution, states=moved), residuals=noise_of_accel(1.0))
        believed.append(mounting_sd(wide_priors(seen).problem)[4] > 2.0 * mounting_sd(run.declared)[4])
    assert believed == [True, False]


@pytest.mark.parametrize(("off", "code"), [(0.0028, "far-from-prior-imu"), (0.1, "calibration-impossible")])
def test_a_scale_that_no_sensor_has_is_none_to_declare(
    smoothed_in_full: Callable[..., SmoothedStates], monkeypatch: pytest.MonkeyPatch, off: float, code: str
) -> None:
    monkeypatch.setattr("trackfg.smoothing.wide_priors.without_noise", lambda *_, contradicted: None)
    run = smoothed_in_full("mainline", seed=0, duration_s=TOTAL_S)
    imu = run.solution.states.imu.copy()
    imu[0, ACCEL_Y_SCALE] += off
    seen = replace(run, solution=replace(run.solution, states=replace(run.solution.states, imu=imu)))
    judged = wide_priors(replace(seen, residuals=noise_of_accel(1.0)))
    (finding,) = (one for one in judged.findings if "the scale of the accelerometer's y axis" in one.message)
    assert finding.code == code
    assert ("declare accel_scale_sd" in str(finding.hint)) == (code == "far-from-prior-imu")
    assert [doubt.quantities[0] for doubt in judged.doubts] == ["roll"] * (code == "calibration-impossible")


def noise_of_accel(ratio: float) -> dict[str, Residuals]:
    """Residuals of the accelerometer that are ``ratio`` times their sigmas."""
    return {"accel": Residuals(np.arange(100), np.full((100, 3), ratio), np.ones((100, 3)))}


def mounting_sd(problem: Problem) -> np.ndarray:
    prior = family_of(problem.families, FactorType.PRIOR_MOUNT)
    assert prior is not None
    return prior.sigma[0]
