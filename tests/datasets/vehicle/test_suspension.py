"""The coach's springs: published response figures, and the exactness of the response in time."""

import numpy as np
import pytest
from scipy.signal import lsim

from trackfg.datasets.vehicle.suspension import Suspension

WAVELENGTHS_M = np.array([5.0, 10.0, 20.0, 40.0, 70.0, 200.0])
BODY, FRONT = 0, 2


@pytest.mark.parametrize(
    ("column", "published"),
    [(BODY, [0.06, 0.20, 0.59, 1.92, 1.43, 1.05]), (FRONT, [0.45, 0.71, 0.89, 1.29, 1.12, 1.01])],
)
def test_vertical_gains_at_25_mps_are_the_published_ones(column, published):
    gain = Suspension().vertical.gain(25.0 / WAVELENGTHS_M, np.ones(4))
    np.testing.assert_allclose(np.abs(gain[:, column]), published, atol=0.006)


def test_bounce_frequencies():
    suspension = Suspension()
    body = np.sqrt(2 * suspension.secondary_vertical[0] / suspension.body_mass_kg) / (2 * np.pi)
    frame = (2 * suspension.primary_vertical[0] + suspension.secondary_vertical[0]) / suspension.bogie_mass_kg
    assert body == pytest.approx(0.67, abs=0.005)
    assert np.sqrt(frame) / (2 * np.pi) == pytest.approx(4.3, abs=0.05)


@pytest.mark.parametrize("plane", ["vertical", "lateral", "roll"])
def test_without_inertia_the_car_follows_its_wheelsets(plane):
    system = getattr(Suspension(), plane)
    at_rest = system.gain(np.zeros(1), np.ones(4))[0]
    moved = np.ones(3) if plane == "roll" else np.array([1, 0, 1, 0, 1, 0])
    np.testing.assert_allclose(at_rest, moved, atol=1e-9)


@pytest.mark.parametrize("plane", ["vertical", "lateral", "roll"])
def test_response_is_that_of_a_general_solver(plane):
    system = getattr(Suspension(), plane)
    n, dt, rng = len(system.mass), 0.005, np.random.default_rng(1)
    t = dt * np.arange(800)
    u = np.cumsum(rng.standard_normal((800, 4)), axis=0) * 1e-3
    u[0] = 0.0
    signals = np.cumsum(rng.standard_normal((800, 2)), axis=0) * 1e-2
    signals[0] = 0.0
    force = rng.standard_normal((n, 2)) * 1e3

    # The inputs' rates, constant between samples, as an integral: states (q, q' - C_u u / M).
    mass = system.mass[:, None]
    state = np.block([[np.zeros((n, n)), np.eye(n)], [-system.stiffness / mass, -system.damping / mass]])
    direct = system.input_damping / mass
    entry = np.block(
        [[direct, np.zeros((n, 2))], [system.input_stiffness / mass - system.damping / mass @ direct, force / mass]]
    )
    _, expected, _ = lsim((state, entry, np.eye(n, 2 * n), np.zeros((n, 6))), np.column_stack([u, signals]), t)
    np.testing.assert_allclose(system.response(u, signals, force, dt, list(range(n))), expected, atol=1e-9)


def test_starts_in_equilibrium():
    system = Suspension().vertical
    u = np.tile([0.01, -0.02, 0.03, 0.0], (50, 1))
    q = system.response(u, np.ones((50, 1)), np.array([[1e4], [0], [0], [0], [0], [0]]), 0.01, [0, 1, 2])
    np.testing.assert_allclose(q, np.broadcast_to(q[0], q.shape), atol=1e-12)
    assert q[0, 0] == pytest.approx(0.005 + 1e4 * (1 / 7e5 + 1 / (4 * 6.65e5)))


def test_lean_moment_leans_the_body_by_the_coefficient():
    suspension = Suspension(roll_coefficient=0.25)
    moment = np.array([[suspension.lean_moment], [0], [0]])
    q = suspension.roll.response(np.zeros((2, 4)), np.ones((2, 1)), moment, 0.01, [0])
    assert q[0, 0] == pytest.approx(0.25)
