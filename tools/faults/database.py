"""Maps in PostgreSQL: each case has a database of its own, copied from the sound one, which is damaged by SQL."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from faults.damage import HOSTILE
from faults.server import Server

SOUND = "sound"
"""Database with the sound map."""
_NOTHING_LEFT = "nothing is left to damage"


@contextmanager
def copied(server: Server, name: str) -> Iterator[str]:
    """Copy the sound database and yield its map's URL; it is removed in the end."""
    server.sql("postgres", f'CREATE DATABASE "{name}" TEMPLATE {SOUND}')
    try:
        yield server.url(name, "trackfg")
    finally:
        server.sql("postgres", f'DROP DATABASE "{name}" WITH (FORCE)')


def values_changed(server: Server, name: str, rng: np.random.Generator) -> str:
    """Put a hostile value into a column of one row or of all."""
    columns = server.sql(
        name,
        "SELECT table_name || ' ' || column_name || ' ' || data_type FROM information_schema.columns "
        "WHERE table_schema = 'trackfg' ORDER BY table_name, ordinal_position",
    ).splitlines()
    if not columns:
        return _NOTHING_LEFT
    table, column, kind = columns[rng.integers(len(columns))].split(" ", 2)
    value = HOSTILE[rng.integers(len(HOSTILE))]
    which = "" if rng.random() < 0.5 else f' WHERE ctid = (SELECT max(ctid) FROM trackfg."{table}")'
    statement = f'UPDATE trackfg."{table}" SET "{column}" = {_literal(value)}::{kind.split()[0]}{which}'
    if "timestamp" in kind or kind == "USER-DEFINED":
        statement = f'UPDATE trackfg."{table}" SET "{column}" = NULL{which}'
    return _changed(server, name, statement)


def structure_changed(server: Server, name: str, rng: np.random.Generator) -> str:
    """Lose, rename, retype or guard a table, a column or rows."""
    tables = server.sql(name, "SELECT tablename FROM pg_tables WHERE schemaname = 'trackfg' ORDER BY 1").splitlines()
    if not tables:
        return _NOTHING_LEFT
    table = tables[rng.integers(len(tables))]
    columns = server.sql(
        name,
        "SELECT column_name FROM information_schema.columns "
        f"WHERE table_schema = 'trackfg' AND table_name = '{table}' ORDER BY ordinal_position",
    ).splitlines()
    if not columns:
        return _NOTHING_LEFT
    column, place = columns[rng.integers(len(columns))], f'trackfg."{table}"'
    statements = (
        f"DROP TABLE {place} CASCADE",
        f"DELETE FROM {place}",
        f"DELETE FROM {place} WHERE ctid = (SELECT min(ctid) FROM {place})",
        f'ALTER TABLE {place} RENAME TO "other"',
        f'ALTER TABLE {place} DROP COLUMN "{column}" CASCADE',
        f'ALTER TABLE {place} RENAME COLUMN "{column}" TO "other"',
        f'ALTER TABLE {place} ALTER COLUMN "{column}" DROP NOT NULL',
        f'ALTER TABLE {place} ALTER COLUMN "{column}" TYPE text USING "{column}"::text',
        f'ALTER TABLE {place} ADD COLUMN "more" integer NOT NULL DEFAULT 1',
        f"CREATE RULE ignored AS ON INSERT TO {place} DO INSTEAD NOTHING",
        "DROP SCHEMA trackfg CASCADE",
    )
    return _changed(server, name, statements[rng.integers(len(statements))])


FAULTS = {"values": values_changed, "structure": structure_changed}


def _literal(value: Any) -> str:
    if value is None:
        return "NULL"
    text = json.dumps(value) if isinstance(value, list | dict | bool) else str(value)
    return "'" + text.replace("'", "''").replace("\0", "") + "'"


def _changed(server: Server, name: str, statement: str) -> str:
    try:
        server.sql(name, statement)
    except AssertionError as error:  # the database holds on to what it was to keep
        return f"{statement[:120]} ({str(error).strip()[:80]})"
    return statement[:160]
