"""The path factor: zero on a path whose attitude changes, blind to a steady gyro bias, its noise counted once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from trackfg.factors.bias import OF_GYRO_RATE
from trackfg.factors.family import Family
from trackfg.factors.motion import mount_matrix
from trackfg.factors.path import follows_path
from trackfg.factors.states import Kind, Nav, Odo, States
from trackfg.numerics.rotations import matrix_from_rpy, so3_exp
from trackfg.sensors.imu_intervals import Intervals, turning

RATE_HZ, FINE = 200.0, 20
LEVER = np.array([1.2, -0.3, 0.9])
MOUNT = np.array([[0.004, -0.006, 0.0, 0.0, 0.0]])


def wobbly(duration_s: float, speed_mps: float) -> tuple[Intervals, np.ndarray, Nav]:
    """A vehicle whose sensor looks where it goes, over a track that bends and twists all the way, gathering speed.

    Gives the samples (constant rates), the distance at their edges, and the states at both ends: the reference point
    moves along the direction of travel, the sensor is LEVER from it, and everything is integrated 20 times finer than
    the samples.
    """
    n = round(duration_s * RATE_HZ)
    t = (np.arange(n) + 0.5) / RATE_HZ
    gyro = np.stack([0.10 * np.sin(9 * t), 0.05 * np.cos(7 * t + 1), 0.06 + 0.04 * np.sin(11 * t)], axis=1)
    dt = 1.0 / (RATE_HZ * FINE)
    start = matrix_from_rpy(np.array([0.05]), np.array([-0.02]), np.array([0.7]))[0]
    R, q, s = start, np.zeros(3), 0.0
    forward, distance = mount_matrix(MOUNT)[0][:, 0], [0.0]
    for i in range(n):
        half, whole = (so3_exp(gyro[i : i + 1] * share * dt)[0] for share in (0.5, 1.0))
        for j in range(FINE):
            step = speed_mps * (1.0 + 0.3 * (i * FINE + j + 0.5) * dt) * dt
            q, s = q + R @ half @ forward * step, s + step
            R = R @ whole
        distance.append(s)
    ends = np.stack([start, R])
    p = np.stack([np.zeros(3), q]) + ends @ LEVER
    samples = Intervals(np.arange(n + 1) / RATE_HZ, gyro, np.zeros((n, 3)), np.zeros(n, dtype=bool))
    return samples, np.array(distance), Nav(ends, p, np.zeros((2, 3)))


def states(nav: Nav, mount: np.ndarray = MOUNT) -> States:
    n = len(nav)
    return States(nav, np.zeros((n, 6)), Odo(np.zeros((n, 4))), mount, np.zeros((1, 3)), np.zeros((1, Kind.IMU.dim)))


def factor(samples: Intervals, distance: np.ndarray, keyframes: np.ndarray, lever: np.ndarray = LEVER) -> Family:
    turned = turning(samples, keyframes, np.zeros(3), distance)
    first = np.arange(len(keyframes) - 1)
    sigma = np.ones((first.size, 2))
    return follows_path(first, turned.turn, turned.mean, turned.mean_by_time, lever, sigma, None)


def ends(samples: Intervals) -> np.ndarray:
    return np.array([0, len(samples)])


@pytest.mark.parametrize("speed_mps", [0.9, 20.0, -20.0], ids=["slow", "fast", "backwards"])
@pytest.mark.parametrize("duration_s", [0.2, 1.0])
def test_residual_is_zero_where_the_sensor_follows_the_track(duration_s: float, speed_mps: float) -> None:
    """To a few micrometres over 20 m: the trapezoid at 200 Hz."""
    samples, distance, nav = wobbly(duration_s, speed_mps)
    assert np.abs(factor(samples, distance, ends(samples)).residual(states(nav))).max() < 3e-6
    # Without the detail between the keyframes it would be centimetres: half the turn times the length.
    chord = np.einsum("ij,j->i", nav.R[0].T, (nav.p - nav.R @ LEVER)[1])
    if abs(speed_mps * duration_s) > 15.0:
        assert np.abs(chord[1:]).max() > 0.1


def test_residual_is_how_far_the_sensor_left_the_path() -> None:
    """Shifted sideways or upwards, in metres, positive to the left and upwards."""
    samples, distance, nav = wobbly(1.0, 20.0)
    aside = nav.p.copy()
    aside[1] += nav.R[0] @ [0.0, 3e-3, -2e-3]
    shifted = factor(samples, distance, ends(samples)).residual(states(Nav(nav.R, aside, nav.v)))
    np.testing.assert_allclose(shifted, [[3e-3, -2e-3]], atol=5e-6)


def test_wrong_mounting_shows_as_an_angle_along_the_whole_length() -> None:
    samples, distance, nav = wobbly(1.0, 20.0)
    askew = MOUNT + np.array([[0.0, 1e-3, 0.0, 0.0, 0.0]])
    residual = factor(samples, distance, ends(samples)).residual(states(nav, askew))[0]
    assert residual[0] == pytest.approx(-1e-3 * distance[-1], rel=0.02)


@pytest.mark.parametrize("axis", range(3))
def test_steady_bias_is_not_seen(axis: int) -> None:
    """The end's attitude closes the gyro's error, spread as a constant bias would be. What is left is of second order.

    As the gyro says, uncorrected, the path would bend by half of bias times time over its length: 10 mm.
    """
    samples, distance, nav = wobbly(1.0, 20.0)
    bias = 1e-3 * np.eye(3)[axis]
    biased = Intervals(samples.edges, samples.gyro + bias, samples.accel, samples.bridged)
    residual = factor(biased, distance, ends(samples)).residual(states(nav))
    bend = 0.5 * 1e-3 * 1.0 * distance[-1]
    assert np.abs(residual).max() < 0.02 * bend


@pytest.mark.parametrize("row", range(3))
def test_axes_of_the_gyro_that_are_not_square_are_no_direction_of_travel(row: int) -> None:
    """What the gyro adds of its rates is taken out of the path in between, too: of second order is what is left."""
    samples, distance, nav = wobbly(1.0, 20.0)
    W = np.zeros((3, 3))
    W[row] = [0.01, -0.008, 0.006]
    askew = Intervals(samples.edges, samples.gyro @ (np.eye(3) + W).T, samples.accel, samples.bridged)
    family, known = factor(askew, distance, ends(samples)), states(nav)
    known.imu[0, OF_GYRO_RATE] = W.ravel()
    left, without = (np.abs(family.residual(one)).max() for one in (known, states(nav)))
    assert left < 1e-4
    if row > 0:  # about the direction of travel itself a turn bends no path
        assert without > 3.0 * left


def test_noise_of_the_gyro_leaves_a_bridge_that_is_independent_of_the_turn() -> None:
    """White noise of density N: N^2 L^2 T / 12 in each direction, and no correlation with the error at the end."""
    noise, duration, length, runs = 1e-3, 0.5, 8.0, 4000
    per = round(duration * RATE_HZ)
    n = runs * per
    gyro = noise * np.sqrt(RATE_HZ) * np.random.default_rng(0).standard_normal((n, 3))
    samples = Intervals(np.arange(n + 1) / RATE_HZ, gyro, np.zeros((n, 3)), np.zeros(n, dtype=bool))
    distance = length / per * np.arange(n + 1)
    p = np.zeros((runs + 1, 3))
    p[:, 0] = length * np.arange(runs + 1)
    nav = Nav(np.tile(np.eye(3), (runs + 1, 1, 1)), p, np.zeros((runs + 1, 3)))
    family = factor(samples, distance, np.arange(0, n + 1, per), np.zeros(3))
    residual = family.residual(states(nav, np.zeros((1, 5))))
    expected = noise * length * np.sqrt(duration / 12.0)
    np.testing.assert_allclose(residual.std(axis=0), expected, rtol=4.0 / np.sqrt(2 * runs))
    turned = gyro.reshape(runs, per, 3).sum(axis=1)
    for row, axis in ((0, 2), (1, 1)):
        assert abs(np.corrcoef(residual[:, row], turned[:, axis])[0, 1]) < 4.0 / np.sqrt(runs)


@pytest.mark.parametrize("size", [0.0, 1e-8, 1e-3, 0.5, 3.0])
def test_the_kernel_compares_turns_with_steady_ones_as_numpy_does(
    size: float, with_both: Callable[[Callable[[], Any]], tuple[Any, Any]]
) -> None:
    random = np.random.default_rng(1)
    turn = so3_exp(size * random.normal(size=(4, 3)) / np.sqrt(3.0))
    mean = np.mean(so3_exp(0.5 * size * random.normal(size=(5, 4, 3))), axis=0)  # no rotation
    by_time = 0.5 * np.eye(3) + 0.1 * size * random.normal(size=(4, 3, 3))
    first = np.arange(4)

    def ahead() -> np.ndarray:
        path = follows_path(first, turn, mean, by_time, np.zeros(3), np.ones((4, 2)), None)
        return path.data["ahead"]

    ours, theirs = with_both(ahead)
    np.testing.assert_allclose(ours, theirs, atol=1e-12)
