"""The strip charts name curves, fixes, stations and events along their axis."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
import pandas as pd

from trackfg.curves import Curve
from trackfg.report.charts import ChartPlace, PlaceKind, PlaceRow
from trackfg.report.numbers import digits
from trackfg.results.result import Result

_EVENTS: Mapping[str, PlaceKind] = {
    "fix used": "fix",
    "fix set aside": "fix",
    "standstill": "standstill",
    "slip": "slip",
    "slide": "slip",
    "imu gap": "gap",
    "tach gap": "gap",
}
"""How an event is marked; others are marked alike."""


def place_rows(
    result: Result,
    curves: Sequence[Curve],
    stations: Iterable[tuple[str, float]],
    exceeded: Sequence[ChartPlace],
    scale: float,
) -> tuple[PlaceRow, ...]:
    """Return the rows that are not empty. ``stations`` are names and chainages, m; ``exceeded`` is where limits are;
    ``scale`` brings metres to the axis.
    """
    chainage = result.geometry["chainage_m"]
    low, high = float(chainage.min()), float(chainage.max())
    events = list(_events(result.events, result.trajectory))
    rows = (
        ("curves", [_curve(curve, low, high) for curve in curves]),
        ("stations", [ChartPlace(x, x, name, "station") for name, x in stations if low <= x <= high]),
        ("fixes", [place for place in events if place.kind == "fix"]),
        ("events", [place for place in events if place.kind != "fix"]),
        ("limits", exceeded),
    )
    return tuple(
        PlaceRow(name, tuple(ChartPlace(scale * p.start, scale * p.end, p.text, p.kind) for p in places))
        for name, places in rows
        if places
    )


def _curve(curve: Curve, low: float, high: float) -> ChartPlace:
    ends = (curve.btc_m, low), (curve.etc_m, high)
    start, end = (x if math.isfinite(x) else edge for x, edge in ends)
    cant = f", cant {curve.cant_mm:.0f} mm" if math.isfinite(curve.cant_mm) else ""
    return ChartPlace(start, end, f"{curve.id}: R {curve.radius_m:.0f} {curve.sense}{cant}", curve.sense)


def _events(events: pd.DataFrame, trajectory: pd.DataFrame) -> Iterator[ChartPlace]:
    """Yield the events that have a place; one that lasts goes to where the vehicle was at its end."""
    if trajectory.empty:
        return
    t, chainage = trajectory["t_s"].to_numpy(), trajectory["chainage_m"].to_numpy()
    rows = events[np.isfinite(events["chainage_m"].to_numpy(dtype=np.float64))]
    for event in rows.to_dict("records"):
        at = float(event["chainage_m"])
        until = float(np.interp(event["end_s"], t, chainage)) if np.isfinite(event["end_s"]) else at
        detail = f", {event['detail']}" if event["detail"] else ""
        when = f" at {digits(event['start_s'], 4)} s" if np.isfinite(event["start_s"]) else ""
        kind = _EVENTS.get(str(event["kind"]), "other")
        start, end = (at, at) if kind in ("fix", "standstill") else sorted((at, until))
        yield ChartPlace(start, end, f"{event['kind']}{when}{detail}", kind)
