"""The reader reads a recording and checks it, or says in one sentence what is wrong with it.

:func:`load` does all the work, and never raises for bad input: :func:`read_recording` turns its first error into an
exception, ``trackfg check`` lists everything. There is no second copy of a check.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from trackfg.checks import plausibility
from trackfg.checks.clock_overlap import of_this_run
from trackfg.checks.limits import CheckLimits
from trackfg.errors import BadInputError
from trackfg.files import atomic_folder
from trackfg.io.balises import read_balises
from trackfg.io.content import files_sha256
from trackfg.io.description_reader import ReadDescription, locate, read_description
from trackfg.io.formats.gnss import GnssConverter
from trackfg.io.formats.registry import format_of, sensors_of
from trackfg.io.known_lines import line_of_recording
from trackfg.io.table_file import resolve_inside
from trackfg.io.tables import Tables, canonical_table
from trackfg.io.writer import write_recording
from trackfg.numerics.arrays import Array
from trackfg.recording.description import Balises, KnownLineFile, Truth
from trackfg.recording.findings import Finding, Section, errors
from trackfg.recording.known_line import KnownLine
from trackfg.recording.model import Recording

__all__ = [
    "LoadedRecording",
    "load",
    "read_recording",
    "write_recording",
]


@dataclass(frozen=True)
class LoadedRecording:
    """The parts that could be read, and everything found on the way.

    ``recording`` is None where the description or a table is unusable; it is there, but must not be used, where only
    the values are implausible (then ``findings`` has errors).
    """

    findings: tuple[Finding, ...]
    recording: Recording | None = None


def read_recording(path: Path | str, limits: CheckLimits | None = None) -> Recording:
    """Read a recording; its tables are as in :mod:`trackfg.recording.model`, in SI, body axes and one clock.

    Parameters
    ----------
    path
        The recording's folder, or its ``recording.toml``.
    limits
        Beyond which values are doubtful, and beyond which they are wrong; the defaults suit a railway vehicle.

    Returns
    -------
    Recording
        Description and tables, with what was noticed about the quality of the data.

    Raises
    ------
    BadInputError
        With the first error (file, column, data row, what was expected, the hint) and how many more there are.

    Examples
    --------
    >>> import trackfg
    >>> recording = trackfg.read_recording("run1")
    >>> recording
    <Recording mainline-seed1-run0: 60.0 s, imu 12000 rows at 200 Hz, tach 3001 rows>
    >>> list(recording.imu.columns)[:4]  # s, rad/s
    ['t_s', 'wx_radps', 'wy_radps', 'wz_radps']
    """
    loaded = load(path, limits)
    faults = errors(loaded.findings)
    if faults or loaded.recording is None:
        raise BadInputError(_message(faults, path))
    return loaded.recording


def load(path: Path | str, limits: CheckLimits | None = None) -> LoadedRecording:
    """Read and check as far as possible. Never raises for bad input."""
    limits = limits or CheckLimits()
    folder, toml = locate(path)
    with contextlib.suppress(OSError, ValueError):  # what is wrong with the path is reported below
        atomic_folder.recover(folder)
    read = read_description(path)
    sensors = read.sensors
    measured, further = _sensor_tables(read, folder, limits), _further_files(read, folder)
    findings, imu = [*read.findings, *measured.findings, *further.findings], measured.tables.get("imu")
    if read.description is not None:
        findings += plausibility.start_doubts(read.description.start, toml.name)
    findings += plausibility.findings(read.parts, measured.tables, toml.name, limits, measured.gnss_origin)
    tables = {name: of_this_run(imu, table, limits) for name, table in measured.tables.items()}
    for name, table in tables.items():
        findings += format_of(sensors[name]).doubts(sensors[name], Section(toml.name, name), table, limits)
    balises = None if further.balises is None else of_this_run(tables.get("imu"), further.balises, limits)
    distinct = tuple(dict.fromkeys(findings))
    if read.description is None or set(tables) != set(sensors):
        return LoadedRecording(distinct)
    # Both are in the order of the registry.
    named = {name: tables[key] for (name, _), key in zip(sensors_of(read.description), sensors, strict=True)}
    recording = replace(
        Recording.of_tables(read.description, named),
        gnss_origin=measured.gnss_origin,
        folder=folder,
        findings=distinct,
        files_sha256=files_sha256(folder, (toml.name, *read.files)),
        balises=balises,
        known_line=further.known_line,
    )
    return LoadedRecording(distinct, recording)


class _SensorTables(NamedTuple):
    """The canonical tables of the sensors that can be read, by name; latitude, longitude (deg) and height (m) of the
    origin of positions, if they have one; and what is wrong with the files.
    """

    tables: dict[str, pd.DataFrame]
    gnss_origin: Array | None
    findings: list[Finding]


def _sensor_tables(read: ReadDescription, folder: Path, limits: CheckLimits) -> _SensorTables:
    reader = Tables(folder, read.sensors.values())
    tables, gnss_origin, findings = dict[str, pd.DataFrame](), None, list[Finding]()
    for name, part in read.sensors.items():
        columns, faults = reader.columns(part, limits)
        findings += faults
        if columns is not None and name not in read.doubtful:
            tables[name], converter = canonical_table(part, columns)
            if isinstance(converter, GnssConverter):
                gnss_origin = converter.origin
    return _SensorTables(tables, gnss_origin, findings)


class _FurtherFiles(NamedTuple):
    """What further files of a recording hold: passages of balises and known lines; and what is wrong with them."""

    balises: pd.DataFrame | None
    known_line: KnownLine | None
    findings: list[Finding]


def _further_files(read: ReadDescription, folder: Path) -> _FurtherFiles:
    balises, known_line, findings = None, None, list[Finding]()
    if isinstance(described := read.parts.get("balises"), Balises) and "balises" not in read.doubtful:
        balises, faults = read_balises(folder, described)
        findings += faults
    if isinstance(tracks := read.parts.get("known_line"), KnownLineFile):
        known_line, faults = line_of_recording(folder, tracks)
        findings += faults
    if isinstance(truth := read.parts.get("truth"), Truth):
        for file in truth.files:  # whether they are there; their content is not looked at
            findings += resolve_inside(folder, file)[1]
    return _FurtherFiles(balises, known_line, findings)


def _message(faults: list[Finding], path: Path | str) -> str:
    more = len(faults) - 1
    if more == 0:
        return str(faults[0])
    return f"{faults[0]} ({more} more error{'s' if more > 1 else ''}: `trackfg check {path}` lists all)"
