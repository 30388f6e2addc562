"""Rotations, axes strings and the Earth: identities that must hold for any input, and published values."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from trackfg.numerics import geodesy, rotations

angle = st.floats(-3.1, 3.1)
vectors = arrays(np.float64, (4, 3), elements=st.floats(-1.7, 1.7))
ALL_AXES = [
    "".join(letters)
    for pairs in itertools.permutations(("FB", "LR", "UD"))
    for letters in itertools.product(*pairs)
]  # fmt: skip


def is_rotation(R: np.ndarray) -> bool:
    return np.allclose(R @ np.swapaxes(R, -1, -2), np.eye(3), atol=1e-12) and np.allclose(np.linalg.det(R), 1.0)


@given(vectors, vectors)
def test_skew_is_the_cross_product(a: np.ndarray, b: np.ndarray) -> None:
    np.testing.assert_allclose((rotations.skew(a) @ b[..., None])[..., 0], np.cross(a, b), atol=1e-14)


@given(vectors, st.sampled_from([1.0, 1e-3, 1e-4, 1e-5, 1e-9, 0.0]))
def test_log_inverts_exp_at_any_size(v: np.ndarray, size: float) -> None:
    R = rotations.so3_exp(size * v)
    assert is_rotation(R)
    np.testing.assert_allclose(rotations.so3_log(R), size * v, atol=1e-12)


@given(vectors)
def test_exp_of_the_opposite_vector_is_the_inverse(v: np.ndarray) -> None:
    np.testing.assert_allclose(
        rotations.so3_exp(v) @ rotations.so3_exp(-v), np.broadcast_to(np.eye(3), (4, 3, 3)), atol=1e-12
    )


def test_exp_turns_by_the_right_hand() -> None:
    np.testing.assert_allclose(
        rotations.so3_exp(np.array([0.0, 0.0, np.pi / 2])) @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-15
    )


@pytest.mark.parametrize("axis", [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, 0.8, 0]])
def test_log_near_half_a_turn(axis: list[float]) -> None:
    for size in (np.pi - 1e-3, np.pi - 1e-9):
        v = size * np.array(axis)
        np.testing.assert_allclose(rotations.so3_log(rotations.so3_exp(v)), v, atol=1e-6)


@given(vectors)
def test_the_quaternion_is_unit_and_rotates_alike(v: np.ndarray) -> None:
    R = rotations.so3_exp(v)
    q = rotations.quaternion(R)
    np.testing.assert_allclose(np.linalg.norm(q, axis=-1), 1.0, atol=1e-12)
    assert (q[..., 0] >= 0).all()
    w, u = q[..., :1, None], q[..., 1:]
    K = rotations.skew(u)
    np.testing.assert_allclose(np.eye(3) + 2 * w * K + 2 * K @ K, R, atol=1e-12)


@given(angle, st.floats(-1.5, 1.5), angle)
def test_roll_pitch_yaw_come_back(roll: float, pitch: float, yaw: float) -> None:
    R = rotations.matrix_from_rpy(*(np.array(a) for a in (roll, pitch, yaw)))
    assert is_rotation(R)
    np.testing.assert_allclose(rotations.rpy_from_matrix(R), [roll, pitch, yaw], atol=1e-9)


def test_signs_of_roll_pitch_and_yaw() -> None:
    def turned(roll: float, pitch: float, yaw: float, body: list[float]) -> np.ndarray:
        return rotations.matrix_from_rpy(*(np.array(a) for a in (roll, pitch, yaw))) @ body

    assert turned(0.1, 0, 0, [0, 1, 0])[2] > 0  # roll: left side up
    assert turned(0, 0.1, 0, [1, 0, 0])[2] < 0  # pitch: nose down
    assert turned(0, 0, 0.1, [1, 0, 0])[1] > 0  # yaw: to the left


def test_rpy_takes_arrays_and_broadcasts() -> None:
    assert rotations.matrix_from_rpy(np.zeros(5), np.zeros(5), np.array(0.3)).shape == (5, 3, 3)


@pytest.mark.parametrize("axes", ALL_AXES)
def test_every_triad_maps_each_column_where_it_points(axes: str) -> None:
    directions = {"F": [1, 0, 0], "B": [-1, 0, 0], "L": [0, 1, 0], "R": [0, -1, 0], "U": [0, 0, 1], "D": [0, 0, -1]}
    A = rotations.axes_matrix(axes)
    for column, letter in enumerate(axes):
        np.testing.assert_array_equal(A[:, column], directions[letter])
    np.testing.assert_array_equal(A @ A.T, np.eye(3))


def test_half_of_the_triads_are_right_handed() -> None:
    assert len(ALL_AXES) == 48
    assert sum(np.linalg.det(rotations.axes_matrix(axes)) > 0 for axes in ALL_AXES) == 24
    assert np.linalg.det(rotations.axes_matrix("FRD")) > 0
    assert np.linalg.det(rotations.axes_matrix("FRU")) < 0


@pytest.mark.parametrize("axes", ["", "FL", "FLUX", "FLX", "FFU", "FBU", "flu"])
def test_no_triad_no_matrix(axes: str) -> None:
    with pytest.raises(ValueError, match="axes"):
        rotations.axes_matrix(axes)


def test_normal_gravity_at_equator_and_pole() -> None:
    assert geodesy.normal_gravity(0.0) == pytest.approx(9.7803253359, abs=1e-9)
    assert geodesy.normal_gravity(90.0) == pytest.approx(9.8321849379, abs=1e-8)
    assert geodesy.normal_gravity(45.0, 1000.0) == pytest.approx(9.8061977694 - 3.086e-3, abs=1e-6)


def test_the_earth_turns_eastwards_about_its_axis() -> None:
    for latitude in (-90.0, -30.0, 0.0, 52.0):
        rate = geodesy.earth_rate_enu(latitude)
        assert np.linalg.norm(rate) == pytest.approx(geodesy.EARTH_RATE)
        in_ecef = geodesy.ecef_from_enu(latitude, 17.0) @ rate
        np.testing.assert_allclose(in_ecef, [0.0, 0.0, geodesy.EARTH_RATE], atol=1e-18)


def test_geodetic_to_ecef_on_the_ellipsoid() -> None:
    np.testing.assert_allclose(geodesy.geodetic_to_ecef(np.array([0.0, 90.0, 5.0])), [0, 6378142.0, 0], atol=1e-6)
    np.testing.assert_allclose(geodesy.geodetic_to_ecef(np.array([90.0, 0.0, 0.0])), [0, 0, 6356752.3142], atol=1e-4)


@given(st.floats(-89, 89), st.floats(-180, 180))
def test_enu_points_east_north_and_up(latitude: float, longitude: float) -> None:
    origin = np.array([latitude, longitude, 100.0])
    assert is_rotation(geodesy.ecef_from_enu(latitude, longitude))
    around = origin + np.array([[0, 0, 0], [0, 1e-5, 0], [1e-5, 0, 0], [0, 0, 1.0]])
    here, east, north, up = geodesy.geodetic_to_enu(around, origin)
    np.testing.assert_allclose(here, 0.0, atol=1e-8)
    assert east[0] == pytest.approx(np.radians(1e-5) * 6.38e6 * np.cos(np.radians(latitude)), rel=0.01)
    assert north[1] == pytest.approx(np.radians(1e-5) * 6.37e6, rel=0.01)
    np.testing.assert_allclose(up, [0, 0, 1], atol=1e-8)
    np.testing.assert_allclose([east[1:], north[[0, 2]]], 0.0, atol=1e-5)


def test_quaternions_turn_as_matrices_do() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 50, 3))
    a[0], b[0], b[1] = 0.0, 0.0, 1e-12
    p, q = rotations.quaternion_exp(a.T), rotations.quaternion_exp(b.T)
    np.testing.assert_allclose(rotations.matrix_from_quaternion(p), rotations.so3_exp(a), atol=1e-14)
    product = rotations.matrix_from_quaternion(rotations.quaternion_product(p, q))
    np.testing.assert_allclose(product, rotations.so3_exp(a) @ rotations.so3_exp(b), atol=1e-14)
    np.testing.assert_allclose(rotations.quaternion_log(p).T, a, atol=1e-13)
    np.testing.assert_allclose(rotations.quaternion_log(-p).T, a, atol=1e-13)
