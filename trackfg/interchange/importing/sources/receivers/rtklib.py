"""Solutions of RTKLIB (``.pos``): positions with sigmas, and speeds where the solution has velocities.

Rows are time, latitude, longitude, height, quality, number of satellites, the standard deviations north, east and up
and their covariances, age and ratio, and perhaps the velocity north, east and up with the same of its own; or all of
these along x, y and z from the centre of the Earth (ECEF). A covariance is written as its root with its sign. Times are
a date and a time of day, or the week of GPS and the time in it; the header names GPST, 18 s ahead of UTC in 2026, or
UTC (RTKLIB ver. 2.4.2 Manual, appendix B.1). Other forms, of degrees and minutes or of a baseline, are refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError, first_line
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.times.numeric_times import WEEK_S, gps_ns
from trackfg.numerics import geodesy
from trackfg.numerics.arrays import Array

SOLUTION = ".pos"
"""The suffix of these files."""
_PLACE, _SIGMAS = ("latitude", "longitude", "height"), ("sd_east_m", "sd_north_m", "sd_up_m")
_HIGHEST_M = 10_000.0
"""No railway is as far above or below the ellipsoid, m: other numbers are no positions in ECEF."""
_QUALITY = ("Q", "ns")
_HEAD = ("latitude(deg)", "longitude(deg)", "height(m)", *_QUALITY, "sdn(m)", "sde(m)", "sdu(m)")
_VELOCITY = ("vn(m/s)", "ve(m/s)", "sdvn", "sdve")
_ECEF = ("x-ecef(m)", "y-ecef(m)", "z-ecef(m)")
_ECEF_SIGMAS = ("sdx(m)", "sdy(m)", "sdz(m)", "sdxy(m)", "sdyz(m)", "sdzx(m)")
_ECEF_VELOCITY = ("vx(m/s)", "vy(m/s)", "vz(m/s)")
_ECEF_VELOCITY_SIGMAS = ("sdvx", "sdvy", "sdvz", "sdvxy", "sdvyz", "sdvzx")
_HEADS = (_HEAD, (*_ECEF, *_QUALITY, *_ECEF_SIGMAS))
"""The columns behind the time, of both forms."""
_ROW_OF, _COLUMN_OF = (0, 1, 2, 0, 1, 2), (0, 1, 2, 1, 2, 0)
"""Where the six numbers of a covariance stand in it: xx, yy, zz, xy, yz, zx."""


def read_rtklib(path: Path) -> SourceTable:
    """Read the positions of a solution. Raises :class:`BadInputError` for another form, and for a row that is none."""
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    header = next((line.lstrip("% ").split() for line in lines if line.startswith("%") and "ns" in line.split()), [])
    scale = header[0] if header else ""
    head = next((head for head in _HEADS if tuple(header[1 : 1 + len(head)]) == head), None)
    if scale not in ("GPST", "UTC") or head is None:
        raise BadInputError(
            f"{path.name}: has no line '% GPST {' '.join(_HEAD)}'; expected a solution of RTKLIB in degrees or ECEF, "
            "with times of GPS or UTC. Hint: set out-solformat = llh, out-timesys = gpst and out-degform = deg"
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
    columns = _geodetic(values) if head is _HEAD else _from_ecef(values, path)
    return SourceTable("gnss", pd.DataFrame({"time_ns": ns, **columns}))


def _geodetic(values: pd.DataFrame) -> dict[str, Array]:
    """Return latitude, longitude, height and speed with their sigmas of a solution in degrees."""
    names = dict(zip((*_PLACE, *_SIGMAS), (*_HEAD[:3], "sde(m)", "sdn(m)", "sdu(m)"), strict=True))
    columns = {name: values[source].to_numpy() for name, source in names.items()}
    if set(_VELOCITY) <= set(values):
        columns |= _speeds(*(values[name].to_numpy() for name in _VELOCITY))
    return columns


def _from_ecef(values: pd.DataFrame, path: Path) -> dict[str, Array]:
    """Return latitude, longitude, height and speed with their sigmas of a solution in ECEF."""
    place = geodesy.ecef_to_geodetic(values[list(_ECEF)].to_numpy())
    if not (np.abs(place[:, 2]) < _HIGHEST_M).all():
        raise BadInputError(f"{path.name}: positions are not at the surface of the Earth; expected x, y, z of ECEF, m")
    to_enu = np.stack([geodesy.ecef_from_enu(latitude, longitude).T for latitude, longitude, _ in place])
    sigmas = np.sqrt(np.maximum(_variances(values, _ECEF_SIGMAS, to_enu), 0.0))
    columns = dict(zip((*_PLACE, *_SIGMAS), (*place.T, *sigmas.T), strict=True))
    if {*_ECEF_VELOCITY, *_ECEF_VELOCITY_SIGMAS} <= set(values):
        east, north, _ = np.einsum("nij,nj->in", to_enu, values[list(_ECEF_VELOCITY)].to_numpy())
        sd_east, sd_north, _ = np.sqrt(np.maximum(_variances(values, _ECEF_VELOCITY_SIGMAS, to_enu), 0.0)).T
        columns |= _speeds(north, east, sd_north, sd_east)
    return columns


def _variances(values: pd.DataFrame, names: Sequence[str], rotation: Array) -> Array:
    """Return variances (n, 3) along the axes to which ``rotation`` (n, 3, 3) turns a covariance of such ``names``."""
    signed = values[list(names)].to_numpy()
    covariance = np.zeros((len(values), 3, 3))
    covariance[:, _ROW_OF, _COLUMN_OF] = covariance[:, _COLUMN_OF, _ROW_OF] = np.sign(signed) * signed**2
    return np.asarray(np.einsum("nij,njk,nik->ni", rotation, covariance, rotation))


def _speeds(north: Array, east: Array, sd_north: Array, sd_east: Array) -> dict[str, Array]:
    """Return the speed over ground, m/s, and its sigma: that of one component."""
    return {"speed_mps": np.hypot(north, east), "sd_speed_mps": np.hypot(sd_north, sd_east) / np.sqrt(2.0)}


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
