"""Errors of a logger: stamps on arrival, a jump of the clock, lost samples in whose place it writes others, forces that
are later than rates.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from trackfg.datasets.effects.samples import Samples
from trackfg.datasets.scenario import Effect
from trackfg.datasets.vehicle.ride import Ride
from trackfg.recording.model import Recording

_LOST = 0.1
"""Share of samples that a bad line loses. Assumed."""


@dataclass(frozen=True)
class DelayedStamps(Effect):
    """Samples stamped on arrival, ``magnitude`` milliseconds late on the average: delays are exponential, in order.

    For the oracle: no delay.
    """

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        imu = recording.imu
        t = imu["t_s"].to_numpy()
        arrival = t + 1e-3 * self.magnitude * rng.standard_exponential(len(t))
        # A sample waits for the one before it and comes 0.1 ms after it: what a serial line takes for a message.
        order = 1e-4 * np.arange(len(t))
        arrival = np.maximum.accumulate(arrival - order) + order
        return recording if self.for_oracle else replace(recording, imu=imu.assign(t_s=arrival))


@dataclass(frozen=True)
class ClockJump(Effect):
    """The IMU's clock jumps ahead by ``magnitude`` seconds, half-way through the run. For the oracle: no jump."""

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        if self.for_oracle:
            return recording
        imu = recording.imu
        t = imu["t_s"].to_numpy()
        late = np.arange(len(t)) >= len(t) // 2
        return replace(recording, imu=imu.assign(t_s=t + self.magnitude * late))


@dataclass(frozen=True)
class FilledHoles(Effect):
    """A tenth of the samples is lost, in holes of ``magnitude`` seconds, and interpolated. For the oracle: holes."""

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        imu = recording.imu
        t = imu["t_s"].to_numpy()
        period_s = self.magnitude / _LOST
        begin = np.arange(t[0], t[-1], period_s) + (period_s - self.magnitude) * rng.random(
            int(np.ptp(t) / period_s) + 1
        )
        hole = np.searchsorted(begin, t, side="right") - 1
        kept = (hole < 0) | (t > begin[hole] + self.magnitude)
        left = imu[kept].reset_index(drop=True)
        if self.for_oracle:
            return replace(recording, imu=left)
        filled = {name: np.interp(t, left["t_s"], left[name]) for name in imu.columns if name != "t_s"}
        return replace(recording, imu=imu.assign(**filled))


@dataclass(frozen=True)
class LateAccelerometer(Effect):
    """The accelerometer's samples are ``magnitude`` milliseconds later than the gyro's. For the oracle: no delay."""

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        if self.for_oracle:
            return recording
        samples = Samples.of(recording)
        force = CubicSpline(samples.t_s, samples.accel)(np.maximum(samples.t_s - 1e-3 * self.magnitude, samples.t_s[0]))
        return replace(samples, accel=force).into(recording)
