"""The tach's scale, the gyro's and how the sensor is turned, from the force that acceleration and curves need.

In the force balance (:mod:`trackfg.checks.force_balance`) forward force, less what the pitch rate implies, is k times
the tach's acceleration, and lateral force, less what the roll rate implies, k times speed times yaw rate; k is 1 where
tach, gyro and accelerometer are scaled rightly, and 1/3.6 where km/h are taken for m/s.

Both sides are noisy, so the slope of y on x is too small and that of x on y, inverted, too large: with errors of x and
y that are independent, the true k lies between the two (Frisch 1934). Each has the sigma of its leave-one-block-out
(jackknife) values; :attr:`Slope.low` and :attr:`Slope.high` add what Student's distribution for so many blocks makes of
three sigmas.

A sensor that points to the left of the direction of travel by an angle a measures ``-sin(a)`` of the acceleration
across, and one that points below it by b ``sin(b)`` of it upwards. These are slopes of what the balance leaves of
lateral and vertical force on the acceleration, beside the other products of small angles
(:meth:`ForceBalance.tilt_columns`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackfg.checks.force_balance import FEWEST_BLOCKS, ForceBalance
from trackfg.numerics.arrays import Array
from trackfg.numerics.chi_square import widening_of_few
from trackfg.numerics.robust import jackknife_sd

_SIGMAS = 3.0
"""Slopes and angles are surely within so many sigmas of their estimate: 1 in 370 is not by chance."""


SURE_CORRELATION = 0.8
"""Lateral force has causes of its own (springs, rails): its slope says something from this correlation on."""


@dataclass(frozen=True)
class Slope:
    """A slope ``value`` with the correlation it was found from; it is between ``low`` and ``high`` (see above)."""

    value: float
    low: float
    high: float
    correlation: float

    def excludes(self, low: float, high: float) -> bool:
        """Return whether the magnitude of the slope is surely outside of these limits."""
        near, far = sorted((abs(self.low), abs(self.high))) if self.low * self.high > 0.0 else (0.0, np.inf)
        return near > high or far < low


@dataclass(frozen=True)
class Angle:
    """An angle with its sigma, deg."""

    value_deg: float
    sd_deg: float

    def exceeds(self, limit_deg: float) -> bool:
        """Return whether its magnitude is surely larger than a limit."""
        return abs(self.value_deg) - _SIGMAS * self.sd_deg > limit_deg


def forward_slope(balance: ForceBalance, P: Array) -> Slope | None:
    """Return the slope of forward force, less what rates mixed by ``P`` (3, 3) imply, on the tach's acceleration."""
    return slope_of(balance.acceleration, balance.force[0] - balance.predicted(P)[0], balance.block)


def lateral_slope(balance: ForceBalance, P: Array) -> Slope | None:
    """Return the slope of lateral force, less what the other rates imply, on speed times yaw rate."""
    expected = np.tensordot(P[2], balance.terms[1, 2], axes=1)
    return slope_of(expected, balance.force[1] - (balance.predicted(P)[1] - expected), balance.block)


def turned_aside(balance: ForceBalance) -> tuple[Angle | None, Angle | None]:
    """Return by how much the sensor points below the direction of travel and to the left of it, pitch and yaw."""
    residual = balance.force - balance.predicted(np.eye(3))
    up, across = (_share_of_acceleration(balance, residual[equation], equation) for equation in (2, 1))
    return up, None if across is None else Angle(-across.value_deg, across.sd_deg)


def _share_of_acceleration(balance: ForceBalance, force: Array, equation: int) -> Angle | None:
    """Return the share of the acceleration in a force (n,) as an angle; None where too few blocks show any."""
    A = np.stack(balance.tilt_columns(equation, vertical=2), axis=1)
    block, columns = np.unique(balance.block, return_inverse=True)[1], [*A.T, force]
    products = np.array([[np.bincount(block, x * y) for y in columns] for x in columns])
    normal, right = np.moveaxis(products[:-1, :-1], 2, 0), products[:-1, -1].T
    if np.count_nonzero(normal[:, 0, 0]) < FEWEST_BLOCKS or np.linalg.matrix_rank(A) < A.shape[1]:
        return None
    share = float(np.linalg.solve(normal.sum(axis=0), right.sum(axis=0))[0])
    others = np.linalg.solve(normal.sum(axis=0) - normal, (right.sum(axis=0) - right)[..., None])[:, 0, 0]
    value, *around = np.degrees(np.arcsin(np.clip([share, *others], -1.0, 1.0)))
    return Angle(float(value), jackknife_sd(np.array(around), float(value)))


def slope_of(x: Array, y: Array, block: NDArray[np.int64]) -> Slope | None:
    """Return the slope of y on x (n,), whose rows belong to the blocks ``block`` (n,); None where either is constant or
    too few blocks show x.
    """
    xx, xy, yy = (np.bincount(block, product).astype(np.float64) for product in (x * x, x * y, y * y))
    xx, xy, yy = xx[xx > 0.0], xy[xx > 0.0], yy[xx > 0.0]
    if xx.size < FEWEST_BLOCKS or yy.sum() == 0.0 or xy.sum() == 0.0:
        return None
    correlation = float(xy.sum() / np.sqrt(xx.sum() * yy.sum()))
    sigmas = _SIGMAS * widening_of_few(xx.size - 1)
    small, small_sd = _ratio(xy, xx)
    large, large_sd = _ratio(yy, xy)
    sign = float(np.sign(correlation))
    low, high = sign * small - sigmas * small_sd, sign * large + sigmas * large_sd
    value = sign * float(np.sqrt(small * large))
    return Slope(value, *((low, high) if sign > 0 else (-high, -low)), correlation)


def _ratio(numerator: Array, denominator: Array) -> tuple[float, float]:
    """Return the ratio of two sums over blocks, with its jackknife sigma."""
    ratio = float(numerator.sum() / denominator.sum())
    others = (numerator.sum() - numerator) / (denominator.sum() - denominator)
    return ratio, jackknife_sd(others, ratio)
