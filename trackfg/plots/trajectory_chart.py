"""One picture of a run over time: the path, speed, attitude and how sure the position is."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from trackfg.evaluation.outages import horizontal_errors, withhold
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import Span
from trackfg.numerics.units import KMH
from trackfg.plots.decimation import extremes
from trackfg.plots.draw import drawn
from trackfg.plots.geometry_channels import label_of
from trackfg.plots.sheet import AMBER, BAND, BLUE, ORANGE, RED, SPAN_NAME, Panel, Path2d, Sheet, SheetCurve
from trackfg.results.result import Result, expect_result

STRETCHES = 400
"""Stretches whose extremes a curve is drawn by. Chosen for the size of the picture."""


def plot_trajectory(
    result: Result,
    path: str | os.PathLike[str] | None = None,
    *,
    reference: pd.DataFrame | None = None,
    title: str | None = None,
    highlight: Sequence[Span] = (),
) -> Any:
    """Draw the path of a result, and over time its speed, attitude and sigmas, with bands of 95 % (1.96 sigma).

    Parameters
    ----------
    result
        With a trajectory.
    path
        The picture, by its suffix: ``.png``, ``.svg`` or, opened without a network, ``.html``; none for a figure.
    reference
        Positions to compare with: ``t_s`` in s, ``east_m`` and ``north_m`` of the vehicle reference point in m.
    title
        Above the picture; the recording's id unless given.
    highlight
        Spans, s, in which positions were withheld: they are shaded, and the map then shows the reference in them only.

    Returns
    -------
    pathlib.Path or plotly.graph_objects.Figure
        The picture; without a path a figure, which a notebook shows.

    Raises
    ------
    BadInputError
        For another suffix.

    Examples
    --------
    >>> import trackfg
    >>> trackfg.plot_trajectory(trackfg.Result.read("out1"), "path.svg", title="Main line").name
    'path.svg'
    """
    expect_result(result, "plot_trajectory")
    return drawn(sheet_of(result, reference, title or result.summary.recording_id, tuple(highlight)), path)


def sheet_of(result: Result, reference: pd.DataFrame | None, title: str, spans: tuple[Span, ...]) -> Sheet:
    """Return what :func:`plot_trajectory` draws, in the units of its labels and thinned."""
    table = result.trajectory
    t = table["t_s"].to_numpy()

    def banded(name: str, unit: str, column: str, scale: float, colour: str) -> SheetCurve:
        y = scale * table[column].to_numpy()
        keep = extremes(y, STRETCHES)
        name = label_of(name, column, result.summary.verdicts).replace("\n", " ")
        return SheetCurve(name, unit, t[keep], y[keep], colour, BAND * scale * table[f"{column}_sd"].to_numpy()[keep])

    def in_metres(name: str, y: Array, colour: str) -> SheetCurve:
        keep = extremes(y, STRETCHES)
        return SheetCurve(name, "m", t[keep], y[keep], colour)

    certainty = [
        in_metres("1 sigma horizontal", np.hypot(table["east_m_sd"].to_numpy(), table["north_m_sd"].to_numpy()), BLUE),
        in_metres("1 sigma along the track", table["chainage_m_sd"].to_numpy(), ORANGE),
    ]
    if reference is not None:
        errors = horizontal_errors(table, reference)
        error = errors["error_m"].to_numpy()
        keep = extremes(error, STRETCHES)
        at = errors["t_s"].to_numpy()[keep]
        certainty.append(SheetCurve("horizontal error", "m", at, error[keep], RED, dots=True))
    degree = 180.0 / np.pi
    return Sheet(
        title=title,
        paths=tuple(_paths(table, reference, spans)),
        panels=(
            Panel("speed, km/h", (banded("speed", "km/h", "speed_mps", 1.0 / KMH, BLUE),)),
            Panel(
                "attitude, deg",
                (banded("roll", "deg", "roll_rad", degree, BLUE), banded("pitch", "deg", "pitch_rad", degree, ORANGE)),
            ),
            Panel("position error, m", tuple(certainty), log=True),
        ),
        x_label="time, s",
        x_range=(float(t[0]), float(t[-1])),
        spans=spans,
    )


def _paths(table: pd.DataFrame, reference: pd.DataFrame | None, spans: tuple[Span, ...]) -> Iterator[Path2d]:
    yield _path("trajectory", table, BLUE)
    for start, end in spans:
        yield _path(SPAN_NAME, table[table["t_s"].between(start, end)], AMBER)
    if reference is not None:
        _, shown = withhold(reference, spans) if spans else (None, reference)
        yield replace(_path("reference", shown, RED), dots=True)


def _path(name: str, table: pd.DataFrame, colour: str) -> Path2d:
    east, north = table["east_m"].to_numpy(), table["north_m"].to_numpy()
    keep = np.union1d(extremes(east, STRETCHES), extremes(north, STRETCHES))
    return Path2d(name, east[keep], north[keep], colour)
