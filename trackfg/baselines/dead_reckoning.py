"""Dead reckoning: attitude, distance and position from gyro, wheel and gravity, without any estimation.

It is the floor for every estimator: P. D. Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation
Systems*, 2nd ed. (2013), sections 5.6.2 (levelling by gravity), 6.3 (odometer and gyro) and 15.2 (biases at rest).

- The gyro's bias is its mean over each rest, interpolated. Without any rest it is the mean of the roll and pitch rates,
  since those angles return to where they were, and the median of the yaw rate, since most track is straight.
- The vertical is the mean specific force at rest, or of the whole run: the rate about it is that of the heading,
  however the sensor is mounted.
- The path is the integral of the wheel's nominal speed along the heading. With GNSS it is turned and shifted onto the
  positions. The chainage is the first fix's at its time.
- Roll and pitch are the gyro's, drawn to the tilt of the specific force less the wheel's acceleration and ``v^2/R``
  with the time constant of the complementary baseline.

It gives no sigmas.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from trackfg.baselines.attitude import required_wheel
from trackfg.baselines.complementary import complementary_roll, smoothing
from trackfg.baselines.result import BaselineResult, resampled_trajectory
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import within
from trackfg.recording.model import Recording
from trackfg.sensors.imu_intervals import intervals
from trackfg.sensors.standstills import find_standstills
from trackfg.sensors.starting_bias import rest_bias
from trackfg.sensors.tilt import euler_rates, force_tilt

_SPEED_OVER_S = 0.25
"""The speed is the wheel's over this before and after, s: pulses are evened out. At the ends it is that further in."""
_TIME_CONSTANT_S = 12.5
"""Of roll and pitch, s: that of the complementary baseline's paper."""


def run(recording: Recording) -> BaselineResult:
    """Estimate chainage, speed, position and attitude, ten rows a second.

    Raises ``BadInputError`` where there is no tachometer.
    """
    wheel, data, track = required_wheel(recording), intervals(recording), recording.description.track
    t, dt = 0.5 * (data.edges[1:] + data.edges[:-1]), data.durations
    rests = find_standstills(recording)
    rate = data.gyro - _bias(t, data.gyro, rests)
    resting = within(t, rests) if len(rests) else np.ones(len(t), dtype=bool)
    level = data.accel[resting].mean(axis=0)
    distance = wheel.at(t) - wheel.at(t[:1])
    speed = wheel.rate(np.clip(t, wheel.t[0] + _SPEED_OVER_S, wheel.t[-1] - _SPEED_OVER_S), _SPEED_OVER_S)
    yaw = np.cumsum(rate @ (level / np.linalg.norm(level)) * dt)
    if track.heading_deg is not None:
        yaw += np.pi / 2.0 - np.radians(track.heading_deg)
    place, turn = _onto_positions(t, np.cumsum(speed * np.exp(1j * yaw) * dt), recording)

    kinematic = np.stack([np.gradient(speed, t), speed * rate[:, 2], -speed * rate[:, 1]], axis=1)
    tilt, alpha = force_tilt(data.accel - kinematic), smoothing(_TIME_CONSTANT_S, float(np.median(dt)))
    start = force_tilt(level[None])[0]
    turned = euler_rates(rate, tilt) * dt[:, None]
    roll, pitch = (complementary_roll(tilt[:, i], turned[:, i], alpha, float(start[i])) for i in (0, 1))
    rolled = track.direction * distance
    columns = {
        "chainage_m": _first_chainage(t, rolled, recording) + rolled,
        "speed_mps": speed,
        "east_m": place.real,
        "north_m": place.imag,
        "roll_rad": roll,
        "pitch_rad": pitch,
        "yaw_rad": yaw + turn,
    }
    return BaselineResult(
        name="dead reckoning",
        trajectory=resampled_trajectory(t, columns),
        parameters={"rests": float(len(rests)), "rest_s": float(np.diff(rests, axis=1).sum())},
    )


def _bias(t: Array, gyro: Array, rests: Array) -> Array:
    """Return the gyro's bias (n, 3), rad/s."""
    if len(rests):
        return rest_bias(t, gyro, rests, np.zeros(3))
    return np.tile(np.append(gyro[:, :2].mean(axis=0), np.median(gyro[:, 2])), (len(t), 1))


def _onto_positions(t: Array, path: Array, recording: Recording) -> tuple[Array, float]:
    """Return the path (n,), east + i north, m, turned and shifted onto the GNSS positions, and the turn, rad."""
    gnss = pd.DataFrame() if recording.gnss is None else recording.gnss[recording.gnss["t_s"].between(t[0], t[-1])]
    if len(gnss) == 0:
        return path, 0.0
    positions = gnss["east_m"].to_numpy() + 1j * gnss["north_m"].to_numpy()
    at = np.interp(gnss["t_s"], t, path.real) + 1j * np.interp(gnss["t_s"], t, path.imag)
    turn = float(np.angle(np.sum(np.conj(at - at.mean()) * (positions - positions.mean()))))
    return (path - at.mean()) * np.exp(1j * turn) + positions.mean(), turn


def _first_chainage(t: Array, rolled: Array, recording: Recording) -> float:
    """Return the chainage at the start, m, with which that at the first fix is the fix's; 0 without fixes."""
    if recording.fixes is None or recording.fixes.empty:
        return 0.0
    first = recording.fixes.iloc[0]
    return float(first["chainage_m"] - np.interp(first["t_s"], t, rolled))
