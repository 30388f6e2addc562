"""A sensor that vibrates on its track shows vibration as track: no residual says so, but its spectrum does."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd

from trackfg.results.verdict import Doubt, Quantity
from trackfg.sensors.short_vibration import SHORTEST_WAVE_M, shaking
from trackfg.smoothing.reassessment import SolvedRun

_LEAST_WIDENING = 1.2
"""Factors below this are none: sigmas of the geometry, which are drawn, and the level of a vibration are not known
better."""

_VERSINE = math.sqrt(1.5)
"""A versine of independent errors of three places, over one of them: 1 + 1/4 + 1/4."""

_HINT = "mount the sensor where it does not vibrate, or declare rigid = false"


def vibration_doubts(run: SolvedRun, geometry: pd.DataFrame) -> list[Doubt]:
    """Return doubts of the geometry's short waves, where the sensor vibrates by more than their sigmas.

    At rest all vibration shows. In motion only that below :data:`~trackfg.sensors.short_vibration.SHORTEST_WAVE_M`
    does, and what that says of the roll on the waves of a twist, of up to twice its base: most of it is on the longest,
    where the ends of the base move against each other.
    """
    if geometry.empty:
        return []
    nav, context = run.solution.states.nav, run.problem.run
    conventions = context.conventions
    speed, longest = np.linalg.norm(nav.v, axis=1), max(2.0 * conventions.twist_base_m, SHORTEST_WAVE_M)
    resting, moving = shaking(context.inertial, context.t, speed, longest)
    twist = conventions.cross_level_base_m * _largest(math.sqrt(2.0) * resting.roll, 2.0 * moving.roll)
    moved: tuple[tuple[Quantity, str, float], ...] = (
        ("twist", "twist_mm", twist),
        ("level", "versine_level_mm", _VERSINE * _largest(resting.up, moving.up)),
        ("alignment", "versine_alignment_mm", _VERSINE * _largest(resting.across, moving.across)),
    )
    return [doubt for name, column, by in moved if (doubt := _doubt(name, 1e3 * by, geometry[f"{column}_sd"]))]


def _largest(*sizes: float) -> float:
    return float(np.nan_to_num(np.fmax.reduce(sizes)))


def _doubt(quantity: Quantity, vibration_mm: float, sigmas: pd.Series[float]) -> Doubt | None:
    usual = float(np.sqrt(np.mean(np.square(sigmas.dropna())))) if sigmas.notna().any() else math.inf
    factor = math.hypot(1.0, vibration_mm / usual)
    if factor < _LEAST_WIDENING:
        return None
    reason = f"the sensor vibrates: by {vibration_mm:.2g} mm of {quantity}, which look like track"
    return Doubt((quantity,), factor, reason, _HINT)
