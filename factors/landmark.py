"""The track is known beforehand: the vehicle passes landmarks and balises, and is on the centre line."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family
from trackfg.factors.linear import Slot
from trackfg.factors.loss import Loss
from trackfg.factors.states import Kind, Nav, Odo
from trackfg.numerics.arrays import Array
from trackfg.numerics.rotations import skew


def _passed(first: Odo, second: Odo, fraction: Array, distance: Array) -> tuple[Array, tuple[Array, ...]]:
    f = fraction[:, 0]
    d_first, d_second = np.zeros((2, len(first), 1, Kind.ODO.dim))
    d_first[:, 0, Odo.DISTANCE], d_second[:, 0, Odo.DISTANCE] = 1.0 - f, f
    residual = (1.0 - f) * first.distance + f * second.distance - distance[:, 0]
    return residual[:, None], (d_first, d_second)


def landmark(first: np.ndarray, fraction: Array, distance: Array, sigma: Array, loss: Loss | None) -> Family:
    """A place of a map was passed between keyframe ``first`` (m,) and the next, at the share ``fraction`` of the time.

    Residual (m): ``(1 - f) D_k + f D_k+1 - d``; ``d`` (m,) is the place's distance in the sense of running, less what
    the distance at that time is beyond the straight line between the keyframes. sigma (m, 1): of recognising it.
    """
    slots = (Slot(Kind.ODO, first), Slot(Kind.ODO, first + 1))
    data = {"fraction": fraction[:, None], "distance": distance[:, None]}
    return Family(FactorType.LANDMARK, _passed, slots, data, sigma, loss)


def _across(nav: Nav, place: Array, normal: Array, lever_arm: Array) -> tuple[Array, tuple[Array, ...]]:
    at_reference = nav.p - np.einsum("mij,mj->mi", nav.R, lever_arm)
    offset = at_reference[:, :2] - place
    by_body = np.einsum("mi,mij->mj", normal, nav.R[:, :2])
    d_nav = np.zeros((len(nav), 1, Kind.NAV.dim))
    d_nav[:, 0, :3] = np.einsum("mi,mij->mj", by_body, skew(lever_arm))
    d_nav[:, 0, 3:6] = by_body
    return np.sum(normal * offset, axis=1)[:, None], (d_nav,)


class OnLine(NamedTuple):
    """Keyframes (m,) have a foot on a centre line at ``place`` (m, 2), m, and its left ``normal`` there (m, 2)."""

    keyframe: np.ndarray
    place: Array
    normal: Array


def across_line(feet: OnLine, lever_arm: Array, sigma: Array, loss: Loss | None) -> Family:
    """The vehicle reference point is on the centre line, in plan.

    Residual (m): ``c = n' (p - R l - f)``, horizontal, positive where the vehicle is to the left of the line's
    direction; ``f`` is the foot, ``n`` the normal, ``l`` (3,) the IMU's position in the vehicle, m. Heights are not
    used: lines are known in plan. sigma (m, 1).
    """
    data = {"place": feet.place, "normal": feet.normal, "lever_arm": np.tile(lever_arm, (len(feet.keyframe), 1))}
    return Family(FactorType.KNOWN_LINE, _across, (Slot(Kind.NAV, feet.keyframe),), data, sigma, loss)


def _along(
    first: Nav, second: Nav, places: Array, normals: Array, correlation: Array, lever_arm: Array
) -> tuple[Array, tuple[Array, ...]]:
    first_offset, (d_first,) = _across(first, places[:, 0], normals[:, 0], lever_arm)
    second_offset, (d_second,) = _across(second, places[:, 1], normals[:, 1], lever_arm)
    return second_offset - correlation * first_offset, (-correlation[:, :, None] * d_first, d_second)


def along_line(
    first: OnLine, second: OnLine, correlation: Array, lever_arm: Array, sigma: Array, loss: Loss | None
) -> Family:
    """The vehicle goes along the centre line from one keyframe to another, as far beside it as before.

    Residual (m): ``c_2 - rho c_1`` with c as of :func:`across_line` and the ``correlation`` rho (m,) of the line's
    errors at both places. With sigma (m, 1) of what changes, and :func:`across_line` for the first keyframe, the
    factors of a stretch are together those of errors that last: a constant one counts once.
    """
    data = {
        "places": np.stack([first.place, second.place], axis=1),
        "normals": np.stack([first.normal, second.normal], axis=1),
        "correlation": correlation[:, None],
        "lever_arm": np.tile(lever_arm, (len(first.keyframe), 1)),
    }
    slots = (Slot(Kind.NAV, first.keyframe), Slot(Kind.NAV, second.keyframe))
    return Family(FactorType.KNOWN_LINE, _along, slots, data, sigma, loss)


def _at_balise(odo: Odo, places: Array, which: Array, carried: Array) -> tuple[Array, tuple[Array, ...]]:
    row = np.arange(len(odo))
    d_odo, d_places = np.zeros((len(odo), 1, Kind.ODO.dim)), np.zeros((len(odo), 1, Kind.SENSOR.dim))
    d_odo[:, 0, Odo.DISTANCE] = 1.0
    d_places[row, 0, which] = -1.0
    return (odo.distance + carried - places[row, which])[:, None], (d_odo, d_places)


def balise_passage(
    keyframe: np.ndarray, carried: Array, balise: np.ndarray, sensors: int, sigma: Array, loss: Loss | None
) -> Family:
    """The vehicle is at balise number ``balise`` (m,) when it is ``carried`` (m,), m, beyond its place at a keyframe.

    Residual (m): distance along the track less that of the balise, which is one of the two in its ``SENSOR`` variable;
    the variables of the ``sensors`` further sensors come first. sigma (m, 1): of reading it. A balise that is passed
    once adds no information.
    """
    slots = (Slot(Kind.ODO, keyframe), Slot(Kind.SENSOR, sensors + balise // Kind.SENSOR.dim))
    data = {"which": balise % Kind.SENSOR.dim, "carried": carried}
    return Family(FactorType.BALISE_PASSAGE, _at_balise, slots, data, sigma, loss)
