"""The attitude baselines share samples freed of their static bias, the wheel's place and speed, and their tables.

Axes and signs are those of trackfg throughout: FLU, roll with the left side up, pitch nose-down. The samples stand at
the middles of intervals laid edge to edge, holes bridged. The tachometer counts whole pulses, so its distance is
averaged over 0.5 s (which moves a place by ``a w^2 / 24``, 3 mm at 0.3 m/s^2); the speed is the slope of that average.

The *static bias* is the gyro's mean over the standstill at the start: what a rate sensor shows at rest is its zero. The
Earth's rate is in that mean, in the direction that the vehicle starts with. Of an accelerometer's bias the part along
the vertical shows, as the length of the specific force less gravity; it would scale every roll, by 0.5 % for 0.05
m/s^2. The part across does not show on a track of unknown cross-level: it stays in as a constant offset of the roll.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from trackfg.baselines.result import STEP_M, BaselineResult, filled, resampled_trajectory
from trackfg.errors import BadInputError
from trackfg.geometry.resampling import resample
from trackfg.geometry.twist import twist
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.passes import Pass, passes
from trackfg.numerics.geodesy import normal_gravity
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.recording.model import Recording
from trackfg.results.columns import GEOMETRY_COLUMNS
from trackfg.sensors.imu_intervals import Intervals, intervals
from trackfg.sensors.standstills import find_standstills
from trackfg.sensors.tach import Wheel, read_wheel

TWIST_BASE_M = 5.0
"""Base of the twist, m: the default of the smoother's results."""
_PLACE_OVER_S = 0.5
"""Time over which the tachometer's distance is averaged, s; the module's docstring says what it costs."""
_AT_THE_START_S = 5.0
"""A standstill that begins within this time is that of the start, s. Chosen here."""
_TILT_OVER_S = 1.0
"""Time over which the first tilt is averaged where the run does not begin at rest, s. Chosen here."""
_SHORTEST_PASS_M = 10.0
"""A shorter pass has no geometry, m: as for the smoother's results (docs/geometry.md)."""
_PASS_STEP_S = 1.0
"""Step in time at which changes of direction are looked for, s. Chosen here."""


@dataclass(frozen=True)
class SampledMotion:
    """The samples (n,) are at times ``t`` and last ``dt``, s.

    ``gyro`` rad/s less ``static_bias`` (3,); ``accel`` m/s^2 less ``excess`` of its z axis; signed nominal
    ``distance``, m, and ``speed``, m/s, of the wheel; ``start`` (n,) of bool: those of the standstill at the start,
    ``standstill_s`` long, or of the first second where there is none.
    """

    t: Array
    dt: Array
    gyro: Array
    accel: Array
    distance: Array
    speed: Array
    static_bias: Array
    excess: float
    start: np.ndarray
    standstill_s: float

    @property
    def sampling_s(self) -> float:
        """Return the sampling interval, s."""
        return float(np.median(self.dt))

    def without_centripetal(self) -> Array:
        """Return specific force less ``w x v`` of the forward speed v, ``(0, v wz, -v wy)``, m/s^2 (n, 3)."""
        out = self.accel.copy()
        out[:, 1] -= self.speed * self.gyro[:, 2]
        out[:, 2] += self.speed * self.gyro[:, 1]
        return out


def required_wheel(recording: Recording, max_gap_s: float = 2.0) -> Wheel:
    """Return the wheel of a recording; a silence in motion longer than ``max_gap_s``, chosen here, is a gap.

    Raises ``BadInputError`` where there is no tachometer.
    """
    wheel = read_wheel(recording, max_gap_s)
    if wheel is None:
        raise BadInputError(f"{recording.description.id}: no tachometer; expected one, which measures place and speed")
    return wheel


def motion_of(recording: Recording, *, remove_static_bias: bool) -> SampledMotion:
    """Return the samples of a recording. Without a standstill at the start there is no static bias to remove.

    Raises ``BadInputError`` where there is no tachometer: it measures place and speed.
    """
    wheel = required_wheel(recording)
    data = intervals(recording)
    t = 0.5 * (data.edges[1:] + data.edges[:-1])
    span = _standstill_at_start(recording, data)
    rest = (t >= span[0]) & (t <= span[1])
    rested = float(span[1] - span[0])
    bias, excess = np.zeros(3), 0.0
    if remove_static_bias and rested > 0.0:
        bias = data.gyro[rest].mean(axis=0)
        excess = float(np.linalg.norm(data.accel[rest].mean(axis=0))) - gravity_of(recording)
    distance, speed = _place_and_speed(t, wheel.at(t))
    return SampledMotion(
        t=t,
        dt=data.durations,
        gyro=data.gyro - bias,
        accel=data.accel - np.array([0.0, 0.0, excess]),
        distance=distance,
        speed=speed,
        static_bias=bias,
        excess=excess,
        start=rest if rested > 0.0 else t <= t[0] + _TILT_OVER_S,
        standstill_s=rested,
    )


@dataclass(frozen=True)
class Attitude:
    """Attitude at every sample, (n,) each, rad; ``cross_level``, m, left of the *vehicle* higher positive."""

    roll: Array
    cross_level: Array
    pitch: Array | None = None
    roll_sd: Array | None = None
    pitch_sd: Array | None = None


def tables(
    name: str,
    recording: Recording,
    motion: SampledMotion,
    attitude: Attitude,
    parameters: dict[str, float | str | bool],
) -> BaselineResult:
    """Return trajectory at 10 Hz, and cross-level and twist per 0.25 m by the longest pass over each place.

    The sigma of the cross-level is ``base`` times that of the roll. A sensor on springs has a roll of its own: its
    geometry is empty.
    """
    shared: dict[str, float | str | bool] = {"standstill_s": motion.standstill_s}
    shared |= {f"static_bias_{axis}_radps": float(b) for axis, b in zip("xyz", motion.static_bias, strict=True)}
    shared["static_excess_z_mps2"] = motion.excess
    return BaselineResult(
        name=name,
        trajectory=_trajectory(recording, motion, attitude),
        geometry=_geometry(recording, motion, attitude)
        if recording.description.imu.rigid
        else filled(GEOMETRY_COLUMNS, {}),
        parameters=parameters | shared,
    )


def _place_and_speed(t: Array, distance: Array) -> tuple[Array, Array]:
    """Return mean and slope of the distance, m and m/s, over ``_PLACE_OVER_S`` about samples, less near the ends."""
    n = len(t)
    half = max(1, round(0.5 * _PLACE_OVER_S / float(np.median(np.diff(t)))))
    i = np.arange(n)
    inside = np.minimum(half, np.minimum(i, n - 1 - i))  # symmetrical: a place at steady speed does not move
    total = np.concatenate([[0.0], np.cumsum(distance)])
    place = (total[i + inside + 1] - total[i - inside]) / (2 * inside + 1)
    low, high = np.maximum(i - half, 0), np.minimum(i + half, n - 1)
    return place, (distance[high] - distance[low]) / (t[high] - t[low])


def gravity_of(recording: Recording) -> float:
    """Return gravity at the recording's latitude, the standard one where that is not known."""
    latitude = recording.description.track.latitude_deg
    return STANDARD_GRAVITY if latitude is None else normal_gravity(latitude)


def _standstill_at_start(recording: Recording, data: Intervals) -> Array:
    """Return start and end, s, of the standstill that the run begins with; without one both are the run's start."""
    start = data.edges[0]
    spans = find_standstills(recording)
    if len(spans) and spans[0, 0] <= start + _AT_THE_START_S:
        return np.asarray(spans[0])
    return np.array([start, start])


def _trajectory(recording: Recording, motion: SampledMotion, attitude: Attitude) -> pd.DataFrame:
    columns = {
        "chainage_m": recording.description.track.direction * motion.distance,
        "speed_mps": motion.speed,
        "roll_rad": attitude.roll,
        "roll_rad_sd": attitude.roll_sd,
        "pitch_rad": attitude.pitch,
        "pitch_rad_sd": attitude.pitch_sd,
    }
    return resampled_trajectory(motion.t, columns)


def _geometry(recording: Recording, motion: SampledMotion, attitude: Attitude) -> pd.DataFrame:
    every = max(1, round(_PASS_STEP_S / motion.sampling_s))
    traversals = passes(motion.distance[::every])
    of_passes = [_of_pass(recording, motion, attitude, traversal, every) for traversal in traversals]
    geometries = [table for table in of_passes if table is not None]
    if not geometries:
        return filled(GEOMETRY_COLUMNS, {})
    geometries.sort(key=len, reverse=True)  # the longest pass comes first
    joined = pd.concat(geometries, ignore_index=True)
    return joined.drop_duplicates("chainage_m").sort_values("chainage_m", ignore_index=True)


def _of_pass(
    recording: Recording, motion: SampledMotion, attitude: Attitude, traversal: Pass, every: int
) -> pd.DataFrame | None:
    """Return the geometry table of one pass, facing increasing chainage; None for one that is too short."""
    track = recording.description.track
    last = len(motion.t) if (traversal.last + 1) * every >= len(motion.t) else traversal.last * every + 1
    rows = slice(traversal.first * every, last)
    if np.ptp(motion.distance[rows]) < _SHORTEST_PASS_M:
        return None
    values = [track.direction * attitude.cross_level[rows], motion.speed[rows]]
    if attitude.roll_sd is not None:
        values.append(track.cross_level_base_m * attitude.roll_sd[rows])
    grid, at = resample(track.direction * motion.distance[rows], np.stack(values), STEP_M)
    columns = {
        "chainage_m": grid,
        "speed_mps": at[1],
        "cross_level_mm": 1e3 * at[0],
        "twist_mm": 1e3 * twist(at[0], STEP_M, TWIST_BASE_M),
    }
    if attitude.roll_sd is not None:
        columns["cross_level_mm_sd"] = 1e3 * at[2]
    return filled(GEOMETRY_COLUMNS, columns)
