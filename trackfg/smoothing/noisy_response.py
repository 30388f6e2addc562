"""The calibration of an inertial sensor multiplies what it measured, noise included; that of a solution's motion is
used instead where this matters.

An interval's noise n is in the mean force by which a calibration c is multiplied, and in the residual that c explains:
the likelihood grows as c makes the noise smaller, and scale factors are pulled by ``n^2 / (f^2 + n^2)`` towards sensors
that measure too much (errors in variables: Fuller, *Measurement Error Models* (1987), 1.1). Where that widens a prior
it is seen at once. But all scales of a sensor are pulled one way, and with them the wheel's, against which nothing
else is measured. With X the response to measured means and X' that to the motion, the bias walk has the residual
``r = b_k+1 - b_k - (X_k+1 - X_k) c`` of sigma s; exchanging one for the other moves c, whose covariance is P, by

    P g,   g = sum (X'_k+1 - X'_k - X_k+1 + X_k)' r / s^2,

one step of Newton's to first order in c, and by ``sqrt(g' P g)`` of its sigmas.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, changed
from trackfg.factors.states import Kind
from trackfg.graph.build import Problem
from trackfg.graph.inertial import response_of_motion
from trackfg.smoothing.reassessment import SolvedRun

_SAME_MOTION = 0.1
"""Change of the motion, relative, from which the response to it is renewed: by the square of it a scale factor may then
be off."""

_PULLED = 0.5
"""Sigmas of a pull of the calibration that matters: an rms error is then 1.12 sigmas."""


def without_noise(run: SolvedRun, problem: Problem, *, contradicted: bool) -> Problem | None:
    """Return the problem whose inertial sensor responds to the motion of the solution.

    None where it already does, or where no prior of the calibration is ``contradicted`` and noise does not pull it.
    """
    walk = problem.family(FactorType.BIAS_WALK)
    if walk is None or not problem.measured:
        return None
    states = run.solution.states
    on_springs = problem.family(FactorType.PATH) is None
    gravity = problem.measured[0].gravity
    response = response_of_motion(states.nav, problem.t, gravity, problem.response, on_springs=on_springs)
    change = np.diff(response, axis=0)
    differs, size = (np.linalg.norm(terms, axis=(0, 1)) for terms in (walk.data["change"] - change, change))
    if (differs <= _SAME_MOTION * size).all():
        return None
    weighted = walk.residual(states) / walk.sigma**2
    pull = np.einsum("mij,mi->j", change - walk.data["change"], weighted)
    if not contradicted and pull @ run.covariance.of(Kind.IMU)[0] @ pull < _PULLED**2:
        return None

    def of_motion(family: Family) -> Family:
        return family.with_data(change=change)

    families = changed(problem.families, FactorType.BIAS_WALK, of_motion)
    return replace(problem, families=families, response=response)
