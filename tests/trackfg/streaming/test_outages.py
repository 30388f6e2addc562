"""A time without any rows that is too long to be bridged: the estimates begin anew, where the tach's count says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.recording.model import Recording
from trackfg.results.events import Event
from trackfg.streaming.fixed_lag import FixedLagSmoother
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.outages import LONGEST_S
from trackfg.streaming.sources.source import RecordingSource

BEGIN_S, END_S = 70.5, 190.5


@pytest.fixture(scope="module")
def run() -> Simulation:
    return simulate("mainline", seed=3, duration_s=215.0)


def interrupted(recording: Recording, *, restarts: bool = False) -> Recording:
    """A recorder that was off for two minutes while the vehicle went on; ``restarts``: its count then begins at 0."""

    def kept(table: pd.DataFrame) -> pd.DataFrame:
        return table[(table["t_s"] < BEGIN_S) | (table["t_s"] > END_S)].reset_index(drop=True)

    assert recording.tach is not None
    tach = kept(recording.tach)
    if restarts:
        after = tach["t_s"] > END_S
        tach.loc[after, "distance_m"] -= tach.loc[after, "distance_m"].iloc[0]
    return replace(recording, imu=kept(recording.imu), tach=tach)


def streamed(recording: Recording) -> tuple[pd.DataFrame, pd.DataFrame, list[Event]]:
    source = RecordingSource(recording)
    intake, smoother = Intake.of(source), FixedLagSmoother(recording.description, lag_s=10.0)
    pieces = [smoother.put(intake.push(batch)[0]) for batch in source]
    pieces += [smoother.put(intake.finish()[0]), smoother.finish()]
    filtered, smoothed = (
        pd.concat([table for piece in pieces if len(table := getattr(piece, name))])
        for name in ("filtered", "smoothed")
    )
    return filtered, smoothed, [event for piece in pieces for event in piece.events]


def off_m(run: Simulation, table: pd.DataFrame) -> np.ndarray:
    true = np.interp(table["t_s"], run.truth["t_s"], run.truth["chainage_m"]) - run.truth["chainage_m"].iloc[0]
    return (table["chainage_m"] - true).to_numpy()


def test_the_estimates_begin_anew_where_the_count_says(run: Simulation) -> None:
    assert END_S - BEGIN_S > LONGEST_S
    filtered, smoothed, events = streamed(interrupted(run.recording))
    kinds = [event.kind for event in events]
    assert [kinds.count(kind) for kind in ("restarted", "imu gap", "tach gap", "by-batch")] == [1, 1, 1, 0]
    for table in (filtered, smoothed):
        assert not table["t_s"].between(BEGIN_S + 0.1, END_S - 0.1).any()
        assert (np.abs(off_m(run, table)) < 3.0 * table["chainage_m_sd"] + 0.01).all()
        assert table["chainage_m_sd"].max() < 60.0
        true = np.interp(table["t_s"], run.truth["t_s"], run.truth["speed_mps"])
        assert np.abs(table["speed_mps"] - true).max() < 0.5
    assert smoothed["t_s"].is_monotonic_increasing
    assert smoothed["t_s"].iloc[-1] > 214.0


def test_a_count_that_began_again_shows_nothing(run: Simulation) -> None:
    filtered, _, events = streamed(interrupted(run.recording, restarts=True))
    assert [event.kind for event in events].count("restarted") == 1
    late = filtered[filtered["t_s"] > END_S]
    assert (np.abs(off_m(run, late)) < late["chainage_m_sd"]).all()
