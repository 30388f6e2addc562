"""Events: rests, holes, fixes, and an injected slip and slide with the distance they took out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.faults import drop_imu, drop_tach
from trackfg.datasets.scenarios import Simulation
from trackfg.recording.model import Recording
from trackfg.results.columns import EVENT_COLUMNS
from trackfg.smoothing.smoother import smooth

TRACK_S = 150.0


@pytest.fixture(scope="module")
def run(simulated: Callable[..., Simulation]) -> Simulation:
    return simulated("mainline", seed=2, duration_s=TRACK_S)


def events_of(recording: Recording) -> pd.DataFrame:
    return smooth(recording, SmoothConfig()).events


def wheel_off(recording: Recording, start_s: float, end_s: float, factor: float) -> tuple[Recording, float]:
    """The tach's increments between two times multiplied by ``factor``; and the nominal distance that this added."""
    assert recording.tach is not None
    tach = recording.tach.copy()
    step = np.diff(tach["distance_m"], prepend=tach["distance_m"].iloc[0])
    inside = (tach["t_s"] > start_s) & (tach["t_s"] <= end_s)
    quantum = step[step > 0].min()
    spoiled = np.cumsum(np.where(inside, factor, 1.0) * step)
    tach["distance_m"] = np.floor(spoiled / quantum + 1e-6) * quantum
    return replace(recording, tach=tach), float((factor - 1.0) * step[inside].sum())


def test_sound_run_has_its_rest_and_nothing_else(run: Simulation) -> None:
    events = events_of(run.recording)
    assert tuple(events.columns) == EVENT_COLUMNS
    assert events["kind"].tolist() == ["standstill"]
    rest = events.iloc[0]
    assert rest["start_s"] == pytest.approx(0.0, abs=2.0)
    assert rest["end_s"] == pytest.approx(30.0, abs=2.0)
    assert rest["chainage_m"] == pytest.approx(0.0, abs=0.05)
    assert np.isnan(rest["distance_removed_m"])


@pytest.mark.parametrize(
    ("factor", "kind", "seed"),
    [(1.3, "slip", 2), (0.6, "slide", 5)],
)
def test_wheel_that_does_not_roll_is_reported(
    simulated: Callable[..., Simulation], factor: float, kind: str, seed: int
) -> None:
    run = simulated("mainline", seed=seed, duration_s=TRACK_S)
    recording, nominal = wheel_off(run.recording, 70.0, 75.0, factor)
    result = smooth(recording, SmoothConfig())
    found = result.events[result.events["kind"].isin(["slip", "slide"])]
    assert set(found["kind"]) == {kind}
    assert found["start_s"].min() == pytest.approx(70.0, abs=1.5)
    assert found["end_s"].max() == pytest.approx(75.0, abs=1.5)
    removed, sd = found["distance_removed_m"].sum(), float(np.sqrt((found["distance_removed_m_sd"] ** 2).sum()))
    true = nominal * run.wheel_scale
    assert removed * true > 0
    assert abs(removed - true) < max(3.0 * sd, 0.05)
    assert sd < 0.2 * abs(true)
    # The run goes on as if nothing had been: the distance after it is right within its sigma.
    t = result.trajectory["t_s"].to_numpy()
    error = result.trajectory["chainage_m"] - run.ride.motion.distance(t) + run.ride.motion.distance(0.0)
    assert np.abs(error / result.trajectory["chainage_m_sd"]).to_numpy()[t > 40.0].max() < 4.0


def test_holes_are_reported_with_their_times(run: Simulation) -> None:
    events = events_of(drop_tach(drop_imu(run.recording, 60.0, 65.0), 90.0, 110.0)).set_index("kind")
    assert events.loc["imu gap", ["start_s", "end_s"]].tolist() == pytest.approx([60.0, 65.0], abs=0.01)
    assert events.loc["tach gap", ["start_s", "end_s"]].tolist() == pytest.approx([90.0, 110.0], abs=0.05)
    place = run.ride.motion.distance(60.0) - run.ride.motion.distance(0.0)
    gap = events.loc["imu gap"]
    assert abs(gap["chainage_m"] - place) < 4.0 * gap["chainage_m_sd"]


def test_fixes_are_used_or_set_aside(simulated: Callable[..., Simulation]) -> None:
    recording = simulated("shunting", seed=0, duration_s=240.0).recording
    assert recording.fixes is not None
    events = events_of(recording)
    assert events["kind"].tolist().count("fix used") == len(recording.fixes)
    fixes = recording.fixes.copy()
    fixes.loc[1, "chainage_m"] += 100.0
    events = events_of(replace(recording, fixes=fixes))
    aside = events[events["kind"] == "fix set aside"]
    assert aside["start_s"].tolist() == pytest.approx([fixes.loc[1, "t_s"]], abs=0.01)
    assert float(aside["detail"].iloc[0].split()[1]) == pytest.approx(100.0, abs=2.0)
    assert events["kind"].tolist().count("fix used") == len(fixes) - 1


def test_gnss_outliers_are_runs(simulated: Callable[..., Simulation]) -> None:
    recording = simulated("mainline-gnss", seed=3, duration_s=120.0).recording
    assert recording.gnss is not None
    gnss = recording.gnss.copy()
    gnss.loc[80:82, "east_m"] += 60.0
    events = events_of(replace(recording, gnss=gnss))
    aside = events[events["kind"] == "gnss set aside"]
    wide = aside[aside["start_s"].between(79.0, 81.0)]
    assert wide[["start_s", "end_s"]].to_numpy()[0] == pytest.approx([80.0, 82.0], abs=0.01)
    assert wide["detail"].iloc[0].startswith("3 positions")


def test_events_are_in_order_and_chainage_follows_the_direction(simulated: Callable[..., Simulation]) -> None:
    recording = simulated("shunting", seed=0, duration_s=240.0).recording
    events = events_of(recording)
    assert (np.diff(events["start_s"]) >= 0).all()
    assert (events["end_s"] >= events["start_s"]).all()
    assert (events["chainage_m_sd"] > 0).all()
    track = recording.description.track.model_copy(update={"direction": -1})
    description = recording.description.model_copy(update={"track": track})
    assert recording.fixes is not None
    fixes = recording.fixes.assign(chainage_m=-recording.fixes["chainage_m"])
    falling = events_of(replace(recording, description=description, fixes=fixes))
    np.testing.assert_allclose(falling["chainage_m"], -events["chainage_m"], atol=1e-6)
