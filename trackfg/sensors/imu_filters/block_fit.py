"""Least squares with errors that are correlated within blocks: the last unknown over the gain, with its sigma."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.chi_square import widening_of_few

FEWEST_BLOCKS = 10
"""Fewer blocks do not show how the unknown scatters beside some others."""

LEAST_EXPLAINED = 0.9
"""The share of the force's power that an equation of a sensor's motion along the track explains at least. It is 0.98
and more of rigid vehicles faster than 5 m/s, and 0.2 at most of bodies on springs, whose motion is their own (all
scenarios)."""


class BlockFit(NamedTuple):
    """``ratio``: the last unknown over the first, the gain; its sigma ``sd``; ``left`` (b,): the power of the observed
    signal in each block that is not explained, of ``power`` in all; ``whole`` (k, k): the normal matrix.
    """

    ratio: float
    sd: float
    left: Array
    power: float
    whole: Array

    @property
    def explained(self) -> float:
        """The share of the power of the observed signal that is explained."""
        return 1.0 - float(self.left.sum()) / self.power


def block_fit(products: Array) -> BlockFit | None:
    """Fit the last signal by the others, of sums of products by block (b, k + 1, k + 1); None where blocks are too few
    or do not separate the unknowns.
    """
    N, n = products[:, :-1, :-1], products[:, :-1, -1]
    whole, scale = N.sum(axis=0), np.sqrt(np.diagonal(N.sum(axis=0)))
    if len(products) < FEWEST_BLOCKS or not (scale > 0.0).all():
        return None
    if np.linalg.matrix_rank(whole / np.outer(scale, scale)) < len(scale):
        return None
    inverse = np.linalg.inv(whole)
    unknown = inverse @ n.sum(axis=0)
    of_last = (n - N @ unknown) @ inverse[-1]
    gain, few = unknown[0], widening_of_few(len(products) - len(unknown))
    left = products[:, -1, -1] - 2.0 * n @ unknown + np.einsum("i,bij,j->b", unknown, N, unknown)
    sd = few * float(np.sqrt(of_last @ of_last) / abs(gain))
    return BlockFit(float(unknown[-1] / gain), sd, left, float(products[:, -1, -1].sum()), whole)
