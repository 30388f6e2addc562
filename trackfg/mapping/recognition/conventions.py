"""A smoothed run laid over a map: what both must mean alike, and the way from the run's chainage to the map's."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
from trackfg.mapping.recognition.recognition import Recognition, recognise
from trackfg.results.result import Result
from trackfg.results.summary import GeometryConventions

if TYPE_CHECKING:
    from trackfg.maps.feature_map import MapConventions

_SCALE_SD_WITHOUT_WHEEL = 1e-3


def check_conventions(meaning: GeometryConventions, conventions: MapConventions, run: str) -> None:
    """Raise :class:`~trackfg.errors.BadInputError` where the columns of run and map mean something else."""
    for name, theirs in vars(conventions).items():
        ours = getattr(meaning, name)
        if abs(ours - theirs) > 1e-9:
            raise BadInputError(f"run {run}: {name} is {ours:g}; expected that of the map, {theirs:g}")


def laid_over(result: Result, grid: pd.DataFrame, map_sd_m: float | None) -> Recognition:
    """A run recognised on a grid; its ``warp`` is the way from the run's chainage to the grid's.

    ``map_sd_m``: how well the grid's chainage is known; None where run and grid do not count from the same place.
    """
    wheel, facts = result.summary.wheel_scale, result.summary.run
    return recognised_near(
        result.geometry,
        grid,
        map_sd_m,
        rate_sd=_SCALE_SD_WITHOUT_WHEEL if wheel is None else wheel.sd,
        direction=1 if facts is None else facts.direction,
    )


def recognised_near(
    run: pd.DataFrame, grid: pd.DataFrame, grid_sd_m: float | None, *, rate_sd: float, direction: int
) -> Recognition:
    """A geometry table recognised about where its own chainage says, to the sigmas of both; anywhere where
    ``grid_sd_m``, how well the grid's chainage is known, is None.
    """
    place_sd = None if grid_sd_m is None else np.hypot(run["chainage_m_sd"].to_numpy(), grid_sd_m)
    return recognise(run, grid, place_sd_m=place_sd, rate_sd=rate_sd, direction=direction)
