"""Sampled errors of points along the track: between keyframes they spread as the inertial noise makes them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trackfg.factors.motion import TRACKING_POINT
from trackfg.factors.states import KEYFRAME_DIM, SHARED_DIM, Kind, Nav, Odo, States, offset_in_keyframe
from trackfg.numerics.rotations import matrix_from_rpy
from trackfg.output.profile_samples import AngleErrors, PlaceErrors, PointErrors, Points, PosteriorErrors, Shifts
from trackfg.sensors.imu_noise.white_noise import WhiteNoise

COUNT = 4000
KEYFRAMES, INTERVAL_S = 4, 2.0
GYRO, ACCEL = 2e-4, 3e-3
RUN: Any = SimpleNamespace(t=INTERVAL_S * np.arange(KEYFRAMES), noise=WhiteNoise.alike(GYRO, ACCEL, KEYFRAMES - 1))
SILENT: Any = SimpleNamespace(t=RUN.t, noise=WhiteNoise.alike(1e-12, 1e-12, KEYFRAMES - 1))
TOLERANCE = 4.0 / np.sqrt(2 * COUNT)
NAV = offset_in_keyframe(Kind.NAV)
AHEAD = 0.4
"""The yaw of a straight run."""


def states() -> States:
    roll, yaw = np.full(KEYFRAMES, 0.1), np.full(KEYFRAMES, AHEAD)
    nav = Nav(matrix_from_rpy(roll, np.zeros(KEYFRAMES), yaw), np.zeros((KEYFRAMES, 3)), np.zeros((KEYFRAMES, 3)))
    zeros = (np.zeros((KEYFRAMES, 6)), Odo(np.zeros((KEYFRAMES, 4))), np.zeros((1, 5)), np.zeros((1, 3)))
    return States(nav, *zeros, np.zeros((1, Kind.IMU.dim)))


def points(fraction: np.ndarray, arm: np.ndarray | None = None, keyframe: int = 1) -> Points:
    n = len(fraction)
    axle = states().nav.R[:1, :, 1].repeat(n, axis=0)
    left = np.tile([-np.sin(AHEAD), np.cos(AHEAD), 0.0], (n, 1))
    arms = np.zeros((n, 3)) if arm is None else np.tile(arm, (n, 1))
    return Points(np.full(n, keyframe), fraction, left, axle, arms)


def drawn(tangents: np.ndarray | None = None, seed: int = 0) -> PosteriorErrors:
    """Errors of keyframes that are known exactly, or with these samples of their tangents."""
    samples = np.zeros((KEYFRAMES, KEYFRAME_DIM + SHARED_DIM, COUNT)) if tangents is None else tangents
    return PosteriorErrors.of(states(), (samples, np.zeros((SHARED_DIM, COUNT))), np.random.default_rng(seed))


FRACTION = np.array([0.0, 0.1, 0.25, 0.5, 0.7, 1.0])


def spread(errors: PlaceErrors | AngleErrors, name: str) -> np.ndarray:
    return np.asarray(getattr(errors, name).std(axis=0))


@pytest.mark.parametrize("name", ["height", "lateral"])
def test_place_between_exact_keyframes_is_a_clamped_beam(name: str) -> None:
    """Doubly integrated white noise with value and slope pinned at both ends: N^2 T^3 f^3 (1 - f)^3 / 3.

    Its first three modes hold 98 % of the variance in the middle, and less near the ends, where there is little.
    """
    found = spread(PointErrors(RUN, points(FRACTION), drawn()).places(), name)
    exact = ACCEL * INTERVAL_S**1.5 * np.sqrt((FRACTION * (1.0 - FRACTION)) ** 3 / 3.0)
    assert found[[0, -1]].max() < 1e-3 * exact.max()
    np.testing.assert_allclose(found[2:5], exact[2:5], rtol=0.03 + TOLERANCE)
    assert 0.6 * exact[1] < found[1] < exact[1]


@pytest.mark.parametrize("name", ["tilt", "heading"])
def test_attitude_between_exact_keyframes_is_a_bridge(name: str) -> None:
    """N^2 T f (1 - f)."""
    found = spread(PointErrors(RUN, points(FRACTION), drawn()).angles(), name)
    exact = GYRO * np.sqrt(INTERVAL_S * FRACTION * (1.0 - FRACTION))
    np.testing.assert_allclose(found, exact, rtol=TOLERANCE, atol=1e-12)


def test_bridge_is_one_path() -> None:
    """Covariance of two places of one interval: N^2 T f (1 - g); of two intervals: none."""
    one, other = points(np.array([0.25, 0.75])), points(np.array([0.5]), keyframe=2)
    both = Points(
        *(np.concatenate([getattr(one, n), getattr(other, n)]) for n in ("keyframe", "fraction", "left", "axle", "arm"))
    )
    tilt = PointErrors(RUN, both, drawn()).angles().tilt
    covariance = np.cov(tilt.T) / (GYRO**2 * INTERVAL_S)
    assert covariance[0, 1] == pytest.approx(0.25 * 0.25, abs=4 * 0.19 / np.sqrt(COUNT))
    assert abs(covariance[0, 2]) < 4 * 0.22 / np.sqrt(COUNT)


def test_errors_of_the_keyframes_are_carried_by_the_cubic() -> None:
    """Place and speed at both ends drawn independently: the marginals at the keyframes, Hermite's cubic in between."""
    rng = np.random.default_rng(1)
    sd_p, sd_v = 3e-3, 2e-3
    tangents = np.zeros((KEYFRAMES, KEYFRAME_DIM + SHARED_DIM, COUNT))
    tangents[:, NAV + 3 : NAV + 6] = sd_p * rng.standard_normal((KEYFRAMES, 3, COUNT))
    tangents[:, NAV + 6 : NAV + 9] = sd_v * rng.standard_normal((KEYFRAMES, 3, COUNT))
    found = PointErrors(SILENT, points(FRACTION), drawn(tangents)).places()
    f, T = FRACTION, INTERVAL_S
    variance = sd_p**2 * ((1 - 3 * f**2 + 2 * f**3) ** 2 + (3 * f**2 - 2 * f**3) ** 2)
    variance += sd_v**2 * T**2 * ((f - 2 * f**2 + f**3) ** 2 + (f**3 - f**2) ** 2)
    np.testing.assert_allclose(spread(found, "height"), np.sqrt(variance), rtol=TOLERANCE)
    np.testing.assert_allclose(spread(found, "lateral"), np.sqrt(variance), rtol=TOLERANCE)


def test_errors_of_the_attitude_are_carried_linearly() -> None:
    rng = np.random.default_rng(2)
    sd = 1e-4
    tangents = np.zeros((KEYFRAMES, KEYFRAME_DIM + SHARED_DIM, COUNT))
    tangents[:, NAV : NAV + 3] = sd * rng.standard_normal((KEYFRAMES, 3, COUNT))
    found = PointErrors(SILENT, points(FRACTION), drawn(tangents)).angles()
    exact = sd * np.sqrt((1.0 - FRACTION) ** 2 + FRACTION**2)
    np.testing.assert_allclose(spread(found, "heading"), exact, rtol=TOLERANCE)
    # d(sin roll) = cos(roll) d(roll)
    np.testing.assert_allclose(spread(found, "tilt"), np.cos(0.1) * exact, rtol=TOLERANCE)


def test_place_below_the_sensor_swings_with_its_attitude() -> None:
    """A sensor 2 m above the point, rolled about its own place by d, is over a point that is 2 d to the left."""
    rng = np.random.default_rng(3)
    roll = 1e-4 * rng.standard_normal(COUNT)
    tangents = np.zeros((KEYFRAMES, KEYFRAME_DIM + SHARED_DIM, COUNT))
    ahead = np.array([np.cos(AHEAD), np.sin(AHEAD), 0.0])
    tangents[:, NAV : NAV + 3] = (states().nav.R[0].T @ ahead)[:, None] * roll
    found = PointErrors(SILENT, points(FRACTION, arm=np.array([0.0, 0.0, 2.0])), drawn(tangents)).places()
    # The point is the sensor's place less the arm, and the arm turns: -(phi x 2 up) = 2 phi to the left.
    np.testing.assert_allclose(found.lateral, np.tile(2.0 * roll[:, None], (1, len(FRACTION))), atol=1e-9)
    np.testing.assert_allclose(found.height, 0.0, atol=1e-9)


def test_rails_under_one_unit_have_the_same_draws() -> None:
    """Halves of what two equal arms give are the whole, and an arm to the right swings up where one to the left goes
    down.
    """
    here = points(FRACTION, arm=np.array([1.0, 2.0, 3.0]))
    whole = PointErrors(RUN, here, drawn()).places()
    passage, shifts = PointErrors(RUN, here, drawn()), Shifts.none(len(FRACTION), COUNT)
    for _ in range(2):
        passage.add_to(shifts, here.arm, share=0.5)
    np.testing.assert_allclose(shifts.along(here.left).lateral, whole.lateral, atol=1e-12)
    arms = [points(FRACTION, arm=np.array(arm)).arm for arm in ([0.0, 0.7, 0.0], [0.0, -0.7, 0.0])]
    left, right = (Shifts.none(len(FRACTION), COUNT) for _ in arms)
    passage = PointErrors(RUN, here, drawn())
    for side, arm in zip((left, right), arms, strict=True):
        passage.add_to(side, arm)
    shaken = Shifts.none(len(FRACTION), COUNT)
    passage.add_to(shaken, np.zeros_like(here.arm))
    np.testing.assert_allclose(left.up + right.up, 2.0 * shaken.up, atol=1e-12)
    assert np.std(left.up - right.up) > 1e-5


RADIUS_M = 300.0
ON_CURVE_M = np.arange(0.0, 20.0 * (KEYFRAMES - 1), 0.5)


def errors_in_a_curve(turned: float, longer: float) -> PlaceErrors:
    """One sample: everything turned about the start, rad, and scaled, as a wrong wheel does, in a curve to the left."""
    n = KEYFRAMES
    yaw = 20.0 * np.arange(n) / RADIUS_M
    R = matrix_from_rpy(np.zeros(n), np.zeros(n), yaw)
    p = RADIUS_M * np.stack([np.sin(yaw), 1 - np.cos(yaw), np.zeros(n)], axis=1)
    samples = np.zeros((n, KEYFRAME_DIM + SHARED_DIM, 1))
    samples[:, NAV + 2, 0] = turned
    shift = turned * np.stack([-p[:, 1], p[:, 0], np.zeros(n)], axis=1) + longer * p
    velocity = 10.0 * (turned * R[:, :, 1] + longer * R[:, :, 0])
    samples[:, NAV + 3 : NAV + 6, 0] = np.einsum("mji,mj->mi", R, shift)
    samples[:, NAV + 6 : NAV + 9, 0] = np.einsum("mji,mj->mi", R, velocity)
    curve = States(
        Nav(R, p, np.zeros((n, 3))), *(getattr(states(), name) for name in ("bias", "odo", "mount", "clock", "imu"))
    )
    here, k = ON_CURVE_M / RADIUS_M, (ON_CURVE_M / 20.0).astype(int)
    left = np.stack([-np.sin(here), np.cos(here), np.zeros(len(here))], axis=1)
    on_curve = Points(k, ON_CURVE_M / 20.0 - k, left, left, np.zeros((len(here), 3)))
    errors = PosteriorErrors.of(curve, (samples, np.zeros((SHARED_DIM, COUNT))), np.random.default_rng(0))
    return PointErrors(SILENT, on_curve, errors).places()


def test_turning_the_whole_path_changes_its_lateral_profile_by_a_straight_line_at_most() -> None:
    """In a curve of R 300: u counts from its own heading, so a rotation of everything is no error of the alignment."""
    turned = 1e-3
    lateral = errors_in_a_curve(turned, longer=0.0).lateral[0]
    straight = np.polyval(np.polyfit(ON_CURVE_M, lateral, 1), ON_CURVE_M)
    assert np.abs(lateral - straight).max() < 2e-5
    assert np.ptp(lateral) == pytest.approx(turned * ON_CURVE_M[-1], rel=0.02)


def test_a_path_that_seems_longer_seems_to_bend_less() -> None:
    """Of 1 % more length 1 % less curvature: -3.3e-5 1/m, in the lateral profile and in its turn from step to step."""
    longer, step = 0.01, ON_CURVE_M[1]
    found = errors_in_a_curve(0.0, longer)
    bent = 2.0 * np.polyfit(ON_CURVE_M, found.lateral[0], 2)[0]
    assert bent == pytest.approx(-longer / RADIUS_M, rel=0.02)
    turn = np.polyfit(ON_CURVE_M, found.turn[0] / step, 1)[0]
    assert turn == pytest.approx(-longer / RADIUS_M, rel=0.02)


def test_point_that_is_elsewhere_in_the_vehicle_is_elsewhere_as_the_body_is_turned() -> None:
    """0.1 m further to the left, on a body that rolls by 0.1 rad, is 0.01 m higher and 0.0995 m to the left."""
    shared = np.zeros((SHARED_DIM, COUNT))
    shared[TRACKING_POINT] = np.array([0.0, 0.1, 0.0])[:, None]
    tangents = np.zeros((KEYFRAMES, KEYFRAME_DIM, COUNT))
    errors = PosteriorErrors.of(states(), (tangents, shared), np.random.default_rng(0))
    seen = points(FRACTION)
    followed = replace(seen, body=np.tile(states().nav.R[0], (len(FRACTION), 1, 1)))
    places, of_sensor = (PointErrors(SILENT, one, errors).places() for one in (followed, seen))
    assert places.height == pytest.approx(0.1 * np.sin(0.1), abs=1e-6)
    assert places.lateral == pytest.approx(0.1 * np.cos(0.1), abs=1e-6)
    assert of_sensor.height == pytest.approx(0.0, abs=1e-6)
