"""Columns of a source get units that a recording knows."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from trackfg.errors import BadInputError
from trackfg.interchange.importing.columns.column_meaning import INCREMENT_OF, QUANTITY_OF
from trackfg.interchange.importing.columns.written_units import Quantity, factor_of, recorded_unit
from trackfg.interchange.importing.mapping import MappedSensor
from trackfg.interchange.importing.sensors.pulse_levels import rises
from trackfg.interchange.importing.sensors.wheel_count import unwrapped_count
from trackfg.interchange.importing.times.clock import Times
from trackfg.io.features import LOCAL, in_wgs_84
from trackfg.numerics import geodesy
from trackfg.numerics.arrays import Array

_EXAMPLES: dict[Quantity, str] = {
    "angular rate": "rad/s, deg/s, deg/h, or 8.75 mdeg/s of a count; rad or deg of increments",
    "acceleration": "m/s^2, g, mg, or 0.122 mg of a count; m/s of increments",
    "speed": "m/s, km/h, mph, or with wheel_diameter_m rpm, with pulses_per_rev Hz",
    "length": "m, mm, ft, or 0.25 mm of a count",
}

_GEODETIC = ("latitude_deg", "longitude_deg")
"""Columns that easting and northing become."""

Columns = dict[str, Array]


def in_recorded_units(
    sensor: MappedSensor, times: Times, columns: Mapping[str, Array], keys: Mapping[str, Any]
) -> tuple[Columns, dict[str, Any]]:
    """Return columns in units that a recording knows, and the keys of the description with these.

    Increments of an IMU become rates over the interval before them, and turns of a wheel its speed. Pulses and
    distances are unwrapped, or summed up where each row has an increment or a level. Raises :class:`BadInputError` for
    an unknown unit.
    """
    columns, keys = dict(columns), dict(keys)
    if sensor.kind == "tach" and keys.get("kind") in ("pulses", "distance"):
        columns = {name: _counted(sensor, values) for name, values in columns.items()}
        if keys["kind"] == "pulses":
            return columns, keys
    if sensor.kind == "gnss":
        *plan, height = keys["position"]
        if sensor.reading.crs is not None:
            place = in_wgs_84(
                np.stack([columns.pop(name) for name in plan], axis=1), sensor.reading.crs, "[gnss] crs", each="row"
            )
            columns |= dict(zip(_GEODETIC, place.T, strict=True))
            keys["position"] = [*_GEODETIC, height]
        elif keys.get("frame") != LOCAL:
            for name in plan:
                columns[name] = columns[name] * _factor_of_position(sensor, sensor.reading.position_unit, "angle")
        columns[height] = columns[height] * _factor_of_position(sensor, sensor.reading.height_unit, "length")
    for key, unit_key, quantity in _quantities(sensor, keys):
        unit = keys.get(unit_key)
        if not isinstance(unit, str):  # the description refuses anything else
            continue
        unit_name, factor = _recorded(sensor, unit_key, quantity, times)
        keys[unit_key] = unit_name
        value = sensor.keys.get(key)
        names = (str(name) for name in (value if isinstance(value, list | tuple) else [value]))
        if factor != 1.0:
            columns |= {name: columns[name] * factor for name in names if name in columns}
    return columns, keys


def _counted(sensor: MappedSensor, values: Array) -> Array:
    """Return a wheel's counts or distances (n,), unwrapped, or the sum of increments, or of the rises of levels."""
    if sensor.reading.increments:
        return np.cumsum(values)
    if sensor.reading.levels:
        return rises(values)
    return unwrapped_count(values, sensor.count_wraps_at, signed=bool(sensor.keys.get("signed")))


def in_plan(sensor: MappedSensor, position: Array) -> Array:
    """Return where positions (n, 2 or 3), in the units of their table, are in plan about the first, m. Shape (n, 2)."""
    if sensor.keys.get("frame") == LOCAL or sensor.reading.crs is not None:
        return position[:, :2] - position[:1, :2]
    geodetic = np.zeros((len(position), 3))  # the height is in a unit of its own, and without influence
    geodetic[:, :2] = position[:, :2] * _factor_of_position(sensor, sensor.reading.position_unit, "angle")
    return geodesy.geodetic_to_enu(geodetic, geodetic[0])[:, :2]


def _factor_of_position(sensor: MappedSensor, unit: str, quantity: Literal["angle", "length"]) -> float:
    """Return what a coordinate is multiplied by to be in degrees, or a height in metres."""
    factor = factor_of(unit, quantity)
    if factor is None:
        key, examples = ("position_unit", "deg, rad, 1e-7 deg") if quantity == "angle" else ("height_unit", "m, ft, mm")
        raise BadInputError(f"[{sensor.section}] {key} = {unit!r} is none; expected one such as {examples}")
    return factor if quantity == "length" else factor / math.radians(1.0)


def _quantities(sensor: MappedSensor, keys: Mapping[str, Any]) -> list[tuple[str, str, Quantity]]:
    """Return the keys that name columns, those of their units, and what is measured."""
    if sensor.kind == "imu":
        return [(key, f"{key}_unit", QUANTITY_OF[key]) for key in ("gyro", "accel")]
    if sensor.kind == "gnss_speed":
        return [(key, "unit", "speed") for key in ("column", "sd") if key in keys]
    if sensor.kind == "speed" or keys.get("kind") == "speed":
        return [("column", "unit", "speed")]
    return [("column", "unit", "length")] if sensor.kind in ("tach", "laser") else []


def _recorded(sensor: MappedSensor, unit_key: str, quantity: Quantity, times: Times) -> tuple[str, float]:
    """Return the unit that the recording gets, and what values are multiplied by."""
    unit = sensor.keys[unit_key]
    assert quantity in ("angular rate", "acceleration", "speed", "length")
    same = recorded_unit(unit, quantity)
    if same is not None:
        return same
    if sensor.kind == "imu":
        increment = factor_of(unit, INCREMENT_OF[unit_key.partition("_")[0]])
        if increment is not None:
            # A lost sample must not look like a slow one: increments are over the usual interval.
            interval = float(np.median(np.diff(times.since(times.first_ns))))
            return {"angular rate": "rad/s"}.get(quantity, "m/s^2"), increment / interval
    hint = ""
    if quantity == "speed":
        wheel = {key: sensor.keys.get(key) for key in ("wheel_diameter_m", "pulses_per_rev")}
        diameter, pulses = (float(size) if isinstance(size, int | float) else None for size in wheel.values())
        if (turning := factor_of(unit, "angular rate")) is not None:
            if diameter is not None:
                return "m/s", turning * 0.5 * diameter
            hint = " Hint: state wheel_diameter_m"
        if (rate := factor_of(unit, "frequency")) is not None:
            if diameter is not None and pulses is not None:
                return "m/s", rate * np.pi * diameter / pulses
            hint = " Hint: state wheel_diameter_m and pulses_per_rev"
    raise BadInputError(
        f"[{sensor.section}] {unit_key} = {unit!r} is no unit of {quantity}; expected one such as "
        f"{_EXAMPLES[quantity]}.{hint}"
    )
