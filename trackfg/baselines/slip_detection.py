"""Wheel slip and slide by comparing two accelerations, and the last moment before that the wheel certainly rolled.

Every cycle of 100 ms the specific force along the vehicle ``a_x`` and the acceleration of the wheel ``A_p``, the second
difference of the tachometer's distance, are averaged over the last 3 s. Slip or slide is

    |a_x - A_p| > Ta                                                                        (1)

with ``Ta`` = 1.23 km/h/s, what gravity along the steepest line (35 permille) adds to ``a_x``. The wheel is off already
then. The start point is the latest cycle, a setback of 2.1 s or more before the detection, at which for three cycles on
end the jerks of both averages are small and alike: ``|Jp| <= 0.15, |Ji| <= 0.1, |Ji - Jp| < 0.05`` km/h/s per cycle.

An average belongs to the middle of its 3 s: there, 1.5 s before the cycle that was picked, the correction starts.

Source: Iwata, Yamamichi, Sugiyama and Kitano, sections 3.1.1, 3.1.2 (2) and 4.3.1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfg.baselines.attitude import required_wheel
from trackfg.baselines.rest_zeros import held_since_rest
from trackfg.errors import BadInputError
from trackfg.numerics.arrays import Array
from trackfg.numerics.units import KMH
from trackfg.recording.model import Recording
from trackfg.sensors.imu_intervals import intervals, means_around
from trackfg.sensors.standstills import find_standstills

_MAX_TACH_GAP_S = 1.0
"""A longer silence of the tachometer while moving is a gap, s. Chosen here."""
_CYCLES_ON_END = 3
"""Cycles that have to meet the jerk rule one after the other (the paper's)."""


@dataclass(frozen=True)
class Cycles:
    """n cycles that end at ``t`` (n,), ``step_s`` apart; ``window`` of them make an average, which is taken backwards.

    ``distance``, m, and ``speed``, m/s, over the last cycle, of the wheel; ``gyro``, rad/s less what it showed at rest,
    and ``accel``, m/s^2, (n, 3): means over the cycle. The averages: ``wheel_acceleration`` (A_p), ``mean_speed``,
    ``mean_gyro``, ``mean_accel``, whose first column is a_x.
    """

    t: Array
    step_s: float
    window: int
    distance: Array
    speed: Array
    gyro: Array
    accel: Array
    wheel_acceleration: Array
    mean_speed: Array
    mean_gyro: Array
    mean_accel: Array

    def __len__(self) -> int:
        return len(self.t)

    @property
    def disagreement(self) -> Array:
        """Return ``a_x - A_p``, m/s^2: above zero when the wheel falls behind, as in a slide."""
        return self.mean_accel[:, 0] - self.wheel_acceleration


def read_cycles(recording: Recording, *, cycle_s: float, average_s: float) -> Cycles:
    """Return the recording in cycles. Raises ``BadInputError`` without a tachometer, or for too short a record."""
    wheel, data = required_wheel(recording, _MAX_TACH_GAP_S), intervals(recording)
    window = round(average_s / cycle_s)
    count = int((data.edges[-1] - data.edges[0]) / cycle_s + 1e-6)
    if count <= window:
        raise BadInputError(f"{recording.description.id}: {count * cycle_s:g} s; expected more than {average_s:g} s")
    t = data.edges[0] + cycle_s * np.arange(1, count + 1)
    middle = 0.5 * (data.edges[1:] + data.edges[:-1])
    gyro = data.gyro - held_since_rest(middle, find_standstills(recording), data.gyro)
    distance = wheel.at(t)
    # Before the record the vehicle is taken to have moved as it did in the first cycle.
    first = distance[0] - wheel.at(t[:1] - cycle_s)[0]
    earlier = distance[0] - first * np.arange(window + 1, 0, -1)
    long = np.concatenate([earlier, distance])
    speed = np.diff(long) / cycle_s
    return Cycles(
        t=t,
        step_s=cycle_s,
        window=window,
        distance=distance,
        speed=speed[window:],
        gyro=means_around(t - 0.5 * cycle_s, cycle_s, data.edges, gyro),
        accel=means_around(t - 0.5 * cycle_s, cycle_s, data.edges, data.accel),
        wheel_acceleration=(speed[window:] - speed[:-window]) / (window * cycle_s),
        mean_speed=(long[window + 1 :] - long[1:-window]) / (window * cycle_s),
        mean_gyro=means_around(t - 0.5 * average_s, average_s, data.edges, gyro),
        mean_accel=means_around(t - 0.5 * average_s, average_s, data.edges, data.accel),
    )


@dataclass(frozen=True)
class JerkRule:
    """The rule by which the wheel certainly rolls. Limits are in km/h/s per cycle."""

    pulse: float = 0.15
    inertial: float = 0.1
    between: float = 0.05

    def steady(self, cycles: Cycles) -> np.ndarray:
        """Return cycles that end three on end which meet the rule. Shape (n,) of bool."""
        wheel = np.diff(cycles.wheel_acceleration, prepend=np.nan) / KMH
        inertial = np.diff(cycles.mean_accel[:, 0], prepend=np.nan) / KMH
        met = (
            (np.abs(wheel) <= self.pulse)
            & (np.abs(inertial) <= self.inertial)
            & (np.abs(inertial - wheel) < self.between)
        )
        three: np.ndarray = met.copy()
        for back in range(1, _CYCLES_ON_END):
            three[back:] &= met[:-back]
            three[:back] = False
        return three


def detections(cycles: Cycles, threshold_kmhps: float) -> np.ndarray:
    """Return cycles that meet (1), of bool (n,)."""
    beyond: np.ndarray = np.abs(cycles.disagreement) > threshold_kmhps * KMH
    return beyond


def start_point(cycles: Cycles, steady: np.ndarray, detected: int, setback_s: float, earliest: int) -> int | None:
    """Return the latest steady cycle, ``setback_s`` or more before ``detected`` and not before ``earliest``, if any."""
    latest = detected - round(setback_s / cycles.step_s)
    if latest < earliest:
        return None
    candidates = np.flatnonzero(steady[earliest : latest + 1])
    return earliest + int(candidates[-1]) if candidates.size else None
