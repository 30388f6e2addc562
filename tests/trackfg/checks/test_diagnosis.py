"""Each estimate recovers what was put into the data, within its sigma; wrong declarations are noticed and mended."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackfg.checks.contradictions.all_contradictions import diagnose
from trackfg.checks.diagnosis import Estimates
from trackfg.checks.diagnosis_axes import AXES, estimate_axes, propose_axes
from trackfg.checks.diagnosis_clock import estimate_clock_offset
from trackfg.checks.diagnosis_rest import noise_density, static_bias
from trackfg.checks.diagnosis_wheel import scale_from_fixes, scale_from_gnss
from trackfg.datasets.effects.catalogue import effect
from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.datasets.vehicle.driving import Service
from trackfg.datasets.vehicle.motion import Limits
from trackfg.io.check import check_recording
from trackfg.io.reader import read_recording
from trackfg.numerics.geodesy import normal_gravity
from trackfg.numerics.rotations import axes_matrix
from trackfg.recording.model import Recording
from trackfg.sensors.tach_rows import tach_quantum_m

Draft = Any
MakeDraft = Callable[..., Draft]
RESTS = np.array([[0.0, 17.0], [98.0, 107.0]])


@pytest.fixture
def read(make_draft: MakeDraft, tmp_path: Path) -> Callable[..., Recording]:
    """The recording of a run with the given properties."""

    def make(**properties: Any) -> Recording:
        return read_recording(make_draft(**properties).write(tmp_path / "rec"))

    return make


@pytest.mark.parametrize("late", [-3.217, -0.21, -0.0137, 0.0, 0.033, 0.5, 1.613, 7.77])
def test_the_clock_offset_is_found_to_a_fraction_of_a_sample(late: float, read: Callable[..., Recording]) -> None:
    offset = estimate_clock_offset(read(tach_late_s=late))
    assert offset is not None
    assert offset.sd_s < 0.03
    assert abs(offset.offset_s + late) < 3.0 * offset.sd_s + 0.002
    assert offset.correlation > 0.9


def test_the_clock_offset_has_an_honest_sigma(read: Callable[..., Recording]) -> None:
    errors = []
    for seed in range(12):
        offset = estimate_clock_offset(read(tach_late_s=0.3, accel_white=0.05, seed=seed))
        assert offset is not None
        errors.append((offset.offset_s + 0.3) / offset.sd_s)
    assert np.sqrt(np.mean(np.square(errors))) < 2.0


def test_a_gentle_drive_with_noise_shows_no_offset() -> None:
    """Little of it is in the band of the comparison, and the slope of noise shows no clock."""
    driver = Service(Limits(0.4, 0.03), fastest_mps=15.0, start_m=5.0, start_rest_s=20.0, dwell_s=(20.0, 30.0))
    plan = replace(scenario("mainline"), driver=driver, effects=(effect("imu-noise", 10.0),))
    for seed in range(2):
        offset = estimate_clock_offset(simulate(plan, seed=seed, duration_s=480.0).recording)
        assert offset is None or (abs(offset.offset_s) < 3.0 * offset.sd_s and not offset.is_sure)


def test_a_declared_offset_is_taken_into_account(make_draft: MakeDraft, tmp_path: Path) -> None:
    draft = make_draft(tach_late_s=2.5)
    draft.toml["tach"]["time_offset_s"] = -2.0
    folder = draft.write(tmp_path / "rec")
    offset = estimate_clock_offset(read_recording(folder))
    assert offset is not None
    assert offset.offset_s == pytest.approx(-0.5, abs=0.03)
    (line,) = [str(finding) for finding in check_recording(folder).findings if finding.code == "clock-offset"]
    assert "key tach.time_offset_s" in line
    mended = float(line.split("set tach.time_offset_s = ")[1].split(",")[0])
    assert mended == pytest.approx(-2.5, abs=0.03)


@pytest.mark.parametrize(("name", "seed", "expected_s"), [("slippery-line", 20, 0.0), ("rough-ride", 24, -0.3)])
def test_a_wheel_that_creeps_with_traction_is_not_ahead(name: str, seed: int, expected_s: float) -> None:
    """It looks 0.08 s ahead at 20 m/s where it creeps by 4 % per g."""
    offset = estimate_clock_offset(simulate(name, seed=seed, duration_s=500.0).recording)
    assert offset is not None
    assert abs(offset.offset_s - expected_s) < min(2.0 * offset.sd_s, 0.05)


def test_no_clock_offset_where_nothing_shows_it(read: Callable[..., Recording]) -> None:
    recording = read()
    assert recording.tach is not None
    parts = dict(vars(recording))
    steady = recording.tach.assign(distance_m=5.0 * recording.tach["t_s"])
    rng = np.random.default_rng(0)
    unrelated = recording.tach.assign(distance_m=rng.uniform(0, 3, len(steady)).cumsum())
    for tach in (None, steady, unrelated, recording.tach[recording.tach["t_s"] < 15.0]):
        assert estimate_clock_offset(Recording(**parts | {"tach": tach})) is None


@pytest.mark.parametrize("quantum", [np.pi * 0.86 / 90, 0.001, 0.5])
def test_the_tach_quantum_is_the_distance_of_a_count(quantum: float) -> None:
    t = np.arange(0.0, 300.0, 0.1)
    distance = np.floor((12.0 * t + 30.0 * np.sin(t / 20.0)) / quantum) * quantum + 1234.5
    assert tach_quantum_m(pd.DataFrame({"t_s": t, "distance_m": distance})) == pytest.approx(quantum, rel=1e-6)


def test_a_continuous_or_resting_tach_has_no_quantum() -> None:
    t = np.arange(0.0, 100.0, 0.1)
    for distance in (
        np.sin(t / 30.0) * 100.0,
        np.zeros_like(t),
        np.random.default_rng(0).uniform(0, 1, t.size).cumsum(),
    ):
        assert tach_quantum_m(pd.DataFrame({"t_s": t, "distance_m": distance})) == 0.0


def test_static_biases(read: Callable[..., Recording]) -> None:
    bias = (2e-4, -5e-4, 1e-3)
    recording = read(gyro_bias=bias, accel_bias=(0.0, 0.0, 0.05))
    found = static_bias(recording, RESTS)
    assert found is not None
    assert found.standstills == 2
    assert found.duration_s == pytest.approx(24.0, abs=0.1)
    error = np.array(found.gyro_radps) - bias
    assert (np.abs(error) < 4.0 * np.array(found.gyro_sd_radps)).all()
    assert (np.array(found.gyro_sd_radps) < 5e-5).all()
    excess = 9.80665 + 0.05 - normal_gravity(35.2)
    assert found.accel_excess_mps2 == pytest.approx(excess, abs=4.0 * found.accel_excess_sd_mps2 + 1e-4)


@pytest.mark.parametrize(("gyro_white", "accel_white"), [(5e-5, 1e-3), (1e-3, 2e-4), (2e-6, 3e-2)])
def test_noise_densities(gyro_white: float, accel_white: float, read: Callable[..., Recording]) -> None:
    found = noise_density(read(gyro_white=gyro_white, accel_white=accel_white), RESTS)
    assert found is not None
    assert found.gyro_white == pytest.approx(gyro_white, abs=4.0 * found.gyro_white_sd)
    assert found.accel_white == pytest.approx(accel_white, abs=4.0 * found.accel_white_sd)
    assert found.gyro_white_sd < 0.1 * gyro_white
    assert found.gyro_ratio == pytest.approx(found.gyro_white / 5e-5)
    assert found.accel_ratio == pytest.approx(found.accel_white / 1e-3)


def test_no_standstill_no_bias_and_no_noise(read: Callable[..., Recording]) -> None:
    recording = read()
    for rests in (np.empty((0, 2)), np.array([[3.0, 4.5]])):
        assert static_bias(recording, rests) is None
        assert noise_density(recording, rests) is None


@pytest.mark.parametrize("scale", [1.0, 1.0123, 0.97])
def test_the_wheel_scale_from_fixes_and_from_gnss(scale: float, read: Callable[..., Recording]) -> None:
    recording = read(wheel_scale=scale, parts=("imu", "tach", "fixes", "gnss"), duration_s=400.0)
    assert recording.tach is not None
    assert recording.fixes is not None
    assert recording.gnss is not None
    by_fixes = scale_from_fixes(recording.tach, recording.fixes)
    by_gnss = scale_from_gnss(recording.tach, recording.gnss)
    assert by_fixes is not None
    assert by_gnss is not None
    assert by_fixes.scale == pytest.approx(scale, abs=3.0 * by_fixes.sd)
    assert by_fixes.sd < 1e-3
    assert by_gnss.scale == pytest.approx(scale, abs=4.0 * by_gnss.sd + 3e-4)
    assert (by_fixes.source, by_gnss.source) == ("fixes", "gnss")


@pytest.mark.parametrize("factor", [1.0, 2.5])
@pytest.mark.parametrize("wrong", [(4,), (0, 9), (3, 7, 12, 19)])
def test_the_scale_from_fixes_is_that_of_the_right_ones(wrong: tuple[int, ...], factor: float) -> None:
    """Of 20 fixes, some have the chainage of another balise; another unit of all of them still shows."""
    t = np.arange(0.0, 500.0)
    tach = pd.DataFrame({"t_s": t, "distance_m": 20.0 * t})
    passed = np.linspace(10.0, 480.0, 20)
    chainage = factor * 20.0 * passed + np.random.default_rng(0).normal(0.0, 0.1, 20)
    chainage[list(wrong)] = chainage[[(i + 8) % 20 for i in wrong]]
    found = scale_from_fixes(tach, pd.DataFrame({"t_s": passed, "chainage_m": chainage, "chainage_sd_m": 0.1}))
    assert found is not None
    assert found.scale == pytest.approx(factor, rel=1e-3)


@pytest.mark.parametrize("count", [5, 16])
@pytest.mark.parametrize("off_m", [30.0, 200.0, 600.0, 1500.0, 4000.0, -1500.0])
def test_one_wrong_fix_is_no_wrong_wheel(count: int, off_m: float) -> None:
    """With five fixes a small error may not be distinguished from creep: then the sigma is wide."""
    t, passed = np.arange(0.0, 601.0), np.linspace(10.0, 590.0, count)
    tach = pd.DataFrame({"t_s": t, "distance_m": 20.0 * t})
    for wrong in range(count):
        chainage = 20.0 * passed + np.random.default_rng(wrong).normal(0.0, 0.1, count)
        chainage[wrong] += off_m
        found = scale_from_fixes(tach, pd.DataFrame({"t_s": passed, "chainage_m": chainage, "chainage_sd_m": 0.1}))
        assert found is not None
        assert abs(found.scale - 1.0) < 3.0 * np.hypot(found.sd, 1e-3)
        assert found.scale == pytest.approx(1.0, abs=0.001 if abs(off_m) > 400.0 else 0.05)


def test_the_scale_from_fixes_does_not_care_for_the_direction_of_chainage(read: Callable[..., Recording]) -> None:
    recording = read(wheel_scale=1.02, parts=("imu", "tach", "fixes"))
    assert recording.tach is not None
    assert recording.fixes is not None
    falling = recording.fixes.assign(chainage_m=5000.0 - recording.fixes["chainage_m"])
    one, other = scale_from_fixes(recording.tach, recording.fixes), scale_from_fixes(recording.tach, falling)
    assert one is not None
    assert other is not None
    assert one.scale == pytest.approx(other.scale, rel=1e-9)
    assert scale_from_fixes(recording.tach, recording.fixes.iloc[:1]) is None


def test_noisy_gnss_with_outliers_still_gives_the_scale(read: Callable[..., Recording]) -> None:
    recording = read(wheel_scale=1.01, parts=("imu", "tach", "gnss"), duration_s=600.0)
    assert recording.tach is not None
    assert recording.gnss is not None
    gnss, rng = recording.gnss.copy(), np.random.default_rng(2)
    gnss[["east_m", "north_m"]] += rng.normal(0.0, 1.0, (len(gnss), 2))
    gnss.loc[::40, "east_m"] += 60.0
    found = scale_from_gnss(recording.tach, gnss)
    assert found is not None
    assert found.scale == pytest.approx(1.01, abs=3.0 * found.sd)
    assert found.sd < 0.01


def turned(draft: Draft, declared: str, true: str) -> None:
    """Write the IMU as a sensor mounted along ``true``, and declare ``declared``."""
    for columns in (["wx", "wy", "wz"], ["fx", "fy", "fz"]):
        draft["imu"][columns] = draft["imu"][columns].to_numpy() @ axes_matrix(true)
    draft.toml["imu"]["axes"] = declared


@pytest.mark.parametrize(
    ("declared", "true"), [("FLU", "BRU"), ("FLU", "LBU"), ("RFU", "LBU"), ("FRD", "RBD"), ("UFL", "UBR")]
)
def test_a_sensor_turned_about_the_vertical_is_noticed_and_the_axes_proposed(
    declared: str, true: str, make_draft: MakeDraft, tmp_path: Path
) -> None:
    draft = make_draft()
    turned(draft, declared, true)
    report = check_recording(draft.write(tmp_path / "rec"))
    assert report.usable
    assert report.estimates["axes"]["proposed"] == true
    (line,) = [str(finding) for finding in report.findings if finding.code == "forward-axis"]
    assert f'set imu.axes = "{true}"' in line
    draft.toml["imu"]["axes"] = true
    assert check_recording(draft.write(tmp_path / "rec")).findings == ()


@pytest.mark.parametrize("true", ["FRD", "DLF", "URF", "LFD", "BLD"])
def test_a_sensor_turned_over_is_refused_and_the_axes_proposed(
    true: str, make_draft: MakeDraft, tmp_path: Path
) -> None:
    draft = make_draft()
    turned(draft, "FLU", true)
    report = check_recording(draft.write(tmp_path / "rec"))
    assert "gravity-axis" in {finding.code for finding in report.findings if finding.level == "error"}
    assert report.estimates["axes"]["proposed"] == true


def test_a_gap_in_motion_does_not_hide_the_forward_axis(read: Callable[..., Recording]) -> None:
    """At its ends the mean speed over the gap is no change of speed."""
    recording = read()
    assert recording.tach is not None
    t, distance = recording.tach["t_s"].to_numpy(), recording.tach["distance_m"].to_numpy()
    speed = np.gradient(distance, t)
    middle = t[np.argmax(speed > 0.5 * speed.max())]
    parts = [table[~table["t_s"].between(middle - 7.0, middle + 7.0)] for table in (recording.imu, recording.tach)]
    axes = estimate_axes(parts[0].reset_index(drop=True), parts[1].reset_index(drop=True), "FLU")
    assert axes.shown_by == "motion"
    assert axes.best_forward == "+x"
    assert axes.best_forward_correlation > 0.9


@pytest.mark.parametrize("axes", AXES)
def test_right_axes_are_left_alone(axes: str, make_draft: MakeDraft, tmp_path: Path) -> None:
    draft = make_draft()
    turned(draft, axes, axes)
    recording = read_recording(draft.write(tmp_path / "rec"))
    found = estimate_axes(recording.imu, recording.tach, axes)
    assert found.proposed == axes
    assert found.best_forward == "+x"
    assert found.tilt_deg < 2.0
    assert found.gyro_slope == pytest.approx(1.0, abs=0.1)
    assert found.lateral_correlation is not None
    assert found.lateral_correlation > 0.95


def test_positions_show_the_forward_axis_of_a_log_without_a_wheel(
    simulated_in_full: Callable[..., Simulation],
) -> None:
    run = replace(simulated_in_full("mainline-field", seed=1, duration_s=300.0).recording, tach=None)
    quarter = axes_matrix("RFU")
    imu = run.imu.copy()
    imu[["wx_radps", "wy_radps", "wz_radps"]] = run.gyro @ quarter
    imu[["fx_mps2", "fy_mps2", "fz_mps2"]] = run.accel @ quarter

    _, of_right = diagnose(run)
    _, of_wrong = diagnose(replace(run, imu=imu))

    assert "forward-axis" not in {finding.code for finding in of_right}
    (line,) = [str(finding) for finding in of_wrong if finding.code == "forward-axis"]
    assert "follows the acceleration of the positions is +y" in line
    assert 'set imu.axes = "RFU"' in line


def test_positions_show_a_gyro_in_another_unit_in_a_log_without_a_wheel(
    simulated_in_full: Callable[..., Simulation],
) -> None:
    run = replace(simulated_in_full("mainline-field", seed=1, duration_s=300.0).recording, tach=None)
    imu = run.imu.copy()
    imu[["wx_radps", "wy_radps", "wz_radps"]] *= np.degrees(1.0)

    _, findings = diagnose(replace(run, imu=imu))

    (line,) = [str(finding) for finding in findings if finding.code == "gyro-scale"]
    assert "times as far as the gyro shows" in line
    assert 'set imu.gyro_unit = "deg/s"' in line


def test_gravity_alone_keeps_the_forward_letter_if_it_can() -> None:
    assert propose_axes("FLU", np.array([0.02, 0.0, -1.0]), None) == "FRD"
    assert propose_axes("RFU", np.array([0.0, 0.1, -0.99]), None) == "LFD"
    assert propose_axes("FLU", np.array([0.0, 0.0, 1.0]), np.array([-1.0, 0.0, 0.0])) == "BRU"


def test_a_gyro_against_its_accelerometer_is_noticed(make_draft: MakeDraft, tmp_path: Path) -> None:
    draft = make_draft()
    draft["imu"][["wx", "wy", "wz"]] *= -1.0
    codes = {finding.code for finding in check_recording(draft.write(tmp_path / "rec")).findings}
    assert codes == {"gyro-sign"}


def test_full_cant_does_not_hide_the_gyro(make_draft: MakeDraft, tmp_path: Path) -> None:
    """At equilibrium cant the lateral force is nearly zero; what remains of it still fits the gyro."""
    draft = make_draft(cant_deficiency=0.0)
    assert check_recording(draft.write(tmp_path / "rec")).findings == ()


def lines(draft: Draft, folder: Path) -> dict[str, str]:
    return {finding.code: str(finding) for finding in check_recording(draft.write(folder)).findings}


def test_declared_noise_and_bias_are_compared_with_the_rests(make_draft: MakeDraft, tmp_path: Path) -> None:
    draft = make_draft(gyro_white=3e-4, accel_white=1e-4, gyro_bias=(0.0, 0.01, 0.0), accel_bias=(0.0, 0.0, 0.3))
    found = lines(draft, tmp_path / "rec")
    assert set(found) == {"noise-low", "noise-high", "gyro-bias", "accel-bias"}
    assert "key imu.noise.gyro_white" in found["noise-low"]
    ratio = float(found["noise-low"].split(", ")[2].split(" times what is declared or assumed")[0])
    assert ratio == pytest.approx(6.0, rel=0.1)
    assert "key imu.noise.accel_white" in found["noise-high"]
    assert "Hint: set accel_white = " in found["noise-high"]
    assert "0.01 rad/s at rest" in found["gyro-bias"]


def test_a_wrong_wheel_is_given_its_diameter(make_draft: MakeDraft, tmp_path: Path) -> None:
    draft = make_draft(wheel_scale=0.92, parts=("imu", "tach", "fixes"))
    line = lines(draft, tmp_path / "rec")["wheel-scale"]
    assert "key tach.wheel_diameter_m" in line
    mended = float(line.split("set tach.wheel_diameter_m = ")[1])
    assert mended == pytest.approx(0.86 * 0.92, rel=0.003)


def test_the_estimates_are_complete_and_ready_for_json(draft: Draft, tmp_path: Path) -> None:
    recording = read_recording(draft.write(tmp_path / "rec"))
    estimates, findings = diagnose(recording)
    assert findings == []
    assert isinstance(estimates, Estimates)
    page = estimates.as_dict()
    assert page["imu_rate_hz"] == pytest.approx(50.0)
    assert page["tach_quantum_m"] == pytest.approx(np.pi * 0.86 / 90)
    assert page["standstills"] == 2
    assert {"axes", "clock_offset", "static_bias", "noise_density", "wheel_scale_fixes"} <= page.keys()

    def leaves(value: Any) -> list[Any]:
        if isinstance(value, dict):
            return [leaf for item in value.values() for leaf in leaves(item)]
        return [leaf for item in value for leaf in leaves(item)] if isinstance(value, list) else [value]

    assert {type(leaf) for leaf in leaves(page)} <= {int, float, str}


@pytest.mark.parametrize("rows", [0, 1, 2])
def test_a_part_of_a_run_in_which_the_tach_gave_nothing_is_diagnosed(rows: int, read: Callable[..., Recording]) -> None:
    recording = read()
    assert recording.tach is not None
    estimates, _ = diagnose(replace(recording, tach=recording.tach.iloc[:rows]))
    assert estimates.imu_rate_hz == pytest.approx(50.0)
    assert (estimates.tach_rate_hz is None) == (rows < 2)


def test_a_recording_of_the_imu_alone_is_diagnosed_too(make_draft: MakeDraft, tmp_path: Path) -> None:
    report = check_recording(make_draft(parts=("imu",)).write(tmp_path / "rec"))
    assert report.findings == ()
    assert "clock_offset" not in report.estimates
    assert report.estimates["axes"]["proposed"] == "FLU"


@pytest.fixture(scope="module")
def with_receiver() -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    """Samples of a run of 140 s from a rest, its positions at 1 Hz, and the true speeds at these times."""
    simulated = simulate("mainline-gnss", seed=1, duration_s=140.0)
    gnss, truth = simulated.recording.gnss, simulated.truth
    assert gnss is not None
    speed = np.interp(gnss["t_s"], truth["t_s"], truth["speed_mps"])
    return simulated.recording.imu, gnss, pd.DataFrame({"t_s": gnss["t_s"], "speed_mps": speed})


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_speeds_of_a_receiver_show_the_forward_axis_without_a_tach(with_receiver, sense):
    imu, gnss, speeds = with_receiver
    noisy = speeds.assign(speed_mps=speeds["speed_mps"] + 0.1 * np.random.default_rng(0).standard_normal(len(speeds)))
    turned = imu.assign(**{name: sense * imu[name] for name in ("wx_radps", "wy_radps", "fx_mps2", "fy_mps2")})
    found = estimate_axes(turned, None, "FLU", gnss, noisy)
    assert (found.forward_by, found.shown_by) == ("receiver", "motion")
    assert found.proposed == ("FLU" if sense > 0.0 else "BRU")


def test_positions_that_are_too_poor_show_no_wrong_forward_axis() -> None:
    """Errors of 10 m make another axis than the forward one correlate by more than a half in one of these draws."""
    run = simulate("mainline-gnss", seed=2, duration_s=140.0).recording
    assert run.gnss is not None
    for seed in range(20):
        error = np.random.default_rng(seed).normal(0.0, 10.0, (len(run.gnss), 2))
        poor = run.gnss.assign(east_m=run.gnss["east_m"] + error[:, 0], north_m=run.gnss["north_m"] + error[:, 1])
        found = estimate_axes(run.imu, None, "FLU", poor)
        assert found.proposed == "FLU"
