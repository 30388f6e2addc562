"""A stream doubts attitudes where the biases of its inertial sensor walk faster than declared.

A sensor that warms up has such biases, and one that is cheaper than declared. The batch raises the walk's level and
solves again (:mod:`trackfg.smoothing.noise_levels`); a stream has held the biases of what it marginalised too firmly.

Residuals of the walk of one axis within a window are those of one error of its bias. So each relinearisation pass gives
a square per axis of what it marginalises, and the expectation of that is the redundancy r. The sum of all has

    n = (sum r)^2 / sum r^2

degrees of freedom (Satterthwaite, "An approximate distribution of estimates of variance components", Biometrics
Bulletin 2 (1946)).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.chi_square import exceeds_chance
from trackfg.results.events import DOUBT, Event
from trackfg.smoothing.noise_levels import FAR_OFF
from trackfg.solver.variance_components import Residuals

_CHANCE = 1e-3
"""Probability of such residuals by chance, below which attitudes are doubted."""

_SENSORS = {"accelerometer": "accel_bias_walk", "gyro": "gyro_bias_walk"}
"""The sensors in the order of the walk's columns, and what declares their walk."""


@dataclass
class WalkTest:
    """Sums over passes and axes, (2, 3), of accelerometer and gyro: of squares, redundancies, and their squares."""

    sums: Array = field(default_factory=lambda: np.zeros((len(_SENSORS), 3)))

    def put(self, walk: Residuals, leaving: int) -> None:
        """Take the residuals of a window, of which the first ``leaving`` intervals are marginalised next."""
        first = walk.keyframe < leaving
        squares = np.sum(walk.values[first] ** 2, axis=0).reshape(len(_SENSORS), -1)
        redundancy = np.sum(walk.redundancy[first], axis=0).reshape(len(_SENSORS), -1)
        self.sums += np.stack([squares, redundancy, redundancy**2], axis=2).sum(axis=1)

    def events(self, until_s: float) -> tuple[Event, ...]:
        """Return an event for each sensor whose biases walk far faster than declared, known at ``until_s``."""
        return tuple(
            _doubt(sensor, ratio, until_s)
            for sensor, sums in zip(_SENSORS, self.sums, strict=True)
            if (ratio := _ratio(*sums.tolist())) > FAR_OFF
        )


def _ratio(squares: float, redundancy: float, redundancy_squared: float) -> float:
    """Return actual over declared walk; 1 where it is no more than chance."""
    if redundancy <= 0.0:
        return 1.0
    mean, degrees = squares / redundancy, redundancy**2 / redundancy_squared
    return float(np.sqrt(mean)) if exceeds_chance(mean, degrees, _CHANCE) else 1.0


def _doubt(sensor: str, ratio: float, until_s: float) -> Event:
    doubt = f"roll, pitch, cross_level, gradient: biases of the {sensor} walk {ratio:.1f} times as fast as declared"
    advice = f"declare {_SENSORS[sensor]} of [imu.noise] as much larger at least, or smooth the recording"
    return Event(DOUBT, t_s=until_s, detail=f"{doubt}: {advice}")
