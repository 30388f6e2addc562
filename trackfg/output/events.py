"""Events of a run: rests, holes in the records, wheel slip and slide, positions used and set aside."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family
from trackfg.factors.states import Kind, States
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import true_runs
from trackfg.output.event_sources import EventSources
from trackfg.output.slip_events import Excess, slip_events, wheel_excess
from trackfg.results.columns import EVENT_COLUMNS
from trackfg.results.events import Event, events_frame
from trackfg.solver.covariance import Covariance

POSITIONS = (
    FactorType.ABSOLUTE_FIX,
    FactorType.WITHHELD_FIX,
    FactorType.LANDMARK,
    FactorType.GNSS_POSITION,
)
"""Families whose measurements are reported one by one, or as runs of outliers."""

REPORTED_TYPES = (FactorType.TACH_DISTANCE, *POSITIONS)
"""The types of all families that events report; none of them has a label."""

_OUTLIER_WEIGHT = 0.5
"""A robust weight below this marks a measurement that the solution does not follow."""


EVENT_TABLES = {
    "standstill": "imu",
    "imu gap": "imu",
    "tach gap": "tach",
    "slip": "tach",
    "slide": "tach",
    "fix used": "fixes",
    "fix set aside": "fixes",
    "gnss set aside": "gnss",
}
"""The table that an event of each kind concerns; a map is none."""


def event_table(
    sources: EventSources,
    states: States,
    covariance: Covariance,
    trajectory: pd.DataFrame,
    further: Sequence[Event] = (),
) -> pd.DataFrame:
    """Return a table of these events, and of ``further`` ones, in order of their start.

    Its columns are :data:`trackfg.results.columns.EVENT_COLUMNS`.
    """
    rows = [*events(sources, states, covariance, wheel_excess(sources, states, trajectory)), *further]
    table = events_frame(sorted(rows, key=lambda event: event.span_s[0]))
    return table.rename(columns={"t_s": "start_s", "until_s": "end_s"})[list(EVENT_COLUMNS)]


def events(sources: EventSources, states: States, covariance: Covariance, excess: Excess | None) -> list[Event]:
    """Return the events in order of their start; slips and slides over the span of the wheel's ``excess``."""
    sd = np.sqrt(covariance.of(Kind.ODO)[:, 0, 0])

    def row(kind: str, start: float, end: float, detail: str = "", removed: Sequence[float] = ()) -> Event:
        chainage = sources.direction * np.interp(start, sources.t, states.odo.distance)
        chainage_sd = np.interp(start, sources.t, sd)
        table = EVENT_TABLES.get(kind, "")
        return Event(kind, table, float(start), float(end), 0, detail, float(chainage), float(chainage_sd), *removed)

    rows = [row("standstill", start, end) for start, end in sources.rests]
    rows += [row("imu gap", start, end, "bridged with interpolated samples") for start, end in sources.gaps]
    if sources.wheel is not None:
        rows += [row("tach gap", start, end) for start, end in sources.wheel.gaps]
    for event in slip_events(sources, states, covariance, excess):
        removed = (event.removed_m, event.removed_m_sd)
        rows.append(row("slip" if removed[0] > 0 else "slide", event.start_s, event.end_s, removed=removed))
    for kind in POSITIONS:
        family = sources.family(kind)
        if family is not None:
            rows += _positions(sources, family, states, row)
    return sorted(rows, key=lambda event: event.span_s[0])


def _positions(sources: EventSources, family: Family, states: States, row: Callable[..., Event]) -> list[Event]:
    """Return fixes one by one, and GNSS as runs of outliers, since a row per epoch would bury the rest."""
    t = sources.t[family.slots[0].index]
    size = np.linalg.norm(family.residual(states), axis=1)
    if family.type is FactorType.GNSS_POSITION and len(family):
        family = _usual(family, sources.usual_gnss)
    outlier = family.weights(states) < _OUTLIER_WEIGHT
    if family.type is not FactorType.GNSS_POSITION:
        what = "landmark" if family.type is FactorType.LANDMARK else "fix"
        return [
            row(f"{what} set aside" if bad else f"{what} used", at, at, f"residual {r:.2f} m")
            for at, r, bad in zip(t, size, outlier, strict=True)
        ]
    return [
        row("gnss set aside", t[i], t[j - 1], f"{j - i} positions, residual up to {size[i:j].max():.1f} m")
        for i, j in true_runs(outlier)
    ]


def _usual(gnss: Family, usual: Array | None) -> Family:
    """Return GNSS positions with sigmas no wider than usual: where a whole group of them is off, its sigma is widened
    until none of it looks like an outlier any more.
    """
    declared = gnss.data["declared"]
    factor = gnss.sigma / declared
    return gnss.with_sigma(declared * np.minimum(factor, np.median(factor, axis=0) if usual is None else usual))
