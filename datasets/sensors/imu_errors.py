"""The errors of an IMU are added to the truth.

True angular rate ``w`` and specific force ``f`` in vehicle axes become samples in this order:

1. mounting, a fixed rotation of the sensor in the vehicle ``R_vs = Rz(yaw) Ry(pitch) Rx(roll)``: ``w_s = R_vs^T w``,
   ``f_s = R_vs^T f``;
2. scale factor and misalignment, a fixed matrix per triad: ``M = I + [m_ij]``, diagonal the scale factors, off the
   diagonal what axis i senses of axis j (so two axes are off the right angle by ``m_ij + m_ji``);
3. the gyro's sensitivity to specific force: ``G f_s``;
4. a bias: an initial one and a random walk, ``b_{k+1} = b_k + walk sqrt(dt) n``;
5. white noise of standard deviation ``density / sqrt(dt)``;
6. saturation at plus or minus the range;
7. quantisation to the nearest multiple of the resolution:

    gyro  = quantised(clipped(M_g w_s + G f_s + b_g + n_g)),
    accel = quantised(clipped(M_a f_s + b_a + n_a)).

What is fixed is drawn once per run, or once for the runs of a vehicle, every element on its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfg.numerics import rotations
from trackfg.numerics.arrays import Array
from trackfg.recording.description import ImuNoise, Vector3

_NEARLY_NONE = 1e-7
"""What is declared of an error that is not there: sigmas are positive."""


@dataclass(frozen=True)
class ImuResponse:
    """The response of the output to the input, by default perfect.

    Standard deviations of the scale factors, of each misalignment (rad) and of each element of the gyro's sensitivity
    to specific force (rad/s per m/s^2); ranges, and resolutions (0: as fine as a double), of rad/s and m/s^2.
    """

    gyro_scale_sd: float = 0.0
    accel_scale_sd: float = 0.0
    gyro_misalignment_sd_rad: float = 0.0
    accel_misalignment_sd_rad: float = 0.0
    g_sensitivity_sd: float = 0.0
    gyro_range_radps: float = np.inf
    accel_range_mps2: float = np.inf
    gyro_resolution_radps: float = 0.0
    accel_resolution_mps2: float = 0.0


@dataclass(frozen=True)
class ImuModel:
    """An IMU in the vehicle: noise and response of its grade, and how it is mounted.

    ``mount_sd_rad``: standard deviation of the residual mounting pitch and yaw; ``mount_roll_sd_rad``: of its roll.
    """

    rate_hz: float
    noise: ImuNoise
    lever_arm_m: Vector3 = (0.0, 0.0, 0.0)
    mount_sd_rad: float = 0.0
    mount_roll_sd_rad: float = 0.0
    response: ImuResponse = ImuResponse()

    @property
    def declared_noise(self) -> ImuNoise:
        """The noise as a data sheet would declare it: densities, and how well scale factors and axes are calibrated."""
        response = self.response
        calibration = {
            "gyro_scale_sd": response.gyro_scale_sd,
            "accel_scale_sd": response.accel_scale_sd,
            "misalignment_sd_rad": max(response.gyro_misalignment_sd_rad, response.accel_misalignment_sd_rad),
            "g_sensitivity_sd": response.g_sensitivity_sd,
        }
        sds = {name: max(float(sd), _NEARLY_NONE) for name, sd in calibration.items()}
        return self.noise.model_copy(update=sds)


@dataclass(frozen=True)
class ImuErrors:
    """The errors of an IMU in one run.

    White noise and bias of each sample, (n, 3) each; mounting; ``M_g``, ``M_a`` and ``G``, (3, 3) each; and the
    response that they were drawn from, for range and resolution.
    """

    gyro_noise: Array
    accel_noise: Array
    gyro_bias: Array
    accel_bias: Array
    mount_rpy_rad: Vector3
    gyro_matrix: Array
    accel_matrix: Array
    g_sensitivity: Array
    response: ImuResponse


def draw_errors(
    model: ImuModel, edges: Array, rng: np.random.Generator, kept_rng: np.random.Generator | None = None
) -> ImuErrors:
    """Return errors for the samples between ``edges``.

    ``kept_rng`` is the stream of what the IMU keeps from run to run: mounting, ``M_g``, ``M_a`` and ``G``. Without one
    they are the run's own.
    """
    noise, response, n, dt = model.noise, model.response, len(edges) - 1, 1.0 / model.rate_hz
    # One stream each: a longer run begins as a shorter one does, and no error changes another one.
    mount_rng, gyro_rng, accel_rng, gyro_bias_rng, accel_bias_rng = rng.spawn(5)
    gyro_matrix_rng, accel_matrix_rng, g_sensitivity_rng = rng.spawn(3)
    if kept_rng is not None:
        mount_rng, gyro_matrix_rng, accel_matrix_rng, g_sensitivity_rng = kept_rng.spawn(4)

    def bias(stream: np.random.Generator, initial_sd: float, walk: float) -> Array:
        start = initial_sd * stream.standard_normal(3)
        return np.asarray(start + np.cumsum(walk * np.sqrt(dt) * stream.standard_normal((n, 3)), axis=0))

    mount_pitch, mount_yaw = model.mount_sd_rad * mount_rng.standard_normal(2)
    mount_roll = model.mount_roll_sd_rad * mount_rng.standard_normal()
    return ImuErrors(
        gyro_bias=bias(gyro_bias_rng, noise.gyro_bias_sd, noise.gyro_bias_walk),
        accel_bias=bias(accel_bias_rng, noise.accel_bias_sd, noise.accel_bias_walk),
        gyro_noise=noise.gyro_white / np.sqrt(dt) * gyro_rng.standard_normal((n, 3)),
        accel_noise=noise.accel_white / np.sqrt(dt) * accel_rng.standard_normal((n, 3)),
        mount_rpy_rad=(float(mount_roll), float(mount_pitch), float(mount_yaw)),
        gyro_matrix=_axes_matrix(response.gyro_scale_sd, response.gyro_misalignment_sd_rad, gyro_matrix_rng),
        accel_matrix=_axes_matrix(response.accel_scale_sd, response.accel_misalignment_sd_rad, accel_matrix_rng),
        g_sensitivity=response.g_sensitivity_sd * g_sensitivity_rng.standard_normal((3, 3)),
        response=response,
    )


def apply_errors(gyro: Array, accel: Array, errors: ImuErrors) -> tuple[Array, Array]:
    """Return the samples (n, 3) that the IMU delivers for the true ones (n, 3)."""
    R_vs = rotations.matrix_from_rpy(*(np.array(angle) for angle in errors.mount_rpy_rad))
    felt_gyro = gyro @ (R_vs @ errors.gyro_matrix.T) + errors.gyro_bias + errors.gyro_noise
    if errors.g_sensitivity.any():
        felt_gyro += accel @ (R_vs @ errors.g_sensitivity.T)
    felt_accel = accel @ (R_vs @ errors.accel_matrix.T) + errors.accel_bias + errors.accel_noise
    response = errors.response
    return (
        _digitised(felt_gyro, response.gyro_range_radps, response.gyro_resolution_radps),
        _digitised(felt_accel, response.accel_range_mps2, response.accel_resolution_mps2),
    )


def _axes_matrix(scale_sd: float, misalignment_sd: float, rng: np.random.Generator) -> Array:
    spread = np.where(np.eye(3) > 0, scale_sd, misalignment_sd)
    return np.asarray(np.eye(3) + spread * rng.standard_normal((3, 3)))


def _digitised(x: Array, largest: float, resolution: float) -> Array:
    if np.isfinite(largest):
        x = np.clip(x, -largest, largest)
    return x if resolution == 0.0 else np.rint(x / resolution) * resolution
