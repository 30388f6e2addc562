"""The step to the next keyframe in a window of two: an iterated filter's update, with the rows of one interval.

The newest keyframe has all that earlier rows say of it as one factor (:mod:`trackfg.factors.past`), the next one is
where the inertial sensor predicts it. What that sensor says is linearised before the other rows of the interval come.
Those are linearised where they put the next keyframe, since their robust weights depend on it, and count from the
prediction like the others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfg.description import ImuNoise
from trackfg.factors.family import LinearFactors
from trackfg.factors.states import KEYFRAME_DIM, SHARED_DIM, Kind, Step
from trackfg.inertial_factors import walk_of
from trackfg.streaming.increment import OTHER_ROWS, Ahead
from trackfg.streaming.window import Interval, Stepped, Window


@dataclass(frozen=True)
class Begun:
    """The next interval as far as the inertial sensor tells it; ``pair``: the two keyframes; its ``linear`` factors."""

    ahead: Ahead
    pair: Window
    linear: list[LinearFactors]

    @classmethod
    def of(cls, tip: Window, ahead: Ahead, noise: ImuNoise) -> Begun:
        """From the newest keyframe alone."""
        pair = tip.extended(ahead.interval)
        pair = pair.with_families(walk_of(pair.t, pair.response, noise))
        return cls(ahead, pair, pair.linearized(left_out=OTHER_ROWS))

    def step(self, interval: Interval) -> Stepped:
        """With the whole interval; the first keyframe can be left behind then. Raises as :meth:`Window.moved` does."""
        pair = self.pair.joined(interval.families[len(self.ahead.interval.families) :])
        there = pair.states.take(slice(0, 1)).joined(interval.ahead)
        shift = _between(self.ahead.interval, interval)
        others = [one.linearize(there).seen_from(shift) for one in pair.families if one.name in OTHER_ROWS and len(one)]
        return pair.stepped([*self.linear, *others], {1})


def _between(predicted: Interval, interval: Interval) -> Step:
    """From where the next keyframe was predicted to be to where the other rows put it, along its own axes: the wheel
    says nothing of attitudes. Of both keyframes.
    """
    here, there = predicted.ahead.nav, interval.ahead.nav
    step = Step(np.zeros((2, KEYFRAME_DIM)), np.zeros(SHARED_DIM))
    step.of(Kind.NAV)[1, 3:6] = here.R[0].T @ (there.p - here.p)[0]
    step.of(Kind.NAV)[1, 6:9] = here.R[0].T @ (there.v - here.v)[0]
    step.of(Kind.ODO)[1] = (interval.ahead.odo - predicted.ahead.odo)[0]
    return step
