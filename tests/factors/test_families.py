"""Every family: analytic Jacobians against numerical ones, array form against per-factor form, refusal of bad input."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import gtsam
import numpy as np
import pytest

from trackfg.factors.bias import bias_walk
from trackfg.factors.checking import check_jacobians
from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family
from trackfg.factors.further_sensors import speed_distance, tach_increment
from trackfg.factors.gnss import ReceiverSpeeds, gnss_position, gnss_speed
from trackfg.factors.gravity import gravity_tilt
from trackfg.factors.gtsam_bridge import custom_factors, with_frozen_chain
from trackfg.factors.landmark import OnLine, across_line, along_line, balise_passage, landmark
from trackfg.factors.linear import Slot
from trackfg.factors.loss import Cauchy, Huber, Loss, SwitchChain
from trackfg.factors.motion import at_rest, non_holonomic, stays
from trackfg.factors.odometry import absolute_fix, arc_length, distance_chain, tach_distance, tach_reading
from trackfg.factors.path import follows_path
from trackfg.factors.prior import nav_prior, prior
from trackfg.factors.rail import RailSightings, same_rail
from trackfg.factors.states import KEYFRAME_DIM, SHARED_DIM, Kind, Nav, Odo, States, Step, vectors
from trackfg.numerics.rotations import so3_exp

KEYFRAMES = 6
WithBoth = Callable[[Callable[[], Any]], tuple[Any, Any]]


@cache
def random_states(seed: int, spread: float = 1.0) -> States:
    rng = np.random.default_rng(seed)

    def normal(*shape: int) -> np.ndarray:
        return rng.normal(size=shape)

    base = so3_exp(normal(1, 3))
    nav = Nav(base @ so3_exp(spread * normal(KEYFRAMES, 3)), 5 * normal(KEYFRAMES, 3), 5 * normal(KEYFRAMES, 3))
    odo = Odo(normal(KEYFRAMES, 4) * [10, 0.1, 10, 3] + [0, 1, 0, 0])
    shared = (0.3 * normal(1, 5), normal(1, 3), 0.1 * normal(1, Kind.IMU.dim), normal(1, 5), normal(2, 2))
    return States(nav, normal(KEYFRAMES, 6), odo, *shared)


@cache
def families(seed: int, loss: Loss | None = None) -> list[Family]:
    rng = np.random.default_rng(seed)
    all_k, first = np.arange(KEYFRAMES), np.arange(KEYFRAMES - 1)

    def normal(*shape: int) -> np.ndarray:
        return rng.normal(size=shape)

    def sigma(m: int, d: int) -> np.ndarray:
        return rng.uniform(0.1, 2.0, (m, d))

    def near_one(m: int) -> np.ndarray:
        return so3_exp(0.3 * normal(m, 3))

    n, f, lever = KEYFRAMES, KEYFRAMES - 1, normal(3)
    speeds = ReceiverSpeeds(normal(n), normal(n), normal(n, 3), normal(n, 3), sigma(n, 1))

    def rail_pairs(lead: np.ndarray, start: np.ndarray) -> tuple[Family, Family]:
        m = len(lead)
        seen = RailSightings(
            first=lead,
            start=start,
            fraction=rng.uniform(0.0, 1.0, m),
            interval=rng.uniform(0.5, 2.0, m),
            across=normal(m, 2, 3),
            lead=normal(m, 3),
            trail=normal(m, 3),
            turned=near_one(m),
            turn=near_one(m),
            detail=0.01 * normal(m, 3),
        )
        return same_rail(seen, sigma(m, 2), loss)

    return [
        non_holonomic(all_k, normal(n, 3), lever, sigma(n, 1)[:, 0], 0.1 * sigma(n, 2), sigma(n, 2), loss),
        at_rest(all_k, 0.01, loss),
        stays(first, 0.02, 0.3, loss),
        gravity_tilt(all_k, 9 * normal(n, 3), 9.8, sigma(n, 3)),
        distance_chain(first, sigma(f, 2)),
        tach_distance(first, normal(f, 5), sigma(f, 1), loss),
        tach_reading(all_k, normal(n), normal(n), normal(n), sigma(n, 1)),
        arc_length(first, lever, sigma(f, 1)),
        absolute_fix(all_k, normal(n), sigma(n, 1), loss),
        landmark(first, rng.uniform(0.0, 1.0, f), normal(f), sigma(f, 1), loss),
        balise_passage(all_k, normal(n), all_k % 3, 0, sigma(n, 1), loss),
        gnss_position(all_k, normal(n, 3), lever, normal(n), sigma(n, 3), loss),
        gnss_position(all_k, normal(n, 3), lever, normal(n), sigma(n, 3), loss, 1),
        gnss_speed(all_k, 1, speeds, lever, sigma(n, 1), loss),
        across_line(OnLine(all_k, normal(n, 2), normal(n, 2)), lever, sigma(n, 1), loss),
        along_line(
            OnLine(first, normal(f, 2), normal(f, 2)),
            OnLine(first + 1, normal(f, 2), normal(f, 2)),
            rng.uniform(0.5, 1.0, f),
            lever,
            sigma(f, 1),
            loss,
        ),
        follows_path(first, near_one(f), near_one(f) * 0.9, near_one(f) * 0.5, lever, sigma(f, 2), loss),
        prior(Kind.BIAS, all_k, normal(n, 6), sigma(n, 6)),
        prior(Kind.MOUNT, np.array([0]), normal(1, 5), sigma(1, 5)),
        bias_walk(first, normal(f, 6, Kind.IMU.dim), sigma(f, 6)),
        prior(Kind.IMU, np.array([0]), normal(1, Kind.IMU.dim), sigma(1, Kind.IMU.dim)),
        prior(Kind.CLOCK, np.array([0]), normal(1, 3), sigma(1, 3)),
        prior(Kind.WHEEL, np.array([0]), normal(1, 5), sigma(1, 5)),
        rail_pairs(first, first)[0],
        rail_pairs(first[:-2], first[:-2] + 2)[1],
        prior(Kind.SENSOR, np.array([0, 1]), normal(2, 2), sigma(2, 2)),
        tach_increment(
            first, 1, {"counted": normal(f), "faster": normal(f), "response": normal(f, 5)}, sigma(f, 1), loss, "tach/2"
        ),
        speed_distance(
            first, 0, {"distance": normal(f), "swing": normal(f), "across": normal(f)}, sigma(f, 1), loss, "speed/1"
        ),
        nav_prior(all_k, Nav(so3_exp(normal(n, 3)), normal(n, 3), normal(n, 3)), sigma(n, 9), lever),
    ]


NAMES = [family.name for family in families(0)]


@pytest.mark.parametrize("i", range(len(NAMES)), ids=NAMES)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("spread", [0.0, 1e-4, 0.02, 0.5])
def test_jacobians_match_numerical_ones(i: int, seed: int, spread: float) -> None:
    family = families(seed)[i]
    if family.type is FactorType.PRIOR_NAV:
        spread = min(spread, 0.5)
    check_jacobians(family, random_states(seed, spread), rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("spread", [0.0, 1e-4, 0.02, 0.5])
@pytest.mark.parametrize(
    "loss", [None, Huber(0.5), Cauchy(2.0), SwitchChain(3.5)], ids=lambda loss: type(loss).__name__
)
def test_kernels_compute_what_numpy_does(seed: int, spread: float, loss: Loss | None, with_both: WithBoth) -> None:
    """Rows, residuals, weights and costs, of families that have a kernel and of those that have none."""
    states = random_states(seed, spread)

    def computed(family: Family) -> tuple[Any, ...]:
        return family.linearize(states).rows, family.whitened(states), family.weights(states), family.cost(states)

    for family in families(seed, loss):
        ours, theirs = with_both(lambda family=family: computed(family))
        for found, expected in zip(ours, theirs, strict=True):
            scale = max(1.0, float(np.abs(expected).max()))
            np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-11 * scale, err_msg=family.name)


def test_a_kernel_takes_measurements_as_they_lie_in_memory(with_both: WithBoth) -> None:
    """Transposed, or every second one."""
    states, family = random_states(0), families(0)[0]
    rate = np.asfortranarray(family.data["angular_rate"])
    for one in (family.with_data(angular_rate=rate), family.take(slice(None, None, 2))):
        ours, theirs = with_both(lambda one=one: one.linearize(states).rows)
        np.testing.assert_allclose(ours, theirs, rtol=1e-10, atol=1e-11)


def test_a_kernel_takes_measurements_of_a_declared_byte_order(with_both: WithBoth) -> None:
    """Arrays of MATLAB's files declare it."""
    states, family = random_states(0), families(0)[0]
    declared = family.data["angular_rate"].view(np.dtype(np.float64).newbyteorder(sys.byteorder))
    ours, theirs = with_both(lambda: family.with_data(angular_rate=declared).linearize(states).rows)
    np.testing.assert_allclose(ours, theirs, rtol=1e-10, atol=1e-11)


def test_residuals_that_are_not_finite_are_refused(kernels: str) -> None:
    """Nor are those beyond all bounds."""
    states = random_states(0)
    far = replace(states, nav=Nav(states.nav.R, states.nav.p, np.full_like(states.nav.v, 1e200)))
    with (
        np.errstate(over="ignore"),
        pytest.raises(ValueError, match="at rest: residual or Jacobian is not finite"),
    ):
        families(0)[1].linearize(far)


def test_checker_finds_a_wrong_jacobian() -> None:
    good = families(0)[0]

    def wrong(*values: object, **data: np.ndarray) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
        residual, jacobians = good.evaluate(*values, **data)
        return residual, (jacobians[0] * 1.001, jacobians[1])

    with pytest.raises(AssertionError, match=r"non-holonomic: d residual\[\d\] / d NAV\[\d\] of factor 0"):
        check_jacobians(Family(good.type, wrong, good.slots, good.data, good.sigma), random_states(0))


LOSSES = (Huber(1.3), Cauchy(2.0))


@pytest.mark.parametrize("loss", LOSSES, ids=lambda loss: type(loss).__name__)
def test_weight_is_the_slope_of_the_loss_over_the_error_and_1_for_small_ones(loss: Loss) -> None:
    error, step = np.concatenate([np.linspace(0.05, 10.0, 200), [50.0, 500.0]]), 1e-5
    slope = (loss.cost(error + step) - loss.cost(error - step)) / (2.0 * step)
    np.testing.assert_allclose(loss.weight(error) * error, slope, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(loss.cost(np.array([0.0, 0.1])), [0.0, 0.005], rtol=0.2, atol=1e-12)


@pytest.mark.parametrize("loss", [None, *LOSSES], ids=lambda loss: "plain" if loss is None else type(loss).__name__)
@pytest.mark.parametrize("i", range(len(NAMES)), ids=NAMES)
def test_array_form_equals_per_factor_form(i: int, loss: Loss | None) -> None:
    states = random_states(3, 0.3)
    family = families(3, loss)[i]
    linear = family.linearize(states)
    values = states.to_gtsam()
    graph = gtsam.NonlinearFactorGraph()
    for factor in custom_factors(family):
        graph.push_back(factor)
    single = graph.linearize(values)
    assert len(linear.rows) == single.size() == len(family)
    for k in range(len(family)):
        assert [slot.keys[k] for slot in linear.slots] == list(single.at(k).keys())
        np.testing.assert_allclose(linear.rows[k], single.at(k).augmentedJacobian(), rtol=1e-9, atol=1e-9)
    ours = [*linear.jacobians, linear.b[:, :, None]]
    np.testing.assert_array_equal(np.concatenate(ours, axis=2), linear.rows)
    assert family.cost(states) == pytest.approx(graph.error(values), rel=1e-9)


def test_a_chained_loss_is_frozen_before_gtsam_sees_it() -> None:
    """Each factor then has the weight that the whole chain gives it."""
    states, chain = random_states(4, 0.3), SwitchChain(3.0, 0.5)
    first = np.arange(KEYFRAMES - 1)
    family = tach_distance(first, np.zeros((len(first), 5)), np.full((len(first), 1), 2.0), chain)
    with pytest.raises(ValueError, match="chained loss"):
        custom_factors(family)
    frozen = with_frozen_chain(family, states)
    assert np.ptp(family.weights(states)) > 0.1
    np.testing.assert_allclose(frozen.linearize(states).rows, family.linearize(states).rows, rtol=1e-12)
    assert len(custom_factors(frozen)) == len(family)


def assert_same(values: gtsam.Values, states: States, rounding: float) -> None:
    for kind in Kind:
        for i, key in enumerate(kind.keys(np.arange(len(states.of(kind)))).tolist()):
            if kind is Kind.NAV:
                nav = values.atNavState(key)
                np.testing.assert_allclose(nav.attitude().matrix(), states.nav.R[i], atol=rounding)
                np.testing.assert_allclose(nav.position(), states.nav.p[i], rtol=rounding)
                np.testing.assert_allclose(nav.velocity(), states.nav.v[i], rtol=rounding)
            else:
                vector = values.atConstantBias(key).vector() if kind is Kind.BIAS else values.atVector(key)
                np.testing.assert_allclose(vector, vectors(states.of(kind))[i], rtol=rounding)


def test_gtsam_has_the_same_states() -> None:
    states = random_states(5)
    assert_same(states.to_gtsam(), states, 1e-15)


@pytest.mark.parametrize("scale", [1.0, 0.25])
def test_a_step_moves_gtsams_values_and_ours_alike(scale: float) -> None:
    rng, states = np.random.default_rng(6), random_states(5)
    step = Step(rng.normal(size=(len(states), KEYFRAME_DIM)), rng.normal(size=SHARED_DIM + states.sensor.size)).scaled(
        scale
    )
    assert_same(states.to_gtsam().retract(step.to_gtsam()), states.moved(step), 1e-12)


def test_keys_are_gtsam_symbols() -> None:
    assert Kind.NAV.keys(np.array([7])).tolist() == [gtsam.symbol("n", 7)]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda: absolute_fix(np.arange(3), np.array([1.0, np.nan, 2.0]), np.ones((3, 1)), None), "finite"),
        (lambda: absolute_fix(np.arange(3), np.ones(2), np.ones((3, 1)), None), "3 rows"),
        (lambda: absolute_fix(np.arange(3), np.ones(3), np.zeros((3, 1)), None), "positive"),
        (lambda: absolute_fix(np.arange(3), np.ones(3), np.ones(3), None), "shape"),
        (lambda: absolute_fix(np.arange(2), np.ones(3), np.ones((3, 1)), None), "slot ODO"),
    ],
)
def test_bad_measurements_are_refused(change: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        change()  # type: ignore[operator]


@pytest.mark.parametrize(
    ("slots", "distance", "sigma", "message"),
    [
        ([0, 1], np.ones((2, 1)), np.ones((2, 1)), "absolute fix: slot ODO is a list; expected an array"),
        (np.arange(2), [[1.0], [1.0]], np.ones((2, 1)), "absolute fix: distance is a list"),
        (np.arange(2), np.ones((2, 1)), 0.5, "absolute fix: sigma is a float"),
    ],
)
def test_what_is_no_array_is_named(slots: Any, distance: Any, sigma: Any, message: str) -> None:
    good = absolute_fix(np.arange(2), np.ones(2), np.ones((2, 1)), None)
    with pytest.raises(TypeError, match=message):
        Family(good.type, good.evaluate, (Slot(Kind.ODO, slots),), {"distance": distance}, sigma)


def test_wrong_shapes_never_reach_gtsam() -> None:
    good = families(0)[4]

    def wrong(*values: object, **data: np.ndarray) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
        residual, jacobians = good.evaluate(*values, **data)
        return residual, tuple(jacobian[:, :, :2] for jacobian in jacobians)

    bad = Family(good.type, wrong, good.slots, good.data, good.sigma)
    with pytest.raises(ValueError, match="Jacobian of ODO"):
        bad.linearize(random_states(0))


def test_arc_is_exact_on_a_circle_and_signed() -> None:
    radius, angles = 300.0, np.array([0.0, 0.1, 0.35, 0.3])
    yaw = so3_exp(np.outer(angles, [0, 0, 1.0]))
    p = radius * np.stack([np.sin(angles), 1 - np.cos(angles), np.zeros(4)], axis=1)
    nav = Nav(yaw, p, np.zeros((4, 3)))
    states = States(
        nav, np.zeros((4, 6)), Odo(np.zeros((4, 4))), np.zeros((1, 5)), np.zeros((1, 3)), np.zeros((1, Kind.IMU.dim))
    )
    arcs = arc_length(np.arange(3), np.zeros(3), np.ones((3, 1))).residual(states)[:, 0]
    np.testing.assert_allclose(arcs, radius * np.diff(angles), rtol=1e-12)
