"""The next interval of a stream: the predicted state at its end, and its factors, by the batch smoother's functions.

The inertial sensor predicts the motion, because the wheel may slip. Rates at the keyframe need rows from a little after
it, of the wheel from later than of the inertial sensor: so the inertial part (:func:`predict_interval`) is prepared
while the other rows (:func:`with_other_rows`) are on their way.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, changed
from trackfg.factors.imu import Preintegration, PreintegrationNoise
from trackfg.factors.motion import mount_matrix
from trackfg.factors.odometry import tach_excess
from trackfg.factors.states import Nav, Odo
from trackfg.graph.further_sensors import further_distances
from trackfg.graph.positions import positions
from trackfg.recording.model import Recording
from trackfg.sensors.imu_intervals import Intervals
from trackfg.sensors.imu_noise.noise_at_rest import NoiseAtRest
from trackfg.sensors.tach import Wheel
from trackfg.streaming.window.interval_factors import WITHIN_INTERVAL, new_factors
from trackfg.streaming.window.predicted_motion import PredictedMotion
from trackfg.streaming.window.stream_context import StreamContext
from trackfg.streaming.window.tach_interval import TachInterval
from trackfg.streaming.window.wheel_creep import with_walking_scale
from trackfg.streaming.window.window import Interval, Window

OFF_S = 60.0
"""How long a device that restarted is taken to have been off, s: the order of a reboot. Its clock does not show it."""
_ROLLING_SIGMAS = 4.0
"""Maximum deviation from the predicted distance, in sigmas, of a wheel that rolls without slip."""
OTHER_ROWS = (
    FactorType.TACH_DISTANCE,
    FactorType.TACH_READING,
    *WITHIN_INTERVAL,
    FactorType.WITHHELD_FIX,
    *(kind for kind in FactorType if kind.of_further_sensor and kind not in WITHIN_INTERVAL),
)
"""Families of other rows than the inertial sensor's."""


class Prediction(NamedTuple):
    """The next interval by the inertial sensor alone; :func:`with_other_rows` adds the rest."""

    motion: PredictedMotion
    interval: Interval

    def with_walking_scale(self, per_sqrt_m: float) -> Prediction:
        """Return the prediction with a wheel's scale that walks by so much, if that is more than the settings say."""
        if not per_sqrt_m:
            return self
        families = with_walking_scale(self.interval.families, self.interval.predicted.odo.step, per_sqrt_m)
        return self._replace(interval=self.interval._replace(families=families))


def predict_interval(
    context: StreamContext,
    window: Window,
    data: Intervals,
    edges: np.ndarray,
    at_rest: NoiseAtRest,
    *,
    broken: bool = False,
) -> Prediction:
    """Predict from the newest keyframe to the next one, at ``edges`` (2,) of the inertial ``data``, which go a bit on.

    ``at_rest``: what rests have shown of the noise. ``broken``: the sensor was off for an unknown time that is not on
    the clock.
    """
    newest = window.states.take(slice(len(window) - 1, None))
    motion = PredictedMotion.of(context, newest, data, edges, at_rest)
    start, measured, distance = motion.start, motion.measured, motion.distance
    odo = start.odo.moved_on(distance)
    predicted = newest.with_motion(motion.nav, odo)
    families = motion.families
    if broken:
        measured, families = _across_break(motion, measured, families)
    end = float(motion.t[1])
    return Prediction(motion, Interval(end, start.bias[0], predicted, measured, motion.response, families))


def with_other_rows(prediction: Prediction, recording: Recording, wheel: Wheel | None, speed_sd: float) -> Interval:
    """Return the interval with the factors of the other rows; ``wheel`` covers the interval and a little more.

    Where the wheel's distance agrees with the prediction, ``speed_sd`` (m/s) being that of the newest keyframe, the
    next keyframe is moved to it: at the prediction itself, the robust loss would take the inertial drift for a slip.
    """
    motion, interval = prediction.motion, prediction.interval
    predicted, tach = interval.predicted, TachInterval.of(motion, wheel)
    if wheel is not None:
        span = float(motion.t[1] - motion.t[0])
        more = float(tach.counted - predicted.odo.step[0])
        further = float(tach_excess(predicted.odo.scale, tach.counted, predicted.odo.step)[0])
        moved_sd = span * math.hypot(speed_sd, max(interval.measured.noise.accel.tolist()) * math.sqrt(span / 3.0))
        distance_sd = math.hypot(moved_sd, math.sqrt(2.0) * wheel.rounding_sd)
        nav = predicted.nav
        if abs(further) < _ROLLING_SIGMAS * distance_sd:
            forward = nav.R @ mount_matrix(predicted.mount)[0, :, 0]
            nav = Nav(nav.R, nav.p + further * forward, nav.v + further / span * forward)
        else:
            further = 0.0
        by_wheel = np.array([further, 0.0, more, further])
        predicted = predicted.with_motion(nav, Odo(predicted.odo.array + by_wheel))
    families = (*interval.families, *tach.families, *_of_positions_and_others(motion, recording, wheel))
    return interval._replace(predicted=predicted, families=families)


def _of_positions_and_others(motion: PredictedMotion, recording: Recording, wheel: Wheel | None) -> tuple[Family, ...]:
    """Return the factors of fixes, GNSS and further sensors; most intervals have no rows of these."""
    if recording.fixes is None and recording.gnss is None and not recording.others:
        return ()
    inputs = motion.inputs.with_rows(recording, wheel)
    return new_factors([*positions(inputs), *further_distances(inputs)])


def _across_break(
    motion: PredictedMotion, measured: Preintegration, families: tuple[Family, ...]
) -> tuple[Preintegration, tuple[Family, ...]]:
    """Return measurement and factors with the noise of a hole of :data:`OFF_S`: the vehicle may have moved on."""
    config, lasting, newest = motion.context.config.imu, float(motion.t[1] - motion.t[0]), motion.start
    moved_sd = float(
        np.hypot(np.linalg.norm(newest.nav.v[0]) * OFF_S, config.bridge_accel_white * OFF_S**1.5 / np.sqrt(3.0))
    )
    longer = np.sqrt(OFF_S / lasting)
    noise = PreintegrationNoise.alike(
        config.bridge_gyro_white * longer, config.bridge_accel_white * longer, moved_sd / float(np.sqrt(lasting))
    )
    loose = changed(
        (family for family in families if family.type is not FactorType.PATH),
        FactorType.ARC_LENGTH,
        lambda family: family.with_sigma(np.full_like(family.sigma, moved_sd)),
    )
    return replace(measured, noise=noise), loose
