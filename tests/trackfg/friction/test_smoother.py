"""The friction graph: its Jacobians, that it beats the filter, finds friction and knows how well."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from trackfg.datasets.j_turn import FRICTION, STRETCHES_S, j_turn
from trackfg.errors import UnsolvableError
from trackfg.friction import imm_ekf
from trackfg.friction.bicycle import FRICTION_COLUMNS, Car, Noise
from trackfg.friction.smoother import FrictionModel, _Problem, smooth_friction

SEEDS = range(5)


@functools.cache
def smoothed(seed):
    return smooth_friction(j_turn(seed).measured)


def stretches(t):
    return [(t > start - 1e-6) & (t < end - 1e-6) for start, end in STRETCHES_S]


def test_jacobians_are_those_of_the_residuals():
    problem = _Problem.of(j_turn(2).measured.iloc[:40], Car(), Noise(), FrictionModel())
    rng = np.random.default_rng(0)
    z = problem.start() + rng.normal(0.0, [0.01, 0.05, 0.02], (40, 3))

    def stacked(z):
        start, steps, last, _ = problem.residuals(z)
        walk = np.diff(z[:, 2]) / problem.walk_sd
        return np.concatenate([start, np.column_stack([steps, walk]).ravel(), last])

    A, b = problem.linearized(z, np.ones(39)).jacobian()
    h = 1e-6
    numeric = np.column_stack(
        [(stacked(z + h * d) - stacked(z - h * d)) / (2 * h) for d in np.eye(120).reshape(120, 40, 3)]
    )
    np.testing.assert_allclose(b, -stacked(z), rtol=1e-9)
    np.testing.assert_allclose(A, numeric, rtol=1e-5, atol=1e-3)


def test_slip_angle_is_twice_as_good_as_the_best_filters():
    """Those with seven and ten modes: three are poorer."""
    ours, best = np.zeros(3), np.full(3, np.inf)

    def squares(table, drive):
        off = (table["slip_angle_rad"] - drive.truth["slip_angle_rad"]) ** 2
        return np.array([off[inside].mean() for inside in stretches(drive.truth["t_s"])])

    drives = {seed: j_turn(seed) for seed in SEEDS}
    ours = sum(squares(smoothed(seed), drive) for seed, drive in drives.items())
    for modes in (7, 10):
        theirs = sum(squares(imm_ekf.run(d.measured, modes=modes).table, d) for d in drives.values())
        best = np.minimum(best, theirs)
    assert np.sqrt(ours.sum() / best.sum()) < 0.55
    assert (np.sqrt(ours / best) < 0.7).all()


def test_friction_in_each_stretch():
    found = np.array(
        [[smoothed(seed)["friction"][inside].mean() for inside in stretches(smoothed(seed)["t_s"])] for seed in SEEDS]
    )
    np.testing.assert_allclose(found.mean(axis=0), FRICTION, atol=0.015)
    np.testing.assert_allclose(found, np.tile(FRICTION, (len(SEEDS), 1)), atol=0.04)


def test_the_jumps_are_where_they_were():
    for seed in SEEDS:
        table = smoothed(seed)
        steps = np.abs(np.diff(table["friction"]))
        largest = np.sort(table["t_s"].to_numpy()[1:][np.argsort(steps)[-2:]])
        np.testing.assert_allclose(largest, [6.0, 12.0], atol=0.4)


def test_sigmas_are_honest():
    ratios = []
    for seed in SEEDS:
        truth, table = j_turn(seed).truth, smoothed(seed)
        assert tuple(table.columns) == FRICTION_COLUMNS
        ratios.append(
            [
                np.sqrt(np.mean(((table[name] - truth[name]) / table[f"{name}_sd"]) ** 2))
                for name in ("slip_angle_rad", "yaw_rate_radps", "friction")
            ]
        )
    assert (np.mean(ratios, axis=0) < 1.5).all()
    assert (np.mean(ratios, axis=0) > 0.5).all()


def test_a_road_that_does_not_change_has_no_jumps():
    drive = j_turn(1)
    first = drive.measured[drive.measured["t_s"] < 5.99]
    table = smooth_friction(first)
    assert np.ptp(table["friction"]) < 0.02
    assert table["friction"].mean() == pytest.approx(0.8, abs=0.05)


def test_friction_is_known_only_once_the_car_turns():
    """Straight ahead nothing shows friction: the prior stays."""
    drive = j_turn(1).measured.iloc[:30].assign(steer_rad=0.0, front_mps2=0.0, rear_mps2=0.0)
    table = smooth_friction(drive)
    model = FrictionModel()
    np.testing.assert_allclose(table["friction"], model.start, atol=0.01)
    np.testing.assert_allclose(table["friction_sd"], model.start_sd, rtol=0.05)


def test_an_iteration_that_does_not_end_is_reported(monkeypatch):
    monkeypatch.setattr("trackfg.friction.smoother._MOST_ITERATIONS", 1)
    with pytest.raises(UnsolvableError, match="no minimum"):
        smooth_friction(j_turn(1).measured.iloc[:100])
