"""White noise of inertial samples has a density on each axis of the body, interval by interval."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.key_figures import Outlined


@dataclass(frozen=True, repr=False)
class WhiteNoise(Outlined):
    """White noise of m intervals has densities ``gyro`` (m, 3), rad/s/sqrt(Hz), and ``accel`` (m, 3), m/s^2/sqrt(Hz).

    They are along the body's axes.
    """

    gyro: Array
    accel: Array

    @classmethod
    def alike(cls, gyro: float, accel: float, count: int) -> WhiteNoise:
        """Return the same noise on all axes of ``count`` intervals."""
        return cls(np.full((count, 3), gyro), np.full((count, 3), accel))

    def __len__(self) -> int:
        return len(self.gyro)

    def over_holes(self, bridged: np.ndarray, gyro: float, accel: float) -> WhiteNoise:
        """Return the noise with these densities in the intervals ``bridged`` (m,), of which there are no samples."""
        if not bridged.any():
            return self
        rows = bridged[:, None]
        return WhiteNoise(np.where(rows, gyro, self.gyro), np.where(rows, accel, self.accel))

    @property
    def variance(self) -> Array:
        """Squares of the densities, gyro first, shape (m, 6)."""
        return np.concatenate([self.gyro, self.accel], axis=1) ** 2

    @classmethod
    def of_variance(cls, variance: Array) -> WhiteNoise:
        """Return the noise of these squares of densities (m, 6)."""
        density = np.sqrt(variance)
        return cls(density[:, :3], density[:, 3:])
