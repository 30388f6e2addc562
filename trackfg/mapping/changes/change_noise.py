"""A run differs from the map by noise where nothing has changed.

**Sigmas as stated.** The variance of a difference is the run's plus the map's plus what a shift error makes of the
profile, the mean square of ``before(x + e) - before(x)`` at ``e = +- sigma_e``. Sigmas of cross-level and gradient hold
the sensor's offset and slow wander, which the comparison takes away; of the rest this much is known: cross-level errs
locally like the twist, gradient like the versine of level over half its chord. So these give the course along the line,
and the residuals the size. The map keeps no sigma of twist: it is taken to go with that of its versine of level as the
run's does.

**Sigmas as seen.** The robust spread (1.4826 times the median magnitude) of the differences over their stated sigmas,
for each band of speed, an octave wide, and over the whole run for bands that are too short. Where it is above 1 the
sigmas are raised by it; those of cross-level and gradient are what it says. Of these a run that is too short has the
whole sigmas, offset and wander included. The map's gradient is a mean of runs with an offset each, which has a step
where one of them begins or ends; the variance of such steps is added. (The offsets of cross-level are solved for, and
make no steps.)

**Threshold.** By Rice's formula a Gaussian process leaves ``+-u`` sigma as often as it crosses zero, times
``exp(-u^2 / 2)``: the number of sign changes per metre is the number of independent places per metre. The sigma of a
place is itself known to a share of ``1 / sqrt(2 n)`` only, as if from ``n`` residuals; the mean over ``chi^2_n / n`` is

    ``alarms per metre = crossings per metre * (1 + u^2 / n)^(-n / 2)``

with ``n`` 20 (16 %), and 10 (22 %) for cross-level and gradient, whose course along the line is borrowed.
Rice, "Mathematical analysis of random noise", Bell System Technical Journal 23 (1944) and 24 (1945).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from trackfg.mapping.changes.overlay import QUANTITIES, Overlay
from trackfg.numerics.arrays import Array
from trackfg.numerics.robust import robust_sd

WITHOUT_SLOW_PART = ("cross_level_mm", "gradient_permille")
"""What is compared without its slow difference, see :mod:`trackfg.mapping.changes.changes`."""

_SLOW_M, _SMOOTHED_M = 150.0, 50.0
"""Windows of the running median and mean that are the slow part of a difference, m: longer than any defect, shorter
than the wander of a sensor. Chosen on simulated runs; see Assumptions in docs/engine.md."""
_LEAST_CROSSINGS = 100
"""Sign changes from which a spread is trusted: as many independent values know it to some 10 %."""
_FREEDOM, _FREEDOM_WITHOUT_SLOW_PART = 20.0, 10.0
"""Residuals from which a sigma is known: it errs by 16 %, and by 22 % where its course along the line is borrowed.
Chosen on simulated runs; see Assumptions in docs/engine.md."""
_ROUNDING = 1e-6
"""Spread over the stated sigma below which a difference is rounding: doubles keep 16 digits, sensors know five."""
_OTHER_RUNS = 0.25
"""Difference of the number of runs from its slow part from which other runs are averaged there: where one run ends, the
slow part lies half a run from either number."""
_SLOWEST_MPS = 0.5
"""Least speed of a band of speed, m/s."""
FEWEST_CROSSINGS_PER_M = 0.02
"""Sign changes per m of a profile too short to count them: half of the fewest that were counted, 0.04 of the
gradient."""


@dataclass(frozen=True)
class ChangeNoise:
    """The noise of one quantity's difference.

    ``sigma`` (n,): of the difference. ``factor``: by which the residuals raised it. ``crossings_per_m``: how often it
    crosses zero. ``freedom``: the number of residuals from which a sigma is known.
    """

    sigma: Array
    factor: float
    crossings_per_m: float
    freedom: float

    def sigmas_for(self, alarms_per_m: float) -> float:
        """Return the threshold, in sigmas, that noise alone exceeds this often."""
        return threshold(self.crossings_per_m / alarms_per_m, self.freedom)


def threshold(crossings_per_alarm: float, freedom: float) -> float:
    """Return the threshold, in sigmas, that noise exceeds once in so many zero crossings.

    ``freedom``: the number of residuals from which a sigma is known.
    """
    return float(np.sqrt(freedom * max(crossings_per_alarm ** (2.0 / freedom) - 1.0, 0.0)))


def freedom_of(name: str) -> float:
    """Return the number of residuals from which the sigma of a quantity at a place is known."""
    return _FREEDOM_WITHOUT_SLOW_PART if name in WITHOUT_SLOW_PART else _FREEDOM


def slow_part(change: Array, step_m: float) -> Array:
    """Return the slow part of a difference (n,); holes shorten the window.

    Beyond each end the difference is continued by its reflection in the end point, so that a slow trend continues. A
    window that were cut off there would take the trend of the last 40 m for a change.
    """
    cells = np.flatnonzero(np.isfinite(change))
    if not cells.size:
        return change
    windows = [2 * round(0.5 * length / step_m) + 1 for length in (_SLOW_M, _SMOOTHED_M)]
    beyond = sum(windows) // 2
    whole = pd.Series(np.pad(change[cells[0] : cells[-1] + 1], beyond, mode="reflect", reflect_type="odd"))
    middle = whole.rolling(windows[0], center=True, min_periods=1).median()
    smooth = middle.rolling(windows[1], center=True, min_periods=1).mean()
    slow = np.full_like(change, np.nan)
    slow[cells[0] : cells[-1] + 1] = smooth.to_numpy()[beyond:-beyond]
    return slow


def stated_sigmas(over: Overlay, chord_m: float) -> dict[str, Array]:
    """Return the sigmas of the local difference of each quantity by the tables, without the shift's. Shapes (n,)."""
    run, grid = {name: over.run_column(f"{name}_sd") for name in QUANTITIES}, over.grid
    level_of_map = grid["versine_level_mm_sd"].to_numpy()
    ratio = run["twist_mm"] / run["versine_level_mm"]
    finite = ratio[np.isfinite(ratio)]
    twist = np.hypot(run["twist_mm"], level_of_map * (np.median(finite) if finite.size else np.nan))
    level = np.hypot(run["versine_level_mm"], level_of_map)
    local = {"twist_mm": twist, "cross_level_mm": twist, "gradient_permille": level / (0.5 * chord_m)}
    return {
        name: local[name] if name in local else np.hypot(run[name], grid[f"{name}_sd"].to_numpy())
        for name in QUANTITIES
    }


def change_noise(over: Overlay, name: str, change: Array, stated: Array, shift_sd: Array) -> ChangeNoise:
    """Return the noise of ``change`` (n,): as stated, and raised to what its own spread shows."""
    map_values = over.before(name)
    sides = np.stack([over.before_at(name, sign * shift_sd) - map_values for sign in (-1.0, 1.0)])
    sides = np.where(np.isfinite(sides), sides, sides[::-1])  # next to a hole there is one side only
    sigma = np.sqrt(stated**2 + np.mean(sides**2, axis=0))
    ratio = change / sigma
    whole, least = _spread(ratio), 1.0
    if name in WITHOUT_SLOW_PART:
        if np.isfinite(whole):
            least = 0.0
        else:
            sigma = np.hypot(over.run_column(f"{name}_sd"), over.grid[f"{name}_sd"].to_numpy())
    factor = max(float(np.nan_to_num(whole, nan=1.0)), least)
    octave = np.floor(np.log2(np.maximum(over.run_column("speed_mps"), _SLOWEST_MPS)))
    factors = np.full(len(ratio), factor)
    for band in np.unique(octave):
        rows = octave == band
        of_band = _spread(ratio[rows])
        if np.isfinite(of_band):
            factors[rows] = max(of_band, least)
    length = over.step_m * np.isfinite(ratio).sum()
    crossings = max(_crossings(ratio), FEWEST_CROSSINGS_PER_M * length) / length if length else FEWEST_CROSSINGS_PER_M
    sigma = factors * sigma
    if name == "gradient_permille":
        sigma = np.sqrt(sigma**2 + _steps_of_mean(over.grid, name, over.step_m))
    return ChangeNoise(sigma, factor, float(crossings), freedom_of(name))


def _steps_of_mean(grid: pd.DataFrame, name: str, step_m: float) -> Array:
    """Return the variance (n,) of the steps that a mean over runs makes where some of them begin or end.

    Every run has an offset of its own. The mean of some of the runs differs from that of all by the difference of the
    two variances: here from that of the runs thereabouts, to which the slow part belongs.
    """
    variance, observations = grid[f"{name}_sd"].to_numpy() ** 2, grid["observations"].to_numpy(float)
    others = np.abs(observations - slow_part(observations, step_m)) > _OTHER_RUNS
    steps = pd.Series(np.where(others, np.abs(variance - slow_part(variance, step_m)), 0.0))
    return steps.rolling(2 * round(0.5 * _SMOOTHED_M / step_m) + 1, center=True, min_periods=1).max().to_numpy()


def _spread(ratio: Array) -> float:
    """Return the robust sigma of the ratios that are known; NaN for a stretch with too few sign changes.

    A run that the map was made of alone differs from it by rounding, which shows nothing: its sigmas stay as stated.
    """
    if _crossings(ratio) < _LEAST_CROSSINGS:
        return np.nan
    spread = robust_sd(ratio[np.isfinite(ratio)])
    return spread if spread > _ROUNDING else 1.0


def _crossings(ratio: Array) -> int:
    """Return the number of sign changes between neighbours that are both known."""
    return int(np.sum(ratio[1:] * ratio[:-1] < 0.0))
