"""Solutions of RTKLIB (``.pos``): positions with sigmas, and speeds where the solution has velocities.

Rows are time, latitude, longitude, height, quality, number of satellites, the standard deviations north, east and up
and their covariances, age and ratio, and perhaps the velocity north, east and up with the same of its own. Times are a
date and a time of day, or the week of GPS and the time in it; the header names GPST, 18 s ahead of UTC in 2026, or UTC
(RTKLIB ver. 2.4.2 Manual, appendix B.1). Other forms, of degrees and minutes or of a baseline, are refused.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError, first_line
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.times.numeric_times import WEEK_S, gps_ns

SOLUTION = ".pos"
"""The suffix of these files."""
_HEAD = ("latitude(deg)", "longitude(deg)", "height(m)", "Q", "ns", "sdn(m)", "sde(m)", "sdu(m)")
_VELOCITY = ("vn(m/s)", "ve(m/s)", "sdvn", "sdve")


def read_rtklib(path: Path) -> SourceTable:
    """Read the positions of a solution. Raises :class:`BadInputError` for another form, and for a row that is none."""
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    header = next((line.lstrip("% ").split() for line in lines if line.startswith("%") and "sdn(m)" in line), [])
    scale = header[0] if header else ""
    if scale not in ("GPST", "UTC") or tuple(header[1 : 1 + len(_HEAD)]) != _HEAD:
        raise BadInputError(
            f"{path.name}: has no line '% GPST {' '.join(_HEAD)}'; expected a solution of RTKLIB in degrees, with "
            "times of GPS or UTC. Hint: set out-solformat = llh, out-timesys = gpst and out-degform = deg"
        )
    names = ["date", "clock", *header[1:]]
    rows = [(number, line.split()) for number, line in enumerate(lines, start=1) if line.strip() and line[0] != "%"]
    wrong = next((number for number, row in rows if len(row) != len(names)), None)
    if wrong is not None:
        raise BadInputError(f"{path.name}: row {wrong}: expected {len(names)} cells, as in the others")
    if not rows:
        raise BadInputError(f"{path.name}: has no rows; expected positions")
    table = pd.DataFrame([row for _, row in rows], columns=names)
    try:
        values = table.drop(columns=["date", "clock"]).astype(np.float64)
        ns = _times_ns(table["date"], table["clock"], of_gps=scale == "GPST")
    except ValueError as error:
        expected = "numbers, and dates such as 2026/05/01 03:12:00.000"
        raise BadInputError(f"{path.name}: {first_line(error)}; expected {expected}") from error
    columns = {"latitude": _HEAD[0], "longitude": _HEAD[1], "height": _HEAD[2], "sd_east_m": _HEAD[6]}
    columns |= {"sd_north_m": _HEAD[5], "sd_up_m": _HEAD[7]}
    frame = pd.DataFrame({"time_ns": ns, **{name: values[source] for name, source in columns.items()}})
    if set(_VELOCITY) <= set(names):
        frame["speed_mps"] = np.hypot(values[_VELOCITY[0]], values[_VELOCITY[1]])
        frame["sd_speed_mps"] = np.hypot(values[_VELOCITY[2]], values[_VELOCITY[3]]) / np.sqrt(2.0)
    return SourceTable("gnss", frame)


def _times_ns(date: pd.Series, clock: pd.Series, *, of_gps: bool) -> np.ndarray:
    """Return times (n,), ns since 1970, of dates and times of day, or of weeks and the times in them."""
    if date.str.contains("/").all():
        dates = pd.to_datetime(date + " " + clock, format="%Y/%m/%d %H:%M:%S.%f").astype("datetime64[ns]")
        ns = dates.astype(np.int64).to_numpy()
        if not of_gps:
            return np.asarray(ns)
        epoch = pd.Timestamp("1980-01-06").value
        since_epoch, rest = np.divmod(ns - epoch, 1_000_000_000)
        return np.asarray(gps_ns(since_epoch.astype(np.float64)) + rest)
    seconds = np.asarray(clock.astype(np.float64), dtype=np.float64)
    whole = np.floor(seconds)
    in_week = gps_ns(np.asarray(date.astype(np.float64).to_numpy() * WEEK_S + whole))
    return np.asarray(in_week + np.round((seconds - whole) * 1e9).astype(np.int64))
