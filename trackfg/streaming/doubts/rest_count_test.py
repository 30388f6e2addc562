"""A stream tests whether its tach goes on counting while the vehicle rests, by :mod:`trackfg.sensors.counted_rests`.

A batch makes rests of such spans before there is a graph. A stream has taken them for motion by the time that the start
shows them: its speed did not come to 0, and biases followed.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import union
from trackfg.recording.description import RecordingDescription
from trackfg.recording.model import IMU_COLUMNS, Recording
from trackfg.results.events import Event, doubt_event
from trackfg.sensors.imu_intervals import Intervals, means_between
from trackfg.sensors.standstills import counted_standstills

_STEP_S = 0.1
"""Samples are kept as means over this, s."""

_MOST = 6000
"""So many means are looked at together, ten minutes; then the older half is dropped."""

_QUANTITIES = (
    *("chainage", "position", "height", "speed", "roll", "pitch", "cross_level", "twist", "level", "alignment"),
    *("curvature", "gradient"),
)
"""Nothing but yaw is left: speed, biases and mounting follow a wheel that seems to roll."""


@dataclass
class RestCountTest:
    """The test keeps means of rate and force, and the tach's distance in the middle of each, as ``rows`` (n, 8); rests
    that the stream knows, (r, 2), s; and those ``counted`` through, (c, 2), s, that were found.
    """

    rows: Array = field(default_factory=lambda: np.zeros((0, 8)))
    rests: Array = field(default_factory=lambda: np.zeros((0, 2)))
    counted: Array = field(default_factory=lambda: np.zeros((0, 2)))

    def put(
        self, samples: Intervals, tach: Array, rests: Array, description: RecordingDescription, sd_s: float
    ) -> None:
        """Take the next samples, rows of the tach (m, 2) that cover them, and the newest ``rests``. ``sd_s``: sigma of
        the tach's clock, s.
        """
        edges = np.arange(samples.edges[0], samples.edges[-1], _STEP_S)
        if len(edges) < 2 or len(tach) < 2:
            return
        gyro, accel = (means_between(edges[:-1], edges[1:], samples.edges, of) for of in (samples.gyro, samples.accel))
        middle = 0.5 * (edges[1:] + edges[:-1])
        self.rows = np.concatenate([self.rows, np.column_stack([middle, gyro, accel, np.interp(middle, *tach.T)])])
        self.rests = union(np.concatenate([self.rests, rests]))
        if len(self.rows) >= _MOST:
            self._look(description, sd_s)
            self.rows = self.rows[_MOST // 2 :]
            self.rests = self.rests[self.rests[:, 1] > self.rows[0, 0]]

    def events(self, until_s: float, description: RecordingDescription, sd_s: float) -> tuple[Event, ...]:
        """Return an event where the tach counted while the vehicle rested. ``sd_s``: sigma of the tach's clock, s."""
        self._look(description, sd_s)
        if not len(self.counted):
            return ()
        sentence = f"the tach goes on counting while the vehicle rests, as from {self.counted[0, 0]:.0f} s on"
        return (doubt_event(_QUANTITIES, sentence, "smooth the recording, and mend the tach", t_s=until_s),)

    def _look(self, description: RecordingDescription, sd_s: float) -> None:
        """Look for rests that were counted through in the rows at hand."""
        if len(self.rows) < 2:
            return
        imu = pd.DataFrame(self.rows[:, :7], columns=IMU_COLUMNS)
        tach = pd.DataFrame(self.rows[:, [0, 7]], columns=["t_s", "distance_m"])
        counted, _ = counted_standstills(Recording(description, imu, tach), self.rests, sd_s)
        self.counted = union(np.concatenate([self.counted, counted]))
