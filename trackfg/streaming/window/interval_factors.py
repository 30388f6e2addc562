"""The factors of a stream's next interval, on keyframes 0 and 1: the newest one and the next.

The batch smoother's functions make them; where a kernel has computed their numbers, these are put into families that
were made once.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from trackfg.config import SmoothConfig
from trackfg.factors.bias import bias_walk
from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family
from trackfg.factors.loss import Huber, SwitchChain
from trackfg.factors.motion import non_holonomic
from trackfg.factors.odometry import arc_length, distance_chain, tach_distance, tach_reading
from trackfg.factors.path import follows_path
from trackfg.factors.states import Kind
from trackfg.numerics.arrays import Array
from trackfg.recording.description import RecordingDescription
from trackfg.sensors.imu_intervals import Turning

WITHIN_INTERVAL = (FactorType.ABSOLUTE_FIX, FactorType.GNSS_POSITION, FactorType.GNSS_SPEED)
"""Families whose factors may touch the older keyframe alone and are new all the same."""


def new_factors(families: Iterable[Family]) -> tuple[Family, ...]:
    """Return the factors that the interval before did not have: those of the older keyframe alone are known."""
    new = (family if family.type in WITHIN_INTERVAL else _on_later_keyframe(family) for family in families)
    return tuple(family for family in new if len(family))


def _on_later_keyframe(family: Family) -> Family:
    mask = family.last_keyframe == 1
    return family if mask.all() else family.take(mask)


class MotionFactors(NamedTuple):
    """The families of the motion along the track, of one interval, and of the walk of the biases, with numbers that
    stand in.
    """

    chain: Family
    arc: Family
    path: Family
    sideways: Family
    walk: Family

    @classmethod
    def of(cls, description: RecordingDescription, config: SmoothConfig) -> MotionFactors:
        """Return the families of a stream with these settings."""
        first, huber = np.zeros(1, dtype=np.int64), Huber(config.motion.robust_width)
        sigma, sigmas, turn = np.ones((1, 1)), np.ones((1, 2)), np.eye(3)[None]
        arm = np.array(description.imu.lever_arm_m)
        return cls(
            distance_chain(first, sigmas),
            arc_length(first, arm, sigma),
            follows_path(first, turn, turn, turn, arm, sigmas, huber),
            non_holonomic(first + 1, np.zeros((1, 3)), arm, np.ones(1), sigmas, sigmas, huber),
            bias_walk(first, np.zeros((1, Kind.BIAS.dim, Kind.IMU.dim)), np.ones((1, Kind.BIAS.dim))),
        )

    def measured(
        self, sigmas: Array, turned: Turning, ahead: Array, rate: Array, *, follows_path: bool
    ) -> tuple[Family, ...]:
        """Return the first four with the numbers of an interval: ``sigmas`` (1, 10) in their order, the last one's with
        the speed that it is of and its growth; how the body turned and how far it was ``ahead`` of a steady turn
        (1, 3), and its ``rate`` (1, 3) at the end, rad/s; without the path where the sensor does not follow it.
        """
        turns = {"turn": turned.turn, "mean": turned.mean, "mean_by_time": turned.mean_by_time, "ahead": ahead}
        path = (self.path.measured(sigmas[:, 3:5], **turns),) if follows_path else ()
        return (
            self.chain.measured(sigmas[:, :2]),
            self.arc.measured(sigmas[:, 2:3]),
            *path,
            self.sideways.measured(sigmas[:, 5:7], angular_rate=rate, speed=sigmas[:, 7], growth=sigmas[:, 8:]),
        )


class TachFactors(NamedTuple):
    """The families of a wheel over one interval, with numbers that stand in: what it ``rolled``, and its count at the
    end as ``read``.
    """

    rolled: Family
    read: Family

    @classmethod
    def of(cls, config: SmoothConfig) -> TachFactors:
        """Return the families of a stream with these settings."""
        first, any_number = np.zeros(1, dtype=np.int64), np.ones(1)
        loss = SwitchChain(config.tach.robust_width, config.keyframes.interval_s)
        rolled = tach_distance(first, np.zeros((1, Kind.WHEEL.dim)), any_number[:, None], loss)
        read = tach_reading(first + 1, any_number, any_number, any_number, any_number[:, None])
        return cls(rolled, read)
