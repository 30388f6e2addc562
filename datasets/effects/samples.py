"""The samples of an IMU as arrays, and the description of the IMU."""

from __future__ import annotations

from dataclasses import dataclass, replace

from trackfg.datasets import tables
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import median_interval
from trackfg.recording.description import Imu
from trackfg.recording.model import Recording


@dataclass(frozen=True)
class Samples:
    """Centres of the intervals (n,), angular rates and specific forces (n, 3), SI, FLU."""

    t_s: Array
    gyro: Array
    accel: Array

    @classmethod
    def of(cls, recording: Recording) -> Samples:
        """Return the samples of a recording."""
        return cls(recording.imu["t_s"].to_numpy(), recording.gyro, recording.accel)

    @property
    def interval_s(self) -> float:
        """Return the median time from one sample to the next."""
        return median_interval(self.t_s)

    def added(self, gyro: Array | float = 0.0, accel: Array | float = 0.0) -> Samples:
        """Return the samples with errors added, (n, 3) or what broadcasts to it."""
        return replace(self, gyro=self.gyro + gyro, accel=self.accel + accel)

    def turned(self, R_vs: Array) -> Samples:
        """Return the samples of a sensor turned by ``R_vs`` (3, 3), sensor to vehicle."""
        return replace(self, gyro=self.gyro @ R_vs, accel=self.accel @ R_vs)

    def into(self, recording: Recording) -> Recording:
        """Return the recording with these samples."""
        return replace(recording, imu=tables.imu_table(self.t_s, self.gyro, self.accel))


def described(recording: Recording, **changes: object) -> Recording:
    """Return the recording with these changes to the description of its IMU."""
    imu: Imu = recording.description.imu.model_copy(update=changes)
    return replace(recording, description=recording.description.model_copy(update={"imu": imu}))
