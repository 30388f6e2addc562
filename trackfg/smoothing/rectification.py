"""Vibration that rectifies more than a good sensor's is found after a solve, and its prior is widened then.

Data sheets differ by a factor of a hundred, and a filter before the samples hides most of a vibration's power, so no
one prior suits all: a wide one would cost sensors without the effect some of their accuracy. So the prior of the
coefficients k (:mod:`trackfg.factors.bias`) begins narrow. Where one of them, as the data alone would have it,

    e = k / (1 - h),   c^2 = s^2 / (1 - h),   h = (s / s0)^2

with s0 its prior and s its posterior sigma, is far beyond ``sqrt(s0^2 + c^2)``, the prior of all three axes becomes
the largest such e: empirical Bayes (Efron & Morris, J. American Statistical Association 68 (1973)). It follows e down
as well, and is the first one again where the data do without. No sensor rectifies more than the worst data sheet
says: an e beyond that is something else, which the coefficient does not take up, and attitudes are doubted for it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackfg.factors.bias import RECTIFICATION
from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, changed
from trackfg.factors.states import KEYFRAME_DIM, Kind, offset_in_keyframe
from trackfg.numerics.arrays import Array
from trackfg.recording.findings import Finding
from trackfg.results.verdict import Doubt
from trackfg.smoothing.reassessment import LEAST_CHANGE, Reassessment, SolvedRun
from trackfg.solver.leave_one_out import prior_left_out

_FAR_SIGMAS = 3.0
"""Sigmas beyond which the data contradict the prior: of three coefficients that it suits, one does in 120 runs."""

_NEAR_SIGMAS = 2.0
"""Sigmas below which it is the first prior again: what contradicted it has been explained by something else."""

_MOST = 6.5e-3 / 0.1
"""The widest prior, m/s^2 per (m/s^2)^2: 0.4 g at 2.5 g rms (ADXL354/355 data sheet, the worst MEMS of its class),
through a filter that leaves a tenth of the power: 50 of 500 Hz on an axle box (IEC 61373) at 100 samples a second."""

_LEAST_FREE = 1e-6
"""1 - h at least: beyond it rounding decides what the data alone say."""


def rectification(run: SolvedRun) -> Reassessment:
    """Reassess the prior of the accelerometer's bias per power of vibration."""
    problem, declared = run.problem, run.declared.family(FactorType.PRIOR_IMU)
    prior = problem.family(FactorType.PRIOR_IMU)
    if prior is None or declared is None:
        return Reassessment(problem)
    k = run.solution.states.imu[0, RECTIFICATION]
    sd, first = prior.sigma[0, RECTIFICATION], declared.sigma[0, RECTIFICATION]
    start = offset_in_keyframe(Kind.IMU)
    columns = np.arange(start, start + Kind.IMU.dim)[RECTIFICATION]
    alone, variance = prior_left_out(k, np.diagonal(run.covariance.of_shared)[columns - KEYFRAME_DIM], sd, _LEAST_FREE)
    sigmas = np.abs(alone) / np.sqrt(first**2 + variance)
    most, wanted = np.maximum(_MOST, first), sd
    if (far := sigmas > _FAR_SIGMAS).any():
        wanted = np.clip(np.abs(alone[far]).max(), first, most)
    elif (sigmas < _NEAR_SIGMAS).all():
        wanted = first
    beyond = float(np.max(np.abs(alone) / np.hypot(most, np.sqrt(variance))))
    doubts = (_unexplained(beyond),) if beyond > _FAR_SIGMAS else ()
    findings = _findings(k, bool((wanted > first).any()))
    if np.abs(np.log(wanted / sd)).max() <= np.log(LEAST_CHANGE) and not np.array_equal(wanted, first):
        wanted = sd
    if np.array_equal(wanted, sd):
        return Reassessment(problem, findings, doubts)

    def known_to(family: Family) -> Family:
        sigma = family.sigma.copy()
        sigma[:, RECTIFICATION] = wanted
        return family.with_sigma(sigma)

    problem = replace(problem, families=changed(problem.families, FactorType.PRIOR_IMU, known_to))
    return Reassessment(problem, findings, doubts, changed=True)


def grown_bias(k: Array) -> str:
    """Say what the coefficients k (3,) are, m/s^2 per (m/s^2)^2."""
    values = ", ".join(f"{value:.2g}" for value in k)
    return f"the accelerometer's bias grows with vibration: {values} m/s^2 per (m/s^2)^2 along x, y, z"


def _unexplained(factor: float) -> Doubt:
    """Return the doubt of attitudes where the bias grows with vibration ``factor`` times as much as a sensor's may."""
    reason = "forces grow with vibration by more than any accelerometer rectifies: something is not modelled"
    hint = "mount the sensor where it shakes less, and check its range and its mounting"
    return Doubt(("roll", "pitch", "yaw", "cross_level"), factor, reason, hint)


def _findings(k: Array, is_large: bool) -> tuple[Finding, ...]:
    if not is_large:
        return ()
    return (
        Finding(
            level="info",
            code="vibration-rectification",
            message=grown_bias(k),
            hint="mount the sensor where it shakes less, or declare rectification_sd of [imu.noise] as large",
        ),
    )
