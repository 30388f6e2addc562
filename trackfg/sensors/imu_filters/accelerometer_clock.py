"""The clock of the accelerometer against the gyro's: filters of their own delay both by some milliseconds.

A sensor that follows the track moves where it points. At the speed v, with the body rate w, and l from the point that
follows the track, it measures upwards

    f_z = -v w_y - l_x w_y' + l_y w_x' + gravity.

Gravity is slow. Without it, and band-passed like all else, the force as it is stamped is that sum plus ``T`` times the
derivative of its first term, where T is what has to be added to the stamps. Least squares estimate T and l together.
A lever arm l_x has the effect of a delay l_x / v, so that both are separable where the speed varies. The fit is
repeated with the samples moved by T until T converges. The sigma is that of errors which are correlated within blocks
(Huber 1967, the sandwich; blocks are its clusters). It leaves out what the gyro's noise in ``w_y'`` does: it makes l
too small and moves T with it, by 0.4 ms for 1.5 m and 1e-4 rad/s per sqrt(Hz).

What is not in the equation has phases of its own, springs above all. So T is only taken where the equation explains
nearly all of the force.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.ndimage import gaussian_filter1d, shift

from trackfg.numerics.arrays import Array
from trackfg.recording.model import Recording
from trackfg.sensors.averages import Motion, averaged, band_passed
from trackfg.sensors.imu_filters.block_fit import FEWEST_BLOCKS, LEAST_EXPLAINED, block_fit
from trackfg.sensors.tach import with_sense

STEP_S = 0.02
"""Step of the averages, s: they hold what is in the band without loss."""

_SHORT_S, _LONG_S = 0.05, 0.5
"""Standard deviations of the two averages between which the band lies, s: 0.3 to 3 Hz. There a train's sensor sees the
waves of the track, longer than any play of wheels and shorter than a gradient."""

_END_S = 0.5
"""So much is left out at either end, s: the filter pads signals by reflection, which reverses a derivative's sign."""

_SPEED_S = 0.5
"""Standard deviation of the speed's average, s: pulses are no motion."""

BLOCK_S = 10.0
"""Length of a block, s: far longer than what the band remembers."""

SIGNALS = 5
"""So many signals have products: the four terms of the equation, with the gain of the first one, both components of l
and T as factors, and the force."""

ENOUGH_S = 600.0
"""So long a time suffices, s: filters do not change."""

STARTS_S = (-0.09, -0.06, -0.03, 0.0, 0.03, 0.06, 0.09)
"""Offsets from which least squares lead to the best one, s. From 0.025 s away they are 1.7 ms short of it, from 0.015 s
0.3 ms (``mainline``). A filter of second order at 5 Hz delays by 0.045 s; the band's shortest waves come again after
0.3 s."""

_SLOWEST = 1.2
"""Steps as long, over :data:`STEP_S`, will do: 50 samples a second with stamps that scatter."""

_ROUNDS, _SETTLED_S = 10, 1e-5
"""Fits at most, and the change of the offset, s, at which they end: a hundredth of what matters."""
_FURTHEST_S = 0.15
"""Offsets beyond this are none, s."""

_SURE_SIGMAS, _LEAST_S = 4.0, 1e-3
"""An offset is sure from so many sigmas on, and matters from so many seconds on: with 5 ms versines of a good sensor
err by 3 to 5 sigmas at 30 m/s."""


@dataclass(frozen=True)
class AccelerometerClock:
    """``offset_s`` is to be added to the accelerometer's stamps to bring them to the gyro's clock, with its sigma."""

    offset_s: float
    sd_s: float

    @property
    def is_sure(self) -> bool:
        """Return whether the clocks are surely apart, by more than does not matter."""
        return abs(self.offset_s) > max(_SURE_SIGMAS * self.sd_s, _LEAST_S)

    @property
    def sentence(self) -> str:
        """Say how late or early the accelerometer is."""
        way = "late" if self.offset_s < 0.0 else "early"
        size, sigma = 1e3 * abs(self.offset_s), 1e3 * self.sd_s
        return f"the accelerometer's samples are {size:.1f} ms {way} against the gyro's (sigma {sigma:.1f} ms)"


def accelerometer_clock(recording: Recording) -> AccelerometerClock | None:
    """Return the accelerometer's offset; None where the recording does not show it.

    That is without a tach, of a vehicle on springs, of one that is slow or hardly moves, and of less than 50 samples a
    second, which do not hold the band.
    """
    if recording.tach is None or recording.tach.empty:
        return None
    motion = averaged(*_of_longest_way(recording.imu, with_sense(recording)), STEP_S)
    if motion is None or motion.step_s > _SLOWEST * STEP_S or len(motion.t_s) * STEP_S < FEWEST_BLOCKS * BLOCK_S:
        return None
    forces = Forces.of(motion)
    fit = _fit(forces.products(0.0), 0.0)
    if _shown_by(fit) is None:
        fit = _best_fit(forces.products_of_starts())
    for _ in range(_ROUNDS):
        if fit is None or abs(fit.clock.offset_s) > _FURTHEST_S:
            return None
        last_s = fit.clock.offset_s
        fit = _fit(forces.products(last_s), last_s)
        if fit is not None and abs(fit.clock.offset_s - last_s) < _SETTLED_S:
            break
    return _shown_by(fit)


def _of_longest_way(imu: pd.DataFrame, tach: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the rows of IMU and tach of the ten minutes in which the wheel rolls furthest."""
    t, distance = tach["t_s"].to_numpy(), tach["distance_m"].to_numpy()
    rolled = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(distance)))])
    begin = t[np.argmax(np.interp(t + ENOUGH_S, t, rolled) - rolled)]

    def within(table: pd.DataFrame) -> pd.DataFrame:
        return table.iloc[slice(*np.searchsorted(table["t_s"], [begin, begin + ENOUGH_S]))]

    return within(imu), within(tach)


@dataclass(frozen=True)
class Forces:
    """Signals of a motion in the band, every ``step_s``: the ``terms`` (n, 4) of the gyro, the force ``up`` (n,)."""

    step_s: float
    terms: Array
    up: Array

    @classmethod
    def of(cls, motion: Motion) -> Forces:
        """Return those of a vehicle's motion."""
        step_s = motion.step_s

        def in_band(values: Array) -> Array:
            return band_passed(values, motion.valid, step_s, _SHORT_S, _LONG_S)

        speed = gaussian_filter1d(motion.speed, _SPEED_S / step_s)
        roll, pitch = in_band(motion.gyro[:, 0]), in_band(motion.gyro[:, 1])
        turned = in_band(-speed * motion.gyro[:, 1])
        terms = [turned, -_rate(pitch, step_s), _rate(roll, step_s), _rate(turned, step_s)]
        inside = slice(round(_END_S / step_s), -round(_END_S / step_s))
        return cls(step_s, np.column_stack(terms)[inside], in_band(motion.accel[:, 2])[inside])

    def products(self, offset_s: float) -> Array:
        """Return the sums of products of all signals, the force's stamps moved by so much, by block (b, 5, 5)."""
        force = shift(self.up, offset_s / self.step_s, order=3, mode="nearest")
        rows = np.column_stack([self.terms, force])
        starts = np.arange(0, len(rows), round(BLOCK_S / self.step_s))
        return np.array([block.T @ block for block in np.split(rows, starts[1:])])

    def products_of_starts(self) -> Array:
        """Return :meth:`products` for each of :data:`STARTS_S`, (s, b, 5, 5)."""
        return np.array([self.products(start_s) for start_s in STARTS_S])


def _rate(values: Array, step_s: float) -> Array:
    """Return the derivative of values (n,) in the band, by five points: right to 0.1 % at 3 Hz."""
    return np.convolve(values, np.array([-1.0, 8.0, 0.0, -8.0, 1.0]) / (12.0 * step_s), mode="same")


def clock_near_start(products: Array) -> AccelerometerClock | None:
    """Return what sums of products (s, b, 5, 5) for each of :data:`STARTS_S` show, to first order."""
    return _shown_by(_best_fit(products))


@dataclass(frozen=True)
class _Fit:
    """The least-squares estimate of the ``clock``, and the share of the force's power that is ``explained``."""

    clock: AccelerometerClock
    explained: float


def _shown_by(fit: _Fit | None) -> AccelerometerClock | None:
    return None if fit is None or fit.explained < LEAST_EXPLAINED else fit.clock


def _best_fit(products: Array) -> _Fit | None:
    """Return the fit that explains most, of sums (s, b, 5, 5) for each of :data:`STARTS_S`."""
    fits = [fit for of_start, start_s in zip(products, STARTS_S, strict=True) if (fit := _fit(of_start, start_s))]
    return max(fits, key=lambda fit: fit.explained, default=None)


def _fit(products: Array, moved_s: float) -> _Fit | None:
    """Fit the equation to sums by block (b, 5, 5), of forces that were moved by so much; None where they are too few.

    It holds to first order in what is left of the offset.
    """
    fit = block_fit(products[products[:, 0, 0] > 0.0])
    return None if fit is None else _Fit(AccelerometerClock(moved_s + fit.ratio, fit.sd), fit.explained)
