"""Grades of inertial sensors: noise and response of two data sheets, and the form for the user's own.

"Data sheet" marks what the front pages of ADIS16480 Rev. G and ADIS16495 Rev. C say. The rest is assumed, because the
front pages do not give it: accelerometer noise (with the vehicle's vibration in it), turn-on biases, bias walks,
scale factors and sensitivity to acceleration after the factory's calibration. The in-run bias stability is a data
sheet's; that a random walk stands for it is assumed. Their numbers are taken to be far finer than the noise: no
quantisation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfg.datasets.sensors.imu_errors import ImuModel, ImuResponse
from trackfg.numerics import units
from trackfg.recording.description import ImuNoise

_DEG = np.pi / 180.0
_G = units.STANDARD_GRAVITY

_ORTHOGONAL_TO_0_05_DEG = 0.05 * _DEG / np.sqrt(2.0)
"""An angle between two axes is off by the sum of two misalignments; the data sheets' figure is taken as one sigma."""


@dataclass(frozen=True)
class ImuGrade:
    """A type of sensor. Where it sits is :class:`~trackfg.datasets.sensors.imu_errors.ImuModel`'s."""

    noise: ImuNoise
    response: ImuResponse

    def imu(self, rate_hz: float) -> ImuModel:
        """Return a sensor of this grade at the reference point."""
        return ImuModel(rate_hz=rate_hz, noise=self.noise, response=self.response)


ADIS16480 = ImuGrade(
    noise=ImuNoise(
        gyro_white=8.73e-5,  # data sheet: 0.3 deg/sqrt(h)
        accel_white=1.5e-3,  # assumed
        gyro_bias_walk=1.5e-6,  # reaches the data sheet's in-run 6 deg/h in some 400 s
        accel_bias_walk=2e-5,  # assumed
        gyro_bias_sd=3.5e-3,  # assumed
        accel_bias_sd=0.05,  # assumed
    ),
    response=ImuResponse(
        gyro_scale_sd=2e-3,  # assumed
        accel_scale_sd=2e-3,  # assumed
        gyro_misalignment_sd_rad=_ORTHOGONAL_TO_0_05_DEG,  # data sheet: +-0.05 deg
        accel_misalignment_sd_rad=_ORTHOGONAL_TO_0_05_DEG,  # assumed to be the gyro's
        g_sensitivity_sd=0.01 * _DEG / _G,  # assumed: 0.01 deg/s per g
        gyro_range_radps=450.0 * _DEG,  # data sheet
        accel_range_mps2=10.0 * _G,  # data sheet
    ),
)

ADIS16495_1 = ImuGrade(
    noise=ImuNoise(
        gyro_white=2.62e-5,  # data sheet: 0.09 deg/sqrt(h)
        accel_white=1e-3,  # assumed
        gyro_bias_walk=2e-7,  # reaches the data sheet's in-run 0.8 deg/h in some 400 s
        accel_bias_walk=2e-6,  # assumed
        gyro_bias_sd=1e-3,  # assumed
        accel_bias_sd=0.02,  # assumed
    ),
    response=ImuResponse(
        gyro_scale_sd=1e-3,  # assumed
        accel_scale_sd=1e-3,  # assumed
        gyro_misalignment_sd_rad=_ORTHOGONAL_TO_0_05_DEG,  # data sheet: +-0.05 deg
        accel_misalignment_sd_rad=_ORTHOGONAL_TO_0_05_DEG,  # assumed to be the gyro's
        g_sensitivity_sd=0.005 * _DEG / _G,  # assumed: 0.005 deg/s per g
        gyro_range_radps=125.0 * _DEG,  # data sheet: the smallest of three ranges, taken to be the -1's
        accel_range_mps2=8.0 * _G,  # data sheet
    ),
)
