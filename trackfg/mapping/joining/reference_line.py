"""The centre line of a map as vertices in east, north, up, every :data:`VERTEX_M`.

Positions of runs with GNSS at one chainage are averaged by inverse variances, in the frame of the first of them.
Without any, the line is the shape that the map's curvature and gradient draw, from the origin eastwards: a picture in a
frame of no known place, without sigmas.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from trackfg.mapping.recognition.warp import Warp
from trackfg.maps.feature_map import LINE_COLUMNS
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.chainage_grid import multiples_between
from trackfg.numerics.geodesy import enu_to_geodetic, geodetic_to_enu

VERTEX_M = 5.0
"""Distance of the vertices, m."""

_AXES = ("east_m", "north_m", "up_m")
Origin = tuple[float, float, float]


def positions_of_run(trajectory: pd.DataFrame, to_map: Warp, run_origin: Origin, origin: Origin) -> pd.DataFrame:
    """Return where a run with GNSS passed the multiples of the vertices' distance, in the frame at ``origin``.

    Columns :data:`trackfg.maps.feature_map.LINE_COLUMNS`. Of places passed more than once, the first pass counts.
    """
    place = to_map(trajectory["chainage_m"].to_numpy())
    order = np.argsort(place, kind="stable")
    place, first = np.unique(place[order], return_index=True)
    rows = trajectory.iloc[order[first]]
    vertices = multiples_between(place[0], place[-1], VERTEX_M)
    positions = np.column_stack([np.interp(vertices, place, rows[axis]) for axis in _AXES])
    if run_origin != origin:
        positions = geodetic_to_enu(enu_to_geodetic(positions, run_origin), np.array(origin))
    columns: dict[str, Array] = {"chainage_m": vertices}
    for i, axis in enumerate(_AXES):
        columns[axis], columns[f"{axis}_sd"] = positions[:, i], np.interp(vertices, place, rows[f"{axis}_sd"])
    return pd.DataFrame(columns, columns=list(LINE_COLUMNS))


def with_positions(line: pd.DataFrame, more: pd.DataFrame) -> pd.DataFrame:
    """Return the vertices of both lines, those in common averaged."""
    both = pd.concat([line, more]).dropna()
    weights = {axis: both[f"{axis}_sd"] ** -2.0 for axis in _AXES}
    sums = pd.DataFrame({"chainage_m": both["chainage_m"].round(6)})
    for axis, weight in weights.items():
        sums[axis], sums[f"{axis}_sd"] = weight * both[axis], weight
    sums = sums.groupby("chainage_m").sum()
    for axis in _AXES:
        sums[axis] /= sums[f"{axis}_sd"]
        sums[f"{axis}_sd"] **= -0.5
    return sums.reset_index()[list(LINE_COLUMNS)]


def moved_line(line: pd.DataFrame, warp: Warp) -> pd.DataFrame:
    """Return the same points by other chainages, brought back to multiples of the vertices' distance."""
    place = warp(line["chainage_m"].to_numpy())
    vertices = multiples_between(place[0], place[-1], VERTEX_M)
    columns = {name: np.interp(vertices, place, line[name]) for name in LINE_COLUMNS[1:]}
    return pd.DataFrame({"chainage_m": vertices, **columns})


def positions_on(line: pd.DataFrame, chainage: Array) -> tuple[Array, Array]:
    """Return east, north, up at places (n,) of a line, and their sigmas. Each (n, 3)."""
    along = line["chainage_m"].to_numpy()
    values, sigmas = (
        np.column_stack([np.interp(chainage, along, line[f"{axis}{suffix}"]) for axis in _AXES])
        for suffix in ("", "_sd")
    )
    return values, sigmas


def drawn_line(grid: pd.DataFrame) -> pd.DataFrame:
    """Return the line that curvature and gradient draw; where they are not known it goes straight and level on."""
    x = grid["chainage_m"].to_numpy()
    step = np.diff(x, prepend=x[0])
    curvature, slope = (np.nan_to_num(grid[name].to_numpy()) for name in ("curvature_1pm", "gradient_permille"))
    heading = np.cumsum(curvature * step)
    ways = (np.cos(heading), np.sin(heading), 1e-3 * slope)
    vertices = multiples_between(x[0], x[-1], VERTEX_M)
    columns: dict[str, Array] = {"chainage_m": vertices}
    for axis, way in zip(_AXES, ways, strict=True):
        columns[axis] = np.interp(vertices, x, np.cumsum(way * step))
        columns[f"{axis}_sd"] = np.full(len(vertices), np.nan)
    return pd.DataFrame(columns, columns=list(LINE_COLUMNS))
