"""Which columns are those of the inertial sensor, and in which units."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import takewhile
from typing import Any

import numpy as np

from trackfg.errors import BadInputError
from trackfg.interchange.importing.columns.column_meaning import (
    QUANTITY_OF,
    InertialKind,
    Triple,
    are_increments,
    has_gravity,
    is_called_increment,
    keeps_gravity,
    kind_in,
    nameless_triples,
    triple_of,
    triples,
    unit_of_turns,
)
from trackfg.interchange.importing.columns.column_names import meaning, names_axis_in_words, parts_of
from trackfg.interchange.importing.columns.plan_columns import plan_columns
from trackfg.interchange.importing.proposals.questions import Ask, Proposal, Question, asked, asked_unit
from trackfg.interchange.importing.source_table import SourceTable

_WITHOUT_GRAVITY = (
    "the acceleration is without gravity, which roll and pitch need; expected the specific force (total acceleration). "
    "Hint: switch on the accelerometer itself, not the linear, free or user acceleration"
)
_ANGLE = re.compile(r"(euler ?)?(roll|pitch|yaw|heading)( ?angle)?|euler ?[xyz]?")
_UNNAMED = re.compile(r"c\d+")
"""Names that columns get which have none."""
_SLOW_COPY = 0.5
"""Columns with fewer rows than that share of the most are slow copies of a sensor."""
_CORE_MOTION = re.compile(r"accelerometerAcceleration|motionUserAcceleration")
"""Names of SensorLog, which logs what iOS measures: the force of gravity, -1 g upwards at rest."""
_SECOND_CHOICE = re.compile(
    r"uncomp|uncal|filt|smooth|low.?pass|average|high.?(g|range)(?![a-z])|(^|[\s_])hg(?![a-z])", re.IGNORECASE
)
"""Names of columns that another sensor, or the same one, has better: filtered ones, which lack the short waves of the
track, and those of a range for shocks, which are noisy.
"""
_KNOWN_AXES = {re.compile(r"corrimu", re.IGNORECASE): "FRU"}
"""Axes of columns in a table of that name, as words for x, y and z. NovAtel's pitch rate and lateral acceleration are
about and along the axis to the right (OEM7 Commands and Logs Reference Manual, CORRIMUDATA)."""
_NAMED_TABLES = 8
"""Tables that a message names."""


def propose_imu(proposal: Proposal, tables: Sequence[SourceTable], ask: Ask) -> None:
    """Add the section of the inertial sensor.

    Raises :class:`BadInputError` where gyro or accelerometer are not found, or where gravity was removed.
    """
    gyro = _chosen(tables, "gyro", ask)
    accel = _chosen(tables, "accel", ask, beside=gyro)
    if (
        accel is None
        and (accel := _chosen(tables, "free_accel", ask, beside=gyro)) is not None
        and not has_gravity(accel)
    ):
        raise BadInputError(_WITHOUT_GRAVITY)
    if gyro is None and accel is None:
        gyro, accel = _of_nameless(proposal, tables, ask)
    if gyro is None or accel is None:
        lacking = [name for name, triple in (("gyro", gyro), ("accelerometer", accel)) if triple is None]
        for table in tables:
            for name in table.columns:
                if kind_in(table, name) in QUANTITY_OF:
                    table.numbers(name)  # one of text is why they are not found
        raise BadInputError(_not_found(lacking, tables))
    gyro = _as_its_accelerometer(gyro, accel)
    section: dict[str, Any] = {"file": gyro.table.name}
    if not _same_rows(gyro, accel):
        section["file"] = [gyro.table.name, accel.table.name]
    section |= proposal.times_of(gyro.table, ask)
    for key, triple in (("gyro", gyro), ("accel", accel)):
        section[key] = list(triple.columns)
        section[f"{key}_unit"] = _unit(proposal, triple, key, ask)
    axes = next((axes for pattern, axes in _KNOWN_AXES.items() if pattern.search(gyro.table.name)), None)
    if axes is not None and names_axis_in_words(gyro.columns[0]):
        section["axes"] = axes
        proposal.reasons["imu.axes"] = "those of the message after which the table is named"
    proposal.sections["imu"] = section


def _as_its_accelerometer(gyro: Triple, accel: Triple) -> Triple:
    """Return a gyro whose unit is not stated as one of increments where its accelerometer's samples are such, and both
    are called so or neither is.

    One that alone is called so has no unit that is sure.
    """
    if gyro.known or gyro.table.name != accel.table.name:
        return gyro
    if is_called_increment(gyro) == is_called_increment(accel):
        return replace(gyro, unit=unit_of_turns(gyro)) if are_increments(accel) else gyro
    return replace(gyro, unit="") if is_called_increment(gyro) else gyro


def _not_found(lacking: Sequence[str], tables: Sequence[SourceTable]) -> str:
    names = "; ".join(f"{table.name}: {', '.join(table.columns[:20])}" for table in tables[:_NAMED_TABLES])
    more = f" and {len(tables) - _NAMED_TABLES} more tables" if len(tables) > _NAMED_TABLES else ""
    if len(lacking) > 1 and any(plan_columns(table) is not None for table in tables):
        return (
            f"positions, but no gyro and no accelerometer found among {names}{more}; expected the samples of an "
            "inertial sensor, without which nothing is estimated. Hint: give the folder in which they lie beside the "
            "positions, or name their columns in a mapping (docs/importing.md)"
        )
    if all(_UNNAMED.fullmatch(name) for table in tables for name in table.columns):
        return (
            f"{tables[0].name}: no row of names of columns found: {names}{more}; expected one above the data. Hint: "
            "write one, such as time_s,gyro_x,gyro_y,gyro_z, with units in brackets; or name c1, c2, ... in a mapping "
            "(docs/importing.md)"
        )
    if lacking[0] == "accelerometer" and any(
        meaning(f"{name} x") == "free_accel" for table in tables for name in table.columns
    ):
        return _WITHOUT_GRAVITY
    empty = [name for table in tables for name in table.columns if table.frame[name].isna().all()]
    more += f" (no value in any row of {', '.join(empty[:20])})" if empty else ""
    kind = "gyro" if lacking[0] == "gyro" else "accel"
    fewer = [name for table in tables for name in table.columns if kind_in(table, name) == kind]
    more += f" ({', '.join(fewer[:20])} alone: all three axes are needed)" if fewer and not empty else ""
    angles = [name for table in tables for name in table.columns if _ANGLE.fullmatch(parts_of(name).words)]
    more += f" ({', '.join(angles[:20])}: angles, of which no rates are made)" if angles and kind == "gyro" else ""
    return (
        f"no three columns of the {lacking[0]} found among {names}{more}; expected names such as gyro_x, or for a "
        "track geometry a column of places and channels such as level. Hint: name them in a mapping (docs/importing.md)"
    )


def _chosen(tables: Sequence[SourceTable], kind: InertialKind, ask: Ask, beside: Triple | None = None) -> Triple | None:
    """Return the columns of a kind: of several sensors the one whose names are most like those ``beside``, or asked."""
    candidates = [triple for table in tables for triple in triples(table, kind)]
    rows = [triple.values().shape[1] for triple in candidates]
    candidates = [triple for triple, n in zip(candidates, rows, strict=True) if n > _SLOW_COPY * max(rows)]
    if kind == "accel":
        candidates = [triple for triple in candidates if triple.known and has_gravity(triple)] or candidates
    if len(candidates) > 1 and beside is not None:
        alike = [_likeness(triple, beside) for triple in candidates]
        candidates = [triple for triple, value in zip(candidates, alike, strict=True) if value == max(alike)]
    if len(candidates) < 2:
        return next(iter(candidates), None)
    candidates.sort(key=lambda triple: _SECOND_CHOICE.search(triple.columns[0]) is not None)
    names = _x_axes([(triple.table, triple.columns) for triple in candidates])
    sensor = "gyro" if kind == "gyro" else "accelerometer"
    question = Question(f"imu.{kind}", f"Which {sensor} is to be used (its x axis)?", names[0], tuple(names))
    return candidates[names.index(ask(question))]


def _of_nameless(proposal: Proposal, tables: Sequence[SourceTable], ask: Ask) -> tuple[Triple | None, Triple | None]:
    """Return gyro and accelerometer among columns that are named after axes alone: the one of two that keeps gravity is
    the accelerometer. What does not show is asked. None for both where there are no two such triples.
    """
    unnamed = [(table, columns) for table in tables for columns in nameless_triples(table)]
    if len(unnamed) < 2:
        return None, None
    names = _x_axes(unnamed)
    with_gravity = [i for i, one in enumerate(unnamed) if keeps_gravity(triple_of(*one, "accel"))]
    if len(with_gravity) == 1:
        accel = with_gravity[0]
        proposal.reasons["imu.accel"] = "the names are those of axes alone: gravity shows it"
    else:
        accel = names.index(_which(ask, "accel", names, "the length of gravity does not show it"))
    others = [i for i in range(len(unnamed)) if i != accel]
    if len(others) == 1:
        gyro = others[0]
        proposal.reasons["imu.gyro"] = "the names are those of axes alone: it is the other one"
    else:
        rest = [names[i] for i in others]
        gyro = others[rest.index(_which(ask, "gyro", rest, "there are several besides the accelerometer"))]
    return triple_of(*unnamed[gyro], "gyro"), triple_of(*unnamed[accel], "accel")


def _which(ask: Ask, key: str, names: Sequence[str], why: str) -> str:
    sensor = "gyro" if key == "gyro" else "accelerometer"
    text = f"Which columns are those of the {sensor}, by their x axis? The names do not say it, and {why}"
    expected = f"one of {', '.join(names)}"
    return asked(ask, Question(f"imu.{key}", text, "", tuple(names), lambda name: name in names, expected=expected))


def _x_axes(unnamed: Sequence[tuple[SourceTable, tuple[str, str, str]]]) -> list[str]:
    """Return names for triples of columns: that of the x axis, with the table's where these are in several."""
    one_table = len({table.name for table, _ in unnamed}) == 1
    return [columns[0] if one_table else f"{table.name}:{columns[0]}" for table, columns in unnamed]


def _likeness(triple: Triple, other: Triple) -> tuple[bool, int]:
    """Return how much the names of two triples have in common: the table, and the first letters of their columns."""
    names = triple.columns[0].casefold(), other.columns[0].casefold()
    same = takewhile(lambda pair: pair[0] == pair[1], zip(*names, strict=False))
    return triple.table.name == other.table.name, sum(1 for _ in same)


def _same_rows(gyro: Triple, accel: Triple) -> bool:
    """Return whether both are in the same rows of one table."""
    if gyro.table.name != accel.table.name:
        return False
    finite = [np.isfinite(triple.table.numbers(triple.columns[0])) for triple in (gyro, accel)]
    return bool((finite[0] & finite[1]).sum() >= _SLOW_COPY * min(finite[0].sum(), finite[1].sum()))


def _unit(proposal: Proposal, triple: Triple, key: str, ask: Ask) -> str:
    """Return the unit of three columns: without a stated one a likely one, named as assumed, or the answer."""
    if key == "accel" and _CORE_MOTION.match(triple.columns[0]):
        proposal.reasons["imu.accel_unit"] = "an iPhone's acceleration reads -1 g upwards at rest"
        return f"-1 {triple.unit or 'g'}"
    if triple.known:
        return triple.unit
    text, stated = f"Unit of {', '.join(triple.columns)}", triple.table.units.get(triple.columns[0], "")
    if not triple.unit:
        more = f"which the source calls {stated}" if stated else "or what one count is worth"
        return asked_unit(ask, f"imu.{key}_unit", f"{text}, {more}", "", QUANTITY_OF[key])
    if key == "accel":
        proposal.reasons["imu.accel_unit"] = "gravity shows it, to about 1 %"
    else:
        proposal.assumed[f"imu.{key}_unit"] = text
    return triple.unit
