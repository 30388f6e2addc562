"""Every format that ``trackfg export`` writes, by name."""

from __future__ import annotations

from importlib.metadata import entry_points

from trackfg.errors import BadInputError, did_you_mean
from trackfg.interchange.exporting.formats.geographic import GeoJson, GeoPackage, GeoParquet, Gpx
from trackfg.interchange.exporting.formats.landxml import LandXml
from trackfg.interchange.exporting.formats.mcap import Mcap
from trackfg.interchange.exporting.formats.rcm_dx import RcmDx
from trackfg.interchange.exporting.formats.tables import Channels, Csv, Excel
from trackfg.interchange.exporting.formats.tum import Tum
from trackfg.interchange.exporting.result_format import ResultFormat

ENTRY_POINT = "trackfg.result_formats"
"""Other packages register a :class:`ResultFormat` class under this group."""

_OWN: tuple[type[ResultFormat], ...] = (
    Csv,
    Excel,
    Channels,
    GeoJson,
    Gpx,
    GeoPackage,
    GeoParquet,
    LandXml,
    RcmDx,
    Tum,
    Mcap,
)


def result_formats() -> dict[str, ResultFormat]:
    """Return the formats by name."""
    others = [point.load()() for point in entry_points(group=ENTRY_POINT)]
    return {form.key: form for form in (*(own() for own in _OWN), *others)}


def result_format(name: str) -> ResultFormat:
    """Return the format of that name. Raises :class:`BadInputError` with the nearest one where there is none."""
    known = result_formats()
    if name not in known:
        near = did_you_mean(name, known)
        raise BadInputError(
            f"no format {name!r}; expected one of {', '.join(known)}" + (f". Hint: {near}" if near else "")
        )
    return known[name]
