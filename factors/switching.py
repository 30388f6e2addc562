"""Measurements that follow each other come from one of two states, inlier or outlier, and stay in it for some time.

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
from typing import NamedTuple

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.kernels import compiled_kernels, kernel_argument

OUTLIER_SIGMAS = 1e3
"""Sigma of the outlier state, in inlier sigmas. Finite, so that a variable measured only by outliers stays determined.
"""

_LASTS_S = 2.8
"""A slip lasts as long."""
_LASTING = 1.9
"""Where, in sigmas, errors that last are as likely in the second state as in the first, in intervals of 1 s. Shorter
ones show less each, and together the same.
"""


class Chain(NamedTuple):
    """The chain of two states has these parameters.

    ``width``, above 2.5: a lone error of this size, in sigmas, is as likely in the second state as in the first.
    ``interval_s``: how long an interval is; more than 1 s counts as 1 s. ``inlier_before``: the probability that the
    interval before belonged to the first state.
    """

    width: float
    interval_s: float = 1.0
    inlier_before: float = 1.0


def chain_cost(z: Array, chain: Chain) -> float:
    """Return ``-log L`` of errors z (n,) in sigmas, less its value where all are 0."""
    return _cost(z, chain) - _least_cost(len(z), chain)


def chain_weights(z: Array, chain: Chain) -> Array:
    """Return the derivative of :func:`chain_cost` by each error, over the error: 1 where it counts in full. (n,)."""
    return np.asarray(1.0 - (1.0 - OUTLIER_SIGMAS**-2) * (1.0 - first_state_probability(z, chain)))


def chain_after(z: Array, chain: Chain) -> Chain:
    """Return the chain with the probability of its first state after errors z (n,)."""
    if len(z) == 0:
        return chain
    if compiled_kernels():
        return chain._replace(inlier_before=_in_kernel(z, chain)[1])
    first, second = _forward(_matrices(z, chain)[0], chain)[:, -1]
    return chain._replace(inlier_before=float(first / (first + second)))


def first_state_probability(z: Array, chain: Chain) -> Array:
    """Return the probability that each error belongs to the first state, given all of them. Shape (n,)."""
    if compiled_kernels():
        return _in_kernel(z, chain)[0]
    matrices = _matrices(z, chain)[0]
    forward = _forward(matrices, chain)
    reversed_ = np.swapaxes(matrices[:, :, ::-1], 0, 1)
    backward = np.ones((2, len(z)))  # M_k+1 ... M_n 1
    backward[:, :-1] = _prefix_products(reversed_)[0].sum(axis=0)[:, ::-1][:, 1:]
    first, second = forward * backward
    return np.asarray(first / (first + second))


def _in_kernel(z: Array, chain: Chain) -> tuple[Array, float]:
    """Return the first state's probability of each error given all of them, and of the last: by a compiled kernel."""
    from trackfg.numerics import compiled

    first, (transition, stay_cost) = np.empty(len(z)), _transition(chain.width, chain.interval_s)
    z = kernel_argument(z)
    return first, compiled.switch_chain(z, transition, stay_cost, OUTLIER_SIGMAS, chain.inlier_before, first)


@lru_cache
def _least_cost(n: int, chain: Chain) -> float:
    return _cost(np.zeros(n), chain)


def _cost(z: Array, chain: Chain) -> float:
    matrices, scale = _matrices(z, chain)
    products, scales = _prefix_products(matrices)
    at_end = chain.inlier_before * products[0, :, -1] + (1.0 - chain.inlier_before) * products[1, :, -1]
    return float(-np.log(at_end.sum()) - scales[-1] - scale.sum())


def _forward(matrices: Array, chain: Chain) -> Array:
    """Return ``p' M_1 ... M_k``, up to a factor. Shape (2, n)."""
    products = _prefix_products(matrices)[0]
    return np.asarray(chain.inlier_before * products[0] + (1.0 - chain.inlier_before) * products[1])


def _matrices(z: Array, chain: Chain) -> tuple[Array, Array]:
    """Return M_k up to a factor, shape (2, 2, n), and the logarithm of that factor (n,)."""
    transition, stay_cost = _transition(chain.width, chain.interval_s)
    exponents = np.stack([-0.5 * z**2, -stay_cost - 0.5 * (z / OUTLIER_SIGMAS) ** 2])
    scale = exponents.max(axis=0)
    return transition[:, :, None] * np.exp(exponents - scale), scale


@lru_cache
def _transition(width: float, interval_s: float) -> tuple[Array, float]:
    """Return T, and the cost of an interval in the second state."""
    duration = min(interval_s, 1.0)
    leave = 1.0 - np.exp(-duration / _LASTS_S)
    stay_cost = duration * (0.5 * _LASTING**2 - 1.0 / _LASTS_S)
    enter = np.exp(stay_cost - np.log(leave) - 0.5 * width**2)
    return np.array([[1.0 - enter, enter], [leave, 1.0 - leave]]), stay_cost


def _prefix_products(matrices: Array) -> tuple[Array, Array]:
    """Return M_1 ... M_k for each k up to a factor, shape (2, 2, n), and the factor's logarithm (n,)."""
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
