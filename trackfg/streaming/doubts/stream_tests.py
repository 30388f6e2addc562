"""A stream's tests take what it writes and measures, and say what they doubt, meanwhile and at its end."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from trackfg.graph.inputs import declared_noise
from trackfg.results.events import Event
from trackfg.sensors.imu_intervals import Intervals
from trackfg.streaming.doubts.accelerometer_test import AccelerometerTest
from trackfg.streaming.doubts.axle_test import AxleTest
from trackfg.streaming.doubts.bandwidth_test import BandwidthTest
from trackfg.streaming.doubts.cut_test import CutTest
from trackfg.streaming.doubts.far_priors import mounting_doubts, prior_doubts
from trackfg.streaming.doubts.fix_delay_test import FixDelayTest
from trackfg.streaming.doubts.lean_test import LeanTest
from trackfg.streaming.doubts.rest_count_test import RestCountTest
from trackfg.streaming.doubts.roll_test import RollTest
from trackfg.streaming.doubts.shared_error_test import SharedErrorTest
from trackfg.streaming.doubts.sigma_test import SigmaTest, fix_doubts
from trackfg.streaming.doubts.tach_test import TachTest
from trackfg.streaming.doubts.track_cells import TrackCells
from trackfg.streaming.doubts.vibration_test import VibrationTest
from trackfg.streaming.tables.smoothed_tables import Tables
from trackfg.streaming.window.moving_window import MovingWindow
from trackfg.streaming.window.running_window import RunningWindow
from trackfg.streaming.window.window import Window


@dataclass
class StreamTests:
    """The tests of a stream, each in a module of its own; ``cells`` are the smoothed rows on a grid along the way."""

    sigmas: SigmaTest = field(default_factory=SigmaTest)
    cells: TrackCells = field(default_factory=TrackCells)
    roll: RollTest = field(default_factory=RollTest)
    lean: LeanTest = field(default_factory=LeanTest)
    cut: CutTest = field(default_factory=CutTest)
    fix_delay: FixDelayTest = field(default_factory=FixDelayTest)
    shared_error: SharedErrorTest = field(default_factory=SharedErrorTest)
    tach: TachTest = field(default_factory=TachTest)
    rest_count: RestCountTest = field(default_factory=RestCountTest)
    vibration: VibrationTest = field(default_factory=VibrationTest)
    accelerometer: AccelerometerTest = field(default_factory=AccelerometerTest)
    bandwidth: BandwidthTest = field(default_factory=BandwidthTest)
    axles: AxleTest = field(default_factory=AxleTest)

    def put_trajectory(self, smoothed: pd.DataFrame, moving: MovingWindow) -> None:
        """Take the next smoothed rows, of the stream whose window is ``moving``."""
        self.sigmas.put(smoothed)
        if len(smoothed):
            t = smoothed["t_s"].to_numpy()
            others = moving.buffer.other_rows_between(float(t[0]) - 1.0, float(t[-1]))
            self.fix_delay.put(smoothed, others.fixes)
            self.shared_error.put(smoothed, others.gnss)
        cells = self.cells.put(smoothed)
        self.roll.put(cells)
        if moving.buffer.description.imu.rigid:
            self.lean.put(cells)
        else:
            self.cut.put(cells, smoothed, moving.votes.tested)

    def put_samples(self, samples: Intervals, running: RunningWindow, led_to: Tables) -> None:
        """Take samples, and the tables that they led to, into the tests of what the sensor makes of the track."""
        description = running.buffer.description
        if description.imu.rigid:
            step_m = running.context.conventions.step_m
            self.bandwidth.put(samples, running.rests.spans, led_to.geometry, step_m)
            declared = declared_noise(description, running.context.config)
            self.axles.put(samples, declared, running.records.noise.shown, led_to, step_m)
        self.vibration.put(samples, led_to.trajectory, led_to.geometry, self.bandwidth.bandwidths.least_hz)
        self.accelerometer.put(samples, led_to.trajectory)
        clock_sd_s = running.context.config.tach.clock_offset_sd_s
        self.rest_count.put(samples, running.buffer.tach, running.rests.spans, description, clock_sd_s)

    def put_window(self, window: Window) -> None:
        """Take the window of a pass after which tables are written."""
        self.tach.put(window)

    def events(self, moving: MovingWindow) -> tuple[Event, ...]:
        """Return what the tests say now of all that has come."""
        until, running, description = moving.buffer.until, moving.running, moving.buffer.description
        doubts = self.sigmas.events(until, positions=description.gnss is not None)
        doubts += (*self.roll.events(until), *self.lean.events(until), *self.cut.events(until))
        doubts += fix_doubts(moving.votes.tested, moving.votes.squares, until)
        doubts += self.fix_delay.events(moving.votes.innovations, until)
        placed = description.gnss is not None or description.fixes is not None
        doubts += self.tach.events(until, placed=placed)
        if running is not None:
            doubts += self.vibration.events(until, running.context.conventions)
            doubts += (*self.accelerometer.events(until), *self.bandwidth.events(until))
            doubts += self.axles.events(until)
            doubts += self.rest_count.events(until, description, moving.config.tach.clock_offset_sd_s)
            records = running.records
            doubts += (*records.noise.events(until), *records.gnss.events(until), *records.gnss_speeds.events(until))
            doubts += records.walk.events(until)
            if not moving.config.position.gnss_correlation_s:
                doubts += self.shared_error.events(records.gnss, until, has_fixes=description.fixes is not None)
            if description.imu.rigid:
                doubts += records.noise.track_doubts(until)
                if running.heading_known and not records.noise.has_risen:  # noise moves the point, too
                    known_to = np.array(description.imu.lever_arm_sigma_m)
                    doubts += mounting_doubts(running.newest.states.mount[0], known_to, until)
            declared = description.imu.noise.rectification_sd
            doubts += prior_doubts(running.newest.states, moving.config, declared, until)
        return doubts
