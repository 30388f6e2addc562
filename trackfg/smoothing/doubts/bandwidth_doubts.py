"""Waves that a sensor is too slow for are missing in the track, and no residual says so.

A low pass of first order leaves ``1 / sqrt(1 + (f / f_h)^2)`` of an amplitude, which is less by ``(f / f_h)^2 / 2`` of
it where f is small. A wave along the track has the frequency ``v / wavelength``. So a column y that was measured at the
speed v lacks

    (v / (2 pi f_h))^2 y'' / 2.

Filters of 5 to 20 Hz of other orders, filters that run both ways and means over 5 to 41 samples of 200 a second made
errors of 0.4 to 2 times as much (``mainline``, 400 s). Where the power of the shortest waves is less than half, what is
left does not show what is missing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from trackfg.factors.factor_type import FactorType
from trackfg.numerics.arrays import Array
from trackfg.numerics.float_table import columns_of
from trackfg.results.verdict import Doubt, Quantity
from trackfg.sensors.imu_filters.bandwidth import SHORTEST_D1_M, Bandwidths
from trackfg.smoothing.doubts.usual_sigmas import COLUMNS, LEAST_WIDENING, WaveSums
from trackfg.smoothing.reassessment import SolvedRun

_COLUMNS: Mapping[Quantity, str] = {**COLUMNS, "curvature": "curvature_1pm"}

_CURVATURE_BASE_M = 10.0
"""Shorter waves are hardly in a curvature, m: it is the turn over so much by default."""

_FASTER = 0.05
"""Share of rows whose shortest waves are missing from which on the quantity is not to be trusted."""

_FASTEST_MPS = 200
"""Speeds are counted up to this, m/s."""

_HINT = "filter the sensor less, or write rates and forces of its own rate, not means or interpolated ones"


@dataclass(frozen=True)
class ShortWaves:
    """The ``speeds`` (200,) at which a geometry was measured are the number of rows by whole m/s; its ``sums`` (4, 4)
    are the :class:`~trackfg.smoothing.doubts.usual_sigmas.WaveSums` of ``v^2 y''`` of twist, level, alignment, mm/s^2,
    and curvature, 1/m/s^2.
    """

    speeds: Array
    sums: Array

    @classmethod
    def of(cls, geometry: pd.DataFrame, step_m: float) -> ShortWaves:
        """Return that of a geometry table with a row every ``step_m`` of each passage."""
        columns = columns_of(geometry)
        speed = np.abs(columns["speed_mps"])
        speeds = np.bincount(
            np.clip(np.nan_to_num(speed), 0, _FASTEST_MPS - 1).astype(np.int64), minlength=_FASTEST_MPS
        )
        along = np.abs(np.abs(np.diff(columns["chainage_m"])) - step_m) < 0.5 * step_m
        sums = np.zeros((len(_COLUMNS), 4))
        if len(speed) > 2:
            for row, column in zip(sums, _COLUMNS.values(), strict=True):
                bends = speed[1:-1] ** 2 * np.diff(columns[column], 2) / step_m**2
                row[:] = WaveSums.of(bends[along[1:] & along[:-1]], columns[f"{column}_sd"])
        return cls(speeds.astype(np.float64), sums)

    def __add__(self, other: ShortWaves) -> ShortWaves:
        return ShortWaves(self.speeds + other.speeds, self.sums + other.sums)

    def doubts(self, bandwidths: Bandwidths) -> Iterator[Doubt]:
        """Yield doubts of what a sensor of such bandwidths is too slow for: twist and curvature are made of rates, else
        forces."""
        rates, forces = ("gyro", bandwidths.gyro_hz), ("accelerometer", bandwidths.accel_hz)
        made_of = {"twist": rates, "curvature": rates, "level": forces, "alignment": forces}
        speeds = np.arange(_FASTEST_MPS) + 0.5
        for (name, column), row in zip(_COLUMNS.items(), self.sums.tolist(), strict=True):
            sums, (sensor, hz) = WaveSums(*row), made_of[name]
            if hz is None or sums.is_empty:
                continue
            reason = f"the {sensor}'s samples hold little above {hz:.2g} Hz"
            shortest_m = _CURVATURE_BASE_M if name == "curvature" else SHORTEST_D1_M
            slowed = speeds > shortest_m * hz
            if self.speeds[slowed].sum() > _FASTER * self.speeds.sum():
                fastest = speeds[np.flatnonzero(self.speeds)[-1]]
                reason += f": at {fastest:.0f} m/s waves shorter than {fastest / hz:.1f} m are missing"
                yield Doubt((name,), math.inf, reason, _HINT)
                continue
            missing = 0.5 * sums.rms / (2.0 * math.pi * hz) ** 2
            factor = sums.widening(missing)
            if factor >= LEAST_WIDENING:
                unit = "1/m" if column == "curvature_1pm" else "mm"
                yield Doubt((name,), factor, f"{reason}: {missing:.2g} {unit} of {name} are missing", _HINT)


def bandwidth_doubts(run: SolvedRun, geometry: pd.DataFrame, bandwidths: Bandwidths) -> list[Doubt]:
    """Return doubts of the short waves of a sensor that follows the track, but is too slow for them."""
    if geometry.empty or run.problem.family(FactorType.PATH) is None:
        return []
    return list(ShortWaves.of(geometry, run.problem.run.conventions.step_m).doubts(bandwidths))
