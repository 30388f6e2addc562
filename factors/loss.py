"""A robust loss is a function rho of the norm e of a factor's whitened residual, with ``rho = e^2 / 2`` for small e.

Losses are minimised by iteratively reweighted least squares with the weight ``rho'(e) / e`` (Zhang, "Parameter
estimation techniques: a tutorial with application to conic fitting", Image and Vision Computing 15 (1997), table 1).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from trackfg.factors.switching import Chain, chain_after, chain_cost, chain_weights
from trackfg.numerics.arrays import Array


@dataclass(frozen=True)
class Loss(ABC):
    """A robust loss has the tuning constant ``width``, in sigmas."""

    width: float

    @abstractmethod
    def weight(self, norm: Array) -> Array:
        """Return the weight of whitened residuals with these norms (m,): ``rho'(e) / e``."""

    @abstractmethod
    def cost(self, norm: Array) -> Array:
        """Return ``rho(e)`` of each norm (m,); where factors are coupled, the cost of all together."""

    kernel_sign: ClassVar[float] = 0.0
    """Of :attr:`kernel_width`: the compiled kernels give Huber's weight for 1, Cauchy's for -1, none for 0."""

    @property
    def kernel_width(self) -> float:
        """The compiled kernels choose the weight by this number: 0 where they give none, and :meth:`weight` does."""
        return self.kernel_sign * self.width

    @property
    def convex(self) -> Loss | None:
        """The loss that stands in while the values are far from the solution: convex, so that no outlier traps them."""
        return None


class Huber(Loss):
    """Huber's loss grows linearly beyond the width."""

    kernel_sign = 1.0

    def weight(self, norm: Array) -> Array:
        """See :meth:`Loss.weight`."""
        return np.minimum(1.0, self.width / np.maximum(norm, 1e-12))

    def cost(self, norm: Array) -> Array:
        """See :meth:`Loss.cost`."""
        c = self.width
        return np.where(norm <= c, 0.5 * norm**2, c * (norm - 0.5 * c))


class Cauchy(Loss):
    """Cauchy's loss grows with the logarithm and lets gross errors go."""

    kernel_sign = -1.0

    def weight(self, norm: Array) -> Array:
        """See :meth:`Loss.weight`."""
        return 1.0 / (1.0 + (norm / self.width) ** 2)

    def cost(self, norm: Array) -> Array:
        """See :meth:`Loss.cost`."""
        c = self.width
        return 0.5 * c**2 * np.log1p((norm / c) ** 2)


@dataclass(frozen=True)
class SwitchChain(Loss):
    """The switches of factors that follow each other in time are a chain: each holds for some time.

    An outlier makes its neighbours doubtful, and errors that last need not be large (:mod:`trackfg.factors.switching`).
    ``interval_s`` is the time from one factor to the next, ``inlier_before`` the probability that the one before the
    first was no outlier. Cost and weights are those of the whole chain, so norms (m,) are in order of time.
    """

    interval_s: float = 1.0
    inlier_before: float = 1.0

    @property
    def chain(self) -> Chain:
        """The chain of two states."""
        return Chain(self.width, self.interval_s, self.inlier_before)

    def weight(self, norm: Array) -> Array:
        """See :meth:`Loss.weight`."""
        return chain_weights(norm, self.chain)

    def cost(self, norm: Array) -> Array:
        """See :meth:`Loss.cost`."""
        return np.asarray(chain_cost(norm, self.chain))

    @property
    def convex(self) -> Huber:
        """Huber's loss: errors of a slip are too many and too large to count in full at the start."""
        return Huber(self.width)

    def after(self, norm: Array) -> SwitchChain:
        """Return the loss of factors that follow some with these norms (m,)."""
        return SwitchChain(self.width, self.interval_s, chain_after(norm, self.chain).inlier_before)
