"""A tach that is wrong throughout: by a factor, in its sense, in its clock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from trackfg.checks.tach_correction import corrected_tach, force_per_acceleration
from trackfg.datasets.scenarios import Simulation
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.recording.description import Tach
from trackfg.recording.model import Recording
from trackfg.smoothing.smoother import smooth


@pytest.fixture(scope="module")
def run(simulated: Callable[..., Simulation]) -> Simulation:
    return simulated("mainline", seed=2, duration_s=150.0)


def with_distance(recording: Recording, factor: float, late_s: float = 0.0) -> Recording:
    """The tach's distance times a factor, of a signed tach, seconds late."""
    assert recording.tach is not None
    tach = Tach(file="tach.csv", column="x", kind="distance", unit="m", signed=True)
    table = recording.tach.assign(distance_m=factor * recording.tach["distance_m"], t_s=recording.tach["t_s"] + late_s)
    return replace(recording, tach=table, description=recording.description.model_copy(update={"tach": tach}))


def test_a_tach_that_is_right_stays_as_it_is(run: Simulation) -> None:
    same, correction = corrected_tach(run.recording)
    assert same is run.recording
    assert (correction.factor, correction.clock_s, correction.findings) == (1.0, 0.0, ())


@pytest.mark.parametrize(
    ("factor", "named"),
    [
        (3.6, "look like km/h"),
        (1.0 / 3.6, "look like m/s"),
        (-1.0, "other sense"),
        (-3.6, "sense; its values look like"),
    ],
)
def test_usual_mistakes_are_named_and_mended(run: Simulation, factor: float, named: str) -> None:
    """Values 3.6 times too large are multiplied by 1/3.6, exactly: what is left is the wheel's scale."""
    mended, correction = corrected_tach(with_distance(run.recording, factor))
    assert correction.factor == pytest.approx(1.0 / factor)
    assert [finding.code for finding in correction.findings] == ["tach-factor"]
    assert named in correction.findings[0].message
    assert mended.tach is not None
    assert run.recording.tach is not None
    np.testing.assert_allclose(mended.tach["distance_m"], run.recording.tach["distance_m"])


def test_another_wheel_is_found_to_some_per_cent(run: Simulation) -> None:
    mended, correction = corrected_tach(with_distance(run.recording, 1.3))
    assert correction.factor == pytest.approx(1.0 / 1.3, rel=0.05)
    assert "another one than described" in correction.findings[0].message
    assert mended.description.tach is not None
    assert mended.description.tach.scale_sd == pytest.approx(0.05)


def test_what_a_pitching_body_measures_of_gravity_is_no_factor(run: Simulation) -> None:
    """A body whose nose rises by 2.6 mrad for each 0.1 m/s^2 of acceleration measures 1.26 times it."""
    assert run.recording.tach is not None
    imu, tach = run.recording.imu, run.recording.tach
    t = imu["t_s"].to_numpy()
    distance = gaussian_filter1d(np.interp(t, tach["t_s"], tach["distance_m"]), 0.5 / np.median(np.diff(t)))
    nose_up = 0.026 * np.gradient(np.gradient(distance, t), t)
    pitching = imu.assign(
        fx_mps2=imu["fx_mps2"] + STANDARD_GRAVITY * nose_up,
        wy_radps=imu["wy_radps"] - np.gradient(nose_up, t),
    )
    assert corrected_tach(replace(run.recording, imu=pitching))[1].factor == 1.0


@pytest.mark.parametrize("late_s", [-0.7, 1.0])
def test_a_tach_that_is_late_is_moved(run: Simulation, late_s: float) -> None:
    mended, correction = corrected_tach(with_distance(run.recording, 1.0, late_s))
    assert correction.clock_s == pytest.approx(-late_s, abs=0.05)
    assert correction.factor == 1.0
    assert [finding.code for finding in correction.findings] == ["tach-clock"]
    assert mended.tach is not None


def test_a_run_without_starts_and_stops_shows_no_factor(run: Simulation) -> None:
    """At rest all the time, force is noise."""
    assert run.recording.tach is not None
    still = run.recording.imu["t_s"] < 25.0
    resting = replace(
        run.recording, imu=run.recording.imu[still], tach=run.recording.tach[run.recording.tach["t_s"] < 25.0]
    )
    assert force_per_acceleration(resting) is None


def test_the_summary_shows_the_whole_scale_and_clock(run: Simulation) -> None:
    summary = smooth(with_distance(run.recording, 3.6, 0.6)).summary
    assert summary.wheel_scale is not None
    assert summary.clock_offset_s is not None
    assert summary.wheel_scale.value == pytest.approx(run.wheel_scale / 3.6, rel=0.01)
    assert summary.clock_offset_s.value == pytest.approx(-0.6, abs=0.02)
    assert {"tach-factor", "tach-clock"} <= {finding.code for finding in summary.findings}
