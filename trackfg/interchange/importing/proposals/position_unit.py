"""The unit of latitudes and longitudes: degrees, radians, or whole numbers of a power of ten of a degree."""

from __future__ import annotations

import re
from math import pi

import numpy as np

from trackfg.errors import BadInputError
from trackfg.interchange.importing.columns.column_meaning import first_of
from trackfg.interchange.importing.columns.column_names import parts_of
from trackfg.interchange.importing.columns.written_units import factor_of, unit_in
from trackfg.interchange.importing.proposals.questions import Ask, Proposal, Question
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.times.reading import times_by_keys
from trackfg.numerics import geodesy
from trackfg.numerics.units import KMH, KNOT, MPH

RAW_DEGREES = "1e-7 deg"
"""Unit of coordinates in messages of u-blox and of MAVLink."""
_POWERS = (7, 6, 5)
_NAMED_POWER = re.compile(r"e[-_]?([5-7])$", re.IGNORECASE)
"""What a name of whole numbers ends in, ``latitudeE7``."""
_RIGHT_ANGLE = 90.0
_SPEEDS = (1.0, KMH, KNOT, MPH)
"""What a speed without a unit may be in, m/s: less than a power of ten apart."""


def unit_of_position(proposal: Proposal, table: SourceTable, plan: tuple[str, str], ask: Ask) -> dict[str, str]:
    """Return the key of a unit other than degrees: radians, or whole numbers of 1e-7, 1e-6 or 1e-5 deg.

    The power of ten is that of the name, the only possible one, or that with which the positions are as fast as the
    speeds beside them; else it is asked. Raises :class:`BadInputError` for degrees and minutes in one number.
    """
    stated = table.units.get(plan[0]) or parts_of(plan[0]).unit
    if factor_of(stated, "angle") == 1.0:
        return {"position_unit": "rad"}
    values = np.stack([table.numbers(name) for name in plan])
    latitude, longitude = (float(np.nanmax(np.abs(part), initial=0.0)) for part in values)
    if not stated and 0.0 < latitude <= pi / 2.0 and longitude <= pi:
        # As degrees they would be in the Gulf of Guinea, whose shores are further from 0 than this.
        proposal.reasons["gnss.position_unit"] = "the values are those of radians: as degrees they would be at sea"
        return {"position_unit": "rad"}
    if latitude > _RIGHT_ANGLE and bool((np.nan_to_num(values) % 1.0 == 0.0).all()):
        powers = [power for power in _POWERS if latitude <= _RIGHT_ANGLE * 10.0**power]
        if (named := _NAMED_POWER.search(plan[0].strip())) is not None and int(named[1]) in powers:
            powers = [int(named[1])]
        if powers:
            return {"position_unit": _of_powers(proposal, table, plan, powers, ask)}
    if _RIGHT_ANGLE < latitude <= _RIGHT_ANGLE * 100.0:
        raise BadInputError(
            f"{table.name}: column {plan[0]!r} has values up to {latitude:g}, degrees and minutes in one number "
            "(ddmm.mmmm) or minutes alone; expected degrees. Hint: write degrees + minutes / 60 with a sign, state "
            'position_unit = "0.0166666667 deg" in a mapping if they are minutes, or import the NMEA log'
        )
    return {}


def _of_powers(proposal: Proposal, table: SourceTable, plan: tuple[str, str], powers: list[int], ask: Ask) -> str:
    units = tuple(f"1e-{power} deg" for power in powers)
    if len(units) == 1:
        return units[0]
    if (power := _as_fast_as_speeds(proposal, table, plan, powers)) is not None:
        proposal.reasons["gnss.position_unit"] = "with it the positions are as fast as the speeds beside them"
        return f"1e-{power} deg"
    text = f"Unit of {' and '.join(plan)}, which are whole numbers"
    return ask(Question("gnss.position_unit", text, units[0], units))


def _as_fast_as_speeds(proposal: Proposal, table: SourceTable, plan: tuple[str, str], powers: list[int]) -> int | None:
    """Return the power of ten with which the positions move as fast as the table's speeds; None where none show it."""
    name = first_of(table, "speed")
    if name is None:
        return None
    times = times_by_keys(table, proposal.times_of(table))
    speed, values = table.numbers(name), np.stack([table.numbers(column) for column in plan], axis=1)
    known = np.isfinite(speed) & np.isfinite(values).all(axis=1) & (values != 0.0).all(axis=1)
    t, speed, values = times.since(times.first_ns)[known], speed[known], values[known]
    fast = speed[1:] > 0.5 * speed.max(initial=0.0)
    if not fast.any():
        return None
    unit = unit_in(table.units.get(name) or name, "speed")
    per_second = _SPEEDS if unit is None else (factor_of(unit, "speed") or 1.0,)
    rolled = float((speed[1:] * np.diff(t))[fast].sum())
    off = {}
    for power in powers:
        geodetic = np.concatenate([values * 10.0**-power, np.zeros((len(values), 1))], axis=1)
        steps = np.diff(geodesy.geodetic_to_enu(geodetic, geodetic[0])[:, :2], axis=0)
        ratio = float(np.linalg.norm(steps, axis=1)[fast].sum()) / rolled
        off[power] = min(abs(np.log(max(ratio, 1e-12) / factor)) for factor in per_second)
    return min(off, key=lambda power: off[power])
