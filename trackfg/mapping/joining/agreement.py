"""The chainages of a map's runs are judged by each other, and count as much as they agree.

The rows that a run gives on the map's variables (:mod:`trackfg.mapping.joining.anchors`) are whitened by the run's own
covariance, one anchor after the other: a row is how far the run went from the anchors before to this one, in sigmas of
that. If the run's sigmas are right, the residuals ``e`` of the joint solution are normal. Where they are too small, all
of them are larger; where positions erred in a street for a while, or a slip was not found, some are. Student's
distribution describes both, with ``nu`` degrees of freedom, common to all runs, and a scale ``s >= 1`` of each run:

    weight    w = (nu + 1) / (nu + (e^2 + h) / s^2),    h the variance of the joint solution in that row,
    scale     s^2 = sum(w e^2) / sum(r),                r = 1 - W h the redundancy of a row that counted W,
    nu        of the largest likelihood, sum(r (log t_nu(e / (s r^0.5)) - log s)); infinite for a normal distribution,

in turns with the joint solution, in which a row then counts ``W = w / s^2`` (Lange, Little and Taylor, "Robust
statistical modeling using the t distribution", Journal of the American Statistical Association 84 (1989); s as in
Foerstner's variance components, :mod:`trackfg.solver.variance_components`). In the end it counts
``(nu + 1) / (nu + 3)`` of that, the information that Student's distribution has of its middle (ibid.). Rows of
cross-levels count as before.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import gammaln, ndtr

from trackfg.mapping.joining.anchors import is_chainage
from trackfg.mapping.joining.joint_solution import JointSolution
from trackfg.mapping.joining.survey import Survey
from trackfg.maps.feature_map import RunInformation
from trackfg.numerics.arrays import Array
from trackfg.numerics.chi_square import exceeds_chance

_DEGREES = (50.0, 20.0, 10.0, 6.0, 4.0, 3.0, 2.0)
"""Degrees of freedom of Student's distribution that are tried: each has tails about half as heavy again as the one
before."""
_SIGMAS = 3.0
"""Runs are not taken to disagree unless chance would make any of them do so as seldom as a normal variable exceeds
this."""
_FAR_OFF = 2.0
"""A user is told of a run whose sigmas are this many times too small."""
_LEAST_REDUNDANCY = 1e-3
"""A row of less redundancy is checked by no other run."""
_SETTLED = 1e-3
"""A round that changes no weight by more, in proportion, is the last one."""
_ROUNDS = 20
"""Rounds of weights and joint solution, and of scales and weights, at most."""


@dataclass(frozen=True)
class Agreement:
    """How well runs agree: ``degrees`` of freedom of Student's distribution, and the ``scales`` of the runs by id."""

    degrees: float
    scales: Mapping[str, float]


def in_agreement(survey: Survey) -> tuple[Survey, Agreement]:
    """Return a survey of runs that count as much as they agree, and how well they do."""
    weights = {run_id: np.ones(len(rows.d)) for run_id, rows in survey.information.items()}
    survey = survey.with_weights(weights)
    for _ in range(_ROUNDS):
        joint = survey.chainages.joint
        residuals = {run_id: _Residuals.of(rows, weights[run_id], joint) for run_id, rows in survey.information.items()}
        agreement = _agreement(residuals)
        newer = {
            run_id: residuals[run_id].weights(agreement.degrees, scale, len(weights[run_id]))
            for run_id, scale in agreement.scales.items()
        }
        change = max(float(np.max(np.abs(newer[run_id] / weights[run_id] - 1.0))) for run_id in weights)
        if change <= _SETTLED:
            break
        weights = newer
        survey = survey.with_weights(weights)
    if np.isinf(agreement.degrees):
        return survey, agreement
    share = np.sqrt((agreement.degrees + 1.0) / (agreement.degrees + 3.0))
    for run_id, of_run in residuals.items():
        weights[run_id][: len(of_run.error)] *= share
    return survey.with_weights(weights), agreement


def disagreements(survey: Survey, agreement: Agreement, run_ids: Collection[str]) -> list[str]:
    """Return what a user should know of some of the runs: which ones disagree with the others by far."""
    return [
        f"run {survey.runs[run_id].recording_id}: its chainages differ from those of other runs by {scale:.1f} times "
        "what its sigmas say, and count as little. Hint: trackfg report shows its slips and positions"
        for run_id, scale in agreement.scales.items()
        if run_id in run_ids and scale >= _FAR_OFF
    ]


class _Residuals(NamedTuple):
    """The residuals of a run's chainages (m,): ``error`` of each row, ``variance`` of the joint solution in it, and
    ``redundancy``.
    """

    error: Array
    variance: Array
    redundancy: Array

    @classmethod
    def of(cls, information: RunInformation, weights: Array, joint: JointSolution) -> _Residuals:
        """Return those of rows that count with their ``weights`` (k,) in a joint solution.

        The variables of this run alone, which are not in that, are those that fit best.
        """
        names, m = information.variables, sum(map(is_chainage, information.variables))
        R, d = weights[:, None] * information.R, weights * information.d
        is_shared = np.array([name in joint.index for name in names])
        shared = joint.rows([name for name in names if name in joint.index])
        basis, _ = np.linalg.qr(R[:, ~is_shared])  # what variables of the run alone explain
        J, e = R[:, is_shared], R[:, is_shared] @ joint.x[shared] - d
        J, e = J - basis @ (basis.T @ J), e - basis @ (basis.T @ e)
        fitted = np.sum((J @ joint.covariance[np.ix_(shared, shared)]) * J, axis=1) + np.sum(basis**2, axis=1)
        return cls(e[:m] / weights[:m], fitted[:m] / weights[:m] ** 2, np.clip(1.0 - fitted[:m], 0.0, 1.0))

    def scale(self, degrees: float, runs: int) -> float:
        """Return s for so many degrees of freedom: 1 where one of so many runs would have such residuals by chance."""
        checked = self.redundancy > _LEAST_REDUNDANCY
        free = float(self.redundancy.sum())
        squares = self.error[checked] ** 2
        if not exceeds_chance(squares.sum() / max(free, _LEAST_REDUNDANCY), free, float(ndtr(-_SIGMAS)) / runs):
            return 1.0
        scale = 1.0
        for _ in range(_ROUNDS):
            shares = _weight(squares / self.redundancy[checked] / scale**2, degrees)
            scale = max(1.0, float(np.sqrt(shares @ squares / free)))
        return scale

    def likelihood(self, degrees: float, scale: float) -> float:
        """Return the log likelihood, but for a constant."""
        checked = self.redundancy > _LEAST_REDUNDANCY
        free = self.redundancy[checked]
        squares = self.error[checked] ** 2 / free / scale**2
        if np.isinf(degrees):
            log_density = -0.5 * squares - 0.5 * np.log(2.0)
        else:
            log_density = gammaln(0.5 * (degrees + 1.0)) - gammaln(0.5 * degrees) - 0.5 * np.log(degrees)
            log_density = log_density - 0.5 * (degrees + 1.0) * np.log1p(squares / degrees)
        return float(free @ (log_density - np.log(scale)))

    def weights(self, degrees: float, scale: float, count: int) -> Array:
        """Return the weights of all rows of the run (count,); those behind the chainages have 1."""
        weights = np.ones(count)
        weights[: len(self.error)] = np.sqrt(_weight((self.error**2 + self.variance) / scale**2, degrees)) / scale
        return weights


def _agreement(residuals: Mapping[str, _Residuals]) -> Agreement:
    """Return how well runs agree, of the largest likelihood."""
    candidates = []
    for degrees in (np.inf, *_DEGREES):
        scales = {run_id: of_run.scale(degrees, len(residuals)) for run_id, of_run in residuals.items()}
        likelihood = sum(of_run.likelihood(degrees, scales[run_id]) for run_id, of_run in residuals.items())
        candidates.append((likelihood, Agreement(degrees, scales)))
    likelihood, normal = candidates[0]
    largest, likeliest = max(candidates, key=lambda candidate: candidate[0])
    return likeliest if largest - likelihood > 0.5 * _SIGMAS**2 else normal


def _weight(squares: Array, degrees: float) -> Array:
    """Return w of rows with such squares (m,)."""
    return np.ones(len(squares)) if np.isinf(degrees) else (degrees + 1.0) / (degrees + squares)
