"""``recording.toml`` to :mod:`trackfg.recording.description`, every fault in it a finding.

A part with a fault is still handed on as far as its tables can be found, marked *doubtful*: the structure of its table
is then checked too, while nothing that depends on the doubtful keys (units, plausibility) is.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from trackfg.errors import did_you_mean
from trackfg.files.owned_folder import kind_of
from trackfg.files.small_file import MOST_TOML_BYTES, InvalidModelError, keys_at, read_small, toml_of
from trackfg.io.formats.registry import FORMATS
from trackfg.recording.description import (
    MOST_OF_A_KIND,
    Balises,
    FurtherTach,
    Imu,
    KnownLineFile,
    RecordingDescription,
    Table,
    Track,
    Truth,
)
from trackfg.recording.findings import Finding
from trackfg.recording.line_kilometrage import LineKilometrage
from trackfg.recording.strict_model import Model

FILE_NAME = "recording.toml"
FORMAT = "trackfg-recording/1"

_OTHER_PARTS: dict[str, type[Model]] = {
    "track": Track,
    "kilometrage": LineKilometrage,
    "balises": Balises,
    "known_line": KnownLineFile,
    "truth": Truth,
}
"""Besides the sensors, whose tables are of numbers."""
_LISTS = tuple(sensor.key for sensor in FORMATS if sensor.several)
_PARTS = {**_OTHER_PARTS, **{sensor.key: sensor.model for sensor in FORMATS}}

_TOP_KEYS = tuple(key for key in RecordingDescription.model_fields if key not in (*_PARTS, "further_tach"))
"""Keys outside all tables. At the end of a file, TOML takes them for keys of its last table."""

_STRUCTURE_KEYS = ("file", "time", "column", "kind", "gyro", "accel", "position", "sd", "chainage", "name")
"""Keys without which a table's structure cannot be checked."""

_SIGMA_KEY = re.compile(r"_sd$|^sd_|_white$|_walk$")
_BOUNDS = {
    "greater_than": "above",
    "greater_than_equal": "at least",
    "less_than": "below",
    "less_than_equal": "at most",
}
_MOST_FAULTS = 50
"""Faults that are reported of one part: a file of a hundred thousand unknown keys is no description."""
_LENGTH_ERRORS = ("too_long", "too_short", "tuple_type", "list_type")


@dataclass(frozen=True)
class ReadDescription:
    """``description`` is None where anything is wrong. ``parts`` holds what can be used of each part: ``"track"``,
    ``"imu"``, ``"tach"``, ..., ``"laser[1]"``, the sensors in the order of the registry; those in ``doubtful`` have a
    fault.
    """

    findings: tuple[Finding, ...]
    description: RecordingDescription | None = None
    parts: Mapping[str, Model] = field(default_factory=dict)
    doubtful: frozenset[str] = frozenset()

    @property
    def sensors(self) -> dict[str, Table]:
        """The parts that are sensors."""
        return {
            name: part
            for name, part in self.parts.items()
            if isinstance(part, Table) and name.partition("[")[0] not in _OTHER_PARTS
        }

    @property
    def files(self) -> tuple[str, ...]:
        """The names of the files that the parts are read from, but for the truth, each once, in alphabetical order."""
        parts = [part for name, part in self.parts.items() if name != "truth"]
        return tuple(sorted({file for part in parts if isinstance(part, Table | KnownLineFile) for file in part.files}))


def locate(path: Path | str) -> tuple[Path, Path]:
    """Return the folder and the ``recording.toml`` of a recording named by either."""
    path = Path(path)
    return (path.parent, path) if path.suffix == ".toml" else (path, path / FILE_NAME)


def describes_recording(toml: Path) -> bool:
    """Return whether a TOML file is the description of a recording, of whatever version: its name or format says so.

    One that cannot be read counts as a description, since :func:`read_description` then says what is wrong with it.
    """
    if toml.name == FILE_NAME:
        return True
    try:
        return _is_of_recordings(toml_of(read_small(toml, MOST_TOML_BYTES)).get("format"))
    except (OSError, ValueError):
        return True


def _is_of_recordings(declared: object) -> bool:
    return isinstance(declared, str) and declared.startswith("trackfg-recording/")


_IMPORTED = "trackfg init makes a recording from a file of another system"


def _no_recording(file: Path, what: str, hint: str | None = None) -> ReadDescription:
    expected = "a folder with recording.toml"
    return ReadDescription((Finding("error", "no-recording", what, file=str(file), expected=expected, hint=hint),))


def read_description(path: Path | str) -> ReadDescription:
    """Read and validate the ``recording.toml`` that is ``path``, or lies in the folder ``path``. Never raises."""
    folder, toml = locate(path)
    try:
        data = toml_of(read_small(toml, MOST_TOML_BYTES))
    except FileNotFoundError:
        if not folder.exists():
            return _no_recording(folder, "no such folder")
        kind = kind_of(folder)
        if kind not in (None, "recording"):
            return _no_recording(folder, f"is a {kind}", "give the recording that it was made from")
        return _no_recording(folder, f"has no {toml.name}", _IMPORTED)
    except NotADirectoryError:
        return _no_recording(folder, "is a file", _IMPORTED)
    except OSError as error:
        reason = f"cannot be read ({error.strerror})"
        return ReadDescription((Finding("error", "no-recording", reason, file=str(toml)),))
    except ValueError as error:  # undecodable bytes and TOML syntax alike
        expected, hint = "TOML 1.0 in UTF-8", "correct this line; text goes in quotation marks, lists in [ ]"
        fault = Finding("error", "toml-syntax", str(error), file=toml.name, expected=expected, hint=hint)
        return ReadDescription((fault,))
    return validated(data, toml.name)


def validated(data: dict[str, Any], file: str) -> ReadDescription:
    """Return a description that was read already, from TOML or elsewhere; ``file`` names it in findings."""
    findings: list[Finding] = []
    parts: dict[str, Model] = {}
    doubtful: set[str] = set()
    data = _with_tachs_apart(data)
    findings += _top_level(data, file)

    for key, model, raw in _named_parts(data):
        if key in _LISTS:
            findings.append(_not_a_table(key, file, f"[[{key}]], one table per {key}"))
            continue
        if not isinstance(raw, dict):
            a_list = isinstance(raw, list)
            findings.append(_list_of_one(key, file) if a_list else _not_a_table(key, file, f"a table [{key}]"))
            continue
        value, faults = _part(model, raw, key, file)
        findings += faults
        if value is not None:
            parts[key] = value
        if faults:
            doubtful.add(key)

    description = None
    if not findings:
        try:
            description = RecordingDescription.model_validate(data)
        except InvalidModelError as error:
            findings += [_finding(detail, RecordingDescription, "", file) for detail in error.details[:_MOST_FAULTS]]
    return ReadDescription(tuple(findings), description, parts, frozenset(doubtful))


def _with_tachs_apart(data: dict[str, Any]) -> dict[str, Any]:
    """Return ``[[tach]]`` as the first tach and the further ones, as the models have them."""
    tachs = data.get("tach")
    if not (isinstance(tachs, list) and tachs and all(isinstance(tach, dict) for tach in tachs)):
        return data
    return {**data, "tach": tachs[0], "further_tach": tachs[1:]}


def _list_of_one(key: str, file: str) -> Finding:
    message, expected = f"is a list, but a recording has one {key}", f"one table [{key}]"
    hint = f"write [{key}], and a recording of its own for each other {key}"
    return Finding("error", "bad-value", message, file=file, column=key, expected=expected, hint=hint)


def _named_parts(data: Mapping[str, Any]) -> Iterator[tuple[str, type[Model], Any]]:
    """Return each part's key, its class, and what the file has there: of a list one by one, ``"laser[1]"``, if it is
    one.
    """
    for key, model in _PARTS.items():
        if key in _LISTS and isinstance(data.get(key), list):
            name, first = ("tach", 2) if model is FurtherTach else (key, 1)
            yield from ((f"{name}[{i}]", model, raw) for i, raw in enumerate(data[key], start=first))
        elif key in data:
            yield key, model, data[key]


def _top_level(data: dict[str, Any], file: str) -> list[Finding]:
    """Return faults of the keys that are not tables, missing parts, and parts that do not exist."""
    findings = []
    declared = data.get("format")
    if declared != FORMAT:
        what = "is missing" if declared is None else f"is {declared!r}"
        hint = f'write format = "{FORMAT}"'
        if _is_of_recordings(declared):
            hint = "this version of trackfg reads version 1 only: convert the recording, or update trackfg"
        findings.append(Finding("error", "format", what, file=file, column="format", expected=repr(FORMAT), hint=hint))
    rest = {key: value for key, value in data.items() if key not in _PARTS and key != "format"}
    try:
        RecordingDescription.model_validate({**rest, "imu": _ANY_IMU} if "imu" in data else rest)
    except InvalidModelError as error:
        findings += [_finding(detail, RecordingDescription, "", file) for detail in error.details[:_MOST_FAULTS]]
    return findings


_ANY_IMU = Imu(file="-", gyro=("x", "y", "z"), accel=("x", "y", "z"))


def _not_a_table(key: str, file: str, expected: str) -> Finding:
    return Finding("error", "bad-value", "is not a table", file=file, column=key, expected=expected)


def _part(model: type[Model], raw: dict[str, Any], key: str, file: str) -> tuple[Model | None, list[Finding]]:
    """Return the validated part, or where it has faults as much of it as finds its table, or None; and the faults."""
    try:
        return model.model_validate(raw), []
    except ValidationError as error:
        details = error.errors()[:_MOST_FAULTS]
    findings = [_finding(detail, model, key, file) for detail in details]
    wrong = {str(detail["loc"][0]) for detail in details if detail["loc"]}
    if model in (Track, LineKilometrage, KnownLineFile) or not wrong.isdisjoint(_STRUCTURE_KEYS):
        return None, findings
    usable = {name: value for name, value in raw.items() if name in model.model_fields and name not in wrong}
    usable = {name: tuple(value) if isinstance(value, list) else value for name, value in usable.items()}
    return model.model_construct(None, **usable), findings


def _finding(detail: ErrorDetails, model: type[Model], prefix: str, file: str) -> Finding:
    """Return what pydantic reports, in the words of this format."""
    loc = [str(step) for step in detail["loc"]]
    keys = [step for step in loc if not step.isdigit()]
    name = keys[-1] if keys else ""
    column = ".".join(filter(None, [prefix, *keys])) or None
    kind, given, context = detail["type"], detail.get("input"), detail.get("ctx", {})

    def finding(code: str, message: str, expected: str | None = None, hint: str | None = None) -> Finding:
        return Finding("error", code, message, file=file, column=column, expected=expected, hint=hint)

    if kind == "extra_forbidden":
        model_keys = [key for key in keys_at(model, loc[:-1]) if key != "further_tach"]  # which is written [[tach]]
        at_the_top = bool(prefix) and name in _TOP_KEYS
        hint = f"move {name} above the first [table]" if at_the_top else did_you_mean(name, model_keys)
        return finding("unknown-key", "unknown key", f"one of {', '.join(model_keys)}", hint or "remove it")
    if kind == "missing" and loc == keys:
        return finding("missing-key", "required key is missing", hint=f"add it: {_EXAMPLES.get(name, name + ' = ...')}")
    if kind == "literal_error":
        code = "unknown-unit" if name in ("unit", "time_unit", "gyro_unit", "accel_unit") else "bad-value"
        choices = re.findall(r"'([^']*)'", str(context["expected"]))
        return finding(code, f"is {given!r}", str(context["expected"]), did_you_mean(str(given), choices))
    if kind in _BOUNDS:
        limit, is_sigma = next(iter(context.values())), _SIGMA_KEY.search(name) is not None
        not_positive = is_sigma and isinstance(given, int | float) and given <= 0
        message = f"is {given!r}" + (", a sigma that is zero or negative" if not_positive else "")
        expected = "a number above 0" if not_positive else f"a number {_BOUNDS[kind]} {limit:g}{_unit(name)}"
        return finding("bad-sigma" if is_sigma else "bad-value", message, expected)
    if kind == "too_long" and name in (*_LISTS, "further_tach"):
        return finding("bad-value", f"has {context['actual_length']} entries", f"at most {MOST_OF_A_KIND}")
    if kind in _LENGTH_ERRORS or kind == "missing":
        return finding("wrong-size", f"is {_shown(given)}", _expected_list(model, loc))
    if kind == "value_error":
        text = str(detail["msg"]).removeprefix("Value error, ")
        message, _, expected = text.partition(": expected ")
        return finding("bad-value", message, expected or None)
    return finding("bad-value", f"is {_shown(given)}", detail["msg"].removeprefix("Input should be "))


_UNITS = {"m": "m", "mps": "m/s", "s": "s", "deg": "deg", "rad": "rad", "rev": "per revolution"}


def _unit(name: str) -> str:
    """Return the unit that a key ends in, with a space before it; nothing where it names none."""
    unit = _UNITS.get(name.rpartition("_")[2])
    return "" if unit is None else f" {unit}"


_EXAMPLES = {
    "imu": '[imu] with file = "imu.parquet", gyro and accel',
    "id": 'id = "2026-05-01-0312-down"',
    "file": 'file = "table.parquet"',
    "gyro": 'gyro = ["wx", "wy", "wz"]',
    "accel": 'accel = ["fx", "fy", "fz"]',
    "column": 'column = "count"',
    "kind": 'kind = "pulses", "distance" or "speed"',
}


def _expected_list(model: type[Model], loc: list[str]) -> str:
    name = next((step for step in loc if step in model.model_fields), "")
    annotation = str(model.model_fields[name].annotation) if name else ""
    return "a list of three names" if "tuple[str" in annotation else "a list of three numbers"


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
