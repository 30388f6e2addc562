"""A smoothed run has its states and its tables in memory, before they become files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from trackfg.numerics.arrays import Array
from trackfg.output.calibration import calibration_table
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

    Sigmas are those of the model: ``verdicts`` say by what a result's are wider.
    """

    trajectory: pd.DataFrame
    geometry: pd.DataFrame
    places: PlaceCovariance
    timings_s: dict[str, float]
    verdicts: tuple[Verdict, ...] = ()
    located: Located | None = None
    on_line: RunOnLine | None = None

    def calibration(self, t: Array) -> pd.DataFrame:
        """Return the wheel scale and the inertial sensor's biases at times ``t`` (m,), s, each with its sigma: columns
        ``t_s, wheel_scale, accel_bias_{x,y,z}_mps2, gyro_bias_{x,y,z}_radps``, and these with ``_sd``.
        """
        return calibration_table(t, self.problem.t, self.problem.response, self.solution.states, self.covariance)

    @property
    def final_calibration(self) -> pd.Series:
        """The calibration at the last row of the trajectory."""
        return self.calibration(self.trajectory["t_s"].to_numpy()[-1:]).iloc[0]
