"""Back-pressure: keyframes get sparser while rows come too fast, and denser again, and it is said."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackfg.config import KeyframeConfig, SmoothConfig
from trackfg.datasets.scenarios import simulate
from trackfg.streaming.back_pressure import BackPressure
from trackfg.streaming.fixed_lag import FixedLagSmoother
from trackfg.streaming.run import Stream
from trackfg.streaming.sources.source import RecordingSource


def factors(pace: BackPressure, took: list[tuple[float, float]], batch_s: float = 0.1) -> list[float]:
    """After each batch, which somebody waited for and which took so long."""
    out = []
    for i, (waited, busy) in enumerate(took):
        before, event = pace.factor, pace.record(waited, busy, i * batch_s)
        assert (event is not None) == (pace.factor != before)
        out.append(pace.factor)
    return out


def test_a_quick_machine_changes_nothing() -> None:
    assert set(factors(BackPressure(), [(0.0, 0.099)] * 10_000)) == {1.0}
    assert set(factors(BackPressure(), [(0.09, 0.01), (0.0, 1.5)] * 1000)) == {1.0}  # it waits: nothing is queued


def test_a_slow_one_makes_keyframes_sparser_step_by_step_and_no_more_than_eight_times() -> None:
    found = factors(BackPressure(), [(0.0, 0.2)] * 2000)
    assert list(dict.fromkeys(found)) == [1.0, 2.0, 4.0, 8.0]
    assert 15 < found.index(2.0) < 25  # two seconds behind


def test_it_goes_back_when_it_has_caught_up() -> None:
    pace = BackPressure()
    factors(pace, [(0.0, 0.2)] * 30)
    assert pace.factor == 2.0
    later = factors(BackPressure(pace.factor, pace.behind_s, pace.at_change_s), [(0.0, 0.05)] * 400)
    assert later[0] == 2.0
    assert later[-1] == 1.0
    assert later.index(1.0) > 100  # not before ten seconds


def test_time_that_nobody_knows_is_no_time() -> None:
    pace = BackPressure()
    assert pace.record(0.0, 100.0, -np.inf) is None
    assert pace.behind_s == 0.0


class Kept:
    """A sink."""

    def __init__(self) -> None:
        self.tables: dict[str, list[pd.DataFrame]] = {}

    def write(self, table: str, rows: pd.DataFrame) -> None:
        self.tables.setdefault(table, []).append(rows)

    def checkpoint(self) -> dict[str, Any]:
        return {}

    def close(self) -> None:
        pass


@pytest.fixture(scope="module")
def slow() -> Kept:
    """A live stream on a machine on which every look at the clock is 0.15 s later: batches of 0.1 s take as long."""
    recording, sink = simulate("mainline", seed=0, duration_s=60.0).recording, Kept()
    source = RecordingSource(recording, speed=1.0, sleep=lambda seconds: None)
    smoother = FixedLagSmoother(recording.description, SmoothConfig(keyframes=KeyframeConfig(interval_s=0.5)))
    stream = Stream.of(source, smoother)
    ticks = itertools.count()
    stream.clock = lambda: 0.15 * (next(ticks) // 2)  # the same at the end of a batch and at the begin of the next
    counts = stream.run(sink)
    assert counts.rows_in == counts.rows_used
    return sink


def test_a_live_stream_says_that_it_takes_fewer_keyframes(slow: Kept) -> None:
    events = pd.concat(slow.tables["events"])
    reported = events[events["kind"] == "sparser"]
    assert len(reported) == 3
    assert "8 times further apart" in reported["detail"].iloc[-1]
    t = pd.concat([rows for rows in slow.tables["filtered"] if len(rows)])["t_s"]
    assert np.median(np.diff(t[t > reported["t_s"].iloc[-1] + 5.0])) == pytest.approx(4.0, abs=0.01)


def test_and_leaves_nothing_out(slow: Kept) -> None:
    smoothed = pd.concat([rows for rows in slow.tables["smoothed"] if len(rows)])
    np.testing.assert_allclose(np.diff(smoothed["t_s"]), 0.1, atol=1e-9)
