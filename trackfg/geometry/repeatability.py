"""Two runs over one track are compared by the rule of track recording, section by section.

The standard deviation of the difference of two runs is taken per section of 200 m; the difference's mean over a section
does not count. Suto, Tsubokawa and Yoshida (2020) ask for 0.5 mm at most on every section, for 10 m versines.

The runs are laid over each other first, by one shift for the whole run or by one for each section. A shift is where the
weighted mean square of the differences of :data:`ALIGNED_BY`, or of what the runs have in their place, is least (each
by its variance along the reference), on the grid and then at the vertex of the parabola through the least value and its
neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
from trackfg.geometry.statistics import section_statistics
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.chainage_grid import cells_of, step_of
from trackfg.numerics.splines import spline_at

ALIGNED_BY = ("twist_mm", "versine_level_mm")
"""What has sharp features everywhere, curves or not."""
_OTHERWISE_BY = (
    ("level_mm", "alignment_mm"),
    ("level_left_mm", "level_right_mm", "alignment_left_mm", "alignment_right_mm"),
    ("cross_level_mm", "versine_alignment_mm", "gauge_mm", "curvature_1pm"),
)
"""What runs are laid over each other by that have none of these: the first group of which both have a column."""

_FURTHEST_M = 20.0
"""How far one run's chainage may be off from another's as a whole, m. Chosen here."""
_FURTHEST_IN_SECTION_M = 1.0
"""How far it may be off in a section besides, m. Chosen here."""
FULL_SHARE = 0.9
"""A section counts where both runs hold this share of it."""


def best_shift(reference: pd.DataFrame, run: pd.DataFrame, *, about_m: float = 0.0, within_m: float) -> float:
    """Return the shift ``d``, m, for which ``run`` at ``chainage + d`` agrees best with ``reference`` at ``chainage``.

    Both have ``chainage_m`` on whole multiples of one step, rising or falling, and a column in common that they can be
    laid over each other by. Sought within ``about_m`` +- ``within_m``. NaN where they have no place in common. Raises
    :class:`~trackfg.errors.BadInputError` for tables without these.
    """
    reference, run = _rising(reference, "reference"), _rising(run, "run")
    names = _aligned_by(reference, run)
    step = step_of(run)
    middle, reach = round(about_m / step), round(within_m / step)
    lags = middle + np.arange(-reach, reach + 1)
    cells = cells_of(reference, step)
    first, count = int(cells[0]), int(cells[-1] - cells[0]) + 1
    mean_square = np.zeros(len(lags))
    for name in names:
        if not all(name in table and table[name].notna().any() for table in (reference, run)):
            continue
        reference_cells = _on_cells(reference, name, first, count, step)
        variance = _mean_square(reference_cells - _mean(reference_cells))
        if not variance > 0.0:
            continue
        run_cells = _on_cells(run, name, first + int(lags[0]), count + 2 * reach, step)
        squares = np.array([_mean_square(run_cells[k : k + count] - reference_cells) for k in range(len(lags))])
        mean_square += squares / variance
    if not mean_square.any() or not np.isfinite(mean_square).any():
        return np.nan
    k = int(np.nanargmin(mean_square))
    beside = mean_square[max(k - 1, 0) : k + 2]
    if len(beside) < 3 or not np.isfinite(beside).all():
        return float(lags[k] * step)
    a, b, c = beside
    bend = a - 2.0 * b + c
    return float((lags[k] + (0.5 * (a - c) / bend if bend > 0.0 else 0.0)) * step)


def section_repeatability(
    reference: pd.DataFrame,
    run: pd.DataFrame,
    columns: Sequence[str],
    *,
    each_section: bool,
    section_m: float = 200.0,
) -> pd.DataFrame:
    """Return the standard deviation of the difference of each column per section that both runs hold.

    Shifted by the whole run's best shift, or with ``each_section`` by each section's own. Columns ``from_m, to_m,
    shift_m``, and one per name in ``columns`` with its standard deviation, in its unit. Raises
    :class:`~trackfg.errors.BadInputError` for a column that one of them has not, and as :func:`best_shift` does.
    """
    reference, run = _rising(reference, "reference"), _rising(run, "run")
    for what, table in (("reference", reference), ("run", run)):
        missing = [name for name in columns if name not in table]
        if missing:
            raise BadInputError(
                f"{what}: no column {missing[0]!r}; expected those to be compared, {', '.join(columns)}"
            )
    whole = best_shift(reference, run, within_m=_FURTHEST_M)
    if not np.isfinite(whole):
        return pd.DataFrame(columns=["from_m", "to_m", "shift_m", *columns], dtype=np.float64)
    chainage = reference["chainage_m"].to_numpy()
    number = np.floor(chainage / section_m + 1e-9)
    shift = np.full(len(chainage), whole)
    if each_section:
        for section in np.unique(number):
            rows = number == section
            section_shift = best_shift(reference[rows], run, about_m=whole, within_m=_FURTHEST_IN_SECTION_M)
            shift[rows] = section_shift if np.isfinite(section_shift) else whole
    full = FULL_SHARE * section_m / step_of(reference)
    table = section_statistics(chainage, shift, section_m=section_m)
    table = table[["from_m", "to_m", "mean"]].rename(columns={"mean": "shift_m"}).set_index("from_m")
    for name in columns:
        run_values = spline_at(run["chainage_m"].to_numpy(), run[name].to_numpy(), chainage + shift)
        sections = section_statistics(chainage, run_values - reference[name].to_numpy(), section_m=section_m)
        sections = sections[sections["count"] >= full].set_index("from_m")
        table[name] = sections["sd"].reindex(table.index)
    return table.dropna(subset=list(columns), how="all").reset_index()


def _rising(table: pd.DataFrame, what: str) -> pd.DataFrame:
    """Return a table with rows in order of rising chainage. Raises ``BadInputError`` where a place is there twice."""
    if "chainage_m" not in table:
        raise BadInputError(f"{what}: no column 'chainage_m'; expected one")
    chainage = table["chainage_m"].to_numpy(dtype=np.float64)
    if len(chainage) == 0 or not np.isfinite(chainage).all():
        raise BadInputError(f"{what}: {len(chainage)} rows, column 'chainage_m': expected places, all of them finite")
    if np.all(np.diff(chainage) > 0.0):
        return table
    rising = table.sort_values("chainage_m", ignore_index=True)
    if np.any(np.diff(rising["chainage_m"].to_numpy()) <= 0.0):
        row = int(np.argmax(rising["chainage_m"].duplicated()))
        place = rising["chainage_m"].iloc[row]
        raise BadInputError(f"{what}: column 'chainage_m': {place:g} m is there twice; expected every place once")
    return rising


def _aligned_by(reference: pd.DataFrame, run: pd.DataFrame) -> tuple[str, ...]:
    """Return the columns that two runs are laid over each other by. Raises ``BadInputError`` if there are none."""
    for group in (ALIGNED_BY, *_OTHERWISE_BY):
        names = tuple(name for name in group if name in reference and name in run)
        if names:
            return names
    expected = ", ".join(name for group in (ALIGNED_BY, *_OTHERWISE_BY) for name in group)
    raise BadInputError(
        f"reference and run have no column in common to be laid over each other by; expected one of {expected}"
    )


def _on_cells(table: pd.DataFrame, column: str, first: int, count: int, step: float) -> Array:
    """Return a column on ``count`` cells from ``first`` on; NaN where it has none."""
    row = cells_of(table, step) - first
    out = np.full(count, np.nan)
    inside = (row >= 0) & (row < count)
    out[row[inside]] = table[column].to_numpy()[inside]
    return out


def _mean(values: Array) -> float:
    """Return the mean of the finite values; NaN if there are none."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else np.nan


def _mean_square(values: Array) -> float:
    return _mean(values**2)
