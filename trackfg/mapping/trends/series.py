"""Repeated runs over a map are a series: every quantity at every cell of the map, on every date, with its sigma.

Each run is recognised on the map and laid over it as for changes of the track (:mod:`trackfg.mapping.changes`); its
value is that of the map and the run's change. Offset and slow wander of a run's cross-level are removed there, because
the sensor's cannot be separated from the track's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
from trackfg.mapping.changes.find import find_changes
from trackfg.mapping.changes.overlay import SUMMARY_M, without_gaps
from trackfg.mapping.joining.build import JoinableRun
from trackfg.mapping.recognition.other_track import other_track_message
from trackfg.mapping.trends.drift import FEWEST_RUNS
from trackfg.mapping.trends.wear import DAY_S
from trackfg.maps.feature_map import FeatureMap
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.chainage_grid import cells_of
from trackfg.numerics.key_figures import Outlined
from trackfg.results.result import Result
from trackfg.results.summary import Summary

QUANTITIES = ("cross_level_mm", "twist_mm", "versine_level_mm", "versine_alignment_mm")
"""What is followed over time."""

_LEAST_COVERED = 0.8
"""Share of a section that a run covers at least, for its standard deviation there to be compared with others'."""


@dataclass(frozen=True, repr=False)
class Series(Outlined):
    """Values and sigmas by quantity, (n, m), of n runs in the order of their dates at m places.

    ``chainage_m`` (m,): of cells, or where sections begin. ``t_days`` (n,) from the first date; ``runs`` their names.
    ``sensors``: the one that each ran with, in its mounting. ``doubts``: by name runs that are of another track, as far
    as their irregularities show, in a sentence.
    """

    runs: tuple[str, ...]
    dates: tuple[datetime, ...]
    chainage_m: Array
    step_m: float
    value: dict[str, Array]
    sd: dict[str, Array]
    sensors: tuple[str, ...]
    doubts: dict[str, str] = field(default_factory=dict)

    @property
    def t_days(self) -> Array:
        """Return days since the first run."""
        return np.array([(date - self.dates[0]).total_seconds() / DAY_S for date in self.dates])

    def table(self) -> pd.DataFrame:
        """Return one row per run and place where the run says anything."""
        n, m = len(self.runs), self.chainage_m.size
        columns: dict[str, Any] = {"run": np.repeat(self.runs, m), "date": pd.Series(self.dates).repeat(m).to_numpy()}
        columns["chainage_m"] = np.tile(self.chainage_m, n)
        for name, values in self.value.items():
            columns |= {name: values.ravel(), f"{name}_sd": self.sd[name].ravel()}
        table = pd.DataFrame(columns)
        return table[table[list(self.value)].notna().any(axis=1)].reset_index(drop=True)


def series(results: Sequence[Result | JoinableRun], feature_map: FeatureMap) -> tuple[Series, dict[str, str]]:
    """Lay results over a map, one after another. Returns the series, and by name runs that cannot be, with the reason.

    Runs are distinguished by what they measured: of recordings with one id, the second is named ``ID-2``. Raises
    :class:`~trackfg.errors.BadInputError` for a run whose recording has no date, or whose measurements are there twice,
    and for fewer runs than a trend needs.
    """
    dated = sorted(((_date(result.summary), result) for result in results), key=lambda pair: pair[0])
    names = _names([result.summary for _, result in dated])
    entries, left_out, doubts = [], dict[str, str](), dict[str, str]()
    for run, (date, result) in zip(names, dated, strict=True):
        try:
            read = result.read() if isinstance(result, JoinableRun) else result
            changes = find_changes(read, feature_map)
        except BadInputError as error:
            left_out[run] = str(error).removeprefix(f"run {result.summary.recording_id}: ")
            continue
        entries.append((date, run, changes.cells, sensor_of(result.summary)))
        if changes.other_track:
            doubts[run] = other_track_message(run, feature_map.name)
    if (different := len({date for date, *_ in entries})) < FEWEST_RUNS:
        reasons = "".join(f"; {reason}" for reason in left_out.values())
        raise BadInputError(f"{different} runs of different dates; a trend needs at least {FEWEST_RUNS}{reasons}")
    meanings = [result.summary.geometry for result in results]
    if len(bases := {meaning.twist_base for meaning in meanings}) > 1:
        raise BadInputError(f"runs with twists over {', '.join(sorted(bases))}; expected one base")
    step = feature_map.conventions.step_m
    on_map = without_gaps(feature_map.grid, step, meanings[0])
    every, shape = on_map.index.to_numpy(), (len(entries), len(on_map))
    values, sd = ({name: np.full(shape, np.nan) for name in QUANTITIES} for _ in range(2))
    for row, (_, _, change, _) in enumerate(entries):
        places = cells_of(change, step) - every[0]
        for name in QUANTITIES:
            values[name][row, places] = on_map[name].to_numpy()[places] + change[name].to_numpy()
            sd[name][row, places] = change[f"{name}_sd"].to_numpy()
    dates, runs, _, sensors = zip(*entries, strict=True)
    return Series(runs, dates, every * step, step, values, sd, sensors, doubts), left_out


def sensor_of(summary: Summary) -> str:
    """Return which sensor a run was made with, in which mounting; empty where it is not known."""
    return "" if summary.run is None else summary.run.imu_id or ""


def _names(summaries: Sequence[Summary]) -> list[str]:
    """Return a name for each dated run: its recording's id, with a number where an earlier run has that."""
    names: dict[tuple[str, str | None], str] = {}
    for summary in summaries:
        facts = summary.run
        measured = ("", None) if facts is None else (facts.content_sha256, facts.start)
        if measured in names:
            raise BadInputError(
                f"run {summary.recording_id!r} has the measurements of run {names[measured]!r}; expected each run once"
            )
        name, taken = summary.recording_id, 1
        while name in names.values():
            taken += 1
            name = f"{summary.recording_id}-{taken}"
        names[measured] = name
    return list(names.values())


def section_series(cells: Series, correlated_m: float) -> Series:
    """Return the standard deviation of each quantity over sections of 200 m.

    Errors are taken to be independent ``correlated_m`` apart: to first order the standard deviation of a section errs
    by the sigma of a cell over the root of the number of independent ones.
    """
    section = np.floor(cells.chainage_m / SUMMARY_M + 1e-9).astype(np.int64)
    first, index = np.unique(section, return_inverse=True)
    values, sd = {}, {}
    for name in cells.value:
        rows = pd.DataFrame(cells.value[name].T).groupby(index)
        covered = _LEAST_COVERED * SUMMARY_M / cells.step_m <= rows.count().to_numpy().T
        errors = pd.DataFrame(cells.sd[name].T ** 2).groupby(index).mean().to_numpy().T
        values[name] = np.where(covered, rows.std(ddof=0).to_numpy().T, np.nan)
        sd[name] = np.where(covered, np.sqrt(errors * correlated_m / SUMMARY_M), np.nan)
    return Series(cells.runs, cells.dates, np.asarray(first * SUMMARY_M), SUMMARY_M, values, sd, cells.sensors)


def _date(summary: Summary) -> datetime:
    facts = summary.run
    date = None if facts is None else facts.start_utc
    if date is None:
        raise BadInputError(
            f"run {summary.recording_id}: its recording has no start; expected a date and time. "
            "Hint: write start = 2026-05-01T03:12:00Z into recording.toml and smooth it again"
        )
    return date
