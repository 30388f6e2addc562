"""The filter step is a Gauss-Newton step of the newest keyframe and the next one: an extended Kalman filter's update.

It smooths the older keyframe by one step besides, and is not iterated.

The newest keyframe stands alone, with everything measured before it in its marginal prior. The next one starts at the
inertial sensor's prediction. The inertial factors are linearised there and compressed to a triangle while the rows of
other sensors are still on their way. The factors of these rows are linearised at the state that they themselves give
the next keyframe, because their robust weights depend on it, and are then expressed relative to the prediction.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackfg.factors.marginal_prior import marginal_prior
from trackfg.factors.states import KEYFRAME_DIM, SHARED_DIM, Kind, offset_in_keyframe
from trackfg.graph.inertial import walk_sigma
from trackfg.numerics.arrays import Array
from trackfg.recording.description import ImuNoise
from trackfg.solver.elimination import compressed, eliminate_pair
from trackfg.solver.pair_rows import linearised_pair
from trackfg.solver.square_root import SquareRoot
from trackfg.streaming.window.next_interval import OTHER_ROWS, Prediction
from trackfg.streaming.window.window import Interval, MarginalisedKeyframes, Window


class FilterResult(NamedTuple):
    """The two keyframes after the step (``pair``) and the square root of their information; the newer one alone with
    its marginal prior (``newest``); and the conditional of the older one on it.
    """

    pair: Window
    root: SquareRoot
    newest: Window
    older: MarginalisedKeyframes


@dataclass(frozen=True)
class PredictedPair:
    """The newest keyframe and the predicted next one (``pair``), with the linear factors of the inertial sensor and the
    marginal prior, compressed to a ``triangle``.
    """

    prediction: Prediction
    pair: Window
    triangle: Array

    @classmethod
    def of(cls, newest: Window, prediction: Prediction, noise: ImuNoise) -> PredictedPair:
        """Linearise the prediction from the newest keyframe, a window of one. ``noise``: how fast biases walk."""
        interval, context = prediction.interval, prediction.motion.context
        sigma = walk_sigma(np.array([newest.t[0], interval.t]), noise)
        walk = context.motion_factors.walk.measured(sigma, change=-interval.response[None])
        pair = newest.extended(interval._replace(families=(*interval.families, walk)))
        inertial = (family for family in pair.families if family.type not in OTHER_ROWS)
        return cls(prediction, pair, compressed(linearised_pair(pair.states, inertial, pair.inertial)))

    def update(self, interval: Interval) -> FilterResult:
        """Take the step with the complete interval. Raises as :meth:`Window.gauss_newton_step` does."""
        predicted = self.prediction.interval
        pair = self.pair.with_factors(interval.families[len(predicted.families) :])
        point = pair.states.take(slice(0, 1)).joined(interval.predicted)
        others = linearised_pair(point, (family for family in pair.families if family.type in OTHER_ROWS))
        others[:, -1] += others[:, :-1] @ _step_between(predicted, interval)
        root, marginal = eliminate_pair(self.triangle, others)
        updated = pair.updated_by(root)
        chained = (family for family in pair.families if family.is_chained)
        chains = (family.tail_of_chain(slice(len(family), None), updated.states).shifted(-1) for family in chained)
        families = (marginal_prior(marginal, pair.states.take(slice(1, 2))), *chains)
        newest = Window(pair.t[1:], updated.states.take(slice(1, 2)), (), pair.response[1:], families)
        return FilterResult(updated, root, newest, MarginalisedKeyframes.first(pair.t, root, pair.states, 1))


def _step_between(predicted: Interval, interval: Interval) -> Array:
    """Return the step of (x_0, x_1, s) from the inertial prediction to where the other rows put the next keyframe.

    Attitudes do not change: the wheel does not measure them.
    """
    start, end = predicted.predicted, interval.predicted
    step = np.zeros(2 * KEYFRAME_DIM + SHARED_DIM + start.sensor.size)
    odo, nav = (KEYFRAME_DIM + offset_in_keyframe(kind) for kind in (Kind.ODO, Kind.NAV))
    step[odo : odo + Kind.ODO.dim] = end.odo.array[0] - start.odo.array[0]
    step[nav + 3 : nav + 6] = (end.nav.p - start.nav.p)[0] @ start.nav.R[0]
    step[nav + 6 : nav + 9] = (end.nav.v - start.nav.v)[0] @ start.nav.R[0]
    return step
