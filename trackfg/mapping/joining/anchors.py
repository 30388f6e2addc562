"""A run's information on the map's variables, all states of the run eliminated.

The variables are, for *anchors* some 250 m apart, the chainage ``M_j`` at which an anchor's stretch of track lies and
its mean cross-level ``C_j``; and the roll ``b`` of each sensor's mounting that is not known. An anchor is no post
beside the track: it is the track about it, recognised by its profile. A run that sighted anchor j at its own chainage
``D_j``, with mean cross-level ``c_j`` (facing increasing chainage), gives

    M_j - o        = D_j + (error of its chainage there) + (error of the match),
    C_j + g B b    = c_j + (error of its cross-level there),

with ``o`` the offset of a run that had no fix (else 0), ``g`` its direction and ``B`` the cross-level base. The errors'
joint covariance P is the marginal of the run's own graph (:mod:`trackfg.output.place_covariance`). With ``P = L L'``
the rows ``L^-1 [...]`` are whitened and contain all that the run's graph knows of the variables. In runs both ways
``g`` changes sign, which separates b from C.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.linalg import cholesky, solve_triangular

from trackfg.maps.feature_map import RunInformation
from trackfg.numerics.arrays import Array
from trackfg.results.place_covariance import PlaceCovariance

WINDOW_M = 100.0
"""Length of track over which the cross-level of an anchor is the mean, m."""

_LEAST_SD_M = 5e-3
"""Least sigma of a sighted chainage, m: the error of linear interpolation between places of the covariance."""
_LEAST_SD_MM = 0.02
"""Least sigma of a sighted cross-level, mm: the same."""

WRONG_SIGMAS = 5.0
"""Innovation, in sigmas, above which a sighting is left out: one normal value in 1.7 million."""


def chainage_variable(anchor: str) -> str:
    """Return the name of M_j, m."""
    return f"mark/{anchor}/chainage_m"


def cross_level_variable(anchor: str) -> str:
    """Return the name of C_j, mm."""
    return f"mark/{anchor}/cross_level_mm"


def offset_variable(run_id: str) -> str:
    """Return the name of the offset of a run's chainage, m."""
    return f"run/{run_id}/offset_m"


def is_chainage(variable: str) -> bool:
    """Return whether a variable is the chainage of an anchor."""
    return variable.endswith("/chainage_m")


def is_offset(variable: str) -> bool:
    """Return whether a variable is the offset of a run."""
    return variable.startswith("run/")


def roll_variable(sensor: str) -> str:
    """Return the name of the roll of a sensor's mounting, mrad."""
    return f"sensor/{sensor}/roll_mrad"


@dataclass(frozen=True)
class Sightings:
    """The anchors (m,) that a run passed, in order of its chainage.

    ``chainage_m``: where, by its own chainage. ``match_sd_m``: sigma of the match; 0 for anchors that this run defines.
    ``cross_level_mm``: mean cross-level, NaN where not known. Each (m,).
    """

    anchors: tuple[str, ...]
    chainage_m: Array
    match_sd_m: Array
    cross_level_mm: Array

    def __getitem__(self, rows: np.ndarray) -> Sightings:
        anchors = tuple(self.anchors[i] for i in np.arange(len(self.anchors))[rows])
        return Sightings(anchors, self.chainage_m[rows], self.match_sd_m[rows], self.cross_level_mm[rows])


@dataclass(frozen=True)
class Sensor:
    """A sensor whose roll in its mounting is not known, and so a variable of the map.

    ``mm_per_mrad``: the cross-level facing increasing chainage that a roll of 1 mrad makes, direction times base (m).
    """

    name: str
    mm_per_mrad: float


def information_on_anchors(
    run_id: str, seen: Sightings, errors: PlaceCovariance, sensor: Sensor | None, *, anchored: bool
) -> RunInformation:
    """Return the rows of a run; without a ``sensor`` the roll of its mounting is known, and ``b`` no variable."""
    m = len(seen.anchors)
    covariance = errors.at(seen.chainage_m)
    covariance[np.diag_indices(2 * m)] += np.r_[seen.match_sd_m**2 + _LEAST_SD_M**2, np.full(m, _LEAST_SD_MM**2)]
    level = np.flatnonzero(np.isfinite(seen.cross_level_mm))
    kept = np.r_[np.arange(m), m + level]
    variables = [chainage_variable(anchor) for anchor in seen.anchors]
    variables += [cross_level_variable(seen.anchors[i]) for i in level]
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
    return RunInformation(tuple(variables), R, d)


def with_roll_prior(information: RunInformation, sensor: str, roll_sd_rad: float) -> RunInformation:
    """Return the rows of a run with the prior of its sensor's roll, if they say anything of the roll."""
    roll = roll_variable(sensor)
    if roll not in information.variables:
        return information
    prior = np.zeros((1, len(information.variables)))
    prior[0, information.variables.index(roll)] = 1e-3 / roll_sd_rad
    return RunInformation(information.variables, np.concatenate([information.R, prior]), np.append(information.d, 0.0))


def sighted_values(information: RunInformation) -> pd.Series[float]:
    """Return the run's own values of the anchors' variables, by name: the inverse of :func:`information_on_anchors`."""
    names = [name for name in information.variables if name.startswith("mark/")]
    R, d = information.R[: len(names), : len(names)], information.d[: len(names)]
    return pd.Series(solve_triangular(R, d, lower=True), index=names)


def agreeing_sightings(
    seen: Sightings, errors: PlaceCovariance, chainage: Array, covariance: Array, *, anchored: bool
) -> np.ndarray:
    """Return which sightings agree with the map, bool (m,).

    The map has the anchors at ``chainage`` (m,) with ``covariance`` (m, m).

    The test is on the innovation of one sighting given all others: with the innovations v and their covariance S it is
    ``(S^-1 v)_j``, of sigma ``sqrt((S^-1)_jj)``. The sighting with the largest is left out if it is above five sigmas,
    then the test is repeated.
    """
    m = len(seen.anchors)
    P = _innovation_covariance(seen, errors, covariance)
    if not anchored:
        P += np.max(np.diag(P)) * 1e4
    good = np.ones(m, dtype=bool)
    while good.sum() > 2:
        inverse = np.linalg.inv(P[np.ix_(good, good)])
        surprise = np.abs(inverse @ (chainage - seen.chainage_m)[good]) / np.sqrt(np.diag(inverse))
        worst = int(np.argmax(surprise))
        if surprise[worst] <= WRONG_SIGMAS:
            break
        good[np.flatnonzero(good)[worst]] = False
    return good


def offset_of_run(seen: Sightings, errors: PlaceCovariance, chainage: Array, covariance: Array) -> tuple[float, float]:
    """Return the constant offset of a run's chainage from the map's, and its sigma, m.

    Both count from the same place, as :func:`agreeing_sightings` has them: what all sightings have in common is what
    no sighting by itself shows.
    """
    weights = np.linalg.solve(_innovation_covariance(seen, errors, covariance), np.ones(len(seen.anchors)))
    total = float(weights.sum())
    return float(weights @ (seen.chainage_m - chainage)) / total, total**-0.5


def _innovation_covariance(sightings: Sightings, errors: PlaceCovariance, covariance: Array) -> Array:
    """Return the covariance of what sightings differ by from the map's anchors, (m, m)."""
    m = len(sightings.anchors)
    P = errors.at(sightings.chainage_m)[:m, :m] + covariance
    P[np.diag_indices(m)] += sightings.match_sd_m**2 + _LEAST_SD_M**2
    return np.asarray(P)


def sensor_name(name: str | None, run_id: str) -> str:
    """Return the sensor's id, or for a sensor without one a name that no other run has."""
    return run_id if name is None else name
