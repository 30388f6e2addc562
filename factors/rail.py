"""Two displacement sensors pass one place of a rail, one after the other: the difference method as a factor.

The leading unit sees the rail at ``b_i`` (body axes, from the IMU) at keyframe i; the trailing one sees the same place
of it at ``b`` at a time between keyframes j and j + 1, a fraction h of the interval T after j. Both points are one
point of the rail, up to how far apart along it they were taken:

    N R_i' ( p_i + R_i b_i - p(h) - R(h) b ) = 0,

N (2, 3) the directions across the rail, in the body axes of keyframe i. In axes that do not turn with the estimate,
what both points are apart along the rail would show sideways as soon as the heading changed, and so seem to measure the
heading itself: 5 mm, a good match, in thousands of sights, to 0.1 mrad. Between keyframes the motion is what inertial
samples say it is, tied to both ends as in :mod:`trackfg.output.dense_motion`:

    R(h) = R_j A Exp(h e),  e = Log(A_T' R_j' R_j+1),   A the gyro's rotation until then, A_T over the whole interval;
    p(h) = the cubic of both ends' positions and velocities, plus the detail c that the accelerometer saw between them.

(Suto, Tsubokawa, Yoshida use the first and second difference of such readings as a filter; the paper of the difference
method cited in docs/geometry.md.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, in_kernel, linear_rows
from trackfg.factors.linear import Slot
from trackfg.factors.loss import Loss
from trackfg.factors.states import Kind, Nav
from trackfg.numerics.arrays import Array
from trackfg.numerics.hermite import hermite_weights
from trackfg.numerics.rotations import skew, so3_exp, so3_log, so3_right_jacobian_inverse


class _Between(NamedTuple):
    """The motion between two keyframes up to a share of the interval, as :class:`RailSightings` has it."""

    fraction: Array
    interval: Array
    turned: Array
    turn: Array
    detail: Array


def _trailing(start: Nav, end: Nav, motion: _Between, b: Array) -> tuple[Array, Array, Array]:
    """Return the point p(h) + R(h) b (m, 3), and its derivatives by both ends (m, 3, 9)."""
    h1, T1, A, A_T, detail = motion
    w0, w1, u0, u1 = hermite_weights(h1, T1)
    p = w0 * start.p + w1 * end.p + u0 * start.v + u1 * end.v + detail

    relative = np.swapaxes(start.R, 1, 2) @ end.R
    e = so3_log(np.swapaxes(A_T, 1, 2) @ relative)
    late = so3_exp(h1 * e)
    R = start.R @ A @ late
    point = p + np.einsum("mij,mj->mi", R, b)

    # R(h) Exp(d): d by both ends' own rotations.
    by_e = h1[:, :, None] * np.linalg.solve(so3_right_jacobian_inverse(h1 * e), so3_right_jacobian_inverse(e))
    d_start = np.swapaxes(A @ late, 1, 2) - by_e @ np.swapaxes(relative, 1, 2)
    by_turn = -R @ skew(b)
    by_start = np.concatenate([by_turn @ d_start, w0[:, :, None] * start.R, u0[:, :, None] * start.R], axis=2)
    by_end = np.concatenate([by_turn @ by_e, w1[:, :, None] * end.R, u1[:, :, None] * end.R], axis=2)
    return point, by_start, by_end


def _leading(nav: Nav, b: Array) -> tuple[Array, Array]:
    point = nav.p + np.einsum("mij,mj->mi", nav.R, b)
    return point, np.concatenate([-nav.R @ skew(b), nav.R, np.zeros_like(nav.R)], axis=2)


_DATA = ("across", "lead", "fraction", "interval", "turned", "turn", "detail", "trail")


@in_kernel(linear_rows("rail_apart", *_DATA))
def _apart(
    first: Nav, start: Nav, end: Nav, *, across: Array, lead: Array, trail: Array, **between: Array
) -> tuple[Array, tuple[Array, ...]]:
    ahead, by_first = _leading(first, lead)
    behind, by_start, by_end = _trailing(start, end, _Between(**between), trail)
    apart = np.einsum("mji,mj->mi", first.R, ahead - behind)
    in_body = across @ np.swapaxes(first.R, 1, 2)
    by_first = in_body @ by_first
    by_first[:, :, :3] += across @ skew(apart)
    return np.einsum("mdi,mi->md", across, apart), (by_first, -in_body @ by_start, -in_body @ by_end)


@in_kernel(linear_rows("rail_within", *_DATA))
def _within(start: Nav, end: Nav, **data: Array) -> tuple[Array, tuple[Array, ...]]:
    residual, (by_first, by_start, by_end) = _apart(start, start, end, **data)
    return residual, (by_first + by_start, by_end)


@dataclass(frozen=True)
class RailSightings:
    """Both units of a pair saw one point of a rail, m times.

    ``first`` (m,): the keyframe at which the leading unit saw it; ``start`` (m,): the keyframe that begins the interval
    in which the trailing one did, at the share ``fraction`` (m,) of its length ``interval`` (m,), s. ``across``
    (m, 2, 3): unit vectors across the rail, in body axes at ``first``. ``lead`` and ``trail`` (m, 3): the point in body
    axes from the IMU, m, as the units saw it. ``turned`` and ``turn`` (m, 3, 3): the gyro's rotation from the start
    until then, and over the whole interval. ``detail`` (m, 3): what the accelerometer saw of the path besides the
    cubic, m.
    """

    first: np.ndarray
    start: np.ndarray
    fraction: Array
    interval: Array
    across: Array
    lead: Array
    trail: Array
    turned: Array
    turn: Array
    detail: Array

    @property
    def data(self) -> dict[str, Array]:
        """The measurements by name, as the factors take them."""
        columns = {name: getattr(self, name) for name in _DATA}
        return {name: values if values.ndim > 1 else values[:, None] for name, values in columns.items()}


def same_rail(seen: RailSightings, sigma: Array, loss: Loss | None) -> tuple[Family, Family]:
    """Return the factors of sightings as two families.

    In the first one the keyframe ``first`` begins the interval ``start``, in the second the others are. Residual and
    sigma (m, 2) in m.
    """
    near = seen.first == seen.start
    ends = (Slot(Kind.NAV, seen.start), Slot(Kind.NAV, seen.start + 1))
    within = Family(FactorType.RAIL_WITHIN, _within, ends, seen.data, sigma, loss)
    apart = Family(FactorType.RAIL_APART, _apart, (Slot(Kind.NAV, seen.first), *ends), seen.data, sigma, loss)
    return within.take(np.flatnonzero(near)), apart.take(np.flatnonzero(~near))
