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
from trackfg.factors.states import KEYFRAME_DIM, SHARED_DIM, Kind, Step
from trackfg.graph.inertial import walk_of
from trackfg.numerics.arrays import Array
from trackfg.recording.description import ImuNoise
from trackfg.solver.elimination import compressed, eliminate_pair, stacked_pair
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
        """Linearise the prediction from the newest keyframe, a window of one."""
        pair = newest.extended(prediction.interval)
        pair = pair.with_families(walk_of(pair.t, pair.response, noise))
        return cls(
            prediction, pair, compressed(stacked_pair(pair.linear_factors(without=OTHER_ROWS), len(pair.states.sensor)))
        )

    def update(self, interval: Interval) -> FilterResult:
        """Take the step with the complete interval. Raises as :meth:`Window.gauss_newton_step` does."""
        predicted = self.prediction.interval
        pair = self.pair.with_factors(interval.families[len(predicted.families) :])
        point = pair.states.take(slice(0, 1)).joined(interval.predicted)
        shift = _step_between(predicted, interval)
        others = [
            family.linearize(point).relative_to_step_start(shift)
            for family in pair.families
            if family.type in OTHER_ROWS and len(family)
        ]
        root, marginal = eliminate_pair(np.concatenate([self.triangle, stacked_pair(others, len(point.sensor))]))
        updated = pair.updated_by(root)
        chained = (family for family in pair.families if family.is_chained)
        chains = (
            family.tail_of_chain(np.zeros(len(family), dtype=bool), updated.states).shifted(-1) for family in chained
        )
        families = (marginal_prior(marginal, pair.states.take(slice(1, 2))), *chains)
        newest = Window(pair.t[1:], updated.states.take(slice(1, 2)), (), pair.response[1:], families)
        return FilterResult(updated, root, newest, MarginalisedKeyframes.first(pair.t, root, pair.states, 1))


def _step_between(predicted: Interval, interval: Interval) -> Step:
    """Return the step of both keyframes from the inertial prediction to where the other rows put the next keyframe.

    Attitudes do not change: the wheel does not measure them.
    """
    start, end = predicted.predicted.nav, interval.predicted.nav
    step = Step(np.zeros((2, KEYFRAME_DIM)), np.zeros(SHARED_DIM + predicted.predicted.sensor.size))
    step.of(Kind.NAV)[1, 3:6] = start.R[0].T @ (end.p - start.p)[0]
    step.of(Kind.NAV)[1, 6:9] = start.R[0].T @ (end.v - start.v)[0]
    step.of(Kind.ODO)[1] = (interval.predicted.odo.array - predicted.predicted.odo.array)[0]
    return step
