"""A mapping is proposed from the data, with a question for each thing that they cannot say.

Names and units show what the columns are (:mod:`trackfg.interchange.importing.column_meaning`); then the recording that
the proposal makes is examined as ``trackfg check`` does, which finds the axes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import tomli_w

from trackfg.checks.diagnosis import estimates_of
from trackfg.checks.diagnosis_axes import AXES
from trackfg.checks.limits import CheckLimits
from trackfg.errors import BadInputError
from trackfg.files.temporary_folder import temporary_folder
from trackfg.interchange.importing.column_meaning import (
    Triple,
    first_of,
    has_gravity,
    kind_in,
    time_columns,
    time_unit,
    triples,
)
from trackfg.interchange.importing.conversion import write_imported
from trackfg.interchange.importing.foreign_units import written_unit
from trackfg.interchange.importing.mapping import FORMAT, mapping_of
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.stations import bare_unit, place_columns

FIX_SD_M = 1.0
"""Proposed for balises and posts without a sigma: a post is read off to about a metre."""

GNSS_SD_M = (3.0, 3.0, 6.0)
"""Proposed for positions without a sigma: a single-frequency receiver in the open (GPS SPS Performance Standard 2020:
about 3 m horizontally, twice as much in height)."""

UNKNOWN_HEIGHT_SD_M = 1000.0
"""Sigma of the height 0 where a source has none, m: no railway is as high as five of it."""

_WHEEL = re.compile(r"wheel|rad(?!ar|ius)|axle|achse|tach|odo")
"""Names of speeds that no GNSS receiver gives."""


@dataclass(frozen=True)
class Question:
    """A question has a ``key``, a ``text``, and a ``default`` that is taken without an answer."""

    key: str
    text: str
    default: str
    choices: tuple[str, ...] = ()


Ask = Callable[[Question], str]


@dataclass
class Proposal:
    """A proposed mapping: its ``sections``, and for keys (``"imu.axes"``) why they are what they are."""

    sections: dict[str, Any]
    reasons: dict[str, str] = field(default_factory=dict)


def propose(tables: Sequence[SourceTable], ask: Ask, given: dict[str, Any] | None = None) -> Proposal:
    """Propose a mapping of ``tables``; ``given`` are the sections of a format that says itself what its columns are.

    Raises :class:`BadInputError` where gyro or accelerometer are not found, or where gravity was removed.
    """
    proposal = Proposal({"format": FORMAT, **(given or {})})
    if "imu" not in proposal.sections:
        _imu(proposal, tables, ask)
    if "tach" not in proposal.sections:
        _tach(proposal, tables, ask)
    if "gnss" not in proposal.sections:
        _gnss(proposal, tables)
    if "balises" not in proposal.sections:
        _balises(proposal, tables)
    if "fixes" not in proposal.sections:
        _fixes(proposal, tables)
    _vehicle(proposal, ask)
    _axes(proposal, tables, ask)
    return proposal


def _imu(proposal: Proposal, tables: Sequence[SourceTable], ask: Ask) -> None:
    gyro, accel = _longest(tables, "gyro"), _longest(tables, "accel")
    if accel is None and (accel := _longest(tables, "free_accel")) is not None and not has_gravity(accel):
        raise BadInputError(
            "the acceleration is without gravity, which roll and pitch need; expected the specific force "
            "(total acceleration). Hint: switch on the accelerometer itself, not the linear or user acceleration"
        )
    if gyro is None or accel is None:
        lacking = "gyro" if gyro is None else "accelerometer"
        names = "; ".join(f"{table.name}: {', '.join(table.columns[:20])}" for table in tables)
        raise BadInputError(
            f"no three columns of the {lacking} found among {names}; expected names such as gyro_x, or for "
            "a track geometry a column of places and channels such as level. Hint: name them in a mapping "
            "(docs/importing.md)"
        )
    same = gyro.table.name == accel.table.name
    section: dict[str, Any] = {"file": gyro.table.name if same else [gyro.table.name, accel.table.name]}
    section |= _time(gyro.table)
    section["gyro"], section["gyro_unit"] = list(gyro.columns), _asked_unit(gyro, "gyro", ask)
    section["accel"], section["accel_unit"] = list(accel.columns), _asked_unit(accel, "accel", ask)
    proposal.sections["imu"] = section


def _longest(tables: Sequence[SourceTable], kind: Literal["gyro", "accel", "free_accel"]) -> Triple | None:
    """Return the columns of a kind with the most rows: a log may have slow copies of fast ones."""
    found = [triple for table in tables for triple in triples(table, kind)]
    return max(found, key=lambda triple: len(triple.table.frame), default=None)


def _number(ask: Ask, key: str, text: str, default: str) -> float:
    answer = ask(Question(key, text, default))
    try:
        return float(answer)
    except ValueError:
        raise BadInputError(f"{key}: {answer!r} is not a number; expected one such as {default}") from None


def _asked_unit(triple: Triple, key: str, ask: Ask) -> str:
    if triple.known or key == "accel":  # the accelerometer's unit follows from gravity
        return triple.unit
    columns = ", ".join(triple.columns)
    return ask(Question("imu.gyro_unit", f"Unit of {columns}", triple.unit, ("rad/s", "deg/s", "deg/h", "mrad/s")))


def _time(table: SourceTable, beside: tuple[SourceTable, str] | None = None) -> dict[str, Any]:
    columns = time_columns(table)
    if columns is None:
        raise BadInputError(
            f"{table.name}: no column of times found among {', '.join(table.columns[:30])}; expected one. Hint: "
            "name it in a mapping (docs/importing.md)"
        )
    unit = time_unit(table, columns, beside)
    return {"time": columns[0] if len(columns) == 1 else list(columns), **({} if unit is None else {"time_unit": unit})}


def _tach(proposal: Proposal, tables: Sequence[SourceTable], ask: Ask) -> None:
    imu = proposal.sections["imu"]["file"]
    for kind in ("count", "distance", "speed"):
        for table in tables:
            names = [name for name in table.columns if kind_in(table, name) == kind]
            name = next((name for name in names if _WHEEL.search(name.casefold())), next(iter(names), None))
            if name is None or (kind == "speed" and not _is_wheels(table, name, imu, ask)):
                continue
            section: dict[str, Any] = {"file": table.name, **_time(table), "column": name}
            if kind == "count":
                section |= {
                    "kind": "pulses",
                    "pulses_per_rev": _number(
                        ask, "tach.pulses_per_rev", f"Pulses per turn of the wheel, in {name}", "1"
                    ),
                    "wheel_diameter_m": _number(ask, "tach.wheel_diameter_m", "Wheel diameter, m", "0.92"),
                }
            elif kind == "distance":
                section |= {"kind": "distance", "unit": _unit_of(proposal, table, name, "length")}
            else:
                section |= {"kind": "speed", "unit": _unit_of(proposal, table, name, "speed")}
                if np.nanmin(table.numbers(name)) < 0.0:
                    section["signed"] = True
                    proposal.reasons["tach.signed"] = "some speeds are negative"
            proposal.sections["tach"] = section
            return


def _is_wheels(table: SourceTable, name: str, imu: str | list[str], ask: Ask) -> bool:
    """Return whether a speed is a wheel's and not the receiver's, which has latitudes beside it.

    Where a table has inertial samples too, and the name does not say which it is, the user is asked.
    """
    if first_of(table, "latitude") is None or _WHEEL.search(name.casefold()):
        return True
    if table.name != imu:
        return False
    return ask(Question("tach.column", f"Is {name} measured at a wheel, not by GNSS?", "no", ("yes", "no"))) == "yes"


def _unit_of(proposal: Proposal, table: SourceTable, name: str, quantity: Literal["speed", "length"]) -> str:
    """Return the unit that a tach's column states, else m or m/s, with that as the reason."""
    stated = written_unit(table.units.get(name) or name, quantity)
    if stated is None:
        proposal.reasons["tach.unit"] = f"assumed, since {name} states none"
    return stated or {"speed": "m/s", "length": "m"}[quantity]


def _gnss(proposal: Proposal, tables: Sequence[SourceTable]) -> None:
    for table in tables:
        latitude, longitude = first_of(table, "latitude"), first_of(table, "longitude")
        if latitude is None or longitude is None:
            continue
        height = first_of(table, "height")
        across, up = first_of(table, "sd_horizontal"), first_of(table, "sd_vertical")
        sd: list[Any] = [across or GNSS_SD_M[0], across or GNSS_SD_M[1], up or GNSS_SD_M[2]]
        if across is None:
            proposal.reasons["gnss.sd"] = "m, east, north, up: assumed, since the source has none"
        if height is None:
            proposal.reasons["gnss.position"] = "the source has no heights: 0, with a sigma of 1 km"
            sd[2] = UNKNOWN_HEIGHT_SD_M
        stated = [f"sd_{axis}_m" for axis in ("east", "north", "up")]
        if set(stated) <= set(table.columns):
            sd = list(stated)
            proposal.reasons.pop("gnss.sd", None)
        position = [latitude, longitude, height or 0.0]
        section = {"file": table.name, **_time(table), "position": position, "sd": sd}
        if height is not None and written_unit(table.units.get(height) or height, "length") == "ft":
            section["height_unit"] = "ft"
        proposal.sections["gnss"] = section
        return


def _balises(proposal: Proposal, tables: Sequence[SourceTable]) -> None:
    """Propose the table of ids with times, and where it has no places a table of places with the same ids."""
    named = [(table, name) for table in tables if (name := first_of(table, "balise")) is not None]
    passages = next(((table, name) for table, name in named if first_of(table, "time") is not None), None)
    if passages is None:
        return
    table, name = passages
    section = {"file": table.name, **_time(table, _clock_of_imu(proposal, tables)), "id": name}
    for places in (table, *(other for other, same in named if other is not table and same == name)):
        if first_of(places, "station") is not None:
            section |= {} if places is table else {"places": places.name}
            section |= _places(proposal, places, "balises")
            break
    proposal.sections["balises"] = section


def _fixes(proposal: Proposal, tables: Sequence[SourceTable]) -> None:
    imu, balises = proposal.sections["imu"]["file"], proposal.sections.get("balises", {})
    taken = {*([imu] if isinstance(imu, str) else imu), balises.get("file"), balises.get("places")}
    for table in tables:
        if table.name in taken or first_of(table, "station") is None:
            continue
        time = _time(table, _clock_of_imu(proposal, tables))
        proposal.sections["fixes"] = {"file": table.name, **time, **_places(proposal, table, "fixes")}
        return


def _places(proposal: Proposal, table: SourceTable, section: str) -> dict[str, Any]:
    """Return the columns of places along the line and of their sigma, which is assumed where the table has none."""
    name = first_of(table, "station")
    assert name is not None
    sd = next((column for column in table.columns if column.casefold().startswith("sd")), FIX_SD_M)
    if sd is FIX_SD_M:
        proposal.reasons[f"{section}.sd"] = "m, assumed, since the source has none"
    if (pair := place_columns(table)) is not None and name in pair[0]:
        return {"chainage": list(pair[0]), "sd": sd, "chainage_unit": pair[1]}
    return {
        "chainage": name,
        "sd": sd,
        "chainage_unit": "m" if _written_places(table, name) else bare_unit(table, name),
    }


def _clock_of_imu(proposal: Proposal, tables: Sequence[SourceTable]) -> tuple[SourceTable, str] | None:
    """Return the table of the inertial sensor, the gyro's of two, and its column of times if it is one."""
    file, time = proposal.sections["imu"]["file"], proposal.sections["imu"].get("time")
    name = file if isinstance(file, str) else file[0]
    table = next((table for table in tables if table.name == name), None)
    return (table, time) if table is not None and isinstance(time, str) and time in table.columns else None


def _written_places(table: SourceTable, name: str) -> bool:
    try:
        table.numbers(name)
    except BadInputError:
        return True
    return False


def _vehicle(proposal: Proposal, ask: Ask) -> None:
    imu = proposal.sections["imu"]
    if "rigid" not in imu:
        text = "Is the sensor fixed to what follows the track (axle box, wheelset, trolley), not on springs?"
        imu["rigid"] = ask(Question("imu.rigid", text, "no", ("yes", "no"))) == "yes"
    if "track" not in proposal.sections:
        gauge = _number(ask, "track.gauge_m", "Track gauge, m", "1.435")
        proposal.sections["track"] = {"gauge_m": gauge, "cross_level_base_m": 1.5 if gauge >= 1.435 else gauge}


def _axes(proposal: Proposal, tables: Sequence[SourceTable], ask: Ask) -> None:
    """Set the axes that the data show, and ask where they do not show them clearly."""
    imu = proposal.sections["imu"]
    if "axes" in imu:
        return
    with temporary_folder() as folder:
        made = write_imported(tables, mapping_of(proposal.sections, "proposal"), folder / "r", run_id="proposal")
        recording = made.loaded.recording
        assert recording is not None  # write_imported raises where it is not readable
        axes = estimates_of(recording).axes
        up = recording.accel.mean(axis=0)
    clear = (
        axes.best_forward_correlation is not None and axes.best_forward_correlation >= CheckLimits().axis_correlation
    )
    if clear:
        imu["axes"] = axes.proposed
        proposal.reasons["imu.axes"] = (
            f"gravity and the tach's acceleration show it (correlation {axes.best_forward_correlation:.2f})"
        )
        return
    vertical = int(np.argmax(np.abs(up)))
    default = next(axes for axes in AXES if axes[vertical] == ("U" if up[vertical] > 0 else "D") and "F" in axes)
    text = "Where do x, y, z point: forward F or back B, left L or right R, up U or down D"
    imu["axes"] = ask(Question("imu.axes", text, default)).upper()
    proposal.reasons["imu.axes"] = "gravity shows which axis is vertical; the others were answered"


def unused_columns(sections: dict[str, Any], tables: Sequence[SourceTable]) -> dict[str, list[str]]:
    """Return the columns that no section of a mapping uses, by the name of their table."""
    used: dict[str, set[str]] = {}
    for section in sections.values():
        if isinstance(section, dict) and "file" in section:
            values = [part for value in section.values() for part in (value if isinstance(value, list) else [value])]
            files = section["file"] if isinstance(section["file"], list) else [section["file"]]
            for file in (*files, *([section["places"]] if "places" in section else [])):
                used.setdefault(file, set()).update(str(value) for value in values)
    unused = {table.name: [name for name in table.columns if name not in used.get(table.name, ())] for table in tables}
    return {name: columns for name, columns in unused.items() if columns}


def mapping_text(proposal: Proposal) -> str:
    """Return the proposal as the text of a mapping, with its reasons as comments."""
    lines, section = [], ""
    for line in tomli_w.dumps(proposal.sections).splitlines():
        if line.startswith("["):
            section = line.strip("[]") + "."
        reason = proposal.reasons.get(section + line.partition(" = ")[0])
        lines += [line] if reason is None else [f"# {reason}", line]
    return "\n".join(lines) + "\n"
