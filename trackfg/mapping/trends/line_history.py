"""The standard deviations of each 200 m of a line over time come from the runs' results alone: no map is needed.

Each run's geometry becomes standard deviations over sections (:func:`trackfg.mapping.trends.series.section_series`);
those of all runs of a line are a series, whose drift is fitted as that of cells. Sections are 200 m long, so that
chainages which agree to some metres do; the trends of a map (:mod:`trackfg.mapping.trends.trends`) say where in a
section, and lay runs over each other first.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

import numpy as np
import pandas as pd

from trackfg.mapping.trends.drift import FEWEST_RUNS
from trackfg.mapping.trends.series import QUANTITIES, Series, section_series, sensor_of
from trackfg.mapping.trends.trends import drift_of
from trackfg.mapping.trends.wear import months
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.chainage_grid import step_of
from trackfg.results.summary import Summary


def sections_of_run(geometry: pd.DataFrame, run: str, date: datetime, summary: Summary) -> Series:
    """Return the standard deviations of a run's geometry by sections: a series of one run.

    Errors are taken to be independent a chord apart, for the sigmas.
    """
    chainage = geometry["chainage_m"].to_numpy(dtype=np.float64)
    value, sd = (
        {name: geometry[f"{name}{end}"].to_numpy(dtype=np.float64)[None] for name in QUANTITIES} for end in ("", "_sd")
    )
    of_run = Series((run,), (date,), chainage, step_of(geometry), value, sd, (sensor_of(summary),))
    return section_series(of_run, summary.geometry.chord_m)


def joined(runs: Sequence[Series]) -> Series:
    """Return the series of several runs' sections, in the order of their dates; NaN where a run has none."""
    by_date = sorted(runs, key=lambda run: run.dates[0])
    places = np.unique(np.concatenate([run.chainage_m for run in by_date]))
    value, sd = ({name: np.full((len(by_date), places.size), np.nan) for name in QUANTITIES} for _ in range(2))
    for row, run in enumerate(by_date):
        at = np.searchsorted(places, run.chainage_m)
        for name in QUANTITIES:
            value[name][row, at], sd[name][row, at] = run.value[name][0], run.sd[name][0]
    names, dates = tuple(run.runs[0] for run in by_date), tuple(run.dates[0] for run in by_date)
    return Series(names, dates, places, by_date[0].step_m, value, sd, tuple(run.sensors[0] for run in by_date))


def newest(history: Series, name: str) -> tuple[Array, Array]:
    """Return the last value of each section and its sigma; NaN where no run knows one."""
    value, sd = history.value[name], history.sd[name]
    back = np.isfinite(value)[::-1].argmax(axis=0)
    at = len(value) - 1 - back, np.arange(value.shape[1])
    return value[at], sd[at]


def rates(history: Series, name: str) -> tuple[Array, Array]:
    """Return how fast each section's value grows and the sigma of that, per month; NaN where too few runs know it."""
    if len(set(history.dates)) < FEWEST_RUNS:
        none = np.full(history.chainage_m.size, np.nan)
        return none, none
    drift = drift_of(history, name, months(history.dates))
    return drift.rate, drift.rate_sd


def section_table(history: Series) -> pd.DataFrame:
    """Return one row per section that a run knows, with the newest value of each quantity and its growth per month.

    Columns ``from_m, to_m``, and ``NAME, NAME_sd, NAME_per_month, NAME_per_month_sd`` in mm.
    """
    columns = {"from_m": history.chainage_m, "to_m": history.chainage_m + history.step_m}
    for name in history.value:
        columns[name], columns[f"{name}_sd"] = newest(history, name)
        columns[f"{name}_per_month"], columns[f"{name}_per_month_sd"] = rates(history, name)
    table = pd.DataFrame(columns)
    return table[table[list(history.value)].notna().any(axis=1)].reset_index(drop=True)
