"""A feature map in memory: landmarks, grid, reference line, and the information of each run.

Everything faces increasing chainage, whichever way the runs went; SI units but where a column's suffix says otherwise;
the 1-sigma of column ``x`` is ``x_sd``, in the same unit. NaN: not known; an empty text: does not apply.

docs/maps-storage.md has every column.

**Landmarks**, one row each, ascending chainage: begin and end of transitions and of circles (BTC, BCC, ECC, ETC) and
named fixes. What is a circle's is that of the circle that the point belongs to, so the four points of a plain curve
repeat it. The transition between two circles of a compound curve is bounded by the ECC of the one and the BCC of the
next. Landmarks' chainages are correlated: ``covariance`` (n, n), m^2, in the order of the rows.

**Grid**, one row per cell that any run passed, chainage ascending on whole multiples of ``conventions.step_m``.

**Line**, the track's centre line as vertices in the map's frame: east, north, up of the tangent frame at ``origin``,
or a local frame of no known place where ``origin`` is None. A vertex with NaN position breaks the line.

**Runs**, one row per run: where it came from, and the unknowns it brought along,

    chainage in the map = offset_m + scale * chainage of the run,
    cross-level in the map = cross-level of the run - direction * cross_level_bias_mm.

**Information**: all that is kept of a run's data, so that a run is added without the data of the others. ``pooled`` is
that of all runs together, without the variables of single runs, so that a run is added to it alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from pydantic import JsonValue

from trackfg.numerics.arrays import Array
from trackfg.numerics.key_figures import KeyFigures, Outlined

CURVE_POINTS = ("BTC", "BCC", "ECC", "ETC")
"""Kinds of landmarks of a curve, in order of chainage."""
FIX = "fix"
"""Kind of a landmark that is a named fix."""


def _with_sd(*quantities: str) -> tuple[str, ...]:
    return tuple(name for quantity in quantities for name in (quantity, f"{quantity}_sd"))


LANDMARK_COLUMNS = (
    "landmark_id",
    "kind",
    "name",
    "curve_id",
    "sense",
    "law",
    *_with_sd("chainage_m", "radius_m", "transition_length_m", "arc_length_m", "cant_mm", "east_m", "north_m", "up_m"),
    "observations",
)
GRID_QUANTITIES = (
    "curvature_1pm",
    "gradient_permille",
    "cant_mm",
    "cross_level_mm",
    "versine_level_mm",
    "versine_alignment_mm",
)
GRID_COLUMNS = (
    *_with_sd("chainage_m", *GRID_QUANTITIES),
    "observations",
)
LINE_COLUMNS = ("chainage_m", *_with_sd("east_m", "north_m", "up_m"))
RUN_COLUMNS = (
    "run_id",
    "recording_id",
    "start",
    "content_sha256",
    "direction",
    *_with_sd("offset_m", "scale", "cross_level_bias_mm"),
)

TEXT_COLUMNS = frozenset(
    ("landmark_id", "kind", "name", "curve_id", "sense", "law", "run_id", "recording_id", "start", "content_sha256")
)
INTEGER_COLUMNS = frozenset(("observations", "direction"))

_EVERYWHERE_KNOWN = ("chainage_m", "chainage_m_sd", "observations", "direction")
_SIGMA_AGREES = 1e-6
"""Relative difference up to which the covariance's diagonal is the square of the sigmas: rounding."""
_FURTHEST_M = 1e7
"""Greatest chainage of a map, m: longer than any railway, and short enough for a profile without gaps in memory."""
_GREATEST = 1e9
"""Greatest number in a table that is no sigma: its square and products of it stay finite."""
_GREATEST_SD = 1e100
"""Greatest sigma: its square stays finite."""


@dataclass(frozen=True)
class MapConventions:
    """The meaning of a map's columns, as in :class:`trackfg.results.summary.GeometryConventions`; lengths in m.

    Raises ``ValueError`` for a length that is none.
    """

    gauge_m: float
    cross_level_base_m: float
    curvature_base_m: float
    gradient_base_m: float
    chord_m: float
    step_m: float = 0.25

    def __post_init__(self) -> None:
        for name, length in vars(self).items():
            if not (isinstance(length, int | float) and 0.0 < length < _FURTHEST_M):
                raise ValueError(f"{name} is {length!r}: expected a length in m")


@dataclass(frozen=True, repr=False)
class RunInformation(Outlined):
    """The information of a run on the map's variables x: ``R x = d + e``, ``e ~ N(0, I)``; R (m, n), d (m,).

    ``variables`` names the n columns, each in the unit that its name ends in: ``mark/ID/chainage_m``,
    ``mark/ID/cross_level_mm``, ``run/ID/offset_m``, ``sensor/ID/roll_mrad`` (:mod:`trackfg.mapping.joining.anchors`).
    """

    variables: tuple[str, ...]
    R: Array
    d: Array

    def __post_init__(self) -> None:
        if len(set(self.variables)) != len(self.variables):
            raise ValueError("a variable is named twice")
        if self.R.shape != (self.d.size, len(self.variables)) or self.d.ndim != 1:
            raise ValueError(f"R {self.R.shape}, d {self.d.shape}: expected (m, {len(self.variables)}) and (m,)")
        if not (np.isfinite(self.R).all() and np.isfinite(self.d).all()):
            raise ValueError("R and d: expected finite numbers")


@dataclass(frozen=True, eq=False, repr=False)
class FeatureMap(KeyFigures):
    """A version of the map of a line. Tables have the columns of this module, in their order.

    ``origin``: (latitude deg, longitude deg, height m) of WGS 84, or None. ``information`` by run id. ``configuration``
    and ``software`` (package: version) are what it was built with. ``version``, ``parent`` (the version it was made
    from) and ``written_at`` (UTC, ISO 8601) are given by :func:`trackfg.maps.write_map`; None before.

    Raises ``ValueError`` for tables that do not fit this description or each other.

    Examples
    --------
    >>> from trackfg.maps import read_map
    >>> line = read_map("line.gpkg")
    >>> list(line.grid.columns)[:3]
    ['chainage_m', 'chainage_m_sd', 'curvature_1pm']
    >>> line.runs["run_id"].tolist()
    ['mainline-seed1-run0']
    """

    name: str
    conventions: MapConventions
    landmarks: pd.DataFrame
    covariance: Array
    grid: pd.DataFrame
    line: pd.DataFrame
    runs: pd.DataFrame
    information: Mapping[str, RunInformation]
    configuration: Mapping[str, JsonValue]
    software: Mapping[str, str]
    origin: tuple[float, float, float] | None = None
    pooled: RunInformation | None = None
    version: int | None = field(default=None, kw_only=True)
    parent: int | None = field(default=None, kw_only=True)
    written_at: str | None = field(default=None, kw_only=True)

    def key_figures(self) -> dict[str, str]:
        """Return the version, the length, and how many runs and landmarks there are."""
        return {
            "map": self.name,
            "version": "not written" if self.version is None else f"version {self.version}",
            "length": f"{1e-3 * len(self.grid) * self.conventions.step_m:.3f} km",
            "runs": f"{len(self.runs)} runs",
            "landmarks": f"{len(self.landmarks)} landmarks",
        }

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or "\0" in self.name:
            raise ValueError(f"name {self.name!r}: expected text")
        if not all(isinstance(text, str) for text in self.software.values()):
            raise ValueError(f"software {dict(self.software)!r}: expected versions as text")
        has_head = isinstance(self.written_at, str | None) and isinstance(self.parent, int | None)
        if not has_head:
            raise ValueError(f"written_at {self.written_at!r}, parent {self.parent!r}: expected a time and a version")
        for what, table, columns in (
            ("landmarks", self.landmarks, LANDMARK_COLUMNS),
            ("grid", self.grid, GRID_COLUMNS),
            ("line", self.line, LINE_COLUMNS),
            ("runs", self.runs, RUN_COLUMNS),
        ):
            _check_table(what, table, columns)
        self._check_landmarks()
        self._check_grid()
        self._check_runs()
        if self.origin is not None and not (abs(self.origin[0]) <= 90.0 and abs(self.origin[1]) <= 360.0):
            raise ValueError(f"origin {self.origin}: expected latitude and longitude in degrees and a height")

    def _check_landmarks(self) -> None:
        table, n = self.landmarks, len(self.landmarks)
        if not table["landmark_id"].is_unique:
            raise ValueError("landmarks: expected every landmark_id once")
        _one_of("landmarks", table["kind"], (*CURVE_POINTS, FIX))
        _one_of("landmarks", table["sense"], ("left", "right", ""))
        if np.any(table["radius_m"] <= 0.0):
            raise ValueError("landmarks: radius_m: expected positive numbers")
        if not table["chainage_m"].is_monotonic_increasing:
            raise ValueError("landmarks: expected ascending chainage_m")
        if self.covariance.shape != (n, n):
            raise ValueError(f"covariance {self.covariance.shape}: expected {(n, n)}, as many as landmarks")
        sd = table["chainage_m_sd"].to_numpy()
        rounding = _SIGMA_AGREES * np.max(sd, initial=0.0) ** 2
        if not np.allclose(self.covariance, self.covariance.T, rtol=0.0, atol=rounding):
            raise ValueError("covariance: expected a symmetric matrix of finite numbers")
        if not np.allclose(np.diag(self.covariance), sd**2, rtol=_SIGMA_AGREES, atol=0.0):
            raise ValueError("covariance: expected the squares of chainage_m_sd on the diagonal")

    def _check_grid(self) -> None:
        cells = self.grid["chainage_m"].to_numpy() / self.conventions.step_m
        if np.any(np.diff(cells) <= 0.5) or np.any(np.abs(cells - np.round(cells)) > 1e-6):
            raise ValueError(f"grid: expected ascending chainage_m on whole multiples of {self.conventions.step_m:g} m")
        if np.any(np.diff(self.line["chainage_m"].to_numpy()) < 0.0):
            raise ValueError("line: expected ascending chainage_m")

    def _check_runs(self) -> None:
        for name in ("run_id", "content_sha256"):
            if not self.runs[name].is_unique:
                raise ValueError(f"runs: expected every {name} once")
        _one_of("runs", self.runs["direction"], (1, -1))
        if unknown := sorted(set(self.information) - set(self.runs["run_id"])):
            raise ValueError(f"information of {', '.join(unknown)}: not among the runs")


def _check_table(what: str, table: pd.DataFrame, columns: tuple[str, ...]) -> None:
    if tuple(table.columns) != columns:
        raise ValueError(f"{what}: columns {list(table.columns)}: expected {list(columns)}")
    for name in set(columns) - TEXT_COLUMNS:
        kinds, expected = ("iu", "integers") if name in INTEGER_COLUMNS else ("f", "floats")
        if table[name].dtype.kind not in kinds:
            raise ValueError(f"{what}: {name} is {table[name].dtype}: expected {expected}")
        values = table[name].to_numpy()
        finite = np.isfinite(values)
        if np.any(np.isinf(values)) or (name in _EVERYWHERE_KNOWN and not finite.all()):
            raise ValueError(f"{what}: {name}: expected finite numbers")
        if name.endswith("_sd") and np.any(values[finite] < 0.0):
            raise ValueError(f"{what}: {name}: expected no negative sigma")
        greatest = _FURTHEST_M if name == "chainage_m" else _GREATEST_SD if name.endswith("_sd") else _GREATEST
        if np.any(np.abs(values[finite]) > greatest):
            raise ValueError(f"{what}: {name}: expected numbers up to {greatest:g}")
    for name in TEXT_COLUMNS.intersection(columns):
        if not all(isinstance(text, str) and "\0" not in text for text in table[name]):
            raise ValueError(f"{what}: {name}: expected text")


def _one_of(what: str, values: pd.Series, allowed: tuple[object, ...]) -> None:
    if not values.isin(allowed).all():
        raise ValueError(f"{what}: {values.name}: expected one of {', '.join(repr(value) for value in allowed)}")
