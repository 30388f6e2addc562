"""The inertial factors: zero on exact motion, on a rotating Earth too; bias Jacobians and noise."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import gtsam
import numpy as np
import pytest

from trackfg.factors.imu import InertialFactors, Preintegration, PreintegrationNoise, imu_factors, preintegrate
from trackfg.factors.states import Kind, Nav, States
from trackfg.numerics.geodesy import earth_rate_enu
from trackfg.numerics.kernels import kernel_argument
from trackfg.numerics.rotations import matrix_from_rpy, so3_exp, so3_log
from trackfg.sensors.imu_intervals import Increments, Intervals, compress

G = 9.80665
GYRO, ACCEL = 1e-4, 2e-3
NOISE = PreintegrationNoise.alike(GYRO, ACCEL)
NAV, BIAS = Kind.NAV, Kind.BIAS
STILL = np.zeros(3)
WithBoth = Callable[[Callable[[], Any]], tuple[Any, Any]]


def values(R: np.ndarray, p: np.ndarray, v: np.ndarray, bias: np.ndarray | None = None) -> gtsam.Values:
    """Two states, leading dimension 2, and the bias of the first."""
    out = gtsam.Values()
    for key, rotation, place, speed in zip(NAV.keys(np.arange(2)).tolist(), R, p, v, strict=True):
        out.insert(key, gtsam.NavState(gtsam.Rot3(rotation), place, speed))
    bias = np.zeros(6) if bias is None else bias
    out.insert(int(BIAS.keys(np.array([0]))[0]), gtsam.imuBias.ConstantBias(bias[:3], bias[3:]))
    return out


def factor(increments: Increments, earth_rate: np.ndarray | None = None, bias: np.ndarray | None = None):  # type: ignore[no-untyped-def]
    parameters = NOISE.parameters(G, STILL if earth_rate is None else earth_rate)
    bias = np.zeros(6) if bias is None else bias
    return imu_factors([preintegrate(parameters, bias, increments.duration, increments.rotation, increments.velocity)])[
        0
    ]


def helix(duration: float, rate_hz: float = 200.0) -> tuple[Intervals, np.ndarray, np.ndarray, np.ndarray]:
    """A canted curve at constant speed and gradient: exact poses at both ends and exact means of the samples.

    Rate and specific force are constant in body axes: n-frame yaw rate w about the vertical, forward axis nose-up.
    """
    speed, yaw_rate, roll, pitch = 20.0, 0.05, -0.08, -0.02
    t = np.array([0.0, duration])
    R = matrix_from_rpy(np.full(2, roll), np.full(2, pitch), yaw_rate * t)
    across, climb = speed * np.cos(pitch), -speed * np.sin(pitch)
    angle = yaw_rate * t
    v = np.stack([across * np.cos(angle), across * np.sin(angle), np.full(2, climb)], axis=1)
    radius = across / yaw_rate
    p = np.stack([radius * np.sin(angle), radius * (1 - np.cos(angle)), climb * t], axis=1)
    w = R[0].T @ [0.0, 0.0, yaw_rate]
    f = R[0].T @ [0.0, across * yaw_rate, G]
    n = round(duration * rate_hz)
    samples = Intervals(np.arange(n + 1) / rate_hz, np.tile(w, (n, 1)), np.tile(f, (n, 1)), np.zeros(n, dtype=bool))
    return samples, R, p, v


def steady(gyro: np.ndarray, accel: np.ndarray, duration: float, rate_hz: float = 200.0) -> Increments:
    """Constant rate and specific force in body axes, compressed by four."""
    n = round(duration * rate_hz)
    samples = Intervals(
        np.arange(n + 1) / rate_hz, np.tile(gyro, (n, 1)), np.tile(accel, (n, 1)), np.zeros(n, dtype=bool)
    )
    return compress(samples, np.arange(0, n + 1, 4))


@pytest.mark.parametrize("group", [1, 4])
@pytest.mark.parametrize("duration", [0.5, 5.0])
def test_residual_is_zero_on_an_exact_curve(duration: float, group: int) -> None:
    samples, R, p, v = helix(duration)
    compressed = compress(samples, np.arange(0, len(samples) + 1, group))
    residual = factor(compressed).unwhitenedError(values(R, p, v))
    assert np.abs(residual[:3]).max() < 1e-12
    assert np.abs(residual[6:]).max() < 2e-8 * duration
    # Within one increment GTSAM takes the force as constant in n: off by a w dt^2 / 12 along the way.
    assert np.abs(residual[3:6]).max() < 2e-6 * duration


def test_compressed_samples_are_as_good_as_the_samples_in_a_wobble() -> None:
    """Over one keyframe interval. GTSAM sums the turn by Euler's rule, first order in the increment."""
    n, rate = 100, 200.0
    t = (np.arange(n) + 0.5) / rate
    gyro = np.stack([0.1 * np.sin(9 * t), 0.05 * np.cos(7 * t), 0.1 + 0.1 * np.sin(5 * t)], axis=1)
    accel = np.stack([np.sin(6 * t), np.cos(11 * t), G + np.sin(13 * t)], axis=1)
    samples = Intervals(np.arange(n + 1) / rate, gyro, accel, np.zeros(n, dtype=bool))
    exact = compress(samples, np.array([0, n]))
    fine = compress(samples, np.arange(n + 1))
    coarse = compress(samples, np.arange(0, n + 1, 4))
    parameters = NOISE.parameters(G, STILL)
    ends = [
        preintegrate(parameters, np.zeros(6), x.duration, x.rotation, x.velocity).predict(
            gtsam.NavState(), gtsam.imuBias.ConstantBias()
        )
        for x in (fine, coarse)
    ]
    gravity = np.array([0.0, 0.0, -G * n / rate])
    for end in ends:
        assert np.linalg.norm(so3_log(end.attitude().matrix().T @ so3_exp(exact.rotation[0]))) < 1e-5
        np.testing.assert_allclose(end.velocity() - gravity, exact.velocity[0], atol=5e-5)
    np.testing.assert_allclose(ends[0].position(), ends[1].position(), atol=2e-5)


@pytest.mark.parametrize("latitude", [0.0, 35.2, -70.0])
def test_body_at_rest_on_the_rotating_earth(latitude: float) -> None:
    """At rest the gyro shows R' w and the accelerometer R' g, whatever the attitude; nothing moves in n."""
    earth, duration = earth_rate_enu(latitude), 20.0
    R = so3_exp(np.array([[0.1, -0.2, 1.3]]))[0]
    increments = steady(R.T @ earth, R.T @ [0, 0, G], duration)
    still = values(np.stack([R, R]), np.zeros((2, 3)), np.zeros((2, 3)))
    with_earth = factor(increments, earth).unwhitenedError(still)
    assert np.abs(with_earth[:3]).max() < 1e-10
    assert np.abs(with_earth[3:6]).max() < 1e-5
    assert np.abs(with_earth[6:]).max() < 1e-6
    # Left out, the Earth's turn of 1.5 mrad in 20 s shows.
    without = factor(increments).unwhitenedError(still)
    assert np.linalg.norm(without[:3]) == pytest.approx(np.linalg.norm(earth) * duration, rel=1e-3)


def test_constant_velocity_on_the_rotating_earth_needs_coriolis() -> None:
    """Straight on at 50 m/s: the specific force holds the body against 2 w x v (7 mm/s^2), and the residual is zero."""
    earth, duration, v = earth_rate_enu(60.0), 2.0, np.array([30.0, 40.0, 0.0])
    R = matrix_from_rpy(np.array(0.0), np.array(0.0), np.array(np.arctan2(40.0, 30.0)))
    force = R.T @ (np.array([0.0, 0.0, G]) + 2.0 * np.cross(earth, v))
    increments = steady(R.T @ earth, force, duration)
    moving = values(np.stack([R, R]), np.array([np.zeros(3), v * duration]), np.stack([v, v]))
    residual = factor(increments, earth).unwhitenedError(moving)
    coriolis = np.linalg.norm(2.0 * np.cross(earth, v))
    assert np.abs(residual[:3]).max() < 1e-8
    assert np.linalg.norm(residual[6:]) < 1e-3 * coriolis * duration
    assert np.linalg.norm(residual[3:6]) < 1e-3 * 0.5 * coriolis * duration**2
    # With the Earth's turn taken off the gyro but no Coriolis, the velocity would be wrong by all of it.
    blind = factor(steady(np.zeros(3), force, duration)).unwhitenedError(moving)
    assert np.linalg.norm(blind[6:]) == pytest.approx(coriolis * duration, rel=1e-3)


@pytest.mark.parametrize("group", [1, 4])
def test_bias_is_taken_off_the_samples(group: int) -> None:
    """Exactly in attitude. The half turn of the bias within an increment stays: an acceleration of b x f dt / 2."""
    samples, R, p, v = helix(1.0)
    bias = np.array([0.03, -0.05, 0.02, 2e-4, -1e-4, 3e-4])
    biased = Intervals(samples.edges, samples.gyro + bias[3:], samples.accel + bias[:3], samples.bridged)
    increments = compress(biased, np.arange(0, len(samples) + 1, group))
    residual = factor(increments, bias=bias).unwhitenedError(values(R, p, v, bias))
    assert np.abs(residual[:3]).max() < 1e-12
    half_turn = 0.5 * np.linalg.norm(bias[3:]) * G * group / 200.0
    assert np.linalg.norm(residual[6:]) < 1.5 * half_turn
    assert np.linalg.norm(residual[3:6]) < half_turn + 2e-6


def test_bias_jacobian_carries_a_bias_found_later() -> None:
    """Preintegrated around zero and evaluated at the bias, as good as preintegrated around it but for second order."""
    samples, R, p, v = helix(1.0)
    for scale in (1.0, 0.1):
        bias = scale * np.array([0.1, -0.1, 0.1, 0.01, -0.01, 0.01])
        biased = Intervals(samples.edges, samples.gyro + bias[3:], samples.accel + bias[:3], samples.bridged)
        increments = compress(biased, np.arange(0, len(samples) + 1, 4))
        late = factor(increments).unwhitenedError(values(R, p, v, bias))
        early = factor(increments, bias=bias).unwhitenedError(values(R, p, v, bias))
        np.testing.assert_allclose(late, early, atol=2e-3 * scale**2)
        assert np.abs(factor(increments).unwhitenedError(values(R, p, v))).max() > 0.05 * scale


def test_gyro_bias_jacobian_is_the_numerical_one() -> None:
    samples, R, p, v = helix(1.0)
    one = factor(compress(samples, np.arange(0, len(samples) + 1, 4)))
    whitened = one.linearize(values(R, p, v))
    A, _ = whitened.jacobian()
    keys = list(whitened.keys())
    bias_key = int(BIAS.keys(np.array([0]))[0])
    start = sum(9 if key != bias_key else 6 for key in keys[: keys.index(bias_key)])
    step = 1e-5
    for c in range(3, 6):
        delta = np.zeros(6)
        delta[c] = step
        ahead, behind = (one.unwhitenedError(values(R, p, v, sign * delta)) for sign in (1, -1))
        numeric = one.noiseModel().whiten((ahead - behind) / (2 * step))
        np.testing.assert_allclose(A[:, start + c], numeric, rtol=1e-4, atol=1e-4 * np.abs(numeric).max())


def test_noise_grows_with_the_square_root_of_time() -> None:
    covariances = []
    for duration in (1.0, 4.0):
        samples, *_ = helix(duration)
        increments = compress(samples, np.arange(0, len(samples) + 1, 4))
        covariances.append(factor(increments).preintegratedMeasurements().preintMeasCov())
    for duration, covariance in zip((1.0, 4.0), covariances, strict=True):
        sd = np.sqrt(np.diag(covariance))
        np.testing.assert_allclose(sd[:3], GYRO * np.sqrt(duration), rtol=1e-2)
        np.testing.assert_allclose(sd[8], ACCEL * np.sqrt(duration), rtol=1e-2)


def test_parameters_hold_what_they_were_given() -> None:
    earth = earth_rate_enu(35.2)
    parameters = NOISE.parameters(9.79, earth)
    np.testing.assert_array_equal(parameters.n_gravity, [0, 0, -9.79])
    np.testing.assert_array_equal(parameters.getOmegaCoriolis(), earth)
    np.testing.assert_allclose(parameters.getGyroscopeCovariance(), GYRO**2 * np.eye(3))
    np.testing.assert_allclose(parameters.getAccelerometerCovariance(), ACCEL**2 * np.eye(3))
    np.testing.assert_array_equal(NOISE.parameters(9.79, STILL).getOmegaCoriolis(), STILL)


def test_factors_tie_neighbours_in_order() -> None:
    samples, *_ = helix(0.5)
    parameters = NOISE.parameters(G, STILL)
    x = compress(samples, np.arange(0, 101, 4))
    made = [preintegrate(parameters, np.zeros(6), x.duration, x.rotation, x.velocity) for _ in range(3)]
    nav, bias = NAV.keys(np.arange(4)).tolist(), BIAS.keys(np.arange(3)).tolist()
    assert [list(f.keys()) for f in imu_factors(made)] == [[nav[k], nav[k + 1], bias[k]] for k in range(3)]


@pytest.fixture
def turning(at_origin: Callable[[int], States]) -> tuple[InertialFactors, States]:
    """Three intervals in a frame that turns fast, the states far from what they predict, and the biases off."""
    rng, measured = np.random.default_rng(3), []
    for steps, duration in ((50, 0.02), (30, 0.02), (1, 0.005)):
        noise = PreintegrationNoise(np.array([1e-4, 2e-4, 3e-4]), np.array([1e-3, 2e-3, 3e-3]))
        rotation = rng.normal([0.0, 0.002, 0.01], 0.004, (steps, 3))
        velocity = rng.normal([0.0, 0.0, 0.2], 0.02, (steps, 3))
        bias, rate = rng.normal(0.0, 0.01, 6), np.array([0.01, -0.02, 0.03])
        measured.append(Preintegration(noise, G, rate, bias, np.full(steps, duration), rotation, velocity))
    nav = Nav(so3_exp(rng.normal(0.0, 0.5, (4, 3))), rng.normal(0.0, 100.0, (4, 3)), rng.normal(0.0, 10.0, (4, 3)))
    return InertialFactors(tuple(measured)), replace(at_origin(4), nav=nav, bias=rng.normal(0.0, 0.02, (4, 6)))


def test_kernels_linearise_as_gtsam_does(turning: tuple[InertialFactors, States], with_both: WithBoth) -> None:
    """Whitened rows are in sigmas; these are of residuals of 1e5 sigmas and more."""
    factors, states = turning
    compiled, gtsams = with_both(lambda: factors.linearize(states))
    assert [slot.kind for slot in compiled.slots] == [slot.kind for slot in gtsams.slots]
    assert all((ours.index == theirs.index).all() for ours, theirs in zip(compiled.slots, gtsams.slots, strict=True))
    scale = np.abs(gtsams.rows).max(axis=2, keepdims=True)
    np.testing.assert_allclose(compiled.rows / scale, gtsams.rows / scale, atol=1e-11)
    costs, theirs = with_both(lambda: factors.costs(states))
    np.testing.assert_allclose(costs, theirs, rtol=1e-11)
    assert factors.cost(states) == pytest.approx(theirs.sum(), rel=1e-11)


@pytest.mark.parametrize("kernels", ["compiled"], indirect=True)
@pytest.mark.usefixtures("kernels")
def test_intervals_keep_no_copy_of_what_their_factors_have(turning: tuple[InertialFactors, States]) -> None:
    factors, states = turning
    alone = [replace(one).delta for one in factors.measured]
    cost = factors.cost(states)
    again = InertialFactors(factors.measured[1:])
    assert len({id(one.delta.base) for one in factors.measured}) == 1
    np.testing.assert_array_equal([one.delta for one in factors.measured], alone)
    assert again.cost(replace(states, nav=states.nav[1:], bias=states.bias[1:])) < cost == factors.cost(states)
    assert len({id(one.delta.base) for one in again.measured}) == 1


def test_kernels_predict_as_gtsam_does(turning: tuple[InertialFactors, States], with_both: WithBoth) -> None:
    factors, states = turning
    for k, measured in enumerate(factors.measured):
        ours, theirs = with_both(lambda k=k, one=measured: one.predicted(states.nav[k : k + 1], states.bias[k]))
        for name in ("R", "p", "v"):
            np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), rtol=1e-12, atol=1e-12)


def test_kernels_take_the_same_covariance_for_diagonal(with_both: WithBoth, at_origin: Callable[[int], States]) -> None:
    """GTSAM does so where all other entries are small: with an accelerometer of 1e-5 m/s^2/sqrt(Hz), for one."""
    increments, rate = steady(np.array([0.0, 0.0, 0.01]), np.array([0.0, 0.0, G]), 1.0), np.zeros(3)
    noise = PreintegrationNoise.alike(1e-6, 1e-5)
    one = Preintegration(noise, G, rate, np.zeros(6), increments.duration, increments.rotation, increments.velocity)
    states = at_origin(2)
    compiled, gtsams = with_both(lambda: InertialFactors((one,)).linearize(states))
    np.testing.assert_allclose(compiled.rows, gtsams.rows, rtol=1e-9, atol=1e-9 * np.abs(gtsams.rows).max())


def test_kernels_take_views_into_bytes() -> None:
    numbers = np.arange(12.0).reshape(4, 3)
    view = np.frombuffer(b"abc" + numbers.tobytes(), dtype="<f8", offset=3).reshape(4, 3)
    assert not view.flags.aligned
    taken = kernel_argument(view)
    assert (memoryview(taken).format, taken.flags.aligned) == ("d", True)
    np.testing.assert_array_equal(taken, numbers)


def test_kernels_take_numbers_of_a_declared_byte_order() -> None:
    compiled = pytest.importorskip("trackfg.numerics.compiled")
    t, edges, samples = np.array([1.5]), np.arange(4.0), np.arange(9.0).reshape(3, 3)
    means, again = np.empty((1, 3)), np.empty((1, 3))
    compiled.means_around(t, 1.0, edges, samples, means)
    declared = samples.view(np.dtype(np.float64).newbyteorder(sys.byteorder))
    assert memoryview(declared).format in ("<d", ">d")
    compiled.means_around(t, 1.0, edges, kernel_argument(declared), again)
    np.testing.assert_array_equal(again, means)
    swapped = samples.astype(np.dtype(np.float64).newbyteorder())
    compiled.means_around(t, 1.0, edges, kernel_argument(swapped), again)
    np.testing.assert_array_equal(again, means)


def test_kernels_refuse_arrays_that_do_not_belong_together(turning: tuple[InertialFactors, States]) -> None:
    compiled = pytest.importorskip("trackfg.numerics.compiled")
    (one, *_), states = turning[0].measured, turning[1]
    nav, exact = states.nav, replace(one, noise=PreintegrationNoise.alike(0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="do not belong together: inertial factors"):
        compiled.inertial_factors(one.delta[None], nav.R, nav.p, nav.v, states.bias, np.empty((1, 9, 25)))
    with pytest.raises(TypeError, match="expected an array of 2 dimensions of doubles, and not of 1"):
        compiled.predict(one.delta[None], *(np.zeros(3),) * 4, np.empty(15))
    with pytest.raises(ValueError, match="covariance of a preintegrated measurement is not positive definite"):
        np.isfinite(exact.delta)
