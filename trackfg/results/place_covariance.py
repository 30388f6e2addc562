"""Joint covariance of the errors of chainage and cross-level along a run.

The per-row sigmas of the tables do not contain the correlation between rows, which dominates: the wheel's scale and the
accelerometer's bias are common to the whole run. The covariance is given at places :data:`APART_M` apart; errors in
between are their linear interpolation, to a few mm. A map needs it beside the run's profile. That of a long run is kept
by blocks of places (:mod:`trackfg.numerics.chained_covariance`), so that it grows in proportion to the run.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from trackfg.numerics.chained_covariance import Block, ChainedCovariance
from trackfg.numerics.key_figures import Outlined

if TYPE_CHECKING:
    from trackfg.numerics.arrays import Array

APART_M = 250.0
"""Distance of the places whose covariance a result holds, m: in between, errors are linear to a few mm."""


_ROUNDING = 1e-6
"""Asymmetry and negative eigenvalues of a matrix of correlations that are rounding of the smoother's elimination."""
_STRETCH = 500
"""Places, 125 km: so many are one matrix (8 MB) that every program reads, and of more so many are tested together, each
stretch and the next having half of them in common."""
_OF = ("chainage_m", "cross_level_mm")
_PARTS = Block._fields[1:]


@dataclass(frozen=True, repr=False)
class PlaceCovariance(Outlined):
    """Joint covariance of the errors at places ``chainage_m`` (p,), ascending.

    ``errors``: of the chainage of all places (m), then of the cross-level of all places (mm), both facing increasing
    chainage. The uncertainty of the mounting's roll is not in it. Raises ``ValueError`` for other numbers of them.
    """

    chainage_m: Array
    errors: ChainedCovariance

    def __post_init__(self) -> None:
        p, size = len(self.chainage_m), self.errors.size
        if size != 2 * p or np.any(np.diff(self.chainage_m) <= 0.0):
            raise ValueError(f"covariance of {size} errors at {p} places: expected ascending places, {2 * p} rows")

    @classmethod
    def of(cls, chainage: Array, matrix: Array) -> PlaceCovariance:
        """Return the covariance that is given as a matrix (2 p, 2 p) of ascending places (p,)."""
        return cls(chainage, ChainedCovariance.of(matrix))

    @classmethod
    def in_order_of_time(cls, chainage: Array, errors: ChainedCovariance) -> PlaceCovariance:
        """Return the covariance of chainage and cross-level at the first place (p,) that was passed, then the next."""
        rank = np.argsort(np.argsort(chainage, kind="stable"), kind="stable")
        errors = errors.renumbered(np.stack([rank, rank + len(rank)], axis=1).ravel())
        return cls(np.sort(chainage), ChainedCovariance.of(errors.matrix) if len(rank) <= _STRETCH else errors)

    @property
    def matrix(self) -> Array:
        """The whole covariance (2 p, 2 p)."""
        return self.errors.matrix

    def refuse_unsound(self) -> None:
        """Raise ``ValueError`` unless this is a covariance: finite, symmetric, without a negative variance.

        The last is tested of all functions of places within 125 km, stretch by stretch: of a day's places all together
        the test would take longer than the smoother.
        """
        numbers = [block[1:] for block in self.errors.blocks]
        if not all(np.isfinite(part).all() for part in (self.chainage_m, *itertools.chain.from_iterable(numbers))):
            raise ValueError("covariance: expected finite numbers")
        if not all(np.allclose(covariance, covariance.T, rtol=_ROUNDING, atol=0.0) for covariance, *_ in numbers):
            raise ValueError("covariance: expected a symmetric matrix")
        places = len(self.chainage_m)
        for begin in range(0, max(places - _STRETCH // 2, 1), _STRETCH // 2):
            part = self._between(np.arange(begin, min(begin + _STRETCH, places)))
            if np.any(np.diag(part) <= 0.0):
                raise ValueError("covariance: expected variances above 0")
            sd = np.sqrt(np.diag(part))
            try:
                np.linalg.cholesky(part / np.outer(sd, sd) + _ROUNDING * np.eye(len(part)))
            except np.linalg.LinAlgError:
                raise ValueError("covariance: expected a positive definite matrix") from None

    @classmethod
    def none(cls) -> PlaceCovariance:
        """Return the covariance of a run without information about the track."""
        return cls.of(np.zeros(0), np.zeros((0, 0)))

    def at(self, chainage: Array) -> Array:
        """Return the joint covariance at other places (m,), shape (2 m, 2 m); beyond the ends that of the ends."""
        left, f = _bracketed(self.chainage_m, chainage)
        right = left + (f > 0.0)
        places = np.unique([left, right])
        count, share = len(places), np.tile(f, 2)[:, None]
        first, second = ([k, k + count] for k in (np.searchsorted(places, left), np.searchsorted(places, right)))

        def interpolated(rows: Array) -> Array:
            return np.asarray((1.0 - share) * rows[np.concatenate(first)] + share * rows[np.concatenate(second)])

        return interpolated(interpolated(self._between(places)).T).T

    def _between(self, places: np.ndarray) -> Array:
        """Return the covariance of some places (m,) alone: (2 m, 2 m)."""
        return self.errors.part(np.concatenate([places, len(self.chainage_m) + places]))

    def to_frame(self) -> pd.DataFrame:
        """Return one row per quantity and place: ``quantity, chainage_m``, then its covariances with each
        ``quantity@m``; or, of a long run, one row per block: the places in it, and its numbers row by row.
        """
        if len(self.errors.blocks) > 1:
            rows = [
                [self.chainage_m[block.rows[::2]], *(part.ravel() for part in block[1:])]
                for block in self.errors.blocks
            ]
            return pd.DataFrame(rows, columns=["chainage_m", *_PARTS])
        names = [f"{name}@{place:.10g}" for name in _OF for place in self.chainage_m]
        table = pd.DataFrame(self.matrix.T, columns=names)  # each column is one piece of memory, which Arrow writes
        table.insert(0, "quantity", np.repeat(_OF, len(self.chainage_m)))
        table.insert(1, "chainage_m", np.tile(self.chainage_m, 2))
        return table

    @classmethod
    def from_frame(cls, table: pd.DataFrame) -> PlaceCovariance:
        """Read what :meth:`to_frame` gave. Raises ``ValueError`` for any other table."""
        if tuple(table.columns) == ("chainage_m", *_PARTS):
            return _of_blocks(table)
        places = len(table) // 2
        if list(table.columns[:2]) != ["quantity", "chainage_m"] or list(table["quantity"]) != list(
            np.repeat(_OF, places)
        ):
            raise ValueError("expected the columns quantity, chainage_m and covariances")
        chainage = table["chainage_m"].to_numpy(dtype=np.float64)[:places]
        return cls.of(chainage, table.iloc[:, 2:].to_numpy(dtype=np.float64))


def _of_blocks(table: pd.DataFrame) -> PlaceCovariance:
    """Read the covariance of a long run, a row per block in order of time."""
    blocks, count = [], 0
    for places, covariance, by_end, start_by_end, with_start in table.itertuples(index=False):
        m = 2 * len(places)
        at_end, at_start = np.reshape(by_end, (m, -1)), np.reshape(with_start, (-1, m))
        start_at_end = np.reshape(start_by_end, (len(at_start), at_end.shape[1]))
        blocks.append(Block(count + np.arange(m), np.reshape(covariance, (m, m)), at_end, start_at_end, at_start))
        count += m
    chainage = np.concatenate(table["chainage_m"].to_list())
    return PlaceCovariance.in_order_of_time(chainage, ChainedCovariance(tuple(blocks)))


def interpolation_weights(places: Array, at: Array) -> Array:
    """Return W (m, p): ``W @ values`` is linear between ascending places (p,), and constant beyond them."""
    weights = np.zeros((len(at), len(places)))
    left, f = _bracketed(places, at)
    row = np.arange(len(at))
    weights[row, left] = 1.0 - f
    weights[row, left + (f > 0.0)] += f
    return weights


def interpolated_variance(places: Array, covariance: Array, at: Array) -> Array:
    """Return the variance (m,) of a quantity known at ascending places (p,): linear in between, constant beyond."""
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
