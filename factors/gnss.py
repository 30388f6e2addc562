"""GNSS positions and speeds are those of an antenna with a lever arm, at a time of the receiver's clock."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family
from trackfg.factors.linear import Slot
from trackfg.factors.loss import Loss
from trackfg.factors.states import Kind, Nav
from trackfg.numerics.arrays import Array
from trackfg.numerics.rotations import skew


def _position(
    nav: Nav, clock: Array, position: Array, lever_arm: Array, delay: Array, declared: Array
) -> tuple[Array, tuple[Array, ...]]:
    del declared  # the residual does not depend on it
    late = delay + clock[:, 2:]
    residual = nav.p + np.einsum("mij,mj->mi", nav.R, lever_arm) + nav.v * late - position
    d_nav = np.concatenate([-nav.R @ skew(lever_arm), nav.R, nav.R * late[:, :, None]], axis=2)
    d_clock = np.zeros((len(nav), 3, 3))
    d_clock[:, :, 2] = nav.v
    return residual, (d_nav, d_clock)


def _position_elsewhere(
    nav: Nav, clock: Array, antenna: Array, position: Array, lever_arm: Array, delay: Array, declared: Array
) -> tuple[Array, tuple[Array, ...]]:
    seen = np.concatenate([lever_arm[:, :2] + antenna, lever_arm[:, 2:]], axis=1)
    residual, by_motion = _position(nav, clock, position, seen, delay, declared)
    return residual, (*by_motion, nav.R[:, :, :2])


def gnss_position(
    index: np.ndarray,
    position: Array,
    lever_arm: Array,
    delay: Array,
    sigma: Array,
    loss: Loss | None,
    sensor: int | None = None,
) -> Family:
    """The antenna is where the receiver says.

    Residual (m, in n): ``p + R l + v (dt + T) - z``; ``z`` (m, 3) is the measured position, ``l`` (3,) the antenna seen
    from the IMU in body axes, ``dt`` (m,) the seconds from the keyframe to the measurement's stamp and ``T`` the
    receiver's clock offset, the seconds to add to its stamps. sigma (m, 3), which stays beside the measurements as
    ``declared`` where residuals change it.

    With the index of a ``SENSOR`` variable the antenna is that much further ahead and to the left, m, than ``l`` says.
    """
    data = {"position": position, "lever_arm": np.tile(lever_arm, (len(index), 1)), "delay": delay[:, None]}
    data["declared"] = sigma
    slots = (Slot(Kind.NAV, index), Slot(Kind.CLOCK, np.zeros_like(index)))
    if sensor is None:
        return Family(FactorType.GNSS_POSITION, _position, slots, data, sigma, loss)
    antenna = Slot(Kind.SENSOR, np.full_like(index, sensor))
    return Family(FactorType.GNSS_POSITION, _position_elsewhere, (*slots, antenna), data, sigma, loss)


def _speed(
    nav: Nav, sensor: Array, speed: Array, swing: Array, force: Array, delay: Array, declared: Array
) -> tuple[Array, tuple[Array, ...]]:
    late = delay + sensor[:, 1:]
    in_body = swing + force * late
    level = (nav.v + np.einsum("mij,mj->mi", nav.R, in_body)) * [1.0, 1.0, 0.0]
    biased = np.sqrt(np.sum(level**2, axis=1) + declared[:, 0] ** 2)
    towards = np.einsum("mji,mj->mi", nav.R, level / biased[:, None])
    zero = np.zeros_like(towards)
    d_nav = np.concatenate([np.cross(in_body, towards), zero, towards], axis=1)[:, None]
    d_sensor = np.stack([np.ones(len(nav)), np.sum(towards * force, axis=1)], axis=1)[:, None]
    return biased[:, None] + sensor[:, :1] - speed, (d_nav, d_sensor)


class ReceiverSpeeds(NamedTuple):
    """Speeds of a receiver (m,), m/s, were measured ``delay`` (m,), s, after keyframes, with sigmas ``sd`` (m, 1), m/s.

    The body turns there at ``angular_rate`` (m, 3), rad/s; from there to the measurement the mean specific ``force`` is
    (m, 3), m/s^2.
    """

    speed: Array
    delay: Array
    angular_rate: Array
    force: Array
    sd: Array


def gnss_speed(
    index: np.ndarray, sensor: int, measured: ReceiverSpeeds, lever_arm: Array, sigma: Array, loss: Loss | None
) -> Family:
    """The antenna moves over ground as fast as the receiver says.

    Residual (m/s): ``sqrt(|u|^2 + s^2) + b - z``, positive when the estimate is too fast, with the level part u of

        v + R (w x l + f (dt + q)),

    the antenna's velocity at the time of the measurement: gravity has no level part. ``z`` is the measured speed, ``l``
    (3,) the antenna seen from the IMU in body axes, ``dt`` the seconds from the keyframe to the stamp. The ``SENSOR``
    variable of index ``sensor`` is ``(b, q)``: by what the speeds are too high, m/s, and the seconds to add to their
    stamps. A receiver filters its speeds, so they are later than its positions.

    The length of a velocity whose components err by s each follows Rice's distribution, whose mean is
    ``|u| + s^2 / (2 |u|)`` for ``|u|`` above some s (Rice, "Mathematical analysis of random noise", Bell System
    Technical Journal 24 (1945), sec. 3.10): the root has this mean. Near rest it hardly depends on u, and a speed says
    as little there. The declared s stays in it (``declared``) where residuals change ``sigma`` (m, 1), m/s.
    """
    swing = np.cross(measured.angular_rate, lever_arm)
    data = {"speed": measured.speed[:, None], "swing": swing, "force": measured.force}
    data |= {"delay": measured.delay[:, None], "declared": measured.sd}
    slots = (Slot(Kind.NAV, index), Slot(Kind.SENSOR, np.full_like(index, sensor)))
    return Family(FactorType.GNSS_SPEED, _speed, slots, data, sigma, loss)
