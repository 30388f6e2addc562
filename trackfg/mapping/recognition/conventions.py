"""A smoothed run on a map: the check that both mean the same, and the recognition of the one on the other."""

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

_OF_THE_TRACK = ("gauge_m", "cross_level_base_m")
"""Conventions that the recording states; settings have the others."""

_SCALE_SD_WITHOUT_WHEEL = 1e-3
"""Prior sigma of the scale of a chainage without a wheel, relative. Chosen; see Assumptions in docs/engine.md."""


def check_conventions(meaning: GeometryConventions, conventions: MapConventions, run: str) -> None:
    """Raise :class:`~trackfg.errors.BadInputError` where the columns of run and map mean something else."""
    for name, expected in vars(conventions).items():
        value = getattr(meaning, name)
        if abs(value - expected) > 1e-9:
            hint = f"smooth it with geometry.{name} = {expected:g} in the settings (--config)"
            if name in _OF_THE_TRACK:
                hint = (
                    f"if it is the same track, set track.{name} = {expected:g} in recording.toml and smooth it again; "
                    f"of another system's geometry, set {name} under [geometry] of the mapping and import it again"
                )
            raise BadInputError(f"run {run}: {name} is {value:g}; expected that of the map, {expected:g}. Hint: {hint}")


def recognised_on_map(result: Result, grid: pd.DataFrame, map_sd_m: float | None) -> Recognition:
    """Recognise a run on a grid; the result's ``warp`` is the function from the run's chainage to the grid's.

    ``map_sd_m``: sigma of the grid's chainage; None where run and grid do not count from the same place.
    """
    wheel, facts = result.summary.wheel_scale, result.summary.run
    return recognised_near(
        result.geometry,
        grid,
        map_sd_m,
        rate_sd=_SCALE_SD_WITHOUT_WHEEL if wheel is None or wheel.sd is None else wheel.sd,
        direction=1 if facts is None else facts.direction,
    )


def recognised_near(
    run: pd.DataFrame, grid: pd.DataFrame, grid_sd_m: float | None, *, rate_sd: float, direction: int
) -> Recognition:
    """Recognise a geometry table about where its own chainage has it, to the sigmas of both.

    ``grid_sd_m``: sigma of the grid's chainage; None to search everywhere.
    """
    place_sd = None if grid_sd_m is None else np.hypot(run["chainage_m_sd"].to_numpy(), grid_sd_m)
    return recognise(run, grid, place_sd_m=place_sd, rate_sd=rate_sd, direction=direction)
