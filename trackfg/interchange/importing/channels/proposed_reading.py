"""A channel table says by names and units which of its columns are which of the geometry's."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from trackfg.interchange.importing.channels.channel_names import channel_of
from trackfg.interchange.importing.geometry_reading import ChannelReading, GeometryReading
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.stations import PlaceColumns, bare_unit, place_columns

if TYPE_CHECKING:
    from trackfg.numerics.chainage.km_notation import Bare

_PLACE = re.compile(
    r"location|position|sijainti|station|chainage|kilomet|chilomet|progressiva|mileage|\bpost|mile.?post|"
    r"^[mp][kp]([\s_]?[\[(].*)?$|\bkm\b|里程|公里|"
    r"(line|track).?offset",
    re.IGNORECASE,
)


def proposed_reading(tables: Sequence[SourceTable]) -> GeometryReading | None:
    """Return how the first table that has places and a channel of track geometry is read; None where none has."""
    for table in tables:
        place, unit = _place(table)
        if place is not None and (channels := _channels(table, place)):
            return GeometryReading(file=table.name, place=place, chainage_unit=unit, channels=channels)
    return None


def _place(table: SourceTable) -> tuple[PlaceColumns | None, Bare]:
    """Return the column of the place, or those of posts and lengths from them, and its unit."""
    if "chainage_m" in table.columns:
        return "chainage_m", "m"
    if (pair := place_columns(table)) is not None:
        return pair
    place = next((name for name in table.columns if _PLACE.search(name)), None)
    return place, "m" if place is None else bare_unit(table, place)


def _channels(table: SourceTable, place: PlaceColumns) -> dict[str, ChannelReading]:
    """Return the channels by the geometry's column: of two of one column the one that is no deviation, or the first."""
    channels: dict[str, ChannelReading] = {}
    names = [name for name in table.columns if name not in (place if isinstance(place, tuple) else (place,))]
    plain = (channel_of(name, table.units.get(name, "")) for name in names)
    has_level = any(channel is not None and channel.column.startswith("level") for channel in plain)
    for name in names:
        channel = channel_of(name, table.units.get(name, ""), beside_level=has_level)
        if channel is None or channel.column == "chainage_m":
            continue
        if channel.column not in channels or (channels[channel.column].deviation and not channel.deviation):
            channels[channel.column] = ChannelReading(name=name, factor=channel.factor, deviation=channel.deviation)
    return channels


def unused_channels(table: SourceTable, reading: GeometryReading) -> list[str]:
    """Return the columns with values that are neither places nor channels of a reading."""
    places = (reading.place,) if isinstance(reading.place, str) else reading.place
    used = {*places, *(channel.name for channel in reading.channels.values())}
    return [name for name in table.columns if name not in used and table.frame[name].notna().any()]
