"""One picture of a result: the path, speed, attitude and how sure the position is.

:func:`plot_trajectory` prepares the panels once; :mod:`trackfg.plot_picture` draws them as PNG or SVG,
:mod:`trackfg.plot_page` as a page that needs no network. Bands are 95 % (1.96 sigma). Long runs are thinned to what the
eye can see: every curve keeps the extremes of each of a fixed number of stretches, so no peak is lost.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from trackfg.errors import BadInputError
from trackfg.evaluate import Span, horizontal_errors, withhold
from trackfg.frames import Array
from trackfg.plot_sheet import AMBER, BLUE, ORANGE, RED, SPAN_NAME, Curve, Panel, Path2d, Sheet
from trackfg.results import Result
from trackfg.units import KMH

BAND = 1.96
"""Half-width of a band in sigmas: 95 % of a normal distribution."""

STRETCHES = 400


def plot_trajectory(
    result: Result,
    path: str | os.PathLike[str],
    *,
    reference: pd.DataFrame | None = None,
    title: str | None = None,
    highlight: Sequence[Span] = (),
) -> Path:
    """Draw ``result`` into ``path``: ``.png``, ``.svg`` or ``.html`` by its suffix.

    ``reference`` (``t_s, east_m, north_m`` of the vehicle reference point) is what the position is compared with.
    ``highlight`` holds the spans in which positions were withheld: they are shaded, and the map then shows the
    reference in them only. Raises :class:`BadInputError` for
    another suffix.
    """
    path = Path(path)
    if path.suffix not in (".png", ".svg", ".html"):
        raise BadInputError(f"{path}: expected a file that ends in .png, .svg or .html")
    sheet = sheet_of(result, reference, title or result.summary.recording_id, tuple(highlight))
    if path.suffix == ".html":
        from trackfg import plot_page

        plot_page.write(sheet, path)
    else:
        from trackfg import plot_picture

        plot_picture.write(sheet, path)
    return path


def extremes(values: Array, stretches: int = STRETCHES) -> NDArray[np.intp]:
    """Indices, sorted, of the least and the greatest of each of ``stretches`` equal stretches, and of both ends."""
    n = len(values)
    if n <= 2 * stretches:
        return np.arange(n)
    edges = np.linspace(0, n, stretches + 1).astype(int)[:-1]
    order = np.lexsort((values, np.searchsorted(edges, np.arange(n), side="right")))
    last = np.append(edges[1:], n) - 1
    return np.unique(np.concatenate([[0, n - 1], order[edges], order[last]]))


def sheet_of(result: Result, reference: pd.DataFrame | None, title: str, spans: tuple[Span, ...]) -> Sheet:
    """What :func:`plot_trajectory` draws, in the units of its labels and thinned."""
    table = result.trajectory
    t = table["t_s"].to_numpy()

    def banded(name: str, column: str, scale: float, colour: str) -> Curve:
        y = scale * table[column].to_numpy()
        keep = extremes(y)
        return Curve(name, t[keep], y[keep], colour, BAND * scale * table[f"{column}_sd"].to_numpy()[keep])

    def plain(name: str, y: Array, colour: str) -> Curve:
        keep = extremes(y)
        return Curve(name, t[keep], y[keep], colour)

    certainty = [
        plain("1 sigma horizontal", np.hypot(table["east_m_sd"].to_numpy(), table["north_m_sd"].to_numpy()), BLUE),
        plain("1 sigma along the track", table["chainage_m_sd"].to_numpy(), ORANGE),
    ]
    if reference is not None:
        errors = horizontal_errors(table, reference)
        error = errors["error_m"].to_numpy()
        keep = extremes(error)
        certainty.append(Curve("horizontal error", errors["t_s"].to_numpy()[keep], error[keep], RED, dots=True))
    degree = 180.0 / np.pi
    return Sheet(
        title=title,
        paths=tuple(_paths(table, reference, spans)),
        panels=(
            Panel("speed, km/h", (banded("speed", "speed_mps", 1.0 / KMH, BLUE),)),
            Panel(
                "attitude, deg",
                (banded("roll", "roll_rad", degree, BLUE), banded("pitch", "pitch_rad", degree, ORANGE)),
            ),
            Panel("position error, m", tuple(certainty), log=True),
        ),
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
    keep = np.union1d(extremes(east), extremes(north))
    return Path2d(name, east[keep], north[keep], colour)
