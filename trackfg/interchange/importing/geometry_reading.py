"""How a channel table is read: the section ``[geometry]`` of a mapping."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator

from trackfg.numerics.chainage.km_notation import Bare
from trackfg.recording.strict_model import Model
from trackfg.results.columns import BAND_COLUMNS, GEOMETRY_COLUMNS, RAIL_COLUMNS

Length = Annotated[float, Field(gt=0, allow_inf_nan=False)]

KNOWN_COLUMNS = frozenset((*GEOMETRY_COLUMNS, *RAIL_COLUMNS, *BAND_COLUMNS))
"""Columns that a geometry may have."""


class ChannelReading(Model):
    """A channel of a file: its ``name`` there, and what its numbers are multiplied by."""

    name: str
    factor: float = 1.0
    deviation: bool = False


class GeometryOptions(Model):
    """Which columns of a table are which of the geometry's, and what these mean, as far as a mapping states it.

    ``place`` is a column of places, or those of posts and lengths from them. ``facing``: whether left and right are
    those of increasing chainage or of the direction of travel, the order of the rows. Lengths that the file does not
    say are assumed: the gauge and its base by the gauge channel, base and anchor of the twist by the cross-level.
    """

    file: str = "*"
    place: str | tuple[str, str] | None = None
    chainage_unit: Bare = "m"
    channels: dict[str, ChannelReading] | None = None
    facing: Literal["increasing chainage", "travel"] = "increasing chainage"
    chainage_sd_m: Length = 10.0
    gauge_m: Length | None = None
    cross_level_base_m: Length | None = None
    step_m: Length | None = None
    twist_base_m: Length | None = None
    twist_anchor: Literal["behind", "centre", "ahead"] | None = None
    chord_m: Length = 10.0
    band_m: tuple[Length, Length] = (3.0, 25.0)
    curvature_base_m: Length = 10.0
    gradient_base_m: Length = 25.0

    @field_validator("channels", mode="before")
    @classmethod
    def _named(cls, value: object) -> object:
        """Take a bare name for a channel, and refuse columns that a geometry has not."""
        if not isinstance(value, dict) or not value:
            raise ValueError("expected columns of the geometry with the file's names")
        for column in value:
            if column not in KNOWN_COLUMNS:
                raise ValueError(
                    f"no column {column!r} of a geometry; expected one of {', '.join(sorted(KNOWN_COLUMNS))}"
                )
        return {column: {"name": name} if isinstance(name, str) else name for column, name in value.items()}


class GeometryReading(GeometryOptions):
    """How a table is read: the place and the channels are known."""

    place: str | tuple[str, str]
    channels: dict[str, ChannelReading]
