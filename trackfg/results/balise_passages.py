"""A run measures how far apart the balises and other fixes are that it passed, by everything but these fixes.

Smoothed without any of its fixes, a run knows how far apart two passages are (wheel, inertial sensor, GNSS), and not
where the first of them is. So ``chainage_m`` is right up to one unknown offset, and the covariance is that of the
differences. Several runs over the same balises are joined from these numbers alone
(:mod:`trackfg.mapping.runs.balise_survey`), as the graph of all states of all runs would be.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from trackfg.numerics.key_figures import Outlined
from trackfg.results.soundness import LEAST_SIGMA

if TYPE_CHECKING:
    from trackfg.numerics.arrays import Array

PASSAGE_COLUMNS = ("t_s", "id", "chainage_m", "reading_m_sd", "planned_m", "planned_m_sd")
_LARGEST_M = 1e12
_ROUNDING = 1e-9
"""Asymmetry and negative eigenvalues, in shares of the greatest variance, that are rounding of the elimination: 3 mm
beside a distance that is known to 100 m."""


@dataclass(frozen=True, repr=False)
class BalisePassages(Outlined):
    """The passages of a run in order of time, and the joint covariance (m, m), m^2, of their chainages.

    ``table`` has the columns :data:`PASSAGE_COLUMNS`: the time; the id, empty for a fix without one; the chainage up to
    the run's offset; the sigma of one reading, by which the passage is off from the place; and the place that is
    planned with its sigma, NaN where none is. Raises ``ValueError`` for other shapes.
    """

    table: pd.DataFrame
    covariance: Array

    def __post_init__(self) -> None:
        m = len(self.table)
        if tuple(self.table.columns) != PASSAGE_COLUMNS or self.covariance.shape != (m, m):
            raise ValueError(
                f"passages: {list(self.table.columns)}, {self.covariance.shape}: expected {m} rows of each"
            )

    def __len__(self) -> int:
        return len(self.table)

    @classmethod
    def none(cls) -> BalisePassages:
        """Return those of a run that passed no balise with an id."""
        return cls(pd.DataFrame(columns=list(PASSAGE_COLUMNS)), np.zeros((0, 0)))

    def refuse_unsound(self) -> None:
        """Raise ``ValueError`` unless all numbers are sound and the matrix is a covariance."""
        numbers = self.table.drop(columns=["id", "planned_m", "planned_m_sd"]).to_numpy(dtype=np.float64)
        planned = self.table[["planned_m", "planned_m_sd"]].to_numpy(dtype=np.float64)
        if not (np.abs(numbers) <= _LARGEST_M).all() or (np.abs(planned) > _LARGEST_M).any():
            raise ValueError("passages: expected finite numbers")
        if (self.table[["reading_m_sd", "planned_m_sd"]] < LEAST_SIGMA).any(axis=None):
            raise ValueError(f"passages: expected sigmas of {LEAST_SIGMA:g} m or more")
        scale = max(float(np.abs(self.covariance).max(initial=0.0)), 1e-12)
        skew = np.abs(self.covariance - self.covariance.T).max(initial=0.0)
        if not (np.isfinite(scale) and skew <= _ROUNDING * scale):
            raise ValueError("passages: expected a symmetric covariance")
        least = np.linalg.eigvalsh(self.covariance).min(initial=0.0)
        if least < -_ROUNDING * scale:
            raise ValueError("passages: expected a covariance without negative variances")

    def to_frame(self) -> pd.DataFrame:
        """Return one row per passage: its columns, then its covariance with each, by number."""
        matrix = pd.DataFrame(self.covariance, columns=[f"covariance_{j}" for j in range(len(self))])
        return pd.concat([self.table.reset_index(drop=True), matrix], axis=1)

    @classmethod
    def from_frame(cls, frame: pd.DataFrame) -> BalisePassages:
        """Read what :meth:`to_frame` gave. Raises ``ValueError`` for any other table."""
        columns = len(PASSAGE_COLUMNS)
        return cls(frame.iloc[:, :columns], frame.iloc[:, columns:].to_numpy(dtype=np.float64))
