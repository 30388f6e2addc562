"""The step to the next keyframe in a window of two: an iterated filter's update, with the rows of one interval.

The newest keyframe has all that earlier rows say of it as one factor (:mod:`trackfg.factors.marginal_prior`), the next
one is where the inertial sensor predicts it. What that sensor says is linearised, and compressed to a triangle, before
the other rows of the interval come. Those are linearised where they put the next keyframe, since their robust weights
depend on it, and count from the prediction like the others.
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
from trackfg.streaming.window.next_interval import OTHER_ROWS, Ahead
from trackfg.streaming.window.window import Gone, Interval, Window


class Found(NamedTuple):
    """The two keyframes after the step, the square root of their information, the newer one alone with all that is
    known of it (``tip``), and what is known of the older one given that (``link``).
    """

    pair: Window
    root: SquareRoot
    tip: Window
    link: Gone


@dataclass(frozen=True)
class Begun:
    """The next interval as far as the inertial sensor tells it: the two keyframes (``pair``), and their linear factors,
    compressed (``rows``).
    """

    ahead: Ahead
    pair: Window
    rows: Array

    @classmethod
    def of(cls, tip: Window, ahead: Ahead, noise: ImuNoise) -> Begun:
        """From the newest keyframe alone."""
        pair = tip.extended(ahead.interval)
        pair = pair.with_families(walk_of(pair.t, pair.response, noise))
        return cls(ahead, pair, compressed(stacked_pair(pair.linearized(left_out=OTHER_ROWS), len(pair.states.sensor))))

    def step(self, interval: Interval) -> Found:
        """With the whole interval. Raises as :meth:`Window.moved` does."""
        pair = self.pair.joined(interval.families[len(self.ahead.interval.families) :])
        there = pair.states.take(slice(0, 1)).joined(interval.ahead)
        shift = _between(self.ahead.interval, interval)
        others = [
            one.linearize(there).relative_to_step_start(shift)
            for one in pair.families
            if one.type in OTHER_ROWS and len(one)
        ]
        root, left = eliminate_pair(np.concatenate([self.rows, stacked_pair(others, len(there.sensor))]))
        found = pair.by(root)
        chained = (one for one in pair.families if one.is_chained)
        rolls = (one.tail_of_chain(np.zeros(len(one), dtype=bool), found.states).shifted(-1) for one in chained)
        known = (marginal_prior(left, pair.states.take(slice(1, 2))), *rolls)
        tip = Window(pair.t[1:], found.states.take(slice(1, 2)), (), pair.response[1:], known)
        return Found(found, root, tip, Gone.of(pair.t, root, pair.states, 1))


def _between(predicted: Interval, interval: Interval) -> Step:
    """From where the next keyframe was predicted to be to where the other rows put it, along its own axes: the wheel
    says nothing of attitudes. Of both keyframes.
    """
    here, there = predicted.ahead.nav, interval.ahead.nav
    step = Step(np.zeros((2, KEYFRAME_DIM)), np.zeros(SHARED_DIM + predicted.ahead.sensor.size))
    step.of(Kind.NAV)[1, 3:6] = here.R[0].T @ (there.p - here.p)[0]
    step.of(Kind.NAV)[1, 6:9] = here.R[0].T @ (there.v - here.v)[0]
    step.of(Kind.ODO)[1] = (interval.ahead.odo.array - predicted.ahead.odo.array)[0]
    return step
