"""Sigmas of a result's tables are widened by what the verdicts say, once, when the tables are made."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from trackfg.results.balise_passages import BalisePassages
from trackfg.results.place_covariance import PlaceCovariance
from trackfg.results.verdict import Quantity, Verdict, widening

QUANTITY_OF_COLUMN: dict[str, Quantity] = {
    "chainage_m": "chainage",
    "east_m": "position",
    "north_m": "position",
    "up_m": "height",
    "speed_mps": "speed",
    "roll_rad": "roll",
    "pitch_rad": "pitch",
    "yaw_rad": "yaw",
    "curvature_1pm": "curvature",
    "gradient_permille": "gradient",
    "cross_level_mm": "cross_level",
    "twist_mm": "twist",
    "level_mm": "level",
    "level_left_mm": "level",
    "level_right_mm": "level",
    "versine_level_mm": "level",
    "alignment_mm": "alignment",
    "alignment_left_mm": "alignment",
    "alignment_right_mm": "alignment",
    "versine_alignment_mm": "alignment",
}
"""The quantity whose verdict holds for each column of trajectory, geometry and events. The gauge has none: lasers alone
measure it.
"""


UNKNOWN_SD: dict[Quantity, float] = {
    "chainage": 1e5,
    "position": 1e5,
    "height": 1e4,
    "speed": 200.0,
    "roll": math.pi,
    "pitch": math.pi,
    "yaw": math.pi,
    "cross_level": 1e3,
    "twist": 1e3,
    "level": 1e3,
    "alignment": 1e3,
    "curvature": 0.1,
    "gradient": 1e3,
}
"""The sigma, in the columns' units, of a quantity that is not to be trusted: as wide as nothing on rails can differ.

Positions: longer than a run between two fixes. Speed: above the record of 160 m/s. Cant stays below 200 mm (EN 13803),
radii above 10 m, gradients of rack railways below 500 per mille, and no railway climbs 10 km. It is finite, so that
every reader of the tables can go on working with them; a mean weighted by 1 / sigma^2 passes over such rows.
"""


def trusted(verdicts: Sequence[Verdict], column: str) -> bool:
    """Return whether the sigmas of a column mean anything; those that no verdict names do."""
    quantity = QUANTITY_OF_COLUMN.get(column)
    return quantity is None or math.isfinite(widening(verdicts, quantity))


def widened(table: pd.DataFrame, verdicts: Sequence[Verdict]) -> pd.DataFrame:
    """Return the table with the sigma of every column times the factor of its quantity.

    Sigmas of a quantity that is not to be trusted become at least those of :data:`UNKNOWN_SD`.
    """
    wide = {}
    for column, quantity in QUANTITY_OF_COLUMN.items():
        name, factor = f"{column}_sd", widening(verdicts, quantity)
        if name in table and factor > 1.0:
            finite = math.isfinite(factor)
            wide[name] = factor * table[name] if finite else table[name].clip(lower=UNKNOWN_SD[quantity])
    return table.assign(**wide)


def widened_places(places: PlaceCovariance, verdicts: Sequence[Verdict]) -> PlaceCovariance:
    """Return the joint covariance likewise; of no places where chainage or cross-level is not to be trusted."""
    factors = np.array([widening(verdicts, "chainage"), widening(verdicts, "cross_level")])
    if not np.isfinite(factors).all():
        return PlaceCovariance.none()
    if (factors == 1.0).all():
        return places
    return replace(places, errors=places.errors.scaled(np.repeat(factors, len(places.chainage_m))))


def widened_passages(passages: BalisePassages, verdicts: Sequence[Verdict]) -> BalisePassages:
    """Return the joint covariance of passages likewise; no passages where chainage is not to be trusted."""
    factor = widening(verdicts, "chainage")
    if not np.isfinite(factor):
        return BalisePassages.none()
    return replace(passages, covariance=factor**2 * passages.covariance)
