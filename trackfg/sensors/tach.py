"""The tachometer as a function of time: how far the wheel has rolled, how fast, and where it says nothing.

An unsigned tach counts up whichever way the vehicle goes. Its sense is settled movement by movement (a movement lies
between two stops): the forward specific force follows the speed's derivative with the sign of the motion.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import pandas as pd
from scipy.ndimage import gaussian_filter1d

from trackfg.numerics.arrays import Array
from trackfg.numerics.integrals import trapezoid_integral
from trackfg.numerics.key_figures import Outlined
from trackfg.numerics.spans import median_interval, true_runs, union, within
from trackfg.recording.model import IMU_COLUMNS, Recording
from trackfg.sensors.tach_rows import rows_are_pulses, tach_quantum_m

_SPEED_NOISE_MPS = 0.1
"""Noise of a speed signal where neither the settings nor its rows determine it, m/s in 1 s: a tenth of a second's speed
in whole km/h.
"""

_GRID_S = 0.1
"""Step at which force and acceleration are compared, s."""

CRAWL_MPS = 0.25
"""A reversal needs a stop, and a stop may be too short for the tach to show: slower than this may be one."""

_CLEARLY_BACKWARDS = -0.7
"""Correlation of forward specific force and tach acceleration, and force per acceleration, below which a movement
counts as backwards.
"""

LEAST_ROUNDING_M = 1e-4
"""A reading is no better than this, m: what a wheel's roundness and its bearings leave of a fine resolution."""

_USUAL_INTERVALS = 3.5
"""A silence of more usual intervals than this is a gap: one row may be late, three are missing."""

_EDGE_STAMPED_FRACTION = 0.1
"""Rounding error, in pulses, of a count whose rows are the pulses' own times."""


@dataclass(frozen=True, repr=False)
class Wheel(Outlined):
    """Signed nominal ``distance`` (m) at times ``t`` (s); ``rounding_sd`` (m) of a reading; ``gaps`` (g, 2), s. What
    was rolled in the spans ``uncounted`` (u, 2), s, is not in the distance; in each of ``doubtful`` (d, 2), s, all that
    it grows by may be wrong.

    A ``coarse`` tach was read at its steps (:mod:`trackfg.sensors.tach_steps`), and has the 1-sigma of a reading
    between each two rows, ``reading_sds`` (n - 1,), m. A speed signal whose noise is known, or a count that misses
    pulses, has ``grown`` (n,), m^2: the variance of its distance up to each row, besides rounding. ``offset_sd_mps`` is
    by how much a speed signal may be off in motion, m/s.
    """

    t: Array
    distance: Array
    rounding_sd: float
    quantum: float
    integrates_speed: bool
    gaps: Array
    uncounted: Array = field(default_factory=lambda: np.zeros((0, 2)))
    coarse: bool = False
    reading_sds: Array | None = None
    grown: Array | None = None
    offset_sd_mps: float = 0.0
    doubtful: Array = field(default_factory=lambda: np.zeros((0, 2)))

    @property
    def is_plain_count(self) -> bool:
        """Return whether the distance is what was counted, but for one rounding of all readings."""
        return not (self.integrates_speed or self.coarse) and self.reading_sds is None and self.grown is None

    def with_rows(self, t: Array, distance: Array, gaps: Array, uncounted: Array) -> Wheel:
        """Return the wheel with other rows: ``t`` (n,), s, ``distance`` (n,), m, and spans without any, (k, 2), s."""
        known = self.coarse, self.reading_sds, self.grown, self.offset_sd_mps
        return Wheel(t, distance, self.rounding_sd, self.quantum, self.integrates_speed, gaps, uncounted, *known)

    def at(self, t: Array) -> Array:
        """Return the nominal distance at times ``t`` (m,), s, in m, shape (m,); it is constant outside the record."""
        if self.integrates_speed or self.coarse:
            from scipy.interpolate import PchipInterpolator  # late: 0.1 s, and most tachs count finely

            return np.asarray(PchipInterpolator(self.t, self.distance)(np.clip(t, self.t[0], self.t[-1])))
        return np.asarray(np.interp(t, self.t, self.distance))

    def rate(self, t: Array, half_window_s: float = 0.25) -> Array:
        """Return the mean nominal speed over ``t`` (m,), s, plus and minus the half window, m/s, shape (m,)."""
        return (self.at(t + half_window_s) - self.at(t - half_window_s)) / (2.0 * half_window_s)

    def reading_sd(self, t: Array) -> Array:
        """Return the 1-sigma of a reading at ``t``, m: its rounding. Shape (m,)."""
        if self.reading_sds is None:
            return np.full(len(t), self.rounding_sd)
        interval = np.searchsorted(self.t, t, side="right") - 1
        return np.asarray(self.reading_sds[np.clip(interval, 0, len(self.reading_sds) - 1)])

    @property
    def miscount(self) -> float:
        """The density of the errors of a count besides its rounding, m in sqrt(1 m); 0 for a speed signal."""
        if self.grown is None or self.integrates_speed:
            return 0.0
        return float(np.sqrt((self.grown[-1] - self.grown[0]) / np.sum(np.abs(np.diff(self.distance)))))

    def variance_gained(self, t: Array, speed_noise_mps: float) -> Array:
        """Return the variance that the distance gains between neighbouring times (m,), m^2, shape (m - 1,).

        ``speed_noise_mps``, m/s in 1 s, is what the settings give a speed signal; 0 where the rows determine it as far
        as they can.
        """
        doubtful = np.zeros(len(t))
        for span in self.doubtful:
            doubtful += np.interp(t, span, [0.0, float(np.diff(self.at(span))[0]) ** 2])
        if self.grown is not None and not (self.integrates_speed and speed_noise_mps > 0.0):
            return np.diff(np.interp(t, self.t, self.grown) + doubtful)
        density = (speed_noise_mps or _SPEED_NOISE_MPS) if self.integrates_speed else 0.0
        return np.asarray(density**2 * np.diff(t) + np.diff(doubtful))

    def with_speed_noise(self, noise_mps: float) -> Wheel:
        """Return the same with white noise of the speed, m/s in 1 s, besides what is known of it."""
        variance = np.zeros(len(self.t)) if self.grown is None else self.grown
        return replace(self, grown=variance + noise_mps**2 * (self.t - self.t[0]))

    def with_miscount(self, density: float) -> Wheel:
        """Return the same with independent errors of the count, m in sqrt(1 m)."""
        way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(self.distance)))])
        return replace(self, grown=density**2 * way)

    def standing(self, rests: Array) -> Wheel:
        """Return the same without what the noise of a speed signal adds up to in rests (r, 2), s."""
        if not self.integrates_speed:
            return self
        moving = ~within(0.5 * (self.t[1:] + self.t[:-1]), rests)
        return replace(self, distance=np.cumsum(np.append(self.distance[0], np.diff(self.distance) * moving)))

    def with_doubtful(self, spans: Array) -> Wheel:
        """Return the same, but the vehicle may have stood in each of ``spans`` (d, 2), s, though the tach counted."""
        return replace(self, doubtful=union(np.concatenate([self.doubtful, spans])))

    def with_speed(self, t: Array, speed: Array, rolls: np.ndarray) -> Wheel:
        """The same, but where it does not roll (``rolls`` (n - 1,) between the times ``t`` (n,)) by ``speed`` (n,)."""
        gained = 0.5 * (speed[1:] + speed[:-1]) * np.diff(t) - np.diff(self.at(t))
        added = np.concatenate([[0.0], np.cumsum(np.where(rolls, 0.0, gained))])
        rows = np.union1d(self.t, t[1:][~rolls])
        inside = (rows >= self.t[0]) & (rows <= self.t[-1])
        rows = rows[inside]
        distance = self.at(rows) + np.interp(rows, t, added)
        return replace(self, t=rows, distance=distance, reading_sds=None, grown=None)

    def covers(self, t: Array) -> np.ndarray:
        """Return whether there is a reading at times ``t`` (m,), s: inside the record and outside its gaps."""
        inside: np.ndarray = (t >= self.t[0]) & (t <= self.t[-1])
        for start, end in (*self.gaps, *self.uncounted):
            inside &= (t <= start) | (t >= end)
        return inside

    def counts(self, t: Array) -> np.ndarray:
        """Return whether all that is rolled between neighbouring times (m,) is in the distance, shape (m - 1,)."""
        counted = np.ones(len(t) - 1, dtype=bool)
        for start, end in self.uncounted:
            counted &= (t[1:] <= start) | (t[:-1] >= end)
        return counted


def read_wheel(recording: Recording, max_gap_s: float) -> Wheel | None:
    """Return the recording's tach, signed; None where it has fewer than two rows, which measure no speed.

    For ``max_gap_s`` see :func:`longest_silence_s`.
    """
    if recording.tach is None or recording.description.tach is None or len(recording.tach) < 2:
        return None
    description, table = recording.description.tach, recording.tach
    t, distance = table["t_s"].to_numpy(), table["distance_m"].to_numpy()
    speed = description.integrates_speed
    quantum, rounding = (0.0, LEAST_ROUNDING_M) if speed else read_resolution(t, distance)
    gaps = silences(t, distance, quantum, longest_silence_s(t, max_gap_s))
    if not description.signed:
        distance = _signed(t, distance, recording)
    return Wheel(t, distance, rounding, quantum, speed, gaps)


def with_sense(recording: Recording) -> pd.DataFrame:
    """Return the recording's tach, an unsigned one with the sense of each movement where the vehicle turns back."""
    tach, description = recording.tach, recording.description.tach
    assert tach is not None
    if description is None or description.signed:
        return tach
    distance = _signed(tach["t_s"].to_numpy(), tach["distance_m"].to_numpy(), recording)
    steps = np.diff(distance)
    turns_back = (steps < 0.0).any() and (steps > 0.0).any()
    return tach.assign(distance_m=distance) if turns_back else tach


def read_resolution(t: Array, distance: Array) -> tuple[float, float]:
    """Return the distance of one count, 0 where there are none, and the sigma of a reading's rounding, m.

    ``t`` (n,), s, and ``distance`` (n,), m, are the rows of a tach.
    """
    quantum = tach_quantum_m(pd.DataFrame({"t_s": t, "distance_m": distance}))
    rounding = quantum / float(np.sqrt(12.0))
    if rows_are_pulses(t, distance, quantum):
        rounding = _EDGE_STAMPED_FRACTION * quantum
    return quantum, max(rounding, LEAST_ROUNDING_M)


def longest_silence_s(t: Array, max_gap_s: float) -> float:
    """Return the longest time between rows, at ``t`` (n,) s, that is no gap: ``max_gap_s``, or some usual intervals."""
    return max(max_gap_s, _USUAL_INTERVALS * median_interval(t))


def silences(t: Array, distance: Array, quantum: float, longest_s: float) -> Array:
    """Return spans without rows, longer than ``longest_s``, over which the wheel rolled, s, shape (g, 2). How far it
    had rolled within one is not read off a straight line: at 1 m/s^2 that would be 0.5 m off in the middle of 2 s.
    """
    silent = t[1:] - t[:-1] > longest_s
    if not silent.any():
        return np.zeros((0, 2))
    silent &= np.abs(np.diff(distance)) > 1.5 * quantum
    return np.stack([t[:-1][silent], t[1:][silent]], axis=1)


def _signed(t: Array, distance: Array, recording: Recording) -> Array:
    """Give each movement between stops the sense in which the accelerometer saw it; forwards where that is unclear."""
    grid = np.arange(t[0], t[-1] + _GRID_S, _GRID_S)
    if grid.size < 10:
        return distance
    rolled = np.interp(grid, t, distance)
    speed = gaussian_filter1d(np.gradient(rolled, _GRID_S), 0.5 / _GRID_S)
    imu_t = recording.imu["t_s"].to_numpy()
    integral = trapezoid_integral(imu_t, recording.imu[IMU_COLUMNS[4]].to_numpy())
    force = gaussian_filter1d(np.gradient(np.interp(grid, imu_t, integral), _GRID_S), 0.5 / _GRID_S)
    acceleration = np.gradient(speed, _GRID_S)
    movements = true_runs(speed > CRAWL_MPS)
    # A movement reaches to the middle of the crawl on either side, where it began and ended.
    middle = np.concatenate([[0], (movements[1:, 0] + movements[:-1, 1]) // 2, [grid.size]])
    sense = np.ones(grid.size)
    for i, j in pairwise(middle):
        f, a = force[i:j] - force[i:j].mean(), acceleration[i:j] - acceleration[i:j].mean()
        # Against both: at constant speed the tach's acceleration is rounding, to which the force is small.
        if float(f @ a) < _CLEARLY_BACKWARDS * np.linalg.norm(a) * max(np.linalg.norm(f), np.linalg.norm(a)):
            sense[i:j] = -1.0
    if (sense > 0).all():
        return distance
    row_sense = np.where(np.interp(0.5 * (t[1:] + t[:-1]), grid, sense) < 0, -1.0, 1.0)
    return np.asarray(distance[0] + np.concatenate([[0.0], np.cumsum(row_sense * np.diff(distance))]))
