"""The noise floor of a record gives the white noise between times, as its samples and rests show it, or as declared."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.kernels import compiled_kernels, kernel_argument
from trackfg.sensors.imu_intervals import Intervals, interpolate_columns
from trackfg.sensors.imu_noise.noise_at_rest import NoiseAtRest, RestNoise
from trackfg.sensors.imu_noise.sample_blocks import NOISE_LIMITS, SampleBlocks, block_length
from trackfg.sensors.imu_noise.white_noise import WhiteNoise

CLEARLY = 2.0
"""Of the declared density squared: of true ones the floor is further up in less than 0.1 % of blocks of 64 samples."""


@dataclass(frozen=True)
class NoiseFloor:
    """The floor of spectra is a density squared, ``seen`` (b, 6), gyro first, between times ``knots`` (b + 1,), s.

    At times ``lost_t`` (h,), s, samples hide a turn (rad) or a change of velocity (m/s) of about ``lost`` (h, 6), and
    at ``shock_t`` (k,), s, they show a change ``shock`` (k, 6) that was none. All times are in order. ``at_rest``: what
    rests show besides.
    """

    knots: Array
    seen: Array
    lost_t: Array
    lost: Array
    shock_t: Array
    shock: Array
    at_rest: NoiseAtRest = field(default_factory=NoiseAtRest)

    @classmethod
    def of(cls, data: Intervals) -> NoiseFloor:
        """Look at all samples of a record; one shorter than a block is not judged. Each rate has a floor of its own."""
        if len(data.stretches) > 1:
            return cls._joined([cls.of(data.take(rows)) for rows in data.stretches])
        length = block_length(data)
        if not length:
            return cls.unknown(data)
        blocks = SampleBlocks.of(data, length)
        if compiled_kernels():
            return cls(blocks.knots, *blocks.by_kernel())
        return cls(blocks.knots, np.maximum(blocks.floor(), blocks.rounding()), *blocks.hidden(), *blocks.shocks())

    @classmethod
    def _joined(cls, parts: list[NoiseFloor]) -> NoiseFloor:
        """Return that of records of which each begins where the one before ends."""
        later = [part.knots[1:] for part in parts[1:]]
        knots = np.concatenate([parts[0].knots, *later])
        seen, lost_t, lost, shock_t, shock = (
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("seen", "lost_t", "lost", "shock_t", "shock")
        )
        return cls(knots, seen, lost_t, lost, shock_t, shock)

    @classmethod
    def unknown(cls, data: Intervals) -> NoiseFloor:
        """Return a floor of a record that is not judged."""
        nowhere = np.zeros(0), np.zeros((0, 6))
        return cls(data.edges[[0, -1]], np.zeros((1, 6)), *nowhere, *nowhere)

    def with_rests(self, data: Intervals, rests: Array) -> NoiseFloor:
        """Return the same with what ``rests`` (r, 2), s, show besides."""
        return replace(self, at_rest=RestNoise.of(data, self.knots, self.seen, rests).shown())

    def between(self, t: Array, gyro: float, accel: float) -> WhiteNoise:
        """Return the white noise between times ``t`` (m + 1,), s: as seen, at least as declared where rests do not show
        less.
        """
        assumed, seen, span = self.at_rest.assumed(gyro, accel), self.seen + self.at_rest.excess, np.diff(t)[:, None]
        if compiled_kernels():
            from trackfg.numerics import compiled

            t, knots, level = map(kernel_argument, (t, self.knots, seen))
            lost_t, lost, shock_t, shock = map(kernel_argument, (self.lost_t, self.lost, self.shock_t, self.shock))
            variance = np.empty((len(span), 6))
            compiled.white_noise(t, knots, level, assumed, CLEARLY, lost_t, lost, shock_t, shock, variance)
            return WhiteNoise.of_variance(variance)
        white = np.where(seen > CLEARLY * assumed, seen, assumed)
        total = np.concatenate([np.zeros((1, 6)), np.cumsum(white * np.diff(self.knots)[:, None], axis=0)])
        lost, shocks = (_summed(t, *parts) for parts in ((self.lost_t, self.lost), (self.shock_t, self.shock)))
        return WhiteNoise.of_variance(
            np.diff(interpolate_columns(t, self.knots, total), axis=0) / span + (lost**2 + shocks**2) / span
        )


def noise_seen(data: Intervals, t: Array, gyro: float, accel: float, at_rest: NoiseAtRest) -> WhiteNoise:
    """Return the white noise between times ``t`` (m + 1,), s, of a record of these samples, and of rests before it
    (:meth:`NoiseFloor.between`).
    """
    if not compiled_kernels() or len(data.stretches) > 1:
        return replace(NoiseFloor.of(data), at_rest=at_rest).between(t, gyro, accel)
    from trackfg.numerics import compiled

    variance = np.empty((len(t) - 1, 6))
    edges, rates, forces, times = map(kernel_argument, (data.edges, data.gyro, data.accel, t))
    compiled.noise_seen(
        *(edges, rates, forces, np.ascontiguousarray(data.bridged), block_length(data), data.usual_duration),
        *(NOISE_LIMITS, at_rest.assumed(gyro, accel), at_rest.excess, CLEARLY, times, variance),
    )
    return WhiteNoise.of_variance(variance)


def _summed(edges: Array, t: Array, values: Array) -> Array:
    """Return the sums of ``values`` (k, 6) at ``t`` (k,) between ``edges`` (m + 1,). Shape (m, 6)."""
    first = np.searchsorted(edges, t, side="right") - 1
    inside = (first >= 0) & (first < len(edges) - 1)
    sums = np.zeros((len(edges) - 1, 6))
    np.add.at(sums, first[inside], values[inside])
    return sums
