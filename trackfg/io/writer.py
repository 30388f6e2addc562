"""Write a recording in its canonical form: SI, FLU, one clock, columns named as in :mod:`trackfg.recording.model`.

Reading it gives the same tables: bit by bit from Parquet, and from CSV too, since numbers are written with as many
digits as identify the double.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import tomli_w

from trackfg.errors import BadInputError
from trackfg.files.atomic_folder import replaced_folder
from trackfg.io.description_reader import FILE_NAME, read_description
from trackfg.recording.canonical import pulse_m
from trackfg.recording.description import Gnss, RecordingDescription, Table, Tach, Truth
from trackfg.recording.model import FIX_COLUMNS, GNSS_COLUMNS, IMU_COLUMNS, LASER_COLUMNS, TACH_COLUMNS, Recording

TableFormat = Literal["parquet", "csv"]


def write_recording(
    recording: Recording,
    folder: Path | str,
    *,
    table_format: TableFormat = "parquet",
    truth: pd.DataFrame | None = None,
    truth_geometry: pd.DataFrame | None = None,
) -> Path:
    """Write ``recording`` as the folder ``folder`` and return its path.

    The folder appears complete or not at all (:mod:`trackfg.files.atomic_folder`). A recording that is there already is
    replaced. ``truth`` has ``t_s`` and trajectory columns, ``truth_geometry`` has ``chainage_m``; geometry needs truth.
    Raises :class:`BadInputError` where ``folder`` is anything else than free, empty or a recording with nothing but its
    own files, where it is the one that ``recording`` was read from, and where a table lacks a column.
    """
    folder = Path(folder)
    _refuse_to_destroy(folder, recording)
    if truth_geometry is not None and truth is None:
        raise BadInputError("truth_geometry without truth: expected both")
    tables = _tables(recording, table_format)
    description = canonical_description(recording, table_format)
    if truth is not None:
        geometry_file = None if truth_geometry is None else f"truth_geometry.{table_format}"
        answer = Truth(file=f"truth.{table_format}", time="t_s", geometry=geometry_file)
        description = description.model_copy(update={"truth": answer})
        tables[answer.file] = (("t_s",), truth)
        if geometry_file is not None and truth_geometry is not None:
            tables[geometry_file] = (("chainage_m",), truth_geometry)
    for file, (columns, table) in tables.items():
        if missing := [column for column in columns if column not in table.columns]:
            raise BadInputError(f"{file}: the table to write lacks {', '.join(missing)}; expected {', '.join(columns)}")
    with replaced_folder(folder) as new:
        for file, (columns, table) in tables.items():
            _write_table(table if file.startswith("truth") else table[list(columns)], new / file)
        (new / FILE_NAME).write_text(tomli_w.dumps(_without_none(description.model_dump())), encoding="utf-8")
    return folder


def canonical_description(recording: Recording, table_format: TableFormat = "parquet") -> RecordingDescription:
    """The description of the canonical tables: ``recording``'s, but for files, columns and units."""
    given = recording.description
    clock = {"time": "t_s", "time_unit": "s", "time_offset_s": 0.0}
    changes: dict[str, Any] = {"truth": None}
    changes["imu"] = given.imu.model_copy(
        update={
            **clock,
            "file": f"imu.{table_format}",
            "stamp": "centre",
            "gyro": IMU_COLUMNS[1:4],
            "gyro_unit": "rad/s",
            "accel": IMU_COLUMNS[4:7],
            "accel_unit": "m/s^2",
            "axes": "FLU",
            "mount_rpy_deg": (0.0, 0.0, 0.0),
        }
    )
    if recording.tach is not None:
        tach = _described(given.tach, "tach")
        kind = {"kind": "distance", "unit": "m", "column": TACH_COLUMNS[1], "integrated": tach.integrates_speed}
        if _pulse_counts(recording) is not None:
            kind = {"kind": "pulses", "unit": "1", "column": "count"}
        changes["tach"] = tach.model_copy(update={**clock, **kind, "file": f"tach.{table_format}"})
    if recording.fixes is not None:
        names = {"chainage": FIX_COLUMNS[1], "sd": FIX_COLUMNS[2]}
        fixes = _described(given.fixes, "fixes")
        changes["fixes"] = fixes.model_copy(update={**clock, **names, "file": f"fixes.{table_format}"})
    if recording.gnss is not None:
        gnss: Gnss = _described(given.gnss, "gnss")
        origin = None if recording.gnss_origin is None else tuple(float(x) for x in recording.gnss_origin)
        frame = {"position": GNSS_COLUMNS[1:4], "sd": GNSS_COLUMNS[4:7], "frame": "local", "origin": origin}
        changes["gnss"] = gnss.model_copy(update={**clock, **frame, "file": f"gnss.{table_format}"})
    places = _laser_places(recording, table_format)
    changes["laser"] = tuple(
        laser.model_copy(update={**clock, "file": places[laser.name][0], "column": places[laser.name][1], "unit": "m"})
        for laser in given.laser
    )
    return given.model_copy(update=changes)


_Part = TypeVar("_Part", bound=Table)


def _described(part: _Part | None, name: str) -> _Part:
    if part is None:
        raise BadInputError(f"the recording has a {name} table but its description has no [{name}]")
    return part


def _laser_places(recording: Recording, table_format: str) -> dict[str, tuple[str, str]]:
    """By name, in the description's order: file and column of each laser. Lasers of the same times share a file."""
    names = [laser.name for laser in recording.description.laser]
    if set(names) != set(recording.lasers):
        raise BadInputError(f"the recording has the lasers {sorted(recording.lasers)} but describes others")
    together: list[list[str]] = []
    for name in names:
        table = recording.lasers[name]
        if missing := [column for column in LASER_COLUMNS if column not in table.columns]:
            raise BadInputError(f"laser {name!r}: the table to write lacks {', '.join(missing)}")
        times = table["t_s"].to_numpy()
        for others in together:
            if np.array_equal(times, recording.lasers[others[0]]["t_s"].to_numpy()):
                others.append(name)
                break
        else:
            together.append([name])
    places = {}
    for number, group in enumerate(together, start=1):
        for i, name in enumerate(group, start=1):
            column = LASER_COLUMNS[1] if len(group) == 1 else f"displacement_{i}_m"
            places[name] = (f"laser_{number}.{table_format}", column)
    return {name: places[name] for name in names}


def _pulse_counts(recording: Recording) -> pd.DataFrame | None:
    """The tach table as pulse counts, if it came from pulses and counts reproduce its distances to the last bit."""
    tach: Tach | None = recording.description.tach
    if tach is None or tach.kind != "pulses" or recording.tach is None:
        return None
    pulse = pulse_m(tach)
    distance = recording.tach["distance_m"].to_numpy()
    count = np.rint(distance / pulse)
    if not np.array_equal(count * pulse, distance):
        return None
    return pd.DataFrame({"t_s": recording.tach["t_s"], "count": count})


def _tables(recording: Recording, table_format: str) -> dict[str, tuple[tuple[str, ...], pd.DataFrame]]:
    """By file name: the columns to write, and the table."""
    tables: dict[str, tuple[tuple[str, ...], pd.DataFrame]] = {f"imu.{table_format}": (IMU_COLUMNS, recording.imu)}
    if recording.tach is not None:
        counts = _pulse_counts(recording)
        tables[f"tach.{table_format}"] = (
            (TACH_COLUMNS, recording.tach) if counts is None else (("t_s", "count"), counts)
        )
    if recording.fixes is not None:
        tables[f"fixes.{table_format}"] = (FIX_COLUMNS, recording.fixes)
    if recording.gnss is not None:
        tables[f"gnss.{table_format}"] = (GNSS_COLUMNS, recording.gnss)
    for name, (file, column) in _laser_places(recording, table_format).items():
        time, displacement = LASER_COLUMNS
        laser = recording.lasers[name]
        columns, table = tables.get(file, ((time,), laser[[time]]))
        tables[file] = ((*columns, column), table.assign(**{column: laser[displacement].to_numpy()}))
    return tables


def _write_table(table: pd.DataFrame, path: Path) -> None:
    arrow = pa.Table.from_pandas(table, preserve_index=False).replace_schema_metadata(None)
    if path.suffix == ".csv":
        pa.csv.write_csv(arrow, path, pa.csv.WriteOptions(quoting_style="none"))
    else:
        pq.write_table(arrow, path)


def _without_none(value: Any) -> Any:
    """TOML has no null: a key that is not set is left out."""
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    if isinstance(value, list | tuple):
        return [_without_none(item) for item in value]
    return value


def _refuse_to_destroy(folder: Path, recording: Recording) -> None:
    if recording.folder is not None and recording.folder.resolve() == folder.resolve():
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
    parts = read_description(folder).parts.values()
    own = {FILE_NAME} | {part.file for part in parts if isinstance(part, Table)}
    own |= {part.geometry for part in parts if isinstance(part, Truth) and part.geometry is not None}
    if foreign := sorted(names - own):
        raise BadInputError(
            f"{folder}: holds files of others ({', '.join(foreign[:5])}); expected nothing but a recording"
        )
