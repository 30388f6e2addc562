"""Which column is the tachometer's: a count of pulses, a distance or a speed."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
import pandas as pd

from trackfg.checks.limits import CheckLimits
from trackfg.checks.sizes import WHEEL_M
from trackfg.errors import BadInputError
from trackfg.interchange.importing.columns.column_meaning import has_axes_beside, kind_in, stem_of
from trackfg.interchange.importing.columns.column_names import parts_of
from trackfg.interchange.importing.columns.plan_columns import plan_columns
from trackfg.interchange.importing.columns.time_columns import is_sample_counter, time_columns
from trackfg.interchange.importing.columns.written_units import factor_of, unit_in
from trackfg.interchange.importing.proposals.questions import Ask, Proposal, Question, asked_number, asked_unit
from trackfg.interchange.importing.proposals.receiver_speed_proposal import NAMED_AFTER_RECEIVERS, NOT_MEASURED
from trackfg.interchange.importing.proposals.stated_wheel import stated_diameter, stated_pulses
from trackfg.interchange.importing.sensors.pulse_levels import are_levels
from trackfg.interchange.importing.sensors.wheel_count import unwrapped_count
from trackfg.interchange.importing.source_table import ROW_NUMBER, SourceTable
from trackfg.interchange.importing.times.reading import times_by_keys
from trackfg.numerics.chainage.passes import only_falls

_WHEEL = re.compile(r"wheel|whl|rad(?!ar|ius)|axle|achse|tach|odo|колес")
"""Names of speeds that no GNSS receiver gives."""
_OVER_GROUND = re.compile(r"radar|doppler|opti[ck]|laser|correvit|kistler|datron|corrsys")
"""Names of sensors of the speed over ground, some of which are makes."""
_OF_A_WHEEL, _UNNAMED, _OF_NO_WHEEL = range(3)
"""What the names of a column and of its table say of a speed."""
_PHONES = re.compile(r"pedomet|proximity")
"""Names of distances that other sensors of a phone give: that of its steps, and that to what is before its screen."""
_TURNS = 0.3
"""Share of the steps of each row's own count that are of another sign than the step before."""
_FEWEST_CHANGES = 10
"""Fewer changes of a column do not show whether they are at a receiver's times."""
_FALLS = 0.01
"""Share of the steps that fall where a vehicle rolls back; fewer are rows that are wrong."""
_PULSES = re.compile(r"pulse|impuls|edge|flank|tach|wheel|encoder")
"""What the name of a table of pulses, or of one of its columns, has in it."""


def propose_tach(proposal: Proposal, tables: Sequence[SourceTable], ask: Ask) -> None:
    """Add the section of the tachometer where a table has one."""
    imu = proposal.sections["imu"]["file"]
    for kind in ("count", "pulse rate", "distance", "speed"):
        for table, name in _candidates(tables, kind):
            if kind in ("distance", "speed") and not _is_wheels(table, name, imu, ask):
                continue
            if kind in ("distance", "speed") and plan_columns(table) is None:
                _give_reason(proposal, table, name)
            section: dict[str, Any] = {"file": table.name, **proposal.times_of(table, ask), "column": name}
            if kind == "count":
                section |= _pulses(f"in {name}", tables, ask)
                section |= _of_falls(proposal, table, section)
            elif kind == "pulse rate":
                section |= _pulses(f"counted in {name}", tables, ask) | {
                    "kind": "speed",
                    "unit": _stated_unit(table, name),
                }
            elif kind == "distance":
                section |= {"kind": "distance", "unit": _unit_of(proposal, table, name, "length", ask)}
                section |= _of_falls(proposal, table, section)
            else:
                section |= _speed(proposal, table, name, ask, stated_diameter(tables))
            proposal.sections["tach"] = section
            return
    _propose_times_of_pulses(proposal, tables, ask)


def propose_speeds_over_ground(proposal: Proposal, tables: Sequence[SourceTable]) -> None:
    """Add a section for each sensor of the speed over ground beside the wheel: one whose name is that of a radar or an
    optical sensor, and whose unit is stated.
    """
    tach, speeds = proposal.sections.get("tach"), list[dict[str, Any]]()
    for table in tables if tach is not None else ():
        for name in table.columns:
            used = tach is not None and (table.name, name) == (tach["file"], tach["column"])
            unit = unit_in(table.units.get(name) or name, "speed")
            measured = (
                kind_in(table, name) == "speed" and _is_scalar(table, name) and not _is_none_of_wheel(table, name)
            )
            if measured and not used and unit is not None and _sensor_named(table, name) == _OF_NO_WHEEL:
                speeds.append({"file": table.name, **proposal.times_of(table), "column": name, "unit": unit})
    if speeds:
        proposal.sections["speed"] = speeds
        named = ", ".join(f"{part['column']} of {part['file']}" for part in speeds)
        proposal.reasons["speed.column"] = f"{named}: the speed over ground"


def _candidates(tables: Sequence[SourceTable], kind: str) -> list[tuple[SourceTable, str]]:
    """Return a column of this kind of each table that has one, those of which the name says a wheel first.

    Of several in one table it is the one that says a wheel, else one that changes between the receiver's positions.
    """
    columns = []
    for table in tables:
        times, plan = time_columns(table) or (), plan_columns(table)
        names = [name for name in table.columns if kind_in(table, name) == kind and _is_scalar(table, name)]
        names = [name for name in names if name not in times and not _is_none_of_wheel(table, name)]
        if kind == "count":  # one that stays is of something else, or of a wheel at rest
            names = [name for name in names if not _is_constant(table.frame[name]) or _is_one(table.frame[name])]
        names.sort(key=lambda name: _sensor_named(table, name))
        if len(names) > 1 and _sensor_named(table, names[0]) != _OF_A_WHEEL and plan is not None:
            names.sort(key=lambda name: not _changes_between_positions(table, name, plan))
        columns += [(table, name) for name in names[:1]]
    return sorted(columns, key=lambda one: _sensor_named(*one))


def _sensor_named(table: SourceTable, name: str) -> int:
    """Return what a column is of by its name, or else by its table's: a wheel, or a sensor that sees the ground."""
    for text in (name.casefold(), stem_of(table.name).casefold()):
        if _WHEEL.search(text):
            return _OF_A_WHEEL
        if _OVER_GROUND.search(text):
            return _OF_NO_WHEEL
    return _UNNAMED


def _give_reason(proposal: Proposal, table: SourceTable, name: str) -> None:
    """Give the reason for a speed or a distance in the place of the wheel's whose name does not say that it is one."""
    if (sensor := _sensor_named(table, name)) == _OF_NO_WHEEL:
        place = "a section [[speed]] of recording.toml is its own"
        proposal.reasons["tach.column"] = f"{name} is of no wheel, and is taken in the place of one: {place}"
    elif sensor == _UNNAMED:
        proposal.reasons["tach.column"] = f"{name} is taken for the wheel's, which no name says"


def _is_none_of_wheel(table: SourceTable, name: str) -> bool:
    """Return whether a column holds a limit or a set value, or turns of something, and neither its name nor its table's
    calls it a wheel's.
    """
    turns = factor_of(_stated_unit(table, name), "angular rate") is not None
    other = turns or NOT_MEASURED.search(name.casefold()) is not None
    return other and not _WHEEL.search(f"{stem_of(table.name)} {name}".casefold())


def _stated_unit(table: SourceTable, name: str) -> str:
    return table.units.get(name) or parts_of(name).unit or name.rpartition(" ")[2]


def _pulses(which: str, tables: Sequence[SourceTable], ask: Ask) -> dict[str, Any]:
    """Return the keys of pulses and of the wheel that gives them, by default as lines above the tables state them."""
    text = f"Pulses per turn of the wheel, {which}"
    pulses = asked_number(ask, "tach.pulses_per_rev", text, stated_pulses(tables))
    return {"kind": "pulses", "pulses_per_rev": pulses, "wheel_diameter_m": _diameter(ask, stated_diameter(tables))}


def _propose_times_of_pulses(proposal: Proposal, tables: Sequence[SourceTable], ask: Ask) -> None:
    """Add the section of a tachometer of whose pulses a table has the times alone: each row is one."""
    for table in tables:
        times = time_columns(table) or ()
        values = [name for name in table.columns if name not in times and not _is_constant(table.frame[name])]
        named = _PULSES.search(f"{stem_of(table.name)} {' '.join(table.columns)}".casefold())
        if not times or values or not named:
            continue
        clock = proposal.times_of(table, beside=proposal.clock_of_imu(tables))
        pulses = _pulses(f"of which {table.name} has the times", tables, ask)
        proposal.sections["tach"] = {"file": table.name, **clock, "column": ROW_NUMBER, **pulses}
        proposal.reasons["tach.column"] = f"{table.name} has times alone: each row is a pulse"
        return


def _is_constant(column: pd.Series) -> bool:
    return bool((column.dropna() == column.iloc[0]).all())


def _is_one(column: pd.Series) -> bool:
    return bool((column.dropna() == 1).all())


def _of_falls(proposal: Proposal, table: SourceTable, section: dict[str, Any]) -> dict[str, Any]:
    """Return the keys of a count or a distance that falls: of each row's own, or of a wheel that also turns back.

    What a row has since the one before rises and falls in turn, or smoothly within what a vehicle rolls in a row; a
    wheel turns one way for a while.
    """
    name = section["column"]
    values = table.numbers(name)
    finite = values[np.isfinite(values)]
    if section["kind"] == "pulses" and are_levels(finite):
        proposal.reasons["tach.levels"] = f"{name} is 0 or 1 for several rows in turn: its rises are counted"
        return {"levels": True}
    going_on = unwrapped_count(finite)
    if only_falls(going_on):  # the import turns it round
        return {}
    steps = np.diff(going_on)
    moved = steps[steps != 0.0]
    falls, turns = float((moved < 0.0).sum()), float((np.diff(np.sign(moved)) != 0.0).sum())
    in_turn = turns > _TURNS * moved.size
    if finite.size > 1 and (finite == 1.0).all():
        proposal.reasons["tach.increments"] = f"{name} is 1 in all rows: one for each pulse"
        return {"increments": True}
    positive = finite.min() >= 0.0 and going_on.min() >= 0.0
    if falls > 0.25 * moved.size and positive and (in_turn or _can_be_of_each_row(table, section, going_on)):
        proposal.reasons["tach.increments"] = f"{name} rises and falls, and is never negative"
        return {"increments": True}
    if falls > _FALLS * moved.size and not in_turn:
        proposal.reasons["tach.signed"] = f"{name} falls for a while: the vehicle rolled back"
        return {"signed": True}
    return {}


def _can_be_of_each_row(table: SourceTable, section: dict[str, Any], values: np.ndarray) -> bool:
    """Return whether a vehicle could roll that much from each row to the next."""
    try:
        t = times_by_keys(table, section).since(None)
    except BadInputError:
        return True
    interval = float(t[-1] - t[0]) / max(t.size - 1, 1)
    if section["kind"] == "pulses":
        metres = np.pi * section["wheel_diameter_m"] / section["pulses_per_rev"]
    else:
        metres = factor_of(section["unit"], "length") or 1.0
    return bool(np.quantile(values, 0.9) * metres <= CheckLimits().speed_error_mps * interval)


def _is_scalar(table: SourceTable, name: str) -> bool:
    """Return whether a column holds numbers of a wheel: no part of a vector, as a velocity is, no count of samples, and
    nothing of a receiver or of a phone's other sensors.
    """
    is_number = pd.api.types.is_numeric_dtype(table.frame[name])
    folded, of_table = name.casefold(), stem_of(table.name).casefold()
    of_receiver = NAMED_AFTER_RECEIVERS.search(folded) is not None or (
        NAMED_AFTER_RECEIVERS.search(of_table) is not None and not _WHEEL.search(f"{of_table} {folded}")
    )
    is_others = _PHONES.search(f"{of_table} {folded}") is not None or of_receiver
    return is_number and not (is_others or has_axes_beside(table, name) or is_sample_counter(table, name))


def _diameter(ask: Ask, stated: str) -> float:
    return asked_number(ask, "tach.wheel_diameter_m", "Wheel diameter, m", stated or "0.92", (0.0, WHEEL_M[1]))


def _speed(proposal: Proposal, table: SourceTable, name: str, ask: Ask, diameter: str) -> dict[str, Any]:
    """Return the keys of a speed, or of turns of the wheel, whose stated ``diameter`` is the default."""
    section: dict[str, Any] = {"kind": "speed"}
    stated = _stated_unit(table, name)
    if factor_of(stated, "angular rate") is not None:
        section |= {"unit": stated, "wheel_diameter_m": _diameter(ask, diameter)}
    else:
        section["unit"] = _unit_of(proposal, table, name, "speed", ask)
    if np.nanmin(table.numbers(name)) < 0.0:
        section["signed"] = True
        proposal.reasons["tach.signed"] = "some speeds are negative"
    return section


def _is_wheels(table: SourceTable, name: str, imu: str | list[str], ask: Ask) -> bool:
    """Return whether a speed or a distance is a wheel's and not the receiver's, which has positions beside it.

    Where a table has inertial samples too, and the name does not say which it is, the user is asked.
    """
    plan = plan_columns(table)
    if plan is None or _WHEEL.search(name.casefold()):
        return True
    if table.name != imu:
        return False
    # Loggers make a distance of each row from a receiver's speeds.
    of_wheel = kind_in(table, name) == "speed" and _changes_between_positions(table, name, plan)
    likely = "yes" if of_wheel else "no"
    return ask(Question("tach.column", f"Is {name} measured at a wheel, not by GNSS?", likely, ("yes", "no"))) == "yes"


def _changes_between_positions(table: SourceTable, name: str, plan: Sequence[str]) -> bool:
    """Return whether most changes of a column, at speed, are in rows that repeat a position or have none.

    What a receiver measures changes with its positions.
    """
    values = table.numbers(name)
    places = np.stack([table.numbers(column) for column in plan], axis=1)
    stays = ~np.any(np.isfinite(places[1:]) & (places[1:] != places[:-1]), axis=1)
    changes = (np.diff(values) != 0.0) & (np.abs(values[1:]) > 0.5 * np.nanmax(np.abs(values)))
    return int(changes.sum()) >= _FEWEST_CHANGES and float(stays[changes].mean()) > 0.5


def _unit_of(proposal: Proposal, table: SourceTable, name: str, quantity: Literal["speed", "length"], ask: Ask) -> str:
    """Return the unit that a tach's column states, or a usual one, named as assumed. An unknown one is asked."""
    stated, usual = table.units.get(name, ""), {"speed": "m/s", "length": "m"}[quantity]
    unit = unit_in(stated or name, quantity)
    if unit is not None:
        return unit
    if stated.strip(" -1"):
        return asked_unit(ask, "tach.unit", f"Unit of {name}, which the source calls {stated}", "", quantity)
    proposal.assumed["tach.unit"] = f"Unit of {name}"
    return usual
