"""The fixed-lag smoother turns rows into estimates at constant cost.

rows -> sample buffer -> moving window -> the newest state at once (filtered)
                              |
                              +-> marginalised keyframes -> what is older than the lag, in pieces (smoothed)

Filtered rows do not wait: a relinearisation pass or a piece of the smoothed tables that falls due with a keyframe is
done when the next rows come, and the inertial part of the next keyframe before its last rows come.

From a source's first batch to the last estimates::

    smoother = FixedLagSmoother(source.description, lag_s=10.0)
    intake = Intake.of(source)
    for batch in source:
        rows, events = intake.push(batch)
        estimates = smoother.put(rows)
        print(estimates.filtered[["t_s", "chainage_m", "chainage_m_sd"]])
    last = [smoother.put(intake.finish()[0]), smoother.finish()]
"""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

import numpy as np

from trackfg.config import SmoothConfig
from trackfg.errors import BadInputError
from trackfg.factors.motion import mount_matrix
from trackfg.graph.inputs import RATE_WINDOW_S
from trackfg.numerics.arrays import Array
from trackfg.output.dense_motion import DenseMotion
from trackfg.output.trajectory import trajectory_columns
from trackfg.recording.description import RecordingDescription
from trackfg.results.events import Event
from trackfg.sensors.imu_noise.white_noise import WhiteNoise
from trackfg.smoothing.localisation import MapChainage
from trackfg.streaming.checkpoint.snapshot import Snapshot, dump, load_attributes
from trackfg.streaming.doubts.reporting import DoubtReports
from trackfg.streaming.doubts.stream_tests import StreamTests
from trackfg.streaming.estimates import Estimates, PassOutput, estimates_of
from trackfg.streaming.locating.map_locator import MapLocator
from trackfg.streaming.outages import Outage, distance_after, outage_after
from trackfg.streaming.rows import SAME_S, Rows
from trackfg.streaming.tables.smoothed_tables import SmoothedTables, TableInput, Tables
from trackfg.streaming.window.moving_window import LostWindow, MovingWindow
from trackfg.streaming.window.running_window import FilterUpdate, Relinearisation, RunningWindow
from trackfg.streaming.window.sample_buffer import SampleBuffer
from trackfg.streaming.window.starting_window import START_S, StartingWindow

if TYPE_CHECKING:
    from trackfg.maps.feature_map import FeatureMap

_KEPT_S = 30.0
"""While nothing measures the speed, rows older than this are dropped, s: no window begins with them."""
BEFORE_S = 10.0
"""Rows this much older than the window are needed, s."""
PIECE_S = 10.0
"""Smoothed tables come in pieces about as long, s."""


class FixedLagSmoother:
    """The batch smoother's graph on the last seconds of a stream, located on a map if there is one.

    Parameters
    ----------
    description
        Of the stream's tables and sensors, as of a recording.
    config
        Settings other than the defaults.
    lag_s
        How long a smoothed estimate waits for later measurements, s.
    feature_map
        A map to be located on.

    Raises
    ------
    BadInputError
        For a lag that is too short to hold two keyframes, for a description in which nothing measures speed, and for a
        map whose columns mean something else than the stream's.

    Examples
    --------
    >>> import trackfg
    >>> from trackfg.streaming.intake.intake import Intake
    >>> from trackfg.streaming.sources.source import RecordingSource
    >>> source = RecordingSource(trackfg.read_recording("run1"))
    >>> smoother = trackfg.FixedLagSmoother(source.description, lag_s=10.0)
    >>> intake = Intake.of(source)
    >>> newest = [smoother.put(intake.push(batch)[0]).filtered for batch in source]
    >>> sum(map(len, newest)) > 40  # a row per keyframe: every 20 m or 1 s, at rest every 5 s
    True
    """

    config: SmoothConfig
    settings: dict[str, str]
    """SHA-256 of each argument that it was made with, by name."""
    _buffer: SampleBuffer
    _moving: MovingWindow
    _tables: SmoothedTables | None
    _done_s: float
    """The end of the tables of a lost window, s."""
    _locator: MapLocator | None
    _tests: StreamTests
    _doubts: DoubtReports

    def __init__(
        self,
        description: RecordingDescription,
        config: SmoothConfig | None = None,
        *,
        lag_s: float = 10.0,
        feature_map: FeatureMap | None = None,
    ) -> None:
        if not isinstance(description, RecordingDescription):
            given = type(description).__name__
            raise TypeError(f"FixedLagSmoother takes a description, as recording.description, not {given}")
        if config is not None and not isinstance(config, SmoothConfig):
            raise TypeError(f"FixedLagSmoother takes settings as trackfg.smooth does, not {type(config).__name__}")
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
        self._buffer = SampleBuffer(description)
        self._locator = None if feature_map is None else MapLocator(description, self.config, feature_map)
        self._moving = MovingWindow(self._buffer, self.config, lag_s, on_map=feature_map is not None)
        self._tables, self._done_s = None, -np.inf
        self._tests, self._doubts = StreamTests(), DoubtReports()

    def put(self, rows: Rows) -> Estimates:
        """Take the next rows and return the estimates that they make."""
        self._buffer.put(rows if self._locator is None else self._locator.with_map_uncertainty(rows))
        outputs, filtered, moving = self._work_due(), [], self._moving
        t = moving.next_keyframe()
        while t is not None and moving.has_rows_for(t):
            if done := self._work_due():  # the pass may have changed the speed, and so the next keyframe's time
                outputs += done
            elif (outage := self._outage) is not None:
                outputs += self._beginning_after(outage)
            else:
                update = moving.add_keyframe(t)
                filtered += [] if update is None else [self._filtered_row(update)]
            t = moving.next_keyframe()
        if t is not None:
            moving.prepare(t)
        elif moving.running is None:
            self._buffer.forget(self._buffer.until - _KEPT_S, self._buffer.until - _KEPT_S)
        estimates = estimates_of(filtered, outputs)
        if moving.running is None or not self._doubts.are_due(self._buffer.until):
            return estimates
        return estimates._replace(events=(*estimates.events, *self._doubts.new(self._tests.events(self._moving))))

    def finish(self) -> Estimates:
        """Return what is left when no more rows come; nothing where they were too few to begin with."""
        outputs, update = self._work_due(), self._moving.add_last_keyframe()
        filtered = [] if update is None else [self._filtered_row(update)]
        outputs += self._work_due(at_end=True)
        if (waiting := self._moving.waiting_event()) is not None:
            outputs.append(PassOutput([], (waiting,)))
        last = estimates_of(filtered, outputs)
        return last._replace(events=(*last.events, *self._tests.events(self._moving)))

    def state(self) -> Snapshot:
        """Return everything that carries over from one call to the next."""
        return dump(self, self._given)

    def restore(self, state: Snapshot) -> None:
        """Go on from the :meth:`state` of a smoother made with the same arguments. Raises
        :class:`~trackfg.errors.BadInputError` where it does not fit.
        """
        vars(self).update(load_attributes(FixedLagSmoother, state, self._given))

    @property
    def keyframe_spacing(self) -> float:
        """The factor by which keyframes are further apart than the settings say. It may be set."""
        return self._moving.keyframe_spacing

    @keyframe_spacing.setter
    def keyframe_spacing(self, factor: float) -> None:
        self._moving.keyframe_spacing = factor

    @property
    def _given(self) -> tuple[object, ...]:
        feature_map = () if self._locator is None else (self._locator.feature_map,)
        return self.config, self._buffer.description, *feature_map

    def _filtered_row(self, update: FilterUpdate) -> Array:
        """Return the newest keyframe's row, (17,)."""
        window, buffer = update.newest_keyframes, self._buffer
        two = window.states.take(slice(len(window) - 2, None))
        covariance = update.covariance.with_added_distance_variance(self._moving.votes.doubt_m**2)
        if self._chainage is not None:
            covariance = self._chainage.with_uncertainty(covariance, two, buffer.description.track.direction)
        t, noise = window.t[-2:], window.measured[-1].noise
        assumed = WhiteNoise(noise.gyro[None], noise.accel[None])
        run = self._running.context.run_of(t, buffer.intervals(*t.tolist()), assumed)
        at = np.array([window.t[-1]])
        rate = buffer.mean_rate(at[0]) - two.bias[-1:, 3:]
        over, interval, end = np.array([RATE_WINDOW_S]), np.zeros(1, dtype=np.int64), np.ones(1)
        forward = mount_matrix(two.mount)[0, :, 0]
        motion = DenseMotion(at, two.nav[1:], two.odo.distance[1:], rate, over, interval, end, forward)
        row = np.concatenate(list(trajectory_columns(run, motion, two, covariance).values()))
        if self._running.heading_known:  # else sigmas are not those of the rows
            self._tests.sigmas.expect(row)
        return row

    def _work_due(self, *, at_end: bool = False) -> list[PassOutput]:
        """Do what is due besides filtered rows: a relinearisation pass, and the next piece of the tables."""
        if self._moving.running is not None:
            self._moving.running.records.speed_doubted = self._tests.sigmas.doubts("speed_mps")
        step = self._moving.relinearise_if_due(at_end=at_end)
        shift_m = self._moving.votes.pop_shift()
        if self._tables is not None:
            self._tables.history.shift(shift_m)
        if (lost := self._moving.pop_lost()) is not None:
            return [self._after_loss(lost)]
        if step is None:
            return []
        running, newest = self._running, float(step.whole_window.t[-1])
        if self._tables is None:
            begin = max(float(step.whole_window.t[0]) - SAME_S, self._done_s)
            self._tables = SmoothedTables.beginning(running.context, begin, for_map=self._locator is not None)
        tables = self._tables
        settled = newest if at_end else newest - self._moving.lag_s
        pieces = []
        if at_end or settled - tables.done_s >= PIECE_S:
            inputs = self._table_input(running, step)
            begin_s = tables.done_s
            pieces = [tables.next_piece(self._buffer, inputs, settled, at_end=at_end)]
            self._moving.votes.written_s = tables.done_s
            self._tests.put_trajectory(pieces[0].trajectory, self._moving)
            self._tests.put_window(step.whole_window)
            self._tests.put_samples(self._buffer.intervals(begin_s, tables.done_s), running, pieces[0])
        locator = self._locator
        events = self._moving.votes.pop_events() if locator is None else self._locate(locator, pieces, step)
        if step.marginalised is not None:
            tables.history.append(step.marginalised)
        if pieces:
            self._buffer.collapse_rests(tables.forget())
            newer = float(step.whole_window.t[0]) - BEFORE_S
            older = float(tables.history.t[0]) - BEFORE_S if tables.history.parts else newer
            self._buffer.forget(older, newer)
        events = (*events, *(() if step.event is None else (step.event,)))
        return [PassOutput(pieces, (*(event for piece in pieces for event in piece.events), *events))]

    def _after_loss(self, lost: LostWindow) -> PassOutput:
        """Return the tables up to where the window was lost; from there on the stream begins anew."""
        pieces, done_s = [], self._done_s
        if self._tables is not None and lost.left is not None:
            inputs = self._table_input(lost.left, Relinearisation(lost.left.window, lost.left.root, None))
            pieces = [self._tables.next_piece(self._buffer, inputs, lost.begin_s, at_end=True)]
            self._tests.put_trajectory(pieces[0].trajectory, self._moving)
            done_s = lost.begin_s
        self._begin_tables_after(done_s)
        self._tests.sigmas.lost = lost.begin_s, lost.begin_s + START_S
        event = Event("restarted", t_s=lost.begin_s, detail=lost.reason)
        return PassOutput(pieces, (*(event for piece in pieces for event in piece.events), event))

    @property
    def _outage(self) -> Outage | None:
        """The outage that the newest keyframe precedes, if one does."""
        running = self._moving.running
        return None if running is None else outage_after(self._buffer, float(running.newest.t[-1]))

    def _beginning_after(self, outage: Outage) -> list[PassOutput]:
        """Return the tables up to an outage, as at the end of a stream; the window begins anew after it."""
        outputs, moving = self._work_due(at_end=True), self._moving
        if moving.running is None:  # lost by the last pass: it begins anew in any case
            return outputs
        distance = distance_after(outage, moving.running)
        moving.running, moving.starting = None, StartingWindow.after(outage.end_s, distance)
        self._begin_tables_after(outage.begin_s)
        buffer = self._buffer
        buffer.forget(outage.end_s, outage.end_s)
        buffer.tach = buffer.tach[buffer.tach[:, 0] > outage.begin_s]  # the outage has been reported
        return [*outputs, PassOutput([], (outage.event,))]

    def _begin_tables_after(self, t: float) -> None:
        """Begin new tables, for rows after ``t``, s."""
        self._tables, self._done_s = None, t
        if self._locator is not None:
            self._locator = MapLocator(self._buffer.description, self.config, self._locator.feature_map)

    def _table_input(self, running: RunningWindow, step: Relinearisation) -> TableInput:
        doubt_m = self._moving.votes.doubt_m
        rests, usual = running.rests.spans, running.records.gnss.usual
        known = step.whole_window, step.root, step.covariance, running.records.noise
        return TableInput(*known, rests, running.tach, self._chainage, doubt_m, usual)

    def _locate(self, locator: MapLocator, pieces: list[Tables], step: Relinearisation) -> tuple[Event, ...]:
        events: list[Event] = []
        for piece in pieces:
            located = locator.locate(piece.track, step)
            events += located.events
            if located.family is not None:
                self._running.add_to_first_keyframe(located.family)
        if step.marginalised is not None:
            locator.history.append(step.marginalised)
        return tuple(events)

    @property
    def _chainage(self) -> MapChainage | None:
        """The chainage of the map, where the vehicle is located on it."""
        return self._locator.chainage if self._locator is not None and self._locator.located else None

    @property
    def _running(self) -> RunningWindow:
        """The window, which has begun. Raises ``ValueError`` before."""
        if self._moving.running is None:
            raise ValueError("the window has not begun")
        return self._moving.running
