"""Two displacement sensors that pass one place of a rail, one after the other: the difference method as a factor.

The leading unit sees the rail at ``b_i`` (body axes, from the IMU) at keyframe i; the trailing one sees the same place
of it at ``b`` at a time between keyframes j and j + 1, a fraction h of the interval T after j. Both points are one
point of the rail, up to how far apart along it they were taken:

    N ( p_i + R_i b_i - p(h) - R(h) b ) = 0,

N (d, 3) the directions across the rail. Between keyframes the motion is what inertial samples say it is, tied to both
ends as in :mod:`trackfg.output.dense_motion`:

    R(h) = R_j A Exp(h e),  e = Log(A_T' R_j' R_j+1),   A the gyro's rotation until then, A_T over the whole interval;
    p(h) = the cubic of both ends' positions and velocities, plus the detail c that the accelerometer saw between them.

(Suto, Tsubokawa, Yoshida use the first and second difference of such readings as a filter; the paper of the difference
method cited in docs/geometry.md.)
"""

from __future__ import annotations

import numpy as np

from trackfg.factors.family import Family, Loss, Slot
from trackfg.factors.states import Kind, Nav
from trackfg.numerics.arrays import Array
from trackfg.numerics.hermite import hermite_weights
from trackfg.numerics.rotations import skew, so3_exp, so3_log, so3_right_jacobian_inverse


def _trailing(
    start: Nav, end: Nav, h: Array, T: Array, A: Array, A_T: Array, detail: Array, b: Array
) -> tuple[Array, Array, Array]:
    """The point p(h) + R(h) b (m, 3), and its derivatives by both ends (m, 3, 9)."""
    h1, T1 = h[:, None], T[:, None]
    w0, w1, u0, u1 = hermite_weights(h1, T1)
    p = w0 * start.p + w1 * end.p + u0 * start.v + u1 * end.v + detail

    relative = np.swapaxes(start.R, 1, 2) @ end.R
    e = so3_log(np.swapaxes(A_T, 1, 2) @ relative)
    late = so3_exp(h1 * e)
    R = start.R @ A @ late
    point = p + np.einsum("mij,mj->mi", R, b)

    # R(h) Exp(d): d by both ends' own rotations.
    by_e = h[:, None, None] * np.linalg.solve(so3_right_jacobian_inverse(h1 * e), so3_right_jacobian_inverse(e))
    d_start = np.swapaxes(A @ late, 1, 2) - by_e @ np.swapaxes(relative, 1, 2)
    turned = -R @ skew(b)
    by_start = np.concatenate([turned @ d_start, w0[:, :, None] * start.R, u0[:, :, None] * start.R], axis=2)
    by_end = np.concatenate([turned @ by_e, w1[:, :, None] * end.R, u1[:, :, None] * end.R], axis=2)
    return point, by_start, by_end


def _leading(nav: Nav, b: Array) -> tuple[Array, Array]:
    point = nav.p + np.einsum("mij,mj->mi", nav.R, b)
    return point, np.concatenate([-nav.R @ skew(b), nav.R, np.zeros_like(nav.R)], axis=2)


def _apart(
    first: Nav, start: Nav, end: Nav, N: Array, b_first: Array, *trailing: Array
) -> tuple[Array, tuple[Array, ...]]:
    lead, by_first = _leading(first, b_first)
    trail, by_start, by_end = _trailing(start, end, trailing[0][:, 0], trailing[1][:, 0], *trailing[2:])
    return np.einsum("mdi,mi->md", N, lead - trail), (N @ by_first, -N @ by_start, -N @ by_end)


def _within(start: Nav, end: Nav, N: Array, b_first: Array, *trailing: Array) -> tuple[Array, tuple[Array, ...]]:
    residual, (by_first, by_start, by_end) = _apart(start, start, end, N, b_first, *trailing)
    return residual, (by_first + by_start, by_end)


def same_rail(
    first: np.ndarray,
    start: np.ndarray,
    across: Array,
    lead: Array,
    trail: Array,
    fraction: Array,
    interval: Array,
    turned: Array,
    turn: Array,
    detail: Array,
    sigma: Array,
    loss: Loss | None,
) -> tuple[Family, Family]:
    """Both units saw one point. Two families: where keyframe ``first`` begins the interval ``start``, and the rest.

    ``across`` (m, d, 3): unit vectors across the rail, in n; ``lead``, ``trail`` (m, 3): the points in body axes from
    the IMU, m; ``fraction``, ``interval`` (m,): h and T (s); ``turned``, ``turn`` (m, 3, 3): A and A_T; ``detail``
    (m, 3): c, m. Residual (m, d) and sigma (m, d) in m.
    """
    data = (across, lead, fraction[:, None], interval[:, None], turned, turn, detail, trail)
    near = first == start

    ends = (Slot(Kind.NAV, start), Slot(Kind.NAV, start + 1))
    within = Family("rail within", _within, ends, data, sigma, loss)
    apart = Family("rail apart", _apart, (Slot(Kind.NAV, first), *ends), data, sigma, loss)
    return within.take(np.flatnonzero(near)), apart.take(np.flatnonzero(~near))
