"""Values that are well-formed but cannot be true: wrong axes, wrong units, clocks that do not meet.

Errors here are those that no real run can produce; doubts are left to :mod:`trackfg.checks.diagnosis`. Arguments:
``parts`` of the description and the canonical ``tables``, both by name (``"imu"``, ``"laser 1"``), as far as they could
be read.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime, timedelta

import pandas as pd

from trackfg.checks.clock_overlap import clock_findings, of_this_run
from trackfg.checks.columns import interval_finding
from trackfg.checks.inertial.inertial_units import gravity_findings, gyro_findings
from trackfg.checks.limits import CheckLimits
from trackfg.checks.sizes import GAUGE_M, unusual_size
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import median_interval
from trackfg.recording.description import Imu, Track
from trackfg.recording.findings import Finding, Section
from trackfg.recording.strict_model import Model
from trackfg.sensors.averages import averaged

_STEP_S = 0.5
"""Step of the averages of motion that are looked at, s."""
_SAME_LATITUDE_DEG = 0.5
"""A line is so near to the latitude that is declared for it, deg: 55 km."""


def findings(
    parts: Mapping[str, Model],
    tables: Mapping[str, pd.DataFrame],
    toml: str,
    limits: CheckLimits,
    gnss_origin: Array | None = None,
) -> list[Finding]:
    """Return all findings of values that cannot be true. ``toml`` is the name of the description's file."""
    report: list[Finding] = []
    imu, imu_table, tach_table = parts.get("imu"), tables.get("imu"), tables.get("tach")
    if tach_table is not None:
        tach_table = of_this_run(imu_table, tach_table, limits)
    track = parts.get("track")
    if isinstance(track, Track):
        report += _track(track, toml, gnss_origin)
    report += _assumed({name: parts[name] for name in tables if name in parts}, toml)
    if isinstance(imu, Imu) and imu_table is not None:
        rate = interval_finding(median_interval(imu_table["t_s"].to_numpy()), imu.file, imu.time, limits, imu.time_unit)
        report += [] if rate is None else [rate]
        report += gravity_findings(imu, imu_table, toml, limits)
        if rate is None:
            motion = averaged(imu_table, tach_table, _STEP_S) or averaged(imu_table, None, _STEP_S)
            report += [] if motion is None else gyro_findings(imu, motion, limits)
            report += clock_findings(imu_table, parts, tables, limits)
    return report


_CLOCK_ZEROS = tuple(datetime(*day, tzinfo=UTC) for day in ((1970, 1, 1), (1980, 1, 1), (1980, 1, 6), (2000, 1, 1)))
"""The dates at which clocks start counting: the epochs of Unix, of PCs and of GPS (IS-GPS-200), and the year 2000 of
real-time clocks with two digits for the year. A clock that was never set shows a time shortly after one of them."""
_DAY = timedelta(days=1)
"""How long a clock may have run since its zero; how far one may be ahead, zones included."""


def start_doubts(start: datetime | None, toml: str) -> list[Finding]:
    """Return a warning where the date of a recording is that of a clock that was not set, or is to come.

    Stores list runs by their dates, and trends follow them.
    """
    if start is None:
        return []
    utc = start.replace(tzinfo=UTC) if start.tzinfo is None else start
    if any(abs(utc - zero) <= _DAY for zero in _CLOCK_ZEROS):
        message = f"is {utc:%Y-%m-%d %H:%M} UTC, which a clock shows that was not set"
    elif utc > datetime.now(UTC) + _DAY:
        message = f"is {utc:%Y-%m-%d %H:%M} UTC, which is to come"
    else:
        return []
    hint = "write when t = 0 of the tables was, as in start = 2026-05-01T03:12:00Z, or leave it out"
    return [Finding("warning", "start-date", message, file=toml, column="start", hint=hint)]


_ASSUMED = {
    ("imu", "rigid"): (
        "true is assumed: a sensor fixed to what follows the track (axle box, wheelset, trolley)",
        "write rigid = true, or rigid = false for a sensor on springs (bogie frame, car body)",
    ),
    ("gnss", "lever_arm_m"): (
        "[0, 0, 0] is assumed: an antenna at the vehicle reference point",
        "write where the antenna is: metres forward, left and up of that point",
    ),
}
"""What is assumed of keys that decide much and that no measurement shows, and what to do, by part and key."""


def _assumed(parts: Mapping[str, Model], toml: str) -> list[Finding]:
    """Return what the description leaves to its defaults though a wrong one makes wrong results."""
    return [
        Finding("info", "assumed", f"is not stated; {value}", file=toml, column=f"{part}.{key}", hint=hint)
        for (part, key), (value, hint) in _ASSUMED.items()
        if part in parts and key not in parts[part].model_fields_set
    ]


_BASE_HINT = "write the distance that cross-level refers to: of the middles of the rails' tops, or the gauge"

_SAME_GAUGE_M = 0.02
"""Gauges that differ by less are of one nominal size, m, widened or worn."""


def _track(track: Track, toml: str, gnss_origin: Array | None) -> list[Finding]:
    """Return what is wrong with the sizes of the track, or with its latitude beside that of the positions."""
    report = []
    for key in ("gauge_m", "cross_level_base_m"):
        report += unusual_size("error", "track-size", getattr(track, key), GAUGE_M, Section(toml, f"track.{key}"))
    base, gauge, key = track.cross_level_base_m, track.gauge_m, "track.cross_level_base_m"
    if "cross_level_base_m" not in track.model_fields_set:
        if abs(gauge - Track().gauge_m) > _SAME_GAUGE_M:
            message = f"is not stated; {base:g} m is assumed, beside a gauge of {gauge:g} m"
            report.append(Finding("info", "assumed", message, file=toml, column=key, hint=_BASE_HINT))
    elif not report and base < gauge - _SAME_GAUGE_M:
        message, expected = f"is {base:g} m, beside a gauge of {gauge:g} m: cross-level is of less", "the gauge or more"
        warning = Finding("warning", "track-size", message, file=toml, column=key, expected=expected, hint=_BASE_HINT)
        report.append(warning)
    latitude = track.latitude_deg
    if latitude is not None and gnss_origin is not None and abs(latitude - gnss_origin[0]) > _SAME_LATITUDE_DEG:
        message = f"is {latitude:g} deg, but the GNSS positions are at {gnss_origin[0]:.3f} deg"
        hint = f"write {gnss_origin[0]:.3f}"
        if abs(latitude - gnss_origin[1]) <= _SAME_LATITUDE_DEG:
            hint = "it is that of their longitudes: exchange latitude and longitude in gnss.position"
        report.append(Finding("warning", "latitude", message, file=toml, column="track.latitude_deg", hint=hint))
    return report
