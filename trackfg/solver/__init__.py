"""The solver minimises a graph by Gauss-Newton, and computes covariances and noise levels.

:func:`solve` minimises a problem of :mod:`trackfg.graph`, :func:`posterior_covariance` computes the covariance of the
minimum.
"""

from trackfg.solver.covariance import Covariance, posterior_covariance
from trackfg.solver.gauss_newton import Solution, solve

__all__ = ["Covariance", "Solution", "posterior_covariance", "solve"]
