"""IMUs worse than declared: more white noise, drift while the sensor warms up, a low-cost grade not declared, a filter
that passes less than the rate of the samples could hold.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy  # its signal, which takes 0.5 s, when it is first used

from trackfg.datasets.effects.samples import Samples, described
from trackfg.datasets.scenario import Effect, Scenario
from trackfg.datasets.sensors.imu_errors import ImuResponse
from trackfg.datasets.vehicle.ride import Ride
from trackfg.numerics import units
from trackfg.recording.description import ImuNoise
from trackfg.recording.model import Recording

_DEG = np.pi / 180.0


@dataclass(frozen=True)
class Noise(Effect):
    """White noise of ``magnitude`` times the declared density. Below 1 the sensor is as it is, and more is declared."""

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        samples, declared = Samples.of(recording), recording.description.imu.noise
        if self.magnitude < 1.0:
            return (
                recording
                if self.for_oracle
                else described(recording, noise=_with_white(declared, 1.0 / self.magnitude))
            )
        more = np.sqrt((self.magnitude**2 - 1.0) / samples.interval_s)
        gyro, accel = (more * stream.standard_normal(samples.gyro.shape) for stream in rng.spawn(2))
        noisy = samples.added(declared.gyro_white * gyro, declared.accel_white * accel).into(recording)
        return described(noisy, noise=_with_white(declared, self.magnitude)) if self.for_oracle else noisy


def _with_white(noise: ImuNoise, times: float) -> ImuNoise:
    """Return the same with the densities of white noise so many times as large."""
    return noise.model_copy(update={name: times * getattr(noise, name) for name in ("gyro_white", "accel_white")})


WARMING_S = 300.0
"""Time constant of an instrument that warms up, s: an electronics box of a kilogram. Assumed."""
# ADIS16495, over 125 K at 1 sigma: gyro bias 0.1 deg/s, accelerometer bias 2 mg, scale factors 0.1 %.
GYRO_PER_K = 0.1 * _DEG / 125.0
ACCEL_PER_K = 2e-3 * units.STANDARD_GRAVITY / 125.0
SCALE_PER_K = 1e-3 / 125.0


@dataclass(frozen=True)
class Warming(Effect):
    """An IMU that warms up by ``magnitude`` kelvin: biases and scale factors drift, coefficients drawn per axis."""

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        samples = Samples.of(recording)
        warmer = self.magnitude * -np.expm1(-(samples.t_s - samples.t_s[0]) / WARMING_S)[:, None]
        bias, scale = rng.standard_normal((2, 2, 3))
        if self.for_oracle:
            return recording
        return samples.added(
            warmer * (GYRO_PER_K * bias[0] + SCALE_PER_K * scale[0] * samples.gyro),
            warmer * (ACCEL_PER_K * bias[1] + SCALE_PER_K * scale[1] * samples.accel),
        ).into(recording)


LOW_COST = ImuNoise(
    gyro_white=0.005 * _DEG,  # MPU-6050: 0.005 deg/s/sqrt(Hz)
    accel_white=4e-4 * units.STANDARD_GRAVITY,  # MPU-6050: 400 ug/sqrt(Hz)
    gyro_bias_walk=1e-5,  # reaches 10 deg/h, a usual in-run stability of this class, within half a minute
    accel_bias_walk=1e-4,  # reaches 0.2 mg within half a minute
    gyro_bias_sd=0.3 * _DEG,
    accel_bias_sd=0.05 * units.STANDARD_GRAVITY,  # MPU-6050: zero-g output 50 mg
)
"""A sensor of a few euros, by the data sheet of the MPU-6050 and, where it is silent, its class."""
LOW_COST_RESPONSE = ImuResponse(
    gyro_scale_sd=0.01,  # MPU-6050: 3 % at most
    accel_scale_sd=0.01,  # MPU-6050: 3 % initial tolerance
    gyro_misalignment_sd_rad=0.01,  # MPU-6050: cross-axis sensitivity 2 % at most
    accel_misalignment_sd_rad=0.01,  # the same
    g_sensitivity_sd=0.1 * _DEG / units.STANDARD_GRAVITY,  # MPU-6050: 0.1 deg/s/g
)


@dataclass(frozen=True)
class LowCost(Effect):
    """A sensor of a few euros with a gyro bias of ``magnitude`` deg/s (1 sigma), whose noise is not declared.

    For the oracle: noise and sigmas of the biases are declared.
    """

    def planned(self, plan: Scenario) -> Scenario:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        noise = LOW_COST.model_copy(update={"gyro_bias_sd": self.magnitude * _DEG})
        return replace(plan, imu=replace(plan.imu, noise=noise, response=LOW_COST_RESPONSE))

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        return recording if self.for_oracle else described(recording, noise=ImuNoise())


@dataclass(frozen=True)
class Slow(Effect):
    """Samples that passed a filter of second order with half of the power left at ``magnitude`` Hz, without delay.

    For the oracle: no filter.
    """

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        if self.for_oracle:
            return recording
        samples = Samples.of(recording)
        corner_hz = self.magnitude / _BOTH_WAYS_HALF
        low_pass = scipy.signal.butter(1, corner_hz, fs=1.0 / samples.interval_s, output="sos")
        gyro, accel = (scipy.signal.sosfiltfilt(low_pass, of, axis=0) for of in (samples.gyro, samples.accel))
        return replace(samples, gyro=gyro, accel=accel).into(recording)


_BOTH_WAYS_HALF = float(np.sqrt(np.sqrt(2.0) - 1.0))
"""Where a filter of first order that runs both ways passes half of the power, over its corner: (1 + x^2)^2 = 2."""
