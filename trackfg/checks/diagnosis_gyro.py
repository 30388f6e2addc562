"""The force balance shows which column of the gyro is the rate about which axis.

Of the 48 signed permutations P of the gyro's columns against the accelerometer's axes, the right one leaves the least
of the force unexplained. Two residuals of one power by themselves differ: a block of 10 s holds about nine independent
values in the band (three in each equation), so that the logarithm of the ratio of two such powers over n blocks has the
sigma sqrt(4 / 9n). One is refused where it leaves more than three of these above the best one, and that without the two
blocks that speak against it most: a shock, a slip or a single curve refuses nothing. What the run does not excite is
not refused, and of those that are left, the one with the fewest changes is taken.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from trackfg.checks.force_balance import ForceBalance
from trackfg.numerics.arrays import Array

_UNCOUNTED = 2
"""Blocks, those that speak most against a permutation, that do not count."""

_NOTHING = 1e-12
"""A power or norm that stands for none."""

SIGNED_PERMUTATIONS = np.array(
    [
        np.diag(signs) @ np.eye(3)[list(order)]
        for order in itertools.permutations(range(3))
        for signs in itertools.product((1.0, -1.0), repeat=3)
    ]
)
"""All 48, the identity first. Shape (48, 3, 3)."""


@dataclass(frozen=True)
class GyroColumns:
    """``columns``: the column of the gyro, by body axis as declared, that shows the rate about x, y and z, such as
    ``("+x", "-y", "+z")``. ``contradiction``: how many times the power that the best permutation leaves unexplained the
    declared columns leave, without the two blocks that add most to that.
    """

    columns: tuple[str, str, str]
    contradiction: float

    @property
    def is_wrong(self) -> bool:
        """Return whether they are not as declared."""
        return self.columns != ("+x", "+y", "+z")

    @property
    def matrix(self) -> Array:
        """P (3, 3): true rates from those declared."""
        return np.array([np.eye(3)["xyz".index(c[1])] * (1.0 if c[0] == "+" else -1.0) for c in self.columns])


def estimate_gyro_columns(balance: ForceBalance) -> GyroColumns:
    """Return the permutation nearest to what is declared that the balance does not refuse."""
    power = unexplained(balance)
    least = power.sum(axis=2).min(axis=0)
    whitened_power = np.einsum("qeb,e->qb", power, 1.0 / np.maximum(least, _NOTHING))
    total = whitened_power.sum(axis=1)
    best = whitened_power[int(np.argmin(total))]
    changes = np.count_nonzero(np.abs(SIGNED_PERMUTATIONS - np.eye(3)).max(axis=2), axis=1)
    possible = [q for q, one in enumerate(whitened_power) if not is_refused(one, best)]
    P = SIGNED_PERMUTATIONS[min(possible, key=lambda q: (changes[q], total[q]))]
    names = [f"{'-+'[int(row.sum() > 0)]}{'xyz'[int(np.argmax(np.abs(row)))]}" for row in P]
    return GyroColumns((names[0], names[1], names[2]), contradiction(whitened_power[0], best))


def unexplained(balance: ForceBalance) -> Array:
    """Return the power of the force that each permutation leaves, by equation and block. Shape (48, 3, blocks).

    The factor of the tach's acceleration in the forward equation is free, since its scale is not judged here, and so
    are small tilts of the sensor.
    """
    residuals = balance.force - np.tensordot(SIGNED_PERMUTATIONS, balance.terms, axes=((1, 2), (1, 2)))
    vertical = np.abs(SIGNED_PERMUTATIONS[:, 2]).argmax(axis=1)
    for column, equation in itertools.product(range(3), range(3)):
        basis = balance.by_tilt(equation, column)
        residuals[vertical == column, equation] -= residuals[vertical == column, equation] @ basis @ basis.T
    return balance.block_sums(residuals**2)


def is_refused(one: Array, best: Array) -> bool:
    """Return whether the power (blocks,) that is left speaks clearly against what leaves it."""
    return bool(np.log(contradiction(one, best)) > 2.0 / np.sqrt(one.size - _UNCOUNTED))


def contradiction(one: Array, best: Array) -> float:
    """Return the ratio of two powers (blocks,) without the blocks that make it largest."""
    counted = np.argsort(one - best)[: one.size - _UNCOUNTED]
    return float(max(one[counted].sum(), _NOTHING) / max(best[counted].sum(), _NOTHING))
