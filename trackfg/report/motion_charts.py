"""The charts of the motion show speed, attitude and sigmas over time, and the path on a map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from trackfg.numerics.arrays import Array
from trackfg.numerics.units import KMH
from trackfg.plots.decimation import extremes
from trackfg.plots.geometry_channels import label_of
from trackfg.plots.scales import extent, with_margin
from trackfg.plots.sheet import AMBER, BLUE, GREY, ORANGE, RED
from trackfg.report.charts import (
    GRID,
    ON_MAP,
    TRUTH_COLOUR,
    ChartLine,
    ChartPanel,
    Figure,
    Span,
    Strips,
    labelled_points,
    listed,
    whole_range,
)
from trackfg.report.columns import packed, packed_sigma, packed_value
from trackfg.report.geometry_charts import error_range
from trackfg.results.result import Result

_DEGREE = 180.0 / np.pi
"""From rad to degrees."""
_BANDED = (
    ("speed", "km/h", "speed_mps", 1.0 / KMH, 1.0),
    ("roll", "deg", "roll_rad", _DEGREE, 0.05),
    ("pitch", "deg", "pitch_rad", _DEGREE, 0.05),
)
"""Label, unit, column, scale, and half of what the axis spans at least."""

_SHADES = {"standstill": GREY, "slip": AMBER, "slide": ORANGE, "imu gap": RED, "tach gap": RED}
SHADES = "Shaded: standstills grey, slips and slides amber, gaps of a sensor red."
_INSTANT = 1e-3
"""Accuracy of the time in the page, s."""
_MAP_STRETCHES = 1500
"""Stretches whose extremes the path is drawn by: more than its chart has pixels."""
_AIR = 0.06
"""Room around the path on the map, as a share of its greatest extent."""
_BEHIND, _MARK = "#8a96a3", "#7a3e9d"
"""Colours of a background and of marks with ids."""
_POSTS = 10
"""Chainages along the path, about."""
_ERRORS = {
    "along_track_m": ("place along\nthe track", "m"),
    "speed_kmh": ("speed", "km/h"),
    "roll_mrad": ("roll", "mrad"),
    "pitch_mrad": ("pitch", "mrad"),
    "east_m": ("east", "m"),
    "north_m": ("north", "m"),
}
"""Columns of :func:`trackfg.evaluation.trajectory_errors.trajectory_errors`: label and unit."""


def motion_strips(result: Result) -> Strips:
    """Draw speed and attitude with bands, heading, and the sigmas of the position."""
    table, verdicts = result.trajectory, result.summary.verdicts
    t = table["t_s"].to_numpy()
    x = packed(t, _INSTANT)
    panels = []
    for name, unit, column, scale, least in _BANDED:
        values, sigmas = scale * table[column].to_numpy(), scale * table[f"{column}_sd"].to_numpy()
        line = ChartLine(name, BLUE, x, packed_value(values, sigmas), packed_sigma(sigmas))
        label = label_of(name, column, verdicts)
        panels.append(ChartPanel(label, unit, (line,), with_margin(*extent(values, sigmas, 0.0, least)), base=0.0))
    yaw = _DEGREE * np.unwrap(table["yaw_rad"].to_numpy())
    label = label_of("yaw\nunwrapped", "yaw_rad", verdicts)
    panels.append(ChartPanel(label, "deg", (ChartLine("yaw", BLUE, x, packed_value(yaw)),), _whole(yaw)))
    across = np.hypot(table["east_m_sd"].to_numpy(), table["north_m_sd"].to_numpy())
    for label, column, name, sigmas in (
        ("chainage\n1 sigma", "chainage_m", "chainage", table["chainage_m_sd"].to_numpy()),
        ("horizontal position\n1 sigma", "east_m", "position", across),
    ):
        line = ChartLine(name, ORANGE, x, packed_value(sigmas))
        panels.append(ChartPanel(label_of(label, column, verdicts), "m", (line,), _whole(sigmas, 0.0)))
    return Strips("time, s", "s", whole_range(t), tuple(panels), spans=_spans(result.events))


def error_strips(errors: pd.DataFrame, events: pd.DataFrame) -> Strips | None:
    """Draw errors of the trajectory over time about their bands; None where the truth says nothing of it."""
    t = errors["t_s"].to_numpy()
    x = packed(t, _INSTANT)
    panels = []
    for column, (label, unit) in _ERRORS.items():
        if column in errors and np.isfinite(errors[column]).any():
            error, sigmas = errors[column].to_numpy(), errors[f"{column}_sd"].to_numpy()
            line = ChartLine(label, BLUE, x, packed_value(error, sigmas), packed_sigma(sigmas), band_about_zero=True)
            panels.append(ChartPanel(label, unit, (line,), error_range(error, sigmas), base=0.0, share=0.8))
    if not panels:
        return None
    return Strips("time, s", "s", whole_range(t), tuple(panels), spans=_spans(events))


@dataclass(frozen=True)
class PathMark:
    """A mark of what has an id along the path: its kind, its id and its chainage, m."""

    kind: str
    id: str
    chainage_m: float


def path_map(
    result: Result,
    truth: pd.DataFrame | None,
    marks: Sequence[PathMark] = (),
    lines: Sequence[Array] = (),
    named: Sequence[tuple[str, float, float]] = (),
) -> Figure:
    """Draw the path, with equal scales to the east and north, chainages along it, the events, and ``marks``.

    Behind it lie the ``lines`` (n, 2) and ``named`` points (name, east, north) of a background, m, as far as they are
    near.
    """
    table = result.trajectory
    frame = _frame(table)
    traces = [*_background_lines(lines, frame), *_background_points(named, frame)]
    if truth is not None and {"east_m", "north_m"} <= set(truth):
        traces.append(_path("truth", truth, TRUTH_COLOUR, 5.0))
    traces.append(_path("trajectory", table, BLUE, 1.8))
    rows, posts = _posts(table["chainage_m"].to_numpy())
    at = table.iloc[rows]
    traces.append(
        {
            "type": "scatter",
            "mode": "markers+text",
            "name": "chainage",
            "x": listed(at["east_m"], 3),
            "y": listed(at["north_m"], 3),
            "text": posts,
            "textposition": "top right",
            "textfont": {"size": 11, "color": GREY},
            "marker": {"color": "#fff", "size": 7, "line": {"color": BLUE, "width": 1.5}},
            "hoverinfo": "skip",
            "showlegend": False,
        }
    )
    traces += [*_event_markers(result), *_mark_traces(marks, table)]
    axis = {"gridcolor": GRID, "zeroline": False, "exponentformat": "none", "separatethousands": True}
    return Figure(
        tuple(traces),
        {
            "xaxis": {**axis, "title": {"text": "east, m"}, "range": list(frame[0])},
            "yaxis": {
                **axis,
                "title": {"text": "north, m"},
                "scaleanchor": "x",
                "scaleratio": 1,
                "range": list(frame[1]),
            },
            "margin": {"l": 80, "r": 20, "t": 36, "b": 50},
            "legend": {"orientation": "h", "x": 0, "y": 1, "yanchor": "bottom"},
            "showlegend": True,
            "hovermode": "closest",
        },
        height=560,
        alternative=_path_in_words(table),
    )


def _frame(table: pd.DataFrame) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the extent of the path to the east and north with some air, at least a metre."""
    sides = (table[name].to_numpy() for name in ("east_m", "north_m"))
    ends = [(float(np.nanmin(side)), float(np.nanmax(side))) for side in sides]
    air = max(_AIR * max(high - low for low, high in ends), 1.0)
    (west, east), (south, north) = ends
    return (west - air, east + air), (south - air, north + air)


def _background_lines(lines: Sequence[Array], frame: tuple[tuple[float, float], ...]) -> list[dict[str, object]]:
    """Return one trace of the lines that come near the path."""
    (west, east), (south, north) = frame
    x: list[float | None] = []
    y: list[float | None] = []
    for line in lines:
        (x0, y0), (x1, y1) = line.min(axis=0), line.max(axis=0)
        if x0 <= east and x1 >= west and y0 <= north and y1 >= south:
            x += [*np.round(line[:, 0], 1).tolist(), None]
            y += [*np.round(line[:, 1], 1).tolist(), None]
    if not x:
        return []
    style = {"color": _BEHIND, "width": 1}
    return [
        {"type": "scatter", "mode": "lines", "name": "background", "x": x, "y": y, "line": style, "hoverinfo": "skip"}
    ]


def _background_points(
    named: Sequence[tuple[str, float, float]], frame: tuple[tuple[float, float], ...]
) -> list[dict[str, object]]:
    (west, east), (south, north) = frame
    near = [(name, x, y) for name, x, y in named if west <= x <= east and south <= y <= north]
    if not near:
        return []
    marker = {"color": GREY, "size": 7, "symbol": "diamond"}
    return [labelled_points("stations", near, marker)]


def _mark_traces(marks: Sequence[PathMark], table: pd.DataFrame) -> list[dict[str, object]]:
    """Return a trace of each kind of mark, its ids beside it, where the path first passes its chainage."""
    chainage, first = np.unique(table["chainage_m"].to_numpy(), return_index=True)
    east, north = (table[name].to_numpy()[first] for name in ("east_m", "north_m"))
    traces, marker = [], {"color": "#fff", "size": 7, "line": {"color": _MARK, "width": 1.5}}
    for kind in dict.fromkeys(mark.kind for mark in marks):
        of_kind = [mark for mark in marks if mark.kind == kind]
        at = np.array([mark.chainage_m for mark in of_kind])
        places = zip(np.interp(at, chainage, east).tolist(), np.interp(at, chainage, north).tolist(), strict=True)
        texts = [(mark.id, x, y) for mark, (x, y) in zip(of_kind, places, strict=True)]
        traces.append(labelled_points(kind, texts, marker))
    return traces


def _path_in_words(table: pd.DataFrame) -> str:
    east, north = table["east_m"].to_numpy(), table["north_m"].to_numpy()
    ends = ", ".join(
        f"{what} {np.ptp(axis):.0f} m" for what, axis in (("east to west", east), ("north to south", north))
    )
    return (
        f"Map of the path: {ends} wide, from ({east[0]:.0f}, {north[0]:.0f}) to ({east[-1]:.0f}, {north[-1]:.0f}) m "
        "east and north, with chainages along it and the events."
    )


def _whole(values: Array, least: float = np.inf) -> tuple[float, float]:
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return (0.0, 1.0)
    low, high = min(float(finite.min()), least), float(finite.max())
    return with_margin(low, high) if high > low else (low - 1.0, high + 1.0)


def _spans(events: pd.DataFrame) -> tuple[Span, ...]:
    return tuple(
        Span(event["start_s"], event["end_s"], _SHADES[event["kind"]])
        for event in events.to_dict("records")
        if event["kind"] in _SHADES and event["end_s"] > event["start_s"]
    )


def _posts(chainage_m: Array) -> tuple[NDArray[np.intp], list[str]]:
    """Return rows at which a round chainage is passed first, about ten of them, and its text."""
    low, high = float(chainage_m.min()), float(chainage_m.max())
    rough = max(high - low, 1.0) / _POSTS
    decade = 10.0 ** np.floor(np.log10(rough))
    step = decade * next(size for size in (1.0, 2.0, 5.0, 10.0) if size * decade >= rough)
    _, rows = np.unique(np.floor(chainage_m / step), return_index=True)
    rows = np.sort(rows)[1:]  # the first is where the run began
    return rows, [f"{step * round(chainage / step) / 1000.0:.6g} km" for chainage in chainage_m[rows]]


def _path(name: str, table: pd.DataFrame, colour: str, width: float) -> dict[str, object]:
    east, north = table["east_m"].to_numpy(), table["north_m"].to_numpy()
    keep = np.union1d(extremes(east, _MAP_STRETCHES), extremes(north, _MAP_STRETCHES))
    return {
        "type": "scatter",
        "mode": "lines",
        "name": name,
        "x": listed(east[keep], 3),
        "y": listed(north[keep], 3),
        "customdata": listed(table["chainage_m"].iloc[keep] / 1000.0, 4) if "chainage_m" in table else None,
        "hovertemplate": f"chainage %{{customdata:.3f}} km<br>{ON_MAP}<extra></extra>",
        "line": {"color": colour, "width": width},
    }


def _marker(kind: str) -> dict[str, object]:
    """Return how an event is marked: a position that was not used stands out among those that were."""
    if kind.endswith("set aside"):
        return {"size": 9, "symbol": "x", "color": RED}
    return {"size": 8, "symbol": "square", "color": _SHADES.get(kind, "#2f855a")}


def _event_markers(result: Result) -> list[dict[str, object]]:
    t = result.trajectory["t_s"].to_numpy()
    traces: list[dict[str, object]] = []
    for kind, events in result.events.groupby("kind", sort=False):
        rows = result.trajectory.iloc[np.clip(np.searchsorted(t, events["start_s"].to_numpy()), 0, len(t) - 1)]
        times = [f"{start:.1f} s" for start in events["start_s"]]
        at = zip(times, rows["east_m"], rows["north_m"], strict=True)
        traces.append(labelled_points(str(kind), at, _marker(str(kind))) | {"mode": "markers"})
    return traces
