"""A channel table says by names and units which of its columns are which of the geometry's."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import cast, get_args

from trackfg.interchange.importing.channels.channel_names import channel_of
from trackfg.interchange.importing.geometry_reading import ChannelReading, GeometryReading
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.numerics.km_notation import Bare

_KM = re.compile(r"^(km|kilomet(er|re)s?|公里|里程)$", re.IGNORECASE)
_M = re.compile(r"^(m|met(er|re)s?|米)$", re.IGNORECASE)
_PLACE = re.compile(
    r"location|position|sijainti|station|chainage|kilomet|mileage|\bpost|mile.?post|^[mp][kp]$|\bkm\b|里程|公里|"
    r"(line|track).?offset",
    re.IGNORECASE,
)
_MILES = re.compile(r"mile.?post|\bmiles?\b|^mp$", re.IGNORECASE)


def proposed_reading(tables: Sequence[SourceTable]) -> GeometryReading | None:
    """Return how the first table that has places and a channel of track geometry is read; None where none has."""
    for table in tables:
        place = _place(table)
        if place is not None and (channels := _channels(table, place)):
            unit = _bare_unit(table, place) if isinstance(place, str) else "m"
            return GeometryReading(file=table.name, place=place, chainage_unit=unit, channels=channels)
    return None


def _place(table: SourceTable) -> str | tuple[str, str] | None:
    """Return the column of the place, or those of kilometres and metres."""
    names = table.columns
    if "chainage_m" in names:
        return "chainage_m"
    km, m = (next((name for name in names if pattern.match(name.strip())), None) for pattern in (_KM, _M))
    if km is not None and m is not None:
        return km, m
    return next((name for name in names if _PLACE.search(name)), None)


def _bare_unit(table: SourceTable, place: str) -> Bare:
    """Return the unit of a place's bare numbers, by the column's unit or its name."""
    stated = table.units.get(place, "").casefold()
    if stated in get_args(Bare):
        return cast(Bare, stated)
    words = place.replace("_", " ")
    if place == "chainage_m":
        return "m"
    return (
        "km" if re.search(r"\bkm\b|^pk$|kilomet", words, re.IGNORECASE) else "mi" if re.search(_MILES, words) else "m"
    )


def _channels(table: SourceTable, place: str | tuple[str, str]) -> dict[str, ChannelReading]:
    """Return the channels by the geometry's column: of two of one column the one that is no deviation, or the first."""
    found: dict[str, ChannelReading] = {}
    for name in table.columns:
        if name in (place if isinstance(place, tuple) else (place,)):
            continue
        channel = channel_of(name, table.units.get(name, ""))
        if channel is None or channel.column == "chainage_m":
            continue
        if channel.column not in found or (found[channel.column].deviation and not channel.deviation):
            found[channel.column] = ChannelReading(name=name, factor=channel.factor, deviation=channel.deviation)
    return found
