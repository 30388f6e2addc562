"""A smoothed run has its states and its tables in memory, before they become files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from trackfg.results.place_covariance import PlaceCovariance
from trackfg.results.verdict import Verdict
from trackfg.smoothing.reassessment import SolvedRun

if TYPE_CHECKING:
    import pandas as pd

    from trackfg.smoothing.known_line import RunOnLine
    from trackfg.smoothing.localisation import Located


@dataclass(frozen=True, kw_only=True)
class SmoothedStates(SolvedRun):
    """The solved run, and the tables made of it.

    ``calibration`` has, on the trajectory's clock, the wheel scale and the biases, each with its sigma: ``t_s,
    wheel_scale, gyro_bias_{x,y,z}_radps, accel_bias_{x,y,z}_mps2``. Sigmas are those of the model: ``verdicts`` say by
    what a result's are wider.
    """

    trajectory: pd.DataFrame
    geometry: pd.DataFrame
    places: PlaceCovariance
    calibration: pd.DataFrame
    timings_s: dict[str, float]
    verdicts: tuple[Verdict, ...] = ()
    located: Located | None = None
    on_line: RunOnLine | None = None
