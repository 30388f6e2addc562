"""Rows of the IMU that are no measurements are left out and counted; all others pass, however they are grouped."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trackfg.checks.inertial.imu_faults import ImuFaultDetector
from trackfg.checks.inertial.stuck_value import StuckValue
from trackfg.checks.limits import CheckLimits
from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.numerics.arrays import Array
from trackfg.numerics.rotations import matrix_from_rpy
from trackfg.recording.description import Imu, RecordingDescription, Tach
from trackfg.results.events import Event
from trackfg.streaming.events import LossReport
from trackfg.streaming.fixed_lag import FixedLagSmoother
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.sources.source import Batch, RecordingSource

RATE_HZ = 200.0
IMU = Imu(file="imu.csv", time="t", gyro=("wx", "wy", "wz"), accel=("fx", "fy", "fz"))
SIGMA = np.repeat([IMU.noise.gyro_white, IMU.noise.accel_white], 3) * np.sqrt(RATE_HZ)
BEGIN, END = 2000, 2400
"""Of a fault, in rows."""


def riding(count: int = 4000, *, steps: float = 0.0, seed: int = 0) -> Array:
    """Rows (n, 7): at rest for 4 s, then shaken; values are multiples of ``steps`` sigmas of the noise."""
    rng, t = np.random.default_rng(seed), np.arange(count) / RATE_HZ
    values = rng.normal(0.0, SIGMA, (count, 6))
    values[800:] *= 8.0
    values[:, 5] += 9.81
    if steps:
        values = np.round(values / (steps * SIGMA)) * (steps * SIGMA)
    return np.column_stack([t, values])


def stuck(rows: Array, *channels: int, begin: int = BEGIN, end: int = END) -> Array:
    out = rows.copy()
    out[begin:end, channels] = out[begin, channels]
    return out


def detector(imu: Imu = IMU, *, is_canonical: bool = True) -> ImuFaultDetector:
    return ImuFaultDetector.of(imu, CheckLimits(), is_canonical=is_canonical)


def measurements(channels: ImuFaultDetector, rows: Array, report: LossReport) -> Array:
    out, faults = channels.take(rows)
    for fault in faults:
        report.lose(fault.code, "imu", fault.t, fault.columns)
    return out


def passed(
    rows: Array, *, imu: Imu = IMU, is_canonical: bool = True, cuts: list[int] | None = None
) -> tuple[Array, list[Event]]:
    """What is left of rows that come in groups, and the events."""
    channels, report = detector(imu, is_canonical=is_canonical), LossReport()
    groups = np.split(rows, np.arange(20, len(rows), 20) if cuts is None else cuts)
    out = [*(measurements(channels, group, report) for group in groups), channels.finish()]
    return np.concatenate(out), list(report.end_of_stream())


def left_out(rows: Array, out: Array) -> np.ndarray:
    """Numbers of the rows that are missing. Those that are not must be as they were."""
    kept = np.isin(rows[:, 0], out[:, 0])
    np.testing.assert_array_equal(rows[kept], out)
    return np.flatnonzero(~kept)


@pytest.mark.parametrize("channels", [(1,), (5,), (6,), (2, 4), (1, 2, 3, 4, 5, 6)])
def test_a_stuck_channel_is_left_out_from_its_first_repetition_on(channels: tuple[int, ...]) -> None:
    rows = stuck(riding(), *channels)
    out, (event,) = passed(rows)
    np.testing.assert_array_equal(left_out(rows, out), np.arange(BEGIN + 1, END))
    assert (event.kind, event.table, event.rows) == ("stuck-channel", "imu", END - BEGIN - 1)
    assert (event.t_s, event.until_s) == (rows[BEGIN + 1, 0], rows[END - 1, 0])
    names = ["wx", "wy", "wz", "fx", "fy", "fz"]
    assert event.detail.startswith(", ".join(names[c - 1] for c in channels) + ": ")


@pytest.mark.parametrize("share", [0.3, 0.8])
@pytest.mark.parametrize("channel", [2, 6])
def test_a_channel_that_is_cut_off_is_left_out_with_what_lies_between(channel: int, share: float) -> None:
    rows = riding()
    values = rows[BEGIN:END, channel]
    values[:] = np.minimum(values, np.quantile(values, share))
    out, (event,) = passed(rows)
    missing = left_out(rows, out)
    assert event.rows == len(missing)
    assert BEGIN <= missing[0] < missing[-1] < END
    assert len(missing) > 0.75 * (END - BEGIN)
    assert (np.diff(missing) == 1).mean() > 0.98


@pytest.mark.parametrize("steps", [0.001, 0.02, 0.1, 0.3, 1.0, 3.0, 30.0])
@pytest.mark.parametrize("begin", [0, 1000])
def test_coarse_values_are_never_taken_for_a_fault(steps: float, begin: int) -> None:
    again = riding(800, steps=steps, seed=1)
    again[:, 0] += 15.0
    rows = np.concatenate([riding(3000, steps=steps)[begin:], again])
    out, events = passed(rows)
    assert not events
    np.testing.assert_array_equal(out, rows)


def test_a_stuck_channel_with_steps_is_found_once_chance_cannot_explain_it() -> None:
    rows = stuck(riding(steps=0.1), 3)
    out, (event,) = passed(rows)
    assert set(range(BEGIN + 1, END)) <= set(left_out(rows, out))
    assert event.rows < END - BEGIN + 3


@pytest.mark.parametrize("again", [2, 3, 10])
def test_a_logger_that_writes_each_sample_several_times_loses_nothing(again: int) -> None:
    rows = riding().repeat(again, axis=0)
    rows[:, 0] = np.arange(len(rows)) / (again * RATE_HZ)
    out, events = passed(rows)
    assert not events
    assert len(out) == len(rows)


def test_a_signal_without_noise_may_stay_where_it_is() -> None:
    t = np.arange(4000) / RATE_HZ
    moving = np.clip(t - 5.0, 0.0, 5.0)[:, None]
    rows = np.column_stack([t, np.sin(moving * np.arange(1, 7)) * 0.01 + [0.0, 0.0, 0.0, 0.0, 0.0, 9.81]])
    assert not passed(rows)[1]


def test_limits_that_a_user_sets_reach_a_stream() -> None:
    rows, description = riding(), RecordingDescription(id="x", imu=IMU)
    rows[BEGIN, 1] = 20.0
    dropped = []
    for limits in (CheckLimits(), CheckLimits(usual_rate_radps=25.0)):
        intake = Intake.begin(description, canonical=True, checks=limits)
        out = [intake.push(Batch({"imu": rows}))[0].imu, intake.finish()[0].imu]
        dropped.append(len(rows) - len(np.concatenate(out)))
    assert dropped == [1, 0]


def test_nothing_waits_where_nothing_repeats() -> None:
    channels, report, rows = detector(), LossReport(), riding()
    for group in np.split(rows, range(20, len(rows), 20)):
        assert len(measurements(channels, group, report)) == len(group)
        assert channels.waiting_since_s == np.inf


def test_rows_wait_no_longer_than_it_is_unclear() -> None:
    channels, report, rows = detector(), LossReport(), stuck(riding(), 4)
    waited = []
    for row in rows:
        measurements(channels, row[None], report)
        since = channels.waiting_since_s
        waited.append(row[0] - since if np.isfinite(since) else 0.0)
    assert max(waited) <= 0.2 + 1e-6
    assert np.count_nonzero(waited[:BEGIN]) == 0
    assert np.count_nonzero(waited[BEGIN + 10 : END]) == 0


@pytest.mark.parametrize("value", [1e9, -1e4, 50.0])
def test_values_that_cannot_be_are_left_out_one_by_one(value: float) -> None:
    rows, hit = riding(), [900, 2001, 2002, 2050]
    rows[hit, 1] = value
    out, (event,) = passed(rows)
    assert left_out(rows, out).tolist() == hit
    assert (event.kind, event.rows) == ("impossible-value", 4)
    assert event.detail.startswith("wx: ")


def test_a_blow_is_left_out() -> None:
    rows, rng = riding(), np.random.default_rng(1)
    rows[BEGIN : BEGIN + 40, 1:] = np.repeat([5.0, 50.0], 3) * rng.choice([-1.0, 1.0], (40, 6))
    out, (event,) = passed(rows)
    np.testing.assert_array_equal(left_out(rows, out), np.arange(BEGIN, BEGIN + 40))
    assert event.kind == "impossible-value"


def test_shaking_that_goes_on_is_believed() -> None:
    rows = riding()
    rows[BEGIN:, 4:] = np.random.default_rng(2).normal(0.0, 300.0, (len(rows) - BEGIN, 3))
    out, (event,) = passed(rows)
    assert event.rows < 150
    assert len(out) == len(rows) - event.rows
    assert event.until_s is not None
    assert event.until_s < rows[BEGIN, 0] + 2.0


def faulty() -> Array:
    """Everything at once."""
    rows = stuck(riding(steps=0.001), 2)
    rows[2500:2700, 5] = np.minimum(rows[2500:2700, 5], np.median(rows[2500:2700, 5]))
    rows[2800:2830, 1:] = [5.0, -5.0, 5.0, 50.0, -50.0, 50.0]
    rows[3000:3002, 3] = rows[3000, 3]
    rows[3100:3120] = stuck(rows[3100:3120], 1, 2, 3, 4, 5, 6, begin=0, end=20)
    rows[3990:, 6] = 9.8
    return rows


@settings(max_examples=25, deadline=None)
@given(st.lists(st.integers(1, 3999), max_size=40, unique=True).map(sorted))
def test_how_rows_are_grouped_makes_no_difference(cuts: list[int]) -> None:
    rows = faulty()
    expected, said = passed(rows, cuts=[])
    out, events = passed(rows, cuts=cuts)
    np.testing.assert_array_equal(out, expected)
    assert events == said
    assert sum(event.rows for event in events) == len(rows) - len(out) > 500


def test_rows_one_by_one_are_no_exception() -> None:
    rows = faulty()
    np.testing.assert_array_equal(passed(rows, cuts=list(range(1, len(rows))))[0], passed(rows)[0])


@pytest.mark.parametrize("cut", [0, 150, BEGIN + 2, BEGIN + 100, END + 10, 2600, 2815, 2840, 3105])
def test_it_goes_on_from_its_state(saved_and_restored: Callable[..., Any], cut: int) -> None:
    rows, report, whole = faulty(), LossReport(), detector()
    before = measurements(whole, rows[:cut], report)
    again, reports = saved_and_restored(whole), (saved_and_restored(report), report)
    rest = [
        np.concatenate([measurements(one, rows[cut:], said), one.finish()])
        for one, said in zip((again, whole), reports, strict=True)
    ]
    np.testing.assert_array_equal(*rest)
    assert reports[0].end_of_stream() == reports[1].end_of_stream()
    np.testing.assert_array_equal(np.concatenate([before, rest[0]]), passed(rows)[0])


def test_rows_in_vehicle_axes_are_judged_in_those_of_the_sensor() -> None:
    R = matrix_from_rpy(*np.radians([3.0, -2.0, 40.0]))
    rows = stuck(riding(steps=0.1), 1)
    turned = np.column_stack([rows[:, 0], rows[:, 1:4] @ R.T, rows[:, 4:] @ R.T])
    out, (event,) = passed(turned, imu=IMU.model_copy(update={"mount_rpy_deg": (3.0, -2.0, 40.0)}))
    np.testing.assert_array_equal(left_out(turned, out), left_out(rows, passed(rows)[0]))
    assert event.detail.startswith("wx: ")


def test_units_of_the_sensor_make_no_difference() -> None:
    rows = faulty()
    imu = IMU.model_copy(update={"gyro_unit": "deg/s", "accel_unit": "g"})
    raw = rows / np.array([1.0, *3 * [np.pi / 180.0], *3 * [9.80665]])
    out, events = passed(raw, imu=imu, is_canonical=False)
    expected, said = passed(rows)
    np.testing.assert_array_equal(left_out(raw, out), left_out(rows, expected))
    assert events == said


def test_what_waits_is_later_than_what_is_complete() -> None:
    """Also where another table goes on meanwhile; and all is passed on in the end, or counted."""
    rows = stuck(riding(steps=0.1), 1, end=4000)
    tach = np.column_stack([rows[:, 0], 0.01 * np.arange(len(rows))])
    description = RecordingDescription(
        id="stuck", imu=IMU, tach=Tach(file="tach.csv", time="t", column="distance", kind="distance", unit="m")
    )
    intake, until, count, lost = Intake.begin(description, canonical=True), -np.inf, 0, 0
    for i in range(0, len(rows), 20):
        batch = Batch({"imu": rows[i : i + 20], "tach": tach[i : i + 20]})
        passed_on, events = intake.push(batch)
        assert (passed_on.imu[:, 0] > until).all()
        assert (passed_on.tach[:, 0] > until).all()
        assert passed_on.until_s >= until
        until, count, lost = passed_on.until_s, count + len(passed_on), lost + sum(event.rows for event in events)
    rest, events = intake.finish()
    lost += sum(event.rows for event in events)
    assert lost > len(rows) - BEGIN - 10
    assert intake.rows_in == 2 * len(rows) == count + len(rest) + lost
    assert intake.rows_out == count + len(rest)


def levels(values: list[float], chance: float, patience: int) -> Iterator[int]:
    for first, end in StuckValue().take(values, 0, float("nan"), chance, patience):
        yield from range(first, end)


def test_a_plateau_ends_where_values_on_both_sides_are_seen() -> None:
    values = [1.0, 2.0, 2.0, 1.0, 3.0, 2.0, 2.1, 2.0]
    assert not list(levels(values, 1e-4, 40))
    assert list(levels([1.0, 2.0, 2.0, 1.0, 1.5, 2.0, 0.5, 2.0], 1e-4, 40)) == [2, 3, 4, 5, 6, 7]


def test_the_likelier_a_repetition_the_more_of_them_are_chance() -> None:
    run, chances = [0.0] * 40, (1e-6, 2e-3, 0.12, 0.4, 0.6)
    fewest = [next((n for n in range(1, 41) if list(levels(run[:n], p, 0))), None) for p in chances]
    assert fewest == [3, 5, 11, 24, None]


@pytest.fixture(scope="module")
def ride() -> Simulation:
    plan = scenario("mainline-gnss")
    return simulate(replace(plan, driver=replace(plan.driver, start_rest_s=9.0)), seed=1, duration_s=42.0)


def test_estimates_are_within_their_sigmas_after_every_fault(ride: Simulation) -> None:
    rng, imu = np.random.default_rng(0), ride.recording.imu.to_numpy(copy=True)
    row = {t: int(np.searchsorted(imu[:, 0], t)) for t in (20.0, 21.5, 24.0, 25.0, 26.0, 26.1, 27.0)}
    imu[row[20.0] : row[21.5], 4] = imu[row[20.0], 4]
    cut = imu[row[24.0] : row[25.0], 1]
    cut[:] = np.minimum(cut, np.median(cut))
    imu[row[26.0] : row[26.1], 1:] = np.repeat([5.0, 50.0], 3) * rng.choice([-1.0, 1.0], (row[26.1] - row[26.0], 6))
    imu[row[27.0], 1:] = [1e4, 0.0, -1e4, 1e9, -1e9, 0.0]
    recording = replace(ride.recording, imu=pd.DataFrame(imu, columns=ride.recording.imu.columns))
    source = RecordingSource(recording, batch_s=1.0)
    intake, smoother = Intake.of(source), FixedLagSmoother(recording.description, lag_s=6.0)
    pieces, kinds = [], []
    for batch in source:
        rows, events = intake.push(batch)
        kinds += [event.kind for event in events]
        pieces.append(smoother.put(rows).filtered)
    table = pd.concat([piece for piece in pieces if len(piece)])
    assert set(kinds) == {"stuck-channel", "impossible-value"}
    after = table[table["t_s"] > 30.0]
    assert len(after) > 8
    for name, small in (("roll_rad", 1e-4), ("pitch_rad", 1e-4), ("speed_mps", 0.005), ("east_m", 0.02)):
        error = after[name] - np.interp(after["t_s"], ride.truth["t_s"], ride.truth[name])
        assert (np.abs(error) < 4.0 * after[f"{name}_sd"] + small).all(), name
