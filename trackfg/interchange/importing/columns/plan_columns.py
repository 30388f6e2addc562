"""Columns that say where a receiver is in plan: latitude and longitude, or easting and northing of a reference system.

Which system that is, a table may say as an EPSG code, as a zone of UTM, or by the name of a country's grid. A zone is
that of ETRS89 where this is named, else of WGS 84, from which ETRS89 is less than a metre away.
"""

from __future__ import annotations

import re

from trackfg.interchange.importing.columns.column_meaning import first_of, kind_in
from trackfg.interchange.importing.columns.column_names import parts_of
from trackfg.interchange.importing.source_table import SourceTable

_EPSG = re.compile(r"epsg\W{0,2}(\d{4,6})(?!\d)", re.IGNORECASE)
_UTM = re.compile(
    r"utm[\s_:-]*(?:zone)?[\s_:-]*(\d{1,2})(?!\d)(?:[\s_]?([ns])(?![a-z])|([f-hj-np-x])(?![a-z]))?", re.IGNORECASE
)
"""The number of a zone, and the letter of its hemisphere or of a band of latitudes that has railways."""
_EITHER, _FIRST_NORTHERN = "s", "n"
"""A letter that is both the southern hemisphere and a northern band, and the first of the northern ones."""
_ZONES, _ZONES_OF_ETRS89 = range(1, 61), range(28, 39)
"""Zones of WGS 84, and those that EPSG has of ETRS89."""
_GRIDS = {
    r"lv.?95": 2056,
    r"lv.?03": 21781,
    r"lambert.?93": 2154,
    r"rd.?new|rijksdriehoek": 28992,
    r"british.national.grid|osgb": 27700,
    r"tm35.?fin": 3067,
    r"sweref.?99.?tm": 3006,
}
"""EPSG codes of grids of one zone. Zones of Gauss and Krüger are on several datums: a number does not say which."""
_ZONE = re.compile(r"(^|[\s_])zone$", re.IGNORECASE)
_AXES = (
    "e(ast(ing)?)?|lon(gitude)?",
    "n(orth(ing)?)?|lat(itude)?",
    "up?|height|hgt|alt(itude)?|elev(ation)?|v(ert(ical)?)?",
)
"""East, north and up in names of sigmas."""
_SIGMA = r"(sd|std|st(an)?d(ard)? ?dev(iation)?|sigma|uncertainty)"
_OF_AXES = [re.compile(rf"((pos(ition)?|gps|gnss) )?({_SIGMA} ?({axis})|({axis})( m)? ?{_SIGMA})") for axis in _AXES]


def plan_columns(table: SourceTable) -> tuple[str, str] | None:
    """Return the columns of latitude and longitude, else those of easting and northing; None without either."""
    for kinds in (("latitude", "longitude"), ("easting", "northing")):
        first, second = (first_of(table, kind) for kind in kinds)
        if first is not None and second is not None:
            return first, second
    return None


def sigma_columns(table: SourceTable) -> tuple[str | None, ...]:
    """Return the columns of sigmas east, north and up, in m; None for each that the table does not have."""
    names = {name: parts_of(name) for name in table.columns}
    in_metres = {name: parts for name, parts in names.items() if (table.units.get(name) or parts.unit) in ("", "m")}
    return tuple(
        next((name for name, parts in in_metres.items() if axis.fullmatch(parts.words)), None) for axis in _OF_AXES
    )


def are_projected(table: SourceTable, plan: tuple[str, str]) -> bool:
    """Return whether the columns of a position are easting and northing."""
    return kind_in(table, plan[0]) == "easting"


def stated_system(table: SourceTable, plan: tuple[str, str]) -> str | None:
    """Return the reference system that names, units, a column of zones or remarks of a table state; None without."""
    names = " ".join([*plan, *(table.units.get(name, "") for name in plan)])
    zone = table.name_like(_ZONE)
    zones = set() if zone is None else set(table.column(zone).dropna())
    in_column = f"{names} UTM {zones.pop()}" if len(zones) == 1 else ""
    return next(filter(None, map(system_of, (names, in_column, table.remarks))), None)


def system_of(text: str) -> str | None:
    """Return the reference system that a text names, as ``EPSG:N``; None where it names none, or more than one."""
    if code := _EPSG.search(text):
        return f"EPSG:{code[1]}"
    for name, number in _GRIDS.items():
        if re.search(name, text, re.IGNORECASE):
            return f"EPSG:{number}"
    zones = {(int(number), (half or band or _FIRST_NORTHERN).casefold()) for number, half, band in _UTM.findall(text)}
    if len(zones) != 1:
        return None
    zone, letter = zones.pop()
    if zone not in _ZONES or letter == _EITHER:
        return None
    if "etrs" in text.casefold() and zone in _ZONES_OF_ETRS89:
        return f"EPSG:{25800 + zone}"
    return f"EPSG:{(32600 if letter >= _FIRST_NORTHERN else 32700) + zone}"
