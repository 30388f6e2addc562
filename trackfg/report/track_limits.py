"""Hold the geometry of a result against limits of track geometry.

The table of a result may have holes in its chainage, and columns of other lengths than the usual ones; both are taken
from the result before :func:`trackfg.geometry.exceedances.exceedances` judges it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from trackfg.files.atomic_file import write_whole
from trackfg.geometry.bands import Band
from trackfg.geometry.exceedances import Judgement, exceedances
from trackfg.geometry.judged_quantities import ColumnLengths
from trackfg.geometry.limits import Limit, at_line_speed
from trackfg.geometry.versine_bands import with_long_bands
from trackfg.geometry.versine_chords import with_further_chords
from trackfg.numerics.chainage.chainage_grid import cells_of
from trackfg.results.official_places import shown_kilometrage, with_km
from trackfg.results.result import Result
from trackfg.results.verdict import NOT_TRUSTED, Quantity, untrusted, widening

_QUANTITIES: dict[str, Quantity] = {
    "level": "level",
    "alignment": "alignment",
    "cross_level": "cross_level",
    "reverse_cross_level": "cross_level",
    "elevation": "cross_level",
    "twist": "twist",
    "warp": "twist",
}
"""The quantity whose verdict holds for each parameter of a limit: of differences of cross-level that of twist, as a
constant error is in neither. The gauge has none.
"""


def judge(
    result: Result, limits: Iterable[Limit], line_speed_kmh: float | None = None, *, km: bool | None = False
) -> Judgement:
    """Return where the geometry of a result exceeds limits, and which limits it does not suffice for.

    What was found has a column ``trusted`` too: false where the verdict says that the quantity is not to be.
    ``line_speed_kmh`` is the speed that the line is limited for, not that of the run. With ``km`` the official place of
    each exceedance is beside its chainage; with None, where the line has a kilometrage. Raises ``BadInputError`` for a
    result without geometry, and where limits depend on the line's speed and it is None.
    """
    geometry = result.geometry_for("limits")
    conventions = result.summary.geometry
    line = shown_kilometrage(result, km)
    kilometrage = None if line is None else line.kilometrage()
    applying = at_line_speed(limits, line_speed_kmh)
    lengths = ColumnLengths(
        Band(*conventions.band_m), conventions.chord_m, conventions.twist_base_m, conventions.twist_anchor
    )
    geometry = without_holes(geometry, conventions.step_m)
    if result.summary.solver is not None:  # of a table of another system the responses are not known
        if any(limit.band in ("D2", "D3") for limit in applying):
            geometry = with_long_bands(geometry, conventions.step_m, conventions.chord_m)
        chords = sorted({limit.chord_m for limit in applying if limit.chord_m} - {conventions.chord_m})
        geometry = with_further_chords(geometry, conventions.step_m, lengths.band, conventions.chord_m, chords)
    judgement = exceedances(
        geometry,
        applying,
        speed_kmh=np.nan if line_speed_kmh is None else line_speed_kmh,
        gauge_m=conventions.gauge_m,
        lengths=lengths,
    )
    doubted = {name for name, of in _QUANTITIES.items() if not math.isfinite(widening(result.summary.verdicts, of))}
    table = judgement.found.assign(trusted=~judgement.found["parameter"].isin(doubted))
    return replace(judgement, found=with_km(table, kilometrage))


def doubt_about(result: Result) -> str:
    """Return in words which quantities of track geometry are not to be trusted; nothing where all are."""
    judged = set(_QUANTITIES.values())
    names = untrusted(verdict for verdict in result.summary.verdicts if verdict.quantity in judged)
    return f"{NOT_TRUSTED} in this run: {names}" if names else ""


def write_exceedances(judgement: Judgement, path: Path) -> None:
    """Write the exceedances as CSV, in one step. Raises ``OutputError`` where the file cannot be written."""
    write_whole(path, judgement.found.to_csv(index=False).encode("utf-8"))


def without_holes(geometry: pd.DataFrame, step_m: float) -> pd.DataFrame:
    """Return the table with a row at every step: NaN where the run did not pass."""
    cells = cells_of(geometry, step_m)
    every = np.arange(cells[0], cells[-1] + 1)
    if len(every) == len(cells):
        return geometry
    table = geometry.set_index(cells).reindex(every).reset_index(drop=True)
    return table.assign(chainage_m=every * step_m)
