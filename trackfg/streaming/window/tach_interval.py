"""The factors of what a wheel rolls over the next interval of a stream, on both its keyframes.

Where compiled kernels are in use, ``kernels/tach.cpp`` computes the numbers of a wheel whose count is its distance but
for rounding; the batch smoother's functions make the factors of any other, and are its reference.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfg.factors.family import Family
from trackfg.factors.odometry import ANY_DISTANCE_SD_M
from trackfg.factors.states import Kind
from trackfg.graph.odometry import ROLLED_AT_REST_M, tach_factors
from trackfg.numerics.kernels import compiled_kernels, kernel_argument
from trackfg.sensors.tach import Wheel
from trackfg.streaming.window.interval_factors import new_factors
from trackfg.streaming.window.predicted_motion import PredictedMotion


class TachInterval(NamedTuple):
    """The tach's count over an interval: what it ``counted``, m (NaN without a wheel), and its factors."""

    counted: float
    families: tuple[Family, ...]

    @classmethod
    def of(cls, motion: PredictedMotion, wheel: Wheel | None) -> TachInterval:
        """Return that of a ``wheel`` that covers the interval and a little more, None where there is none."""
        if wheel is not None and wheel.is_plain_count and compiled_kernels():
            return _by_kernel(motion, wheel)
        inputs = motion.inputs.with_rows(motion.inputs.recording, wheel)
        counted = np.nan if wheel is None else float(np.diff(wheel.at(motion.t))[0])
        return cls(counted, new_factors(tach_factors(inputs)))


def _by_kernel(motion: PredictedMotion, wheel: Wheel) -> TachInterval:
    from trackfg.numerics import compiled

    config, out = motion.context.config, np.empty(3 + Kind.WHEEL.dim)
    tach = config.tach
    numbers = np.array([
        *(*motion.t.tolist(), *motion.rolling.tolist()),
        *(tach.creep_m_per_sqrt_m, tach.creep_per_traction, ROLLED_AT_REST_M, ANY_DISTANCE_SD_M),
        *(config.noise.tach, wheel.quantum),
    ])  # fmt: skip
    t, distance, gaps, uncounted = map(kernel_argument, (wheel.t, wheel.distance, wheel.gaps, wheel.uncounted))
    is_read = compiled.tach_interval(t, distance, gaps, uncounted, numbers, out)
    first, second, *_ = out.tolist()
    templates = motion.context.tach_factors
    families: tuple[Family, ...] = (templates.rolled.measured(out[None, 2:3], response=out[None, 3:]),)
    if is_read:
        count, rate = out[1:2, None], motion.rolling[None, 3:]
        since = motion.t[1:, None] - motion.context.clock_origin
        rounding = np.array([[wheel.rounding_sd]])
        families += (templates.read.measured(rounding, count=count, rate=rate, since=since),)
    return TachInterval(second - first, families)
