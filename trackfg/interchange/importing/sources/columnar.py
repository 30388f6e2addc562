"""Files of columns: Parquet, Feather and Arrow, SQLite, NumPy and MATLAB."""

from __future__ import annotations

import importlib
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute
import pyarrow.feather
import pyarrow.parquet

from trackfg.errors import BadInputError
from trackfg.interchange.importing.columns.column_names import in_one_level
from trackfg.interchange.importing.shapes.array_tables import tables_of_arrays
from trackfg.interchange.importing.shapes.binary_points import points_of, systems_of
from trackfg.interchange.importing.source_format import readable, starts_with
from trackfg.interchange.importing.source_table import SourceTable

_ORC, _PARQUET = ".orc", (".parquet", ".pq")
ARROW_SUFFIXES = (*_PARQUET, ".feather", ".arrow", ".ipc", _ORC)
SQLITE_SUFFIXES = (".db", ".sqlite", ".sqlite3")
ARRAY_SUFFIXES = (".npy", ".npz", ".mat")

_HDF5 = b"MATLAB 7.3 MAT-file"
_DEPTH = 4
"""Structs within structs."""
_AXES = ("x", "y", "z")
_ROWS_AT_ONCE = 50_000
"""Rows of a database that are turned into columns at a time: as Python's numbers they are four times as large."""


def read_arrow(path: Path) -> list[SourceTable]:
    """Read a Parquet, Feather or Arrow file, a column at a time. Raises :class:`BadInputError` where it is none."""
    units, columns, notes, left_out = {}, {}, [], []
    systems = systems_of(_metadata(path))
    plain = (part for whole in _arrow_columns(path) for part in _without_nesting(*whole))
    for written, column in plain:
        name = in_one_level(written)
        if pa.types.is_timestamp(column.type):
            if column.type.tz is None:
                notes.append(f"{path.name}: times of {name} state no zone: they are taken as UTC")
            columns[name], units[name] = column.cast(pa.timestamp("ns")).cast(pa.int64()).to_pandas(), "ns"
        elif pa.types.is_duration(column.type):
            columns[name], units[name] = column.cast(pa.duration("ns")).cast(pa.int64()).to_pandas(), "ns"
        elif pa.types.is_decimal(column.type):
            columns[name] = column.cast(pa.float64()).to_pandas()
        elif _is_bytes(column.type):
            points = points_of(column.to_pylist(), systems.get(written, set()))
            columns |= points or {}
            left_out += [] if points else [name]
        elif pa.types.is_nested(column.type):
            left_out.append(name)
        else:
            columns[name] = (column.cast(pa.string()) if _is_text(column.type) else column).to_pandas()
    if left_out:
        notes.append(f"{path.name}: columns of lists or bytes are not read: {', '.join(left_out)}")
    return [SourceTable(path.name, pd.DataFrame(columns, copy=False), units, notes=tuple(notes))] if columns else []


def _is_bytes(kind: pa.DataType) -> bool:
    return bool(pa.types.is_binary(kind) or pa.types.is_large_binary(kind) or pa.types.is_fixed_size_binary(kind))


def _metadata(path: Path) -> dict[bytes, bytes] | None:
    """Return the metadata of a Parquet file, in which GeoParquet states reference systems; None of other files."""
    if path.suffix.casefold() not in _PARQUET:
        return None
    with readable(path, path.suffix, (pa.ArrowException, OSError, ValueError)):
        metadata: dict[bytes, bytes] | None = pa.parquet.read_schema(path).metadata
        return metadata


def _arrow_columns(path: Path) -> Iterator[tuple[str, pa.ChunkedArray]]:
    with readable(path, path.suffix, (pa.ArrowException, OSError, ValueError)):
        if path.suffix.casefold() in _PARQUET:
            with pa.parquet.ParquetFile(path) as file:
                for name in file.schema_arrow.names:
                    part = file.read(columns=[name], use_threads=False)
                    yield name, part.column(part.schema.get_all_field_indices(name)[-1])  # the last of that name
        elif path.suffix.casefold() == _ORC:
            table = importlib.import_module("pyarrow.orc").read_table(path)  # some builds of Arrow are without it
            yield from zip(table.column_names, table.columns, strict=True)
        else:
            table = pa.feather.read_table(path, use_threads=False)  # mapped into memory, unless it is compressed
            yield from zip(table.column_names, table.columns, strict=True)


def _without_nesting(name: str, column: pa.ChunkedArray) -> Iterator[tuple[str, pa.ChunkedArray]]:
    """Yield the fields of a struct, and the axes of vectors of three numbers in lists; another column as it is."""
    if pa.types.is_struct(column.type):
        for field, part in zip(column.type, column.flatten(), strict=True):
            yield from _without_nesting(f"{name}.{field.name}", part)
    elif _holds_vectors(column):
        values = pa.compute.list_flatten(column).to_numpy().reshape(-1, len(_AXES))
        for axis, part in zip(_AXES, values.T, strict=True):
            yield f"{name} {axis}", pa.chunked_array([np.ascontiguousarray(part)])
    else:
        yield name, column


def _holds_vectors(column: pa.ChunkedArray) -> bool:
    """Return whether each cell is a list of three numbers."""
    kind = column.type
    if not (pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind)):
        return False
    if _is_text(kind.value_type) or column.null_count or not len(column):
        return False
    ends = pa.compute.min_max(pa.compute.list_value_length(column))
    return bool(ends["min"].as_py() == ends["max"].as_py() == len(_AXES))


def _is_text(kind: pa.DataType) -> bool:
    return not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind))


def read_sqlite(path: Path) -> list[SourceTable]:
    """Read every table of a SQLite database. Raises :class:`BadInputError` where it is none."""
    with (
        readable(path, "SQLite", (sqlite3.Error, OSError, UnicodeError)),
        closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as connection,
    ):
        return list(_tables(connection, path.name))


def _tables(connection: sqlite3.Connection, name: str) -> Iterator[SourceTable]:
    titles = connection.execute("SELECT name FROM sqlite_master WHERE type IN ('table', 'view') ORDER BY name")
    for (title,) in titles.fetchall():
        if title.startswith("sqlite_"):
            continue
        quoted = '"' + title.replace('"', '""') + '"'
        cursor = connection.execute(f"SELECT * FROM {quoted}")
        names = [column[0] for column in cursor.description]
        frames = []
        while rows := cursor.fetchmany(_ROWS_AT_ONCE):
            columns = zip(names, zip(*rows, strict=True), strict=True)
            frames.append(pd.DataFrame({column: _cells(values) for column, values in columns}))
        frame = pd.concat(frames, ignore_index=True) if frames else pd.DataFrame()
        if len(frame) > 1:
            mixed = {str(column): frame[column].astype("string") for column in frame.select_dtypes("object")}
            yield SourceTable(f"{name}/{title}", frame.assign(**mixed))


def _cells(values: tuple[Any, ...]) -> pd.Series:
    if all(isinstance(value, int | float) or value is None for value in values):
        return pd.Series(values, dtype=None if all(isinstance(value, int) for value in values) else np.float64)
    return pd.Series(
        [value if isinstance(value, str) or value is None else str(value) for value in values], dtype="string"
    )


def read_arrays(path: Path) -> list[SourceTable]:
    """Read the arrays of a NumPy or MATLAB file. Raises :class:`BadInputError` where it is none, or holds objects."""
    with readable(path, f"arrays of numbers ({path.suffix})"):
        if path.suffix.casefold() == ".mat":
            return tables_of_arrays(_matlab(path), path.name)
        with path.open("rb") as stream:
            loaded = np.load(stream, allow_pickle=False)
            if isinstance(loaded, np.ndarray):
                return _of_array(loaded, path.name)
            with loaded:
                return tables_of_arrays(_npz(loaded), path.name)


def _of_array(array: np.ndarray, name: str) -> list[SourceTable]:
    """Return the table of an array with named columns, or of one with numbers for names."""
    if array.dtype.names is not None:
        return tables_of_arrays({part: array[part] for part in array.dtype.names}, name)
    if array.ndim != 2:
        return []
    return [SourceTable(name, pd.DataFrame(array, columns=[f"c{i + 1}" for i in range(array.shape[1])]))]


def _npz(loaded: Any) -> dict[str, np.ndarray]:
    arrays: dict[str, np.ndarray] = {}
    for name in loaded.files:
        array = loaded[name]
        parts = array.dtype.names
        arrays |= {name: array} if parts is None else {f"{name}/{part}": array[part] for part in parts}
    return arrays


def _matlab(path: Path) -> dict[str, Any]:
    """Return the arrays of a MATLAB file by their paths through structs."""
    if starts_with(path, _HDF5):
        from trackfg.interchange.importing.sources.hdf5 import arrays_in

        return arrays_in(path)
    from scipy.io import loadmat

    content = loadmat(path, squeeze_me=True, struct_as_record=False)
    arrays = dict(_leaves({name: value for name, value in content.items() if not name.startswith("__")}, "", _DEPTH))
    if not arrays:
        raise BadInputError(
            f"{path.name}: no arrays of numbers found; expected some. Hint: timetable and timeseries are objects of "
            "MATLAB: save their arrays, as by s = struct('t', seconds(T.Time), 'gyro', T.gyro) and "
            "save('log.mat', '-struct', 's')"
        )
    return arrays


def _leaves(content: dict[str, Any], prefix: str, depth: int) -> Iterator[tuple[str, Any]]:
    for name, value in content.items():
        if hasattr(value, "_fieldnames") and depth:
            yield from _leaves(
                {part: getattr(value, part) for part in value._fieldnames}, f"{prefix}{name}/", depth - 1
            )
        elif isinstance(value, np.ndarray | int | float) and np.asarray(value).dtype.kind in "iufbUO":
            yield f"{prefix}{name}", value
