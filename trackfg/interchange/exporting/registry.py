"""The registry has every format that ``trackfg export`` writes, by name."""

from __future__ import annotations

from trackfg.interchange.exporting.formats.geographic import GeoJson, GeoPackage, GeoParquet, Gpx
from trackfg.interchange.exporting.formats.landxml import LandXml
from trackfg.interchange.exporting.formats.mcap import Mcap
from trackfg.interchange.exporting.formats.rcm_dx import RcmDx
from trackfg.interchange.exporting.formats.tables import Channels, Csv, Excel
from trackfg.interchange.exporting.formats.tum import Tum
from trackfg.interchange.exporting.result_format import ResultFormat
from trackfg.interchange.format_names import by_name, registered

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
    others = [make() for make in registered(ENTRY_POINT)]
    return {form.key: form for form in (*(make() for make in _OWN), *others)}


def result_format(name: str) -> ResultFormat:
    """Return the format of that name. Raises :class:`~trackfg.errors.BadInputError` as :func:`by_name` does."""
    return by_name(result_formats(), name)
