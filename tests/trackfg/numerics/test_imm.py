"""The IMM core: against filterpy, against a single Kalman filter, and where likelihoods underflow."""

from __future__ import annotations

import numpy as np
import pytest

from trackfg.numerics.imm import interacting_multiple_models, measured

DT = 0.1
F = np.array([[1.0, DT], [0.0, 1.0]])
H = np.array([[1.0, 0.0]])
R = np.array([[0.04]])
SPREADS = np.array([0.01, 0.3, 4.0])
BY_ACCELERATION = np.outer([0.5 * DT**2, DT], [0.5 * DT**2, DT])
TRANSITION = np.array([[0.9, 0.08, 0.02], [0.1, 0.8, 0.1], [0.05, 0.15, 0.8]])
START = np.array([0.5, 0.3, 0.2])


def positions(steps=80):
    """A place that stands, then runs away: (steps, 1)."""
    rng = np.random.default_rng(5)
    t = DT * np.arange(steps)
    return (np.maximum(t - 4.0, 0.0) ** 2 + 0.2 * rng.standard_normal(steps))[:, None]


def linear_step(y, spreads=SPREADS):
    def step(k, x, P):
        return measured(
            x @ F.T,
            F @ P @ F.T + spreads[:, None, None] * BY_ACCELERATION,
            y[k] - x @ F.T @ H.T,
            np.broadcast_to(H, (len(spreads), 1, 2)),
            R,
        )

    return step


def run(y, *, spreads=SPREADS, transition=TRANSITION, start=START, window=1):
    modes = len(spreads)
    return interacting_multiple_models(
        linear_step(y, spreads),
        np.zeros((modes, 2)),
        np.tile(np.eye(2), (modes, 1, 1)),
        start,
        transition,
        len(y) - 1,
        window,
    )


def test_equals_filterpy():
    kalman = pytest.importorskip("filterpy.kalman")
    filters = []
    for spread in SPREADS:
        one = kalman.KalmanFilter(dim_x=2, dim_z=1)
        one.x, one.P, one.F, one.H, one.R = np.zeros((2, 1)), np.eye(2), F, H, R
        one.Q = spread * BY_ACCELERATION
        filters.append(one)
    peer = kalman.IMMEstimator(filters, START, TRANSITION)
    y = positions()
    ours = run(y)
    for k in range(1, len(y)):
        peer.predict()
        peer.update(y[k])
        np.testing.assert_allclose(ours.probability[k], peer.mu, rtol=1e-8, atol=1e-12)
        np.testing.assert_allclose(ours.state[k], np.ravel(peer.x), rtol=1e-8, atol=1e-12)
        np.testing.assert_allclose(ours.covariance[k], peer.P, rtol=1e-8, atol=1e-12)


def test_equal_modes_are_one_kalman_filter():
    y = positions()
    several = run(y, spreads=np.full(3, 0.3))
    one = run(y, spreads=np.array([0.3]), transition=np.eye(1), start=np.ones(1))
    np.testing.assert_allclose(several.state, one.state, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(several.covariance, one.covariance, rtol=1e-9, atol=1e-12)


def test_follows_the_mode():
    result = run(positions())
    np.testing.assert_allclose(result.probability.sum(axis=1), 1.0)
    assert result.probability[35:40, 0].mean() > 0.45
    assert (result.probability[35:40].argmax(axis=1) == 0).all()
    assert result.probability[45:60, 2].max() > 0.5


def test_window_averages_what_is_shown_and_not_the_recursion():
    y = positions()
    plain, windowed = run(y), run(y, window=5)
    np.testing.assert_allclose(windowed.probability[20], plain.probability[16:21].mean(axis=0))
    np.testing.assert_allclose(windowed.probability[2], plain.probability[1:3].mean(axis=0))


def test_far_from_every_mode():
    y = positions()
    y[40:] += 1e4
    result = run(y)
    assert np.isfinite(result.state).all()
    np.testing.assert_allclose(result.probability.sum(axis=1), 1.0)


def test_a_mode_that_nothing_leads_to():
    transition = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    result = run(positions(), transition=transition)
    np.testing.assert_allclose(result.probability[1:], np.tile([1.0, 0.0, 0.0], (79, 1)), atol=1e-12)
    assert np.isfinite(result.state).all()


def test_scaled_rows_change_nothing():
    y = positions()
    np.testing.assert_allclose(run(y, transition=0.9 * TRANSITION).state, run(y).state, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize(
    "wrong",
    [{"transition": np.eye(2)}, {"start": np.ones(2)}, {"transition": -TRANSITION}, {"window": 0}],
)
def test_refuses(wrong):
    with pytest.raises(ValueError, match="expected"):
        run(positions(), **wrong)
