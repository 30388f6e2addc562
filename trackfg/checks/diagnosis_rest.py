"""An inertial sensor shows its biases and its white noise while the vehicle stands still.

White noise: the Allan variance of averages over ``tau`` is ``N^2 / tau`` for a density N, so that
``N = sqrt(tau / 2 * mean((x_{i+1} - x_i)^2))`` over successive averages x (IEEE Std 952). A tau of a quarter of a
second is short enough for slow drift not to matter and long enough for the sensor's own filter not to.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfg.numerics import geodesy
from trackfg.numerics.arrays import Array
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.recording.model import IMU_COLUMNS, Recording

_TAU_S = 0.25
"""Averages over this, s, show the white noise: a drift of the bias adds little to their differences yet."""
_MARGIN_S = 0.5
"""Left out at both ends of a standstill: brakes and couplings are still settling."""
_GRAVITY_SD = 0.03
"""m/s^2: how much gravity varies over the Earth where the latitude is not known."""


@dataclass(frozen=True)
class StaticBias:
    """Averages over all standstills, ``duration_s`` in total.

    ``gyro_radps`` still holds the Earth's rotation (7e-5 rad/s). ``accel_excess_mps2`` is the magnitude of specific
    force less gravity: the part of the accelerometer's bias along the vertical; the other two cannot be separated from
    tilt.
    """

    gyro_radps: tuple[float, float, float]
    gyro_sd_radps: tuple[float, float, float]
    accel_excess_mps2: float
    accel_excess_sd_mps2: float
    standstills: int
    duration_s: float


@dataclass(frozen=True)
class NoiseDensity:
    """White noise, root mean square over the axes, with its sigma; and the ratio to what the description declares."""

    gyro_white: float
    gyro_white_sd: float
    gyro_ratio: float
    accel_white: float
    accel_white_sd: float
    accel_ratio: float


def static_bias(recording: Recording, standstills: Array) -> StaticBias | None:
    """Return the biases; None without standstill. ``standstills`` (m, 2) as from :func:`find_standstills`.

    Sigma of a mean: white noise over the whole duration, and the scatter between standstills where there are several.
    """
    spans = _spans(recording, standstills)
    if not spans:
        return None
    t = recording.imu["t_s"].to_numpy()
    weights = np.array([span.stop - span.start for span in spans], dtype=np.float64)
    means, white = np.empty((2, len(spans), 4))
    for i, span in enumerate(spans):
        samples = _samples(recording, span)
        average, scatter = samples.mean(axis=0), samples.std(axis=0)
        means[i] = *average[:3], np.linalg.norm(average[3:])
        white[i] = *scatter[:3], scatter[3:].max()
    mean = np.average(means, axis=0, weights=weights)
    variance = np.average(white**2, axis=0, weights=weights) / weights.sum()
    if len(spans) > 1:
        variance = variance + np.average((means - mean) ** 2, axis=0, weights=weights) / (len(spans) - 1)
    latitude = recording.description.track.latitude_deg
    gravity = STANDARD_GRAVITY if latitude is None else geodesy.normal_gravity(latitude)
    sd = np.sqrt(variance)
    return StaticBias(
        gyro_radps=(float(mean[0]), float(mean[1]), float(mean[2])),
        gyro_sd_radps=(float(sd[0]), float(sd[1]), float(sd[2])),
        accel_excess_mps2=float(mean[3] - gravity),
        accel_excess_sd_mps2=float(np.hypot(sd[3], _GRAVITY_SD if latitude is None else 0.0)),
        standstills=len(spans),
        duration_s=float(sum((span.stop - span.start) * _interval(t, span) for span in spans)),
    )


def noise_density(recording: Recording, standstills: Array) -> NoiseDensity | None:
    """Return the white noise of gyro and accelerometer in ``standstills`` (r, 2), s; None without a standstill that
    holds a few averages.

    A mean over tau differs from the next by noise of twice the density squared over tau.
    """
    t = recording.imu["t_s"].to_numpy()
    declared = recording.description.imu.noise
    differences = []
    for span in _spans(recording, standstills):
        interval = _interval(t, span)
        size = max(1, round(_TAU_S / interval))
        count = (span.stop - span.start) // size
        samples = _samples(recording, slice(span.start, span.start + count * size))
        averages = samples.reshape(count, size, 6).mean(axis=1)
        differences.append(np.diff(averages, axis=0) * np.sqrt(0.5 * size * interval))
    squares = np.concatenate(differences) ** 2 if differences else np.empty((0, 6))
    if squares.shape[0] < 5:
        return None
    gyro, accel = (float(np.sqrt(squares[:, i : i + 3].mean())) for i in (0, 3))
    # A difference shares an average with the next: 2/3 of them count. The sigma of a root is half of that of a square.
    relative = float(0.5 * np.sqrt(2.0 / (2.0 / 3.0 * 3.0 * squares.shape[0])))
    return NoiseDensity(
        gyro_white=gyro,
        gyro_white_sd=relative * gyro,
        gyro_ratio=gyro / declared.gyro_white,
        accel_white=accel,
        accel_white_sd=relative * accel,
        accel_ratio=accel / declared.accel_white,
    )


def _samples(recording: Recording, rows: slice) -> Array:
    """Return what gyro and accelerometer measure in some rows, (k, 6)."""
    return np.column_stack([recording.imu[name].iloc[rows] for name in IMU_COLUMNS[1:]])


def _interval(t: Array, span: slice) -> float:
    """Return the sampling interval of rows at ``t`` (n,), s, in a standstill: the rate may be another one elsewhere."""
    return float(np.median(np.diff(t[span])))


def _spans(recording: Recording, standstills: Array) -> list[slice]:
    """Return the IMU rows of each standstill, less the margins, where at least a second is left."""
    t = recording.imu["t_s"].to_numpy()
    bounds = np.searchsorted(t, np.asarray(standstills) + np.array([_MARGIN_S, -_MARGIN_S]))
    spans = [slice(int(a), int(b)) for a, b in bounds.reshape(-1, 2) if b - a >= 2]
    return [span for span in spans if (span.stop - span.start) * _interval(t, span) >= 1.0]
