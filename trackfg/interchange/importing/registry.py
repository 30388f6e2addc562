"""Every format that ``trackfg import`` reads, by name, and the one that a source is of."""

from __future__ import annotations

from pathlib import Path

from trackfg.errors import BadInputError
from trackfg.files.owned_folder import kind_of
from trackfg.interchange.format_names import by_name, registered
from trackfg.interchange.importing.source_format import SourceFormat
from trackfg.interchange.importing.sources.hdf5 import RcmDx, TableHdf5
from trackfg.interchange.importing.sources.mcap_json import McapJson
from trackfg.interchange.importing.sources.mdf import Mdf
from trackfg.interchange.importing.sources.netcdf import ClassicNetCdf
from trackfg.interchange.importing.sources.phones import Phyphox, SensorLogger
from trackfg.interchange.importing.sources.receivers.gnss_log import GnssLog
from trackfg.interchange.importing.sources.rosbag import RosBag
from trackfg.interchange.importing.sources.table_files import TEXT_SUFFIXES
from trackfg.interchange.importing.sources.tdms import Tdms
from trackfg.interchange.importing.sources.text import TextFormat
from trackfg.interchange.importing.sources.vbo import Vbo
from trackfg.interchange.importing.unread_formats import unread_format
from trackfg.results.result import RESULT_FOLDER

ENTRY_POINT = "trackfg.source_formats"
"""Other packages register a :class:`SourceFormat` class under this group."""

_OWN: tuple[type[SourceFormat], ...] = (
    Phyphox,
    SensorLogger,
    McapJson,
    RosBag,
    RcmDx,
    TableHdf5,
    ClassicNetCdf,
    Mdf,
    Tdms,
    GnssLog,
    Vbo,
    TextFormat,
)
"""In the order in which they are tried: the particular ones first."""


def source_formats() -> dict[str, SourceFormat]:
    """Return the formats by name: those of other packages first, so that they can be more particular."""
    others = [make() for make in registered(ENTRY_POINT)]
    return {form.key: form for form in (*others, *(make() for make in _OWN))}


def source_format(path: Path, name: str | None = None) -> SourceFormat:
    """Return the format of that name, or the one that recognises the source.

    Raises :class:`BadInputError` where there is none of that name, no such file or a pipe, where the source is a
    recording or a result of trackfg, and where nothing recognises it.
    """
    formats = source_formats()
    named = None if name is None else by_name(formats, name)
    if not path.exists():
        raise BadInputError(f"{path}: no such file or folder")
    if not path.is_file() and not path.is_dir():
        raise BadInputError(f"{path}: is a pipe or a device; expected a file or a folder")
    if named is not None:
        return named
    kind = kind_of(path)
    if kind == "recording":
        raise BadInputError(
            f"{path}: is a trackfg recording; expected one of another system. Hint: trackfg check and smooth take it "
            "as it is; --from text imports its tables anew, without what recording.toml says of them"
        )
    if RESULT_FOLDER.holds(path):
        raise BadInputError(f"{path}: is a trackfg result; expected a recording of another system")
    candidate = next((form for form in formats.values() if form.recognises(path)), None)
    may_be_other = candidate is None or path.suffix.casefold() in (*TEXT_SUFFIXES, ".mat")
    if may_be_other and (unread := unread_format(path)) is not None:
        raise BadInputError(unread)
    if candidate is not None:
        return candidate
    if kind is not None:
        raise BadInputError(f"{path}: is a trackfg {kind}; expected a source of one of {', '.join(formats)}")
    hint = "Hint: trackfg import and init take its name with --from"
    raise BadInputError(f"{path}: of no known format; expected one of {', '.join(formats)}. {hint}")
