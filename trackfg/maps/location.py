"""The location of a map is the path of a GeoPackage (``.gpkg``), or the URL of a PostgreSQL database.

One database schema holds one map: ``postgresql://host/database?schema=NAME``, :data:`DEFAULT_SCHEMA` without. All else
in the URL goes to the driver as it is.
"""

from __future__ import annotations

import os
import re
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from urllib.parse import quote

from trackfg.errors import BadInputError, OutputError, TrackfgError, printable
from trackfg.maps.schema import Schema, map_schema
from trackfg.maps.sql import sa

DEFAULT_SCHEMA = "trackfg"
"""Database schema of a URL that names none."""

Purpose = Literal["read", "write", "create"]

_EXPECTED = "expected the path of a .gpkg file or a postgresql:// URL"
_LOCK_WAIT_S = 120.0
"""How long a connection waits for another writer of the same file, s."""
_POSTGRESQL = {"postgresql", "postgres", "postgresql+psycopg"}
"""Schemes of a URL of PostgreSQL."""
_SQLITE_MAGIC = b"SQLite format 3\0"
"""First bytes of an SQLite file."""


@dataclass(frozen=True)
class Location:
    """A map's place. ``shown`` names it in messages, without a password; ``name`` is what a map made here is called.

    ``path`` is None for a database, ``url`` for a file.
    """

    shown: str
    name: str
    schema: Schema
    path: Path | None = None
    url: sa.URL | None = None

    @contextmanager
    def connect(self, purpose: Purpose) -> Iterator[sa.Connection]:
        """Open a transaction: committed at the end of the block, undone with an exception or when the process dies.

        To ``create`` is to write, where there may be no file yet. Raises :class:`BadInputError` for what cannot be
        opened or is refused by the database, :class:`OutputError` where a disk is full, and :class:`TrackfgError` where
        it stays locked or has no driver. No new file is left where nothing was written into it.
        """
        is_new = purpose == "create" and self.path is not None and not self.path.exists()
        engine = self._file_engine(purpose) if self.path is not None else self._server_engine()
        try:
            with engine.begin() as connection:
                yield connection
        except sa.exc.DBAPIError as error:
            raise self._explained(error) from error
        except sa.exc.InvalidRequestError as error:
            raise BadInputError(f"{self.shown}: {printable(str(error))}; expected a feature map") from error
        except UnicodeError as error:
            raise BadInputError(f"{self.shown}: a name in it is no text; expected a feature map") from error
        finally:
            engine.dispose()
            if is_new and self.path is not None and self.path.exists() and self.path.stat().st_size == 0:
                self.path.unlink()

    def _file_engine(self, purpose: Purpose) -> sa.Engine:
        """Return an engine that opens by URI.

        With ``rw`` it makes no file, also where it could only be read, and undoes a killed write.
        """
        path = self.path
        assert path is not None
        _refuse_unless_sqlite(path, may_be_absent=purpose == "create")
        uri = f"file:{quote(os.fsencode(path.absolute()))}?mode={'rwc' if purpose == 'create' else 'rw'}"

        def open_file() -> sqlite3.Connection:
            connection = sqlite3.connect(uri, uri=True, timeout=_LOCK_WAIT_S, isolation_level=None)
            connection.execute("PRAGMA trusted_schema = OFF")  # functions in a file's schema have no side effects
            connection.execute("PRAGMA cache_spill = OFF")  # readers wait for the commit alone, not for the whole write
            return connection

        engine = sa.create_engine("sqlite://", creator=open_file, poolclass=sa.NullPool)

        @sa.event.listens_for(engine, "begin")
        def begin(connection: sa.Connection) -> None:
            connection.exec_driver_sql("BEGIN" if purpose == "read" else "BEGIN IMMEDIATE")

        return engine

    def _server_engine(self) -> sa.Engine:
        assert self.url is not None
        try:
            return sa.create_engine(self.url, poolclass=sa.NullPool)
        except ImportError as error:
            raise TrackfgError(f"{self.shown}: needs a driver: pip install 'trackfg[postgres]'") from error

    def _explained(self, error: sa.exc.DBAPIError) -> TrackfgError:
        reason = printable(" ".join(str(error.orig).split()))
        if "locked" in reason and self.path is not None:
            return TrackfgError(f"{self.shown}: another process has kept it locked for {_LOCK_WAIT_S:g} s")
        if getattr(error.orig, "sqlite_errorcode", None) == sqlite3.SQLITE_FULL:
            return OutputError(f"{self.shown}: cannot be written ({reason})")
        if reason.startswith("no such column"):
            return BadInputError(f"{self.shown}: {reason}; expected the columns of a feature map, by their names")
        return BadInputError(f"{self.shown}: {reason}")


def locate(location: str | os.PathLike[str]) -> Location:
    """Return where a map is; nothing is opened.

    Raises :class:`BadInputError` for anything but the path of a ``.gpkg`` and the URL of a PostgreSQL database. Its
    message repeats a path, of anything that may hold a password only what comes before its first colon.
    """
    text = os.fspath(location)
    if scheme := re.match(r"([A-Za-z][A-Za-z0-9+.-]*)://", text):
        if scheme[1] not in _POSTGRESQL:
            raise BadInputError(f"{scheme[0]}...: {_EXPECTED}")
        return _database(text)
    path = Path(text)
    scheme = re.match(r"\s*([A-Za-z][A-Za-z0-9+.-]*)\s*:", text)
    if path.suffix.lower() != ".gpkg" or "\0" in text or (scheme and scheme[1].lower() in _POSTGRESQL):
        shown = f"{scheme[1]}:..." if scheme else repr(text) if re.fullmatch(r"[^@=?]*", text) else "the map"
        raise BadInputError(f"{shown}: {_EXPECTED}")
    return Location(str(path), path.stem, map_schema(None), path=path)


def _database(text: str) -> Location:
    expected = "expected postgresql://USER@HOST/DATABASE?schema=NAME"
    try:
        url = sa.make_url(text)
    except (sa.exc.ArgumentError, ValueError) as error:
        raise BadInputError(f"not a URL of a database: {expected}") from error
    if "@" in f"{url.host}{url.database}":  # a password with an @ or a / in it, part of which is taken for these
        raise BadInputError(f"not a URL of a database: {expected}. Hint: write @ as %40 and / as %2F in a password")
    schema = url.query.get("schema", DEFAULT_SCHEMA)
    if (
        not isinstance(schema, str)
        or not re.fullmatch(r"[a-z_][a-z0-9_]{0,62}", schema)
        or schema.startswith(("pg_", "information_schema"))
    ):
        raise BadInputError(f"schema {schema!r}: expected one name of small letters, digits and underscores")
    shown = url.set(drivername="postgresql", query={"schema": schema}).render_as_string(hide_password=True)
    driver = url.set(drivername="postgresql+psycopg").difference_update_query(["schema"])
    return Location(shown, schema, map_schema(schema), url=driver)


def _refuse_unless_sqlite(path: Path, may_be_absent: bool) -> None:
    """Raise ``BadInputError`` for no SQLite file; an empty one is what a killed first write leaves."""
    try:
        if path.exists() and not path.is_file():
            raise BadInputError(f"{path}: is no regular file; expected a feature map")
        with path.open("rb") as file:
            head = file.read(len(_SQLITE_MAGIC))
    except FileNotFoundError as error:
        if may_be_absent and path.parent.is_dir():
            return
        raise BadInputError(f"{path}: no such file; expected a feature map") from error
    except OSError as error:
        raise BadInputError(f"{path}: {error.strerror}; expected a feature map") from error
    if head and head != _SQLITE_MAGIC:
        raise BadInputError(f"{path}: is not a GeoPackage; expected a feature map")
