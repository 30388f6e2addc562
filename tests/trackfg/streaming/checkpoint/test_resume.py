"""A stream that is killed goes on from its last checkpoint with the same rows and events as if it had not been."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from trackfg.streaming.checkpoint.checkpoint import Checkpoint
from trackfg.streaming.events import event_table
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.sinks.parquet_parts import ParquetParts, read_parts
from trackfg.streaming.sinks.sink import TABLES
from trackfg.streaming.sources.json_lines import JsonLinesSource
from trackfg.streaming.sources.source import Source

DESCRIPTION: dict[str, Any] = {
    "id": "down",
    "imu": {"gyro": ["wx", "wy", "wz"], "accel": ["fx", "fy", "fz"], "gyro_unit": "deg/s", "stamp": "end"},
    "tach": {"column": "v", "kind": "speed", "unit": "km/h"},
}


class KilledError(Exception):
    """The process ends here."""


def spoilt_lines(seed: int) -> bytes:
    """30 s of a stream with something of every fault in it."""
    rng = np.random.default_rng(seed)
    keyed: list[tuple[float, str]] = []
    for t in np.arange(0.0, 30.0, 0.05).round(6).tolist():
        row: dict[str, Any] = {"table": "imu", "t": t - (12.0 if t > 18.0 else 0.0)}
        row |= dict(zip(("wx", "wy", "wz", "fx", "fy", "fz"), rng.standard_normal(6).tolist(), strict=True))
        row["fz"] += 9.8
        fault = rng.integers(0, 60)
        if fault == 0:
            row["wx"] = None
        if fault == 1:
            row["t"] += 77.0
        copies = 2 if fault == 2 else 0 if fault == 3 and t > 10.0 else 1
        keyed += [(t + rng.uniform(0.0, 0.25), "rubbish" if fault == 4 else json.dumps(row))] * copies
        if round(t * 20) % 4 == 0:
            tach = {"table": "tach", "t": row["t"], "v": 30.0 + t}
            keyed.append((t + rng.uniform(0.0, 0.15), json.dumps(tach)))
    lines = [json.dumps({"description": DESCRIPTION}), *(line for _, line in sorted(keyed))]
    return "\n".join(lines).encode()


def run(source: Source, intake: Intake, sink: ParquetParts, saved: Path, *, every: int, killed_at: int | None) -> None:
    """The loop of a stream: a checkpoint at every so many batches, an end without warning."""
    for count, batch in enumerate(source, start=1):
        if count == killed_at:
            raise KilledError
        rows, events = intake.push(batch)
        sink.write("filtered", rows.frame("imu"))
        sink.write("smoothed", rows.frame("tach"))
        if events:
            sink.write("events", event_table(events))
        if count % every == 0:
            checkpoint = Checkpoint({}, sink.checkpoint(), batch.position, intake.state())
            saved.write_bytes(b"".join(checkpoint.to_bytes()))
    rows, events = intake.finish()
    sink.write("filtered", rows.frame("imu"))
    sink.write("smoothed", rows.frame("tach"))
    sink.write("events", event_table(events))
    sink.close()


@given(seed=st.integers(0, 1000), every=st.integers(5, 40), kills=st.lists(st.integers(1, 80), max_size=2))
@settings(max_examples=6, deadline=None, phases=[Phase.explicit, Phase.generate])
def test_killed_at_any_moment(
    seed: int, every: int, kills: list[int], tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("stream")
    lines = spoilt_lines(seed)
    source = JsonLinesSource(io.BytesIO(lines), batch_s=0.3)
    run(source, Intake.of(source), ParquetParts(folder / "whole"), folder / "unused", every=every, killed_at=None)

    saved = folder / "checkpoint"
    for killed_at in [*kills, None]:
        state = Checkpoint.from_bytes(saved.read_bytes()) if saved.exists() else Checkpoint({}, {})
        source = JsonLinesSource(io.BytesIO(lines), batch_s=0.3, position=state.position)
        intake = Intake.of(source)
        if state.intake is not None:
            intake.restore(state.intake)
        begun = state.sink or {name: {"part": 1, "rows": 0} for name in TABLES}
        sink = ParquetParts(folder / "killed", rows_per_part=100, state=begun)
        try:
            run(source, intake, sink, saved, every=every, killed_at=killed_at)
        except KilledError:
            continue
        break
    for table in ("filtered", "smoothed", "events"):
        pd.testing.assert_frame_equal(
            read_parts(folder / "killed", table), read_parts(folder / "whole", table), check_exact=True
        )
    kinds = set(read_parts(folder / "whole", "events")["kind"])
    assert {"not-finite", "bad-line", "clock-restart"} <= kinds
