"""The trajectory table: its quantities, and its sigmas against numerical propagation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackfg.factors.bias import response_terms
from trackfg.factors.motion import mount_matrix
from trackfg.factors.states import (
    ELIMINATION_ORDER,
    KEYFRAME_DIM,
    SHARED,
    SHARED_DIM,
    Kind,
    Nav,
    Odo,
    States,
    offset_in_keyframe,
    retract,
)
from trackfg.numerics.rotations import matrix_from_rpy, rpy_from_matrix
from trackfg.output.calibration import calibration_table
from trackfg.output.dense_motion import DenseMotion
from trackfg.output.trajectory import (
    QUANTITIES,
    keyframe_jacobian,
    keyframe_variances,
    trajectory_table,
)
from trackfg.sensors.imu_noise.white_noise import WhiteNoise
from trackfg.solver.covariance import Covariance

N = 7
GYRO, ACCEL = 1e-3, 0.1
LEVER = np.array([1.5, -0.4, 0.8])
RUN: Any = SimpleNamespace(
    t=2.0 * np.arange(N),
    lever_arm=LEVER,
    noise=WhiteNoise.alike(GYRO, ACCEL, N - 1),
    mount_roll_sd=0.0,
    direction=1,
)
DIM = KEYFRAME_DIM + SHARED_DIM


@pytest.fixture(scope="module")
def gyro() -> np.ndarray:
    return np.random.default_rng(7).normal(size=(N, 3)) * 0.1


@pytest.fixture(scope="module")
def states(gyro: np.ndarray) -> States:
    """A vehicle on rails: what moves at the reference point moves along the direction of travel."""
    rng = np.random.default_rng(3)
    mount = np.array([[0.03, -0.05, 0.0, 0.0, 0.0]])
    R = matrix_from_rpy(0.1 * rng.normal(size=N), 0.05 * rng.normal(size=N), rng.uniform(-3, 3, N))
    forward = mount_matrix(mount)[0][:, 0]
    body = rng.uniform(5, 20, (N, 1)) * forward + np.cross(gyro, LEVER)
    nav = Nav(R, 50 * rng.normal(size=(N, 3)), np.einsum("mij,mj->mi", R, body))
    odo = Odo.of(np.cumsum(rng.uniform(5, 10, N)), np.full(N, 1.01), np.zeros(N), np.zeros(N))
    return States(nav, 0.01 * rng.normal(size=(N, 6)), odo, mount, np.zeros((1, 3)), np.zeros((1, Kind.IMU.dim)))


def with_marginals(marginal: np.ndarray) -> Covariance:
    """Keyframes with these marginals (N, DIM, DIM), which do not correlate."""
    dim = KEYFRAME_DIM
    return Covariance(marginal[:, :dim], marginal[0, dim:, dim:], np.zeros((N - 1, DIM, DIM)))


@pytest.fixture(scope="module")
def covariance() -> Covariance:
    rng = np.random.default_rng(5)
    root = 0.01 * rng.normal(size=(N, DIM, DIM + 4))
    root[:, KEYFRAME_DIM:] = root[0, KEYFRAME_DIM:]  # one covariance of what all keyframes share
    return with_marginals(root @ np.swapaxes(root, 1, 2))


def at_keyframes(states: States, gyro: np.ndarray) -> DenseMotion:
    """Rows whose body rates have no noise."""
    keyframe = np.append(np.arange(N - 1), N - 2)
    fraction = np.append(np.zeros(N - 1), 1.0)
    forward = mount_matrix(states.mount)[0, :, 0]
    return DenseMotion(
        np.arange(float(N)), states.nav, states.odo.distance, gyro, np.full(N, np.inf), keyframe, fraction, forward
    )


def quantities(states: States, gyro: np.ndarray, covariance: Covariance, direction: int = 1) -> pd.DataFrame:
    return trajectory_table(
        SimpleNamespace(**{**vars(RUN), "direction": direction}), at_keyframes(states, gyro), states, covariance
    )


def moved(states: States, column: int, step: float) -> States:
    """Every keyframe moved along one direction of the stacked tangent (shared variables last)."""
    delta = np.zeros(DIM)
    delta[column] = step
    parts, start = {}, 0
    for kind in (*ELIMINATION_ORDER, *SHARED):
        rows = 1 if kind.shared else N
        parts[kind] = retract(states.of(kind), np.tile(delta[start : start + kind.dim], (rows, 1)))
        start += kind.dim
    return States(*(parts[kind] for kind in (Kind.NAV, Kind.BIAS, Kind.ODO, *SHARED)))  # type: ignore[arg-type]


@pytest.mark.usefixtures("kernels")
def test_sigmas_equal_numerical_propagation(states: States, gyro: np.ndarray, covariance: Covariance) -> None:
    step = 1e-6
    J = np.zeros((N, len(QUANTITIES), DIM))
    for column in range(DIM):
        ahead, behind = (
            quantities(moved(states, column, sign * step), gyro, covariance)[list(QUANTITIES)].to_numpy()
            for sign in (1, -1)
        )
        J[:, :, column] = (ahead - behind) / (2 * step)
    numeric = np.einsum("nij,njk,nik->ni", J, covariance.marginal, J)
    at_rest = J.copy()
    at_rest[:, 4, KEYFRAME_DIM + 2 : KEYFRAME_DIM + 5] = 0.0  # where nothing turns, all points have one speed
    without_turning = np.einsum("nij,njk,nik->ni", at_rest, covariance.marginal, at_rest)
    np.testing.assert_allclose(keyframe_variances(states, covariance, LEVER), without_turning, rtol=1e-6)
    table = quantities(states, gyro, covariance)
    np.testing.assert_allclose(table[[f"{q}_sd" for q in QUANTITIES]].to_numpy(), np.sqrt(numeric), rtol=1e-6)


@pytest.mark.usefixtures("kernels")
def test_variance_is_interpolated_between_keyframes(states: States, gyro: np.ndarray, covariance: Covariance) -> None:
    variance = keyframe_variances(states, covariance, LEVER)
    keyframes = replace(at_keyframes(states, gyro), gyro=np.zeros((N, 3)))
    shifted = replace(keyframes, fraction=np.append(np.full(N - 1, 0.25), 1.0))
    table = trajectory_table(RUN, shifted, states, covariance)
    expected = 0.75 * variance[:-1] + 0.25 * variance[1:]
    # What the white noise of the samples adds at a quarter of 2 s: a Brownian bridge; to places its pinned integral,
    # and what the speeds at both ends do to the cubic between them.
    bridge, swing = 2.0 * 0.25 * 0.75, (2.0 * 0.25 * 0.75) ** 2
    speeds = swing * (0.75**2 * variance[:-1, 4] + 0.25**2 * variance[1:, 4])
    expected[:, :4] += (ACCEL**2 * bridge**3 / 3.0 + speeds)[:, None]
    expected[:, 4] += ACCEL**2 * 2.0 * 0.25 * 0.75
    expected[:, 5:] += GYRO**2 * 2.0 * 0.25 * 0.75
    np.testing.assert_allclose(table[[f"{q}_sd" for q in QUANTITIES]].to_numpy()[:-1] ** 2, expected, rtol=1e-12)


@pytest.mark.usefixtures("kernels")
def test_speed_has_the_noise_of_its_row_s_body_rate(states: States, gyro: np.ndarray) -> None:
    rng, span = np.random.default_rng(11), 0.02
    certain = with_marginals(np.zeros((N, DIM, DIM)))
    drawn = gyro + GYRO / np.sqrt(span) * rng.normal(size=(1000, N, 3))
    motions = [replace(at_keyframes(states, rate), gyro_span=np.full(N, span)) for rate in drawn]
    tables = [trajectory_table(RUN, motion, states, certain) for motion in motions]
    scatter = np.std([table["speed_mps"] for table in tables], axis=0)
    np.testing.assert_allclose(tables[0]["speed_mps_sd"], scatter, rtol=0.06)


def test_the_kernel_differentiates_as_numpy_does(
    states: States, with_both: Callable[[Callable[[], Any]], tuple[Any, Any]]
) -> None:
    ours, theirs = with_both(lambda: keyframe_jacobian(states, LEVER))
    np.testing.assert_allclose(ours, theirs, atol=1e-13)


def test_the_kernel_makes_rows_as_numpy_does(
    states: States, gyro: np.ndarray, covariance: Covariance, with_both: Callable[[Callable[[], Any]], tuple[Any, Any]]
) -> None:
    """Of rows between keyframes, of noise that differs by axis and interval, of chainage that falls."""
    random, at = np.random.default_rng(3), at_keyframes(states, gyro)
    k, fraction = np.array([0, 0, 2, 4, 5, 5]), np.array([0.0, 0.3, 0.5, 0.9, 0.2, 1.0])
    motion = DenseMotion(
        k + fraction, at.nav[:6], at.distance[:6], gyro[:6], np.full(6, 0.02), k, fraction, np.array([1.0, 0.0, 0.0])
    )
    noise = WhiteNoise(1e-3 * random.uniform(1.0, 2.0, (N - 1, 3)), random.uniform(0.1, 0.2, (N - 1, 3)))
    run: Any = SimpleNamespace(**{**vars(RUN), "noise": noise, "direction": -1})
    ours, theirs = with_both(lambda: trajectory_table(run, motion, states, covariance))
    pd.testing.assert_frame_equal(ours, theirs, rtol=1e-10, atol=1e-12)


@pytest.mark.usefixtures("kernels")
def test_unknown_roll_of_the_mounting_is_in_the_sigma_of_roll_alone(
    states: States, gyro: np.ndarray, covariance: Covariance
) -> None:
    surveyed = quantities(states, gyro, covariance)
    unsure: Any = SimpleNamespace(**{**vars(RUN), "mount_roll_sd": 2e-3})
    unknown = trajectory_table(unsure, at_keyframes(states, gyro), states, covariance)
    np.testing.assert_allclose(unknown["roll_rad_sd"], np.hypot(surveyed["roll_rad_sd"], 2e-3))
    pd.testing.assert_frame_equal(unknown.drop(columns="roll_rad_sd"), surveyed.drop(columns="roll_rad_sd"))


@pytest.mark.usefixtures("kernels")
def test_place_is_that_of_the_reference_point_and_speed_that_of_the_point_on_the_track(
    states: States, gyro: np.ndarray, covariance: Covariance
) -> None:
    """The vehicle turns about a point 3 m behind the reference point and 1 m below it."""
    point = np.array([-3.0, 0.2, -1.0])
    swinging = replace(states, mount=np.concatenate([states.mount[:, :2], point[None]], axis=1))
    table = quantities(swinging, gyro, covariance)
    reference = states.nav.p - states.nav.R @ LEVER
    np.testing.assert_allclose(table[["east_m", "north_m", "up_m"]].to_numpy(), reference)
    body = np.einsum("mji,mj->mi", states.nav.R, states.nav.v) + np.cross(gyro, point - LEVER)
    np.testing.assert_allclose(table["speed_mps"], body @ mount_matrix(states.mount)[0][:, 0])


@pytest.mark.usefixtures("kernels")
def test_backing_up_is_negative_speed(states: States, gyro: np.ndarray, covariance: Covariance) -> None:
    backwards = replace(states, nav=replace(states.nav, v=-states.nav.v))
    assert (quantities(backwards, -gyro, covariance)["speed_mps"] < 0).all()


@pytest.mark.usefixtures("kernels")
def test_attitude_is_that_of_the_vehicle_not_of_the_sensor(
    states: States, gyro: np.ndarray, covariance: Covariance
) -> None:
    """A sensor mounted 30 mrad nose-down and 50 mrad to the right sees the vehicle turned the other way."""
    rpy = quantities(states, gyro, covariance)[["roll_rad", "pitch_rad", "yaw_rad"]].to_numpy()
    R_bt = mount_matrix(states.mount)[0]
    np.testing.assert_allclose(rpy, rpy_from_matrix(states.nav.R @ R_bt), atol=1e-12)
    level = replace(states, nav=replace(states.nav, R=np.tile(np.eye(3), (N, 1, 1))))
    turned = quantities(level, gyro, covariance)
    np.testing.assert_allclose(turned["pitch_rad"], 0.03)
    np.testing.assert_allclose(turned["yaw_rad"], -0.05)
    assert (np.abs(rpy[:, 2]) <= np.pi).all()


@pytest.mark.usefixtures("kernels")
def test_falling_chainage(states: States, gyro: np.ndarray, covariance: Covariance) -> None:
    up, down = (quantities(states, gyro, covariance, direction) for direction in (1, -1))
    np.testing.assert_array_equal(down["chainage_m"], -up["chainage_m"])
    assert (np.diff(down["chainage_m"]) < 0).all()
    pd.testing.assert_frame_equal(up.drop(columns="chainage_m"), down.drop(columns="chainage_m"))


def test_calibration_interpolates_values_and_variances(states: States, covariance: Covariance) -> None:
    half = np.append(0.5 * (RUN.t[1:] + RUN.t[:-1]), RUN.t[-1])
    response = response_terms(*np.random.default_rng(8).normal(size=(3, N, 3)), states.nav.R, states.nav.v)
    response[-1] = 0.0
    found = replace(states, imu=1e-3 * np.random.default_rng(9).normal(size=(1, Kind.IMU.dim)))
    table = calibration_table(half, RUN.t, response, found, covariance)
    pd.testing.assert_frame_equal(
        calibration_table(half[-2:], RUN.t, response, found, covariance), table.tail(2).reset_index(drop=True)
    )
    np.testing.assert_allclose(table["wheel_scale"], 1.01)
    # The sensor's own bias is what the calibration does not explain of the interval's.
    own = states.bias - np.einsum("nij,j->ni", response, found.imu[0])
    middle = 0.5 * (own[1:] + own[:-1])
    columns = [f"accel_bias_{a}_mps2" for a in "xyz"] + [f"gyro_bias_{a}_radps" for a in "xyz"]
    np.testing.assert_allclose(table[columns].to_numpy()[:-1], middle)
    np.testing.assert_allclose(table[columns].to_numpy()[-1], states.bias[-1])
    J = np.zeros((N, 6, DIM))
    bias, imu = offset_in_keyframe(Kind.BIAS), offset_in_keyframe(Kind.IMU)
    J[:, :, bias : bias + 6], J[:, :, imu : imu + Kind.IMU.dim] = np.eye(6), -response
    variance = np.diagonal(J @ covariance.marginal @ np.swapaxes(J, 1, 2), axis1=1, axis2=2)
    sd = table[[f"{c}_sd" for c in columns]].to_numpy()
    np.testing.assert_allclose(sd[:-1] ** 2, 0.5 * (variance[1:] + variance[:-1]))
    np.testing.assert_allclose(table["wheel_scale_sd"].iloc[-1] ** 2, covariance.of(Kind.ODO)[-1, 1, 1])
