"""A stream learns from residuals how fast the biases of its inertial sensor walk.

A sensor that warms up has biases that walk faster than declared, and one that is cheaper than declared. As in the batch
(:mod:`trackfg.smoothing.noise_levels`) the walk's level rises to what residuals show, in the window and for what comes.
What was marginalised before has held the biases too firmly: attitudes are doubted. Motion that the model does not have
looks like biases that walk as well. Where residuals of a sensor's samples are far above their noise, its walk stays as
it is, and attitudes are doubted all the same.

Residuals of the walk of one axis within a window are those of one error of its bias. So each relinearisation pass gives
a square per axis of what it marginalises, and the expectation of that is the redundancy r. The sum of all has

    n = (sum r)^2 / sum r^2

degrees of freedom (Satterthwaite, "An approximate distribution of estimates of variance components", Biometrics
Bulletin 2 (1946)).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import changed
from trackfg.numerics.arrays import Array
from trackfg.numerics.chi_square import exceeds_chance
from trackfg.recording.description import ImuNoise
from trackfg.results.events import Event, doubt_event
from trackfg.smoothing.noise_levels import FAR_OFF, level_like, levels_seen, settled
from trackfg.solver.variance_components import Residuals
from trackfg.streaming.events import CHANCE_OF_DOUBT
from trackfg.streaming.window.window import Window

_SENSORS = {"accelerometer": "accel_bias_walk", "gyro": "gyro_bias_walk"}
"""The sensors in the order of the walk's columns, and what declares their walk."""

_AXES = 3
"""Columns of the walk of each sensor."""


@dataclass
class WalkRecord:
    """The record holds the ``level`` (2,) of the walk of accelerometer and gyro, in declared sigmas; and the ``sums``
    (2, 3) over passes and axes of squares in declared sigmas, of redundancies and of their squares.
    """

    sums: Array = field(default_factory=lambda: np.zeros((len(_SENSORS), 3)))
    level: Array = field(default_factory=lambda: np.ones(len(_SENSORS)))

    def weigh(self, window: Window, walk: Residuals, leaving: int, far_off: np.ndarray) -> Window:
        """Compute the levels anew, and return the window with a walk of them; itself where they are as they were.

        ``walk``: the residuals of its intervals, of which the first ``leaving`` ones are marginalised next;
        ``far_off`` (2,): whether those of the samples of accelerometer and gyro are far above their noise.
        """
        first = walk.keyframe < leaving
        squares = np.sum(walk.values[first] ** 2, axis=0).reshape(len(_SENSORS), _AXES) * self.level[:, None] ** 2
        redundancy = np.sum(walk.redundancy[first], axis=0).reshape(len(_SENSORS), _AXES)
        self.sums += np.stack([squares, redundancy, redundancy**2], axis=2).sum(axis=1)
        previous = self.level
        self.level = np.where(far_off, previous, settled(previous, self._levels_seen()))
        if (self.level == previous).all():
            return window
        factor = np.repeat(self.level / previous, _AXES)
        families = changed(
            window.families, FactorType.BIAS_WALK, lambda family: family.with_sigma(family.sigma * factor)
        )
        return replace(window, families=families)

    def of(self, declared: ImuNoise) -> ImuNoise:
        """Return the declared noise with walks of the newest levels."""
        if (self.level == 1.0).all():
            return declared
        names = _SENSORS.values()
        walks = {name: level * getattr(declared, name) for name, level in zip(names, self.level.tolist(), strict=True)}
        return declared.model_copy(update=walks)

    def events(self, until_s: float) -> tuple[Event, ...]:
        """Return an event for each sensor whose biases walk far faster than declared, known at ``until_s``."""
        squares, degrees = self._independent
        mean = squares / np.maximum(degrees, 1.0)
        ratio = np.where(exceeds_chance(mean, degrees, CHANCE_OF_DOUBT), np.sqrt(mean), 1.0)
        return tuple(
            _doubt(sensor, level, until_s)
            for sensor, level in zip(_SENSORS, ratio.tolist(), strict=True)
            if level > FAR_OFF
        )

    def _levels_seen(self) -> Array:
        """Return the levels that the sums show; that of the accelerometer, which shows less, is like the gyro's."""
        squares, degrees = self._independent
        seen = levels_seen(squares, degrees)
        if seen[1] > 1.0:
            seen[0] = level_like(float(seen[1]), float(squares[0]), float(degrees[0]))
        return seen

    @property
    def _independent(self) -> tuple[Array, Array]:
        """Return the squares and the number, (2,) each, of independent residuals that show as much as all do."""
        squares, redundancy, redundancy_squared = self.sums.T
        known = redundancy > 0.0
        degrees = np.divide(redundancy**2, redundancy_squared, out=np.zeros(len(_SENSORS)), where=known)
        return np.divide(squares * degrees, redundancy, out=np.zeros(len(_SENSORS)), where=known), degrees


def _doubt(sensor: str, level: float, until_s: float) -> Event:
    reason = f"biases of the {sensor} walk {level:.1f} times as fast as declared"
    advice = f"declare {_SENSORS[sensor]} of [imu.noise] as much larger at least, or smooth the recording"
    return doubt_event(("roll", "pitch", "cross_level", "gradient"), reason, advice, t_s=until_s)
