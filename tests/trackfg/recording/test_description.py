"""The models behind recording.toml: defaults, units that belong together, and what is refused."""

from __future__ import annotations

import tomllib
from typing import Any

import pytest
from pydantic import ValidationError

from trackfg.errors import BadInputError
from trackfg.recording.description import Imu, Laser, RecordingDescription, Tach

CONTRACT = """
format = "trackfg-recording/1"
id = "2026-05-01-0312-down"
start = 2026-05-01T03:12:00Z
[track]
gauge_m = 1.067
cross_level_base_m = 1.067
direction = 1
latitude_deg = 35.2
[imu]
file = "imu.parquet"
time = "t"
stamp = "centre"
gyro = ["wx", "wy", "wz"]
gyro_unit = "rad/s"
accel = ["fx", "fy", "fz"]
accel_unit = "m/s^2"
axes = "FLU"
mount_rpy_deg = [0, 0, 0]
lever_arm_m = [0, 0, 0]
[imu.noise]
gyro_white = 5e-5
accel_white = 1e-3
gyro_bias_walk = 2e-6
accel_bias_walk = 1e-5
gyro_bias_sd = 1e-3
accel_bias_sd = 0.03
[tach]
file = "tach.parquet"
time = "t"
column = "count"
kind = "pulses"
unit = "1"
pulses_per_rev = 90
wheel_diameter_m = 0.86
scale_sd = 0.01
signed = false
time_offset_s = 0.0
[fixes]
file = "fixes.csv"
time = "t"
chainage = "chainage_m"
sd = "sd_m"
[gnss]
file = "gnss.csv"
time = "t"
position = ["lat_deg", "lon_deg", "height_m"]
sd = ["sd_e", "sd_n", "sd_u"]
lever_arm_m = [0, 0, 0]
[[laser]]
name = "A-left-vertical"
file = "laser.parquet"
time = "t"
column = "a_lv"
unit = "mm"
position_m = [5.0, 0.5, 0.0]
axis = "z"
rail = "left"
sd_m = 1e-4
[truth]
file = "truth.parquet"
time = "t"
geometry = "truth_geometry.parquet"
"""


def tach(**changes: Any) -> Tach:
    return Tach(**({"file": "t.csv", "column": "c", "kind": "distance", "unit": "m"} | changes))


def laser(name: str) -> Laser:
    return Laser(name=name, file="l.csv", column="d", position_m=(0, 0, 0), axis="y", rail="left", sd_m=1e-3)


def imu(**changes: Any) -> Imu:
    return Imu(**({"file": "i.csv", "gyro": ("a", "b", "c"), "accel": ("d", "e", "f")} | changes))


def test_the_documented_example_is_valid_and_complete() -> None:
    description = RecordingDescription.model_validate(tomllib.loads(CONTRACT))
    assert description.track.gauge_m == 1.067
    assert description.laser[0].position_m == (5.0, 0.5, 0.0)
    assert description.truth is not None
    assert description.truth.geometry == "truth_geometry.parquet"
    assert description.start is not None
    assert description.start.isoformat() == "2026-05-01T03:12:00+00:00"


def test_what_may_be_left_out_has_the_documented_default() -> None:
    description = RecordingDescription(id="x", imu=imu())
    assert (description.track.gauge_m, description.track.cross_level_base_m) == (1.435, 1.5)
    assert description.track.direction == 1
    assert (description.imu.time, description.imu.time_unit, description.imu.stamp) == ("t", "s", "centre")
    assert description.imu.axes == "FLU"
    assert description.tach is description.fixes is description.gnss is description.truth is None
    assert description.laser == ()


def test_a_sensor_has_a_name_or_none() -> None:
    assert imu().id is None
    assert imu(id="car 7, rear axle").id == "car 7, rear axle"
    with pytest.raises(ValidationError, match="at least 1 character"):
        imu(id="")


@pytest.mark.parametrize(
    ("kind", "unit", "fits"),
    [
        ("pulses", "1", True), ("pulses", "m", False),
        ("distance", "m", True), ("distance", "mm", True), ("distance", "km/h", False), ("distance", "1", False),
        ("speed", "m/s", True), ("speed", "km/h", True), ("speed", "m", False),
    ],
)  # fmt: skip
def test_a_tach_has_a_unit_of_its_kind(kind: str, unit: str, fits: bool) -> None:
    given = {"kind": kind, "unit": unit, "pulses_per_rev": 90, "wheel_diameter_m": 0.9}
    if fits:
        assert tach(**given).integrates_speed == (kind == "speed")
    else:
        with pytest.raises(ValidationError, match="does not fit kind"):
            tach(**given)


def test_a_distance_may_be_marked_as_integrated_from_a_speed() -> None:
    assert tach(integrated=True).integrates_speed
    assert not tach().integrates_speed


@pytest.mark.parametrize("axes", ["", "FL", "FLX", "flu", "FBU", "FLUD", "UUU"])
def test_axes_that_are_no_triad_are_refused(axes: str) -> None:
    with pytest.raises(ValidationError, match="axes"):
        imu(axes=axes)


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_sigmas_and_sizes_are_positive_and_finite(value: float) -> None:
    with pytest.raises(ValidationError):
        tach(scale_sd=value)
    with pytest.raises(ValidationError):
        tach(wheel_diameter_m=value)


def test_lasers_have_names_of_their_own() -> None:
    other = laser("b").model_copy(update={"rail": "right"})
    assert len(RecordingDescription(id="x", imu=imu(), laser=(laser("a"), other)).laser) == 2
    with pytest.raises(BadInputError, match="two lasers have the name 'a'"):
        RecordingDescription(id="x", imu=imu(), laser=(laser("a"), laser("a")))


def test_a_description_made_in_python_names_every_field_at_fault() -> None:
    wrong = {"id": "x", "imu": {"file": "imu.csv", "gyro": ["x", "y", "z"], "acc": ["x", "y", "z"]}, "starts": "now"}
    with pytest.raises(BadInputError) as refused:
        RecordingDescription.model_validate(wrong)
    known, unknown, key = str(refused.value).split("; expected one of ", 2)
    assert known == "RecordingDescription: imu.accel: is missing; imu.acc: unknown key"
    assert unknown.endswith("; starts: unknown key")
    assert key.endswith("Hint: did you mean 'start'?")


def test_unknown_keys_are_refused_and_nothing_changes_afterwards() -> None:
    with pytest.raises(ValidationError, match="extra"):
        tach(scale=1.0)
    with pytest.raises(ValidationError, match="frozen"):
        tach().column = "other"  # type: ignore[misc]
