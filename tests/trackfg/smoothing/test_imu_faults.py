"""Rows of the IMU that are no measurements: the batch does without them, as a stream does, and says so."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from trackfg import smooth
from trackfg.checks.inertial.imu_faults import without_imu_faults
from trackfg.checks.limits import CheckLimits
from trackfg.datasets.scenarios import simulate
from trackfg.errors import UnsolvableError
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.sources.source import RecordingSource

BEGIN_S, END_S = 40.0, 41.5


@pytest.fixture(scope="module")
def run() -> Any:
    return simulate("mainline", seed=3, duration_s=90.0)


def with_fault(run: Any, column: str, value: float | None = None) -> Any:
    """The recording with a channel stuck for 1.5 s, or with a value there."""
    imu = run.recording.imu.copy()
    rows = imu["t_s"].between(BEGIN_S, END_S)
    imu.loc[rows, column] = imu.loc[rows, column].iloc[0] if value is None else value
    return replace(run.recording, imu=imu)


@pytest.mark.parametrize(("column", "value"), [("wz_radps", None), ("fy_mps2", None), ("fx_mps2", 1e4)])
def test_batch_and_stream_drop_the_same_rows(run: Any, column: str, value: float | None) -> None:
    recording = with_fault(run, column, value)
    kept = without_imu_faults(recording, CheckLimits()).imu["t_s"].to_numpy()
    source = RecordingSource(recording)
    intake = Intake.of(source)
    pieces = [intake.push(batch)[0].imu for batch in source] + [intake.finish()[0].imu]
    np.testing.assert_array_equal(kept, np.concatenate(pieces)[:, 0])
    assert len(kept) < len(recording.imu) - 200


def without_samples(run: Any, *, filled: bool) -> Any:
    """The recording with a hole of 1.5 s in its IMU, which may be filled by interpolation."""
    imu, hole = run.recording.imu, run.recording.imu["t_s"].between(BEGIN_S, END_S)
    left = imu[~hole]
    if filled:
        columns = {name: np.interp(imu["t_s"], left["t_s"], left[name]) for name in imu.columns[1:]}
        left = imu.assign(**columns)
    return replace(run.recording, imu=left.reset_index(drop=True))


def test_a_hole_that_was_filled_is_one_all_the_same(run: Any) -> None:
    filled, left = (smooth(without_samples(run, filled=filled)) for filled in (True, False))
    (finding,) = [one for one in filled.summary.findings if one.code == "imu-rows-dropped"]
    assert "lie on straight lines" in finding.message
    rows = ~left.trajectory["t_s"].between(BEGIN_S - 0.01, BEGIN_S + 0.2)  # the hole begins a sample later
    for name in ("roll_rad", "yaw_rad", "speed_mps"):
        for column in (name, f"{name}_sd"):
            off = (filled.trajectory[column] - left.trajectory[column])[rows]
            assert (np.abs(off) < 0.1 * left.trajectory[f"{name}_sd"][rows]).all(), column
    recording = without_samples(run, filled=True)
    kept = without_imu_faults(recording, CheckLimits()).imu["t_s"].to_numpy()
    source = RecordingSource(recording)
    intake = Intake.of(source)
    pieces = [intake.push(batch)[0].imu for batch in source] + [intake.finish()[0].imu]
    np.testing.assert_array_equal(kept, np.concatenate(pieces)[:, 0])


def test_a_stuck_gyro_does_not_turn_the_vehicle(run: Any) -> None:
    result = smooth(with_fault(run, "wx_radps"))
    (finding,) = [one for one in result.summary.findings if one.code == "imu-rows-dropped"]
    assert "wx_radps show one value again and again" in finding.message
    assert finding.time_s == pytest.approx(BEGIN_S, abs=0.02)
    (gap,) = result.events[result.events["kind"] == "imu gap"].itertuples()
    assert (gap.start_s, gap.end_s) == (pytest.approx(BEGIN_S, abs=0.02), pytest.approx(END_S, abs=0.02))
    for name in ("roll_rad", "pitch_rad", "speed_mps"):
        error = result.trajectory[name] - np.interp(result.trajectory["t_s"], run.truth["t_s"], run.truth[name])
        assert (np.abs(error) < 5.0 * result.trajectory[f"{name}_sd"]).all(), name


def test_an_imu_without_rows_is_refused_with_the_reason(run: Any) -> None:
    recording = run.recording
    with pytest.raises(UnsolvableError, match=r"^the IMU record has 0 samples over 0 s: at least 10 .* are needed$"):
        smooth(replace(recording, imu=recording.imu.iloc[:0]))
    with pytest.raises(UnsolvableError, match=r"are needed; 60 rows not used, .*: fx_mps2 show values beyond"):
        smooth(replace(recording, imu=recording.imu.iloc[:60].assign(fx_mps2=1e4)))


def test_a_sound_recording_stays_as_it_is(run: Any) -> None:
    assert without_imu_faults(run.recording, CheckLimits()) is run.recording
