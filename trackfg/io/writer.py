"""Write a recording in its canonical form: SI, FLU, one clock, columns named as in :mod:`trackfg.recording.model`.

Reading it gives the same tables: bit by bit from Parquet, and from CSV too, since numbers are written with as many
digits as identify the double.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.csv
import tomli_w

from trackfg.errors import BadInputError
from trackfg.files.atomic_folder import real_path, replaced_folder
from trackfg.files.parquet import write_parquet
from trackfg.io.balises import balises_written
from trackfg.io.content import named_files
from trackfg.io.description_reader import FILE_NAME
from trackfg.io.features import LOCAL
from trackfg.io.formats.registry import FORMATS, format_of, sensors_of
from trackfg.io.formats.sensor_format import TIME_COLUMN, SensorFormat, WrittenTable
from trackfg.io.known_lines import line_written
from trackfg.recording.description import KnownLineFile, RecordingDescription, Truth
from trackfg.recording.model import Recording

TableFormat = Literal["parquet", "csv"]
KNOWN_LINE_FILE = "known_line.geojson"
"""The tracks of a recording as it is written."""


def write_recording(
    recording: Recording,
    folder: Path | str,
    *,
    table_format: TableFormat = "parquet",
    truth: pd.DataFrame | None = None,
    truth_geometry: pd.DataFrame | None = None,
) -> Path:
    """Write a recording as a folder, which appears complete or not at all (:mod:`trackfg.files.atomic_folder`).

    Parameters
    ----------
    recording
        What is written, in its canonical form.
    folder
        Where; a recording that is there already is replaced.
    table_format
        Of the tables: ``"parquet"`` or ``"csv"``.
    truth
        What is known to be true, with ``t_s`` in s and columns of a trajectory.
    truth_geometry
        The true geometry, with ``chainage_m`` in m; needs ``truth``.

    Returns
    -------
    pathlib.Path
        The folder.

    Raises
    ------
    BadInputError
        Where ``folder`` is anything else than free, empty or a recording with nothing but its own files, where it is
        the one that ``recording`` was read from, and where a table lacks a column.

    Examples
    --------
    >>> import trackfg
    >>> recording = trackfg.read_recording("run1")
    >>> folder = trackfg.write_recording(recording, "copy", table_format="csv")
    >>> sorted(path.name for path in folder.iterdir())
    ['imu.csv', 'recording.toml', 'tach.csv']
    >>> trackfg.read_recording(folder).imu.equals(recording.imu)
    True
    """
    folder = Path(folder)
    _refuse_to_destroy(folder, recording)
    if truth_geometry is not None and truth is None:
        raise BadInputError("truth_geometry without truth: expected both")
    description, tables = canonical_form(recording, table_format)
    if truth is not None:
        geometry_file = None if truth_geometry is None else f"truth_geometry.{table_format}"
        answer = Truth(file=f"truth.{table_format}", time="t_s", geometry=geometry_file)
        description = description.model_copy(update={"truth": answer})
        tables[answer.file] = _having(truth, "t_s", answer.file)
        if geometry_file is not None and truth_geometry is not None:
            tables[geometry_file] = _having(truth_geometry, "chainage_m", geometry_file)
    with replaced_folder(folder) as new:
        for file, table in tables.items():
            write_table(table, new / file)
        if recording.known_line is not None:
            (new / KNOWN_LINE_FILE).write_bytes(line_written(recording.known_line))
        content = _with_tachs_together(description.model_dump(exclude_none=True))  # TOML has no null
        (new / FILE_NAME).write_text(tomli_w.dumps(content), encoding="utf-8")
    return folder


def _with_tachs_together(data: dict[str, Any]) -> dict[str, Any]:
    """Return the description's further tachs as entries of ``[[tach]]``."""
    further = data.pop("further_tach")
    return {**data, "tach": [data["tach"], *further]} if further else data


def _having(table: pd.DataFrame, column: str, file: str) -> pd.DataFrame:
    if column not in table.columns:
        raise BadInputError(f"{file}: the table to write lacks {column}; expected {column}")
    return table


def canonical_form(recording: Recording, table_format: str) -> tuple[RecordingDescription, dict[str, pd.DataFrame]]:
    """Return the recording's description, but for files, columns and units, and the canonical tables by file."""
    description, tables = recording.description, recording.tables
    files: dict[str, pd.DataFrame] = {}
    described = dict(sensors_of(description))
    if unknown := sorted(set(tables) - set(described)):
        raise BadInputError(
            f"the recording has a {unknown[0]} table but its description has no [{unknown[0].partition('/')[0]}]"
        )
    missing = [name for name, part in described.items() if name not in tables and format_of(part).several]
    if missing:
        raise BadInputError(f"the recording describes {missing[0].partition('/')[0]}s without a table: {missing}")
    changes: dict[str, Any] = {"truth": None}
    for sensor in FORMATS:
        names = [name for name, part in described.items() if format_of(part) is sensor and name in tables]
        written = [sensor.written(described[name], _complete(sensor, name, tables[name])) for name in names]
        places = _places(sensor, written, table_format)
        parts = []
        for name, (keys, table), (file, column) in zip(names, written, places, strict=True):
            _add(files, file, table, column)
            clock = {"file": file, "time": TIME_COLUMN, "time_unit": "s", "time_offset_s": 0.0}
            shared = {} if column is None else {"column": column}
            parts.append(described[name].model_copy(update={**keys, **clock, **shared}))
        changes[sensor.key] = tuple(parts) if sensor.several else parts[0] if parts else None
    if changes["further_tach"] and changes["tach"] is None:
        further = next(name for name in described if name.startswith("tach/"))
        raise BadInputError(f"the recording has a {further} table but no first tach; expected a table tach, too")
    if changes["gnss"] is not None:
        origin = None if recording.gnss_origin is None else tuple(float(x) for x in recording.gnss_origin)
        changes["gnss"] = changes["gnss"].model_copy(update={"origin": origin})
    line = recording.known_line
    crs = LOCAL if line is not None and line.is_local else None
    changes["known_line"] = None if line is None else KnownLineFile(file=KNOWN_LINE_FILE, crs=crs)
    changes["balises"] = None
    if recording.balises is not None and description.balises is not None:
        file = f"balises.{table_format}"
        changes["balises"], files[file] = balises_written(description.balises, recording.balises, file)
    return description.model_copy(update=changes), files


def _complete(sensor: SensorFormat[Any], name: str, table: pd.DataFrame) -> pd.DataFrame:
    """Return the canonical columns of a table. Raises :class:`BadInputError` where it lacks one."""
    if missing := [column for column in sensor.canonical if column not in table.columns]:
        _, _, sensor_name = name.partition("/")
        which = f"{sensor.key} {sensor_name!r}" if sensor_name else f"{name}.parquet"
        expected = ", ".join(sensor.canonical)
        raise BadInputError(f"{which}: the table to write lacks {', '.join(missing)}; expected {expected}")
    return table[list(sensor.canonical)]


def _places(
    sensor: SensorFormat[Any], written: Sequence[WrittenTable], table_format: str
) -> list[tuple[str, str | None]]:
    """Return the file of each table, and its column where sensors of the same times share a file."""
    if not sensor.several:
        return [(f"{sensor.key}.{table_format}", None) for _ in written]
    times = [table[TIME_COLUMN].to_numpy() for _, table in written]
    first = [next(j for j, t in enumerate(times) if np.array_equal(t, clock)) for clock in times]
    groups = list(dict.fromkeys(first))
    places = []
    for i, (leader, (keys, _)) in enumerate(zip(first, written, strict=True)):
        quantity, *unit = str(keys["column"]).rsplit("_", 1)
        number = str(first[: i + 1].count(leader))
        column = "_".join([quantity, number, *unit]) if first.count(leader) > 1 else None
        places.append((f"{sensor.key}_{groups.index(leader) + 1}.{table_format}", column))
    return places


def _add(files: dict[str, pd.DataFrame], file: str, table: pd.DataFrame, column: str | None) -> None:
    """Add a table to those that are written, or its data column to the file that it shares."""
    if column is None:
        files[file] = table
    else:
        files[file] = files.get(file, table[[TIME_COLUMN]]).assign(**{column: table.iloc[:, 1].to_numpy()})


def write_table(table: pd.DataFrame, path: Path) -> None:
    """Write a table as the suffix of its file says, .csv or .parquet, without anything of pandas in it."""
    arrow = pa.Table.from_pandas(table, preserve_index=False).replace_schema_metadata(None)
    if path.suffix == ".csv":
        has_text = any(pa.types.is_string(kind) or pa.types.is_large_string(kind) for kind in arrow.schema.types)
        style = "needed" if has_text else "none"
        pa.csv.write_csv(arrow, path, pa.csv.WriteOptions(quoting_style=style))
    else:
        write_parquet(arrow, path)


def _refuse_to_destroy(folder: Path, recording: Recording) -> None:
    if recording.folder is not None and real_path(recording.folder) == real_path(folder):
        raise BadInputError(
            f"{folder}: the recording was read from here, and raw input is never changed; choose another"
        )
    if not folder.exists():
        return
    if not folder.is_dir():
        raise BadInputError(f"{folder}: is a file; expected a folder that is free, empty or a recording")
    names = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if not path.is_dir()}
    if not names:
        return
    if FILE_NAME not in names:
        raise BadInputError(
            f"{folder}: is not a recording and not empty; expected a folder that is free or a recording"
        )
    if foreign := sorted(names.difference(named_files(folder))):
        raise BadInputError(
            f"{folder}: holds files of others ({', '.join(foreign[:5])}); expected nothing but a recording"
        )
