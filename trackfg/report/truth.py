"""The truth that a recording holds, and the errors of a result against it."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property

import pandas as pd

from trackfg.errors import BadInputError
from trackfg.evaluation.geometry_errors import geometry_errors
from trackfg.evaluation.trajectory_errors import from_the_true_start, trajectory_errors
from trackfg.io.description_reader import read_description
from trackfg.io.truth import has_truth, read_truth, read_truth_geometry
from trackfg.results.result import Result


@dataclass(frozen=True)
class Against:
    """A result beside the truth: ``trajectory`` has ``t_s, chainage_m`` and more, ``geometry`` is None where there is
    none.
    """

    result: Result
    trajectory: pd.DataFrame
    geometry: pd.DataFrame | None

    @cached_property
    def geometry_errors(self) -> pd.DataFrame:
        """Return the errors as of :func:`trackfg.evaluation.geometry_errors.geometry_errors`; no columns but the place
        without a true geometry.
        """
        truth = self.geometry
        if truth is None or self.result.geometry.empty:
            return pd.DataFrame({"chainage_m": [], "speed_mps": []})
        return geometry_errors(self.result.geometry, self.result.trajectory, self.trajectory, truth)

    @cached_property
    def trajectory_errors(self) -> pd.DataFrame:
        """Return the errors as of :func:`trackfg.evaluation.trajectory_errors.trajectory_errors`; those of the place
        along the track from the true start where nothing said where the run began.
        """
        trajectory = self.result.trajectory
        if not self.knows_its_start:
            trajectory = from_the_true_start(trajectory, self.trajectory)
        return trajectory_errors(trajectory, self.trajectory)

    @property
    def knows_its_start(self) -> bool:
        """Return whether fixes or a map gave the chainage, which else counts from the start of the run."""
        summary = self.result.summary
        is_located = summary.map is not None and summary.map.sections > 0
        return is_located or (summary.run is not None and summary.run.anchored)


def is_without_truth(recording: str | os.PathLike[str]) -> bool:
    """Return whether a recording, which can be read, has no truth: a page shows no errors then."""
    return not has_truth(os.fspath(recording))


def against(result: Result, recording: str | os.PathLike[str]) -> Against | None:
    """Return the truth of the recording that the result was made from; None if it has none.

    Raises :class:`BadInputError` if it is another recording, or cannot be read.
    """
    path = os.fspath(recording)
    truth_exists = has_truth(path)
    description = read_description(path).description
    name = result.summary.recording_id
    if description is not None and description.id != name:
        raise BadInputError(f"{path}: is the recording {description.id!r}; expected {name!r}, which the result is of")
    if not truth_exists:
        return None
    truth, geometry = read_truth(path), read_truth_geometry(path)
    if "chainage_m" not in truth:
        raise BadInputError(f"{path}: the truth has no chainage_m; expected t_s and chainage_m at least")
    return Against(result, truth, geometry)
