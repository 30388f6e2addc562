"""Rows of a receiver: which of them are measurements, and how exact they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from trackfg.interchange.importing.columns.receiver_state import (
    RANGE_SD_M,
    UNKNOWN_HEIGHT_SD_M,
    range_sd_m,
    without_position,
)
from trackfg.interchange.importing.mapping import MappedSensor
from trackfg.interchange.importing.sensors.recorded_columns import in_plan
from trackfg.interchange.importing.sensors.sensor_columns import CONSTANT, column_or_number
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.numerics.arrays import Array
from trackfg.recording.interpolated_rows import interpolated_rows
from trackfg.recording.receiver_epochs import held_rows

OF_A_RECEIVER = ("gnss", "gnss_speed")
"""Kinds of sensors whose rows a table may hold."""
_FAR_FROM_ZERO = 10.0
"""Heights, as they are written, that are never below this are not near 0 for a while: a step is no way of a railway."""


def known_rows(sensor: MappedSensor, measured: Sequence[Array]) -> np.ndarray:
    """Return which rows (n,) have a position, or a speed with its sigma, and not what stands for none."""
    if sensor.kind == "gnss":
        plan = np.stack(measured[:2])
        return np.asarray(np.isfinite(plan).all(axis=0) & (plan != 0.0).any(axis=0))
    speed, *sd = measured
    # A phone writes a speed of -1 where it has none, and a sigma of 0 where it knows none.
    return np.asarray(np.all([speed >= 0.0, *(one > 0.0 for one in sd)], axis=0))


def measured_rows(
    sensor: MappedSensor,
    beside: MappedSensor | None,
    table: SourceTable,
    t: Array,
    measured: Sequence[Array],
    keep: np.ndarray,
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return which of the rows (n,) to ``keep``, at times t (n,), s, are measurements, with a note on the others.

    ``beside``: the positions of the same table, by which speeds are held, too.
    """
    if sensor.reading.valid is not None:
        keep = keep & ~without_position(table.column(sensor.reading.valid))
    rows = np.flatnonzero(keep)
    part = replace(table, frame=table.frame.iloc[rows])
    values = [column[rows] for column in measured]
    for find, what in ((_held, "repeat the values of the row above"), (_interpolated, "are interpolated")):
        if (left_out := rows[find(sensor, part, t[rows], values, beside)]).size:
            keep = keep.copy()
            keep[left_out] = False
            counted = f"{len(left_out)} of {len(rows)} rows {what}"
            return keep, (f"{table.name}: {counted}, and are left out of [{sensor.section}]",)
    return keep, ()


def with_sigmas(
    sensor: MappedSensor, table: SourceTable, columns: dict[str, Array], keys: dict[str, Any], keep: np.ndarray
) -> tuple[dict[str, Array], dict[str, Any], tuple[str, ...]]:
    """Return columns and keys of positions with sigmas by quality, and a wide one where the height is none; speeds as
    they are. ``keep``: the rows (n,) that have a position.
    """
    if sensor.kind != "gnss":
        return columns, keys, ()
    return _without_zero_heights(table, _by_quality(sensor, table, columns, keys), keys, keep)


def _held(
    sensor: MappedSensor, table: SourceTable, t: Array, measured: Sequence[Array], beside: MappedSensor | None
) -> np.ndarray:
    """Return which rows (n,) at times t (n,), s, of a receiver hold what is ``measured`` of a row before.

    ``beside``: the positions of the same table, by which speeds are held, too, unless they have changed by themselves.
    """
    values, positions = np.stack(measured, axis=1), sensor if sensor.kind == "gnss" else beside
    if positions is None:
        return held_rows(t, values)
    place = np.stack([column_or_number(positions, table, part) for part in positions.keys["position"]], axis=1)
    both = values if positions is sensor else np.concatenate([place, values], axis=1)
    return held_rows(t, both, in_plan(positions, place))


def _interpolated(
    sensor: MappedSensor, table: SourceTable, t: Array, measured: Sequence[Array], beside: MappedSensor | None
) -> np.ndarray:
    """Return which rows (n,) of a receiver are interpolated between its measurements; arguments as of :func:`held`."""
    values = np.stack(measured, axis=1)
    return interpolated_rows(t, in_plan(sensor, values) if sensor.kind == "gnss" else values[:, :1])


def _by_quality(
    sensor: MappedSensor, table: SourceTable, columns: dict[str, Array], keys: dict[str, Any]
) -> dict[str, Array]:
    """Return the columns of positions, with constant sigmas times the dilution of precision and by quality.

    That of a constant height stays: no quality says how far the vehicle is from it.
    """
    factor = np.ones(len(table.frame))
    if sensor.reading.dop is not None:
        dop = table.numbers(sensor.reading.dop)
        factor = np.where(dop > 0.0, dop, 1.0)  # 0 or nothing: not known
    if sensor.reading.quality is not None:
        factor = factor * range_sd_m(table.column(sensor.reading.quality)) / RANGE_SD_M
    scaled = [
        sd
        for place, sd in zip(keys["position"], keys["sd"], strict=False)
        if sd.startswith(CONSTANT) and not place.startswith(CONSTANT)
    ]
    return {name: values * factor if name in scaled else values for name, values in columns.items()}


def _without_zero_heights(
    table: SourceTable, columns: dict[str, Array], keys: dict[str, Any], keep: np.ndarray
) -> tuple[dict[str, Array], dict[str, Any], tuple[str, ...]]:
    """Return columns and keys of positions with a wide sigma where the height is exactly 0 beside others far from it.

    Receivers write 0 for the height of a fix in two dimensions. ``keep``: the rows (n,) that have a position.
    """
    height, sd = keys["position"][2], keys["sd"][2]
    values = columns[height]
    zero = (values == 0.0) & keep
    others = np.abs(values[keep & ~zero & np.isfinite(values)])
    if not zero.any() or not others.size or others.min() < _FAR_FROM_ZERO:
        return columns, keys, ()
    wide = f"{CONSTANT}height_sd"
    columns = {**columns, wide: np.where(zero, UNKNOWN_HEIGHT_SD_M, columns[sd])}
    keys = {**keys, "sd": [*keys["sd"][:2], wide]}
    note = f"{table.name}: {np.count_nonzero(zero)} heights of exactly 0 beside others of {others.min():g} and more"
    return columns, keys, (f"{note} are taken for none: their sigma is {UNKNOWN_HEIGHT_SD_M:g} m",)
