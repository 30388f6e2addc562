"""The marginal prior holds the information of marginalised keyframes about the next one and about the shared variables.

Once keyframes are eliminated (:func:`trackfg.solver.elimination.eliminate_with_marginals`), all their factors together
are rows ``A x = b`` on the tangent x = (keyframe, shared variables) at the states where they were linearised. The
factor keeps these rows, and measures x from that linearisation point however far the states have moved since. (Sibley,
Matthies and Sukhatme, "Sliding window filter with application to planetary landing", J. Field Robotics 27 (2010).)

Far from the linearisation point the chart matters. Until a vehicle has moved its heading may be off by any angle, while
roll and pitch, and their part in the accelerometer's bias, are known to a milliradian. So attitudes are compared by
their angles roll, pitch and yaw, which a turn about the vertical leaves apart: ``x = E0^-1 (angles - angles0)`` with E
the matrix that makes angular rates in body axes rates of the angles. Velocities are compared in the vehicle's own axes,
each at its own attitude, ``x_v = R'v - R0'v0 - R0'v0 x x_turn``: a turn about the vertical leaves what is known of the
speed alone, however far it goes, where a tangent would make the vehicle faster by ``v turn^2 / 2``. To first order x is
the tangent of the graph.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, in_kernel
from trackfg.factors.linear import Slot
from trackfg.factors.states import (
    ELIMINATION_ORDER,
    KEYFRAME_DIM,
    SHARED,
    SHARED_DIM,
    Kind,
    Nav,
    Odo,
    States,
    Step,
    Value,
    offset_in_keyframe,
    vectors,
)
from trackfg.numerics.arrays import Array
from trackfg.numerics.kernels import compiled_kernels, kernel_argument
from trackfg.numerics.rotations import body_rates, cross, euler_rates, matrix_from_rpy, rpy_from_matrix, skew

_KINDS = (*ELIMINATION_ORDER, *SHARED)
_OTHERS = tuple(kind for kind in _KINDS if kind is not Kind.NAV)
_IN_KEYFRAME = len(ELIMINATION_ORDER)
_SLOTS = tuple(Slot(kind, np.zeros(1, dtype=np.int64)) for kind in _KINDS)
"""A marginal prior is on keyframe 0 and the shared variables."""

_ORIGINS = ("R", "p", "v", "bias", "odo", "mount", "clock", "imu", "wheel")
"""The linearisation point in the data of a marginal prior, in the order of :attr:`States.arrays`."""


def local_coordinates(value: Value, origin: Value) -> Array:
    """Return the tangents (m, dim) from ``origin`` to ``value``, in this module's chart."""
    if not (isinstance(value, Nav) and isinstance(origin, Nav)):
        return vectors(value) - vectors(origin)
    rpy = rpy_from_matrix(origin.R)
    return _nav_coordinates(value, origin, rpy_from_matrix(value.R), rpy, body_rates(rpy))


def _nav_coordinates(value: Nav, origin: Nav, rpy: Array, rpy_origin: Array, rates: Array) -> Array:
    """Return the tangents of NAV; ``rpy`` (m, 3) of both, ``rates`` are the body rates at the origin."""
    angles = rpy - rpy_origin
    angles[:, 2] -= 2.0 * np.pi * np.round(angles[:, 2] / (2.0 * np.pi))
    turn = np.einsum("mij,mj->mi", rates, angles)
    shift = np.einsum("mji,mj->mi", origin.R, value.p - origin.p)
    velocity = origin.own_velocity
    return np.concatenate([turn, shift, value.own_velocity - velocity - cross(velocity, turn)], axis=1)


def step_from(origin: States, states: States) -> Step:
    """Return the step from ``origin`` to other states of as many keyframes, in this chart."""
    if compiled_kernels():
        from trackfg.numerics import compiled

        keyframes, shared = np.empty((len(states), KEYFRAME_DIM)), np.empty(SHARED_DIM)
        compiled.step_from(origin.arrays, states.arrays, keyframes, shared)
        return Step(keyframes, np.concatenate([shared, (states.sensor - origin.sensor).ravel()]))
    parts = [local_coordinates(states.of(kind), origin.of(kind)) for kind in (*_KINDS, Kind.SENSOR)]
    shared = np.concatenate([part.ravel() for part in parts[_IN_KEYFRAME:]])
    return Step(np.concatenate(parts[:_IN_KEYFRAME], axis=1), shared)


def change_of_linearisation_point(origin: States, other: States) -> tuple[Array, Step]:
    """Return J and c of ``x = J y + c``: x a tangent from ``origin`` (one keyframe), y one from the ``other`` point.

    J is square, of KEYFRAME_DIM + SHARED_DIM.
    """
    J = np.eye(sum(kind.dim for kind in _KINDS) + origin.sensor.size)
    at = offset_in_keyframe(Kind.NAV)
    J[at : at + Kind.NAV.dim, at : at + Kind.NAV.dim] = _by_nav(
        other.nav, origin.nav, rpy_from_matrix(other.nav.R), body_rates(rpy_from_matrix(origin.nav.R))
    )[0]
    return J, step_from(origin, other)


def retract_in_chart(origin: States, step: Step) -> States:
    """Return ``origin`` moved by a step in this chart."""
    if compiled_kernels():
        return origin.moved_by_kernel(step, in_chart=True)
    states, x = origin.moved(step), step.of(Kind.NAV)
    turn, rpy, velocity = x[:, :3], rpy_from_matrix(origin.nav.R), origin.nav.own_velocity
    angles = rpy + np.einsum("mij,mj->mi", euler_rates(rpy), turn)
    R = matrix_from_rpy(*angles.T)
    v = np.einsum("mij,mj->mi", R, velocity + x[:, 6:] + cross(velocity, turn))
    return replace(states, nav=Nav(R, states.nav.p, v))


class PriorRows:
    """The kernel of a marginal prior in ``kernels/factors.cpp``."""

    @staticmethod
    def arguments(family: Family, states: States) -> tuple[Array, int, tuple[Array, ...], Array, Array, Array, Array]:
        """Return what the kernel takes of a family and of the further sensors' states."""
        data = family.data
        origin, A, b, sigma = [
            kernel_argument(array[0]) for array in (data["sensor"], data["A"], data["b"], family.sigma)
        ]
        sensor, keyframe = kernel_argument(states.sensor[: len(origin)]), int(family.slots[0].index[0])
        return sensor, keyframe, tuple([kernel_argument(data[name]) for name in _ORIGINS]), origin, A, b, sigma

    def __call__(self, family: Family, states: States, _width: float, rows: Array) -> bool:
        """Do as :func:`_marginal`: see :data:`trackfg.factors.family.Kernel`."""
        from trackfg.numerics import compiled

        return compiled.marginal_prior(states.arrays, *self.arguments(family, states), rows[0])


@in_kernel(PriorRows())
def _marginal(
    *values: Value, R: Array, p: Array, v: Array, A: Array, b: Array, **origins: Array
) -> tuple[Array, tuple[Array, ...]]:
    sensors = len(values) - len(_KINDS)
    kinds, at = (*_KINDS, *[Kind.SENSOR] * sensors), 0
    vector_origins = iter([
        *(origins[kind.attribute] for kind in _OTHERS), *(origins["sensor"][:, j] for j in range(sensors))
    ])  # fmt: skip
    tangents, jacobians = [], []
    for kind, value in zip(kinds, values, strict=True):
        block = A[:, :, at : at + kind.dim]
        at += kind.dim
        if isinstance(value, Nav):
            origin, (rpy, rpy_origin) = Nav(R, p, v), (rpy_from_matrix(rotation) for rotation in (value.R, R))
            rates = body_rates(rpy_origin)
            tangents.append(_nav_coordinates(value, origin, rpy, rpy_origin, rates))
            block = block @ _by_nav(value, origin, rpy, rates)
        else:
            tangents.append(vectors(value) - next(vector_origins))
        jacobians.append(block)
    x = np.concatenate(tangents, axis=1)
    return (A @ x[:, :, None])[:, :, 0] - b, tuple(jacobians)


def _by_nav(value: Nav, origin: Nav, rpy: Array, rates: Array) -> Array:
    """Return the derivative of :func:`_nav_coordinates` by the tangent of ``value``."""
    out = np.zeros((len(value), Kind.NAV.dim, Kind.NAV.dim))
    out[:, :3, :3] = rates @ euler_rates(rpy)
    out[:, 3:6, 3:6] = np.swapaxes(origin.R, 1, 2) @ value.R
    out[:, 6:, :3] = skew(value.own_velocity) - skew(origin.own_velocity) @ out[:, :3, :3]
    out[:, 6:, 6:] = np.eye(3)
    return out


def marginal_prior(rows: Array, origin: States) -> Family:
    """Return rows [A b] of the first keyframe and the shared variables, linearised at ``origin``, as a family of one.

    ``rows`` has the shape (r, KEYFRAME_DIM + SHARED_DIM + 1), ``origin`` one keyframe. Residual: ``A x - b``,
    in sigmas, with x from ``origin``.
    """
    if not np.isfinite(rows).all():
        raise ValueError("rows of a marginal prior must be finite")
    A, b = np.ascontiguousarray(rows[:, :-1]), np.ascontiguousarray(rows[:, -1])
    data = dict(zip(_ORIGINS, origin.arrays, strict=True))
    data |= {"sensor": origin.sensor[None], "A": A[None], "b": b[None]}
    sensors = tuple(Slot(Kind.SENSOR, j) for j in np.arange(len(origin.sensor))[:, None])
    return Family.sound(FactorType.MARGINAL_PRIOR, _marginal, (*_SLOTS, *sensors), data, np.ones((1, len(rows))))


def delayed_position(rows: Array, origin: States) -> Family:
    """Return what a position passed before the first keyframe says about it, as a :func:`marginal_prior`."""
    return replace(marginal_prior(rows, origin), type=FactorType.DELAYED_POSITION)


def rebased_to_interval_bias(family: Family, response: Array) -> Family:
    """Re-express a marginal prior when its keyframe becomes the start of an interval.

    The bias state then includes what the calibration c adds over the interval, ``b = own + response c``, with
    ``response`` (6, dim of c).
    """
    bias, imu = (family.data[kind.attribute] for kind in (Kind.BIAS, Kind.IMU))
    at_bias, at_imu = (offset_in_keyframe(kind) for kind in (Kind.BIAS, Kind.IMU))
    A = family.data["A"][0].copy()
    A[:, at_imu : at_imu + Kind.IMU.dim] -= A[:, at_bias : at_bias + Kind.BIAS.dim] @ response
    return family.with_data(A=A[None], bias=bias + imu @ response.T)


def with_distance_shifted(family: Family, by_m: float, sd_m: float) -> Family:
    """Move a marginal prior along the track by ``by_m``, uncertain to ``sd_m``; all else stays.

    Its distance D was wrong by e ~ N(by, sd^2), e being counted from D + by.
    """
    odo = Odo(family.data["odo"]).moved_along(by_m).array
    errors = np.zeros((1, family.data["A"].shape[2]))
    errors[0, offset_in_keyframe(Kind.ODO) + Odo.DISTANCE] = sd_m
    return _with_errors(family.with_data(odo=odo), errors)


def with_scale_walked(family: Family, way_m: float, per_sqrt_m: float) -> Family:
    """Let the wheel's scale have walked over the last ``way_m`` (signed) before a marginal prior; all else stays.

    Its scale S was wrong by s, its distance D by d, and its velocity v by ``v s / S``, where a scale that walks by
    ``per_sqrt_m`` = q in every root of a metre makes

        Cov(d, s) = q^2 [w^3 / 3, w^2 / 2; w^2 / 2, w].
    """
    root_way, odo = np.sqrt(abs(way_m)), Odo(family.data["odo"])
    distance, scale, velocity = np.zeros((3, family.data["A"].shape[2]))
    at = offset_in_keyframe(Kind.ODO)
    distance[at + Odo.DISTANCE], scale[at + Odo.SCALE] = 1.0, 1.0
    at = offset_in_keyframe(Kind.NAV) + 6
    velocity[at : at + 3] = Nav(*(family.data[name] for name in ("R", "p", "v"))).own_velocity[0] / odo.scale[0]
    with_scale = scale + velocity + 0.5 * way_m * distance
    alone = np.sqrt(1.0 / 12.0) * way_m * distance
    return _with_errors(family, per_sqrt_m * root_way * np.stack([with_scale, alone]))


def _with_errors(family: Family, errors: Array) -> Family:
    """Return a marginal prior that may be wrong by each of the ``errors`` (k, n) times a normal variable, eliminated.

    ``A (x - errors' e) = b``, ``e = 0`` of unit sigma.
    """
    k, (A, b) = len(errors), (family.data[name][0] for name in ("A", "b"))
    rows = np.block([[np.eye(k), np.zeros((k, A.shape[1] + 1))], [-A @ errors.T, A, b[:, None]]])
    remainder = np.asarray(np.linalg.qr(rows, mode="r"))[k:, k:]
    return replace(
        family.with_data(A=remainder[None, :, :-1], b=remainder[None, :, -1]), sigma=np.ones((1, len(remainder)))
    )
