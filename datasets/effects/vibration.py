"""Vibration shakes an IMU: that of the wheels on the rails, of an engine, and shocks at rail joints, as it is sampled.

Vibration is far faster than the samples, so it is made at several times their rate and then sampled: by the value at
the middle of each interval (``instant``: what lies above half the sampling rate is folded down, *aliased*), by the mean
over it (``average``), or after a low pass (``filtered``). It has no mean: what it moves comes back.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import scipy  # its signal, which takes 0.5 s, when it is first used

from trackfg.datasets.effects.samples import Samples, described
from trackfg.datasets.scenario import Effect
from trackfg.datasets.vehicle.ride import Ride
from trackfg.numerics import units
from trackfg.numerics.arrays import Array
from trackfg.recording.model import Recording

Sampling = Literal["instant", "average", "filtered"]

AT_MPS = 20.0
"""The speed at which a vibration has its magnitude, m/s (72 km/h); its rms is proportional to the speed. Assumed."""


@dataclass(frozen=True)
class Place:
    """A place of an IMU on a vehicle: the band of the vibration, Hz, what it is along x, y and z of the vertical one,
    and the arm, m: what moves up and down at one end of it and not at the other turns.
    """

    band_hz: tuple[float, float]
    axes: tuple[float, float, float]
    arm_m: float


PLACES = {
    # Bands and rms along x, y, z: IEC 61373, functional random vibration, categories 1 B, 2 and 3 (0.70, 0.45, 1.01;
    # 2.5, 4.7, 5.4; 17, 34, 38 m/s^2). Arms: half the distance of the bogies, of the wheelsets, of the rails.
    "body": Place((5.0, 150.0), (0.69, 0.45, 1.0), 9.0),
    "bogie": Place((5.0, 250.0), (0.46, 0.87, 1.0), 1.25),
    "axle-box": Place((10.0, 500.0), (0.45, 0.89, 1.0), 0.75),
}

PlaceName = Literal["body", "bogie", "axle-box"]

_PER_HIGHEST = 2.5
"""Rate at which vibration is made over its highest frequency: more than the 2 of Nyquist, for the filter's slope."""
_PASSED = 0.4
"""Corner of the low pass before sampling, over the sampling rate: below the half that folds."""
_HARMONICS = 4
"""How many multiples of the engine's frequency shake the vehicle. Assumed."""
_ENGINE_HZ = (10.0, 30.0)
"""Firing frequency of an idling engine: 600-900 revolutions a minute, 2 to 4 firings in each (2-3 cylinder pairs)."""
_HUNTING = 0.02
"""How far an idling engine's speed wanders, as a share, and over how long, s: its governor's limit cycle. Assumed."""
_HUNTING_S = 2.0
_ENGINE_ARM_M = 1.0
"""Half the width of a vehicle, m: an engine rocks it about its long axis."""


@dataclass(frozen=True)
class Vibration(Effect):
    """Random vibration of the running gear, flat within the band of the place.

    ``magnitude``: rms of the vertical acceleration at :data:`AT_MPS`, m/s^2. For the oracle: white noise of the rms of
    the vibration is declared besides.
    """

    place: PlaceName = "body"
    sampling: Sampling = "average"

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        samples = Samples.of(recording)
        gyro, accel = self.shaken(samples, ride, rng)
        shaken = samples.added(gyro, accel).into(recording)
        return _noise_declared(shaken, gyro, accel) if self.for_oracle else shaken

    def level(self, ride: Ride, t: Array) -> Array:
        """Return the rms of the vertical acceleration at times (n,), m/s^2."""
        return np.asarray(self.magnitude * np.abs(ride.motion.speed(t)) / AT_MPS)

    def shaken(self, samples: Samples, ride: Ride, rng: np.random.Generator) -> tuple[Array, Array]:
        """Return what the vibration adds to the samples, rad/s and m/s^2, (n, 3) each."""
        place, level = PLACES[self.place], self.level(ride, samples.t_s)[:, None]
        interval, n = samples.interval_s, len(samples.t_s)
        parts = max(1, int(np.ceil(_PER_HIGHEST * place.band_hz[1] * interval)))
        rate = parts / interval
        low, high = place.band_hz
        band = scipy.signal.butter(2, (low, min(high, 0.45 * rate)), "bandpass", fs=rate, output="sos")
        # The sum of the squares of its impulse response is what the filter leaves of white noise's variance.
        loss = np.sqrt(np.sum(scipy.signal.sosfilt(band, np.eye(1, round(20.0 * rate / low))[0]) ** 2))
        decay = np.exp(-2.0 * np.pi * low / rate)

        def sampled(fine: Array) -> Array:
            return _sampled(fine, parts, self.sampling)

        def noise(stream: np.random.Generator) -> Array:
            return np.asarray(scipy.signal.sosfilt(band, stream.standard_normal(n * parts)) / loss)

        streams = rng.spawn(6)
        accel = np.column_stack([sampled(noise(stream)) for stream in streams[:3]]) * np.array(place.axes)
        turning = [scipy.signal.lfilter([1.0 / rate], [1.0, -decay], noise(stream)) for stream in streams[3:]]
        gyro = np.column_stack([sampled(rate_of_turn) for rate_of_turn in turning]) / place.arm_m
        return gyro * level, accel * level


@dataclass(frozen=True)
class Idling(Effect):
    """An engine that runs all the time, at rest too: harmonics of a frequency that wanders a little.

    ``magnitude``: rms of the vertical acceleration, m/s^2. Sampled without a filter.
    """

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        samples = Samples.of(recording)
        hunt_rng, shape_rng = rng.spawn(2)
        kept = np.exp(-samples.interval_s / _HUNTING_S)
        driven = hunt_rng.standard_normal(len(samples.t_s)) * np.sqrt(1.0 - kept * kept)
        hunting = 1.0 + _HUNTING * scipy.signal.lfilter([1.0], [1.0, -kept], driven)
        frequency = shape_rng.uniform(*_ENGINE_HZ)
        turns = 2.0 * np.pi * np.cumsum(frequency * hunting) * samples.interval_s
        order = np.arange(1, _HARMONICS + 1)
        swings = np.exp(1j * turns[:, None] * order)
        weight = shape_rng.uniform(0.5, 1.0, (6, _HARMONICS)) / order
        weight /= np.sqrt(0.5 * np.sum(weight**2, axis=1, keepdims=True))
        phased = weight * np.exp(2j * np.pi * shape_rng.random((6, _HARMONICS)))
        accel = self.magnitude * (swings @ phased[:3].T).real * np.array(PLACES["body"].axes)
        turning = phased[3:] / (2j * np.pi * frequency * order * _ENGINE_ARM_M)
        gyro = self.magnitude * (swings @ turning.T).real
        return samples.added(gyro, accel).into(recording)


@dataclass(frozen=True)
class Rectification(Effect):
    """An accelerometer whose bias grows with the power of the vibration along each axis.

    ``magnitude``: bias over power, m/s^2 per (m/s^2)^2, the sign of each axis drawn. For the oracle: the vibration
    without the bias, declared as white noise.
    """

    vibration: Vibration = field(default_factory=lambda: Vibration(5.0, place="bogie", sampling="filtered"))

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        samples = Samples.of(recording)
        sign_rng, shaking_rng = rng.spawn(2)
        gyro, accel = self.vibration.shaken(samples, ride, shaking_rng)
        sign = sign_rng.choice([-1.0, 1.0], 3)
        if self.for_oracle:
            return _noise_declared(samples.added(gyro, accel).into(recording), gyro, accel)
        power = (self.vibration.level(ride, samples.t_s)[:, None] * np.array(PLACES[self.vibration.place].axes)) ** 2
        return samples.added(gyro, accel + self.magnitude * sign * power).into(recording)


JOINT_M = 25.0
"""Length of rails between joints, m."""
RANGE_MPS2 = 4.0 * units.STANDARD_GRAVITY
"""Range of the accelerometer that shocks overdrive, m/s^2."""
_RINGING_HZ, _RINGING_S = 60.0, 0.015
"""A shock rings at so many Hz and decays within so many seconds: a bogie frame on its primary springs. Assumed."""
_SHOCK_AXES = np.array([0.3, 0.5, 1.0])
"""Of a shock's vertical peak, what comes along x, y and z. Assumed."""
_PARTS = 10
"""Parts of an interval in which a shock is resolved: 2 kHz at 200 samples a second."""
_SHOCK_S = 8.0 * _RINGING_S
"""When nothing is left of a shock (3e-4)."""


@dataclass(frozen=True)
class Saturation(Effect):
    """Shocks at rail joints beyond the range of an accelerometer that averages what it has clipped.

    ``magnitude``: the largest peak at :data:`AT_MPS`, m/s^2; a joint's own is 0.5 to 1 times that. Gravity takes part
    of the range, so that clipping leaves a mean. For the oracle: no clipping.
    """

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        samples = Samples.of(recording)
        n, step = len(samples.t_s), samples.interval_s / _PARTS
        places = np.arange(0.0, ride.line.length_m, JOINT_M)
        size = rng.uniform(0.5, 1.0, len(places))
        times, which = ride.motion.times_at(places)
        peak = self.magnitude * size[which] * np.abs(ride.motion.speed(times)) / AT_MPS
        start = np.ceil((times - samples.t_s[0]) / step + 0.5 * _PARTS).astype(int)
        within = (start >= 0) & (start < n * _PARTS)
        impulses = np.zeros(n * _PARTS)
        np.add.at(impulses, start[within], peak[within])
        t = step * np.arange(round(_SHOCK_S / step))
        w = 2.0 * np.pi * _RINGING_HZ
        # The steps of a decaying sine: afterwards the frame has the speed that it had before.
        swing = np.exp(-t / _RINGING_S) * np.sin(w * t)
        ringing = np.diff(swing, append=0.0) / (w * step)
        shock = np.convolve(impulses, ringing)[: n * _PARTS]
        force = np.repeat(samples.accel, _PARTS, axis=0) + shock[:, None] * _SHOCK_AXES
        if not self.for_oracle:
            force = np.clip(force, -RANGE_MPS2, RANGE_MPS2)
        accel = force.reshape(n, _PARTS, 3).mean(axis=1)
        return samples.added(accel=accel - samples.accel).into(recording)


def _sampled(fine: Array, parts: int, sampling: Sampling) -> Array:
    """Return samples (n,) of a signal (n parts,)."""
    if sampling == "average":
        return np.asarray(fine.reshape(-1, parts).mean(axis=1))
    if sampling == "filtered":
        fine = scipy.signal.sosfiltfilt(scipy.signal.butter(2, 2.0 * _PASSED / parts, output="sos"), fine)
    return np.asarray(fine[parts // 2 :: parts])


def _noise_declared(recording: Recording, gyro: Array, accel: Array) -> Recording:
    """Return the recording that declares white noise of the rms of these errors besides what it declares already."""
    noise = recording.description.imu.noise
    interval = Samples.of(recording).interval_s
    white = {
        "gyro_white": float(np.hypot(noise.gyro_white, np.sqrt(interval * np.mean(gyro**2)))),
        "accel_white": float(np.hypot(noise.accel_white, np.sqrt(interval * np.mean(accel**2)))),
    }
    return described(recording, noise=noise.model_copy(update=white))
