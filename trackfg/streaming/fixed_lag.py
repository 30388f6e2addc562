"""The fixed-lag smoother: rows in, estimates out, at constant cost.

rows -> tape -> moving window -> the newest state at once (filtered); what is older than the lag, in pieces (smoothed)

What a keyframe leaves to do, a step of the whole window or a piece of the smoothed tables, is done when the next rows
come, and what can be done of the next keyframe before its last rows come is: filtered rows wait for neither.

>>> smoother = FixedLagSmoother(source.description, lag_s=10.0)
>>> intake = Intake.of(source)
>>> for batch in source:
...     rows, events = intake.push(batch)
...     estimates = smoother.put(rows)
...     print(estimates.filtered[["t_s", "chainage_m", "chainage_m_sd"]])
>>> last = [smoother.put(intake.finish()[0]), smoother.finish()]
"""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pandas as pd

from trackfg.config import SmoothConfig
from trackfg.errors import BadInputError
from trackfg.graph.motion import RATE_WINDOW_S
from trackfg.numerics.arrays import Array
from trackfg.output.dense_motion import DenseMotion
from trackfg.output.trajectory import trajectory_columns
from trackfg.recording.description import RecordingDescription
from trackfg.results.columns import GEOMETRY_COLUMNS, TRAJECTORY_COLUMNS
from trackfg.smoothing.localisation import MapChainage
from trackfg.streaming.checkpoint.snapshot import Snapshot, attributes_of, taken
from trackfg.streaming.events import StreamEvent
from trackfg.streaming.locating.map_locator import MapLocator
from trackfg.streaming.rows import Rows
from trackfg.streaming.tables.smoothed_tables import SmoothedTables, Tables
from trackfg.streaming.window.moving_window import BEFORE_S, Lost, MovingWindow, Pass, Update
from trackfg.streaming.window.sample_buffer import Tape
from trackfg.streaming.window.stream_context import Setting

if TYPE_CHECKING:
    from trackfg.maps.feature_map import FeatureMap

NO_TRAJECTORY = pd.DataFrame(columns=list(TRAJECTORY_COLUMNS), dtype=np.float64)
NO_GEOMETRY = pd.DataFrame(columns=["t_s", *GEOMETRY_COLUMNS], dtype=np.float64)

_JUST_S = 1e-6
KEPT_S = 30.0
"""Rows so old are let go while nothing measures the speed: no window begins with them."""
PIECE_S = 10.0
"""Smoothed tables come in pieces about as long."""


class Estimates(NamedTuple):
    """``filtered``: a row per new keyframe, from the rows up to it. ``smoothed``: rows of the trajectory, ``geometry``:
    rows of the geometry table, of what the lag is over for. Columns as in a result, and of geometry ``t_s``, when the
    place was passed; tables may be empty. ``events``: what else became known.
    """

    filtered: pd.DataFrame
    smoothed: pd.DataFrame
    geometry: pd.DataFrame
    events: tuple[StreamEvent, ...] = ()


NO_ESTIMATES = Estimates(NO_TRAJECTORY, NO_TRAJECTORY, NO_GEOMETRY)


class Behind(NamedTuple):
    """What a step of the whole window made known."""

    pieces: list[Tables]
    events: tuple[StreamEvent, ...]


class FixedLagSmoother:
    """The batch smoother's graph on the last ``lag_s`` seconds of a stream, located on a map if there is one.

    Raises :class:`~trackfg.errors.BadInputError` for a lag that is too short to hold two keyframes, for a description
    in which nothing measures speed, and for a map whose columns mean something else than the stream's.
    """

    config: SmoothConfig
    settings: dict[str, str]
    """What it was made with, as a digest of each, by name."""
    _tape: Tape
    _moving: MovingWindow
    _tables: SmoothedTables | None
    _done_s: float
    """When the tables that a lost window left behind end."""
    _locator: MapLocator | None

    def __init__(
        self,
        description: RecordingDescription,
        config: SmoothConfig | None = None,
        *,
        lag_s: float = 10.0,
        feature_map: FeatureMap | None = None,
    ) -> None:
        self.config = config or SmoothConfig()
        if not lag_s >= 2.0 * self.config.keyframes.interval_s:
            raise BadInputError(
                f"a lag of {lag_s:g} s: expected {2.0 * self.config.keyframes.interval_s:g} s or more, two keyframes"
            )
        if description.tach is None and description.gnss is None:
            raise BadInputError(f"{description.id}: nothing measures speed: expected [tach] or [gnss] for a stream")
        made_with = {
            "description": description.model_dump_json().encode(),
            "configuration": self.config.model_dump_json().encode(),
            "lag": repr(float(lag_s)).encode(),
            "map": b"" if feature_map is None else feature_map.grid.to_numpy(dtype=np.float64).tobytes(),
        }
        self.settings = {name: hashlib.sha256(what).hexdigest() for name, what in made_with.items()}
        self._tape = Tape(description)
        self._locator = None if feature_map is None else MapLocator(description, self.config, feature_map)
        self._moving = MovingWindow(self._tape, self.config, lag_s, on_map=feature_map is not None)
        self._tables, self._done_s = None, -np.inf

    def put(self, rows: Rows) -> Estimates:
        """Take the next rows and give what they make known."""
        self._tape.put(rows if self._locator is None else self._locator.less_sure(rows))
        behind, at_once = self._behind(), []
        t = self._moving.next_keyframe()
        while t is not None and self._moving.reaches(t):
            if done := self._behind():  # it may be that the vehicle is slower than was thought
                behind += done
            else:
                update = self._moving.advanced(t)
                at_once += [] if update is None else [self._filtered(update)]
            t = self._moving.next_keyframe()
        if t is not None:
            self._moving.prepare(t)
        elif self._moving.tip is None:  # nothing measures the speed: rows that no window begins with are let go
            self._tape.forget(self._tape.until - KEPT_S, self._tape.until - KEPT_S)
        return _estimates_of(_table(at_once), behind)

    def finish(self) -> Estimates:
        """What is left when no more rows come; nothing where they were too few to begin with."""
        behind, update = self._behind(), self._moving.last()
        behind += self._behind(at_end=True)
        if self._moving.next_keyframe() is None and self._moving.tip is None and self._tape.data is not None:
            behind.append(Behind([], (self._moving.without_speed(self._tape.until),)))
        return _estimates_of(_table([] if update is None else [self._filtered(update)]), behind)

    def state(self) -> Snapshot:
        """Everything that carries over from one call to the next."""
        return taken(self, self._given)

    def restore(self, state: Snapshot) -> None:
        """Go on from the :meth:`state` of a smoother made with the same arguments. Raises
        :class:`~trackfg.errors.BadInputError` where it does not fit.
        """
        vars(self).update(attributes_of(FixedLagSmoother, state, self._given))

    @property
    def sparser(self) -> float:
        """How many times further apart keyframes are than the settings say. It may be set."""
        return self._moving.sparser

    @sparser.setter
    def sparser(self, factor: float) -> None:
        self._moving.sparser = factor

    @property
    def _given(self) -> tuple[object, ...]:
        feature_map = () if self._locator is None else (self._locator.feature_map,)
        return self.config, self._tape.description, *feature_map

    def _filtered(self, update: Update) -> dict[str, Array]:
        """The newest keyframe's row, by columns."""
        window, setting = update.window, self._setting
        k = len(window) - 1
        two = window.states.take(slice(k - 1, None))
        direction = setting.description.track.direction
        covariance = update.covariance.with_added_distance_variance(self._moving.places.doubt_m**2)
        if self._chainage is not None:
            covariance = self._chainage.with_uncertainty(covariance, two, direction)
        data = self._tape.data
        assert data is not None
        run = setting.run_of(window.t[-2:], data)
        at = np.array([window.t[-1]])
        rate = self._tape.rate_at(at[0]) - two.bias[-1:, 3:]
        over, interval, end = np.array([RATE_WINDOW_S]), np.zeros(1, dtype=np.int64), np.ones(1)
        motion = DenseMotion(at, two.nav[1:], two.odo.distance[1:], rate, over, interval, end)
        return trajectory_columns(run, motion, two, covariance)

    def _behind(self, *, at_end: bool = False) -> list[Behind]:
        """What is due behind the newest keyframe: a step of the whole window, and the next piece of the tables."""
        step = self._moving.passed(at_end=at_end)
        if self._moving.lost is not None and self._moving.newly_lost:
            return [self._lost(self._moving.lost)]
        if step is None:
            return []
        if self._tables is None:
            begin = max(float(step.window.t[0]) - _JUST_S, self._done_s)
            self._tables = SmoothedTables.beginning(self._setting, begin, looks=self._locator is not None)
        tables, newest = self._tables, float(step.window.t[-1])
        settled = newest if at_end else newest - self._moving.lag_s
        pieces = []
        if at_end or settled - tables.done_s >= PIECE_S:
            pieces = [self._tables_up_to(tables, step, settled, at_end=at_end)]
        locator = self._locator
        events = self._moving.places.told() if locator is None else self._locate(locator, pieces, step)
        if step.gone is not None:
            tables.history.append(step.gone)
        if pieces:
            self._tape.stood(tables.forget())
            newer = float(step.window.t[0]) - BEFORE_S
            older = float(tables.history.t[0]) - BEFORE_S if tables.history.parts else newer
            self._tape.forget(older, newer)
        events = (*events, *(() if step.event is None else (step.event,)))
        return [Behind(pieces, (*(event for piece in pieces for event in piece.events), *events))]

    def _lost(self, lost: Lost) -> Behind:
        """What is known up to there; from there on the stream begins anew."""
        self._moving.newly_lost, pieces = False, []
        if self._tables is not None and lost.left is not None:
            pieces = [self._tables_up_to(self._tables, lost.left, lost.begin_s, at_end=True)]
            self._done_s = lost.begin_s
        self._tables = None
        if self._locator is not None:
            self._locator = MapLocator(self._tape.description, self.config, self._locator.feature_map)
        event = StreamEvent("restarted", t_s=lost.begin_s, detail=lost.reason)
        return Behind(pieces, (*(event for piece in pieces for event in piece.events), event))

    def _tables_up_to(self, tables: SmoothedTables, step: Pass, settled_s: float, *, at_end: bool) -> Tables:
        return tables.up_to(
            self._tape,
            step.window,
            step.root,
            settled_s,
            rests=self._moving.rests,
            odometer=self._moving.odometer,
            at_end=at_end,
            chainage=self._chainage,
            doubt_m=self._moving.places.doubt_m,
        )

    def _locate(self, locator: MapLocator, pieces: list[Tables], step: Pass) -> tuple[StreamEvent, ...]:
        events: list[StreamEvent] = []
        for piece in pieces:
            told = locator.take(piece.sight, step)
            events += told.events
            if told.family is not None:
                self._moving.tell(told.family)
        if step.gone is not None:
            locator.history.append(step.gone)
        return tuple(events)

    @property
    def _chainage(self) -> MapChainage | None:
        """That of the map, where the vehicle is located on it."""
        return self._locator.chainage if self._locator is not None and self._locator.located else None

    @property
    def _setting(self) -> Setting:
        assert self._moving.setting is not None
        return self._moving.setting


def _estimates_of(filtered: pd.DataFrame, behind: list[Behind]) -> Estimates:
    smoothed = _joined([piece.trajectory for one in behind for piece in one.pieces], NO_TRAJECTORY)
    geometry = _joined([piece.geometry for one in behind for piece in one.pieces], NO_GEOMETRY)
    return Estimates(filtered, smoothed, geometry, tuple(event for one in behind for event in one.events))


def _table(rows: list[dict[str, Array]]) -> pd.DataFrame:
    if not rows:
        return NO_TRAJECTORY
    table = np.array([[row[name][0] for name in TRAJECTORY_COLUMNS] for row in rows])
    return pd.DataFrame(table, columns=NO_TRAJECTORY.columns)


def _joined(tables: list[pd.DataFrame], none: pd.DataFrame) -> pd.DataFrame:
    filled = [table for table in tables if len(table)]
    if not filled:
        return none
    return filled[0] if len(filled) == 1 else pd.concat(filled, ignore_index=True)
