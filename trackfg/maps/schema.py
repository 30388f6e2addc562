"""The tables of a stored map, the same in GeoPackage and PostgreSQL; docs/maps-storage.md has every column.

A version is never changed: each write adds rows. The tables of a version's rows (``map_landmarks``, ``map_line``,
``map_grid``, ``map_runs``) number them ``fid = version * 2^32 + row``, so that the primary key alone finds a version,
in its order, without an index beside. ``map_matrices`` is addressed by content: what a run contributed is stored once,
however many versions hold it.

Column types are those that GeoPackage allows and PostgreSQL has too; JSON and times are text.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from trackfg.maps.feature_map import (
    GRID_COLUMNS,
    INTEGER_COLUMNS,
    LANDMARK_COLUMNS,
    LINE_COLUMNS,
    RUN_COLUMNS,
    TEXT_COLUMNS,
)
from trackfg.maps.sql import sa

FORMAT = "trackfg-map/1"
"""Format of a stored map; a newer one has a greater number."""
ROWS_PER_VERSION = 2**32
"""Row numbers of each version in a table."""

KEY = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
"""In SQLite only INTEGER, which has 64 bits there, can be the row's own number, as GeoPackage demands."""

_INTEGER = sa.Integer()
_NUMBER: sa.Double[float] = sa.Double()
_TEXT = sa.Text()
_BYTES = sa.LargeBinary()


@dataclass(frozen=True)
class Schema:
    """The tables of a map in one database schema (PostgreSQL), or in a file (``schema`` None)."""

    metadata: sa.MetaData
    format: sa.Table
    versions: sa.Table
    landmarks: sa.Table
    line: sa.Table
    grid: sa.Table
    runs: sa.Table
    matrices: sa.Table


def map_schema(schema: str | None) -> Schema:
    """Return the tables, in the order in which they can be created."""
    metadata = sa.MetaData(schema=schema)

    def table(name: str, *columns: sa.Column[Any]) -> sa.Table:
        return sa.Table(name, metadata, *columns, sqlite_autoincrement=True)

    def key(name: str = "fid") -> sa.Column[Any]:
        return sa.Column(name, KEY, primary_key=True)

    def rows(name: str, columns: tuple[str, ...], *more: sa.Column[Any]) -> sa.Table:
        version = sa.Column("version", _INTEGER, nullable=False)
        return table(name, key(), version, *map(data_column, columns), *more)

    return Schema(
        metadata,
        format=table("map_format", key(), sa.Column("format", _TEXT, nullable=False)),
        matrices=table(
            "map_matrices",
            key(),
            sa.Column("sha256", _TEXT, nullable=False, unique=True),
            sa.Column("column_names", _TEXT, nullable=False),
            sa.Column("row_count", _INTEGER, nullable=False),
            sa.Column("data", _BYTES, nullable=False),
        ),
        versions=table(
            "map_versions",
            key("version"),
            sa.Column("parent", KEY, unique=True),
            sa.Column("written_at", _TEXT, nullable=False),
            sa.Column("name", _TEXT, nullable=False),
            *(sa.Column(name, _NUMBER, nullable=False) for name in CONVENTION_COLUMNS),
            *(sa.Column(name, _NUMBER) for name in ORIGIN_COLUMNS),
            sa.Column("configuration", _TEXT, nullable=False),
            sa.Column("software", _TEXT, nullable=False),
            sa.Column("covariance_sha256", _TEXT, nullable=False),
            sa.Column(POOLED, _TEXT),
        ),
        landmarks=rows("map_landmarks", LANDMARK_COLUMNS),
        line=rows("map_line", LINE_COLUMNS),
        grid=rows("map_grid", GRID_COLUMNS),
        runs=rows("map_runs", RUN_COLUMNS, sa.Column("information_sha256", _TEXT)),
    )


POOLED = "pooled_sha256"
"""Column that maps begun by earlier versions of trackfg do not have."""

CONVENTION_COLUMNS = ("gauge_m", "cross_level_base_m", "curvature_base_m", "gradient_base_m", "chord_m", "step_m")
ORIGIN_COLUMNS = ("origin_latitude_deg", "origin_longitude_deg", "origin_height_m")


def data_column(name: str) -> sa.Column[Any]:
    """Return a column of a data frame. Numbers may be NULL, which is NaN in memory."""
    if name in TEXT_COLUMNS:
        return sa.Column(name, _TEXT, nullable=False)
    if name in INTEGER_COLUMNS:
        return sa.Column(name, _INTEGER, nullable=False)
    return sa.Column(name, _NUMBER)
