"""What takes over where a step fails: the whole window, a batch, a new window; and no output is lost."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackfg.config import KeyframeConfig, SmoothConfig
from trackfg.datasets.scenarios import scenario, simulate
from trackfg.datasets.vehicle.driving import Service
from trackfg.errors import UnsolvableError
from trackfg.results.events import Event
from trackfg.streaming.estimates import Estimates
from trackfg.streaming.fixed_lag import FixedLagSmoother
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.rows import Rows
from trackfg.streaming.run import Stream
from trackfg.streaming.sinks.sink import Callback
from trackfg.streaming.sources.json_lines import JsonLinesSource
from trackfg.streaming.sources.source import RecordingSource
from trackfg.streaming.window import running_window, starting_window, window_solver
from trackfg.streaming.window.window import Window

from .conftest import setting_off

RUN = simulate(setting_off("mainline"), seed=3, duration_s=57.0)
AT_S = 27.0
Tables = tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame, list[Event]]


def streamed(batch_s: float | None = None) -> Tables:
    source = RecordingSource(RUN.recording, batch_s=batch_s)
    smoother = FixedLagSmoother(source.description, SmoothConfig(keyframes=KeyframeConfig(interval_s=0.5)), lag_s=5.0)
    intake, out = Intake.of(source), list[Estimates]()
    for batch in source:
        out.append(smoother.put(intake.push(batch)[0]))
    out += [smoother.put(intake.finish()[0]), smoother.finish()]
    tables = (pd.concat([one[i] for one in out if len(one[i])], ignore_index=True) for i in range(3))
    return *tables, [event for one in out for event in one.events]


@pytest.fixture(scope="module")
def undisturbed() -> Tables:
    return streamed()


@pytest.fixture
def failing(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Steps of windows whose newest keyframe is between 27 and 32 s fail, of some lengths; and batches."""

    def fail(longest: int, *, batches: bool = False) -> None:
        updated_by = Window.updated_by

        def step(window: Window, *args: Any) -> Any:
            if AT_S < window.t[-1] < AT_S + 5.0 and len(window) <= longest:
                raise UnsolvableError("as asked")
            return updated_by(window, *args)

        monkeypatch.setattr(Window, "updated_by", step)
        if batches:

            def solve(problem: Any, config: Any) -> Any:
                if AT_S < problem.t[-1] < AT_S + 5.0:
                    raise UnsolvableError("as asked")
                return solved(problem, config)

            solved = window_solver.solve
            monkeypatch.setattr(window_solver, "solve", solve)

    return fail


def close(ours: pd.DataFrame, undisturbed: pd.DataFrame, name: str, sigmas: float) -> None:
    away = np.abs(ours[name] - undisturbed[name]) / undisturbed[f"{name}_sd"]
    assert away.max() < sigmas, name


def test_the_front_takes_over_from_the_tip(failing: Callable[..., None], undisturbed: Tables) -> None:
    failing(2)
    ours = streamed()
    assert [event.kind for event in ours[3]] == [event.kind for event in undisturbed[3]]
    for mine, other in zip(ours[:2], undisturbed[:2], strict=True):
        np.testing.assert_array_equal(mine["t_s"], other["t_s"])
        for name in ("roll_rad", "chainage_m", "speed_mps"):
            close(mine, other, name, 0.3)


def test_the_whole_window_takes_over_from_the_front(failing: Callable[..., None], undisturbed: Tables) -> None:
    failing(10)
    ours = streamed()
    reported = [event for event in ours[3] if event.kind == "by-window"]
    assert len(reported) == 9
    assert reported[0].detail == "as asked"
    assert not [event for event in undisturbed[3] if event.kind.startswith("by-")]
    for mine, other in zip(ours[:2], undisturbed[:2], strict=True):
        np.testing.assert_array_equal(mine["t_s"].round(6), other["t_s"].round(6))
        # Steps of the window come at other times than without: the smoothed rows know more or less of what comes.
        for name in ("roll_rad", "chainage_m", "speed_mps"):
            close(mine, other, name, 3.0)


def test_a_new_window_begins_where_no_batch_helps(failing: Callable[..., None], undisturbed: Tables) -> None:
    failing(1000, batches=True)
    ours = streamed()
    reported = [event for event in ours[3] if event.kind == "restarted"]
    assert len(reported) == 1
    assert {event.kind for event in ours[3]} == {"restarted", "standstill"}  # what follows needs no help
    assert reported[0].t_s is not None
    assert AT_S - 5.0 <= reported[0].t_s < AT_S + 1.0  # a pass is taken every ten keyframes, 5 s
    np.testing.assert_allclose(np.diff(ours[1]["t_s"]), 0.1, atol=0.051)  # of smoothed rows none is missing
    assert len(ours[1]) >= len(undisturbed[1]) - 1
    truth, late = RUN.truth, ours[1][ours[1]["t_s"] > AT_S + 1.0]
    for name in ("roll_rad", "chainage_m", "speed_mps"):
        error = late[name] - np.interp(late["t_s"], truth["t_s"], truth[name] - truth[name].iloc[0])
        assert (np.abs(error) < 5.0 * late[f"{name}_sd"]).mean() > 0.98, name
    assert late["chainage_m_sd"].max() < 20.0


def test_a_settled_step_is_kept_where_the_batch_solution_fails(
    monkeypatch: pytest.MonkeyPatch, undisturbed: Tables
) -> None:
    """Every window looks as if the wheel slipped, and so is compared with a batch solution, which fails."""
    failures = 0

    def fail(problem: Any, config: Any) -> Any:
        nonlocal failures
        if problem.t[-1] < AT_S:
            return solve(problem, config)
        failures += 1
        raise UnsolvableError("as asked")

    solve, suspects_slip = window_solver.solve, Window.suspects_slip.fget
    monkeypatch.setattr(window_solver, "solve", fail)
    monkeypatch.setattr(Window, "suspects_slip", property(lambda window: window.t[-1] > AT_S or suspects_slip(window)))
    ours = streamed()
    assert failures > 5
    assert ours[3] == undisturbed[3]
    for mine, other in zip(ours[:3], undisturbed[:3], strict=True):
        pd.testing.assert_frame_equal(mine, other, check_exact=True)


def test_a_prediction_that_fails_before_its_last_rows_come_loses_the_window_when_they_have(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    predict_interval = running_window.predict_interval

    def fail(context: Any, window: Any, data: Any, edges: Any, at_rest: Any, **kwargs: Any) -> Any:
        if AT_S < data.edges[edges[1]] < AT_S + 1.0:
            raise UnsolvableError("as asked")
        return predict_interval(context, window, data, edges, at_rest, **kwargs)

    monkeypatch.setattr(running_window, "predict_interval", fail)
    reported = [event for event in streamed(batch_s=0.1)[3] if event.kind == "restarted"]
    assert [event.detail for event in reported] == ["as asked"]


def test_a_window_of_one_keyframe_may_be_the_last(monkeypatch: pytest.MonkeyPatch) -> None:
    """After an interval as long as the lag one keyframe is left, and the stream may end before the next one."""
    source = RecordingSource(RUN.recording)
    smoother, intake = FixedLagSmoother(source.description, lag_s=5.0), Intake.of(source)
    for batch in source:
        smoother.put(intake.push(batch)[0])
    running = smoother._moving.running
    assert running is not None
    running.relinearise_if_due(at_end=True)
    running.lag_s = 0.0
    running.relinearise_if_due(at_end=True)
    assert len(running.window) == 1
    assert running.added == []
    before = running.window.states.nav.p
    last = running.relinearise_if_due(at_end=True)
    assert last is not None
    assert last.marginalised is None
    np.testing.assert_allclose(running.window.states.nav.p, before, atol=1e-3)


def test_a_first_window_that_cannot_be_made_comes_later(monkeypatch: pytest.MonkeyPatch) -> None:
    build = starting_window.build_problem

    def fail(recording: Any, *args: Any, **kwargs: Any) -> Any:
        if recording.imu["t_s"].iloc[0] < 15.0:
            raise UnsolvableError("as asked")
        return build(recording, *args, **kwargs)

    monkeypatch.setattr(starting_window, "build_problem", fail)
    filtered, smoothed, _, events = streamed()
    assert [event.kind for event in events].count("restarted") == 2
    assert 29.0 < filtered["t_s"].iloc[0] < 31.0
    assert smoothed["t_s"].iloc[0] == pytest.approx(20.0, abs=0.11)


def test_what_fails_at_the_end_leaves_the_rows_before_it_written(monkeypatch: pytest.MonkeyPatch) -> None:
    source = RecordingSource(simulate("measuring-car", seed=0, duration_s=10.0).recording)
    stream, put, steps = Stream.of(source, FixedLagSmoother(source.description, lag_s=5.0)), list[Rows](), list[Any]()
    smoother_put = stream.smoother.put

    def counted(rows: Rows) -> Estimates:
        put.append(rows)
        return smoother_put(rows)

    def fail() -> Estimates:
        raise UnsolvableError("as asked")

    monkeypatch.setattr(stream.smoother, "put", counted)
    monkeypatch.setattr(stream.smoother, "finish", fail)
    with pytest.raises(UnsolvableError, match="as asked"):
        stream.run(Callback(lambda table, frame: None), watch=steps.append)
    assert len(steps) == len(put) > 1


def test_the_batch_solvers_work_on_rows_in_random_order_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Such rows determine no heading: without a bound each keyframe solves again a window that has grown by one.

    Windows lost one after another have half the work each, but for what the last solution of each took.
    """
    most, work, last, begins = 2000, list[int](), list[int](), list[int]()
    windows, batch = running_window.RunningWindow.begin, window_solver.WindowSolver._batch_solution

    def begin(*args: Any, **kwargs: Any) -> Any:
        begins.append(kwargs["damped_work"])
        work.append(0)
        last.append(0)
        return windows(*args, **kwargs)

    def counted(self: Any, window: Window, config: Any) -> Window:
        before = self.damped_work
        solution = batch(self, window, config)
        step = self.damped_work - before
        work[-1] += step
        last[-1] = step or last[-1]  # once the heading is known solutions are free
        return solution

    monkeypatch.setattr(window_solver, "_MOST_DAMPED", most)
    monkeypatch.setattr(running_window.RunningWindow, "begin", begin)
    monkeypatch.setattr(window_solver.WindowSolver, "_batch_solution", counted)
    source = JsonLinesSource(_in_random_order())
    smoother, intake, events = FixedLagSmoother(source.description, lag_s=10.0), Intake.of(source), list[Event]()
    for push in source:
        events += smoother.put(intake.push(push)[0]).events
    events += [*smoother.put(intake.finish()[0]).events, *smoother.finish().events]
    for before, window, step in zip(begins, work, last, strict=True):
        assert before + window <= max(most, before) + step
    assert begins[0] == 0
    assert begins[1:] == [(before + window) // 2 for before, window in zip(begins, work, strict=True)][:-1]
    restarts = [event.detail for event in events if event.kind == "restarted"]
    assert any("the heading is unknown after" in detail for detail in restarts), restarts


@pytest.mark.slow
def test_a_vehicle_that_waits_with_unknown_heading_is_not_begun_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """At the platform no row determines the heading, however many there are."""
    monkeypatch.setattr(window_solver, "_MOST_DAMPED", 2000)
    plan = scenario("mainline-gnss")
    assert isinstance(plan.driver, Service)
    run = simulate(replace(plan, driver=replace(plan.driver, start_rest_s=40.0)), seed=6, duration_s=60.0)
    source = RecordingSource(run.recording, batch_s=1.0)
    smoother, intake, events = FixedLagSmoother(source.description), Intake.of(source), list[Event]()
    for push in source:
        events += smoother.put(intake.push(push)[0]).events
    last = smoother.finish()
    assert not [event for event in events if event.kind == "restarted"]
    assert last.filtered["yaw_rad_sd"].iloc[-1] < 0.03


def _in_random_order() -> io.BytesIO:
    run = simulate("no-stop", seed=0, duration_s=30.0).recording
    assert run.tach is not None
    imu, names = run.imu.iloc[::2], ("t", "wx", "wy", "wz", "fx", "fy", "fz")
    lines = [json.dumps({"table": "imu", **dict(zip(names, row, strict=True))}) for row in imu.to_numpy().tolist()]
    lines += [json.dumps({"table": "tach", "t": t, "d": d}) for t, d in run.tach.to_numpy().tolist()]
    lines = np.random.default_rng(1).permutation(lines).tolist()
    tach = {"column": "d", "kind": "distance", "unit": "m"}
    imu_columns = {"gyro": ["wx", "wy", "wz"], "accel": ["fx", "fy", "fz"]}
    first = json.dumps({"description": {"id": "shuffled", "imu": imu_columns, "tach": tach}})
    return io.BytesIO("\n".join([first, *lines, ""]).encode())
