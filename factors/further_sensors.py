"""Distance by further sensors: tachometers of other axles, speed over ground by radar or optics.

The first tach is part of the odometer's state (:mod:`trackfg.factors.odometry`). Each further sensor measures the
distance ``a`` from one keyframe to the next, and has one ``SENSOR`` variable ``(e, q)`` for the whole run: e is what
its scale is off by, so that ``1 + e`` is true distance per measured distance, and q is its clock's offset (s) or the
tangent of the yaw of its mounting. The factors are those of an interval, so they name the first keyframe too, though
nothing depends on it.
"""

from __future__ import annotations

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family
from trackfg.factors.linear import Slot
from trackfg.factors.loss import Loss
from trackfg.factors.odometry import tach_excess
from trackfg.factors.states import Kind, Odo
from trackfg.numerics.arrays import Array


def _increment(
    first: Odo, second: Odo, wheel: Array, sensor: Array, counted: Array, faster: Array, response: Array
) -> tuple[Array, tuple[Array, ...]]:
    scale, offset = 1.0 + sensor[:, 0], sensor[:, 1]
    rolled = counted - faster * offset
    (d_first, d_second), d_sensor = np.zeros((2, len(first), 1, 4)), np.zeros((len(first), 1, 2))
    d_second[:, 0, Odo.STEP] = -1.0
    d_sensor[:, 0, 0], d_sensor[:, 0, 1] = rolled, -scale * faster
    residual = tach_excess(scale, rolled, second.step, np.sum(response * wheel, axis=1))
    return residual[:, None], (d_first, d_second, -response[:, None, :], d_sensor)


def tach_increment(
    first: np.ndarray, sensor: int, measured: dict[str, Array], sigma: Array, loss: Loss | None, label: str
) -> Family:
    """The wheel of a further tach rolls as far as the vehicle moves from keyframe ``first`` (m,) to the next.

    Residual (m): ``(1 + e) (c - r q) - a_k+1 - response w``, positive when the wheel turns more than the vehicle moves.
    ``measured`` has ``counted`` (m,), the nominal distance c between the keyframes' times (m), ``faster`` (m,), how
    much its rate r grows (m/s), for the clock's offset q, and ``response`` (m, 4) of
    :func:`trackfg.factors.odometry.wheel_response`. sigma (m, 1) covers creep and rounding. ``sensor`` is the index of
    the ``SENSOR`` variable.
    """
    slots = (
        Slot(Kind.ODO, first),
        Slot(Kind.ODO, first + 1),
        Slot(Kind.WHEEL, np.zeros_like(first)),
        Slot(Kind.SENSOR, np.full_like(first, sensor)),
    )
    return Family(FactorType.TACH_INCREMENT, _increment, slots, measured, sigma, loss, label=label)


def _over_ground(
    first: Odo, second: Odo, sensor: Array, distance: Array, swing: Array, across: Array
) -> tuple[Array, tuple[Array, ...]]:
    (d_first, d_second), d_sensor = np.zeros((2, len(first), 1, 4)), np.zeros((len(first), 1, 2))
    d_second[:, 0, Odo.STEP] = -1.0
    d_sensor[:, 0, 0], d_sensor[:, 0, 1] = distance, -across
    residual = (1.0 + sensor[:, 0]) * distance - second.step - swing - sensor[:, 1] * across
    return residual[:, None], (d_first, d_second, d_sensor)


def speed_distance(
    first: np.ndarray, sensor: int, measured: dict[str, Array], sigma: Array, loss: Loss | None, label: str
) -> Family:
    """The integral of a speed over ground is the way of the sensor's place from keyframe ``first`` (m,) to the next.

    Residual (m): ``(1 + e) d - a_k+1 - u - q w``, positive when the sensor sees more than the vehicle moves. As the
    vehicle turns, the sensor's place moves further than the reference point, by u (m) along the vehicle and by w (m) to
    the left. A sensor that is yawed to the left by an angle of tangent q sees both times the angle's cosine, which is
    in e. ``measured`` has ``distance`` d, ``swing`` u and ``across`` w, all (m,). sigma (m, 1). ``sensor`` is the index
    of the ``SENSOR`` variable.
    """
    slots = (Slot(Kind.ODO, first), Slot(Kind.ODO, first + 1), Slot(Kind.SENSOR, np.full_like(first, sensor)))
    return Family(FactorType.SPEED_DISTANCE, _over_ground, slots, measured, sigma, loss, label=label)
