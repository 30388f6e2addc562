"""The road friction's IMM-EKF: its model, the printed and the corrected transitions, and the paper's finding."""

from __future__ import annotations

import functools

import numpy as np
import pandas as pd
import pytest

from trackfg.datasets.j_turn import FRICTION, STRETCHES_S, j_turn
from trackfg.errors import BadInputError
from trackfg.friction import imm_ekf
from trackfg.friction.bicycle import FRICTION_COLUMNS, Car, Noise, tyre_forces
from trackfg.friction.imm_ekf import transition_matrix

SEEDS = range(5)
MODES = (3, 7, 10)


@functools.cache
def figures_of(seed: int, modes: int, as_printed: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Per stretch: RMSE of the slip angle (mrad), mean friction from 2 s into the stretch on."""
    error, friction = np.zeros((2, 3))
    drive = j_turn(seed)
    table = imm_ekf.run(drive.measured, modes=modes, as_printed=as_printed).table
    off = table["slip_angle_rad"] - drive.truth["slip_angle_rad"]
    for i, (start, end) in enumerate(STRETCHES_S):
        inside = (table["t_s"] > start - 1e-6) & (table["t_s"] < end - 1e-6)
        error[i] = 1e3 * np.sqrt((off[inside] ** 2).mean())
        friction[i] = table["friction"][inside & (table["t_s"] > start + 2.0)].mean()
    return error, friction


def figures(modes: int) -> np.ndarray:
    """The means of both over the seeds. Shape (2, 3)."""
    return np.mean([figures_of(seed, modes) for seed in SEEDS], axis=0)


def test_stiffness_makes_the_force_tend_to_friction_times_load():
    car = Car()
    np.testing.assert_allclose(car.K, [15.31, 30.01], atol=0.005)
    sideways = tyre_forces(car, np.array([1e4, 0.0]), 0.0, 0.5).F
    assert 2.0 * sideways.sum() == pytest.approx(-0.5 * car.m * 9.80665, rel=1e-3)


def test_jacobians():
    car, rng = Car(), np.random.default_rng(1)
    x = rng.normal(0.0, [0.05, 0.3], (50, 2))
    delta, mu = rng.uniform(-0.06, 0.06, 50), rng.uniform(0.05, 1.0, 50)
    forces = tyre_forces(car, x, delta, mu)
    for i in range(2):
        h = 1e-6 * np.eye(2)[i]
        numeric = (tyre_forces(car, x + h, delta, mu).F - tyre_forces(car, x - h, delta, mu).F) / 2e-6
        np.testing.assert_allclose(forces.by_state[:, :, i], numeric, rtol=1e-5, atol=1e-2)
    numeric = (tyre_forces(car, x, delta, mu + 1e-6).F - tyre_forces(car, x, delta, mu - 1e-6).F) / 2e-6
    np.testing.assert_allclose(forces.by_friction, numeric, rtol=1e-5, atol=1e-2)


def test_the_model_is_the_simulation():
    """Written twice, in the simulation and in the estimators: without noise they agree."""
    quiet, car = j_turn(0, noise=False), Car()
    x = quiet.truth[["slip_angle_rad", "yaw_rate_radps"]].to_numpy()
    F = tyre_forces(car, x, quiet.measured["steer_rad"].to_numpy(), quiet.truth["friction"].to_numpy()).F
    np.testing.assert_allclose(x[:-1] @ car.A(0.03).T + F[:-1] @ car.G(0.03).T, x[1:], atol=1e-12)
    np.testing.assert_allclose(F @ car.D.T, quiet.measured[["front_mps2", "rear_mps2"]], atol=1e-9)
    np.testing.assert_array_equal(Noise().Q, np.diag([400.0, 400.0]))
    np.testing.assert_array_equal(Noise().R, np.diag([0.25, 0.25]))


@pytest.mark.parametrize(("modes", "edge"), [(7, 0.925), (10, 0.914)])
def test_printed_rows_do_not_sum_to_one(modes, edge):
    printed = transition_matrix(modes, as_printed=True).sum(axis=1)
    assert printed[[0, -1]] == pytest.approx(edge, abs=5e-4)
    np.testing.assert_allclose(printed[1:-1], 1.0)


@pytest.mark.parametrize("modes", [3, 4, 7, 10, 20])
def test_corrected_rows_sum_to_one(modes):
    p = transition_matrix(modes)
    np.testing.assert_allclose(p.sum(axis=1), 1.0)
    assert (p > 0).all()


def test_too_few_modes():
    with pytest.raises(ValueError, match="3 or more"):
        transition_matrix(2)


def test_unusable_measurements_are_named():
    drive = j_turn(0).measured
    spoilt = drive.copy()
    spoilt.loc[5, "front_mps2"] = np.nan
    for table, message in (
        (spoilt, "row 5, front_mps2"),
        (drive.drop(columns="steer_rad"), "steer_rad"),
        (drive.drop(index=7), "constant rate"),
        (drive.iloc[:1], "two rows"),
    ):
        with pytest.raises(BadInputError, match=message):
            imm_ekf.run(table)


def test_result_table():
    drive = j_turn(0)
    result = imm_ekf.run(drive.measured, modes=7)
    assert tuple(result.table.columns) == FRICTION_COLUMNS
    assert result.probability.shape == (600, 7)
    np.testing.assert_allclose(result.friction_modes[[3, 4]], [0.5714, 0.7143], atol=1e-4)
    np.testing.assert_allclose(result.probability @ result.friction_modes, result.table["friction"])
    assert np.isfinite(result.table.to_numpy()).all()
    # A filter knows nothing of what comes.
    early = imm_ekf.run(drive.measured.iloc[:300], modes=7).table
    pd.testing.assert_frame_equal(early, result.table.iloc[:300])


def test_friction_is_found_with_seven_and_ten_modes():
    for modes in (7, 10):
        np.testing.assert_allclose(figures(modes)[1], FRICTION, atol=0.04)


def test_three_modes_are_poor():
    few, many = figures(3), figures(10)
    assert np.abs(few[1] - FRICTION).max() > 2.0 * np.abs(many[1] - FRICTION).max()
    assert (few[0][1:] > 1.3 * many[0][1:]).all()
    # The change is detected all the same.
    assert (np.diff(few[1]) < -0.1).all()


def test_slip_angle_as_measured():
    """RMSE in mrad, by modes and stretch: at low friction an order of magnitude above the paper's dry road."""
    expected = {3: (1.1, 3.6, 16.2), 7: (1.05, 2.3, 14.4), 10: (1.1, 2.3, 10.8)}
    for modes in MODES:
        np.testing.assert_allclose(figures(modes)[0], expected[modes], rtol=0.4)


def test_the_printed_rows_hardly_matter():
    printed, corrected = figures_of(0, 10, as_printed=True), figures_of(0, 10)
    np.testing.assert_allclose(printed[0], corrected[0], rtol=0.02)
    np.testing.assert_allclose(printed[1], corrected[1], atol=0.005)
