"""What one run says of a map's variables.

A map's variables are, for marks some 250 m apart, ``M_j``, the chainage at which a mark's stretch of track lies, and
``C_j``, its mean cross-level; and the roll ``b`` of each sensor's mounting that is not known. A mark is no post: it is
the track around it, known again by its profile. Facing increasing chainage, a run that saw mark j at its own chainage
``D_j``, with mean cross-level ``c_j``, says

    M_j - o        = D_j + (its chainage's error there) + (error of recognising the place),
    C_j + g B b    = c_j + (its cross-level's error there),

with the offset ``o`` of a run that no fix told where it was (else 0), ``g`` its direction, ``B`` the cross-level base.
The errors' joint covariance P is the marginal of the run's own graph (:mod:`trackfg.output.place_covariance`); so with
``P = L L'`` the rows ``L^-1 [...]`` are all that the run's graph, every state of it eliminated, says about them. In
runs both ways ``g`` changes sign, which is what tells b from C.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.linalg import cholesky, solve_triangular

from trackfg.maps.feature_map import RunInformation
from trackfg.numerics.arrays import Array
from trackfg.results.place_covariance import PlaceCovariance

WINDOW_M = 100.0
"""The length of track over which the cross-level of a mark is the mean."""

_LEAST_SD_M = 5e-3
_LEAST_SD_MM = 0.02
"""What linear interpolation between places of the covariance leaves out."""

_WRONG_SIGMAS = 5.0


def chainage_variable(mark: str) -> str:
    """The name of M_j, m."""
    return f"mark/{mark}/chainage_m"


def cross_level_variable(mark: str) -> str:
    """The name of C_j, mm."""
    return f"mark/{mark}/cross_level_mm"


def offset_variable(run_id: str) -> str:
    """The name of the offset of a run's chainage, m."""
    return f"run/{run_id}/offset_m"


def roll_variable(sensor: str) -> str:
    """The name of a sensor's roll in its mounting, mrad."""
    return f"sensor/{sensor}/roll_mrad"


@dataclass(frozen=True)
class Sightings:
    """The marks (m,) that a run saw: at its own ``chainage_m``, recognised to ``match_sd_m`` (0: it is the one that
    made the mark), with mean ``cross_level_mm`` (NaN: not known). Each (m,), in order of chainage.
    """

    marks: tuple[str, ...]
    chainage_m: Array
    match_sd_m: Array
    cross_level_mm: Array

    def __getitem__(self, rows: np.ndarray) -> Sightings:
        marks = tuple(self.marks[i] for i in np.arange(len(self.marks))[rows])
        return Sightings(marks, self.chainage_m[rows], self.match_sd_m[rows], self.cross_level_mm[rows])


@dataclass(frozen=True)
class Sensor:
    """A sensor whose roll in its mounting is not known, and so a variable of the map.

    ``roll_sd_rad``: prior sigma of the roll about 0, greater than 0; None where an earlier run of the sensor brought it
    into the map. ``mm_per_mrad``: the cross-level facing increasing chainage that a roll of 1 mrad makes, direction
    times base (m).
    """

    name: str
    roll_sd_rad: float | None
    mm_per_mrad: float


def said_of_marks(
    run_id: str, seen: Sightings, errors: PlaceCovariance, sensor: Sensor | None, *, anchored: bool
) -> RunInformation:
    """Return the rows of a run. ``sensor`` is None where the roll of its mounting is known: ``b`` is then no variable.

    The first run of a sensor brings the prior of its roll.
    """
    m = len(seen.marks)
    covariance = errors.at(seen.chainage_m)
    covariance[np.diag_indices(2 * m)] += np.r_[seen.match_sd_m**2 + _LEAST_SD_M**2, np.full(m, _LEAST_SD_MM**2)]
    level = np.flatnonzero(np.isfinite(seen.cross_level_mm))
    kept = np.r_[np.arange(m), m + level]
    variables = [chainage_variable(mark) for mark in seen.marks]
    variables += [cross_level_variable(seen.marks[i]) for i in level]
    H = np.eye(len(kept))
    if level.size and sensor is not None:
        variables.append(roll_variable(sensor.name))
        H = np.column_stack([H, np.r_[np.zeros(m), np.full(level.size, sensor.mm_per_mrad)]])
    if not anchored:
        variables.append(offset_variable(run_id))
        H = np.column_stack([H, np.r_[np.full(m, -1.0), np.zeros(level.size)]])
    L = cholesky(covariance[np.ix_(kept, kept)], lower=True)
    values = np.r_[seen.chainage_m, seen.cross_level_mm[level]]
    R, d = solve_triangular(L, H, lower=True), solve_triangular(L, values, lower=True)
    if level.size and sensor is not None and sensor.roll_sd_rad is not None:
        prior = np.zeros((1, len(variables)))
        prior[0, variables.index(roll_variable(sensor.name))] = 1e-3 / sensor.roll_sd_rad
        R, d = np.concatenate([R, prior]), np.r_[d, 0.0]
    return RunInformation(tuple(variables), R, d)


def seen_by(information: RunInformation) -> pd.Series[float]:
    """The run's own values of the marks' variables, by name: what :func:`said_of_marks` was given."""
    names = [name for name in information.variables if name.startswith("mark/")]
    R, d = information.R[: len(names), : len(names)], information.d[: len(names)]
    return pd.Series(solve_triangular(R, d, lower=True), index=names)


def without_wrong(
    seen: Sightings, errors: PlaceCovariance, chainage: Array, covariance: Array, *, anchored: bool
) -> np.ndarray:
    """Which sightings agree with the map, which has the marks at ``chainage`` with ``covariance`` (m, m). Bool (m,).

    One is wrong where the error of its match, as the others lead to expect it, is more than five of its sigmas: with
    the innovations v and their covariance S that is ``(S^-1 v)_j / sqrt((S^-1)_jj)``. The worst goes, then again.
    """
    m = len(seen.marks)
    P = errors.at(seen.chainage_m)[:m, :m] + covariance
    P[np.diag_indices(m)] += seen.match_sd_m**2 + _LEAST_SD_M**2
    if not anchored:
        P += np.max(np.diag(P)) * 1e4
    good = np.ones(m, dtype=bool)
    while good.sum() > 2:
        inverse = np.linalg.inv(P[np.ix_(good, good)])
        surprise = np.abs(inverse @ (chainage - seen.chainage_m)[good]) / np.sqrt(np.diag(inverse))
        worst = int(np.argmax(surprise))
        if surprise[worst] <= _WRONG_SIGMAS:
            break
        good[np.flatnonzero(good)[worst]] = False
    return good


def sensor_of(name: str | None, run_id: str) -> str:
    """The sensor's own name, or one that no other run has."""
    return run_id if name is None else name


def mark_names(places: Sequence[float] | Array) -> list[str]:
    """Of marks made at these chainages, whole metres."""
    return [f"{place:.0f}" for place in places]
