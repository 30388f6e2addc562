"""Located tables have the time and the position of each row of a result: what most other systems address by."""

from __future__ import annotations

import numpy as np
import pandas as pd

from trackfg.geometry.versine_bands import with_long_bands
from trackfg.interchange.exporting.rail_bands import with_rail_bands
from trackfg.numerics.arrays import Array
from trackfg.numerics.geodesy import enu_to_geodetic
from trackfg.numerics.rotations import matrix_from_rpy, quaternion
from trackfg.results.official_places import line_kilometrage, with_km
from trackfg.results.result import Result

PLACE_COLUMNS = ("t_s", "east_m", "north_m", "up_m")
"""Columns that :func:`located_geometry` adds for every result."""

GEODETIC_COLUMNS = ("latitude_deg", "longitude_deg", "height_m")
"""Columns that it adds where the result has a place on the Earth (WGS 84)."""

_DATES = {"t_s": "time_utc", "start_s": "start_utc", "end_s": "end_utc"}
"""Columns of times, s, and those of their dates."""


def origin_of(result: Result) -> tuple[float, float, float] | None:
    """Return where east, north and up are counted from: latitude, longitude (deg), height (m); None without GNSS."""
    return None if result.summary.run is None else result.summary.run.origin


def direction_of(result: Result) -> int:
    """Return 1 where chainage grows along the run, -1 where it falls."""
    return 1 if result.summary.run is None else result.summary.run.direction


def start_of(result: Result) -> pd.Timestamp | None:
    """Return the date of t = 0, in UTC; None where the recording has none."""
    start = None if result.summary.run is None else result.summary.run.start_utc
    return None if start is None else pd.Timestamp(start)


def located_geometry(result: Result) -> pd.DataFrame:
    """Return the geometry with :data:`PLACE_COLUMNS` and, with GNSS, :data:`GEODETIC_COLUMNS` after the chainage.

    A place that was passed more than once has the time and the position of its first pass; one that the trajectory does
    not reach, as all of a geometry that another system measured, has NaN.
    """
    trajectory, chainage = result.trajectory, result.geometry["chainage_m"].to_numpy()
    along = trajectory["chainage_m"].to_numpy() * direction_of(result)
    first = np.concatenate([[True], along[1:] > np.maximum.accumulate(along)[:-1]]) if len(along) else along > 0
    passages = trajectory[first].sort_values("chainage_m")
    if passages.empty:
        passages = pd.DataFrame({name: [np.nan] for name in passages.columns})
    places = {
        name: np.interp(chainage, passages["chainage_m"], passages[name], left=np.nan, right=np.nan)
        for name in PLACE_COLUMNS
    }
    origin = origin_of(result)
    if origin is not None and len(chainage):
        geodetic = enu_to_geodetic(np.stack([places[name] for name in PLACE_COLUMNS[1:]], axis=1), origin)
        places |= dict(zip(GEODETIC_COLUMNS, geodetic.T, strict=True))
    table = result.geometry
    return pd.concat([table[["chainage_m"]], pd.DataFrame(places), table.drop(columns="chainage_m")], axis=1)


def located_trajectory(result: Result) -> pd.DataFrame:
    """Return the trajectory, with :data:`GEODETIC_COLUMNS` where the result has a place on the Earth."""
    origin = origin_of(result)
    if origin is None or result.trajectory.empty:
        return result.trajectory
    geodetic = enu_to_geodetic(result.trajectory[["east_m", "north_m", "up_m"]].to_numpy(), origin)
    return result.trajectory.assign(**dict(zip(GEODETIC_COLUMNS, geodetic.T, strict=True)))


def travelled_m(trajectory: pd.DataFrame) -> Array:
    """Return the distance travelled since the first row, to and fro, m (n,)."""
    return np.concatenate([[0.0], np.cumsum(np.abs(np.diff(trajectory["chainage_m"])))])


def quaternions_of(trajectory: pd.DataFrame) -> Array:
    """Return the attitude, body to navigation, as quaternions (n, 4): x, y, z, w."""
    angles = (trajectory[name].to_numpy() for name in ("roll_rad", "pitch_rad", "yaw_rad"))
    return np.roll(quaternion(matrix_from_rpy(*angles)), -1, axis=1)


def table_of(result: Result, name: str, *, km: bool = False, bands: bool = False) -> pd.DataFrame:
    """Return a table of the result by its name, ``geometry``, ``trajectory``, ``events`` or ``balises``, with places.

    With ``km`` official places are beside its chainages, with ``bands`` the geometry of a smoothed run has level and
    alignment in the bands D2 and D3, computed from its versines, and those of the rails. Raises
    :class:`~trackfg.errors.BadInputError` where official places are wanted and the result has no kilometrage.
    """
    kilometrage = line_kilometrage(result).kilometrage() if km else None
    if name == "balises":
        return with_km(result.balises, kilometrage, of="place_m")
    if name == "geometry":
        table, meaning = located_geometry(result), result.summary.geometry
        if bands and result.summary.solver is not None and len(table):
            table = with_long_bands(table, meaning.step_m, meaning.chord_m)
            over_base = meaning.tops_apart_m / meaning.cross_level_base_m
            table = with_rail_bands(table, meaning.step_m, meaning.twist_base_m, tops_over_base=over_base)
    else:
        table = located_trajectory(result) if name == "trajectory" else result.events
    return with_km(_dated(table, start_of(result)), kilometrage)


def _dated(table: pd.DataFrame, start: pd.Timestamp | None) -> pd.DataFrame:
    """Return a table with dates in UTC after its times, where the date of t = 0 is known."""
    if start is None:
        return table
    table = table.copy(deep=False)
    for time, date in _DATES.items():
        if time in table:
            dates = start.tz_localize(None) + pd.to_timedelta(table[time].astype(np.float64), unit="s")
            table.insert(list(table.columns).index(time) + 1, date, dates.astype("datetime64[us]"))
    return table
