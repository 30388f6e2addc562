"""What ``trackfg smooth`` gives back, in memory and as a folder.

==================  ==========================================================================================
file                content
==================  ==========================================================================================
trajectory.parquet  one row per instant of a uniform clock, columns :data:`TRAJECTORY_COLUMNS`
geometry.parquet    one row per 0.25 m of chainage, columns :data:`GEOMETRY_COLUMNS`, with lasers :data:`RAIL_COLUMNS`
                    too; the file's metadata (key ``trackfg``) hold :class:`GeometryConventions`
covariance.parquet  how errors of chainage and cross-level hang together (:mod:`trackfg.output.place_covariance`)
events.csv          one row per event, columns :data:`EVENT_COLUMNS`
summary.json        :class:`Summary`
==================  ==========================================================================================

Columns carry their unit as suffix; the 1-sigma of column ``x`` is column ``x_sd``, in the same unit.
"""

from __future__ import annotations

import io
import os
import platform
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Literal

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import BaseModel, ConfigDict, Field, JsonValue

from trackfg.errors import BadInputError
from trackfg.files.atomic_folder import replaced_folder
from trackfg.files.owned_folder import FolderKind
from trackfg.output.place_covariance import PlaceCovariance
from trackfg.recording.findings import Finding

_STATES = ("chainage_m", "east_m", "north_m", "up_m", "speed_mps", "roll_rad", "pitch_rad", "yaw_rad")

TRAJECTORY_COLUMNS = ("t_s", *(name for state in _STATES for name in (state, f"{state}_sd")))
"""``t_s``, then each state followed by its sigma. Chainage and position are those of the vehicle reference point."""

_CENTRE_GEOMETRY = (
    "curvature_1pm",
    "gradient_permille",
    "cross_level_mm",
    "twist_mm",
    "level_mm",
    "alignment_mm",
    "versine_level_mm",
    "versine_alignment_mm",
)
_RAIL_GEOMETRY = ("level_left_mm", "level_right_mm", "alignment_left_mm", "alignment_right_mm", "gauge_mm")

GEOMETRY_COLUMNS = (
    "chainage_m",
    "chainage_m_sd",
    "speed_mps",
    *(name for quantity in _CENTRE_GEOMETRY for name in (quantity, f"{quantity}_sd")),
)
"""The place, its sigma, the speed at which it was measured, then each quantity followed by its sigma."""

RAIL_COLUMNS = tuple(name for quantity in _RAIL_GEOMETRY for name in (quantity, f"{quantity}_sd"))
"""What lasers add: each rail by itself, and the gauge."""

EVENT_COLUMNS = (
    "kind",
    "start_s",
    "end_s",
    "chainage_m",
    "chainage_m_sd",
    "distance_removed_m",
    "distance_removed_m_sd",
    "detail",
)
"""``distance_removed_m`` is the tachometer's error over the event that the smoother took out, else empty."""

_EVENT_TEXT = ("kind", "detail")
_TRAJECTORY, _GEOMETRY, _COVARIANCE, _EVENTS, _SUMMARY = FILES = (
    "trajectory.parquet",
    "geometry.parquet",
    "covariance.parquet",
    "events.csv",
    "summary.json",
)


RESULT_FOLDER = FolderKind("result", _SUMMARY, "trackfg-result/", FILES)


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Estimate(_Model):
    """An estimated scalar and its 1-sigma, in the unit of the field that holds it."""

    value: float
    sd: float


class VectorEstimate(_Model):
    """An estimated vector in the body axes x, y, z and the 1-sigma of each."""

    value: tuple[float, float, float]
    sd: tuple[float, float, float]


class Solver(_Model):
    """How the solution was reached. ``cost`` is half the sum of squared whitened residuals after robust weights."""

    converged: bool
    reason: str
    iterations: int
    cost: float
    degrees_of_freedom: int


class GeometryConventions(_Model):
    """What the geometry columns mean. Lengths in m; see docs/geometry.md for the formulas.

    ``facing``: left is left when looking that way, whichever way the run went.
    """

    facing: Literal["increasing chainage"] = "increasing chainage"
    gauge_m: float
    cross_level_base_m: float
    step_m: float
    twist_base_m: float
    chord_m: float
    band_m: tuple[float, float]
    curvature_base_m: float
    gradient_base_m: float


class RunFacts(_Model):
    """What joining runs into a map needs to know of the recording.

    ``content_sha256`` tells the same measurements again, whatever the recording is called. ``anchored``: fixes told
    where on the line the run was; else chainage counts from its start. ``imu_id``: which sensor in which mounting, and
    ``mount_roll_sd_rad`` how well the roll of that is known. ``origin``: of east, north, up: WGS 84 latitude (deg),
    longitude (deg) and height (m), if GNSS told.
    """

    start: str | None = None
    content_sha256: str
    direction: Literal[1, -1]
    anchored: bool
    imu_id: str | None = None
    mount_roll_sd_rad: float
    origin: tuple[float, float, float] | None = None


class MapUse(_Model):
    """The map that the run was located on: its name and version, the share of the run that was recognised, and the
    probability that the place is right. Nothing of the map was used where ``sections`` is 0.
    """

    name: str
    version: int | None
    sections: int
    recognised_m: float
    probability: float
    found_after_m: float | None


class Summary(_Model):
    """The run in one page. Biases are those at the end of the run; what was not estimated is null.

    ``configuration`` is what was used, adapted noise levels included; ``noise_ratios`` says, per group of factors, how
    large the residuals are against what its sigmas lead to expect (1 is right; see
    :mod:`trackfg.solver.variance_components`).
    """

    format: Literal["trackfg-result/1"] = "trackfg-result/1"
    recording_id: str
    run: RunFacts | None = None
    map: MapUse | None = None
    versions: dict[str, str] = Field(default_factory=lambda: versions())
    configuration: dict[str, JsonValue]
    solver: Solver
    timings_s: dict[str, float]
    duration_s: float
    distance_m: float
    keyframes: int
    noise_ratios: dict[str, float] = Field(default_factory=dict)
    wheel_scale: Estimate | None = None
    clock_offset_s: Estimate | None = None
    gyro_bias_radps: VectorEstimate
    accel_bias_mps2: VectorEstimate
    geometry: GeometryConventions
    findings: tuple[Finding, ...] = ()


def versions() -> dict[str, str]:
    """The versions that a result depends on."""
    packages = ("trackfg", "gtsam", "numpy", "scipy", "pandas")
    return {"python": platform.python_version(), **{name: version(name) for name in packages}}


@dataclass(frozen=True)
class Result:
    """The smoothed run. Raises ``ValueError`` if a table has other columns than the contract's."""

    trajectory: pd.DataFrame
    geometry: pd.DataFrame
    events: pd.DataFrame
    summary: Summary
    covariance: PlaceCovariance = field(default_factory=PlaceCovariance.none)

    def __post_init__(self) -> None:
        with_rails = len(self.geometry.columns) > len(GEOMETRY_COLUMNS)
        geometry_columns = GEOMETRY_COLUMNS + RAIL_COLUMNS if with_rails else GEOMETRY_COLUMNS
        for table, columns in (
            (self.trajectory, TRAJECTORY_COLUMNS),
            (self.geometry, geometry_columns),
            (self.events, EVENT_COLUMNS),
        ):
            if tuple(table.columns) != columns:
                raise ValueError(f"columns {list(table.columns)}: expected {list(columns)}")

    @property
    def has_rails(self) -> bool:
        """Whether the geometry has each rail by itself and the gauge."""
        return RAIL_COLUMNS[0] in self.geometry

    def write(self, folder: str | os.PathLike[str]) -> Path:
        """Write the result, replacing an earlier one in one step (:mod:`trackfg.files.atomic_folder` says how).

        Killed at any moment, it leaves the old result, whole, or none where there was none. Raises
        :class:`BadInputError` if ``folder`` holds anything but a result.
        """
        folder = Path(folder)
        RESULT_FOLDER.refuse_foreign(folder)
        with replaced_folder(folder) as new:
            self.trajectory.to_parquet(new / _TRAJECTORY, index=False)
            pq.write_table(self._geometry_file(), new / _GEOMETRY)
            self.covariance.to_frame().to_parquet(new / _COVARIANCE, index=False)
            self.events.to_csv(new / _EVENTS, index=False)
            (new / _SUMMARY).write_text(self.summary.model_dump_json(indent=2) + "\n", encoding="utf-8")
        return folder

    def _geometry_file(self) -> pa.Table:
        table = pa.Table.from_pandas(self.geometry, preserve_index=False)
        conventions = self.summary.geometry.model_dump_json()
        return table.replace_schema_metadata({**(table.schema.metadata or {}), "trackfg": conventions})

    @classmethod
    def read(cls, folder: str | os.PathLike[str]) -> Result:
        """Read a result, also while another process replaces it. Raises :class:`BadInputError` if it is not one."""
        folder = Path(folder)
        content = RESULT_FOLDER.read(folder)
        try:
            return cls(
                trajectory=pd.read_parquet(io.BytesIO(content[_TRAJECTORY])),
                geometry=pd.read_parquet(io.BytesIO(content[_GEOMETRY])),
                events=pd.read_csv(
                    io.BytesIO(content[_EVENTS]),
                    dtype={name: "str" if name in _EVENT_TEXT else "float64" for name in EVENT_COLUMNS},
                    keep_default_na=False,
                    na_values={name: [""] for name in EVENT_COLUMNS if name not in _EVENT_TEXT},
                ),
                summary=Summary.model_validate_json(content[_SUMMARY]),
                covariance=PlaceCovariance.from_frame(pd.read_parquet(io.BytesIO(content[_COVARIANCE]))),
            )
        except (ValueError, OSError) as error:
            raise BadInputError(f"{folder}: not a readable trackfg result: {error}") from error
