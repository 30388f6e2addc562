"""The inertial sensor alone shows the forward acceleration, without the errors that last for a whole run.

The forward acceleration is the specific force less gravity's part, for which the pitch is the gyro's, so that no slip
of a wheel spoils it. Over a run it is off by

    b + d t + k a + psi v w + g rho turn:

the accelerometer's bias b; a drift d of the pitch, since the gyro has a bias, too; its scale k; the yaw psi of the
sensor in its mounting, by which it measures a share of the curve's side force v w as well; and the error rho of its
roll, by which each turn of the vehicle looks like a change of pitch. A sensor of a few euros, whose bias of 50 mg is 50
mrad of roll, is off by 0.5 m/s^2 after each curve of 60 degrees. All five follow from what the wheel says of the
acceleration, by least squares with Cauchy's weights: where it slips, other than for most of the run, it has none.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d

from trackfg.config import SmoothConfig
from trackfg.numerics.arrays import Array
from trackfg.numerics.robust import SD_PER_MAD, cauchy_fit
from trackfg.sensors.dead_reckoning import InitialPath
from trackfg.sensors.imu_intervals import Intervals, means_around
from trackfg.sensors.imu_noise.noise_floor import NoiseFloor
from trackfg.sensors.tach import Wheel

_ACCELERATION_SD = 0.02
"""m/s in 1 s: noise, vibration, the body on its springs; at least."""

_NEARBY_S = 20.0
"""Noise is that of so long, s: vibration goes with the speed."""

_MEAN_S = 5.0
"""The wheel's acceleration is a mean over this, s: a speed in whole km/h says it to 0.03 m/s^2 then."""

_PITCH_DRIFT = 2e-3
"""Sigma of the gyro's bias that rests, or the median, have left, rad/s: a sensor of a few euros, 0.1 deg/s."""

_SCALE_SD = 0.03
"""Sigma of the accelerometer's scale: 3 % is the initial tolerance of the MPU-6050."""

_ROLL_SD = 0.1
"""Sigma of a roll by the accelerometer, rad: a sensor of a few euros is off by 50 to 100 mg."""

_LEAST_SD_MPS2 = 1e-3
"""Residuals have at least this sigma, m/s^2: no train accelerates more steadily."""


class ForwardForce(NamedTuple):
    """The forward specific ``force`` (n,), m/s^2, and what of it is ``acceleration`` (n,), each the mean of a step.

    ``noise`` (n,), m/s in 1 s.
    """

    force: Array
    acceleration: Array
    noise: Array


def forward_force(
    t: Array, wheel: Wheel, data: Intervals, floor: NoiseFloor, path: InitialPath, gravity: float, config: SmoothConfig
) -> ForwardForce:
    """Return the forward force between the times ``t`` (n + 1,), equally far apart, s.

    ``floor`` is the noise of the samples in ``data``; ``path`` gives roll and gyro bias; ``gravity`` m/s^2.
    """
    step, middle = float(t[1] - t[0]), 0.5 * (t[1:] + t[:-1])
    force, gyro = (means_around(middle, step, data.edges, samples) for samples in (data.accel, data.gyro))
    rate = gyro - path.bias(middle)
    acceleration = force[:, 0] + gravity * np.sin(_pitch(middle, rate, path))
    errors = _lasting_errors(t, acceleration, rate[:, 2], wheel, gravity, config)
    white = floor.between(t, _ACCELERATION_SD, _ACCELERATION_SD).accel[:, 0]
    return ForwardForce(force[:, 0], acceleration - errors, np.maximum(white, _shaking(force[:, 0], step)))


def _pitch(t: Array, w: Array, path: InitialPath) -> Array:
    """Return the pitch by the rates ``w`` (n, 3) alone, up to a constant, at times (n,), rad.

    Track rises and falls alike, so the rate's median is bias.
    """
    roll = np.interp(t, path.t, path.rpy[:, 0])
    rate = w[:, 1] * np.cos(roll) - w[:, 2] * np.sin(roll)
    return np.asarray(np.cumsum(rate - np.median(rate)) * (t[1] - t[0]))


def _shaking(force: Array, step: float) -> Array:
    """Return the noise of the force that differs from step to step, more than the vehicle's acceleration: m/s in 1 s.

    That is vibration of some hertz, of which the means over a step hold what is left. By medians of second differences.
    """
    bend = np.abs(np.diff(force, n=2)) / np.sqrt(6.0)
    width = min(len(bend), 2 * round(0.5 * _NEARBY_S / step) + 1)
    return np.asarray(SD_PER_MAD * np.sqrt(step) * np.pad(median_filter(bend, width, mode="nearest"), 1, "edge"))


def _lasting_errors(
    t: Array, acceleration: Array, yaw_rate: Array, wheel: Wheel, gravity: float, config: SmoothConfig
) -> Array:
    """Return the errors of the acceleration (n,), m/s^2, that last for the whole run, by the wheel."""
    step, speed = float(t[1] - t[0]), wheel.rate(t)
    since, turn = step * np.arange(len(acceleration)), step * np.cumsum(yaw_rate)
    side = 0.5 * (speed[1:] + speed[:-1]) * yaw_rate
    terms = np.stack([np.ones_like(since), since, acceleration, side, gravity * turn], axis=1)
    sigmas = [np.inf, gravity * _PITCH_DRIFT, _SCALE_SD, np.radians(config.motion.mount_sd_deg), _ROLL_SD]
    width = min(len(since), round(_MEAN_S / step))
    excess = np.column_stack([terms, acceleration - np.diff(speed) / step])
    means = uniform_filter1d(excess, width, axis=0, mode="nearest")[wheel.covers(t[1:]) & wheel.covers(t[:-1])]
    if not len(means):
        return np.zeros_like(acceleration)
    coefficients, _ = cauchy_fit(means[:, :-1], means[:, -1], np.array(sigmas), _LEAST_SD_MPS2, width)
    return np.asarray(terms @ coefficients)
