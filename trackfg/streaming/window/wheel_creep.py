"""Fixes show that the wheel creeps for a while, and so does the accelerometer where that begins or ends in the window.

**Fixes.** Where creep comes slowly, the accelerometer's bias explains it as well. A fix that is off then may be right,
and the wheel may have crept since the last fix that agreed. Where the fix differs by r from the distance D, v being the
sum of both variances, its density is

    right, the wheel rolled     (1 - W) (1 - E) N(r; 0, v)
    right, the wheel crept      (1 - W) E       N(r; 0, v + q^2 w^3 / 3)
    wrong                       W / R

with the probabilities W and E and the length R of the line as in the batch's consensus of fixes
(:mod:`trackfg.graph.fix_consensus`). Creep is a scale that has walked since the last fix that agreed, w metres before,
with a sigma of ``MOST_CREEP`` at the end, so that ``q^2 w = MOST_CREEP^2``: creep is likelier than a wrong fix where r
is below 2.7 % of w (over less than 1 km, below some 3 %). A fix with the chainage of another balise is further off.
Where positions of GNSS have the sigma g, errors and their duration included, creep beyond that would not have passed
unnoticed: the variance of the walk is the parallel sum of ``q^2 w^3 / 3`` and ``g^2``.

If the wheel crept, the window has a scale that walks by q since that fix, and its marginal prior allows for the walk
before the window. The accelerometer shows where in the window the scale changed. Wheels of further axles have one scale
for the run, so over that way their increments may be off by as much, too: all that agree have crept together, and one
that has not crept agrees with the fix. The scale keeps walking until as many more fixes agree as a hypothesis has
votes. The sigmas of rows that have left the window by then are doubted.

**Accelerometer.** A change of the scale by a per cent within seconds makes large residuals of the wheel, one after the
other, or slip in each interval. There the likelihood of the window's rows decides whether the scale walks, as in the
batch (:mod:`trackfg.solver.scale_evidence`); it keeps walking until the likelihood of a window is against it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, changed, family_of
from trackfg.factors.marginal_prior import with_scale_walked
from trackfg.factors.odometry import MOST_CREEP
from trackfg.factors.states import Odo
from trackfg.graph.fix_consensus import SHORTEST_LINE_M, wrong_is_likelier
from trackfg.graph.odometry import ROLLED_AT_REST_M
from trackfg.numerics.arrays import Array
from trackfg.results.events import Event, doubt_event
from trackfg.solver.scale_evidence import CLEARLY, ScaleEvidence
from trackfg.streaming.window.window import Window

WALK_PER_SQRT_M = 3e-4
"""Random walk of a scale whose change the accelerometer shows, 1/sqrt(m): 1 % in a kilometre, the widest that the batch
tries (:mod:`trackfg.smoothing.wheel_scale`). In creep of 1 and 2 % the likelihood has its maximum within a factor
of three of it."""

_QUIET = 0.25
"""Mean square of the wheel's whitened residuals below which no likelihood is computed, which costs a third of a pass.
A wheel that rolls makes 0.04 to 0.2: its creep is declared three times what it is."""


@dataclass(frozen=True)
class Creep:
    """The wheel crept over the last ``way_m`` (signed), which began at ``since_s``, so that the vehicle is
    ``further_m`` along the track.
    """

    further_m: float
    way_m: float
    since_s: float

    @property
    def walk_per_sqrt_m(self) -> float:
        """The random walk of the scale over the way, 1/sqrt(m)."""
        return MOST_CREEP / float(np.sqrt(abs(self.way_m)))

    @property
    def variance(self) -> float:
        """The variance that the walk adds to the distance over the way, m^2."""
        return MOST_CREEP**2 * self.way_m**2 / 3.0

    def is_likely(self, variance: float, others_sd_m: float = np.inf) -> bool:
        """Return whether it is likelier than a wrong fix; ``variance`` (m^2) is that of the difference without it.

        ``others_sd_m``: the sigma with which others than wheels determine where the vehicle is; more would not go
        unnoticed.
        """
        line_m = max(SHORTEST_LINE_M, abs(self.way_m))
        unnoticed = 1.0 / (1.0 / self.variance + 1.0 / others_sd_m**2)
        return not wrong_is_likelier(self.further_m, variance + unnoticed, line_m)

    def event(self, t: float) -> Event:
        """Return the event of a fix at ``t``, s, that shows the creep."""
        percent = 100.0 * self.further_m / abs(self.way_m)
        detail = f"a fix is {self.further_m:+.1f} m on, {percent:+.1f} % of the way since the one before: followed"
        return Event("wheel-crept", "fixes", self.since_s, t, 0, detail)

    def doubt(self, until_s: float) -> Event:
        """Return the event that estimates before ``until_s``, which are written, did not know of it."""
        reason = f"the wheel crept, by {abs(self.further_m):.1f} m in all, which sigmas did not allow for"
        advice = "widen that of chainage by as much, or smooth the recording"
        quantities = ("chainage", "speed")
        return doubt_event(quantities, reason, advice, table="fixes", t_s=self.since_s, until_s=until_s)


def with_creep(window: Window, creep: Creep) -> Window:
    """Return the window with a scale that walks over the creep's way, up to its last keyframe, and the place there."""
    since = _way_since(window.states.odo.distance, creep)
    odo = window.states.odo.array.copy()
    odo[:, Odo.DISTANCE] += creep.further_m * since / creep.way_m
    walk, marginalised_m = creep.walk_per_sqrt_m, float(since[0])
    step = window.states.odo.step[1:] * (since[1:] != 0.0)
    families = with_walking_scale(window.families, step, walk)
    families = _with_creeping_axles(families, np.abs(step) * creep.variance / abs(creep.way_m))
    if marginalised_m:
        families = changed(
            families, FactorType.MARGINAL_PRIOR, lambda family: with_scale_walked(family, marginalised_m, walk)
        )
    return replace(window, states=replace(window.states, odo=Odo(odo)), families=families)


def _with_creeping_axles(families: Sequence[Family], variance: Array) -> tuple[Family, ...]:
    """Return families whose wheels of further axles creep by so much more, ``variance`` (n - 1,), m^2, per interval."""

    def creeping(wheel: Family) -> Family:
        return wheel.with_sigma(np.sqrt(wheel.sigma**2 + variance[wheel.slots[0].index, None]))

    return changed(families, FactorType.TACH_INCREMENT, creeping)


def scale_walks(window: Window, declared_per_sqrt_m: float, *, walks: bool) -> bool:
    """Return whether the wheel's scale walks in a window by more than declared, where that or the contrary is clear;
    else ``walks``, as before.
    """
    tach, chain = (family_of(window.families, kind) for kind in (FactorType.TACH_DISTANCE, FactorType.DISTANCE_CHAIN))
    if tach is None or chain is None or declared_per_sqrt_m >= WALK_PER_SQRT_M:
        return False
    if not walks and np.mean((tach.residual(window.states) / tach.sigma) ** 2) < _QUIET:
        return False
    evidence = ScaleEvidence.of(window.inertial, window.families, window.states)
    root_way = np.sqrt(np.abs(window.states.odo.step[chain.slots[0].index + 1]) + ROLLED_AT_REST_M)

    def likelihood(per_sqrt_m: float) -> float:
        return evidence.log_likelihood(chain.with_sigma(np.stack([chain.sigma[:, 0], per_sqrt_m * root_way], 1)))

    gain = likelihood(WALK_PER_SQRT_M) - likelihood(declared_per_sqrt_m)
    return gain > (-CLEARLY if walks else CLEARLY)


def with_walk(window: Window) -> Window:
    """Return the window with a scale that walks by :data:`WALK_PER_SQRT_M`, for creep that the accelerometer shows."""
    families = with_walking_scale(window.families, window.states.odo.step[1:], WALK_PER_SQRT_M)
    return replace(window, families=families)


def with_walking_scale(families: Sequence[Family], step: Array, per_sqrt_m: float | Array) -> tuple[Family, ...]:
    """Return families with a wheel's scale that walks by ``per_sqrt_m`` or more over each ``step`` (n - 1,), m, from
    one keyframe to the next.
    """
    sd = per_sqrt_m * np.sqrt(np.abs(step))

    def walking(chain: Family) -> Family:
        sigma = chain.sigma.copy()
        sigma[:, 1] = np.maximum(sigma[:, 1], sd[chain.slots[0].index])
        return chain.with_sigma(sigma)

    return changed(families, FactorType.DISTANCE_CHAIN, walking)


def _way_since(distance: Array, creep: Creep) -> Array:
    """Return how much of the creep's way (m, signed) lies behind at distances (n,), m, the last one at its end."""
    way = creep.way_m - (distance[-1] - distance)
    return np.asarray(np.clip(way, min(0.0, creep.way_m), max(0.0, creep.way_m)))
