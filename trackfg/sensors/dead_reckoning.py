"""Initial values: a cheap pass over the run that lands close enough for Gauss-Newton.

On a uniform grid: roll and pitch from the specific force less its kinematic part (``dv/dt``, ``v wz``, ``-v wy`` with
the tach's or the GNSS's speed v) below a crossover frequency and from the gyro above it, both by one zero-phase filter,
so that a constant gyro bias cancels; yaw from the gyro; position by stepping the speed along the forward axis. Where
there is GNSS the path is turned and shifted onto it.

Everything is array operations: no loop over time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.linalg.lapack import dtbtrs
from scipy.ndimage import gaussian_filter1d

from trackfg.numerics.arrays import Array
from trackfg.numerics.integrals import trapezoid_integral
from trackfg.numerics.rotations import matrix_from_rpy
from trackfg.recording.model import Recording
from trackfg.sensors.imu_intervals import Intervals, interpolate_columns, means_around
from trackfg.sensors.starting_bias import GridMotion, StartingBias, starting_bias
from trackfg.sensors.tach import Wheel
from trackfg.sensors.tilt import euler_rates

_GRID_S = 0.1
"""Step of the first pass, s: it resolves a train's motion, and ten times fewer rows than the IMU has suffice."""

_CROSSOVER_S = 20.0
"""Attitude comes from the specific force below ``1 / (2 pi 20 s)`` and from the gyro above. At 20 s a gyro of 5 deg/h
drifts by 0.03 deg, less than the 0.1 deg that an acceleration wrong by 0.02 m/s^2 tilts."""


@dataclass(frozen=True)
class InitialPath:
    """The pass on a grid: ``t`` (n,), ``rpy`` (n, 3) rad with yaw unwrapped, ``p`` and ``v`` (n, 3), ``speed`` (n,)."""

    t: Array
    rpy: Array
    p: Array
    v: Array
    speed: Array
    gyro_bias: Array
    start: StartingBias | None = None
    """What is known of the biases beforehand; None where an earlier estimate goes on."""

    def attitude(self, t: Array) -> Array:
        """``R_nb`` at ``t``. Shape (m,) to (m, 3, 3)."""
        rpy = interpolate_columns(t, self.t, self.rpy)
        return matrix_from_rpy(rpy[:, 0], rpy[:, 1], rpy[:, 2])

    def bias(self, t: Array) -> Array:
        """Gyro bias at ``t``, rad/s, shape (m, 3)."""
        return interpolate_columns(t, self.t, self.gyro_bias)

    def position(self, t: Array) -> Array:
        """Position in n at ``t``, m, shape (m, 3)."""
        return interpolate_columns(t, self.t, self.p)

    def rolled(self, t: Array) -> Array:
        """Return the integral of the speed up to ``t``, m: the distance without the rounding of a count, shape (m,)."""
        speed = np.interp(t, self.t, self.speed)
        return trapezoid_integral(t, speed)

    def velocity(self, t: Array) -> Array:
        """Velocity in n at ``t``, m/s, shape (m, 3)."""
        return interpolate_columns(t, self.t, self.v)


def initial_path(
    recording: Recording, data: Intervals, wheel: Wheel | None, rests: Array, earth_rate: Array, yaw: float
) -> InitialPath:
    """Run the pass. ``rests`` (m, 2) s; ``earth_rate`` (3,) rad/s in n; ``yaw`` rad at the start if GNSS is absent."""
    t = np.arange(data.edges[0], data.edges[-1], _GRID_S)
    t = np.append(t, data.edges[-1]) if data.edges[-1] - t[-1] > 1e-6 else t
    gyro, accel = (means_around(t, _GRID_S, data.edges, samples) for samples in (data.gyro, data.accel))
    motion = GridMotion(t, gyro, accel, *_speed(recording, wheel, t))
    bias = starting_bias(motion, rests, earth_rate, recording.description.imu.noise, recording.gnss)
    w = gyro - bias.gyro
    slow = _low_pass(motion.tilt(bias.gyro, bias.accel))
    rp = slow
    dt = np.gradient(t)[:, None]
    for _ in range(2):  # the rates of roll and pitch depend on roll and pitch themselves
        rates = euler_rates(w, rp)
        integral = np.cumsum(rates[:, :2] * dt, axis=0)
        rp = slow + integral - _low_pass(integral)
    heading = np.cumsum(rates[:, 2] * dt[:, 0])
    rpy = np.column_stack([rp, heading - heading[0] + yaw])
    path = _dead_reckon(t, rpy, motion.speed, bias)
    return path if recording.gnss is None else _onto_gnss(path, recording)


def _low_pass(x: Array) -> Array:
    """Return at each time the straight line fitted to all samples with weights ``exp(-|s| / crossover)``.

    Away from the ends that is the first-order filter run both ways. At the ends lines still pass as they are, such as a
    constant bias of the gyro makes, and no single sample, each with its errors, decides how they go on.
    """
    t, s0, s1, s2 = _moments(len(x))
    x0 = _weighted(x)
    x1 = _weighted(t * x) - t * x0
    return np.asarray((s2 * x0 - s1 * x1) / (s2 * s0 - s1 * s1))


@lru_cache(maxsize=1)
def _moments(count: int) -> tuple[Array, Array, Array, Array]:
    """Return the times (n, 1) of samples, in crossovers, and the weighted sums around each of the powers 0, 1 and 2 of
    the time from there, (n, 1). The passes over a run have them in common.
    """
    t: Array = _GRID_S / _CROSSOVER_S * np.arange(count, dtype=np.float64)[:, None]
    by_one, by_t, by_t2 = _weighted(np.ones_like(t)), _weighted(t), _weighted(t * t)
    return t, by_one, by_t - t * by_one, by_t2 - 2.0 * t * by_t + t * t * by_one


def _weighted(x: Array) -> Array:
    """Return the sums of x (n, c) with weights ``exp(-|s| / crossover)`` around each sample."""
    decay = np.exp(-_GRID_S / _CROSSOVER_S)
    recursion = np.stack([np.ones(len(x)), np.full(len(x), -decay)])  # y_k - decay y_{k-1} = x_k, as a banded triangle
    forward = dtbtrs(recursion, x, uplo="L")[0]
    backward = dtbtrs(recursion, x[::-1], uplo="L")[0][::-1]
    return np.asarray(forward + backward - x)


def _speed(recording: Recording, wheel: Wheel | None, t: Array) -> tuple[Array, Array]:
    """Forward speed and its derivative on the grid: from the wheel, else from GNSS positions, else zero."""
    if wheel is not None and (within := (t >= wheel.t[0]) & (t <= wheel.t[-1])).sum() > 1:
        speed = np.interp(t, t[within], np.gradient(wheel.at(t[within]), t[within]))
    elif recording.gnss is not None and len(recording.gnss) > 2:
        gnss_t = recording.gnss["t_s"].to_numpy()
        position = recording.gnss[["east_m", "north_m", "up_m"]].to_numpy()
        speed = np.interp(t, gnss_t, np.linalg.norm(np.gradient(position, gnss_t, axis=0), axis=1))
    else:
        return np.zeros(t.size), np.zeros(t.size)
    speed = _smooth(speed)
    return speed, np.gradient(_smooth(speed), t)


def _smooth(x: Array) -> Array:
    """Smooth by a Gaussian of 0.5 s; slopes go on beyond the ends, since a run may begin with any acceleration."""
    sigma = 0.5 / _GRID_S
    reach = min(round(4.0 * sigma), len(x) - 1)
    return np.asarray(gaussian_filter1d(np.pad(x, reach, "reflect", reflect_type="odd"), sigma)[reach:][: len(x)])


def _dead_reckon(t: Array, rpy: Array, speed: Array, bias: StartingBias) -> InitialPath:
    cp = np.cos(rpy[:, 1])
    forward = np.stack([np.cos(rpy[:, 2]) * cp, np.sin(rpy[:, 2]) * cp, -np.sin(rpy[:, 1])], axis=1)
    v = forward * speed[:, None]
    p = np.vstack([np.zeros(3), np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t)[:, None], axis=0)])
    return InitialPath(t, rpy, p, v, speed, bias.gyro, bias)


def _onto_gnss(path: InitialPath, recording: Recording) -> InitialPath:
    """Turn the path about the vertical and shift it to where it fits the GNSS positions best (Procrustes, in plan)."""
    gnss = recording.gnss
    assert gnss is not None
    t = gnss["t_s"].to_numpy()
    inside = (t >= path.t[0]) & (t <= path.t[-1])
    measured = gnss.loc[inside, ["east_m", "north_m", "up_m"]].to_numpy()
    if len(measured) == 0:
        return path
    ours = path.position(t[inside])
    mean_ours, mean_measured = ours.mean(axis=0), measured.mean(axis=0)
    a = (ours - mean_ours)[:, 0] + 1j * (ours - mean_ours)[:, 1]
    b = (measured - mean_measured)[:, 0] + 1j * (measured - mean_measured)[:, 1]
    turn = float(np.angle(np.sum(np.conj(a) * b)))
    R = matrix_from_rpy(np.zeros(1), np.zeros(1), np.array([turn]))[0]
    p = (path.p - mean_ours) @ R.T + mean_measured
    return replace(path, rpy=path.rpy + np.array([0.0, 0.0, turn]), p=p, v=path.v @ R.T)
