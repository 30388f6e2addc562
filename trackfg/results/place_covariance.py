"""Joint covariance of the errors of chainage and cross-level along a run.

The per-row sigmas of the tables do not contain the correlation between rows, which dominates: the wheel's scale and the
accelerometer's bias are common to the whole run. The covariance is given at places :data:`APART_M` apart; errors in
between are their linear interpolation, to a few mm. A map needs it beside the run's profile.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from trackfg.numerics.key_figures import Outlined

if TYPE_CHECKING:
    from trackfg.numerics.arrays import Array

APART_M = 250.0
"""Distance of the places whose covariance a result holds, m: in between, errors are linear to a few mm."""


_ROUNDING = 1e-6
"""Asymmetry and negative eigenvalues of a matrix of correlations that are rounding of the smoother's elimination."""
_TESTED = 500
"""Places that are tested together, 125 km, each stretch and the next having half of them in common."""
_OF = ("chainage_m", "cross_level_mm")


@dataclass(frozen=True, repr=False)
class PlaceCovariance(Outlined):
    """Joint covariance of the errors at places ``chainage_m`` (p,), ascending.

    ``matrix`` (2 p, 2 p): of the chainage of all places (m), then of the cross-level of all places (mm), both facing
    increasing chainage. The uncertainty of the mounting's roll is not in it. Raises ``ValueError`` for other shapes.
    """

    chainage_m: Array
    matrix: Array

    def __post_init__(self) -> None:
        p = len(self.chainage_m)
        if self.matrix.shape != (2 * p, 2 * p) or np.any(np.diff(self.chainage_m) <= 0.0):
            raise ValueError(f"covariance {self.matrix.shape} of {p} places: expected ascending places, {2 * p} rows")

    def refuse_unsound(self) -> None:
        """Raise ``ValueError`` unless this is a covariance: finite, symmetric, without a negative variance.

        The last is tested of all functions of places within 125 km, stretch by stretch: of a day's places all together
        the test would take longer than the smoother.
        """
        rows = [slice(begin, begin + _TESTED) for begin in range(0, len(self.matrix), _TESTED)]
        if not (np.isfinite(self.chainage_m).all() and all(np.isfinite(self.matrix[own]).all() for own in rows)):
            raise ValueError("covariance: expected finite numbers")
        if not all(np.allclose(self.matrix[own], self.matrix[:, own].T, rtol=_ROUNDING, atol=0.0) for own in rows):
            raise ValueError("covariance: expected a symmetric matrix")
        if np.any(np.diag(self.matrix) <= 0.0):
            raise ValueError("covariance: expected variances above 0")
        places = len(self.chainage_m)
        for begin in range(0, max(places - _TESTED // 2, 1), _TESTED // 2):
            some = np.arange(begin, min(begin + _TESTED, places))
            own = np.concatenate([some, places + some])
            part = self.matrix[np.ix_(own, own)]
            sd = np.sqrt(np.diag(part))
            try:
                np.linalg.cholesky(part / np.outer(sd, sd) + _ROUNDING * np.eye(len(own)))
            except np.linalg.LinAlgError:
                raise ValueError("covariance: expected a positive definite matrix") from None

    @classmethod
    def none(cls) -> PlaceCovariance:
        """Return the covariance of a run that tells nothing of the track."""
        return cls(np.zeros(0), np.zeros((0, 0)))

    def at(self, chainage: Array) -> Array:
        """Return the joint covariance at other places (m,), shape (2 m, 2 m); beyond the ends that of the ends."""
        weights = interpolation_weights(self.chainage_m, chainage)
        both = np.kron(np.eye(2), weights)
        return np.asarray(both @ self.matrix @ both.T)

    def to_frame(self) -> pd.DataFrame:
        """Return one row per quantity and place: ``quantity, chainage_m``, then its covariances with each
        ``quantity@m``.
        """
        names = [f"{name}@{place:.10g}" for name in _OF for place in self.chainage_m]
        table = pd.DataFrame(self.matrix.T, columns=names)  # each column is one piece of memory, which Arrow writes
        table.insert(0, "quantity", np.repeat(_OF, len(self.chainage_m)))
        table.insert(1, "chainage_m", np.tile(self.chainage_m, 2))
        return table

    @classmethod
    def from_frame(cls, table: pd.DataFrame) -> PlaceCovariance:
        """Read what :meth:`to_frame` gave. Raises ``ValueError`` for any other table."""
        places = len(table) // 2
        if list(table.columns[:2]) != ["quantity", "chainage_m"] or list(table["quantity"]) != list(
            np.repeat(_OF, places)
        ):
            raise ValueError("expected the columns quantity, chainage_m and covariances")
        chainage = table["chainage_m"].to_numpy(dtype=np.float64)[:places]
        return cls(chainage, table.iloc[:, 2:].to_numpy(dtype=np.float64))


def interpolation_weights(places: Array, at: Array) -> Array:
    """Return W (m, p): ``W @ values`` is the linear interpolation of values at ascending places (p,), constant
    beyond.
    """
    weights = np.zeros((len(at), len(places)))
    left, f = _bracketed(places, at)
    row = np.arange(len(at))
    weights[row, left] = 1.0 - f
    weights[row, left + (f > 0.0)] += f
    return weights


def interpolated_variance(places: Array, covariance: Array, at: Array) -> Array:
    """Return the variance of a quantity known at ascending places (p,) and linear in between, constant beyond. Shape
    (m,).
    """
    left, f = _bracketed(places, at)
    variance = np.append(np.diag(covariance), 0.0)
    beside = np.append(np.diag(covariance, 1), 0.0)
    return np.asarray((1.0 - f) ** 2 * variance[left] + 2.0 * f * (1.0 - f) * beside[left] + f**2 * variance[left + 1])


def _bracketed(places: Array, at: Array) -> tuple[np.ndarray, Array]:
    """Return the place before each (m,), and the share of the way to the next: 0 before the first, 1 after the last."""
    if len(places) == 1:
        return np.zeros(len(at), dtype=np.int64), np.zeros(len(at))
    left = np.clip(np.searchsorted(places, at, side="right") - 1, 0, len(places) - 2)
    return left, np.clip((at - places[left]) / (places[left + 1] - places[left]), 0.0, 1.0)
