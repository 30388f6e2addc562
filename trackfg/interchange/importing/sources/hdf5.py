"""HDF5 files: RCM-DX of recording cars, and tables of named columns such as DLR's OnboardEU journeys.

RCM-DX 2.0 (OpenRailAssociation/rcm-dx): a measuring system has data sources; a data source has one array of times, ns
since 1970, and channels, each a group with an array ``data`` and its unit. Names come plain, as the specification has
them, or with the system's prefix (``[PLATFORM].``, ``section.``), as recording cars write them: both are read.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pandas as pd

from trackfg.files.libraries import library
from trackfg.interchange.importing.columns.column_names import meaning
from trackfg.interchange.importing.shapes.array_tables import names_rate, tables_of_arrays
from trackfg.interchange.importing.shapes.dates_since import with_dates
from trackfg.interchange.importing.shapes.packed_values import scale_in, scale_of_others, unit_in, unpacked
from trackfg.interchange.importing.shapes.usual_shape import in_usual_shape_of_types
from trackfg.interchange.importing.source_format import DialectFor, SourceFormat, readable, refuse_empty, starts_with
from trackfg.interchange.importing.source_table import SourceTable, column_of, holds_numbers

Part = TypeVar("Part")
_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_NAMES = ("columns", "column_names", "names", "labels", "channels")
"""Attributes with the names of the columns of an array (n, columns)."""


class RcmDx(SourceFormat):
    """Each data source is a table ``SYSTEM/SOURCE`` with the column ``timestamp`` and one for each channel."""

    key = "rcm-dx"
    title = "RCM-DX 2.0 (.rcmdx, HDF5) of recording cars"

    def recognises(self, path: Path) -> bool:
        """Return whether it is HDF5 with the root group of RCM-DX."""
        return _is_hdf5(path) and (path.suffix.casefold() == ".rcmdx" or _has_root(path, "RCMDX"))

    def tables(self, path: Path, dialect_for: DialectFor) -> Sequence[SourceTable]:
        """Read the data sources of every session, each with the run's place at its times."""
        return _placed(_in_one(refuse_empty(_read(path, _data_sources), path, "data source with a timestamp")))


class TableHdf5(SourceFormat):
    """Each dataset with named columns is a table; OnboardEU files have ``journey_NN/IMU`` and ``journey_NN/GNSS``.

    In a file without any the arrays of each group are, with the units that they state, as those of netCDF-4 do. Tables
    of pandas' ``to_hdf`` have its names.
    """

    key = "hdf5"
    title = "HDF5 with tables of named columns, such as OnboardEU's journeys"

    def recognises(self, path: Path) -> bool:
        """Return whether it is HDF5."""
        return _is_hdf5(path)

    def tables(self, path: Path, dialect_for: DialectFor) -> Sequence[SourceTable]:
        """Read the datasets; of several journeys the first, since a recording is one run."""
        tables = _read(path, _pandas_tables) or _read(path, _compound_tables)
        if not tables:
            arrays, units = arrays_in(path), dict(_read(path, _units))
            tables = [with_dates(table) for table in tables_of_arrays(arrays, path.name, units)]
            notes = tuple(f"{path.name}: {note}" for note in _read(path, _scales))
            tables = [replace(table, notes=notes if table is tables[0] else ()) for table in tables]
        tables = in_usual_shape_of_types(tables)
        refuse_empty(tables, path, "dataset with named columns, and no arrays of numbers")
        journeys = sorted({table.name.partition("/")[0] for table in tables if table.name.startswith("journey_")})
        return [table for table in tables if not journeys or table.name.partition("/")[0] == journeys[0]]


def _is_hdf5(path: Path) -> bool:
    return starts_with(path, _SIGNATURE)


def _has_root(path: Path, name: str) -> bool:
    try:
        h5py = library("h5py", "hdf5")
        with h5py.File(path, "r") as file:
            return name in file
    except Exception:  # a damaged file is of no format; a missing library is named when it is read
        return False


def _read(path: Path, parts_of: Callable[[Any, Any], Iterator[Part]]) -> list[Part]:
    """Return what ``parts_of`` yields for the library and the open file. Raises :class:`BadInputError`."""
    h5py = library("h5py", "hdf5")
    faults = (OSError, KeyError, ValueError, TypeError, RuntimeError)
    with readable(path, "HDF5", faults), h5py.File(path, "r") as file:
        return list(parts_of(h5py, file))


def _all_of(kind: type, file: Any) -> list[Any]:
    """Return the groups or datasets of a file, at any depth."""
    items: list[Any] = []
    file.visititems(lambda _, item: items.append(item) if isinstance(item, kind) else None)
    return items


def _plain(name: str) -> str:
    """Return a name without the prefix of its system: all before the last point, which no plain name has."""
    return name.rpartition(".")[2] if "." in name else name


def _data_sources(h5py: Any, file: Any) -> Iterator[SourceTable]:
    """Find the groups with an array ``timestamp`` and groups with an array ``data``."""
    for group in _all_of(h5py.Group, file):
        members = {_plain(name).casefold(): item for name, item in group.items()}
        times = members.get("timestamp")
        if not isinstance(times, h5py.Dataset) or times.ndim != 1 or not len(times):
            continue
        columns: dict[str, Any] = {"timestamp": times[()].astype(np.int64)}
        units: dict[str, str] = {}
        for name, item in _channels(h5py, members):
            data = item if isinstance(item, h5py.Dataset) else _data(h5py, item)
            if name == "timestamp" or data is None or data.shape != times.shape or data.dtype.kind not in "iufb":
                continue
            columns[name] = data[()]
            units[name] = _text(data.attrs.get("Unit", ""))
        if len(columns) > 1:
            parts = [_plain(part) for part in group.name.split("/")[1:]]
            yield SourceTable("/".join(parts[-2:]), pd.DataFrame(columns), units)


def _in_one(tables: Sequence[SourceTable]) -> list[SourceTable]:
    """Return the tables with the sessions of a data source, one after the other, in one."""
    sessions: dict[tuple[str, ...], list[SourceTable]] = {}
    for table in tables:
        sessions.setdefault((table.name, *table.columns), []).append(table)
    out = []
    for parts in sessions.values():
        parts.sort(key=lambda table: int(table.frame["timestamp"].iloc[0]))
        out.append(replace(parts[0], frame=pd.concat([table.frame for table in parts], ignore_index=True)))
    return out


def _placed(tables: Sequence[SourceTable]) -> list[SourceTable]:
    """Return the tables with the positions of the run, ``lineoffset`` in km or ``trackoffset`` in m, at their times."""
    for positions in tables:
        for name, unit in (("lineoffset", "km"), ("trackoffset", "m")):
            if name in positions.columns and positions.frame[name].notna().any():
                at, place = positions.frame["timestamp"].to_numpy(), positions.numbers(name)
                return [
                    table
                    if name in table.columns
                    else replace(
                        table,
                        frame=table.frame.assign(**{name: np.interp(table.frame["timestamp"], at, place)}),
                        units={**table.units, name: unit},
                    )
                    for table in tables
                ]
    return list(tables)


def _channels(h5py: Any, members: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield the members of a data source by name; of the positions' channel the arrays that it holds itself."""
    for name, item in members.items():
        if isinstance(item, h5py.Group) and _data(h5py, item) is None:
            yield from ((_plain(part).casefold(), array) for part, array in item.items())
        else:
            yield name, item


def _data(h5py: Any, item: Any) -> Any:
    """Return the array ``data`` of a channel's group; None where it has none."""
    if not isinstance(item, h5py.Group):
        return None
    arrays = [value for name, value in item.items() if _plain(name).casefold() == "data"]
    return arrays[0] if arrays and isinstance(arrays[0], h5py.Dataset) else None


def _compound_tables(h5py: Any, file: Any) -> Iterator[SourceTable]:
    for dataset in _all_of(h5py.Dataset, file):
        if dataset.dtype.names and len(dataset):
            values = dataset[()]
            rates = {name: rate for item in (file, dataset.parent, dataset) for name, rate in _rates_at(item)}
            columns = {name: values[name] for name in dataset.dtype.names}
            yield from tables_of_arrays({**rates, **columns}, dataset.name.lstrip("/"))


def _pandas_tables(h5py: Any, file: Any) -> Iterator[SourceTable]:
    """Find the tables that pandas has written: an index beside blocks of columns of one type."""
    for group in _all_of(h5py.Group, file):
        kind = _text(group.attrs.get("pandas_type", ""))
        if kind == "frame":
            columns = _blocks(group)
        elif kind == "frame_table":
            columns = _fields(group["table"])
        else:
            continue
        pairs = ((name, column_of(values)) for name, values in columns.items())
        columns = {name: column for name, column in pairs if column is not None}
        if holds_numbers(columns):
            yield SourceTable(group.name.lstrip("/"), pd.DataFrame(columns))


def _blocks(group: Any) -> dict[str, Any]:
    index = group["axis1"]
    columns = {_index_name(index.attrs.get("name"), index.attrs.get("kind")): index[()]}
    for number in range(int(group.attrs["nblocks"])):
        names = [_text(name) for name in group[f"block{number}_items"][()]]
        values = np.asarray(group[f"block{number}_values"][()])
        if values.ndim == 2:  # texts are a pickle
            columns |= dict(zip(names, values.T, strict=False))
    return columns


def _fields(table: Any) -> dict[str, Any]:
    rows, columns = table[()], dict[str, Any]()
    for field in rows.dtype.names:
        if field == "index":
            columns[_index_name(None, table.attrs.get("index_kind"))] = rows[field]
        elif rows[field].ndim == 2:
            names = _names_of_block(table.attrs.get(f"{field}_kind"))
            columns |= dict(zip(names, rows[field].T, strict=False))
        else:
            columns[field] = rows[field]
    return columns


def _index_name(name: Any, kind: Any) -> str:
    """Return the name of an index: its own, else ``time`` of dates."""
    given = "" if name is None else _text(name)
    if given not in ("", "N."):  # None, as PyTables keeps it
        return given
    return "time" if "datetime" in _text(kind or "") else "index"


def _names_of_block(kind: Any) -> list[str]:
    """Return the texts of a list that PyTables has kept as a pickle in text form, which is not to be run."""
    names = re.findall(rb"V([^\n]*)\n", bytes(kind) if isinstance(kind, bytes) else b"")
    return [name.decode("raw-unicode-escape") for name in names]


def _units(h5py: Any, file: Any) -> Iterator[tuple[str, str]]:
    """Yield the units that arrays state, by their paths."""
    for dataset in _all_of(h5py.Dataset, file):
        if (stated := unit_in(_attributes(dataset))) is not None:
            yield dataset.name.lstrip("/"), stated
        for column, unit in zip(_listed(dataset, *_NAMES), _listed(dataset, "units", "unit"), strict=False):
            yield f"{dataset.name.lstrip('/')}/{column}", unit


def _scales(h5py: Any, file: Any) -> Iterator[str]:
    """Yield a note for each attribute of a scale: the arrays to which it is applied, or is not."""
    applied, left = dict[str, list[str]](), dict[str, list[str]]()
    for dataset in _all_of(h5py.Dataset, file):
        for find, arrays in ((scale_in, applied), (scale_of_others, left)):
            if (name := find(_attributes(dataset), dataset.dtype)) is not None:
                arrays.setdefault(name, []).append(dataset.name.lstrip("/"))
    for name, paths in applied.items():
        yield f"counts are multiplied by their attribute {name} ({', '.join(paths)})"
    for name, paths in left.items():
        yield f"an attribute {name} is not applied to what are no whole numbers ({', '.join(paths)})"


def arrays_in(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of numbers and texts in an HDF5 file by their paths. Raises :class:`BadInputError`."""
    return dict(_read(path, _arrays))


def _arrays(h5py: Any, file: Any) -> Iterator[tuple[str, np.ndarray]]:
    for dataset in _all_of(h5py.Dataset, file):
        name = dataset.name.lstrip("/")
        is_text = h5py.check_string_dtype(dataset.dtype) is not None and dataset.ndim == 1
        if name.startswith("#"):
            continue
        if is_text:
            yield name, dataset[()]
        elif dataset.dtype.kind in "iufb":
            values, columns = unpacked(dataset[()], _attributes(dataset)), _listed(dataset, *_NAMES)
            if values.ndim == 2 and len(columns) == values.shape[1]:
                yield from ((f"{name}/{column}", values[:, i]) for i, column in enumerate(columns))
            else:
                yield name, values
    for item in (file, *_all_of(h5py.Group, file), *_all_of(h5py.Dataset, file)):
        yield from ((f"{item.name}/{name}".strip("/"), value) for name, value in _rates_at(item))


def _rates_at(item: Any) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the attributes of a file, a group or an array that are a sampling rate or the interval of samples."""
    return ((name, np.asarray(value)) for name, value in item.attrs.items() if names_rate(name))


def _attributes(dataset: Any) -> dict[str, Any]:
    """Return the attributes of an array by their names in lower case, with those of its group behind them.

    Times are in a unit of their own.
    """
    group = dataset.parent
    shared = {} if group.name == "/" or meaning(dataset.name.rpartition("/")[2]) == "time" else group.attrs
    return {name.casefold(): value for attributes in (shared, dataset.attrs) for name, value in attributes.items()}


def _listed(dataset: Any, *names: str) -> list[str]:
    """Return the texts of a list that an attribute of one of these names has; none without it."""
    attributes = {name.casefold(): value for name, value in dataset.attrs.items()}
    value = next((attributes[name] for name in names if name in attributes), ())
    return [] if isinstance(value, str | bytes) else [_text(part) for part in np.ravel(value)]


def _text(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
