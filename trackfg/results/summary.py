"""The summary of a result: what the solver did, what it estimated of the sensors, and which conventions hold."""

from __future__ import annotations

import math
import platform
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, JsonValue

from trackfg.numerics.kernels import kernels_in_use
from trackfg.numerics.key_figures import outline
from trackfg.recording.description import rail_head_m
from trackfg.recording.findings import Finding
from trackfg.recording.line_kilometrage import LineKilometrage
from trackfg.recording.strict_model import Model
from trackfg.results.verdict import Verdict

Sigma = Annotated[float, Field(gt=0)]
Length = Annotated[float, Field(ge=1e-3, le=1e4)]
"""m."""


class Estimate(Model):
    """An estimated scalar and its 1-sigma, in the unit of the field that holds it; null where no sigma is right."""

    value: float
    sd: Sigma | None


class VectorEstimate(Model):
    """An estimated vector in the body axes x, y, z and the 1-sigma of each; null where no sigma is right."""

    value: tuple[float, float, float]
    sd: tuple[Sigma, Sigma, Sigma] | None


class Mounting(Model):
    """The mounting of the sensor as the motion shows it, in the axes of the IMU as declared.

    The direction of travel is turned to the left by ``yaw_rad`` and then downwards by ``pitch_rad``. The point that
    follows the track is ``tracking_point_m`` from the vehicle reference point.
    """

    pitch_rad: Estimate
    yaw_rad: Estimate
    tracking_point_m: VectorEstimate


def utc(text: str) -> datetime:
    """Return a time of ISO 8601 in UTC, which it is in unless it names an offset. Raises ``ValueError`` for others."""
    time = datetime.fromisoformat(text)
    return time.replace(tzinfo=UTC) if time.tzinfo is None else time.astimezone(UTC)


class Solver(Model):
    """The way to the solution. ``cost`` is half the sum of squared whitened residuals after robust weights."""

    converged: bool
    reason: str
    iterations: int
    cost: float
    degrees_of_freedom: int


class GeometryConventions(Model):
    """The meaning of the geometry columns. Lengths in m; see docs/geometry.md for the formulas.

    ``facing``: left is left when looking that way, whichever way the run went. ``twist_anchor``: where the base of the
    twist lies, seen from the place that it is written at.
    """

    facing: Literal["increasing chainage"] = "increasing chainage"
    gauge_m: Length
    cross_level_base_m: Length
    step_m: Length
    twist_base_m: Length
    twist_anchor: Literal["behind", "centre", "ahead"] = "behind"
    chord_m: Length
    band_m: tuple[Length, Length]
    curvature_base_m: Length
    gradient_base_m: Length

    @property
    def tops_apart_m(self) -> float:
        """The distance between the middles of the rails' tops, m."""
        return self.gauge_m + rail_head_m(self.gauge_m, self.cross_level_base_m)

    @property
    def twist_base(self) -> str:
        """The base of the twist in words: ``5 m``, ``3 m ahead``, ``3 m centred``."""
        where = {"behind": "", "centre": " centred", "ahead": " ahead"}[self.twist_anchor]
        return f"{self.twist_base_m:g} m{where}"


class RunFacts(Model):
    """The facts of a recording that joining runs into a map needs.

    ``content_sha256`` identifies the same measurements, whatever the recording is called; ``files_sha256`` the same
    files, byte by byte (:mod:`trackfg.io.content`), null where it was not read from files. ``anchored``: fixes gave the
    chainage, which else counts from the start of the run. ``imu_id``: which sensor in which mounting, and
    ``mount_roll_sd_rad`` how well the roll of that is known. ``origin``: of east, north, up: WGS 84 latitude (deg),
    longitude (deg) and height (m), if there was GNSS. ``kilometrage``: that of the line, if the recording has it.
    """

    start: str | None = None
    content_sha256: str
    files_sha256: str | None = None
    direction: Literal[1, -1]
    anchored: bool
    imu_id: str | None = None
    mount_roll_sd_rad: float
    origin: tuple[float, float, float] | None = None
    kilometrage: LineKilometrage | None = None

    @property
    def start_utc(self) -> datetime | None:
        """The time when the run began, in UTC; None where its recording has no start."""
        return None if self.start is None else utc(self.start)


class MapUse(Model):
    """The map that the run was located on: its name and version, when that was written, the share of the run that was
    recognised, and the probability that the place is right. Nothing of the map was used where ``sections`` is 0.
    """

    name: str
    version: int | None
    written_at: str | None = None
    sections: int
    recognised_m: float
    probability: float
    found_after_m: float | None


class LineStretch(Model):
    """A stretch of the run and the track of a known line that it is on.

    ``status``: ``on``, the track is known and was used; ``undecided`` among ``tracks``; ``disagrees``, the run keeps
    ``across_m`` away from it; ``absent``, no track of the file is there. ``probability``: that of the status and the
    track; ``tracks``: that of each track. ``across_m``: where the run is, without the line, to the left of the track's
    direction, on average, with the sigma of run and line together.
    """

    status: Literal["on", "undecided", "disagrees", "absent"]
    track: str | None
    probability: float
    tracks: dict[str, float]
    start_s: float
    end_s: float
    start_chainage_m: float
    end_chainage_m: float
    across_m: float | None
    across_m_sd: Sigma | None


class LineUse(Model):
    """The known line that the run was smoothed with: its file, and which track the run is on from where to where.

    ``content_sha256`` is the digest of a file that was given beside the recording; of one that is part of the recording
    it is null, since the recording's own digest has it.
    """

    name: str
    content_sha256: str | None = None
    stretches: tuple[LineStretch, ...]

    def length_m(self, status: str) -> float:
        """Return the length of all stretches of a status, m."""
        return sum(abs(s.end_chainage_m - s.start_chainage_m) for s in self.stretches if s.status == status)


def _finite(value: JsonValue) -> JsonValue:
    """Return a value of JSON. Raises ``ValueError`` where a number of it, at any depth, is NaN or infinite."""
    if isinstance(value, dict | list):
        for part in value.values() if isinstance(value, dict) else value:
            _finite(part)
    elif isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"{value} is no number of JSON")
    return value


FiniteJson = Annotated[JsonValue, AfterValidator(_finite)]
"""What JSON holds; Python's own readers take NaN and infinity for JSON too."""


class Summary(Model):
    """The run in one page. Biases are those at the end of the run; what was not estimated or determined is null.

    ``settings`` is what was asked for, defaults included, ``configuration`` what was used in the end, adapted noise
    levels included; ``further_scales`` has true over measured distance of each further sensor with rows, by the name of
    its table, such as ``tach/2``. ``clock_offset_s`` is added to the tachometer's stamps, ``gnss_clock_offset_s`` to
    those of positions. ``gnss_speed_offset_mps`` is by what a receiver's own speeds are too high,
    ``gnss_speed_clock_offset_s`` what is added to their stamps. ``noise_ratios`` says, per group of factors, how large
    the residuals are against what its sigmas lead to expect (1 is right; see
    :mod:`trackfg.solver.variance_components`). ``verdicts`` says whether the sigmas of each quantity can be trusted;
    results of versions before it have none. ``solver`` and the biases are null where another system measured the
    geometry: nothing was smoothed.
    """

    format: Literal["trackfg-result/1"] = "trackfg-result/1"
    recording_id: str
    run: RunFacts | None = None
    map: MapUse | None = None
    line: LineUse | None = None
    versions: dict[str, str] = Field(default_factory=lambda: versions())
    settings: dict[str, FiniteJson] | None = None
    configuration: dict[str, FiniteJson]
    solver: Solver | None = None
    timings_s: dict[str, float]
    duration_s: float
    distance_m: float | None
    keyframes: int
    noise_ratios: dict[str, float] = Field(default_factory=dict)
    wheel_scale: Estimate | None = None
    further_scales: dict[str, Estimate] = Field(default_factory=dict)
    clock_offset_s: Estimate | None = None
    gnss_clock_offset_s: Estimate | None = None
    gnss_speed_offset_mps: Estimate | None = None
    gnss_speed_clock_offset_s: Estimate | None = None
    mounting: Mounting | None = None
    gyro_bias_radps: VectorEstimate | None = None
    accel_bias_mps2: VectorEstimate | None = None
    geometry: GeometryConventions
    findings: tuple[Finding, ...] = ()
    verdicts: tuple[Verdict, ...] = ()

    def __repr__(self) -> str:
        return outline(self, type(self).model_fields)

    __str__ = __repr__

    @property
    def converged(self) -> bool:
        """Return whether the solver converged; true where there was none."""
        return self.solver is None or self.solver.converged

    @property
    def reason(self) -> str:
        """Return why the solver stopped, or that there was none."""
        return "measured by another system" if self.solver is None else self.solver.reason


def versions() -> dict[str, str]:
    """Return the versions that a result depends on, and whether ``kernels`` were ``compiled`` or ``numpy``."""
    return {"python": platform.python_version(), **_installed(), "kernels": kernels_in_use()}


@cache
def _installed() -> dict[str, str]:
    """Return the versions of packages: what is installed says so in texts of hundreds of lines, which are read once."""
    return {name: version(name) for name in ("trackfg", "gtsam", "numpy", "scipy", "pandas")}
