"""Tables whose clocks do not meet the IMU's: rows far from its time, another time zone, a part that is missing."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from trackfg.checks.columns import ColumnPlace
from trackfg.checks.diagnosis_silence import SHORTEST_S
from trackfg.checks.limits import CheckLimits
from trackfg.numerics.arrays import Array
from trackfg.numerics.units import known_units, to_si
from trackfg.recording.description import Table
from trackfg.recording.findings import Finding, Level
from trackfg.recording.strict_model import Model

_HALF_HOUR_S, _ZONES_S = 1800.0, 14.0 * 3600.0
"""Zones differ by whole half hours, up to so many seconds from UTC."""
_MOST = 0.5
"""Where less of a table meets the IMU after a shift, that is chance: its clock begins somewhere else."""
_SHRUNK = 100.0
"""Times of a larger unit than declared cover a thousandth of the record, those of a sensor that failed any part."""
_FEWEST = 10
"""Rows: fewer may be so close together by chance."""
_SAME_ENDS_S = 60.0
"""Sensors that record the same run begin and end no further apart, s."""


def clock_findings(
    imu: pd.DataFrame, parts: Mapping[str, Model], tables: Mapping[str, pd.DataFrame], limits: CheckLimits
) -> list[Finding]:
    """Return which ``tables`` do not meet the IMU's time, or meet it in part only; ``parts`` are their descriptions."""
    findings, expected = [], "times within those of the IMU"
    begin, end = imu["t_s"].iloc[[0, -1]]
    for name, table in tables.items():
        part = parts[name]
        if name == "imu" or not isinstance(part, Table):
            continue
        t = table["t_s"].to_numpy()
        share = float(np.mean((t >= begin) & (t <= end)))
        section = f"[[{name.partition('[')[0]}]]" if name.endswith("]") else f"[{name}]"
        covers = f"the table covers {t[0]:.9g} to {t[-1]:.9g} s, the IMU {begin:.9g} to {end:.9g} s"
        if (unit := _unit_that_fits(part, t, (begin, end), share)) is not None:
            hint = f'the times look like {unit}: set time_unit = "{unit}" in {section}'
            findings.append(
                Finding("error", "time-unit", covers, file=part.file, column=part.time, expected=expected, hint=hint)
            )
            continue
        near = _near(imu, table, limits)
        message = f"far from the IMU's time, {begin:.9g} to {end:.9g} s: left out"
        hint = "remove the rows, or write their times on the recording's clock"
        place = ColumnPlace(part.file, part.time, t)
        findings += place.at_first(~near & near.any(), "clocks-apart", message, expected, hint, "warning")
        zone_s = _zone_apart_s((begin, end), t, share)
        if share >= limits.overlap_warning and zone_s == 0.0:
            findings += _rolls_on(imu, table, near, place) if name.startswith("tach") else []
            continue
        is_error = (share == 0.0 and (t[0] > end or t[-1] < begin)) or not near.any()
        message = covers + (": the clocks do not overlap" if is_error else f": {share:.0%} of its rows are within")
        hint = f"set time_offset_s of {section} (first rows together: {begin - t[0]:.9g}), or its time_unit"
        if zone_s != 0.0:
            offset_s = part.time_offset_s + zone_s
            hint = f"set time_offset_s = {offset_s:g} in {section}: its times look like those of another time zone"
        level: Level = "error" if is_error else "warning"
        findings.append(
            Finding(level, "clocks-apart", message, file=part.file, column=part.time, expected=expected, hint=hint)
        )
    return findings


def _unit_that_fits(part: Table, t: Array, record: tuple[float, float], share: float) -> str | None:
    """Return the unit in which times (n,), s, of a table fill most of a ``record``, between two times, s.

    None where there is no other than the declared one: most of them are within the record as they are, the ``share``,
    and not so close together that they are of a larger unit.
    """
    (begin, end), span = record, float(np.ptp(t))
    shrunk = len(t) >= _FEWEST and span < (end - begin) / _SHRUNK
    if share > _MOST and not shrunk:
        return None
    raw = (t - part.time_offset_s) / to_si("time", part.time_unit)
    for unit in known_units("time"):
        read = raw * to_si("time", unit) + part.time_offset_s
        fits = float(np.mean((read >= begin) & (read <= end)))
        if unit != part.time_unit and fits > _MOST and np.ptp(read) > _MOST * (end - begin):
            return unit
    return None


def _zone_apart_s(record: tuple[float, float], t: Array, share: float) -> float:
    """Return by how much times (n,), s, of another time zone are to be shifted; 0 where they are of the same.

    Most of them fit a ``record``, between two times, s, then, and more than the ``share`` of them that is within it as
    they are. In a run of hours most are within it all the same: then both ends have to fit.
    """
    begin, end = record
    shift = _HALF_HOUR_S * round((begin - t[0]) / _HALF_HOUR_S)
    if not 0.0 < abs(shift) <= _ZONES_S:
        return 0.0
    fits = float(np.mean((t + shift >= begin) & (t + shift <= end)))
    same_ends = max(abs(t[0] + shift - begin), abs(t[-1] + shift - end)) < _SAME_ENDS_S
    return shift if fits > max(share, _MOST) and (same_ends or share == 0.0) else 0.0


def _rolls_on(imu: pd.DataFrame, tach: pd.DataFrame, near: np.ndarray, place: ColumnPlace) -> list[Finding]:
    """Return findings for a wheel that rolls for 20 s or more before the first row of the IMU, or after its last: a
    part is missing.
    """
    (begin, end), t, distance = imu["t_s"].iloc[[0, -1]], tach["t_s"].to_numpy(), tach["distance_m"].to_numpy()
    expected, hint = "an IMU that measures as long", "look for the missing rows: nothing is estimated there"
    findings, rolls = list[Finding](), np.append(np.diff(distance) != 0.0, False)
    first, last = f"before the IMU's first row, at {begin:.9g} s", f"after the IMU's last row, at {end:.9g} s"
    for outside, where in ((near & (t < begin), first), (near & (t > end), last)):
        rolled = outside & rolls
        if rolled.any() and np.ptp(t[rolled]) >= SHORTEST_S:
            message = f"the wheel rolls {np.abs(np.diff(distance[outside])).sum():.4g} m {where}"
            findings += place.at_first(outside, "imu-absent", message, expected, hint, "warning")
    return findings


def of_this_run(imu: pd.DataFrame | None, table: pd.DataFrame, limits: CheckLimits) -> pd.DataFrame:
    """Return a table without rows far from the IMU's time, unless all are, which is an error by itself."""
    if imu is None:
        return table
    near = _near(imu, table, limits)
    return table if near.all() or not near.any() else table[near].reset_index(drop=True)


def _near(imu: pd.DataFrame, table: pd.DataFrame, limits: CheckLimits) -> np.ndarray:
    begin, end = imu["t_s"].iloc[[0, -1]]
    apart_s = max(end - begin, limits.far_row_s)
    return table["t_s"].between(begin - apart_s, end + apart_s).to_numpy()
