"""The map locator recognises the geometry that leaves the window on a map, and gives the window its position.

The recent track is matched by the batch's recogniser. While the position on the map is unknown, the run is followed
section by section over all of it (:mod:`trackfg.mapping.recognition.tracker`). It is located once that agrees twice in
succession on one place, with the probability that the batch asks for, and the recent track is recognised there as a
whole. From then on, or after a fix, each new section is sought near its expected place
(:func:`trackfg.mapping.recognition.recognition.recognise`), at a cost that depends on neither the map's length nor the
run's.

A section counts once, when it is certain. It was passed at keyframes that have been marginalised;
:mod:`trackfg.streaming.locating.delayed_positions` turns it into a factor on the window.
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
from trackfg.results.events import Event
from trackfg.smoothing.localisation import SURE, MapChainage, landmark_loss, landmark_sd
from trackfg.solver.covariance import posterior_covariance
from trackfg.streaming.locating.delayed_positions import DelayedPositions, PassedPlaces, delayed_position_factor
from trackfg.streaming.locating.recent_track import RecentTrack
from trackfg.streaming.rows import Rows
from trackfg.streaming.tables.smoothed_tables import TrackPiece
from trackfg.streaming.window.marginalised import MarginalisedHistory
from trackfg.streaming.window.running_window import Relinearisation

if TYPE_CHECKING:
    from trackfg.maps.feature_map import FeatureMap

_BEHIND_M = 500.0
"""Keyframes are kept so far back, m: a section that is not certain by then does not count."""
_BEHIND_KEYFRAMES = 400
"""No more keyframes are kept than this: at rest and at a crawl their number per metre has no bound."""
_KNOWN_M = 200.0
"""A position with a smaller sigma is known, m: it is sought nowhere else."""
_FOUND_SD_M = 10.0
"""Sigma of a position that was found by following, m."""
_AGREE_M = 20.0
"""Two places that were followed one after the other agree within this, m."""
_AROUND_M = 150.0
"""How much of the map is used on either side of where the recent track may be, m."""
_LOST_M = 1000.0
"""After so much unrecognised track the vehicle is off the map, m."""
_SET_ASIDE = 0.5
"""A robust weight below this marks a section that the solution does not follow."""


class LocatedPiece(NamedTuple):
    """A factor on the first keyframe that stays in the window, if there is one, and the events."""

    family: Family | None
    events: tuple[Event, ...]


class _Match(NamedTuple):
    """The recent track as recognised on the map; its chainage is ``shift`` m less than that in the recognition."""

    recognition: Recognition
    shift: float
    probability: float


@dataclass
class MapLocator:
    """Locates a stream on a map, section by section.

    ``used``: middles of the sections that became factors, m of the run's chainage; ``newest``: where the last section
    that was sought begins. ``followed``: chainage on the map less that of the run, where the last section was certain.
    ``located``: whether the map has placed the vehicle; ``unrecognised_m``: the length of sections since.

    Raises :class:`~trackfg.errors.BadInputError` where the map's columns mean something else than the stream's.
    """

    description: RecordingDescription
    config: SmoothConfig
    feature_map: FeatureMap
    history: MarginalisedHistory = field(default_factory=MarginalisedHistory)
    track: RecentTrack = field(default_factory=RecentTrack)
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

    def with_map_uncertainty(self, rows: Rows) -> Rows:
        """Return rows whose fixes have the map's error in their sigma: they are by the map's chainage."""
        if not len(rows.fixes):
            return rows
        fixes = rows.fixes.copy()
        fixes[:, 2] = np.hypot(fixes[:, 2], self.chainage.sd_m(fixes[:, 1]))
        return replace(rows, fixes=fixes)

    def locate(self, piece: TrackPiece, step: Relinearisation) -> LocatedPiece:
        """Seek the next piece of track, as seen from a window. Keyframes that leave it are not in the history yet."""
        self._append(piece)
        sections, late, events = self.track.sections(), None, []
        if sections and sections[-1] != self.newest:
            leaving = 0 if step.marginalised is None else len(step.marginalised.t)
            marginal = posterior_covariance(step.root).at(leaving)
            match = self._match(sections, marginal)
            if match is not None:
                late = self._new_positions(match, step, leaving, marginal)
            if late is not None and match is not None:
                events = self._events(late, match)
            if late is None:
                self.unrecognised_m += SECTION_M * len(self._unsought(sections))
            self.newest = sections[-1]
        if late is None and self.located and not self.lost and self.unrecognised_m > _LOST_M:
            self.lost = True
            detail = f"the track has not been recognised on the map for {self.unrecognised_m:.0f} m"
            events = [Event("lost", t_s=float(self.track.passed_s[-1]), detail=detail)]
        return LocatedPiece(None if late is None else late.family, tuple(events))

    def _append(self, piece: TrackPiece) -> None:
        if piece.moved:
            by = self.description.track.direction * piece.moved * self._step_m
            self.track.move(by)
            self.used = [place + by for place in self.used]
            self.newest = self.follower = self.followed = None
        self.track.append(piece)
        if len(self.track):
            place, sense = self.track.place, self.track.sense
            near = np.flatnonzero(sense * (place[-1] - place) < _BEHIND_M)
            self.history.forget(float(self.track.passed_s[near[0]]), at_most=_BEHIND_KEYFRAMES)
            self.used = [used for used in self.used if abs(place - used).min() < SECTION_M]

    def _match(self, sections: list[int], marginal: Array) -> _Match | None:
        """``marginal`` (49, 49) is the covariance of a keyframe in the window."""
        odo = offset_in_keyframe(Kind.ODO)
        place_sd, rate_sd = (float(np.sqrt(marginal[i, i])) for i in (odo, odo + 1))
        if place_sd < _KNOWN_M:
            self.follower = self.followed = None
            recognition = self._recognise(0.0, place_sd, rate_sd)
            return None if recognition is None else _Match(recognition, 0.0, recognition.probability)
        match = None
        for begin in self._unsought(sections):
            match = self._follow(begin, rate_sd)
        return match

    def _unsought(self, sections: list[int]) -> list[int]:
        """Return the sections that were not sought before."""
        return sections[sections.index(self.newest) + 1 if self.newest in sections else 0 :]

    def _follow(self, begin_m: int, rate_sd: float) -> _Match | None:
        """Return the match where the run was followed to, if that is certain twice in succession."""
        if self.follower is None:
            self.follower = PlaceTracker(rate_sd, SECTION_M)
        at = self.follower.take(self.track.ascending(), begin_m, self._reference)
        if at is None:
            return None
        previous, self.followed = self.followed, at.reference_m - at.run_m if at.probability > SURE else None
        if previous is None or self.followed is None or abs(previous - self.followed) > _AGREE_M:
            return None
        shift = round(self.followed / self._step_m) * self._step_m
        recognition = self._recognise(shift, _FOUND_SD_M, rate_sd)
        if recognition is None or recognition.probability < SURE or recognition.used.empty:
            return None
        return _Match(recognition, shift, at.probability)

    def _recognise(self, shift: float, place_sd: float, rate_sd: float) -> Recognition | None:
        """Seek the recent track near its chainage plus ``shift``, m; None where the map has nothing there."""
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

    def _new_positions(
        self, match: _Match, step: Relinearisation, leaving: int, marginal: Array
    ) -> DelayedPositions | None:
        """Return the sections that are certain and have become no factor before."""
        rows, sense = match.recognition.used, self.track.sense
        middle = rows["run_m"].to_numpy() - match.shift
        complete = sense * (middle - self.track.place[-1]) <= self._step_m - 0.5 * SECTION_M
        free = np.array(
            [all(abs(place - used) > SECTION_M - 1.0 for used in self.used) for place in middle], dtype=bool
        )
        chosen = np.flatnonzero(complete & free)[::sense]
        if not len(chosen):
            return None
        t, beyond = self.track.passed_at(middle[chosen])
        distance = self.description.track.direction * rows["reference_m"].to_numpy()[chosen]
        places = PassedPlaces(t, distance, landmark_sd(rows.iloc[chosen]), beyond)
        loss = landmark_loss(self.config.position)
        late = delayed_position_factor(places, self.history, step.whole_window, step.root, leaving, marginal, loss)
        if late is not None:
            self.used += middle[chosen][np.isin(t, late.places.t)].tolist()
        return late

    def _events(self, late: DelayedPositions, match: _Match) -> list[Event]:
        """Return one event per section, as the batch has it, and before them that the vehicle is located."""
        places, events = late.places, list[Event]()
        chainage = self.description.track.direction * places.distance
        sd = np.hypot(late.sd, self.chainage.sd_m(chainage))
        for i, aside in enumerate(late.weight < _SET_ASIDE):
            t, place = float(places.t[i]), (float(chainage[i]), float(sd[i]))
            if not events and (self.lost or not self.located):
                on = f"on the map {self.feature_map.name!r}, probability {match.probability:.6f}"
                events.append(Event("located", "", t, t, 0, on, *place))
            kind = "landmark set aside" if aside else "landmark used"
            events.append(Event(kind, "", t, t, 0, f"residual {late.residual[i]:.2f} m", *place))
        self.located, self.lost, self.unrecognised_m = True, False, 0.0
        return events
