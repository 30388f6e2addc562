"""Where a stream is on a map: what leaves the window as track geometry is recognised, and told to the window.

The last stretch of the geometry is held against the map by the recogniser that the batch uses. As long as nobody knows
where on the map the vehicle is, it is followed section by section over all of it
(:mod:`trackfg.mapping.recognition.tracker`), and found once that says the same place twice in succession with the
probability from which the batch believes one, and the stretch as a whole is recognised there. From then on, or where a
fix has said where it is, each new section is sought about where it should be
(:func:`trackfg.mapping.recognition.recognition.recognise`), on the part of the map that is near: the cost of that
depends on neither the map's length nor the run's.

A section counts once, when it is certain. What it says, "the vehicle was there then", concerns keyframes that have left
the window by then; :mod:`trackfg.streaming.locating.delayed_positions` carries it to the window.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trackfg.config import SmoothConfig
from trackfg.factors.family import Family
from trackfg.factors.states import Kind, offset_in_keyframe
from trackfg.graph.run_context import geometry_conventions
from trackfg.mapping.recognition.conventions import check_conventions
from trackfg.mapping.recognition.profiles import FEATURES, SECTION_M
from trackfg.mapping.recognition.recognition import Recognition, recognise
from trackfg.mapping.recognition.tracker import PlaceTracker, reference_of
from trackfg.numerics.arrays import Array
from trackfg.recording.description import RecordingDescription
from trackfg.smoothing.localisation import SURE, MapChainage, landmark_loss, landmark_sd
from trackfg.solver.covariance import posterior_covariance
from trackfg.streaming.events import StreamEvent
from trackfg.streaming.locating.delayed_positions import Passed, ToldLate, told_late
from trackfg.streaming.locating.recent_track import SeenTrack
from trackfg.streaming.rows import Rows
from trackfg.streaming.tables.smoothed_tables import Sight
from trackfg.streaming.window.marginalised import History
from trackfg.streaming.window.moving_window import Pass

if TYPE_CHECKING:
    from trackfg.maps.feature_map import FeatureMap

_BEHIND_M = 500.0
"""Keyframes are kept so far back: a section that is not certain by then counts for nothing."""
_BEHIND_KEYFRAMES = 400
_KNOWN_M = 200.0
"""A place with a smaller sigma is known: it is sought nowhere else."""
_FOUND_SD_M = 10.0
"""Of a place that was found by following."""
_AGREE_M = 20.0
_AROUND_M = 150.0
"""Of the map on either side of where the stretch may be."""
_LOST_M = 1000.0
"""After as much track that is not recognised the vehicle is off the map."""
_SET_ASIDE = 0.5
"""A robust weight below this marks a section that the solution does not follow."""


class Told(NamedTuple):
    """A factor on the first keyframe that stays in the window, if there is one, and what happened."""

    family: Family | None
    events: tuple[StreamEvent, ...]


class _Found(NamedTuple):
    """The track recognised; its chainage is ``shift`` m less than that in the recognition."""

    recognition: Recognition
    shift: float
    probability: float


@dataclass
class MapLocator:
    """``used``: middles of the sections that were told, m of the run's chainage; ``newest``: where the last that was
    looked at begins. ``followed``: chainage on the map less that of the run, where the last section was certain of it.
    ``located``: whether the map has told where the vehicle is; ``unrecognised_m``: the length of sections since.

    Raises :class:`~trackfg.errors.BadInputError` where the map's columns mean something else than the stream's.
    """

    description: RecordingDescription
    config: SmoothConfig
    feature_map: FeatureMap
    history: History = field(default_factory=History)
    track: SeenTrack = field(default_factory=SeenTrack)
    used: list[float] = field(default_factory=list)
    newest: int | None = None
    follower: PlaceTracker | None = None
    followed: float | None = None
    located: bool = False
    lost: bool = False
    unrecognised_m: float = 0.0

    def __post_init__(self) -> None:
        meaning = geometry_conventions(self.config.geometry, self.description.track)
        check_conventions(meaning, self.feature_map.conventions, self.description.id)
        self._step_m = meaning.step_m
        self._grid = self.feature_map.grid
        self._reference = reference_of(self._grid)
        self._map_sd = float(self._grid["chainage_m_sd"].median())
        self.chainage = MapChainage(self._grid, on_springs=not self.description.imu.rigid)

    def less_sure(self, rows: Rows) -> Rows:
        """Fixes by the map's chainage, which errs by itself."""
        if not len(rows.fixes):
            return rows
        fixes = rows.fixes.copy()
        fixes[:, 2] = np.hypot(fixes[:, 2], self.chainage.sd_m(fixes[:, 1]))
        return replace(rows, fixes=fixes)

    def take(self, sight: Sight, step: Pass) -> Told:
        """The next piece of track, as seen from a window. Keyframes that leave it are not in the history yet."""
        self._append(sight)
        sections, told, events = self.track.sections(), None, []
        if sections and sections[-1] != self.newest:
            leaving = 0 if step.gone is None else len(step.gone.t)
            marginal = posterior_covariance(step.root).marginal[leaving]
            found = self._found(sections, marginal)
            if found is not None:
                told = self._told(found, step, leaving, marginal)
            if told is not None and found is not None:
                events = self._events(told, found)
            if told is None:
                self.unrecognised_m += SECTION_M * len(self._new(sections))
            self.newest = sections[-1]
        if told is None and self.located and not self.lost and self.unrecognised_m > _LOST_M:
            self.lost = True
            detail = f"the track has not been recognised on the map for {self.unrecognised_m:.0f} m"
            events = [StreamEvent("lost", t_s=float(self.track.passed_s[-1]), detail=detail)]
        return Told(None if told is None else told.family, tuple(events))

    def _append(self, sight: Sight) -> None:
        if sight.moved:
            by = self.description.track.direction * sight.moved * self._step_m
            self.track.move(by)
            self.used = [place + by for place in self.used]
            self.newest = self.follower = self.followed = None
        self.track.append(sight)
        if len(self.track):
            place, sense = self.track.place, self.track.sense
            near = np.flatnonzero(sense * (place[-1] - place) < _BEHIND_M)
            self.history.forget(float(self.track.passed_s[near[0]]), at_most=_BEHIND_KEYFRAMES)
            self.used = [used for used in self.used if abs(place - used).min() < SECTION_M]

    def _found(self, sections: list[int], marginal: Array) -> _Found | None:
        """``marginal`` is the covariance of a keyframe in the window."""
        odo = offset_in_keyframe(Kind.ODO)
        place_sd, rate_sd = (float(np.sqrt(marginal[i, i])) for i in (odo, odo + 1))
        if place_sd < _KNOWN_M:
            self.follower = self.followed = None
            recognition = self._recognised(0.0, place_sd, rate_sd)
            return None if recognition is None else _Found(recognition, 0.0, recognition.probability)
        found = None
        for begin in self._new(sections):
            found = self._followed(begin, rate_sd)
        return found

    def _new(self, sections: list[int]) -> list[int]:
        """Those that were not looked at before."""
        return sections[sections.index(self.newest) + 1 if self.newest in sections else 0 :]

    def _followed(self, begin_m: int, rate_sd: float) -> _Found | None:
        """The stretch where the run was followed to, if that is certain."""
        if self.follower is None:
            self.follower = PlaceTracker(rate_sd, SECTION_M)
        at = self.follower.take(self.track.ascending(), begin_m, self._reference)
        if at is None:
            return None
        before, self.followed = self.followed, at.reference_m - at.run_m if at.probability > SURE else None
        if before is None or self.followed is None or abs(before - self.followed) > _AGREE_M:
            return None
        shift = round(self.followed / self._step_m) * self._step_m
        recognition = self._recognised(shift, _FOUND_SD_M, rate_sd)
        if recognition is None or recognition.probability < SURE or recognition.used.empty:
            return None
        return _Found(recognition, shift, at.probability)

    def _recognised(self, shift: float, place_sd: float, rate_sd: float) -> Recognition | None:
        """The stretch about where its own chainage and ``shift`` have it; None where the map has nothing there."""
        run, sense = self.track.ascending(), self.track.sense
        back = np.abs(self.track.place[-1] - run["chainage_m"].to_numpy())
        run["chainage_m"] += shift
        sd = np.sqrt(place_sd**2 + self._map_sd**2 + (rate_sd * back) ** 2)
        chainage, around = self._grid["chainage_m"], _AROUND_M + 4.0 * float(sd.max())
        ends = run["chainage_m"].iloc[0] - around, run["chainage_m"].iloc[-1] + around
        grid = self._grid.iloc[slice(*np.searchsorted(chainage, ends).tolist())]
        if not any(grid[name].notna().any() and run[name].notna().any() for name in FEATURES):
            return None
        return recognise(run, grid, place_sd_m=sd, rate_sd=rate_sd, direction=sense, section_m=SECTION_M)

    def _told(self, found: _Found, step: Pass, leaving: int, marginal: Array) -> ToldLate | None:
        """The sections that are certain and that were not told before."""
        rows, sense = found.recognition.used, self.track.sense
        middle = rows["run_m"].to_numpy() - found.shift
        complete = sense * (middle - self.track.place[-1]) <= self._step_m - 0.5 * SECTION_M
        free = np.array(
            [all(abs(place - used) > SECTION_M - 1.0 for used in self.used) for place in middle], dtype=bool
        )
        chosen = np.flatnonzero(complete & free)[::sense]
        if not len(chosen):
            return None
        t, beyond = self.track.passed_at(middle[chosen])
        distance = self.description.track.direction * rows["reference_m"].to_numpy()[chosen]
        places = Passed(t, distance, landmark_sd(rows.iloc[chosen]), beyond)
        loss = landmark_loss(self.config.position)
        told = told_late(places, self.history, step.window, step.root, leaving, marginal, loss)
        if told is not None:
            self.used += middle[chosen][np.isin(t, told.places.t)].tolist()
        return told

    def _events(self, told: ToldLate, found: _Found) -> list[StreamEvent]:
        """As the batch's, one per section, and before them that the vehicle is located."""
        places, events = told.places, list[StreamEvent]()
        chainage = self.description.track.direction * places.distance
        sd = np.hypot(told.sd, self.chainage.sd_m(chainage))
        for i, aside in enumerate(told.weight < _SET_ASIDE):
            t, place = float(places.t[i]), (float(chainage[i]), float(sd[i]))
            if not events and (self.lost or not self.located):
                on = f"on the map {self.feature_map.name!r}, probability {found.probability:.6f}"
                events.append(StreamEvent("located", "", t, t, 0, on, *place))
            kind = "landmark set aside" if aside else "landmark used"
            events.append(StreamEvent(kind, "", t, t, 0, f"residual {told.residual[i]:.2f} m", *place))
        self.located, self.lost, self.unrecognised_m = True, False, 0.0
        return events
