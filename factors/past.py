"""The past: what keyframes that are gone said of the next one and of the shared variables.

Once they are eliminated (:func:`trackfg.elimination.left_behind`), all their factors together are rows ``A x = b`` on
the tangent x = (keyframe, shared variables) at the states where they were linearised. The factor keeps these rows, and
measures x from there however far the states have moved since. (Sibley, Matthies and Sukhatme, "Sliding window filter
with application to planetary landing", J. Field Robotics 27 (2010).)
"""

from __future__ import annotations

import numpy as np

from trackfg.factors.family import Family, Slot
from trackfg.factors.states import ELIMINATION_ORDER, SHARED, Kind, Nav, States, Value, local, offset_in_keyframe
from trackfg.frames import Array, so3_right_jacobian_inverse

_KINDS = (*ELIMINATION_ORDER, *SHARED)


def _past(*parts: Value) -> tuple[Array, tuple[Array, ...]]:
    values, (R, p, v, *others, A, b) = parts[: len(_KINDS)], parts[len(_KINDS) :]
    origins = dict(zip((kind for kind in _KINDS if kind is not Kind.NAV), others, strict=True))
    residual = -np.asarray(b)
    jacobians = []
    for kind, value in zip(_KINDS, values, strict=True):
        at = offset_in_keyframe(kind)
        block = np.asarray(A)[:, :, at : at + kind.dim]
        if isinstance(value, Nav):
            origin = Nav(np.asarray(R), np.asarray(p), np.asarray(v))
            away = local(value, origin)
            turned = np.swapaxes(origin.R, 1, 2) @ value.R
            by_nav = np.zeros((len(value), 9, 9))
            by_nav[:, :3, :3] = so3_right_jacobian_inverse(away[:, :3])
            by_nav[:, 3:6, 3:6] = by_nav[:, 6:, 6:] = turned
            jacobians.append(block @ by_nav)
        else:
            away = local(value, origins[kind])
            jacobians.append(block)
        residual = residual + np.einsum("mij,mj->mi", block, away)
    return residual, tuple(jacobians)


def past(rows: Array, origin: States) -> Family:
    """Rows [A b] (r, 50) of the first keyframe and the shared variables, linearised at ``origin`` (one keyframe).

    Residual: ``A x - b``, in sigmas, with x the tangent from ``origin``.
    """
    zero = np.zeros(1, dtype=np.int64)
    nav = origin.nav
    others = [np.asarray(origin.of(kind)) for kind in _KINDS if kind is not Kind.NAV]
    data = (nav.R, nav.p, nav.v, *others, rows[None, :, :-1], rows[None, :, -1])
    return Family("past", _past, tuple(Slot(kind, zero) for kind in _KINDS), data, np.ones((1, len(rows))))
