"""A recording replayed: every row once, in the order of time, and in real time when asked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackfg.io.reader import read_recording
from trackfg.recording.model import Recording
from trackfg.streaming.rows import recording_rows
from trackfg.streaming.sources.source import RecordingSource


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory, example_tables: Any) -> Recording:
    folder: Path = tmp_path_factory.mktemp("rec")
    example_tables["imu"].to_csv(folder / "imu.csv", index=False)
    example_tables["tach"].to_csv(folder / "tach.csv", index=False)
    (folder / "recording.toml").write_text(
        'format = "trackfg-recording/1"\nid = "x"\n[imu]\nfile = "imu.csv"\ngyro = ["wx", "wy", "wz"]\n'
        'accel = ["fx", "fy", "fz"]\n[tach]\nfile = "tach.csv"\ncolumn = "count"\nkind = "pulses"\n'
        "pulses_per_rev = 90\nwheel_diameter_m = 0.86\ntime_offset_s = 0.25\n"
    )
    return read_recording(folder)


@pytest.mark.parametrize("batch_s", [0.1, 1.0, 1000.0])
def test_every_row_comes_once(batch_s: float, recording: Recording) -> None:
    batches = list(RecordingSource(recording, batch_s=batch_s))
    for name, table in recording_rows(recording).tables().items():
        parts = [batch.tables[name] for batch in batches if name in batch.tables]
        np.testing.assert_array_equal(np.concatenate(parts) if parts else table[:0], table)
    assert [batch.position for batch in batches] == [round(1e3 * batch_s * (i + 1)) for i in range(len(batches))]
    edges = [(table[0, 0], table[-1, 0]) for batch in batches for table in batch.tables.values()]
    assert max(last - first for first, last in edges) < batch_s


def test_a_position_leaves_out_what_was_read(recording: Recording) -> None:
    whole = list(RecordingSource(recording, batch_s=5.0))
    rest = list(RecordingSource(recording, batch_s=5.0, position=70_000))
    assert [batch.position for batch in rest] == [batch.position for batch in whole[14:]]
    np.testing.assert_array_equal(rest[0].tables["imu"], whole[14].tables["imu"])


def test_a_position_is_the_same_in_batches_of_any_length(recording: Recording) -> None:
    longer, shorter = (
        np.concatenate([batch.tables["imu"] for batch in source if "imu" in batch.tables])
        for source in (RecordingSource(recording, batch_s=batch_s, position=3700) for batch_s in (1.0, 0.1))
    )
    np.testing.assert_array_equal(longer, shorter)


def test_real_time_waits_for_the_last_row_of_a_batch(recording: Recording) -> None:
    now, slept = [100.0], []

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        now[0] += seconds

    for batch in RecordingSource(recording, batch_s=1.0, speed=10.0, clock=lambda: now[0], sleep=sleep):
        assert now[0] >= 100.0 + 1e-4 * batch.position - 1e-9
        now[0] += 0.53 if batch.position == 10_000 else 0.01  # one batch takes as long as five
    assert now[0] == pytest.approx(100.0 + 1e-4 * batch.position, abs=0.02)
    assert len(slept) == batch.position / 1000 - 5  # it caught up


def test_a_row_years_away_is_one_more_batch(recording: Recording) -> None:
    tach = recording.tach
    assert tach is not None
    later = pd.DataFrame({"t_s": [1e12], "distance_m": tach["distance_m"].iloc[-1:]})
    batches = list(RecordingSource(replace(recording, tach=pd.concat([tach, later], ignore_index=True))))
    assert len(batches) == len(list(RecordingSource(recording))) + 1
    assert batches[-1].tables["tach"][0, 0] == 1e12
