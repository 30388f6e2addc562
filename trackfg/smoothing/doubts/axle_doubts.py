"""A frame on two axles sees the mean of the track under both: short waves come out too small.

No residual says so. Axles L apart leave cos(pi L / wavelength) of an amplitude in the path and in the roll: of waves of
10 m 0.71 with 2.5 m, 0.95 with 1 m. So a column y of the path lacks ``-L^2 y'' / 8``
(:mod:`trackfg.sensors.imu_filters.axles`). The heading of the chord lacks a third of that, but the graph holds it
between the chord's and the path's.

A sensor whose force its turning and its noise do not explain has a motion of its own. The graph explains such a body on
springs, too, by mounting, calibration and noise: its path leaves its heading by less than :mod:`path_doubts
<trackfg.smoothing.doubts.path_doubts>` look for.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from trackfg.factors.factor_type import FactorType
from trackfg.factors.motion import mount_matrix
from trackfg.numerics.arrays import Array
from trackfg.results.verdict import Doubt, Quantity
from trackfg.sensors.imu_filters.axles import Axles, axles, means, own_motion, track_sums
from trackfg.smoothing.doubts.usual_sigmas import COLUMNS, LEAST_WIDENING, WaveSums
from trackfg.smoothing.leaning_body import HINT, OF_TRACK
from trackfg.smoothing.reassessment import SolvedRun

_ALL: Mapping[Quantity, str] = {"cross_level": "cross_level_mm", **COLUMNS, "curvature": "curvature_1pm"}

_OVER_M = 0.5
"""A bend is that over so much to either side, m: shorter waves are noise."""

_FRAME_HINT = "put the sensor on one axle, or on a frame with axles closer to each other"


@dataclass(frozen=True)
class Bends:
    """The ``sums`` (5, 4) are the :class:`~trackfg.smoothing.doubts.usual_sigmas.WaveSums` of ``y''`` of each column
    of a geometry; y is in mm, the curvature in 1/m.
    """

    sums: Array

    @classmethod
    def of(cls, geometry: pd.DataFrame, step_m: float) -> Bends:
        """Return that of a geometry table with a row every ``step_m`` of each passage."""
        reach = max(1, round(_OVER_M / step_m))
        places = geometry["chainage_m"].to_numpy()
        sums = np.zeros((len(_ALL), 4))
        if len(places) > 2 * reach:
            inside = np.abs(np.abs(places[2 * reach :] - places[: -2 * reach]) - 2 * reach * step_m) < 0.5 * step_m
            for row, column in zip(sums, _ALL.values(), strict=True):
                y, sd = geometry[column].to_numpy(), geometry[f"{column}_sd"].to_numpy()
                bend = (y[2 * reach :] - 2.0 * y[reach:-reach] + y[: -2 * reach])[inside] / (reach * step_m) ** 2
                row[:] = WaveSums.of(bend, sd)
        return cls(sums)

    def __add__(self, other: Bends) -> Bends:
        return Bends(self.sums + other.sums)

    def doubts(self, frame: Axles) -> Iterator[Doubt]:
        """Yield doubts of the quantities of which such a frame misses more than their sigmas."""
        for (name, column), row in zip(_ALL.items(), self.sums.tolist(), strict=True):
            sums = WaveSums(*row)
            if sums.is_empty:
                continue
            missing = frame.apart_m**2 / 8.0 * sums.rms
            factor = sums.widening(missing)
            if factor >= LEAST_WIDENING:
                unit = column.rpartition("_")[2].replace("1pm", "1/m")
                reason = f"the sensor is on a frame whose axles are {frame.apart_m:.1f} m apart"
                yield Doubt((name,), factor, f"{reason}: {missing:.2g} {unit} of {name} are missing", _FRAME_HINT)


def axle_doubts(run: SolvedRun, geometry: pd.DataFrame) -> list[Doubt]:
    """Return doubts of the short waves that a frame on two axles, which follows the track, does not follow, and of the
    geometry where the sensor does not follow it.
    """
    if geometry.empty or run.problem.family(FactorType.PATH) is None:
        return []
    context, states = run.problem.run, run.solution.states
    speed = states.nav.own_velocity @ mount_matrix(states.mount)[0, :, 0]
    # Levels of noise that residuals show hold what the model does not explain: a motion of the sensor's own.
    sums = track_sums(means(context.inertial, run.declared.run.noise, context.t, speed))
    frame, share = axles(sums), own_motion(sums)
    doubts = [] if frame is None else list(Bends.of(geometry, context.conventions.step_m).doubts(frame))
    return doubts if share is None else [*doubts, Doubt(OF_TRACK, math.inf, own_in_words(share), HINT)]


def own_in_words(share: float) -> str:
    """Say what a share of the force is that is motion of the sensor's own."""
    return (
        f"of the force upwards on waves of 8 to 30 m {100 * share:.0f} % are neither noise nor what the sensor's "
        "turning shows of the track: the sensor is on springs and was declared rigid"
    )
