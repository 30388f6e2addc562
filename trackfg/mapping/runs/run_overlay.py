"""Runs over one line laid over the first of them: their shifts, and how well every channel repeats.

The rule is that of track recording: the standard deviation of the difference of two runs per section of 200 m, in which
a constant difference does not count (:mod:`trackfg.geometry.repeatability`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
from trackfg.geometry.cross_level import on_base
from trackfg.geometry.repeatability import FULL_SHARE
from trackfg.geometry.statistics import section_statistics
from trackfg.mapping.recognition.profiles import SECTION_M
from trackfg.mapping.recognition.warp import warped
from trackfg.mapping.runs.run_alignment import aligned
from trackfg.numerics.chainage.chainage_grid import cells_of
from trackfg.numerics.key_figures import Outlined
from trackfg.results.columns import BAND_COLUMNS, CHANNELS
from trackfg.results.result import Result

REPEATED_M = 200.0
"""Length of the sections of repeatability, m."""
DIFFERENCE_COLUMNS = ("run", "channel", "from_m", "to_m", "sd", "mean")
REPEATABILITY_COLUMNS = ("run", "channel", "sections", "sd_median", "sd_95", "sd_max", "mean")


@dataclass(frozen=True, repr=False)
class RunOverlay(Outlined):
    """Runs over the first of them, the reference.

    ``shifts``: the sections of all further runs, columns :data:`~trackfg.mapping.runs.run_alignment.SHIFT_COLUMNS`.
    ``geometries``: of each run by the reference's chainage and on its base of cross-level, the reference first.
    ``differences``: one row per run, channel and section of 200 m, columns :data:`DIFFERENCE_COLUMNS`, with the
    standard deviation and the mean of run less reference in the channel's unit.
    """

    names: tuple[str, ...]
    shifts: pd.DataFrame
    geometries: tuple[pd.DataFrame, ...]
    differences: pd.DataFrame

    @property
    def repeatability(self) -> pd.DataFrame:
        """The median, 95 % quantile and maximum of the sections' standard deviations, by run and channel."""
        rows = [
            (
                run,
                channel,
                len(table),
                *(float(np.quantile(table["sd"], share)) for share in (0.5, 0.95, 1.0)),
                float(table["mean"].mean()),
            )
            for (run, channel), table in self.differences.groupby(["run", "channel"], sort=False)
        ]
        return pd.DataFrame(rows, columns=list(REPEATABILITY_COLUMNS))


def overlaid(results: Sequence[Result], names: Sequence[str], *, section_m: float = SECTION_M) -> RunOverlay:
    """Lay runs over the first of them. ``section_m``: length of the sections of the shift, a whole multiple of 20 m.

    Raises :class:`BadInputError` for fewer than two runs, for names that are there twice, and for a run that is
    recognised nowhere on the first.
    """
    if len(results) < 2:
        raise BadInputError(f"{', '.join(names) or 'no run'}: expected at least two runs, to lay one over the other")
    if len(set(names)) < len(names):
        raise BadInputError(f"runs of one name: {', '.join(names)}; expected each name once")
    reference = results[0]
    step_m = reference.summary.geometry.step_m
    shifts, geometries, differences = [], [reference.geometry], []
    base_m = reference.summary.geometry.cross_level_base_m
    for run, name in zip(results[1:], names[1:], strict=True):
        result = replace(run, geometry=on_base(run.geometry, run.summary.geometry.cross_level_base_m, base_m))
        shifts_of_run, to_reference = aligned(result, reference, name, section_m)
        geometry = warped(result.geometry.dropna(axis=1, how="all"), to_reference, step_m)
        shifts.append(shifts_of_run)
        geometries.append(geometry)
        differences.append(_differences(reference, result, geometry, name))
    shift_table = pd.concat(shifts, ignore_index=True)
    return RunOverlay(tuple(names), shift_table, tuple(geometries), pd.concat(differences, ignore_index=True))


def _differences(reference: Result, run: Result, geometry: pd.DataFrame, name: str) -> pd.DataFrame:
    """Return the standard deviation and mean of the difference per section, of each channel that means the same."""
    step_m = reference.summary.geometry.step_m
    channels = comparable_channels(reference, run)
    reference_table, run_table = (table[["chainage_m", *channels]] for table in (reference.geometry, geometry))
    _, row, row_of_run = np.intersect1d(
        cells_of(reference_table, step_m), cells_of(run_table, step_m), assume_unique=True, return_indices=True
    )
    chainage = reference_table["chainage_m"].to_numpy()[row]
    tables = [pd.DataFrame(columns=list(DIFFERENCE_COLUMNS))]
    for channel in channels:
        difference = run_table[channel].to_numpy()[row_of_run] - reference_table[channel].to_numpy()[row]
        table = section_statistics(chainage, difference, section_m=REPEATED_M)
        table = table[table["count"] >= FULL_SHARE * REPEATED_M / step_m]
        if len(table):
            tables.append(table.assign(run=name, channel=channel)[list(DIFFERENCE_COLUMNS)])
    return pd.concat(tables[1:] or tables, ignore_index=True)


def comparable_channels(reference: Result, run: Result) -> list[str]:
    """Return the channels that both runs know and that mean the same in both."""
    a, b = reference.summary.geometry, run.summary.geometry
    same = {
        "twist": (a.twist_base_m, a.twist_anchor) == (b.twist_base_m, b.twist_anchor),
        "versine": a.chord_m == b.chord_m and (reference.summary.solver is None) == (run.summary.solver is None),
        "level": a.band_m == b.band_m,
        "alignment": a.band_m == b.band_m,
        "curvature": a.curvature_base_m == b.curvature_base_m,
        "gradient": a.gradient_base_m == b.gradient_base_m,
    }
    return [
        name
        for name in CHANNELS
        if all(name in result.geometry and result.geometry[name].notna().any() for result in (reference, run))
        and (name in BAND_COLUMNS or same.get(name.partition("_")[0], True))
    ]
