"""Events of a stream: each once, whole, and those of the batch smoother."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackfg import smooth
from trackfg.config import SmoothConfig
from trackfg.datasets.faults import drop_imu, drop_tach, slip_wheel
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.datasets.vehicle.adhesion import WheelSlip
from trackfg.evaluation.slip_scores import score_slips
from trackfg.results.columns import EVENT_COLUMNS
from trackfg.results.events import Event

from ..conftest import setting_off

SLIPS = ("slip", "slide")


def table_of(events: Sequence[Event]) -> pd.DataFrame:
    """As a result's events."""
    rows = [
        (
            e.kind,
            e.t_s,
            e.until_s,
            e.chainage_m,
            e.chainage_m_sd,
            e.distance_removed_m,
            e.distance_removed_m_sd,
            e.detail,
        )
        for e in events
    ]
    table = pd.DataFrame(rows, columns=list(EVENT_COLUMNS))
    numbers = list(EVENT_COLUMNS[1:-1])
    table[numbers] = table[numbers].astype(float)
    return table.sort_values("start_s", ignore_index=True)


def twice(t: pd.Series) -> float:
    """How close two events of a kind come, s."""
    return float(np.diff(np.sort(t)).min(initial=np.inf))


@pytest.fixture(scope="module")
def slipping() -> Simulation:
    """A slip, and a slide that is longer than a piece, and than the lag."""
    run = simulate(setting_off("mainline"), seed=2, duration_s=107.0)
    return slip_wheel(run, [WheelSlip(44.0, 3.0, 0.3), WheelSlip(67.0, 16.0, -0.25)])


@pytest.fixture(scope="module")
def reported(stream: Callable[..., Any], slipping: Simulation) -> pd.DataFrame:
    return table_of(stream(slipping.recording, lag_s=8.0).events)


def test_slips_are_reported_once_and_whole(reported: pd.DataFrame, slipping: Simulation) -> None:
    score = score_slips(reported, slipping.slips.astype({"start_s": float, "end_s": float}), slipping.truth)
    assert score.recall == 1.0
    assert score.precision == 1.0
    found = reported[reported["kind"].isin(SLIPS)]
    assert found["kind"].tolist() == ["slip", "slide"]
    off = found["distance_removed_m"].to_numpy() - slipping.slips["distance_error_m"].to_numpy(dtype=float)
    assert (np.abs(off) < 4.0 * found["distance_removed_m_sd"] + 0.05).all()
    np.testing.assert_allclose(found["start_s"], slipping.slips["start_s"].astype(float), atol=1.5)
    np.testing.assert_allclose(found["end_s"], slipping.slips["end_s"].astype(float), atol=1.5)


def test_events_are_the_batch_smoothers(reported: pd.DataFrame, slipping: Simulation) -> None:
    batch = smooth(slipping.recording).events
    assert reported["kind"].tolist() == batch["kind"].tolist()
    np.testing.assert_allclose(reported[["start_s", "end_s"]], batch[["start_s", "end_s"]], atol=2.0)
    slip = batch["kind"].isin(SLIPS)
    np.testing.assert_allclose(
        reported["distance_removed_m"][slip], batch["distance_removed_m"][slip], rtol=0.05, atol=0.1
    )


def test_how_rows_are_grouped_makes_no_difference(
    stream: Callable[..., Any], reported: pd.DataFrame, slipping: Simulation
) -> None:
    again = table_of(stream(slipping.recording, lag_s=8.0, batch_s=3.7).events)
    pd.testing.assert_frame_equal(again, reported, check_exact=True)


def test_holes_are_reported(stream: Callable[..., Any]) -> None:
    recording = simulate(setting_off("mainline"), seed=2, duration_s=87.0).recording
    events = table_of(stream(drop_tach(drop_imu(recording, 42.0, 44.0), 62.0, 77.0), lag_s=8.0).events)
    events = events.set_index("kind")
    assert events.index.tolist() == ["standstill", "imu gap", "tach gap"]
    assert events.loc["imu gap", ["start_s", "end_s"]].tolist() == pytest.approx([42.0, 44.0], abs=0.01)
    assert events.loc["tach gap", ["start_s", "end_s"]].tolist() == pytest.approx([62.0, 77.0], abs=0.05)


def test_a_tach_that_falls_silent_for_good_is_a_gap_up_to_the_end(stream: Callable[..., Any]) -> None:
    recording = simulate(setting_off("mainline"), seed=0, duration_s=52.0).recording
    dead, ends_earlier = (stream(drop_tach(recording, since, 52.1), lag_s=8.0).events for since in (27.0, 49.0))
    ((gap_s, gap_until_s),) = [(event.t_s, event.until_s) for event in dead if event.kind == "tach gap"]
    assert (gap_s, gap_until_s) == pytest.approx((27.0, 52.0), abs=0.05)
    assert "tach gap" not in {event.kind for event in ends_earlier}


def test_fixes_are_used_or_set_aside(stream: Callable[..., Any]) -> None:
    recording = simulate("shunting", seed=0, duration_s=240.0).recording
    assert recording.fixes is not None
    assert len(recording.fixes) > 2
    fixes = recording.fixes.copy()
    fixes.loc[1, "chainage_m"] += 100.0
    events = table_of(stream(replace(recording, fixes=fixes), lag_s=10.0, config=SmoothConfig()).events)
    used, aside = (events[events["kind"] == f"fix {what}"] for what in ("used", "set aside"))
    np.testing.assert_allclose(aside["start_s"], fixes["t_s"][[1]], atol=0.01)
    np.testing.assert_allclose(used["start_s"], fixes["t_s"].drop(1), atol=0.01)


def test_gnss_outliers_are_runs(stream: Callable[..., Any]) -> None:
    recording = simulate(setting_off("mainline-gnss"), seed=3, duration_s=87.0).recording
    assert recording.gnss is not None
    gnss = recording.gnss.copy()
    gnss.loc[58:70, "east_m"] += 60.0
    events = stream(replace(recording, gnss=gnss), lag_s=8.0, config=SmoothConfig()).events
    aside = [event for event in events if event.kind == "gnss set aside" and 57.0 < (event.t_s or 0.0) < 72.0]
    assert [(event.t_s, event.until_s) for event in aside] == [pytest.approx((58.0, 70.0), abs=0.01)]
    assert aside[0].detail.startswith("13 positions")


@pytest.mark.slow
def test_a_tach_that_is_stuck_for_long_is_reported_in_parts(
    stream: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("trackfg.streaming.tables.settled_events.LONGEST_S", 10.0)  # and up to a pass more
    recording = simulate(setting_off("mainline-gnss"), seed=2, duration_s=98.0).recording
    assert recording.tach is not None
    tach = recording.tach.copy()
    tach["distance_m"] = np.where(
        tach["t_s"] > 44.0, np.interp(44.0, tach["t_s"], tach["distance_m"]), tach["distance_m"]
    )
    events = table_of(stream(replace(recording, tach=tach), lag_s=8.0, config=SmoothConfig()).events)
    slides = events[events["kind"] == "slide"]
    assert len(slides) > 2
    assert slides["start_s"].min() == pytest.approx(44.0, abs=1.5)
    assert slides["end_s"].max() == pytest.approx(98.0, abs=1.5)
    between = slides["start_s"].to_numpy()[1:] - slides["end_s"].to_numpy()[:-1]
    np.testing.assert_allclose(between, 0.1, atol=0.11)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "duration_s"), [(1, 80.0), (2, 175.0)])
def test_recall_and_precision_are_those_of_the_batch_smoother(
    stream: Callable[..., Any], seed: int, duration_s: float
) -> None:
    run = simulate("slippery-line-leaves", seed=seed, duration_s=duration_s)
    slips = run.slips.astype({"start_s": float, "end_s": float, "peak_creep": float})
    batch = score_slips(smooth(run.recording).events, slips, run.truth)
    events = stream(run.recording, lag_s=10.0, batch_s=2.0, config=SmoothConfig()).events
    ours = score_slips(table_of(events), slips, run.truth)
    assert len(ours.found) >= len(batch.found) - 1  # a slip of 0.1 m is at the edge of what shows
    assert ours.precision >= batch.precision - 0.05
