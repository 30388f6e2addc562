"""Values that are well-formed but cannot be true: wrong axes, wrong units, clocks that do not meet.

Errors here are those that no real run can produce; doubts are left to :mod:`trackfg.checks.diagnosis`. Arguments:
``parts`` of the description and the canonical ``tables``, both by name (``"imu"``, ``"laser 1"``), as far as they could
be read.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime, timedelta

import numpy as np
import pandas as pd

from trackfg.checks import diagnosis_axes
from trackfg.checks.columns import ColumnPlace, too_fast_hint
from trackfg.checks.diagnosis_silence import SHORTEST_S
from trackfg.checks.limits import CheckLimits
from trackfg.numerics.arrays import Array
from trackfg.numerics.units import STANDARD_GRAVITY, known_units, to_si
from trackfg.recording.canonical import imu_rotation
from trackfg.recording.description import GnssSpeed, Imu, Laser, Speed, Table, Tach, Track
from trackfg.recording.findings import Finding, Level, Section
from trackfg.recording.strict_model import Model
from trackfg.sensors.averages import Motion, averaged

_STEP_S = 0.5
_SAME_LATITUDE_DEG = 0.5
"""A line is so near to the latitude that is declared for it, deg: 55 km."""


def findings(
    parts: Mapping[str, Model],
    tables: Mapping[str, pd.DataFrame],
    toml: str,
    limits: CheckLimits,
    gnss_origin: Array | None = None,
) -> list[Finding]:
    """All of them. ``toml`` is the name of the description's file."""
    found: list[Finding] = []
    imu, imu_table, tach_table = parts.get("imu"), tables.get("imu"), tables.get("tach")
    if tach_table is not None:
        tach_table = of_this_run(imu_table, tach_table, limits)
    track = parts.get("track")
    if isinstance(track, Track):
        found += _track(track, toml, gnss_origin)
    found += _assumed({name: parts[name] for name in tables if name in parts}, toml)
    if isinstance(imu, Imu) and imu_table is not None:
        rate = _imu_interval(imu, imu_table, limits)
        found += rate
        found += gravity_findings(imu, imu_table, toml, limits)
        if not rate:
            if tach_table is not None and (tach_motion := averaged(imu_table, tach_table, _STEP_S)) is not None:
                found += _gyro_unit(imu, tach_motion, limits)
            elif (motion := averaged(imu_table, None, _STEP_S)) is not None:
                found += _gyro_unit(imu, motion, limits)
            found += _overlaps(imu_table, parts, tables, limits)
    return found


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
        Finding(
            "info",
            "assumed",
            f"is not stated; {value}",
            file=toml,
            column=f"{part}.{key}",
            hint=hint,
        )
        for (part, key), (value, hint) in _ASSUMED.items()
        if part in parts and key not in parts[part].model_fields_set
    ]


_BASE_HINT = "write the distance that cross-level refers to: of the middles of the rails' tops, or the gauge"

_SAME_GAUGE_M = 0.02
"""Gauges that differ by less are of one nominal size, m, widened or worn."""


def _track(track: Track, toml: str, gnss_origin: Array | None) -> list[Finding]:
    found = []
    for key in ("gauge_m", "cross_level_base_m"):
        found += _unusual_size("error", "track-size", getattr(track, key), (0.3, 4.0), Section(toml, f"track.{key}"))
    is_stated = "cross_level_base_m" in track.model_fields_set
    if is_stated and not found and track.cross_level_base_m < track.gauge_m - _SAME_GAUGE_M:
        message = f"is {track.cross_level_base_m:g} m, beside a gauge of {track.gauge_m:g} m: cross-level is of less"
        found.append(
            Finding(
                "warning",
                "track-size",
                message,
                file=toml,
                column="track.cross_level_base_m",
                expected="the gauge or more",
                hint=_BASE_HINT,
            )
        )
    if not is_stated and abs(track.gauge_m - Track().gauge_m) > _SAME_GAUGE_M:
        message = f"is not stated; {track.cross_level_base_m:g} m is assumed, beside a gauge of {track.gauge_m:g} m"
        found.append(Finding("info", "assumed", message, file=toml, column="track.cross_level_base_m", hint=_BASE_HINT))
    latitude = track.latitude_deg
    if latitude is not None and gnss_origin is not None and abs(latitude - gnss_origin[0]) > _SAME_LATITUDE_DEG:
        message = f"is {latitude:g} deg, but the GNSS positions are at {gnss_origin[0]:.3f} deg"
        hint = f"write {gnss_origin[0]:.3f}"
        if abs(latitude - gnss_origin[1]) <= _SAME_LATITUDE_DEG:
            hint = "it is that of their longitudes: exchange latitude and longitude in gnss.position"
        found.append(Finding("warning", "latitude", message, file=toml, column="track.latitude_deg", hint=hint))
    return found


def _unusual_size(level: Level, code: str, size_m: float, usual_m: tuple[float, float], key: Section) -> list[Finding]:
    low, high = usual_m
    if low <= size_m <= high:
        return []
    hint = f"write {size_m / 1000:g}" if 1000 * low <= size_m <= 1000 * high else None
    expected = f"{low:g} to {high:g} m"
    return [Finding(level, code, f"is {size_m:g} m", file=key.file, column=key.name, expected=expected, hint=hint)]


def _imu_interval(imu: Imu, table: pd.DataFrame, limits: CheckLimits) -> list[Finding]:
    interval = float(np.median(np.diff(table["t_s"])))
    low, high = limits.imu_interval_s
    if low <= interval <= high:
        return []
    raw = interval / to_si("time", imu.time_unit)
    units = [unit for unit in known_units("time") if 2e-4 <= raw * to_si("time", unit) <= high]
    hint = f'set imu.time_unit = "{units[0]}"' if units else "check the time column and imu.time_unit"
    message, expected = f"rows are {interval:.4g} s apart (median)", f"{low:g} to {high:g} s"
    return [Finding("error", "time-unit", message, file=imu.file, column=imu.time, expected=expected, hint=hint)]


def gravity_findings(imu: Imu, table: pd.DataFrame, toml: str, limits: CheckLimits) -> list[Finding]:
    """Return what is wrong with the magnitude, or else with the direction, of the median specific force."""
    force = diagnosis_axes.mean_specific_force(table)
    magnitude = float(np.linalg.norm(force))
    g = STANDARD_GRAVITY
    columns = ", ".join(imu.accel)
    if abs(magnitude - g) > limits.gravity_error_mps2:
        message = f"the median specific force is {magnitude:.4g} m/s^2 as declared ({imu.accel_unit})"
        hint = "check imu.accel and imu.accel_unit"
        if magnitude < _LEFT_OF_GRAVITY * g or not _is_steady(table):
            hint = "gravity seems to have been removed: record specific force, as the sensor gives it"
        elif imu.accel_unit == "m/s^2" and abs(magnitude * g - g) < limits.gravity_error_mps2:
            hint = 'the data look like g: set imu.accel_unit = "g"'
        elif imu.accel_unit == "g" and abs(magnitude / g - g) < limits.gravity_error_mps2:
            hint = 'the data look like m/s^2: set imu.accel_unit = "m/s^2"'
        elif 0.8 < magnitude / (1000.0 * to_si("acceleration", imu.accel_unit)) < 1.2:
            hint = 'the data look like milli-g: divide them by 1000 and set imu.accel_unit = "g"'
        expected = f"{g:.2f} m/s^2 within {limits.gravity_error_mps2:g}"
        return [Finding("error", "accel-unit", message, file=imu.file, column=columns, expected=expected, hint=hint)]
    up = force / magnitude
    tilt = float(np.degrees(np.arccos(np.clip(up[2], -1.0, 1.0))))
    if tilt <= limits.tilt_warning_deg:
        return []
    expected = "+1 g on the upward axis at rest"
    if tilt <= limits.tilt_error_deg or abs(up).max() < np.cos(np.radians(limits.tilt_error_deg)):
        roll, pitch = diagnosis_axes.levelling_deg(up)
        message = f"gravity is {tilt:.0f} deg off the vertical of the declared axes"
        hint = f"if the sensor is mounted so, turn imu.mount_rpy_deg by roll {roll:.1f}, pitch {pitch:.1f} deg"
        level: Level = "warning" if tilt <= limits.tilt_error_deg else "error"
        return [Finding(level, "gravity-tilt", message, file=toml, column="imu.axes", expected=expected, hint=hint)]
    sensor = imu_rotation(imu).T @ force
    i = int(np.argmax(np.abs(sensor)))
    message = (
        f"gravity is on the wrong axis or sign: column {imu.accel[i]!r}, declared {imu.axes[i]}, "
        f"holds {sensor[i]:+.2f} m/s^2, so it points {'up' if sensor[i] > 0 else 'down'}"
    )
    hint = f'set imu.axes = "{diagnosis_axes.propose_axes(imu.axes, up, None)}" if the other columns are right'
    return [Finding("error", "gravity-axis", message, file=imu.file, column=imu.accel[i], expected=expected, hint=hint)]


_LEFT_OF_GRAVITY = 0.05
"""Less than this part of gravity is none: the smallest unit that is taken for another is g, 0.1 of m/s^2."""
_STEADY_RANGE = 0.5
"""Gravity makes the magnitude of specific force vary by less than half of itself (quantiles 5 to 95 %), in any unit: no
vehicle accelerates like that. What is left where it was removed varies by more than itself."""


def _is_steady(table: pd.DataFrame) -> bool:
    """Return whether the magnitude of specific force hardly varies."""
    magnitude = np.linalg.norm(diagnosis_axes.specific_force_blocks(table), axis=1)
    low, middle, high = np.quantile(magnitude, [0.05, 0.5, 0.95])
    return bool(high - low < _STEADY_RANGE * middle)


def _gyro_unit(imu: Imu, motion: Motion, limits: CheckLimits) -> list[Finding]:
    """Angular rates that no vehicle has, or that do not fit the lateral specific force."""
    columns = ", ".join(imu.gyro)
    other = "deg/s" if imu.gyro_unit == "rad/s" else "rad/s"
    to_other = f'the data look like {other}: set imu.gyro_unit = "{other}"'

    def wrong(message: str, expected: str, hint: str = to_other) -> list[Finding]:
        return [Finding("error", "gyro-unit", message, file=imu.file, column=columns, expected=expected, hint=hint)]

    if not motion.valid.any():
        return []
    rate = float(np.quantile(np.abs(motion.gyro[motion.valid]).max(axis=1), 0.995))
    if rate > limits.rate_error_radps:
        return wrong(
            f"angular rates of {rate:.3g} rad/s as declared ({imu.gyro_unit}), held for half a second",
            f"at most {limits.rate_error_radps:g} rad/s",
            too_fast_hint(imu),
        )
    if np.isnan(motion.speed).any() or np.quantile(np.abs(motion.speed), 0.99) > limits.speed_error_mps:
        return []  # a speed that no vehicle has says nothing of the gyro
    lateral = float(np.quantile(np.abs(motion.speed * motion.gyro[:, 2])[motion.valid], 0.995))
    if lateral > limits.lateral_error_mps2:
        return wrong(
            f"speed times yaw rate is {lateral:.3g} m/s^2 as declared ({imu.gyro_unit})",
            f"at most {limits.lateral_error_mps2:g} m/s^2",
            too_fast_hint(imu),
        )
    balance = diagnosis_axes.lateral_balance(motion)
    if balance is None or abs(balance[1]) < max(0.7, limits.axis_correlation):
        return []
    slope = abs(balance[0])
    is_other = slope < 1 / 20 if imu.gyro_unit == "rad/s" else slope > 20
    if not is_other:
        return []
    return wrong(
        f"lateral specific force is {slope:.3g} times what the gyro implies as declared ({imu.gyro_unit})", "1"
    )


def speed_findings(
    code: str, speed: Array, part: Tach | Speed | GnssSpeed, hint: str, limits: CheckLimits
) -> list[Finding]:
    """Return a finding where one in a hundred speeds (n,), m/s, is beyond any vehicle."""
    fastest = float(np.quantile(np.abs(speed), 0.99)) if speed.size else 0.0
    if fastest <= limits.speed_error_mps:
        return []
    message, expected = f"speeds of {fastest:.4g} m/s as declared", f"at most {limits.speed_error_mps:g} m/s"
    return [Finding("error", code, message, file=part.file, column=part.column, expected=expected, hint=hint)]


def tach_findings(tach: Tach, section: Section, table: pd.DataFrame, limits: CheckLimits) -> list[Finding]:
    """Speeds that no vehicle has, and a wheel of no usual size."""
    t, distance = table["t_s"].to_numpy(), table["distance_m"].to_numpy()
    span = max(1, int(np.searchsorted(t, t[0] + 1.0)))
    speed = np.abs(distance[span:] - distance[:-span]) / (t[span:] - t[:-span])
    hint = (
        f"check {section.name}.wheel_diameter_m (in m) and {section.name}.pulses_per_rev"
        if tach.kind == "pulses"
        else f"check {section.name}.kind and {section.name}.unit"
    )
    found = speed_findings("tach-unit", speed, tach, hint, limits)
    if tach.wheel_diameter_m is not None:
        key = Section(section.file, f"{section.name}.wheel_diameter_m")
        found += _unusual_size("warning", "wheel-diameter", tach.wheel_diameter_m, (0.05, 2.0), key)
    return found


def laser_findings(laser: Laser, section: Section, table: pd.DataFrame, limits: CheckLimits) -> list[Finding]:
    """A unit off by 1000: too large to be true, or moving less than a hundredth of its own noise."""
    displacement = table["displacement_m"].to_numpy()
    largest = float(np.quantile(np.abs(displacement), 0.9))
    low, high = np.quantile(displacement, [0.05, 0.95])
    if largest > limits.laser_range_m:
        message = f"displacements of {largest:.4g} m as declared ({laser.unit})"
        hint = 'the data look like mm: set unit = "mm"' if laser.unit == "m" else "divide the data by 1000"
        expected = f"at most {limits.laser_range_m:g} m"
    elif 0.0 < high - low < 0.05 * laser.sd_m and laser.unit == "mm" and largest * 1000.0 <= limits.laser_range_m:
        message = f"the displacement varies by {high - low:.3g} m as declared (mm), far below its sigma"
        hint = 'the data look like m: set unit = "m"'
        expected = f"a variation above {laser.sd_m:g} m"
    else:
        return []
    message += f" ({section.name}.unit)"
    return [Finding("error", "laser-unit", message, file=laser.file, column=laser.column, expected=expected, hint=hint)]


_HALF_HOUR_S, _ZONES_S = 1800.0, 14.0 * 3600.0
"""Zones differ by whole half hours, up to so many seconds from UTC."""
_SAME_ENDS_S = 60.0
"""Sensors that record the same run begin and end no further apart, s."""


def _overlaps(
    imu: pd.DataFrame, parts: Mapping[str, Model], tables: Mapping[str, pd.DataFrame], limits: CheckLimits
) -> list[Finding]:
    """Tables whose time does not meet the IMU's, or meets it in part only."""
    found, expected = [], "times within those of the IMU"
    begin, end = imu["t_s"].iloc[[0, -1]]
    for name, table in tables.items():
        part = parts[name]
        if name == "imu" or not isinstance(part, Table):
            continue
        t = table["t_s"].to_numpy()
        share = float(np.mean((t >= begin) & (t <= end)))
        near = _near(imu, table, limits)
        message = f"far from the IMU's time, {begin:.9g} to {end:.9g} s: left out"
        hint = "remove the rows, or write their times on the recording's clock"
        place = ColumnPlace(part.file, part.time, t)
        found += place.at_first(~near & near.any(), "clocks-apart", message, expected, hint, "warning")
        zone_s = _zone_apart_s((begin, end), t, share)
        if share >= limits.overlap_warning and zone_s == 0.0:
            found += _rolls_on(imu, table, near, place) if name.startswith("tach") else []
            continue
        message = f"the table covers {t[0]:.9g} to {t[-1]:.9g} s, the IMU {begin:.9g} to {end:.9g} s"
        is_error = (share == 0.0 and (t[0] > end or t[-1] < begin)) or not near.any()
        section = f"[[{name.partition('[')[0]}]]" if name.endswith("]") else f"[{name}]"
        message += ": the clocks do not overlap" if is_error else f": {share:.0%} of its rows are within"
        hint = f"set time_offset_s of {section} (first rows together: {begin - t[0]:.9g}), or its time_unit"
        if zone_s != 0.0:
            offset_s = part.time_offset_s + zone_s
            hint = f"set time_offset_s = {offset_s:g} in {section}: its times look like those of another time zone"
        level: Level = "error" if is_error else "warning"
        found.append(
            Finding(level, "clocks-apart", message, file=part.file, column=part.time, expected=expected, hint=hint)
        )
    return found


def _zone_apart_s(record: tuple[float, float], t: Array, share: float) -> float:
    """Return by how much times (n,), s, of another time zone are to be shifted; 0 where they are of the same.

    They fit a ``record``, between two times, s, better then than with the ``share`` of them that is within it as they
    are. In a run of hours most are within it all the same: then both ends have to fit.
    """
    begin, end = record
    shift = _HALF_HOUR_S * round((begin - t[0]) / _HALF_HOUR_S)
    if not 0.0 < abs(shift) <= _ZONES_S:
        return 0.0
    fits = float(np.mean((t + shift >= begin) & (t + shift <= end)))
    same_ends = max(abs(t[0] + shift - begin), abs(t[-1] + shift - end)) < _SAME_ENDS_S
    return shift if fits > share and (same_ends or share == 0.0) else 0.0


def _rolls_on(imu: pd.DataFrame, tach: pd.DataFrame, near: np.ndarray, place: ColumnPlace) -> list[Finding]:
    """A wheel that rolls for 20 s or more before the first row of the IMU, or after its last: a part is missing."""
    (begin, end), t, distance = imu["t_s"].iloc[[0, -1]], tach["t_s"].to_numpy(), tach["distance_m"].to_numpy()
    expected, hint = "an IMU that measures as long", "look for the missing rows: nothing is estimated there"
    found, rolls = list[Finding](), np.append(np.diff(distance) != 0.0, False)
    first, last = f"before the IMU's first row, at {begin:.9g} s", f"after the IMU's last row, at {end:.9g} s"
    for outside, where in ((near & (t < begin), first), (near & (t > end), last)):
        rolled = outside & rolls
        if rolled.any() and np.ptp(t[rolled]) >= SHORTEST_S:
            message = f"the wheel rolls {np.abs(np.diff(distance[outside])).sum():.4g} m {where}"
            found += place.at_first(outside, "imu-absent", message, expected, hint, "warning")
    return found


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
