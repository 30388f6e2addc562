"""Distance is what the tach counts times the wheel's scale, the length of the path, and what absolute fixes measure.

The odometer's state at keyframe k is ``o = (D, S, W, a)``: along-track distance D (m), wheel scale S (true distance per
nominal distance), wheel distance W as the tach would count it without rounding (m), and a, the distance since the
previous keyframe (m). A tach reading is then absolute, and its rounding an independent error of each reading: between
any two keyframes the count is off by one rounding, not by a random walk of them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, in_kernel, linear_rows
from trackfg.factors.linear import Slot
from trackfg.factors.loss import Loss
from trackfg.factors.motion import mount_derivative, mount_matrix, tracking_point
from trackfg.factors.states import Kind, Nav, Odo
from trackfg.numerics.arrays import Array

MOST_CREEP = 0.02
"""Share of the distance by which a wheel that does not slip is off, at most: the top of the creep curve (Polach, "Creep
forces in simulations of traction vehicles running on adhesion limit", Wear 258, 2005).
"""

SPEED_OFFSET = 4
"""The entry of ``WHEEL`` by which a speed signal is off while the vehicle moves, m/s."""

ANY_DISTANCE_SD_M = 1e4
"""Sigma of the distance of an interval in which the wheel says nothing, m: any distance."""


@in_kernel(linear_rows("distance_chain"))
def _chain(first: Odo, second: Odo) -> tuple[Array, tuple[Array, ...]]:
    residual = np.stack([second.distance - first.distance - second.step, second.scale - first.scale], axis=1)
    d_first, d_second = np.zeros((2, len(first), 2, Kind.ODO.dim))
    d_first[:, 0, Odo.DISTANCE], d_first[:, 1, Odo.SCALE] = -1.0, -1.0
    d_second[:, 0, Odo.DISTANCE], d_second[:, 0, Odo.STEP], d_second[:, 1, Odo.SCALE] = 1.0, -1.0, 1.0
    return residual, (d_first, d_second)


def distance_chain(first: np.ndarray, sigma: Array) -> Family:
    """Distance adds up, and the wheel scale hardly changes.

    Residual: ``D_k+1 - D_k - a_k+1`` (m) and ``S_k+1 - S_k``. sigma (m, 2).
    """
    return Family(FactorType.DISTANCE_CHAIN, _chain, (Slot(Kind.ODO, first), Slot(Kind.ODO, first + 1)), {}, sigma)


def wheel_response(distance: Array, turned: Array, force: Array, moving_s: Array | float = 0.0) -> Array:
    """Return what each entry of ``WHEEL`` adds to the distance that a wheel rolls, shape (m, 5).

    For an interval of the signed ``distance`` (m), in which the vehicle turns left by ``turned`` (rad) under the mean
    forward force ``force`` (g). Off to the left a wheel rolls less in a curve to the left; off to the outside it rolls
    more in every curve. A force the way the vehicle goes is traction, and the wheel creeps ahead; else it brakes.
    ``moving_s`` is for how long (s) a speed signal was integrated that may be off by a constant in motion: values that
    are cut off, and not rounded, are half a quantum too low on average. 0 where pulses are counted.
    """
    way = np.sign(distance)
    along = way * force
    traction, braking = distance * np.maximum(along, 0.0), distance * np.minimum(along, 0.0)
    return np.stack([-turned, way * np.abs(turned), traction, braking, way * moving_s], axis=1)


def force_on_distances(response: Array) -> Array:
    """Return each interval's length times its forward force, m g, shape (m,), of a :func:`wheel_response` (m, 5)."""
    _, _, traction, braking, *_ = response.T
    return np.asarray(traction + braking)


def creep_sd(per_traction: float, force_on_distance: Array) -> Array:
    """Return the 1-sigma (m) of the creep over distances times the mean forward forces on them (m,), m g.

    On the stable side of its creep curve a wheel creeps by a share of the distance that is about proportional to the
    force; ``per_traction`` is the sigma of that share per g.
    """
    return np.asarray(per_traction * np.abs(force_on_distance))


def tach_excess(scale: Array, counted: Array | float, distance: Array, explained: Array | float = 0.0) -> Array:
    """Return how much further the wheel rolled than the vehicle moved, m: ``S dW - dD - explained``.

    ``counted`` (m,) is what the tach counts over each interval, m, ``scale`` (m,) the wheel scale, ``distance`` (m,)
    how far the vehicle moves, m, and ``explained`` (m,) what curves and force add (:func:`wheel_response`), m.
    """
    return np.asarray(scale * counted - distance - explained)


@in_kernel(linear_rows("tach_distance", "response"))
def _wheel(first: Odo, second: Odo, wheel: Array, response: Array) -> tuple[Array, tuple[Array, ...]]:
    turned = second.count - first.count
    d_first, d_second = np.zeros((2, len(first), 1, Kind.ODO.dim))
    d_first[:, 0, Odo.SCALE], d_first[:, 0, Odo.COUNT] = turned, -first.scale
    d_second[:, 0, Odo.COUNT], d_second[:, 0, Odo.STEP] = first.scale, -1.0
    residual = tach_excess(first.scale, turned, second.step, np.sum(response * wheel, axis=1))
    return residual[:, None], (d_first, d_second, -response[:, None, :])


def tach_distance(
    first: np.ndarray, response: Array, sigma: Array, loss: Loss | None, doubtful: np.ndarray | None = None
) -> Family:
    """The wheel rolls: scale times wheel distance is distance along the track, and what curves and force add.

    Residual (m): ``S_k (W_k+1 - W_k) - a_k+1 - response w``, positive when the wheel turns more than the vehicle moves
    (slip), negative when it turns less (slide). ``response`` (m, 5) is that of :func:`wheel_response` to the shared
    ``WHEEL`` variable w. sigma (m, 1) covers creep, not rounding. ``doubtful`` (m,): which of them seem to be slips.
    """
    slots = (Slot(Kind.ODO, first), Slot(Kind.ODO, first + 1), Slot(Kind.WHEEL, np.zeros_like(first)))
    return Family(FactorType.TACH_DISTANCE, _wheel, slots, {"response": response}, sigma, loss, doubtful)


@in_kernel(linear_rows("tach_reading", "count", "rate", "since"))
def _reading(odo: Odo, clock: Array, count: Array, rate: Array, since: Array) -> tuple[Array, tuple[Array, ...]]:
    offset = clock[:, 0] + clock[:, 1] * since[:, 0]
    d_odo, d_clock = np.zeros((len(odo), 1, Kind.ODO.dim)), np.zeros((len(odo), 1, Kind.CLOCK.dim))
    d_odo[:, 0, Odo.COUNT] = 1.0
    d_clock[:, 0, 0], d_clock[:, 0, 1] = rate[:, 0], rate[:, 0] * since[:, 0]
    return (odo.count - (count[:, 0] - rate[:, 0] * offset))[:, None], (d_odo, d_clock)


def tach_reading(index: np.ndarray, count: Array, rate: Array, since: Array, sigma: Array) -> Family:
    """The tach shows the count at a keyframe, rounded.

    Residual (m): ``W_k - (c_k - r_k T_k)``: ``c`` (m,) is the count at the keyframe's time as nominal distance, ``r``
    (m,) its rate (m/s) and ``T_k`` the clock offset, the seconds to add to the tach's times: offset plus drift times
    ``since`` (m,), the seconds since the middle of the run. sigma (m, 1): rounding.
    """
    slots = (Slot(Kind.ODO, index), Slot(Kind.CLOCK, np.zeros_like(index)))
    data = {"count": count[:, None], "rate": rate[:, None], "since": since[:, None]}
    return Family(FactorType.TACH_READING, _reading, slots, data, sigma)


@in_kernel(linear_rows("arc_length", "lever_arm"))
def _arc(first: Nav, second: Nav, odo: Odo, mount: Array, lever_arm: Array) -> tuple[Array, tuple[Array, ...]]:
    from_track = lever_arm - tracking_point(mount)
    chord = (second.p - np.einsum("mij,mj->mi", second.R, from_track)) - (
        first.p - np.einsum("mij,mj->mi", first.R, from_track)
    )
    f, d_f = mount_matrix(mount)[:, :, 0], mount_derivative(mount)[:, :, :, 0]
    t0, t1 = (np.einsum("mij,mj->mi", nav.R, f) for nav in (first, second))
    mean = 0.5 * (t0 + t1)
    along = np.sum(chord * mean, axis=1)
    cosine = np.sum(t0 * t1, axis=1)
    ratio, d_ratio = _angle_over_sine(cosine)

    def jacobians(R: Array, tangent_derivative: Array, chord_sign: float) -> tuple[Array, Array]:
        """Return the rows over one keyframe's tangent and the mounting: via its direction, its end of the chord."""
        toward = (chord_sign * ratio)[:, None] * np.einsum("mji,mj->mi", R, mean)
        direction = np.einsum("mji,mj->mi", R, tangent_derivative)
        # d(R f) = R (d x f): the component along a body vector u is (f x u) . d
        turned = np.cross(toward, from_track) + np.cross(f, direction)
        by_angles = np.einsum("mcj,mj->mc", d_f, direction)
        d_nav = np.concatenate([turned, toward, np.zeros_like(toward)], axis=1)
        return d_nav[:, None], np.concatenate([by_angles, toward], axis=1)[:, None]

    by_t0 = 0.5 * ratio[:, None] * chord + (along * d_ratio)[:, None] * t1
    by_t1 = 0.5 * ratio[:, None] * chord + (along * d_ratio)[:, None] * t0
    (d_first, at_first), (d_second, at_second) = jacobians(first.R, by_t0, -1.0), jacobians(second.R, by_t1, 1.0)
    d_odo = np.zeros((len(odo), 1, Kind.ODO.dim))
    d_odo[:, 0, Odo.STEP] = -1.0
    residual = ratio * along - odo.step
    return residual[:, None], (d_first, d_second, d_odo, at_first + at_second)


def _angle_over_sine(cosine: Array) -> tuple[Array, Array]:
    """Return ``phi / sin(phi)`` and its derivative by ``cos(phi)``, by series near zero."""
    cosine = np.minimum(cosine, 1.0)
    x = 1.0 - cosine
    small = x < 1e-4
    phi = np.arccos(np.where(small, 0.5, cosine))
    sine = np.sin(phi)
    value = np.where(small, 1.0 + x / 3.0 + 2.0 * x * x / 15.0, phi / sine)
    slope = np.where(small, -(1.0 / 3.0 + 4.0 * x / 15.0), -(sine - phi * np.cos(phi)) / sine**3)
    return value, slope


def arc_length(first: np.ndarray, lever_arm: Array, sigma: Array) -> Family:
    """The distance between two keyframes is the length of the arc between their poses.

    Residual (m): ``(c . (t0 + t1)/2) phi/sin(phi) - a_k+1`` with c the chord of the point that follows the track, t0
    and t1 the directions of travel and phi the angle between them. It is exact on a circle, where c is along t0 + t1
    and the arc is radius times phi, and signed: backwards counts negative. ``lever_arm`` (3,) is the IMU's position in
    the vehicle, m; point and direction are those of ``MOUNT``. sigma (m, 1).
    """
    slots = (
        Slot(Kind.NAV, first),
        Slot(Kind.NAV, first + 1),
        Slot(Kind.ODO, first + 1),
        Slot(Kind.MOUNT, np.zeros_like(first)),
    )
    return Family(FactorType.ARC_LENGTH, _arc, slots, {"lever_arm": lever_arm[None].repeat(len(first), axis=0)}, sigma)


@in_kernel(linear_rows("absolute_fix", "distance"))
def _fix(odo: Odo, distance: Array) -> tuple[Array, tuple[Array, ...]]:
    jacobian = np.zeros((len(odo), 1, Kind.ODO.dim))
    jacobian[:, 0, Odo.DISTANCE] = 1.0
    return odo.distance[:, None] - distance, (jacobian,)


def absolute_fix(index: np.ndarray, distance: Array, sigma: Array, loss: Loss | None) -> Family:
    """The vehicle is at a known place: balise, RFID tag, mile post.

    Residual (m): ``D_k - d_k``; ``d`` (m,) is the place's distance in the sense of running, carried to the keyframe's
    time by the tach. sigma (m, 1).
    """
    data = {"distance": distance[:, None]}
    return Family(FactorType.ABSOLUTE_FIX, _fix, (Slot(Kind.ODO, index),), data, sigma, loss)


def _seen(odo: Odo, distance: Array) -> tuple[Array, tuple[Array, ...]]:
    return odo.distance[:, None] - distance, (np.zeros((len(odo), 1, Kind.ODO.dim)),)


def withheld_fix(fixes: Family) -> Family:
    """Return the fixes as withheld ones: their residuals are evaluated, but no state depends on them."""
    return replace(fixes, type=FactorType.WITHHELD_FIX, evaluate=_seen)


def followed_fix(fixes: Family) -> Family:
    """Return the fixes as :func:`absolute_fix` makes them, whether they were withheld or not."""
    return replace(fixes, type=FactorType.ABSOLUTE_FIX, evaluate=_fix)
