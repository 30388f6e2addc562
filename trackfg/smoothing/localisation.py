"""Localisation of a run on a map: its profile is recognised there, and the run is solved again with that.

The run is smoothed by itself first. Where its profile lies on the map's
(:mod:`trackfg.mapping.recognition.recognition`) becomes landmark factors, one per recognised section, with the sigma of
the match and a robust loss, so that a wrong match is an outlier and no jump. Where nothing is recognised, or several
places are as likely, there is no factor and the chainage's sigma grows.

All chainages are the map's then. The errors that all matches have in common are added to their variance at the end: the
map's own, and, for a sensor on springs, that its body follows the track's curves late. A fix, which does not depend on
the map, is given a sigma that contains the map's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from trackfg.config import PositionConfig
from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, changed
from trackfg.factors.landmark import landmark
from trackfg.factors.loss import Cauchy, Loss
from trackfg.factors.states import States
from trackfg.graph.build import Problem
from trackfg.graph.priors import with_free_start
from trackfg.mapping.recognition.conventions import check_conventions, recognised_near
from trackfg.numerics.arrays import Array
from trackfg.output.profiles import Profile
from trackfg.recording.findings import Finding
from trackfg.recording.line_kilometrage import LineKilometrage
from trackfg.results.official_places import kilometrage_of_map
from trackfg.results.summary import MapUse
from trackfg.solver.covariance import Covariance

if TYPE_CHECKING:
    from trackfg.maps.feature_map import FeatureMap

_LEAST_SD_M = 0.01
"""Least sigma of a match, m: a creep of 1 mm per root of a metre over a section of 100 m."""
SURE = 0.99
"""Probability from which a place found without any fix is accepted."""
_ON_SPRINGS_SD_M = 0.8
"""Sigma of a place, m, by a body's lag behind the track's curves. Chosen on simulated car bodies at 50-100 km/h; see
Assumptions in docs/engine.md."""


@dataclass(frozen=True)
class MapChainage:
    """The chainage of a map and its uncertainty.

    ``grid``: the map's grid. ``on_springs``: the matches are of the motion of a body on springs.
    """

    grid: pd.DataFrame
    on_springs: bool

    def sd_m(self, chainage: Array) -> Array:
        """Return the sigma of the map's own chainage at places (n,), m."""
        return np.asarray(np.interp(chainage, self.grid["chainage_m"], self.grid["chainage_m_sd"]))

    def with_uncertainty(self, covariance: Covariance, states: States, direction: int) -> Covariance:
        """Return the covariance with that of the map's chainage added, and of a body's lag on springs."""
        common = _ON_SPRINGS_SD_M if self.on_springs else 0.0
        return covariance.with_added_distance_variance(self.sd_m(direction * states.odo.distance) ** 2 + common**2)


@dataclass(frozen=True)
class Located:
    """A problem with landmarks, ready to be solved again.

    ``chainage``: that which it is in. ``use``: what of the map was used. ``anchored``: fixes gave its chainage before.
    """

    problem: Problem
    chainage: MapChainage
    use: MapUse
    findings: tuple[Finding, ...]
    anchored: bool
    kilometrage_of_map: LineKilometrage | None

    def kilometrage(self, own: LineKilometrage | None) -> LineKilometrage | None:
        """Return the kilometrage for the run's chainages; ``own`` is that of its recording.

        A run that had no fix counted from its start, and so does its own kilometrage. Located, it counts as the map
        does.
        """
        if not self.use.sections or (self.anchored and own is not None):
            return own
        return self.kilometrage_of_map


@dataclass(frozen=True)
class UnlocatedRun:
    """A run as solved without the map.

    ``geometry`` is its own table, from ``passes``; ``anchored``: fixes gave its chainage; ``on_springs``: the table is
    of the body's motion. ``wheel_scale_sd`` is the relative uncertainty of its distances.
    """

    id: str
    problem: Problem
    states: States
    geometry: pd.DataFrame
    passes: Sequence[Profile]
    anchored: bool
    wheel_scale_sd: float
    on_springs: bool


def located(run: UnlocatedRun, feature_map: FeatureMap, config: PositionConfig) -> Located:
    """Recognise the run on the map, and give its problem the landmarks that follow.

    Raises :class:`~trackfg.errors.BadInputError` where the map's columns mean something else than the run's.
    """
    problem, states, anchored = run.problem, run.states, run.anchored
    direction, meaning = problem.run.direction, problem.run.conventions
    check_conventions(meaning, feature_map.conventions, run.id)
    grid = feature_map.grid
    chainage = MapChainage(grid, run.on_springs)
    map_sd = float(grid["chainage_m_sd"].median())
    recognition = recognised_near(
        run.geometry, grid, map_sd if anchored else None, rate_sd=run.wheel_scale_sd, direction=direction
    )
    located_run = partial(
        Located,
        chainage=chainage,
        anchored=anchored,
        kilometrage_of_map=kilometrage_of_map(feature_map.name, feature_map.configuration, None),
    )
    used = recognition.used
    if not anchored and recognition.probability < SURE:
        used = used.iloc[:0]
    use = MapUse(
        name=feature_map.name,
        version=feature_map.version,
        written_at=feature_map.written_at,
        sections=len(used),
        recognised_m=float(np.median(np.diff(recognition.sections["run_m"])) * len(used)) if len(used) > 1 else 0.0,
        probability=float(recognition.probability),
        found_after_m=None if np.isnan(recognition.found_after_m) else float(recognition.found_after_m),
    )
    if used.empty:
        then = "the map was not used" if anchored else "chainage counts from the start of the run"
        what = f"the track is not recognised on the map {feature_map.name!r}: {then}"
        hint = "it was sought where its fixes place it: check that they count as the map does" if anchored else None
        finding = Finding("warning", "not-on-map", what, hint=hint)
        return located_run(problem, use=use, findings=(finding,))
    moved = states
    families = problem.families
    if not anchored:
        offset = direction * float((used["reference_m"] - used["run_m"]).mean())
        moved = replace(states, odo=states.odo.moved_along(offset))
        families = with_free_start(families)
    families = changed(families, FactorType.ABSOLUTE_FIX, lambda fixes: _less_sure(fixes, chainage, direction))
    family = _landmarks(used, run.passes, states, meaning.step_m, direction, landmark_loss(config))
    return located_run(replace(problem, initial=moved, families=(*families, family)), use=use, findings=())


def landmark_loss(config: PositionConfig) -> Loss | None:
    """Return the loss of matches."""
    return Cauchy(config.fix_width) if config.robust else None


def landmark_sd(used: pd.DataFrame) -> Array:
    """Return the sigmas of matches as landmarks, (m,).

    ``used``: rows of :attr:`trackfg.mapping.recognition.recognition.Recognition.used`.
    """
    return np.asarray(np.hypot(used["match_sd_m"].to_numpy(), _LEAST_SD_M))


def _less_sure(family: Family, chainage: MapChainage, direction: int) -> Family:
    """Fixes by the map's chainage, which errs by itself."""
    place = direction * family.data["distance"][:, 0]
    return family.with_sigma(np.hypot(family.sigma, chainage.sd_m(place)[:, None]))


def _landmarks(
    used: pd.DataFrame,
    passes: Sequence[Profile],
    states: States,
    step_m: float,
    direction: int,
    loss: Loss | None,
) -> Family:
    """Return one factor per section, at the time when its middle was passed on the longest pass, as in the table."""
    place = used["run_m"].to_numpy()
    when = np.full(len(place), np.nan)
    for profile in sorted(passes, key=len, reverse=True):
        within = np.isnan(when) & (place >= profile.cell[0] * step_m) & (place <= profile.cell[-1] * step_m)
        when[within] = np.interp(place[within], profile.cell * step_m, profile.keyframe + profile.fraction)
    passed = np.isfinite(when)
    k = np.clip(when[passed].astype(np.int64), 0, len(states) - 2)
    f = when[passed] - k
    D = states.odo.distance
    beyond = direction * place[passed] - ((1.0 - f) * D[k] + f * D[k + 1])
    distance = direction * used["reference_m"].to_numpy()[passed] - beyond
    return landmark(k, f, distance, landmark_sd(used)[passed, None], loss)
