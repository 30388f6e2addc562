"""A sensor that vibrates on its track shows vibration as track: no residual says so, but its spectrum does."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pandas as pd

from trackfg.results.summary import GeometryConventions
from trackfg.results.verdict import Doubt, Quantity
from trackfg.sensors.imu_filters.bandwidth import Bandwidths
from trackfg.sensors.short_vibration import SHORTEST_WAVE_M, Blocks
from trackfg.smoothing.doubts.usual_sigmas import COLUMNS, LEAST_WIDENING, inverse_squares, usual_sigma
from trackfg.smoothing.reassessment import SolvedRun

_VERSINE = math.sqrt(1.5)
"""A versine of independent errors of three places, over one of them: 1 + 1/4 + 1/4."""

_HINT = "mount the sensor where it does not vibrate, or declare rigid = false"


def vibration_doubts(run: SolvedRun, geometry: pd.DataFrame, bandwidths: Bandwidths) -> list[Doubt]:
    """Return doubts of the geometry's short waves, where a sensor of such bandwidths vibrates by more than their
    sigmas.
    """
    if geometry.empty:
        return []
    nav, context = run.solution.states.nav, run.problem.run
    blocks = Blocks.of(context.inertial, context.t, np.linalg.norm(nav.v, axis=1), bandwidths.least_hz)
    sums = {name: inverse_squares(geometry[f"{column}_sd"].to_numpy()) for name, column in COLUMNS.items()}
    usual = {name: usual_sigma(number, inverse) for name, (number, inverse) in sums.items() if number}
    return doubts_of_vibration(blocks, usual, context.conventions)


def doubts_of_vibration(
    blocks: Blocks, usual_mm: Mapping[Quantity, float], conventions: GeometryConventions
) -> list[Doubt]:
    """Return a doubt of each quantity whose sigmas, which are ``usual_mm``, the vibration of ``blocks`` exceeds.

    At rest all vibration shows. In motion only that below :data:`~trackfg.sensors.short_vibration.SHORTEST_WAVE_M`
    does, and what that says of the roll on the waves of a twist, of up to twice its base: most of it is on the longest,
    where the ends of the base move against each other.
    """
    resting, moving = blocks.shaking(max(2.0 * conventions.twist_base_m, SHORTEST_WAVE_M))
    moved: dict[Quantity, float] = {
        "twist": conventions.cross_level_base_m * _largest(math.sqrt(2.0) * resting.roll, 2.0 * moving.roll),
        "level": _VERSINE * _largest(resting.up, moving.up),
        "alignment": _VERSINE * _largest(resting.across, moving.across),
    }
    shown = {name: (1e3 * moved[name], math.hypot(1.0, 1e3 * moved[name] / usual)) for name, usual in usual_mm.items()}
    return [
        Doubt((name,), factor, f"the sensor vibrates: by {by:.2g} mm of {name}, which look like track", _HINT)
        for name, (by, factor) in shown.items()
        if factor >= LEAST_WIDENING
    ]


def _largest(*sizes: float) -> float:
    return float(np.nan_to_num(np.fmax.reduce(sizes)))
