"""The fixed-lag smoother against the batch smoother, and against the truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackfg import smooth
from trackfg.config import KeyframeConfig, SmoothConfig
from trackfg.datasets.catalogue import scenario
from trackfg.datasets.faults import drop_imu, drop_tach
from trackfg.datasets.scenarios import simulate
from trackfg.errors import BadInputError
from trackfg.evaluation.geometry_errors import geometry_errors
from trackfg.numerics.kernels import compiled_kernels
from trackfg.recording.model import IMU_COLUMNS, Recording
from trackfg.results.columns import GEOMETRY_COLUMNS, TRAJECTORY_COLUMNS
from trackfg.results.result import Result
from trackfg.streaming.fixed_lag import FixedLagSmoother
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.sources.source import RecordingSource
from trackfg.streaming.window.moving_window import MovingWindow

from .conftest import setting_off

ATTITUDE = ("roll_rad", "pitch_rad", "yaw_rad")


def at(table: pd.DataFrame, name: str, t: np.ndarray) -> np.ndarray:
    return np.interp(t, table["t_s"], table[name])


@pytest.fixture(scope="module")
def run() -> Any:
    """A train that stands for 10 s, then moves with GNSS."""
    plan = scenario("mainline-gnss")
    return simulate(replace(plan, driver=replace(plan.driver, start_rest_s=10.0)), seed=1, duration_s=90.0)


@pytest.fixture(scope="module")
def ours(stream: Callable[..., Any], run: Any) -> Any:
    return stream(run.recording, lag_s=20.0)


@pytest.fixture(scope="module")
def batch(run: Any) -> Result:
    return smooth(run.recording, SmoothConfig(keyframes=KeyframeConfig(interval_s=0.5)))


def test_a_lag_as_long_as_the_run_is_the_batch(stream: Callable[..., Any], run: Any, batch: Result) -> None:
    ours, theirs = stream(run.recording, lag_s=1000.0), batch.trajectory
    t = ours.smoothed["t_s"].to_numpy()
    for name in ATTITUDE:
        sd = at(theirs, f"{name}_sd", t)
        away = (ours.smoothed[name].to_numpy() - at(theirs, name, t)) / sd
        assert np.sqrt(np.mean(away**2)) < 0.15, name
        np.testing.assert_allclose(np.median(ours.smoothed[f"{name}_sd"] / sd), 1.0, rtol=0.05)


def test_a_step_of_the_whole_window_leaves_nothing_to_move(run: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the newest keyframe knows goes back to all others first: from there one step is the solution."""
    lengths = []
    passed = MovingWindow.relinearise_if_due

    def again(self: MovingWindow, **kwargs: Any) -> Any:
        step = passed(self, **kwargs)
        if step is not None and self.running is not None and self.running.heading_known:
            lengths.append(self.running.window.gauss_newton_step().root.length)
        return step

    monkeypatch.setattr(MovingWindow, "relinearise_if_due", again)
    source = RecordingSource(run.recording)
    smoother, intake = FixedLagSmoother(source.description, lag_s=10.0), Intake.of(source)
    for batch in source:
        smoother.put(intake.push(batch)[0])
    assert len(lengths) > 5
    assert np.median(lengths) < 0.02
    assert max(lengths) < 1.0


def _with_shocks(recording: Recording) -> Recording:
    """Return the recording with sideways shocks of two samples, of which the last is known only by what comes late."""
    imu, across = recording.imu.copy(), IMU_COLUMNS[5]
    for t, shock in ((20.0, 6.0), (21.0, 6.0), (22.0, 6.0), (23.0, 6.0), (35.0, 0.5)):
        at = int(np.searchsorted(imu["t_s"] - imu["t_s"].iloc[0], t))
        imu.loc[imu.index[at : at + 2], across] += shock
    return replace(recording, imu=imu)


@pytest.mark.parametrize(("changed", "longer_s"), [(lambda recording: recording, 1.7), (_with_shocks, 12.0)])
def test_how_rows_are_grouped_makes_no_difference(
    changed: Callable[[Recording], Recording], longer_s: float, stream: Callable[..., Any]
) -> None:
    """Bit by bit with the compiled kernels; numpy rounds sums by where the record that is at hand begins."""
    recording = changed(simulate(setting_off("mainline"), seed=1, duration_s=37.0).recording)
    first, second = (stream(recording, lag_s=5.0, batch_s=batch_s) for batch_s in (0.1, longer_s))
    for one, other in zip(first[1:4], second[1:4], strict=True):
        if compiled_kernels():
            pd.testing.assert_frame_equal(one, other, check_exact=True)
        else:
            pd.testing.assert_frame_equal(one, other, rtol=1e-12, atol=1e-12)


def test_tables(ours: Any, run: Any) -> None:
    assert tuple(ours.filtered) == tuple(ours.smoothed) == TRAJECTORY_COLUMNS
    assert tuple(ours.geometry) == ("t_s", *GEOMETRY_COLUMNS)
    np.testing.assert_allclose(np.diff(ours.smoothed["t_s"]), 0.1, atol=1e-9)
    np.testing.assert_allclose(np.diff(ours.geometry["chainage_m"]), 0.25, atol=1e-9)
    assert ours.smoothed["t_s"].iloc[-1] > run.recording.imu["t_s"].iloc[-1] - 0.11
    assert (np.diff(ours.filtered["t_s"]) > 0.0).all()


def test_errors_are_within_their_sigmas_and_shrink_with_the_lag(ours: Any, run: Any) -> None:
    truth, rms = run.truth, {}
    for what, table in (("filtered", ours.filtered), ("smoothed", ours.smoothed)):
        t = table["t_s"].to_numpy()
        for name in ("speed_mps", "roll_rad", "pitch_rad"):
            z = (table[name].to_numpy() - at(truth, name, t)) / table[f"{name}_sd"].to_numpy()
            assert np.sqrt(np.mean(z**2)) < 2.0
            rms[what, name] = float(np.sqrt(np.mean((table[name].to_numpy() - at(truth, name, t)) ** 2)))
    assert rms["smoothed", "speed_mps"] < rms["filtered", "speed_mps"]


def test_twist_is_as_good_as_the_batch_smoothers(ours: Any, batch: Result, run: Any) -> None:
    rms = []
    for geometry, trajectory in ((ours.geometry, ours.smoothed), (batch.geometry, batch.trajectory)):
        errors = geometry_errors(geometry, trajectory, run.truth, run.truth_geometry)["twist_mm"].dropna()
        assert len(errors) > 0.9 * len(batch.geometry)
        rms.append(np.sqrt(np.mean(errors**2)))
    assert rms[0] < 2.0 * rms[1]  # in two minutes the sensor is not as well known as over a whole run


def test_a_start_that_no_fix_has_shown_yet_is_not_claimed(stream: Callable[..., Any]) -> None:
    """Without a fix in the first seconds the place along the track is unknown, then it is known."""
    simulation = simulate("shuttle", seed=0, duration_s=100.0)
    fixes = simulation.recording.fixes
    first = fixes["t_s"].iloc[0]
    assert first > 15.0
    ours = stream(simulation.recording, lag_s=10.0).filtered
    before, after = ours[ours["t_s"] < first - 1.0], ours[ours["t_s"] > first + 1.0]
    assert len(before) > 0 < len(after)
    assert (before["chainage_m_sd"] > 1e3).all()
    error = after["chainage_m"] - at(simulation.truth, "chainage_m", after["t_s"].to_numpy())
    assert (np.abs(error) < 4.0 * after["chainage_m_sd"] + 0.1).all()


def test_a_tach_that_is_off_says_of_no_rest(stream: Callable[..., Any]) -> None:
    plan = scenario("trolley")
    run = simulate(replace(plan, driver=replace(plan.driver, start_rest_s=9.0)), seed=0, duration_s=50.0)
    tach = run.recording.tach
    off_s = (25.0, 35.0)  # at walking pace on smooth track, where the inertial sensor is as quiet as at rest
    off = replace(run.recording, tach=tach[~tach["t_s"].between(*off_s)].reset_index(drop=True))
    assert run.truth["speed_mps"][run.truth["t_s"].between(*off_s)].min() > 0.5
    ours = stream(off, lag_s=10.0)
    assert [event.t_s for event in ours.events if event.kind == "standstill" and event.t_s > 20.0] == []
    away = ours.smoothed["speed_mps"] - at(run.truth, "speed_mps", ours.smoothed["t_s"])
    assert (away.abs() < 5.0 * ours.smoothed["speed_mps_sd"])[ours.smoothed["t_s"] > 20.0].all()


def test_seconds_without_any_rows_are_not_taken_for_even_motion(stream: Callable[..., Any]) -> None:
    run = simulate(setting_off("mainline"), seed=3, duration_s=42.0)
    off_s = (16.63, 20.89)  # while it accelerates
    ours = stream(drop_tach(drop_imu(run.recording, *off_s), *off_s), lag_s=10.0)
    after = ours.filtered[ours.filtered["t_s"] > off_s[1]]
    for name in ("speed_mps", "pitch_rad"):
        away = after[name].to_numpy() - at(run.truth, name, after["t_s"].to_numpy())
        assert (np.abs(away) < 4.0 * after[f"{name}_sd"]).all(), name


def test_a_lag_without_two_keyframes_is_refused(run: Any) -> None:
    with pytest.raises(BadInputError, match="a lag of 1 s: expected 2 s or more"):
        FixedLagSmoother(run.recording.description, lag_s=1.0)


def test_what_is_no_description_or_no_settings_is_said_so(run: Any) -> None:
    with pytest.raises(TypeError, match=r"takes a description, as recording\.description, not Recording"):
        FixedLagSmoother(run.recording)
    with pytest.raises(TypeError, match=r"takes settings as trackfg\.smooth does, not dict"):
        FixedLagSmoother(run.recording.description, {"output": {}})  # type: ignore[arg-type]


def test_without_anything_that_measures_speed_it_is_refused(run: Any) -> None:
    blind = run.recording.description.model_copy(update={"tach": None, "gnss": None})
    with pytest.raises(BadInputError, match="nothing measures speed"):
        FixedLagSmoother(blind)


def test_lasers_show_the_rails(stream: Callable[..., Any]) -> None:
    simulation = simulate("measuring-car-b", seed=0, duration_s=80.0)
    assert not simulation.recording.description.imu.rigid
    ours = stream(simulation.recording, lag_s=10.0)
    assert {"gauge_mm", "level_left_mm", "alignment_right_mm_sd"} <= set(ours.geometry)
    np.testing.assert_allclose(np.diff(ours.geometry["chainage_m"]), 0.25, atol=1e-9)
    errors = geometry_errors(ours.geometry, ours.smoothed, simulation.truth, simulation.truth_geometry)
    for name in ("gauge_mm", "twist_mm", "level_left_mm", "alignment_right_mm"):
        z = (errors[name] / ours.geometry[f"{name}_sd"]).dropna()
        assert len(z) > 1000
        assert np.sqrt(np.mean(z**2)) < 2.0, name
    assert np.sqrt(np.mean(errors["gauge_mm"] ** 2)) < 0.1
