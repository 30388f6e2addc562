"""Faults of inputs: each takes a file of a case's folder and a random generator, and returns what it did in words."""

from __future__ import annotations

import json
import os
import re
import shutil
import sqlite3
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import tomli_w

Damage = Callable[[Path, np.random.Generator], str]

HOSTILE: tuple[Any, ...] = (
    0.0, -1.0, 1.0, float("nan"), float("inf"), -float("inf"), 1e300, -1e300, 5e-324, 1e-300, 1e9, -1e9, 2**63, 10**30,
    True, "", "1", "x" * 5000, "\0", "\x1b[31m", "[/markup]", "=1+1", "../../etc/passwd", "\u202e", [], {}, None,
)  # fmt: skip
"""Values for numbers, texts, lists and tables alike."""
NUMBERS = tuple(value for value in HOSTILE if isinstance(value, float))
_TABLES = (".csv", ".parquet")
_STREAM = ".jsonl"
"""Read as standard input, which may go on for ever: it is given no endless one."""
_STEPS_S = (-1e9, -3600.0, -1.0, 1.0, 60.0, 1e5, 1e9, 1e12)


def bytes_changed(path: Path, rng: np.random.Generator) -> str:
    """Flip, cut, repeat, insert or zero bytes."""
    content = bytearray(path.read_bytes())
    at = int(rng.integers(len(content) + 1))
    some = int(min(2 ** rng.integers(1, 12), len(content)))
    kind = rng.choice(["flip", "cut", "empty", "repeat", "insert", "zero", "lose"])
    if kind == "flip":
        for i in rng.integers(max(len(content), 1), size=int(rng.integers(1, 20))):
            if content:
                content[i] ^= 1 << int(rng.integers(8))
    elif kind == "cut":
        del content[at:]
    elif kind == "empty":
        content.clear()
    elif kind == "repeat":
        content[at:at] = content[at : at + some]
    elif kind == "insert":
        content[at:at] = rng.bytes(some)
    elif kind == "zero":
        content[at : at + some] = bytes(len(content[at : at + some]))
    else:
        del content[at : at + some]
    path.write_bytes(content)
    return f"{path.name}: {kind} at byte {at} ({some})"


def value_changed(path: Path, rng: np.random.Generator) -> str:
    """Put hostile values into a table, a text of TOML or JSON, a database, or XML."""
    if path.suffix in _TABLES:
        return _cells(path, rng)
    if path.suffix in (".toml", ".json"):
        return _leaf(path, rng, lambda: HOSTILE[rng.integers(len(HOSTILE))])
    if path.suffix == ".gpkg":
        return _field(path, rng)
    if path.suffix == ".jsonl":
        return _json_rows(path, rng)
    return _number_in_text(path, rng)


def structure_changed(path: Path, rng: np.random.Generator) -> str:
    """Lose, rename, double, retype or reorder columns, rows, keys or tables."""
    if path.suffix in _TABLES:
        return _columns(path, rng)
    if path.suffix in (".toml", ".json"):
        return _keys(path, rng)
    if path.suffix == ".gpkg":
        return _schema(path, rng)
    lines = path.read_bytes().split(b"\n" if path.suffix == ".jsonl" else b"<")
    kind = rng.choice(["shuffle", "lose half", "double", "reverse"])
    body = lines[1:]
    if kind == "shuffle":
        rng.shuffle(body)
    elif kind == "lose half":
        body = [line for line in body if rng.random() < 0.5]
    elif kind == "double":
        body = [line for line in body for _ in range(2)]
    else:
        body.reverse()
    path.write_bytes((b"\n" if path.suffix == ".jsonl" else b"<").join([lines[0], *body]))
    return f"{path.name}: {kind}"


def size_changed(path: Path, rng: np.random.Generator) -> str:
    """Make a file absurdly large, deep or wide."""
    kind = rng.choice(["sparse", "long line", "deep", "many", "repeated"])
    if kind == "sparse":
        with path.open("ab") as file:
            file.truncate(path.stat().st_size + (2**30 if path.suffix == _STREAM else 50 * 2**30))
    elif kind == "repeated":
        content = path.read_bytes()
        with path.open("ab") as file:
            for _ in range(int(min(50, 2**24 // max(len(content), 1)))):
                file.write(content)
    else:
        text = {
            "long line": "x" * 20_000_000,
            "deep": {".toml": "a." * 100_000 + "a = 1", ".json": "[" * 200_000}.get(path.suffix, "<a>" * 100_000),
            "many": "".join(f"k{i} = {i}\n" for i in range(200_000)),
        }[str(kind)]
        if rng.random() < 0.5:
            path.write_text(text)
        else:
            with path.open("a") as file:
                file.write("\n" + text)
    return f"{path.name}: {kind}"


def link_put(path: Path, rng: np.random.Generator) -> str:
    """Put a pipe, a device, a folder, a link or nothing in the place of a file."""
    kind = str(rng.choice(["absent", "pipe", "zero", "null", "loop", "outside", "folder", "dangling"]))
    path.unlink()
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind != "absent":
        endless = "/dev/null" if path.suffix == _STREAM else "/dev/zero"
        targets = {"zero": endless, "null": "/dev/null", "loop": path.name, "outside": "/etc/passwd"}
        path.symlink_to(targets.get(kind, "no/where"))
    return f"{path.name}: {kind}"


def clock_changed(path: Path, rng: np.random.Generator) -> str:
    """Shift, scale, jump, reverse or stop the times of a table; of another file, as :func:`value_changed`."""
    if path.suffix not in _TABLES:
        return value_changed(path, rng)
    table = _read(path)
    name = next((name for name in table if name in ("t_s", "t")), None)
    if name is None:
        return value_changed(path, rng)
    t, first = table[name].to_numpy(dtype=float).copy(), int(rng.integers(len(table) or 1))
    kind, step = str(rng.choice(["shift", "scale", "jump", "row", "reverse", "stop"])), float(rng.choice(_STEPS_S))
    if kind == "shift":
        t += step
    elif kind == "scale":
        t *= abs(step)
    elif kind == "jump":
        t[first:] += step
    elif kind == "row" and t.size:
        t[first] += step
    elif kind == "reverse":
        t = t[::-1]
    elif t.size:
        t[first:] = t[first]
    _write(path, table.assign(**{name: t}))
    return f"{path.name}: time {kind} by {step:g} s from row {first}"


def exchanged(path: Path, rng: np.random.Generator) -> str:
    """Put another file of the case in the place of one."""
    others = sorted(other for other in path.parent.rglob("*") if other.is_file() and other != path)
    if not others:
        return bytes_changed(path, rng)
    other = others[rng.integers(len(others))]
    shutil.copy(other, path)
    return f"{path.name}: content of {other.name}"


FAULTS: dict[str, Damage] = {
    "bytes": bytes_changed,
    "values": value_changed,
    "structure": structure_changed,
    "size": size_changed,
    "links": link_put,
    "clocks": clock_changed,
    "exchange": exchanged,
}


def _read(path: Path) -> pd.DataFrame:
    return pd.read_csv(path) if path.suffix == ".csv" else pd.read_parquet(path)


def _write(path: Path, table: pd.DataFrame) -> None:
    if path.suffix == ".csv":
        table.to_csv(path, index=False)
    else:
        table.to_parquet(path)


def _cells(path: Path, rng: np.random.Generator) -> str:
    table = _read(path)
    if not table.size:
        return f"{path.name}: is empty"
    name = table.columns[rng.integers(table.shape[1])]
    first = int(rng.integers(len(table)))
    last = first + int(rng.choice([1, 1, 10, len(table)]))
    kind, value = str(rng.choice(["put", "scale", "negate", "hold", "shuffle"])), NUMBERS[rng.integers(len(NUMBERS))]
    column = table[name].copy()
    if column.dtype.kind not in "fiu":
        column = column.astype(object)
        kind, value = "put", HOSTILE[rng.integers(len(HOSTILE) - 3)]
    elif kind != "put":
        column = column.astype(float)
    part = slice(first, last)
    if kind == "put":
        column = column.astype(float) if column.dtype.kind in "fiu" else column
        column.iloc[part] = str(value) if column.dtype == object else value
    elif kind == "scale":
        column.iloc[part] *= 10.0 ** rng.integers(-12, 13)
    elif kind == "negate":
        column.iloc[part] = -column.iloc[part]
    elif kind == "hold":
        column.iloc[part] = column.iloc[first]
    else:
        column.iloc[part] = rng.permutation(column.iloc[part].to_numpy())
    _write(path, table.assign(**{name: column}))
    return f"{path.name}: {kind} {value!r:.40} in {name}, rows {first} to {last}"


def _columns(path: Path, rng: np.random.Generator) -> str:
    table = _read(path)
    kind = str(rng.choice(["drop", "rename", "text", "one row", "no rows", "reverse", "shuffle", "double", "integers"]))
    name = table.columns[rng.integers(table.shape[1])]
    if kind == "drop":
        table = table.drop(columns=name)
    elif kind == "rename":
        table = table.rename(columns={name: str(HOSTILE[rng.integers(15, 22)])[:50]})
    elif kind == "text":
        table = table.assign(**{name: table[name].astype(str) + "x"})
    elif kind == "integers":
        table = table.assign(**{name: np.arange(len(table))})
    elif kind == "double":
        table = pd.concat([table, table], ignore_index=True)
    elif kind == "shuffle":
        table = table.sample(frac=1.0, random_state=int(rng.integers(2**31))).reset_index(drop=True)
    else:
        table = {"one row": table[:1], "no rows": table[:0], "reverse": table[::-1].reset_index(drop=True)}[kind]
    _write(path, table)
    return f"{path.name}: {kind} ({name})"


def _leaves(content: Any) -> list[tuple[Any, Any]]:
    items = list(content.items()) if isinstance(content, dict) else list(enumerate(content))
    leaves = [(content, key) for key, _ in items]
    for _, value in items:
        if isinstance(value, dict | list):
            leaves += _leaves(value)
    return leaves


def _load(path: Path) -> Any:
    text = path.read_text()
    return tomllib.loads(text) if path.suffix == ".toml" else json.loads(text)


def _dump(path: Path, content: Any) -> None:
    if path.suffix == ".json":
        path.write_text(json.dumps(content))
        return
    try:
        path.write_text(tomli_w.dumps(content))
    except TypeError:  # TOML has no null
        path.write_text(json.dumps(content))


def _leaf(path: Path, rng: np.random.Generator, value: Callable[[], Any]) -> str:
    content = _load(path)
    leaves = _leaves(content)
    holder, key = leaves[rng.integers(len(leaves))]
    holder[key] = put = value()
    _dump(path, content)
    return f"{path.name}: {key} = {put!r:.40}"


def _keys(path: Path, rng: np.random.Generator) -> str:
    content = _load(path)
    leaves = _leaves(content)
    holder, key = leaves[rng.integers(len(leaves))]
    kind = str(rng.choice(["drop", "add", "list", "table", "many"]))
    if kind == "drop":
        del holder[key]
    elif kind == "add" and isinstance(holder, dict):
        holder[f"{key}x"] = 1
    elif kind == "many":
        holder[key] = [holder[key]] * 5000
    else:
        holder[key] = [holder[key]] if kind == "list" else {"x": holder[key]}
    _dump(path, content)
    return f"{path.name}: {kind} {key}"


def _sql(path: Path, statement: str, values: tuple[Any, ...] = ()) -> str:
    connection = sqlite3.connect(path)
    try:
        connection.execute(statement, values)
        connection.commit()
    except sqlite3.Error as error:
        return f"{path.name}: {statement[:80]} ({error})"
    finally:
        connection.close()
    return f"{path.name}: {statement[:80]} {values!r:.60}"


def _tables_of(path: Path) -> list[str]:
    connection = sqlite3.connect(path)
    names = [row[0] for row in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table' ORDER BY name")]
    connection.close()
    return [name for name in names if not name.startswith("sqlite_")]


def _field(path: Path, rng: np.random.Generator) -> str:
    names = _tables_of(path)
    table = names[rng.integers(len(names))]
    connection = sqlite3.connect(path)
    columns = [row[1] for row in connection.execute(f'PRAGMA table_info("{table}")')]
    connection.close()
    column = columns[rng.integers(len(columns))]
    value = HOSTILE[rng.integers(len(HOSTILE))]
    stored = json.dumps(value) if isinstance(value, list | dict) else value
    stored = 2**63 - 1 if isinstance(stored, int) and stored >= 2**63 else stored
    which = "" if rng.random() < 0.3 else f' WHERE rowid = (SELECT max(rowid) FROM "{table}")'
    return _sql(path, f'UPDATE "{table}" SET "{column}" = ?{which}', (stored,))


def _schema(path: Path, rng: np.random.Generator) -> str:
    names = _tables_of(path)
    table = names[rng.integers(len(names))]
    statements = (
        f'DROP TABLE "{table}"',
        f'DELETE FROM "{table}"',
        f'ALTER TABLE "{table}" RENAME TO "other"',
        f'DELETE FROM "{table}" WHERE rowid = (SELECT min(rowid) FROM "{table}")',
        f'CREATE TRIGGER evil AFTER INSERT ON "{table}" BEGIN DELETE FROM "{table}"; END',
        f'CREATE TRIGGER ignore BEFORE INSERT ON "{table}" BEGIN SELECT RAISE(IGNORE); END',
        "PRAGMA user_version = 999999",
        "PRAGMA application_id = 1",
    )
    return _sql(path, statements[rng.integers(len(statements))])


def _json_rows(path: Path, rng: np.random.Generator) -> str:
    lines = path.read_text().splitlines()
    share = float(rng.choice([1e-3, 0.1, 1.0]))
    key = str(rng.choice(["t_s", "wx_radps", "fz_mps2", "count", "table"]))
    value = HOSTILE[rng.integers(len(HOSTILE))]
    for i in range(1, len(lines)):
        if rng.random() < share:
            row = json.loads(lines[i])
            if key in row:
                row[key] = value
                lines[i] = json.dumps(row)
    path.write_text("\n".join(lines) + "\n")
    return f"{path.name}: {key} = {value!r:.40} in {100 * share:g} % of the rows"


def _number_in_text(path: Path, rng: np.random.Generator) -> str:
    """Change one number of a text, XML or MCAP alike, to another one."""
    content = path.read_bytes()
    places = [digit.start(1) for digit in re.finditer(rb'[" ,:\[\-.]([0-9])', content)]
    if not places:
        return bytes_changed(path, rng)
    at = places[rng.integers(len(places))]
    end = at
    while end < len(content) and chr(content[end]) in "0123456789.eE+-":
        end += 1
    value = str(NUMBERS[rng.integers(len(NUMBERS))]).encode()
    path.write_bytes(content[:at] + value + content[end:])
    return f"{path.name}: {content[at:end].decode()[:20]} becomes {value.decode()} at byte {at}"
