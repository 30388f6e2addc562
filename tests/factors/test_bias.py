"""The bias walk: what the calibration explains of a changing bias, and only that."""

from __future__ import annotations

import numpy as np

from trackfg.factors.bias import EARTH, bias_walk, response_sigmas, response_terms
from trackfg.factors.family import Family
from trackfg.factors.states import Kind, Nav, Odo, States
from trackfg.numerics.rotations import so3_exp
from trackfg.numerics.units import STANDARD_GRAVITY

N = 5
RNG = np.random.default_rng(0)
FORCE = RNG.normal([0.3, -0.5, 9.8], 0.5, (N, 3))
RATE = RNG.normal(0.0, 0.1, (N, 3))
POWER = RNG.uniform(0.0, 4.0, (N, 3))
ATTITUDE = so3_exp(RNG.normal(size=(N, 3)))
VELOCITY = RNG.normal(0.0, 30.0, (N, 3))


def calibration(A: np.ndarray, W: np.ndarray, G: np.ndarray, k: np.ndarray, e: np.ndarray) -> np.ndarray:
    return np.concatenate([A.ravel(), W.ravel(), G.ravel(), k, e])[None]


def states(bias: np.ndarray, imu: np.ndarray) -> States:
    nav = Nav(np.tile(np.eye(3), (N, 1, 1)), np.zeros((N, 3)), np.zeros((N, 3)))
    return States(nav, bias, Odo(np.zeros((N, 4))), np.zeros((1, 5)), np.zeros((1, 3)), imu)


def walk() -> Family:
    change = np.diff(response_terms(FORCE, RATE, POWER, ATTITUDE, VELOCITY), axis=0)
    return bias_walk(np.arange(N - 1), change, np.ones((N - 1, 6)))


def test_a_constant_bias_of_a_scaled_and_misaligned_sensor_costs_nothing() -> None:
    A, W, G, k = RNG.normal(size=(3, 3)), RNG.normal(size=(3, 3)), RNG.normal(size=(3, 2)), RNG.normal(size=3)
    own, e = RNG.normal(size=6), RNG.normal(size=2)
    coriolis = np.einsum("nji,nj->ni", ATTITUDE, 2.0 * np.cross(np.append(e, 0.0), VELOCITY))
    accel = own[:3] + (FORCE - [0.0, 0.0, STANDARD_GRAVITY]) @ A.T + k * POWER + coriolis
    earth = np.einsum("nji,j->ni", ATTITUDE, np.append(e, 0.0))
    seen = np.concatenate([accel, own[3:] + RATE @ W.T + FORCE[:, :2] @ G.T + earth], axis=1)
    family = walk()
    assert np.abs(family.residual(states(seen, calibration(A, W, G, k, e)))).max() < 1e-12
    # Taken for a perfect sensor, its bias would have walked.
    blind = family.residual(states(seen, np.zeros((1, Kind.IMU.dim))))
    np.testing.assert_allclose(blind, np.diff(seen, axis=0))


def test_what_the_calibration_does_not_explain_is_the_walk() -> None:
    own = RNG.normal(size=(N, 6))
    residual = walk().residual(states(own, np.zeros((1, Kind.IMU.dim))))
    np.testing.assert_allclose(residual, np.diff(own, axis=0))


def test_scale_factors_are_on_the_diagonal_and_gravity_on_z_is_a_bias() -> None:
    """A turn about z reaches the gyro's z by its scale factor, its x and y by misalignments; gravity is in no term."""
    pull, scale, askew, sensed, rectified = 1e-3, 2e-3, 6e-4, 1e-5, 5e-3
    turning = 3e-5
    sigma = response_sigmas(pull, scale, askew, sensed, rectified, turning)
    assert sigma.shape == (Kind.IMU.dim,)

    def spread(force: list[float], rate: list[float], power: list[float]) -> np.ndarray:
        motion = (np.add([force], [0.0, 0.0, STANDARD_GRAVITY]), np.array([rate]), np.array([power]))
        terms = response_terms(*motion, np.eye(3)[None], np.zeros((1, 3)))[0]
        earth = [0.0, 0.0, 0.0, turning, turning, 0.0]  # about the level axes of a level body
        return np.sqrt((terms**2) @ sigma**2 - np.square(earth))

    np.testing.assert_allclose(spread([0, 0, 0], [0, 0, 1], [0, 0, 0]), [0, 0, 0, askew, askew, scale], atol=1e-15)
    np.testing.assert_allclose(
        spread([1, 0, 0], [0, 0, 0], [0, 0, 0]), [pull, askew, askew, sensed, sensed, sensed], atol=1e-12
    )
    np.testing.assert_allclose(
        spread([0, 1, 0], [0, 0, 0], [0, 0, 0]), [askew, pull, askew, sensed, sensed, sensed], atol=1e-12
    )
    np.testing.assert_allclose(spread([0, 0, 0], [0, 0, 0], [0, 2, 0]), [0, 2 * rectified, 0, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(spread([0, 0, 1], [0, 0, 0], [0, 0, 0]), [askew, askew, pull, 0, 0, 0], atol=1e-12)
    assert not spread([0, 0, 0], [0, 0, 0], [0, 0, 0]).any()


def test_a_train_to_the_east_is_lighter_where_the_earth_turns_about_the_north() -> None:
    """Eotvos: at 30 m/s and 6e-5 rad/s it is 3.6e-3 m/s^2, upwards on the train that the accelerometer pushes less."""
    terms = response_terms(*np.zeros((3, 1, 3)), np.eye(3)[None], np.array([[30.0, 0.0, 0.0]]))[0]
    calibration_of_earth = np.zeros(Kind.IMU.dim)
    calibration_of_earth[EARTH] = [0.0, 6e-5]
    np.testing.assert_allclose(terms @ calibration_of_earth, [0.0, 0.0, -3.6e-3, 0.0, 6e-5, 0.0], atol=1e-18)
