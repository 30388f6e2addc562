"""What intake reports and the estimator must not bridge: a device that was off, a counter that began again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from trackfg.config import KeyframeConfig, SmoothConfig
from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.datasets.vehicle.driving import Service
from trackfg.numerics.spans import subtract
from trackfg.results.events import Event
from trackfg.streaming.events import motion_breaks
from trackfg.streaming.fixed_lag import FixedLagSmoother
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.rows import RowTables
from trackfg.streaming.sources.source import Batch, RecordingSource

WHEN_S, OFF_S = 45.0, 12.0
TWICE_A_SECOND = SmoothConfig(keyframes=KeyframeConfig(interval_s=0.5))


@pytest.fixture(scope="module")
def run() -> Simulation:
    plan = scenario("mainline-gnss")
    assert isinstance(plan.driver, Service)
    return simulate(replace(plan, driver=replace(plan.driver, start_rest_s=10.0)), seed=3, duration_s=90.0)


def streamed(run: Simulation, batches: Iterator[Batch]) -> tuple[pd.DataFrame, list[str]]:
    """Filtered rows, and the kinds of events."""
    intake = Intake.of(RecordingSource(run.recording))
    smoother = FixedLagSmoother(run.recording.description, TWICE_A_SECOND, lag_s=8.0)
    pieces, kinds = [], []
    for batch in batches:
        rows, events = intake.push(batch)
        kinds += [event.kind for event in events]
        pieces.append(smoother.put(rows))
    pieces += [smoother.put(intake.finish()[0]), smoother.finish()]
    kinds += [event.kind for piece in pieces for event in piece.events]
    return pd.concat([piece.filtered for piece in pieces if len(piece.filtered)]), kinds


def sigmas(run: Simulation, table: pd.DataFrame, name: str, later_s: float = 0.0) -> np.ndarray:
    """Errors ten seconds after and later."""
    late = table[table["t_s"] > WHEN_S + 10.0]
    true = np.interp(late["t_s"] + later_s, run.truth["t_s"], run.truth[name])
    return ((late[name] - true) / late[f"{name}_sd"]).to_numpy()


def off_for_a_time(run: Simulation) -> Iterator[Batch]:
    """A device that loses its power while the vehicle goes on, and then begins at zero, clock and count."""
    assert run.recording.tach is not None
    count = float(np.interp(WHEN_S + OFF_S, run.recording.tach["t_s"], run.recording.tach["distance_m"]))

    def again(name: str, rows: np.ndarray) -> np.ndarray:
        before, after = rows[rows[:, 0] <= WHEN_S], rows[rows[:, 0] > WHEN_S + OFF_S].copy()
        after[:, 0] -= WHEN_S + OFF_S
        if name == "tach":
            after[:, 1] -= count
        return np.concatenate([before, after])

    for batch in RecordingSource(run.recording, batch_s=0.5):
        tables: RowTables = {name: again(name, rows) for name, rows in batch.tables.items()}
        yield Batch(tables, batch.events)


def test_a_device_that_was_off_is_not_bridged(run: Simulation) -> None:
    table, kinds = streamed(run, off_for_a_time(run))
    assert "clock-restart" in kinds
    for name in ("east_m", "north_m", "speed_mps", "roll_rad", "pitch_rad", "yaw_rad"):
        assert np.abs(sigmas(run, table, name, OFF_S)).max() < 4.5, name
        assert np.sqrt(np.mean(sigmas(run, table, name, OFF_S) ** 2)) < 2.0, name
    moved = run.truth["chainage_m"].iloc[0]
    place = table["chainage_m"] + moved - np.interp(table["t_s"] + OFF_S, run.truth["t_s"], run.truth["chainage_m"])
    after = table["t_s"] > WHEN_S + 1.0
    assert (np.abs(place[after]) < 4.0 * table["chainage_m_sd"][after]).all()


def test_a_count_that_begins_again_is_taken_up(run: Simulation) -> None:
    def begun_again() -> Iterator[Batch]:
        for batch in RecordingSource(run.recording, batch_s=0.5):
            tables = dict(batch.tables)
            if "tach" in tables:
                tach = tables["tach"].copy()
                tach[tach[:, 0] > WHEN_S, 1] -= 400.0
                tables["tach"] = tach[::10]  # ten rows, of which each is to prove the new count, take some time
            yield Batch(tables, batch.events)

    table, kinds = streamed(run, begun_again())
    assert kinds.count("tach-reset") == 1
    assert not {"slip", "slide"} & set(kinds)
    moved = table["chainage_m"] + run.truth["chainage_m"].iloc[0]
    late = table["t_s"] > WHEN_S
    error = moved - np.interp(table["t_s"], run.truth["t_s"], run.truth["chainage_m"])
    assert (np.abs(error[late]) < 4.0 * table["chainage_m_sd"][late]).all()
    assert table["chainage_m_sd"].iloc[-1] < 10.0


def test_breaks_are_reported_by_table() -> None:
    events = [
        Event("clock-restart", "imu", 1.0, 1.1),
        Event("clock-restart", "tach", 1.0, 1.0),
        Event("tach-reset", "tach", 2.0, 2.5),
        Event("gap", "imu", 3.0, 4.0),
    ]
    breaks = motion_breaks(events)
    assert {name: spans.tolist() for name, spans in breaks.items()} == {"imu": [[1.0, 1.1]], "tach": [[2.0, 2.5]]}


def test_a_span_about_a_break_becomes_two() -> None:
    spans = np.array([[0.0, 10.0], [20.0, 30.0]])
    assert subtract(spans, np.array([[4.0, 5.0]])).tolist() == [[0.0, 4.0], [5.0, 10.0], [20.0, 30.0]]
    assert subtract(spans, np.array([[10.0, 12.0], [19.0, 21.0]])).tolist() == [[0.0, 10.0], [21.0, 30.0]]
    assert subtract(spans, np.zeros((0, 2))).tolist() == spans.tolist()
