"""A log of an inertial sensor is read from whatever it lies in: a recording, or a file that can be imported."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from trackfg.errors import BadInputError, did_you_mean
from trackfg.files.temporary_folder import temporary_folder
from trackfg.interchange.importing.conversion import write_imported
from trackfg.interchange.importing.mapping import mapping_of
from trackfg.interchange.importing.proposal import propose
from trackfg.interchange.importing.proposals.questions import Ask
from trackfg.interchange.importing.registry import source_format
from trackfg.io.description_reader import locate
from trackfg.io.reader import read_recording
from trackfg.io.table_file import open_table
from trackfg.numerics.arrays import Array
from trackfg.recording.model import Recording

_TEMPERATURE = re.compile(r"temp|\bdegc\b|°c", re.IGNORECASE)
"""What the name of a column of temperatures contains."""
_ANSWERS = {"tach.pulses_per_rev": "1"}
"""What is not asked: no noise depends on the wheel."""


def read_sensor_log(path: Path, ask: Ask, temperature: str | None = None) -> tuple[Recording, tuple[str, Array] | None]:
    """Return a recording, and the temperature beside its inertial samples: the column's name and a value per sample.

    A folder or a ``recording.toml`` is a recording; any other file is imported as ``trackfg import`` does, with the
    answers of ``ask``. ``temperature`` names the column; by default its name shows it, and there need be none. Raises
    :class:`BadInputError`.
    """
    folder, toml = locate(path)
    if path.suffix == ".toml" or toml.exists():
        recording = read_recording(path)
        file = recording.description.imu.file
        table, _ = open_table(folder, file, ())
        names = () if table is None else table.columns
        name = _named(temperature, names, file)
        if name is None:
            return recording, None
        table, faults = open_table(folder, file, [name])
        values, more = (None, faults) if table is None else table.numbers(name)
        if values is None:
            raise BadInputError(str(more[0]))
        return recording, (name, _beside(values, recording, name))
    form = source_format(path, None)
    tables = form.tables(path, lambda _: None)
    proposal = propose(tables, lambda question: _ANSWERS.get(question.key) or ask(question), form.mapping(tables))
    proposal.sections["source"] = form.key
    with temporary_folder() as folder:
        made = write_imported(
            tables, mapping_of(proposal.sections, "proposed mapping"), folder / "log", run_id=path.stem
        )
        recording = read_recording(made.folder)
    used = proposal.sections["imu"]["file"]
    for source in tables:
        if source.name in ([used] if isinstance(used, str) else used):
            name = _named(temperature, source.columns, source.name)
            if name is not None:
                return recording, (name, _beside(source.numbers(name), recording, name))
    return recording, None


def _named(wanted: str | None, names: tuple[str, ...] | list[str], file: str) -> str | None:
    """Return the column of the temperature."""
    if wanted is None:
        return next((name for name in names if _TEMPERATURE.search(name)), None)
    if wanted in names:
        return wanted
    near = did_you_mean(wanted, names)
    hint = f". Hint: {near}" if near else ""
    raise BadInputError(f"{file}: no column {wanted!r}; expected one of {', '.join(names[:30])}{hint}")


def _beside(values: Array, recording: Recording, name: str) -> Array:
    """Return a value per sample: rows that a reader left out are few, and a temperature is slow."""
    samples = len(recording.imu)
    if not len(values):
        raise BadInputError(f"column {name!r}: has no values; expected temperatures in degC")
    return np.asarray(values[np.minimum(np.arange(samples) * len(values) // samples, len(values) - 1)])
