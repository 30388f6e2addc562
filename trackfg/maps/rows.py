"""Data frames and matrices are written to the tables and read from them here.

A statement per row through SQLAlchemy's own layer costs 30 us on PostgreSQL: 12 s for 100 km. So frames go in by what
each database has for it: ``executemany`` of prepared tuples in SQLite, ``COPY`` in PostgreSQL.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Iterator, Sequence
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.csv

from trackfg.maps.feature_map import INTEGER_COLUMNS, TEXT_COLUMNS
from trackfg.maps.schema import ROWS_PER_VERSION, Schema
from trackfg.maps.sql import sa
from trackfg.numerics.arrays import Array

Column: TypeAlias = "np.ndarray | pd.Series"

_AT_A_TIME = 50_000
"""Rows that are converted at a time."""


def insert_frame(connection: sa.Connection, table: sa.Table, version: int, frame: pd.DataFrame) -> None:
    """Add the rows of one version; NaN becomes NULL. ``frame`` has the table's columns after ``fid, version``."""
    names = [column.name for column in table.columns]
    for start in range(0, len(frame), _AT_A_TIME):
        part = frame.iloc[start : start + _AT_A_TIME]
        fid = version * ROWS_PER_VERSION + start + np.arange(len(part))
        columns: list[Column] = [fid, np.full(len(part), version), *(part[name] for name in names[2:])]
        if connection.dialect.name == "postgresql":
            _copy(connection, table, names, columns)
        else:
            marks = ", ".join("?" * len(names))
            statement = f"INSERT INTO {_quoted(connection, table, names)} VALUES ({marks})"
            values = [column.tolist() for column in columns]  # Python's numbers; SQLite stores NaN as NULL by itself
            connection.exec_driver_sql(statement, list(zip(*values, strict=True)))


def _copy(connection: sa.Connection, table: sa.Table, names: list[str], columns: list[Column]) -> None:
    """Copy columns into a table: numbers so that they read back exactly, an empty text quoted, a NULL not."""
    kinds = [pa.string() if isinstance(table.c[name].type, sa.Text) else None for name in names]
    arrays = [pa.array(column, kind, from_pandas=True) for column, kind in zip(columns, kinds, strict=True)]
    batch = pa.table(arrays, names=names)
    text = io.BytesIO()
    pyarrow.csv.write_csv(batch, text, pyarrow.csv.WriteOptions(include_header=False, quoting_style="needed"))
    statement = f"COPY {_quoted(connection, table, names)} FROM STDIN (FORMAT csv)"
    cursor = connection.connection.cursor()
    try:
        with cursor.copy(statement) as copy:
            copy.write(text.getbuffer())
    except connection.dialect.loaded_dbapi.Error as error:  # SQLAlchemy does not see what its driver does here
        raise sa.exc.DBAPIError(statement, None, error) from error
    finally:
        cursor.close()


def _quoted(connection: sa.Connection, table: sa.Table, names: list[str]) -> str:
    quote = connection.dialect.identifier_preparer
    return f"{quote.format_table(table)} ({', '.join(quote.quote(name) for name in names)})"


def read_frame(connection: sa.Connection, table: sa.Table, version: int) -> pd.DataFrame:
    """Return the rows of one version in their order, without ``fid, version``; NULL numbers become NaN.

    Raises ``ValueError`` where one before the last is missing: rows are numbered without a gap.
    """
    wanted = list(table.columns)[2:]
    first = version * ROWS_PER_VERSION
    chosen = (table.c.fid >= first) & (table.c.fid < first + ROWS_PER_VERSION)
    count, last = connection.execute(sa.select(sa.func.count(), sa.func.max(table.c.fid)).where(chosen)).one()
    if count and count != last - first + 1:
        raise ValueError(f"{table.name}: rows are missing ({last - first + 1 - count}); expected all that were written")
    result = connection.execute(sa.select(*wanted).where(chosen).order_by(table.c.fid))
    parts = list(_parts(result, [column.name for column in wanted]))
    return pd.concat(parts, ignore_index=True) if len(parts) > 1 else parts[0]


def _parts(result: sa.CursorResult[tuple[object, ...]], names: list[str]) -> Iterator[pd.DataFrame]:
    """Yield some thousand rows at a time, because Python's numbers take five times the memory of the frame's."""
    while True:
        rows = result.fetchmany(_AT_A_TIME)
        columns = list(zip(*rows, strict=True)) or [()] * len(names)
        yield pd.DataFrame({name: _series(name, values) for name, values in zip(names, columns, strict=True)})
        if len(rows) < _AT_A_TIME:
            return


def _series(name: str, values: tuple[object, ...]) -> pd.Series:
    if name in INTEGER_COLUMNS:
        return pd.Series(values, dtype="int64")
    if name in TEXT_COLUMNS or name.endswith("_sha256"):
        return pd.Series(values, dtype="str" if None not in values else "object")
    return pd.Series(np.array(values, dtype=np.float64))


Matrix: TypeAlias = tuple[tuple[str, ...], Array]
"""A matrix of float64, (m, n), after the names of its columns."""

_ADDRESSES_AT_A_TIME = 500
"""Matrices that are looked up at a time: some MB of them, and fewer parameters than any database allows."""


def put_matrices(connection: sa.Connection, schema: Schema, matrices: Sequence[Matrix]) -> list[str]:
    """Store matrices, unless they are there. Returns their addresses, SHA-256."""
    rows: dict[str, dict[str, Any]] = {}
    addresses = []
    for names, values in matrices:
        column_names = json.dumps(names, ensure_ascii=False)
        data = np.ascontiguousarray(values, dtype="<f8").tobytes()
        address = hashlib.sha256(column_names.encode() + b"\0" + data).hexdigest()
        rows[address] = {"sha256": address, "column_names": column_names, "row_count": len(values), "data": data}
        addresses.append(address)
    stored = schema.matrices.c.sha256
    for row in _at(connection, stored, addresses, stored):
        rows.pop(row[0], None)
    if rows:
        connection.execute(schema.matrices.insert(), list(rows.values()))
    return addresses


def get_matrices(connection: sa.Connection, schema: Schema, addresses: Sequence[str]) -> dict[str, Matrix]:
    """Return matrices by address. Raises ``ValueError`` where one is missing or damaged."""
    stored = schema.matrices.c
    matrices = {}
    columns = stored.sha256, stored.column_names, stored.row_count, stored.data
    for row in _at(connection, stored.sha256, addresses, *columns):
        address, column_names, row_count, data = row
        names = tuple(str(name) for name in json.loads(column_names))
        values = np.frombuffer(data, dtype="<f8")
        if values.size != row_count * len(names):
            raise ValueError(f"matrix {address} has {values.size} numbers: expected {row_count} x {len(names)}")
        matrices[address] = names, values.reshape(row_count, len(names)).astype(np.float64)
    if missing := [address for address in addresses if address not in matrices]:
        raise ValueError(f"matrix {missing[0]} is missing")
    return matrices


def _at(
    connection: sa.Connection, column: sa.Column[Any], values: Sequence[str], *wanted: sa.Column[Any]
) -> Iterator[tuple[Any, ...]]:
    """Yield the wanted columns of the rows that have one of some values in a column."""
    for start in range(0, len(values), _ADDRESSES_AT_A_TIME):
        part = values[start : start + _ADDRESSES_AT_A_TIME]
        yield from map(tuple, connection.execute(sa.select(*wanted).where(column.in_(part))))
