"""Inertial mid-chord offset and difference method, switched by speed (Suto, Tsubokawa and Yoshida, 2020).

The paper's measuring car has one unit with an inertial sensor and rail displacement sensors and, 5 m from it, one with
displacement sensors only. It measures 10 m versines ``v(x) = y(x) - (y(x - 5) + y(x + 5)) / 2`` of each rail's height
and lateral position ``y``:

*Inertial.* The rail is where the sensor is plus what lies between, ``y = y_s + e``. With the acceleration ``A`` across
the sensor's path (:mod:`trackfg.baselines.mid_chord_motion`), ``y_s'' = A / V^2`` and

    v(x) = -1/2 int_{-5}^{5} (5 - |u|) A(x + u) / V(x + u)^2 du + versine of e,
    e_up = -X sin theta + cos theta (Y sin phi + Z cos phi),   e_left = X heading + Y cos phi - Z sin phi

for a rail seen at ``(X, Y, Z)`` from the sensor. An error ``b`` of ``A`` gives ``12.5 m b / V^2``.

*Difference.* Two units 5 m apart see two points of a rail at one moment, ``D(x) = y(x + 2.5) - y(x - 2.5)`` with the
car's middle at x, so that ``v(x) = (D(x - 2.5) - D(x + 2.5)) / 2``: no speed in it, and of the car's attitude only the
change over 5 m, by the gyro. For level that is the paper's first difference; for alignment the difference of two
sights 5 m apart is taken in the first one's axes (second difference), so that the tangent of the heading never occurs.

*Conventional* and *developed* blend these by speed, the latter with the mixed waveform between them
(:mod:`trackfg.baselines.mixed_waveform`).

The paper prints no formulas: the forms above are derived from its words, and docs/baselines/mid-chord.md has what was
settled here. Only places reached running forwards for the first time count.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
import pandas as pd

from trackfg.baselines.mid_chord_motion import UnitMotion, unit_motion
from trackfg.baselines.mixed_waveform import blended, mixed_waveform
from trackfg.baselines.result import STEP_M, BaselineResult, filled, recorded, resampled_trajectory
from trackfg.errors import BadInputError
from trackfg.geometry.design_versine import design_versine
from trackfg.geometry.grid import steps, weighted_neighbours
from trackfg.geometry.moving_average import ALIGNMENT_WINDOWS_M, LEVEL_WINDOWS_M
from trackfg.geometry.resampling import resample
from trackfg.geometry.versines import versine
from trackfg.numerics.arrays import Array
from trackfg.numerics.units import KMH
from trackfg.recording.model import Recording
from trackfg.results.columns import GEOMETRY_COLUMNS
from trackfg.sensors.displacement import SIDES, RailView, rail_views

Method = Literal["inertial", "difference", "conventional", "developed"]

VERSINE_COLUMNS = (
    "versine_level_left_mm",
    "versine_level_right_mm",
    "versine_alignment_left_mm",
    "versine_alignment_right_mm",
)
"""What the geometry table has beside the usual columns: each rail's versines. The centre line's are their means."""

_HALF_CHORD_M = 5.0
"""Half of the paper's chord, and the distance of its two units, m."""
_BASE_TOLERANCE_M = 0.05
"""By how much the distance of the units may differ from that, m: 1 % of it. Chosen here."""


@dataclass(frozen=True)
class MidChordParameters:
    """The method, its transitions between speeds, and the filters (docs/baselines/mid-chord.md).

    Raises ``BadInputError`` for an unknown method.
    """

    method: Method = "developed"
    conventional_band_kmh: tuple[float, float] = (30.0, 45.0)
    difference_band_kmh: tuple[float, float] = (25.0, 30.0)
    inertial_band_kmh: tuple[float, float] = (60.0, 65.0)
    level_windows_m: tuple[float, ...] = LEVEL_WINDOWS_M
    alignment_windows_m: tuple[float, ...] = ALIGNMENT_WINDOWS_M
    attitude_time_s: float = 12.5
    speed_window_s: float = 1.0
    slowest_kmh: float = 1.0

    def __post_init__(self) -> None:
        if self.method not in get_args(Method):
            raise BadInputError(f"method is {self.method!r}; expected {', '.join(get_args(Method))}")


def run(recording: Recording, **parameters: Any) -> BaselineResult:
    """Measure versines of both rails and of the centre line, on whole multiples of 0.25 m.

    ``parameters`` are fields of :class:`MidChordParameters`. The inertial method needs one unit, all others two.

    Raises ``BadInputError`` for an unknown method, and where there is no tachometer, no unit that sees both rails both
    ways, or the foremost and the rearmost are not 5 m apart.
    """
    p = MidChordParameters(**parameters)
    motion = unit_motion(recording, attitude_time_s=p.attitude_time_s, speed_window_s=p.speed_window_s)
    units = _units(recording)
    lever_arm = np.array(recording.description.imu.lever_arm_m)
    grid = _Grid.of(motion, recording.description.track.direction)

    def inertial() -> Array:
        nearest = min(units, key=lambda unit: abs(unit[0].along_m - lever_arm[0]))
        return _inertial(motion, nearest, lever_arm, grid, p.slowest_kmh * KMH)

    def difference() -> Array:
        return _difference(motion, *_five_metres_apart(recording, units), grid)

    match p.method:
        case "inertial":
            versines = inertial()
        case "difference":
            versines = difference()
        case "conventional":
            versines = blended(difference(), inertial(), grid.speed / KMH, p.conventional_band_kmh)
        case "developed":
            low, high = difference(), inertial()
            windows = (p.level_windows_m, p.level_windows_m, p.alignment_windows_m, p.alignment_windows_m)
            mixed = np.stack([mixed_waveform(high[i], low[i], STEP_M, window) for i, window in enumerate(windows)])
            slow = blended(low, mixed, grid.speed / KMH, p.difference_band_kmh)
            versines = blended(slow, high, grid.speed / KMH, p.inertial_band_kmh)
    return BaselineResult(
        name=f"mid-chord {p.method}",
        trajectory=_trajectory(motion, recording.description.track.direction),
        geometry=_geometry(grid, versines),
        parameters=recorded(p),
    )


@dataclass(frozen=True)
class _Grid:
    """Distances on whole multiples of 0.25 m, ascending in the direction of travel, (m,), and the speed there.

    ``rows``: the motion's samples that count. ``direction``: of chainage along the run.
    """

    distance: Array
    speed: Array
    rows: np.ndarray
    place: Array
    direction: int

    @classmethod
    def of(cls, motion: UnitMotion, direction: int) -> _Grid:
        rows = np.flatnonzero(motion.distance >= np.maximum.accumulate(motion.distance))
        place = motion.distance[rows]
        distance, _ = resample(place, motion.speed[rows], STEP_M)
        return cls(distance, np.interp(distance, place, motion.speed[rows]), rows, place, direction)

    def bring(self, values: Array) -> Array:
        """Return values at the motion's samples (..., n) at the grid's places."""
        return resample(self.place, values[..., self.rows], STEP_M)[1]

    def shifted(self, values: Array, by_m: float) -> Array:
        """Return values measured with the car at ``x`` at the row nearest to ``x + by_m``, where they belong."""
        count = round(by_m / STEP_M)
        return weighted_neighbours(values, {-count: 1.0})


def _units(recording: Recording) -> list[tuple[RailView, RailView]]:
    """Return the units that see the left and the right rail, each in height and across, the foremost first."""
    views = rail_views(recording)
    by_place = {view.along_m: [v for v in views if v.along_m == view.along_m] for view in views}
    units = [
        (pair[0], pair[1])
        for pair in by_place.values()
        if len(pair) == len(SIDES) and all(v.lateral is not None and v.vertical is not None for v in pair)
    ]
    if not units:
        raise BadInputError(
            f"{recording.description.id}: no unit of lasers that sees both rails vertically and laterally; expected one"
        )
    return units


def _five_metres_apart(
    recording: Recording, units: list[tuple[RailView, RailView]]
) -> tuple[tuple[RailView, RailView], tuple[RailView, RailView]]:
    front, rear = units[0], units[-1]
    apart = front[0].along_m - rear[0].along_m
    if abs(apart - _HALF_CHORD_M) > _BASE_TOLERANCE_M:
        raise BadInputError(
            f"{recording.description.id}: units of lasers {apart:g} m apart; expected {_HALF_CHORD_M:g} m"
        )
    return front, rear


def _seen(motion: UnitMotion, unit: tuple[RailView, RailView], origin: Array) -> Array:
    """Return both rails' height and lateral place from ``origin`` in the vehicle, in level axes. Shape (4, n).

    Rows: height left and right, lateral left and right; the lateral ones with the heading's part.
    """
    window = float(np.median(np.diff(motion.t)))
    sin_r, cos_r = np.sin(motion.roll), np.cos(motion.roll)
    points = np.stack([view.points(motion.t, window) - origin for view in unit])
    x, y, z = np.moveaxis(points, -1, 0)
    up = -x * np.sin(motion.pitch_by_gyro) + np.cos(motion.pitch_by_gyro) * (y * sin_r + z * cos_r)
    left = x * motion.heading + y * cos_r - z * sin_r
    return np.concatenate([up, left])


def _inertial(
    motion: UnitMotion, unit: tuple[RailView, RailView], lever_arm: Array, grid: _Grid, slowest_mps: float
) -> Array:
    """Return versines of the rails, m, rows as in :func:`_seen`."""
    curvature = np.stack([motion.up, motion.left]) / np.maximum(motion.speed, slowest_mps) ** 2
    path = design_versine(grid.bring(curvature), STEP_M, _HALF_CHORD_M, _HALF_CHORD_M)
    to_rail = versine(grid.bring(_seen(motion, unit, lever_arm)), STEP_M, _HALF_CHORD_M, _HALF_CHORD_M)
    return grid.shifted(path[[0, 0, 1, 1]] + to_rail, unit[0].along_m)


def _difference(
    motion: UnitMotion, front: tuple[RailView, RailView], rear: tuple[RailView, RailView], grid: _Grid
) -> Array:
    """Return versines of the rails, m, rows as in :func:`_seen`."""
    base = grid.bring(_seen(motion, front, np.zeros(3)) - _seen(motion, rear, np.zeros(3)))
    half = steps(0.5 * _HALF_CHORD_M, STEP_M, "half the distance of the units")
    about_middle = weighted_neighbours(base, {-half: 0.5, half: -0.5})
    return grid.shifted(about_middle, 0.5 * (front[0].along_m + rear[0].along_m))


def _geometry(grid: _Grid, versines: Array) -> pd.DataFrame:
    """Return the geometry table, facing increasing chainage: against it, the vehicle's left is right."""
    level, alignment = 1e3 * versines[:2], 1e3 * versines[2:]
    chainage, speed = grid.distance, grid.speed
    if grid.direction < 0:
        level, alignment = level[::-1, ::-1], -alignment[::-1, ::-1]
        chainage, speed = -chainage[::-1], speed[::-1]
    table = filled(
        GEOMETRY_COLUMNS,
        {
            "chainage_m": chainage,
            "speed_mps": speed,
            "versine_level_mm": level.mean(axis=0),
            "versine_alignment_mm": alignment.mean(axis=0),
        },
    )
    return table.assign(**dict(zip(VERSINE_COLUMNS, (*level, *alignment), strict=True)))


def _trajectory(motion: UnitMotion, direction: int) -> pd.DataFrame:
    """Return ten rows a second: chainage from 0, speed, and the attitude that was used."""
    columns = {
        "chainage_m": direction * motion.distance,
        "speed_mps": motion.speed,
        "roll_rad": motion.roll,
        "pitch_rad": motion.pitch,
        "yaw_rad": motion.heading,
    }
    return resampled_trajectory(motion.t, columns)
