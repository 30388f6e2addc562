"""A measuring unit on a car body makes attitude, and acceleration across its path, of its inertial sensor.

*Attitude.* Roll ``phi`` and pitch ``theta`` by a complementary filter with the time constant ``T``,

    phi_k = a (phi_{k-1} + phi'_k dt) + (1 - a) asin((f_y - V w_z) / g),     a = T / (T + dt),
    theta_k = a (theta_{k-1} + theta'_k dt) - (1 - a) asin((f_x - V') / g),
    phi' = w_x + (w_y sin phi + w_z cos phi) tan theta,   theta' = w_y cos phi - w_z sin phi,

``V w_z`` the centripetal and ``V'`` the tachometer's acceleration. The rates depend on the angles themselves: they are
put in from the pass before, ``_PASSES`` times. Over the few metres of a chord the angles' *changes* are the gyro's
alone, ``theta_g = int theta'`` and ``heading = int (w_y sin phi + w_z cos phi) / cos theta``.

*Acceleration* square to the body's x axis, in the plane of the track's tangent and the vertical (``up``) and level to
the left (``left``):

    left = cos phi f_y - sin phi f_z,   up = sin phi f_y + cos phi f_z - g cos theta.

With the x axis along the path these are ``V^2`` times the path's curvatures, whether or not the vehicle speeds up.

*Zeros.* At every rest the means of the gyro, and of the specific force along z less what gravity leaves of it after the
other two axes, are taken for the sensors' offsets until the next rest. The horizontal offsets cannot be separated from
a tilt there; the filter takes them for one, so that they do not stay in ``left``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter

from trackfg.baselines.attitude import gravity_of, required_wheel
from trackfg.baselines.rest_zeros import held_since_rest
from trackfg.numerics.arrays import Array
from trackfg.recording.model import Recording
from trackfg.sensors.imu_intervals import intervals
from trackfg.sensors.standstills import find_standstills

_PASSES = 12
"""Roll and pitch act on one another by ``w_z T``, at most some 0.6: each pass leaves that part of the last error."""

_MAX_TACH_GAP_S = 1.0
"""A longer silence of the tachometer while moving is a gap, s. Chosen here."""


@dataclass(frozen=True)
class UnitMotion:
    """The motion at the samples' times ``t`` (n,) s.

    ``distance`` (m) and ``speed`` (m/s) by the tachometer, its nominal wheel; ``roll, pitch`` (rad) by the filter;
    ``pitch_by_gyro, heading`` (rad) by the gyro alone; ``left, up``: accelerations square to the path, m/s^2.
    """

    t: Array
    distance: Array
    speed: Array
    roll: Array
    pitch: Array
    pitch_by_gyro: Array
    heading: Array
    left: Array
    up: Array


def unit_motion(recording: Recording, *, attitude_time_s: float, speed_window_s: float) -> UnitMotion:
    """Return attitude and accelerations of the unit. Speed and distance are means over ``speed_window_s``.

    Raises ``BadInputError`` where there is no tachometer.
    """
    wheel, data, g = required_wheel(recording, _MAX_TACH_GAP_S), intervals(recording), gravity_of(recording)
    t, dt = 0.5 * (data.edges[1:] + data.edges[:-1]), data.durations
    distance, speed, gained = _by_wheel(wheel.at(t), float(np.median(dt)), speed_window_s)
    rests = find_standstills(recording)
    gyro = data.gyro - held_since_rest(t, rests, data.gyro)
    accel = data.accel.copy()
    mean = held_since_rest(t, rests, data.accel)
    if len(rests):
        accel[:, 2] -= mean[:, 2] - np.sqrt(g**2 - mean[:, 0] ** 2 - mean[:, 1] ** 2)

    roll_seen = np.arcsin(np.clip((accel[:, 1] - speed * gyro[:, 2]) / g, -1.0, 1.0))
    pitch_seen = -np.arcsin(np.clip((accel[:, 0] - gained) / g, -1.0, 1.0))
    roll, pitch = roll_seen, pitch_seen
    roll_rate, pitch_rate, yaw_rate = gyro.T
    for _ in range(_PASSES):
        yaw_rate = (gyro[:, 1] * np.sin(roll) + gyro[:, 2] * np.cos(roll)) / np.cos(pitch)
        roll_rate = gyro[:, 0] + yaw_rate * np.sin(pitch)
        pitch_rate = gyro[:, 1] * np.cos(roll) - gyro[:, 2] * np.sin(roll)
        roll = _complementary(roll_seen, roll_rate, dt, attitude_time_s)
        pitch = _complementary(pitch_seen, pitch_rate, dt, attitude_time_s)
    return UnitMotion(
        t=t,
        distance=distance,
        speed=speed,
        roll=roll,
        pitch=pitch,
        pitch_by_gyro=pitch[0] + _integral(pitch_rate, dt),
        heading=_integral(yaw_rate, dt),
        left=np.cos(roll) * accel[:, 1] - np.sin(roll) * accel[:, 2],
        up=np.sin(roll) * accel[:, 1] + np.cos(roll) * accel[:, 2] - g * np.cos(pitch),
    )


def _by_wheel(distance: Array, step_s: float, window_s: float) -> tuple[Array, Array, Array]:
    """Return mean distance and speed over the window, and the mean slope of that speed. Shapes (n,).

    Beyond its ends the record goes on as it is on this side of them, turned round (a steady speed stays one).
    """
    half = max(1, round(0.5 * window_s / step_s))
    long = np.pad(distance, 2 * half, mode="reflect", reflect_type="odd")
    span = 2 * half * step_s
    speed = (long[2 * half :] - long[: -2 * half]) / span
    gained = (speed[2 * half :] - speed[: -2 * half]) / span
    return uniform_filter1d(long, 2 * half + 1)[2 * half : -2 * half], speed[half:-half], gained


def _complementary(accel_angle: Array, rate: Array, dt: Array, time_s: float) -> Array:
    """Return the angle: below the corner ``accel_angle``, above it the integral of the gyro's ``rate``. Shapes (n,)."""
    step = float(np.median(dt))
    a = time_s / (time_s + step)
    start = float(accel_angle[: max(1, round(1.0 / step))].mean())
    out, _ = lfilter([1.0], [1.0, -a], a * rate * dt + (1.0 - a) * accel_angle, zi=[a * start])
    return np.asarray(out)


def _integral(rate: Array, dt: Array) -> Array:
    """Integrate to the middle of each sample, from that of the first. Shapes (n,)."""
    half = 0.5 * rate * dt
    return np.concatenate([[0.0], np.cumsum(half[1:] + half[:-1])])
