"""What an IMU adds to the truth.

A fixed mounting rotation ``R_vs = Rz(yaw) Ry(pitch)`` of sensor in vehicle, an initial bias, a bias random walk
(``b_{k+1} = b_k + walk sqrt(dt) n``), and white noise of standard deviation ``density / sqrt(dt)``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfg import frames
from trackfg.description import ImuNoise, Vector3
from trackfg.frames import Array


@dataclass(frozen=True)
class ImuModel:
    """An IMU in the vehicle. ``mount_sd_rad``: standard deviation of the residual mounting pitch and yaw."""

    rate_hz: float
    noise: ImuNoise
    lever_arm_m: Vector3 = (0.0, 0.0, 0.0)
    mount_sd_rad: float = 0.0


@dataclass(frozen=True)
class ImuErrors:
    """What an IMU adds to the truth: white noise and bias of each sample, (n, 3) each, and its mounting."""

    gyro_noise: Array
    accel_noise: Array
    gyro_bias: Array
    accel_bias: Array
    mount_rpy_rad: Vector3


def draw_errors(model: ImuModel, edges: Array, rng: np.random.Generator) -> ImuErrors:
    """Errors for the samples between ``edges``."""
    noise, n, dt = model.noise, len(edges) - 1, 1.0 / model.rate_hz
    # One stream each: a longer run begins as a shorter one does.
    mount_rng, gyro_rng, accel_rng, gyro_bias_rng, accel_bias_rng = rng.spawn(5)

    def bias(stream: np.random.Generator, initial_sd: float, walk: float) -> Array:
        start = initial_sd * stream.standard_normal(3)
        return np.asarray(start + np.cumsum(walk * np.sqrt(dt) * stream.standard_normal((n, 3)), axis=0))

    mount_pitch, mount_yaw = model.mount_sd_rad * mount_rng.standard_normal(2)
    return ImuErrors(
        gyro_bias=bias(gyro_bias_rng, noise.gyro_bias_sd, noise.gyro_bias_walk),
        accel_bias=bias(accel_bias_rng, noise.accel_bias_sd, noise.accel_bias_walk),
        gyro_noise=noise.gyro_white / np.sqrt(dt) * gyro_rng.standard_normal((n, 3)),
        accel_noise=noise.accel_white / np.sqrt(dt) * accel_rng.standard_normal((n, 3)),
        mount_rpy_rad=(0.0, float(mount_pitch), float(mount_yaw)),
    )


def apply_errors(gyro: Array, accel: Array, errors: ImuErrors) -> tuple[Array, Array]:
    """The samples that the IMU delivers for the true ones."""
    R_vs = frames.matrix_from_rpy(*(np.array(angle) for angle in errors.mount_rpy_rad))
    return (
        gyro @ R_vs + errors.gyro_bias + errors.gyro_noise,
        accel @ R_vs + errors.accel_bias + errors.accel_noise,
    )
