"""Statistics along the chainage: sections of 200 m, sliding standard deviation, and peaks beyond a limit.

Values that are NaN do not count. Standard deviations are about the mean of what they are taken over (divisor: the
number of values).
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from trackfg.errors import BadInputError
from trackfg.geometry.grid import steps, window_sums
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import true_runs


def section_statistics(
    chainage_m: ArrayLike, values: ArrayLike, *, section_m: float = 200.0, threshold: float | None = None
) -> pd.DataFrame:
    """Return one row per section that has values, sections beginning at whole multiples of ``section_m``.

    Shape (n,) both. Columns ``from_m, to_m, count, mean, sd, mean_abs, max_abs`` and, with a ``threshold``,
    ``share_beyond``: the share of values with ``|x| > threshold``.
    """
    chainage, value = np.asarray(chainage_m, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if chainage.ndim != 1 or chainage.shape != value.shape:
        raise BadInputError(f"{value.shape} values at {chainage.shape} places; expected one value per place")
    finite = np.isfinite(value)
    chainage, value = chainage[finite], value[finite]
    if not section_m > 0.0:
        raise BadInputError(f"section_m is {section_m!r}; expected a length above 0")
    # A chainage such as 0.6 / 0.2 must not fall into the section before its own by rounding.
    number = np.floor(chainage / section_m + 1e-9).astype(np.int64)
    frame = pd.DataFrame({"value": value, "magnitude": np.abs(value)})
    groups = frame.groupby(number)
    table = pd.DataFrame(
        {
            "count": groups["value"].count(),
            "mean": groups["value"].mean(),
            "sd": groups["value"].std(ddof=0),
            "mean_abs": groups["magnitude"].mean(),
            "max_abs": groups["magnitude"].max(),
        }
    )
    if threshold is not None:
        table["share_beyond"] = (frame["magnitude"] > threshold).groupby(number).mean()
    start = table.index.to_numpy(dtype=np.float64) * section_m
    table.insert(0, "from_m", start)
    table.insert(1, "to_m", start + section_m)
    return table.reset_index(drop=True)


def sliding_sd(y: ArrayLike, step_m: float, length_m: float = 200.0) -> Array:
    """Return standard deviation over ``length_m`` centred at each place. Shape (..., n) to the same.

    NaN within half the length of an end, and where less than half of the values count. Raises ``BadInputError`` where
    half the length is no whole multiple of ``step_m``.
    """
    half = steps(length_m / 2.0, step_m, "half of length_m")
    y = np.asarray(y, dtype=np.float64)
    out = np.full(y.shape, np.nan)
    if y.shape[-1] <= 2 * half:
        return out
    counts = np.isfinite(y)
    whole = bool(counts.all())
    level = np.mean(y, axis=-1, keepdims=True, where=counts) if counts.any(axis=-1).all() else 0.0
    x = y - level  # about zero, so that little is lost in the difference of squares below
    if not whole:
        x = np.where(counts, x, 0.0)
    number = 2.0 * half + 1.0 if whole else window_sums(counts.astype(np.float64), 2 * half + 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = window_sums(x, 2 * half + 1) / number
        square = window_sums(x * x, 2 * half + 1) / number
    sd = np.sqrt(np.maximum(square - mean * mean, 0.0))
    out[..., half : y.shape[-1] - half] = np.where(np.asarray(number) > half, sd, np.nan)
    return out


def peaks(chainage_m: ArrayLike, values: ArrayLike, limit: float | Array) -> pd.DataFrame:
    """Return the exceedances: one row per run of values of one sign with ``|x| > limit``, at its largest value.

    Shape (n,) all, or one ``limit`` for all. Columns ``chainage_m`` and ``value`` of the extreme, ``from_m, to_m`` and
    ``length_m`` of the run (0 for a single place). A NaN ends a run.
    """
    chainage, value = np.asarray(chainage_m, dtype=np.float64), np.asarray(values, dtype=np.float64)
    rows = []
    for sign in (1.0, -1.0):
        for first, stop in true_runs(sign * value > limit):
            top = first + int(np.argmax(sign * value[first:stop]))
            rows.append((chainage[top], value[top], chainage[first], chainage[stop - 1]))
    table = pd.DataFrame(rows, columns=["chainage_m", "value", "from_m", "to_m"], dtype=np.float64)
    table["length_m"] = table["to_m"] - table["from_m"]
    return table.sort_values("chainage_m", ignore_index=True)
