"""The past: what keyframes that are gone said of the next one and of the shared variables.

Once they are eliminated (:func:`trackfg.elimination.eliminate_leaving`), all their factors together are rows
``A x = b`` on the tangent x = (keyframe, shared variables) at the states where they were linearised. The factor keeps
these rows, and measures x from there however far the states have moved since. (Sibley, Matthies and Sukhatme, "Sliding
window filter with application to planetary landing", J. Field Robotics 27 (2010).)

Far away the chart matters. Until a vehicle has moved its heading may be off by any angle, while roll and pitch, and
their part in the accelerometer's bias, are known to a milliradian. So attitudes are compared by their angles roll,
pitch and yaw, which a turn about the vertical leaves apart: ``x = E0^-1 (angles - angles0)`` with E the matrix that
makes angular rates in body axes rates of the angles. To first order it is the tangent of the graph.
"""

from __future__ import annotations

import numpy as np

from trackfg.factors.family import Family, Slot
from trackfg.factors.states import ELIMINATION_ORDER, SHARED, Kind, Nav, States, Step, Value, offset_in_keyframe
from trackfg.frames import Array, body_rates, euler_rates, matrix_from_rpy, rpy_from_matrix

_KINDS = (*ELIMINATION_ORDER, *SHARED)
_IN_KEYFRAME = len(ELIMINATION_ORDER)


def away(value: Value, origin: Value) -> Array:
    """The tangents (m, dim) from ``origin`` to ``value``, in this module's chart."""
    if not (isinstance(value, Nav) and isinstance(origin, Nav)):
        return np.asarray(value, dtype=np.float64) - np.asarray(origin, dtype=np.float64)
    rpy = rpy_from_matrix(origin.R)
    angles = rpy_from_matrix(value.R) - rpy
    angles[:, 2] -= 2.0 * np.pi * np.round(angles[:, 2] / (2.0 * np.pi))
    turn = np.einsum("mij,mj->mi", body_rates(rpy), angles)
    shift, faster = (np.einsum("mji,mj->mi", origin.R, part) for part in (value.p - origin.p, value.v - origin.v))
    return np.concatenate([turn, shift, faster], axis=1)


def step_from(origin: States, states: States) -> Step:
    """The step from ``origin`` to other states of as many keyframes, in this chart."""
    parts = [away(states.of(kind), origin.of(kind)) for kind in _KINDS]
    return Step(np.concatenate(parts[:_IN_KEYFRAME], axis=1), np.concatenate(parts[_IN_KEYFRAME:], axis=1)[0])


def carried(origin: States, other: States) -> tuple[Array, Step]:
    """How a tangent from ``origin`` (one keyframe) depends on that from an ``other`` one near it: ``J y + c``.

    J (49, 49) and c.
    """
    J = np.eye(sum(kind.dim for kind in _KINDS))
    at = offset_in_keyframe(Kind.NAV)
    J[at : at + Kind.NAV.dim, at : at + Kind.NAV.dim] = _by_nav(other.nav, origin.nav)[0]
    return J, step_from(origin, other)


def moved_from(origin: States, step: Step) -> States:
    """``origin`` moved by a step in this chart."""
    states, turn = origin.moved(step), step.of(Kind.NAV)[:, :3]
    rpy = rpy_from_matrix(origin.nav.R)
    angles = rpy + np.einsum("mij,mj->mi", euler_rates(rpy), turn)
    return states.turned(matrix_from_rpy(*angles.T))


def _past(*parts: Value) -> tuple[Array, tuple[Array, ...]]:
    values, (R, p, v, *others, A, b) = parts[: len(_KINDS)], (np.asarray(part) for part in parts[len(_KINDS) :])
    origins: dict[Kind, Array] = dict(zip((kind for kind in _KINDS if kind is not Kind.NAV), others, strict=True))
    residual, jacobians = -b, []
    for kind, value in zip(_KINDS, values, strict=True):
        at = offset_in_keyframe(kind)
        block = A[:, :, at : at + kind.dim]
        origin = Nav(R, p, v) if isinstance(value, Nav) else origins[kind]
        residual = residual + np.einsum("mij,mj->mi", block, away(value, origin))
        jacobians.append(block @ _by_nav(value, Nav(R, p, v)) if isinstance(value, Nav) else block)
    return residual, tuple(jacobians)


def _by_nav(value: Nav, origin: Nav) -> Array:
    """The derivative of :func:`away` by the tangent of ``value``."""
    out = np.zeros((len(value), Kind.NAV.dim, Kind.NAV.dim))
    out[:, :3, :3] = body_rates(rpy_from_matrix(origin.R)) @ euler_rates(rpy_from_matrix(value.R))
    out[:, 3:6, 3:6] = out[:, 6:, 6:] = np.swapaxes(origin.R, 1, 2) @ value.R
    return out


def past(rows: Array, origin: States) -> Family:
    """Rows [A b] (r, 50) of the first keyframe and the shared variables, linearised at ``origin`` (one keyframe).

    Residual: ``A x - b``, in sigmas, with x from ``origin``.
    """
    zero = np.zeros(1, dtype=np.int64)
    nav = origin.nav
    others = [np.asarray(origin.of(kind)) for kind in _KINDS if kind is not Kind.NAV]
    data = (nav.R, nav.p, nav.v, *others, rows[None, :, :-1], rows[None, :, -1])
    return Family("past", _past, tuple(Slot(kind, zero) for kind in _KINDS), data, np.ones((1, len(rows))))
