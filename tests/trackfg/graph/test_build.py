"""What a recording becomes: keyframes, factors, initial values; what is refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.faults import drop_imu, drop_tach
from trackfg.datasets.scenarios import Simulation
from trackfg.errors import UnsolvableError
from trackfg.factors.bias import OF_ACCELEROMETER, OF_GYRO, OF_GYRO_RATE
from trackfg.factors.factor_type import FactorType
from trackfg.factors.states import Kind, Nav, Odo, States
from trackfg.graph.build import Problem, build_problem
from trackfg.numerics.geodesy import earth_rate_enu, normal_gravity
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.recording.model import Recording
from trackfg.sensors.imu_intervals import increment_starts


def problem_of(recording: Recording) -> Problem:
    return build_problem(recording, SmoothConfig())


@pytest.fixture(scope="module")
def run(simulated: Callable[..., Simulation]) -> Simulation:
    return simulated("mainline-gnss", seed=1, duration_s=120.0)


@pytest.fixture(scope="module")
def problem(run: Simulation) -> Problem:
    return problem_of(run.recording)


def truth_at(run: Simulation, problem: Problem) -> States:
    t = problem.t
    R = run.ride.rotation(t)
    v = R[:, :, 0] * run.ride.motion.speed(t)[:, None]
    distance = run.ride.motion.distance(t) - run.ride.motion.distance(t[0])
    nav = Nav(R, run.ride.position(t), v)
    count = np.zeros(len(t)) if problem.wheel is None else problem.wheel.at(t)
    odo = Odo.of(distance, np.ones(len(t)), count, np.diff(distance, prepend=distance[0]))
    return States(nav, np.zeros((len(t), 6)), odo, np.zeros((1, 5)), np.zeros((1, 3)), np.zeros((1, Kind.IMU.dim)))


@pytest.mark.parametrize("name", ["mainline", "mainline-gnss", "shunting"])
def test_truth_of_a_noise_free_run_costs_nothing(simulated: Callable[..., Simulation], name: str) -> None:
    """Every factor's residual is far below its sigma at the truth; the inertial ones below a sigma in all."""
    run = simulated(name, seed=1, duration_s=150.0, noise=False)
    problem = problem_of(run.recording)
    states = truth_at(run, problem)
    assert problem.native.error(states.to_gtsam()) < 1e-2 * 7.5 * len(problem.t)
    for family in problem.families:
        if family.type in (FactorType.PRIOR_ODO, FactorType.ABSOLUTE_FIX):
            continue  # their origin of distance is the first fix
        # The yaw of the start is 0 to 1e-6 rad by convention, about an axis that is as rough as the roll there.
        assert np.abs(family.whitened(states)).max() < (5.0 if family.type is FactorType.PRIOR_NAV else 0.5), (
            family.name
        )


def test_keyframes_lie_on_edges_of_the_samples(problem: Problem) -> None:
    np.testing.assert_array_equal(problem.t, problem.run.inertial.edges[problem.run.edges])
    assert (np.diff(problem.t) > 0).all()
    assert problem.run.edges[0] == 0
    assert problem.run.edges[-1] == len(problem.run.inertial)


def test_every_position_has_its_keyframe(run: Simulation, problem: Problem) -> None:
    assert run.recording.gnss is not None
    family = problem.family(FactorType.GNSS_POSITION)
    assert family is not None
    moving = run.recording.gnss["t_s"].to_numpy()
    moving = moving[moving > problem.rests[0, 1]]
    assert np.abs(problem.t[:, None] - moving).min(axis=0).max() <= 0.5 / 200.0 + 1e-9
    assert len(family) == len(run.recording.gnss)


def test_world_follows_from_the_recording(
    run: Simulation, problem: Problem, simulated: Callable[..., Simulation]
) -> None:
    np.testing.assert_allclose(problem.run.world.earth_rate, earth_rate_enu(35.2))
    assert problem.run.world.gravity == pytest.approx(normal_gravity(35.2))
    plain = problem_of(simulated("mainline", seed=1, duration_s=40.0).recording).run.world
    assert not plain.earth_rate.any()
    assert plain.gravity == STANDARD_GRAVITY
    track = run.recording.description.track.model_copy(update={"heading_deg": None})
    description = run.recording.description.model_copy(update={"track": track})
    unknown = problem_of(replace(run.recording, description=description, gnss_origin=None, gnss=None)).run.world
    # Where north is is not known: only the vertical part of the Earth's rate can be modelled.
    assert unknown.earth_rate[:2].tolist() == [0.0, 0.0]
    assert unknown.earth_rate[2] == pytest.approx(earth_rate_enu(35.2)[2])


def test_each_accelerometer_sample_is_counted_once(run: Simulation, problem: Problem) -> None:
    """Gravity tilt only where nothing measures speed; the inertial factors give the accelerometer no weight there."""
    assert problem.family(FactorType.GRAVITY_TILT) is None
    speedless = problem_of(replace(run.recording, tach=None, gnss=None))
    tilt = speedless.family(FactorType.GRAVITY_TILT)
    assert tilt is not None
    assert len(tilt) == len(speedless.t)
    push = speedless.initial
    faster = replace(push, nav=replace(push.nav, v=push.nav.v + np.arange(len(push))[:, None] * 0.1))
    # A change of speed of 0.1 m/s per keyframe costs nothing against sigmas of 1000 m/s/sqrt(s).
    values = [float(speedless.native.error(s.to_gtsam())) for s in (push, faster)]
    assert abs(values[1] - values[0]) < 1.0


def test_families_are_those_that_the_sensors_give(run: Simulation, problem: Problem) -> None:
    types = {family.type for family in problem.families}
    assert {
        FactorType.TACH_READING,
        FactorType.GNSS_POSITION,
        FactorType.NON_HOLONOMIC,
        FactorType.AT_REST,
        FactorType.STANDSTILL,
        FactorType.ARC_LENGTH,
    } <= types
    assert problem.family(FactorType.ABSOLUTE_FIX) is None
    blind = problem_of(replace(run.recording, tach=None))
    assert blind.family(FactorType.TACH_READING) is None
    assert blind.wheel is None


def test_silent_tach_reads_nothing_and_says_nothing(run: Simulation) -> None:
    """A slope across a silence of 40 s is no reading, and a straight line through it costs the wheel nothing."""
    problem = problem_of(drop_tach(run.recording, 60.0, 100.0))
    reading = problem.family(FactorType.TACH_READING)
    assert reading is not None
    at = problem.t[reading.slots[0].index]
    assert not ((at > 60.1) & (at < 99.9)).any()


def test_hole_in_the_imu_lies_between_keyframes(run: Simulation) -> None:
    problem = problem_of(drop_imu(run.recording, 70.0, 75.0))
    np.testing.assert_allclose(problem.gaps, [[70.0, 75.0]], atol=0.01)
    for time in (70.0, 75.0):
        assert np.abs(problem.t - time).min() < 0.01


def test_distances_before_the_first_fix(simulated: Callable[..., Simulation]) -> None:
    run = simulated("shunting", seed=0, duration_s=240.0)
    problem = problem_of(run.recording)
    fix = problem.family(FactorType.ABSOLUTE_FIX)
    assert fix is not None
    assert run.recording.fixes is not None
    np.testing.assert_allclose(fix.residual(problem.initial)[0], 0.0, atol=0.1)
    true = run.ride.motion.distance(problem.t)
    assert np.abs(problem.initial.odo.distance - true).max() < 2.0 + 0.03 * run.ride.motion.path(240.0)


@pytest.mark.parametrize("samples", [1, 5, 9, 60])
def test_too_short_a_record_is_refused(run: Simulation, samples: int) -> None:
    with pytest.raises(UnsolvableError, match=r"at least 10 samples and 0\.5 s are needed"):
        problem_of(replace(run.recording, imu=run.recording.imu.iloc[:samples]))


def test_a_simulation_is_no_recording(run: Simulation) -> None:
    with pytest.raises(TypeError, match=r"build_problem takes a recording, .* not Simulation"):
        problem_of(run)  # type: ignore[arg-type]


def test_rests_after_the_inertial_record_are_left_out(simulated: Callable[..., Simulation]) -> None:
    """Of a tach whose clock goes 60 times as fast from the second minute on, half the stops are after the record."""
    recording = simulated("shunting", seed=1, duration_s=200.0).recording
    assert recording.tach is not None
    t = recording.tach["t_s"].to_numpy(copy=True)
    t[t > 60.0] = 60.0 + 60.0 * (t[t > 60.0] - 60.0)
    problem = problem_of(replace(recording, tach=recording.tach.assign(t_s=t)))
    assert (np.diff(problem.rests, axis=1) > 0.0).all()


def test_positions_outside_the_record_are_left_out(run: Simulation) -> None:
    assert run.recording.gnss is not None
    gnss = run.recording.gnss.copy()
    gnss["t_s"] -= 20.5
    family = problem_of(replace(run.recording, gnss=gnss)).family(FactorType.GNSS_POSITION)
    assert family is not None
    assert len(family) == (gnss["t_s"] >= 0).sum()


def test_increments_start_at_keyframes_and_around_times(problem: Problem) -> None:
    times = np.array([12.3456, 50.0, 99.999])
    starts, first = increment_starts(problem.run.inertial, problem.run.edges, 0.02, times)
    assert (np.diff(starts) > 0).all()
    np.testing.assert_array_equal(starts[first], problem.run.edges)
    edges = problem.run.inertial.edges
    assert np.diff(edges[starts]).max() < 0.0201
    for time in times:
        k = np.searchsorted(edges[starts], time + 1e-9, side="right") - 1
        assert edges[starts[k]] <= time + 1e-9
        assert edges[starts[k + 1]] - edges[starts[k]] < 0.0051 or edges[starts[k]] == pytest.approx(time, abs=1e-9)


def test_bias_variables_follow_the_rest(run: Simulation, problem: Problem) -> None:
    bias = problem.initial.of(Kind.BIAS)
    assert isinstance(bias, np.ndarray)
    true = run.truth[[f"gyro_bias_{axis}_radps" for axis in "xyz"]].iloc[0].to_numpy()
    assert np.abs(bias[0, 3:] - true).max() < 1e-4


def test_large_biases_make_the_calibration_as_poor_at_most_ten_times(run: Simulation) -> None:
    recording = run.recording
    imu = recording.imu.assign(fz_mps2=recording.imu["fz_mps2"] + 0.15)
    good, poor = (build_problem(one, SmoothConfig()) for one in (recording, replace(recording, imu=imu)))
    np.testing.assert_array_equal(good.imu_grade, 1.0)
    np.testing.assert_array_equal(poor.imu_grade[OF_GYRO], 1.0)  # the gyro is as good as it was
    np.testing.assert_array_equal(poor.imu_grade[OF_ACCELEROMETER], poor.imu_grade[0])
    assert poor.imu_grade[0] == pytest.approx(0.15 / recording.description.imu.noise.accel_bias_sd, rel=0.4)
    sigmas = [family.sigma[0] for family in (one.family(FactorType.PRIOR_IMU) for one in (good, poor)) if family]
    assert sigmas[1][0] == pytest.approx(poor.imu_grade[0] * sigmas[0][0])
    awful = replace(recording, imu=recording.imu.assign(fz_mps2=recording.imu["fz_mps2"] + 2.0))
    assert build_problem(awful, SmoothConfig()).imu_grade[0] == 10.0


def test_a_bias_of_another_kind_of_sensor_makes_both_triads_as_poor(run: Simulation) -> None:
    recording = run.recording
    declared = recording.description.imu.noise
    problems = []
    for times in (6.0, 15.0):  # the worst of one kind are ten times as poor as the typical ones
        imu = recording.imu.assign(fz_mps2=recording.imu["fz_mps2"] + times * declared.accel_bias_sd)
        problems.append(build_problem(replace(recording, imu=imu), SmoothConfig()))
    worst, of_another_kind = (problem.imu_grade for problem in problems)
    assert worst[OF_ACCELEROMETER].min() > 1.0
    np.testing.assert_array_equal(worst[OF_GYRO], 1.0)
    np.testing.assert_array_equal(of_another_kind[OF_ACCELEROMETER], 10.0)
    np.testing.assert_array_equal(of_another_kind[OF_GYRO], 10.0)
    axes, poor_axes = (problem.family(FactorType.PRIOR_IMU).sigma[0, OF_GYRO_RATE] for problem in problems)
    np.testing.assert_allclose(axes[[0, 1]], [declared.gyro_scale_sd, declared.misalignment_sd_rad])
    np.testing.assert_allclose(poor_axes[[0, 1]], [10.0 * declared.gyro_scale_sd, 0.01])  # 2 % across at most
