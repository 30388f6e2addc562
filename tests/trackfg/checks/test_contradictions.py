"""Each single mistake in a sound recording is named with the edit that mends it; sound recordings are left alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
import pandas as pd
import pytest

from trackfg.checks import plausibility
from trackfg.checks.clock_overlap import of_this_run
from trackfg.checks.contradictions.all_contradictions import diagnose
from trackfg.checks.diagnosis_silence import is_moving
from trackfg.checks.diagnosis_wheel import receiver_speed_scale
from trackfg.checks.limits import CheckLimits
from trackfg.datasets.catalogue import scenario, scenarios
from trackfg.datasets.effects.inertial import LowCost
from trackfg.datasets.effects.mounting import Tilt
from trackfg.datasets.line.built_in_lines import NARROW_YARD
from trackfg.datasets.scenarios import simulate
from trackfg.datasets.sensors.positioning import BaliseModel
from trackfg.datasets.sensors.receiver_speeds import ReceiverSpeeds
from trackfg.datasets.tables import gnss_speed_description
from trackfg.datasets.vehicle.driving import Service
from trackfg.datasets.vehicle.motion import Limits
from trackfg.numerics.rotations import so3_exp
from trackfg.numerics.units import KMH, KNOT
from trackfg.recording.model import GNSS_SPEED_TABLE, IMU_COLUMNS, Recording
from trackfg.smoothing.weightless_sensors import without_contradicted_speeds

GYRO, FORCE = list(IMU_COLUMNS[1:4]), list(IMU_COLUMNS[4:7])
Spoil = Callable[[Recording], Recording]


@pytest.fixture(scope="module")
def sound() -> Recording:
    """Five minutes of a line with curves, with a balise every 200 m and GNSS; the tach gives a speed."""
    plan = replace(scenario("mainline-gnss"), balises=BaliseModel(spacing_m=200.0, sd_m=0.1))
    recording = simulate(plan, seed=1, duration_s=300.0).recording
    tach = recording.description.tach
    assert tach is not None
    speed = tach.model_copy(update={"kind": "speed", "unit": "m/s", "pulses_per_rev": None, "wheel_diameter_m": None})
    return replace(recording, description=recording.description.model_copy(update={"tach": speed}))


@pytest.fixture(scope="module")
def speeds() -> pd.DataFrame:
    """What a receiver measures of its speed on that run, without errors."""
    return ReceiverSpeeds().measured(simulate("mainline-gnss", seed=1, duration_s=300.0).ride, 300.0, None).table


def mixed(columns: list[str], *rows: Sequence[float]) -> Spoil:
    """Write what the rows of a matrix make of a sensor's columns."""

    def spoil(recording: Recording) -> Recording:
        imu = recording.imu.copy()
        imu[columns] = recording.imu[columns].to_numpy() @ np.array(rows).T
        return replace(recording, imu=imu)

    return spoil


def changed(table: str, **columns: Callable[[pd.DataFrame], pd.Series]) -> Spoil:
    """Write other columns into a table."""

    def spoil(recording: Recording) -> Recording:
        changed_table = recording.tables[table].assign(**columns)
        return replace(recording, **{table: changed_table.sort_values("t_s", ignore_index=True)})

    return spoil


def exchanged(table: str, one: str, other: str) -> Spoil:
    return lambda recording: replace(
        recording, **{table: recording.tables[table].rename(columns={one: other, other: one})}
    )


def scaled(table: str, factor: float, *columns: str) -> Spoil:
    return changed(table, **{column: lambda rows, c=column: rows[c] * factor for column in columns})


def later(table: str, seconds: float) -> Spoil:
    return changed(table, t_s=lambda rows: rows["t_s"] + seconds)


def declared_in(unit: str, factor: float) -> Spoil:
    """Take speeds that are in m/s for another unit."""

    def spoil(recording: Recording) -> Recording:
        spoiled = scaled("tach", factor, "distance_m")(recording)
        assert recording.description.tach is not None
        tach = recording.description.tach.model_copy(update={"unit": unit})
        return replace(spoiled, description=recording.description.model_copy(update={"tach": tach}))

    return spoil


def turned_left(recording: Recording) -> Recording:
    """Turn both sensors by a quarter about the vertical."""
    rows = ((0, -1, 0), (1, 0, 0), (0, 0, 1))
    return mixed(FORCE, *rows)(mixed(GYRO, *rows)(recording))


def turned(axis: str, degrees: float) -> Spoil:
    """Turn both sensors about an axis of the vehicle."""
    rows = so3_exp(np.radians(degrees) * (np.array(list("xyz")) == axis)).T
    return lambda recording: mixed(FORCE, *rows)(mixed(GYRO, *rows)(recording))


def other_sense(recording: Recording) -> Recording:
    """Negate a tach that knows directions."""
    tach = recording.description.tach
    assert tach is not None
    description = recording.description.model_copy(update={"tach": tach.model_copy(update={"signed": True})})
    return scaled("tach", -1.0, "distance_m")(replace(recording, description=description))


def kept(table: str, first_s: float) -> Spoil:
    """Leave the rows before a time out."""

    def spoil(recording: Recording) -> Recording:
        rows = recording.tables[table]
        return replace(recording, **{table: rows[rows["t_s"] >= first_s].reset_index(drop=True)})

    return spoil


def accelerometer_later(by_s: float) -> Spoil:
    return changed("imu", **{c: lambda rows, c=c: np.interp(rows["t_s"] - by_s, rows["t_s"], rows[c]) for c in FORCE})


def means_of(count: int) -> Spoil:
    return changed(
        "imu",
        **{c: lambda rows, c=c: rows[c].rolling(count, center=True, min_periods=1).mean() for c in [*GYRO, *FORCE]},
    )


def noisier(columns: list[str], sd: float) -> Spoil:
    noise = np.random.default_rng(0)
    return changed("imu", **{c: lambda rows, c=c: rows[c] + sd * noise.standard_normal(len(rows)) for c in columns})


X, Y, Z = (1, 0, 0), (0, 1, 0), (0, 0, 1)
BACK, RIGHT, DOWN = (-1, 0, 0), (0, -1, 0), (0, 0, -1)

# What is done to the recording; the codes of the findings, of which the first names the cause; what its line must say.
MISTAKES: dict[str, tuple[Spoil, set[str], str]] = {
    "gyro x has the wrong sign": (mixed(GYRO, BACK, Y, Z), {"gyro-sign"}, "negate column 'wx_radps'"),
    "gyro y has the wrong sign": (mixed(GYRO, X, RIGHT, Z), {"gyro-sign"}, "negate column 'wy_radps'"),
    "gyro z has the wrong sign": (mixed(GYRO, X, Y, DOWN), {"gyro-sign"}, "negate column 'wz_radps'"),
    "the whole gyro has the wrong sign": (
        mixed(GYRO, BACK, RIGHT, DOWN), {"gyro-sign"},
        "negate columns 'wx_radps' and 'wy_radps' and 'wz_radps'"),
    "gyro x and y exchanged": (
        mixed(GYRO, Y, X, Z), {"gyro-columns"}, 'set imu.gyro = ["wy_radps", "wx_radps", "wz_radps"]'),
    "gyro y and z exchanged": (
        mixed(GYRO, X, Z, Y), {"gyro-columns"}, 'set imu.gyro = ["wx_radps", "wz_radps", "wy_radps"]'),
    "gyro x and z exchanged": (
        mixed(GYRO, Z, Y, X), {"gyro-columns"}, 'set imu.gyro = ["wz_radps", "wy_radps", "wx_radps"]'),
    "gyro columns in a circle": (
        mixed(GYRO, Y, Z, X), {"gyro-columns"}, 'set imu.gyro = ["wz_radps", "wx_radps", "wy_radps"]'),
    "forward force has the wrong sign": (mixed(FORCE, BACK, Y, Z), {"accel-sign"}, "negate column 'fx_mps2'"),
    "lateral force has the wrong sign": (mixed(FORCE, X, RIGHT, Z), {"accel-sign"}, "negate column 'fy_mps2'"),
    "forces x and y exchanged": (
        mixed(FORCE, Y, X, Z), {"accel-columns"}, 'set imu.accel = ["fy_mps2", "fx_mps2", "fz_mps2"]'),
    "the sensor turned by a quarter": (turned_left, {"forward-axis"}, 'set imu.axes = "RFU"'),
    "the sensor points to the left": (
        turned("z", 6.0), {"mounting"}, "deg) to the left of the direction of travel"),
    "the sensor points down": (turned("y", 6.0), {"mounting"}, "deg) below the direction of travel"),
    "km/h taken for m/s": (
        scaled("tach", 3.6, "distance_m"), {"speed-scale", "wheel-scale"}, 'set tach.unit = "km/h"'),
    "m/s taken for km/h": (
        declared_in("km/h", 1 / 3.6), {"speed-scale", "wheel-scale"}, 'set tach.unit = "m/s"'),
    "a wheel 30 % larger": (
        scaled("tach", 1 / 1.3, "distance_m"), {"speed-scale", "wheel-scale"}, "must be multiplied by 1.3"),
    "a wheel 30 % smaller": (
        scaled("tach", 1 / 0.7, "distance_m"), {"speed-scale", "wheel-scale"}, "must be multiplied by 0.7"),
    "the tach counts in the other sense": (
        other_sense, {"tach-factor", "direction"}, "negate the column; trackfg smooth does so"),
    "the tach is dead": (scaled("tach", 0.0, "distance_m"), {"tach-silent"}, "stays at one value from t = 0"),
    "the tach freezes": (
        changed("tach", distance_m=lambda rows: rows["distance_m"].clip(upper=rows["distance_m"].median())),
        {"tach-silent"}, "while the IMU moves"),
    "the tach is there for the second half": (
        kept("tach", 150.0), {"tach-absent"}, " to 150 s, while the IMU moves"),
    "the tach is late": (later("tach", 1.0), {"clock-offset"}, "set tach.time_offset_s = -"),
    "GNSS is 3 s late": (later("gnss", 3.0), {"gnss-delay"}, "set gnss.time_offset_s = -"),
    "east and north exchanged": (
        exchanged("gnss", "east_m", "north_m"),
        {"gnss-mirrored"}, 'set gnss.position = ["north_m", "east_m", "up_m"]'),
    "fixes in km": (
        scaled("fixes", 1e-3, "chainage_m"), {"fix-unit"}, "look like km: multiply them by 1000"),
    "fixes against the direction": (
        scaled("fixes", -1.0, "chainage_m"), {"direction"}, "set track.direction = -1"),
    "balises are 2 s late": (later("fixes", 2.0), {"fix-delay"}, "set fixes.time_offset_s = -"),
    "the accelerometer is late": (
        accelerometer_later(0.02), {"accelerometer-clock"}, "trackfg smooth moves the samples"),
    "the samples are means over 0.1 s": (
        means_of(20), {"imu-bandwidth"}, "at 32 m/s waves of the track shorter than"),
    "much more noise than declared": (noisier(GYRO, 0.01), {"noise-low"}, "set gyro_white = "),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_named(mistake: str, sound: Recording) -> None:
    spoil, expected, text = MISTAKES[mistake]
    _, findings = diagnose(spoil(sound))
    lines = {finding.code: str(finding) for finding in findings if finding.level != "info"}
    assert set(lines) == expected
    assert any(text in line for line in lines.values()), lines


def test_a_wheel_that_neither_fixes_nor_gnss_test_is_tested_by_curves(sound: Recording) -> None:
    alone = replace(sound, fixes=None, gnss=None)
    assert not diagnose(alone)[1]
    assert {finding.code for finding in diagnose(scaled("tach", 1 / 1.07, "distance_m")(sound))[1]} == {"wheel-scale"}
    (finding,) = diagnose(scaled("tach", 1 / 1.07, "distance_m")(alone))[1]
    assert finding.code == "curve-scale"
    assert "must be multiplied by 1.07" in str(finding.hint)


def test_exchanged_degrees_are_named_before_and_without_what_follows_from_them(sound: Recording) -> None:
    gnss, description = sound.gnss, sound.description
    assert gnss is not None
    assert description.gnss is not None
    late = replace(sound, gnss=gnss.assign(t_s=gnss["t_s"] + 3.0))
    _, findings = diagnose(exchanged("gnss", "east_m", "north_m")(late))
    assert [finding.code for finding in findings if finding.level != "info"] == ["gnss-mirrored", "gnss-delay"]

    degrees = description.model_copy(update={"gnss": description.gnss.model_copy(update={"frame": "geodetic"})})
    at_47_and_8 = gnss.assign(east_m=0.99 * gnss["north_m"], north_m=gnss["east_m"] / 0.68)
    _, findings = diagnose(replace(sound, gnss=at_47_and_8, description=degrees))
    assert [finding.code for finding in findings if finding.level != "info"] == ["gnss-mirrored"]


def test_a_few_garbled_samples_are_no_reason_to_exchange_columns(sound: Recording) -> None:
    imu = sound.imu.copy()
    imu.loc[[9000, 9001, 15000, 15001], "wx_radps"] = 9999.0
    assert {finding.code for finding in diagnose(replace(sound, imu=imu))[1]} - {
        finding.code for finding in diagnose(sound)[1]
    } == {"impossible-value"}


def test_a_recording_of_which_the_smoother_drops_every_row_is_still_diagnosed(sound: Recording) -> None:
    imu = sound.imu[:2000]
    estimates, findings = diagnose(replace(sound, imu=imu.assign(fx_mps2=imu["fx_mps2"] + 1e6)))
    assert estimates.duration_s > 0.0
    assert "impossible-value" in {finding.code for finding in findings}


def test_a_sound_recording_is_left_alone(sound: Recording) -> None:
    assert [finding for finding in diagnose(sound)[1] if finding.level != "info"] == []


@pytest.mark.parametrize("name", sorted(set(scenarios()) - {"rough-ride"}))
@pytest.mark.parametrize(("seed", "duration_s"), [(0, 60.0), (3, 120.0)])
def test_scenarios_are_sound(name: str, seed: int, duration_s: float) -> None:
    """Short runs are the hard ones. In the field scenario the tach's clock is indeed 0.08 s off."""
    _, findings = diagnose(simulate(name, seed=seed, duration_s=duration_s).recording)
    codes = {finding.code for finding in findings if finding.level != "info"}
    assert codes <= ({"clock-offset"} if name == "mainline-field" else set())


@pytest.mark.parametrize(
    ("name", "seed"),
    [*(("shunting-unsigned", seed) for seed in (3, 8, 13, 14)), *(("slippery-line-leaves", seed) for seed in (6, 11))],
)
def test_a_vehicle_that_turns_back_or_slips_is_sound(name: str, seed: int) -> None:
    """By an unsigned count a shunter goes far too far for its fixes, and thirty slips look like a late clock."""
    _, findings = diagnose(simulate(name, seed=seed, duration_s=300.0).recording)
    assert [finding for finding in findings if finding.level != "info"] == []


@pytest.mark.parametrize("seed", range(3))
def test_a_poor_sensor_that_shakes_is_sound(seed: int) -> None:
    """1 deg/s of bias and 2 m/s^2 of vibration are no contradictions; what they are is said."""
    recording = simulate("mainline-gnss", seed=seed, duration_s=90.0).recording
    rng = np.random.default_rng(seed)
    spoiled = noisier(FORCE, 2.0)(recording)
    spoiled.imu[GYRO] += np.radians(1.0) * rng.choice([-1.0, 1.0], 3)
    codes = {finding.code for finding in diagnose(spoiled)[1] if finding.level != "info"}
    assert codes <= {"gyro-bias", "accel-bias", "noise-low"}


@pytest.mark.parametrize("unit", ["m/s^2", "g"])
def test_removed_gravity_is_not_taken_for_a_unit(unit: str, sound: Recording) -> None:
    """A phone's linear acceleration, with a bias of 0.9 m/s^2 that happens to look like 1 g in g."""
    imu = sound.imu.copy()
    imu[FORCE] = imu[FORCE].to_numpy() - imu[FORCE].median().to_numpy() + [0.0, 0.9, 0.0]
    part = sound.description.imu.model_copy(update={"accel_unit": unit})
    found = plausibility.findings({"imu": part}, {"imu": imu}, "recording.toml", CheckLimits())
    assert [finding.code for finding in found] == ["accel-unit"]
    assert "gravity seems to have been removed" in str(found[0])


def test_a_row_far_away_in_time_is_reported(sound: Recording) -> None:
    fixes = sound.tables["fixes"].copy()
    fixes.loc[len(fixes) - 1, "t_s"] = 1e9
    parts = {"imu": sound.description.imu, "fixes": sound.description.fixes}
    found = plausibility.findings(parts, {"imu": sound.imu, "fixes": fixes}, "recording.toml", CheckLimits())
    assert [finding.code for finding in found] == ["clocks-apart"]
    assert f"data row {len(fixes)} (t = 1e+09 s): far from the IMU's time" in str(found[0])


def test_a_row_far_away_in_time_is_left_out(sound: Recording) -> None:
    assert sound.fixes is not None
    fixes = sound.fixes.copy()
    fixes.loc[len(fixes) - 1, "t_s"] = 1e300
    left = of_this_run(sound.imu, fixes, CheckLimits())
    pd.testing.assert_frame_equal(left, sound.fixes.iloc[:-1])
    assert of_this_run(sound.imu, fixes.iloc[-1:], CheckLimits()).shape == (1, fixes.shape[1])


def test_a_short_start_is_seen_where_the_tach_shows_none() -> None:
    """80 s of rest, 3 s of 0.3 m/s^2, and then constant speed: only the start shows. A knock shows nothing."""
    t = np.arange(0.0, 120.0, 0.01)
    rows = 1e-3 * np.random.default_rng(0).standard_normal((t.size, 6))
    rows[(t > 80.0) & (t < 83.0), 3] += 0.3
    assert is_moving(t, rows)
    knocked = rows.copy()
    knocked[(t > 79.0) & (t < 84.0), 3] = 0.0
    knocked[(t > 30.0) & (t < 30.1), 3] += 5.0
    knocked[(t > 30.1) & (t < 30.2), 3] -= 5.0
    assert not is_moving(t, knocked)


@pytest.mark.parametrize("seed", [3, 5])
def test_a_tilted_sensor_of_a_few_euros_is_no_exchanged_one(seed: int) -> None:
    """Narrow curves on changing grades, by a sensor 4 deg off whose accelerometer has a bias of up to 50 mg."""
    limits = Limits(acceleration_mps2=0.8, jerk_mps3=0.8)
    line = replace(NARROW_YARD, line_speed_mps=8.0, station_spacing_m=400.0)
    driver = Service(limits, fastest_mps=8.0, start_m=5.0, start_rest_s=5.0, dwell_s=(2.0, 10.0))
    effects = (LowCost(0.5), Tilt(4.0))
    plan = replace(scenario("mainline"), line=line, driver=driver, balises=None, effects=effects)
    recording = simulate(plan, seed=seed, duration_s=200.0).recording
    codes = {finding.code for finding in diagnose(recording)[1]}
    assert not codes & {"gyro-sign", "gyro-columns", "accel-sign", "accel-columns"}


@pytest.mark.parametrize(("back", "signed"), [(False, False), (False, True), (True, True)])
@pytest.mark.parametrize(("wrong", "expected"), [(0, set()), (1, {"fix-order"}), (4, {"direction"})])
def test_one_fix_in_the_wrong_place_is_no_wrong_direction(
    wrong: int, expected: set[str], back: bool, signed: bool, sound: Recording
) -> None:
    assert sound.tach is not None
    assert sound.fixes is not None
    assert sound.description.tach is not None
    tach = sound.description.tach.model_copy(update={"signed": signed})
    t = np.linspace(sound.tach["t_s"].iloc[0], sound.tach["t_s"].iloc[-1], 5)
    chainage = np.interp(t, sound.tach["t_s"], sound.tach["distance_m"])
    chainage[1 : 1 + wrong] = chainage[1 : 1 + wrong][::-1] if wrong > 1 else chainage[0] - 900.0
    sense = -1.0 if back else 1.0
    turned = replace(
        sound,
        description=sound.description.model_copy(update={"tach": tach}),
        tach=sound.tach.assign(distance_m=sense * sound.tach["distance_m"]),
        fixes=pd.DataFrame({"t_s": t, "chainage_m": sense * chainage, "chainage_sd_m": 0.3}),
    )
    assert {finding.code for finding in diagnose(turned)[1]} & {"fix-order", "direction"} == expected


@pytest.mark.parametrize(
    ("declared", "factor", "hint"),
    [
        ("m/s", 1.0 / KMH, 'set gnss_speed.unit = "km/h"'),
        ("km/h", KMH, 'set gnss_speed.unit = "m/s"'),
        ("m/s", 1.0 / KNOT, "the data look like kn: multiply them by 0.51"),
    ],
)
def test_a_receiver_s_speed_in_another_unit_is_named(
    sound: Recording, speeds: pd.DataFrame, declared: Literal["m/s", "km/h"], factor: float, hint: str
) -> None:
    wrong = speeds.assign(speed_mps=speeds["speed_mps"] * factor)
    part = gnss_speed_description().model_copy(update={"unit": declared})
    description = sound.description.model_copy(update={"gnss_speed": part})
    recording = replace(sound, description=description, others={GNSS_SPEED_TABLE: wrong})
    _, found = diagnose(recording)
    (finding,) = (one for one in found if one.code == "gnss-speed-scale")
    assert finding.hint is not None
    assert hint in finding.hint
    left = without_contradicted_speeds(recording, CheckLimits())
    assert GNSS_SPEED_TABLE not in left.others
    assert "left out" in left.findings[-1].message


def test_a_receiver_s_speed_in_its_unit_is_left_alone(sound: Recording, speeds: pd.DataFrame) -> None:
    description = sound.description.model_copy(update={"gnss_speed": gnss_speed_description()})
    for recording in (
        replace(sound, description=description, others={GNSS_SPEED_TABLE: speeds}),
        replace(sound, description=description, others={GNSS_SPEED_TABLE: speeds}, gnss=None),
    ):
        scale = receiver_speed_scale(recording.others.get("gnss_speed"), recording.gnss, recording.tach)
        assert scale is not None
        assert scale.scale == pytest.approx(1.0, abs=0.03)
        assert without_contradicted_speeds(recording, CheckLimits()) is recording
