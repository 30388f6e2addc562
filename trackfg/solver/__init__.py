"""The solver minimises a graph by Gauss-Newton, and computes covariances and noise levels.

:func:`solve` minimises a problem of :mod:`trackfg.graph`, :func:`posterior_covariance` tells how sure the minimum is.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from trackfg.lazy_imports import lazy_imports

if TYPE_CHECKING:
    from trackfg.solver.covariance import Covariance, posterior_covariance
    from trackfg.solver.gauss_newton import Solution, solve

__all__ = ["Covariance", "Solution", "posterior_covariance", "solve"]

__getattr__ = lazy_imports(
    __name__,
    {
        "Covariance": "covariance",
        "posterior_covariance": "covariance",
        "Solution": "gauss_newton",
        "solve": "gauss_newton",
    },
)
