"""Measurements in a row that come from one of two states, and stay in it for some time.

A wheel rolls or slips; the error z of each interval, in sigmas, is then normal or anything. With a chain of two states
from interval to interval the likelihood of all errors together is a product of 2 by 2 matrices,

    L = p' M_1 ... M_n 1,   M_k = T diag(exp(-z_k^2 / 2), exp(-c - z_k^2 / (2 w^2))),

``T`` the transition matrix, ``p`` the state before. ``-log L`` is a robust cost of the whole row. Its derivative by z_k
is, but for the outliers' own width, z_k times the probability, given all of the row, that interval k belongs to the
first state: the weight of iteratively reweighted least squares (expectation and maximisation over hidden states).

Forward and backward products are those of Rabiner, "A tutorial on hidden Markov models" (1989). Matrix products are
associative, so all of them come by doubling (Hillis and Steele, "Data parallel algorithms", 1986): log2(n) operations
on arrays instead of a loop over intervals.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from trackfg.frames import Array

OUTLIER_SIGMAS = 1e3
"""How wide the errors of the second state spread: finite, lest nothing hold what they measure."""

_LEAVE = 0.3
"""Probability that the interval after a slipping one rolls: a slip lasts some three intervals."""
_LASTING = 1.9
"""Where, in sigmas, errors that last are as likely in the second state as in the first."""
_STAY_COST = 0.5 * _LASTING**2 + float(np.log(1.0 - _LEAVE))


def row_cost(z: Array, width: float) -> float:
    """``-log L`` of errors z (n,) in sigmas, less its value where all are 0.

    ``width``, above 2.5: a lone error of this size is as likely in the second state as in the first.
    """
    return _cost(z, width) - _least_cost(len(z), width)


def row_weights(z: Array, width: float) -> Array:
    """The derivative of :func:`row_cost` by each error, over the error: 1 where it counts in full. Shape (n,)."""
    return np.asarray(1.0 - (1.0 - OUTLIER_SIGMAS**-2) * (1.0 - first_state_probability(z, width)))


def first_state_probability(z: Array, width: float) -> Array:
    """The probability that each error belongs to the first state, given all of them. Shape (n,)."""
    matrices = _matrices(z, width)[0]
    before = _prefix_products(matrices)[0][0]  # p' M_1 ... M_k with p = (1, 0)
    reversed_ = np.swapaxes(matrices[:, :, ::-1], 0, 1)
    after = np.ones((2, len(z)))  # M_k+1 ... M_n 1
    after[:, :-1] = _prefix_products(reversed_)[0].sum(axis=0)[:, ::-1][:, 1:]
    first, second = before * after
    return np.asarray(first / (first + second))


@lru_cache
def _least_cost(n: int, width: float) -> float:
    return _cost(np.zeros(n), width)


def _cost(z: Array, width: float) -> float:
    matrices, scale = _matrices(z, width)
    products, scales = _prefix_products(matrices)
    return float(-np.log(products[0, :, -1].sum()) - scales[-1] - scale.sum())


def _matrices(z: Array, width: float) -> tuple[Array, Array]:
    """M_k up to a factor, shape (2, 2, n), and the logarithm of that factor (n,)."""
    enter = np.exp(_STAY_COST - np.log(_LEAVE) - 0.5 * width**2)
    transition = np.array([[1.0 - enter, enter], [_LEAVE, 1.0 - _LEAVE]])
    exponents = np.stack([-0.5 * z**2, -_STAY_COST - 0.5 * (z / OUTLIER_SIGMAS) ** 2])
    scale = exponents.max(axis=0)
    return transition[:, :, None] * np.exp(exponents - scale), scale


def _prefix_products(matrices: Array) -> tuple[Array, Array]:
    """M_1 ... M_k for each k up to a factor, shape (2, 2, n), and the logarithm of that factor (n,)."""
    product, n = matrices.copy(), matrices.shape[2]
    scale = np.zeros(n)
    shift = 1
    while shift < n:
        (a, b), (c, d) = product[:, :, :-shift].copy()
        (e, f), (g, h) = product[:, :, shift:].copy()
        product[0, 0, shift:], product[0, 1, shift:] = a * e + b * g, a * f + b * h
        product[1, 0, shift:], product[1, 1, shift:] = c * e + d * g, c * f + d * h
        scale[shift:] = scale[shift:] + scale[:-shift]
        largest = product.max(axis=(0, 1))
        product /= largest
        scale += np.log(largest)
        shift *= 2
    return product, scale
