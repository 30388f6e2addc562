"""The rows after a hole in the stamps of the IMU show, as they come, whether its clock was set ahead over it.

Over a gap the offset of IMU and tach (:mod:`trackfg.checks.diagnosis_clock`) stays as it was before; where the IMU's
clock was set by L it changes by L. With the correlations r of their accelerations after the hole at either offset, and
n independent values, the difference of the sums of squares over their level, twice the logarithm of the likelihood
ratio, is

    n log((1 - r_gap^2) / (1 - r_set^2))

Over a gap it exceeds x with a probability of exp(-x / 2) at most, however often it is looked at while rows come
(Ville's inequality). An offset that is estimated from few rows, and may be any, errs far more often.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from trackfg.checks.diagnosis_clock import NOT_ALIKE, ClockOffset, Likeness, clock_offset, likeness

LEAST_S = 0.5
"""Shorter holes are not looked into, s: the offset of two clocks shows to some tenths of a second."""
SIDE_S = 300.0
"""So much of the record on either side of a hole is compared, s."""
_BETTER = 20.0
"""Difference of the sums of squares, over their level, from which on the clock was set: exp(-10) is the probability of
four sigmas. In simulated runs it stayed below 3 over gaps, and below 18 with a tach of four pulses a revolution.
"""
_LATEST_S = 2.0
"""A tach is no later than this before a hole, s: displays on a bus are up to 1 s late."""
_SIGMAS = 4.0
"""Agreement of offsets, in sigmas."""
_APART_S = 0.15
"""The same, s: what the offset wanders within minutes, and what its sigma leaves out."""


def offset_before(imu: pd.DataFrame, tach: pd.DataFrame) -> ClockOffset | None:
    """Return what brings the tach's times to those of the IMU before a hole; None where these rows do not show it."""
    rows = _beside(tach, imu)
    return None if rows is None else clock_offset(imu, rows, _LATEST_S)


def was_set(imu: pd.DataFrame, tach: pd.DataFrame, before: ClockOffset, by_s: float) -> bool:
    """Return whether the rows after a hole show that the IMU's clock was set ahead over it by ``by_s``, s."""
    within_s = max(_SIGMAS * before.sd_s, _APART_S)
    if within_s >= 0.5 * by_s:
        return False
    as_gap, as_set = (_alike(samples, tach, before, within_s) for samples in (imu, imu.assign(t_s=imu["t_s"] - by_s)))
    ratio = (1.0 - as_gap.correlation**2) / (1.0 - as_set.correlation**2)
    return bool(min(as_gap.independent, as_set.independent) * np.log(ratio) > _BETTER)


def _alike(imu: pd.DataFrame, tach: pd.DataFrame, before: ClockOffset, within_s: float) -> Likeness:
    rows = _beside(tach, imu)
    return NOT_ALIKE if rows is None else likeness(imu, rows, before, within_s)


def _beside(tach: pd.DataFrame, imu: pd.DataFrame) -> pd.DataFrame | None:
    """Return the rows of the tach about the times of the IMU's; None where one of both has fewer than two."""
    if len(imu) < 2:
        return None
    rows = tach[tach["t_s"].between(imu["t_s"].iloc[0] - _LATEST_S, imu["t_s"].iloc[-1] + _LATEST_S)]
    return rows if len(rows) > 1 else None
