"""Every way in which a recording can be bad: what `trackfg check` says, and reading refuses in the same words."""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackfg.errors import BadInputError
from trackfg.io.check import CheckLimits, check_recording
from trackfg.io.reader import read_recording
from trackfg.recording.description import Fixes, Gnss, Imu, ImuNoise, Laser, Table, Tach, Track, Truth

Draft = Any
Spoil = Callable[[Draft], None]


def put(table: str, row: int, column: str, value: float) -> Spoil:
    """Write ``value`` into data row ``row`` (from 1)."""

    def spoil(draft: Draft) -> None:
        draft[table][column] = draft[table][column].astype(float)
        draft[table].loc[row - 1, column] = value

    return spoil


def scale(table: str, columns: list[str], factor: float) -> Spoil:
    def spoil(draft: Draft) -> None:
        draft[table][columns] = draft[table][columns] * factor

    return spoil


def declare(*path: str | int, value: object) -> Spoil:
    def spoil(draft: Draft) -> None:
        place = draft.toml
        for step in path[:-1]:
            place = place[step]
        place[path[-1]] = value

    return spoil


def forget(*path: str | int) -> Spoil:
    def spoil(draft: Draft) -> None:
        place = draft.toml
        for step in path[:-1]:
            place = place[step]
        del place[path[-1]]

    return spoil


def drop_rows(table: str, first: int, last: int) -> Spoil:
    def spoil(draft: Draft) -> None:
        draft.tables[f"{table}.csv"] = draft[table].drop(index=range(first - 1, last)).reset_index(drop=True)

    return spoil


def cell(table: str, row: int, column: str, text: str) -> Spoil:
    def spoil(draft: Draft) -> None:
        draft[table][column] = draft[table][column].astype(object)
        draft[table].loc[row - 1, column] = text

    return spoil


def text(name: str, content: str | bytes) -> Spoil:
    return lambda draft: draft.texts.__setitem__(name, content)


def rows_swapped(table: str, row: int) -> Spoil:
    def spoil(draft: Draft) -> None:
        data = draft[table].to_numpy(copy=True)
        data[[row - 2, row - 1]] = data[[row - 1, row - 2]]
        draft.tables[f"{table}.csv"] = pd.DataFrame(data, columns=draft[table].columns)

    return spoil


def longer_row(draft: Draft) -> None:
    lines = draft["imu"].to_csv(index=False).splitlines()
    lines[12] += ",5"
    del draft.tables["imu.csv"]
    draft.texts["imu.csv"] = "\n".join(lines)


def semicolons(draft: Draft) -> None:
    draft.texts["imu.csv"] = draft["imu"].to_csv(index=False, sep=";")


def truncated_parquet(draft: Draft) -> None:
    draft.toml["imu"]["file"] = "imu.parquet"
    draft.texts["imu.parquet"] = draft["imu"].to_parquet()[:5000]


def dates_as_time(draft: Draft) -> None:
    draft.toml["imu"]["file"] = "imu.parquet"
    draft.tables["imu.parquet"] = draft["imu"].assign(t=pd.to_datetime(draft["imu"]["t"], unit="s"))


def emptied(draft: Draft) -> None:
    draft.tables["tach.csv"] = draft["tach"].iloc[:0]


def turned_over(draft: Draft) -> None:
    draft["imu"][["wy", "wz", "fy", "fz"]] *= -1.0


def on_its_side(draft: Draft) -> None:
    imu = draft["imu"]
    imu["fy"], imu["fz"] = imu["fz"].copy(), -imu["fy"]


def laser_in_metres(draft: Draft) -> None:
    draft["laser"]["a_lv"] /= 1000.0


def laser_in_another_unit(draft: Draft) -> None:
    draft["laser"]["t"] *= 1000.0
    draft.toml["laser"][0]["time_unit"] = "us"


def since_1970_in_us(table: str) -> Spoil:
    def spoil(draft: Draft) -> None:
        draft[table]["t"] = 1e6 * (draft[table]["t"] + 1_777_000_000)

    return spoil


def two_lasers_of_one_name(draft: Draft) -> None:
    draft.toml["laser"] *= 2


ALL_GYRO, ALL_ACCEL = ["wx", "wy", "wz"], ["fx", "fy", "fz"]

# What is done to a sound recording; the code of the finding; what its one line must say.
BROKEN: dict[str, tuple[Spoil, str, list[str]]] = {
    "no such table": (
        declare("imu", "file", value="imv.csv"), "missing-file",
        ["imv.csv: no such file", "did you mean 'imu.csv'?"]),
    "no such column": (
        declare("imu", "gyro", value=["wx", "wy", "w_z"]), "missing-column",
        ["imu.csv, column 'w_z': no such column", "one of t, wx, wy, wz, fx, fy, fz", "did you mean 'wz'?"]),
    "no such tach column": (
        declare("tach", "column", value="pulses"), "missing-column", ["tach.csv, column 'pulses'"]),
    "no such laser table": (
        declare("laser", 0, "file", value="laser.parquet"), "missing-file", ["laser.parquet: no such file"]),
    "unknown gyro unit": (
        declare("imu", "gyro_unit", value="deg/sec"), "unknown-unit",
        ["recording.toml, key imu.gyro_unit: is 'deg/sec'", "'rad/s' or 'deg/s'", "did you mean 'deg/s'?"]),
    "unknown laser unit": (
        declare("laser", 0, "unit", value="cm"), "unknown-unit", ["key laser[1].unit: is 'cm'", "'m' or 'mm'"]),
    "unit of another kind of tach": (
        declare("tach", "unit", value="km/h"), "bad-value",
        ["key tach: unit 'km/h' does not fit kind 'pulses'", "expected 1"]),
    "unknown time unit": (
        declare("tach", "time_unit", value="min"), "unknown-unit", ["key tach.time_unit: is 'min'"]),
    "time repeats": (
        put("imu", 100, "t", 1.96), "time-repeated",
        ["imu.csv, column 't', data row 100 (t = 1.96 s)", "expected times that grow"]),
    "time falls": (
        put("tach", 50, "t", 4.75), "time-falls",
        ["tach.csv, column 't', data row 50 (t = 4.75 s): earlier than the row before", "sort the rows"]),
    "fixes out of order": (
        rows_swapped("fixes", 3), "time-falls", ["fixes.csv, column 't', data row 3"]),
    "NaN in the gyro": (
        put("imu", 17, "wx", np.nan), "nan",
        ["imu.csv, column 'wx', data row 17 (t = 0.32 s): empty or NaN", "expected a finite number"]),
    "infinite force": (
        put("imu", 18, "fz", np.inf), "infinite", ["imu.csv, column 'fz', data row 18 (t = 0.34 s): infinite"]),
    "a number out of this world": (
        put("fixes", 1, "chainage_m", 1e200), "infinite",
        ["fixes.csv, column 'chainage_m', data row 1", "above 1e+12"]),
    "NaN in the time": (
        put("tach", 5, "t", np.nan), "nan", ["tach.csv, column 't', data row 5: empty or NaN"]),
    "text in a cell": (
        cell("imu", 21, "fy", "ERR"), "not-numeric",
        ["imu.csv, column 'fy', data row 21: 'ERR' is not a number"]),
    "decimal comma": (
        cell("fixes", 2, "chainage_m", "1,5"), "not-numeric",
        ["fixes.csv, column 'chainage_m', data row 2: '1,5' is not a number", "decimals with a point"]),
    "a cell too many": (
        longer_row, "row-length", ["imu.csv, data row 12: 8 cells", "expected 7, as in the header"]),
    "semicolons": (semicolons, "missing-column", ["imu.csv, column 't'", "separate the cells by commas"]),
    "IMU gap": (
        drop_rows("imu", 2001, 2600), "gap",
        ["imu.csv, column 't', data row 2001 (t = 52 s): no rows for 12.02 s", "at most 10 s"]),
    "gravity upside down": (
        turned_over, "gravity-axis",
        ["imu.csv, column 'fz'", "wrong axis or sign", "declared U", "-9.8", 'set imu.axes = "FRD"']),
    "gravity on the lateral axis": (
        on_its_side, "gravity-axis", ["imu.csv, column 'fy'", "declared L", "points up", 'imu.axes = "FUR"']),
    "gyro in degrees": (
        scale("imu", ALL_GYRO, 180 / np.pi), "gyro-unit",
        ["imu.csv, column 'wx, wy, wz'", "as declared (rad/s)", 'set imu.gyro_unit = "deg/s"']),
    "gyro in radians declared as degrees": (
        declare("imu", "gyro_unit", value="deg/s"), "gyro-unit",
        ["imu.csv, column 'wx, wy, wz'", "as declared (deg/s)", 'set imu.gyro_unit = "rad/s"']),
    "g declared as m/s^2": (
        scale("imu", ALL_ACCEL, 1 / 9.80665), "accel-unit",
        ["imu.csv, column 'fx, fy, fz'", "1 m/s^2 as declared", 'set imu.accel_unit = "g"']),
    "m/s^2 declared as g": (
        declare("imu", "accel_unit", value="g"), "accel-unit",
        ["imu.csv", "96.1", "as declared (g)", 'set imu.accel_unit = "m/s^2"']),
    "milli-g": (scale("imu", ALL_ACCEL, 1000 / 9.80665), "accel-unit", ["imu.csv", "milli-g"]),
    "gravity removed": (
        lambda draft: draft["imu"].__setitem__("fz", draft["imu"]["fz"] - 9.80665), "accel-unit",
        ["imu.csv", "gravity seems to have been removed"]),
    "zero sigma of a fix": (
        put("fixes", 2, "sd_m", 0.0), "bad-sigma",
        ["fixes.csv, column 'sd_m', data row 2", "0: a sigma that is zero or negative", "above 0"]),
    "sigma of a fix below any number's square": (
        put("fixes", 2, "sd_m", 5e-324), "bad-sigma",
        ["fixes.csv, column 'sd_m', data row 2", "a sigma that no place has", "1e-09 m or more"]),
    "negative sigma of GNSS": (
        put("gnss", 9, "sd_n", -1.0), "bad-sigma", ["gnss.csv, column 'sd_n', data row 9 (t = 8 s): -1"]),
    "zero noise density": (
        declare("imu", "noise", "gyro_white", value=0), "bad-sigma",
        ["recording.toml, key imu.noise.gyro_white", "zero or negative", "a number above 0"]),
    "negative laser sigma": (
        declare("laser", 0, "sd_m", value=-1e-4), "bad-sigma", ["key laser[1].sd_m"]),
    "tach backwards": (
        put("tach", 400, "count", 3.0), "tach-backwards",
        ["tach.csv, column 'count', data row 400 (t = 39.9 s): 3: the tach runs backwards", "tach.signed"]),
    "tach that only falls": (
        scale("tach", ["count"], -1.0), "tach-backwards",
        ["the tach runs backwards", "it never rises: negate it", "tach.signed = true"]),
    "clocks apart": (
        declare("tach", "time_offset_s", value=5000.0), "clocks-apart",
        ["tach.csv, column 't'", "the clocks do not overlap", "[tach]", "time_offset_s"]),
    "local time beside UTC": (
        declare("tach", "time_offset_s", value=-7201.0), "clocks-apart",
        ["the clocks do not overlap", "set time_offset_s = -1 in [tach]", "another time zone"]),
    "laser in m declared as mm": (
        laser_in_metres, "laser-unit", ["laser.csv, column 'a_lv'", "as declared (mm)", 'unit = "m"']),
    "laser in mm declared as m": (
        declare("laser", 0, "unit", value="m"), "laser-unit",
        ["laser.csv, column 'a_lv'", "421.9", "as declared (m)", 'unit = "mm"', "laser[1].unit"]),
    "time in ms": (
        scale("imu", ["t"], 1000.0), "time-unit",
        ["imu.csv, column 't': rows are 20 s apart (median), 0.05 a second", 'the times look like ms',
         'set imu.time_unit = "ms", and the sensor has 50 rows a second']),
    "time in us": (
        scale("imu", ["t"], 1e6), "time-unit", ["rows are 2e+04 s apart", 'set imu.time_unit = "us"']),
    "time in s declared as us": (
        declare("imu", "time_unit", value="us"), "time-unit", ["5e+07 a second", 'set imu.time_unit = "s"']),
    "time since 1970 in us": (
        since_1970_in_us("imu"), "time-unit", ["rows are 2e+04 s apart", 'set imu.time_unit = "us"']),
    "time of the tach since 1970 in us": (
        since_1970_in_us("tach"), "time-unit",
        ["tach.csv, column 't': 1.777e+15 s in the first row, as declared (s)", "set time_unit of this table"]),
    "time of the tach in ms": (
        scale("tach", ["t"], 1000.0), "time-unit", ["tach.csv, column 't'", 'set time_unit = "ms" in [tach]']),
    "time of the lasers in ms declared as us": (
        laser_in_another_unit, "time-unit", ["laser.csv, column 't'", 'set time_unit = "ms" in [[laser]]']),
    "wheel in mm": (
        declare("tach", "wheel_diameter_m", value=860), "tach-unit", ["tach.csv, column 'count'", "wheel_diameter_m"]),
    "gauge in mm": (
        declare("track", "gauge_m", value=1067), "track-size", ["key track.gauge_m: is 1067 m", "write 1.067"]),
    "misspelt key": (
        declare("imu", "giro_unit", value="rad/s"), "unknown-key",
        ["recording.toml, key imu.giro_unit: unknown key", "did you mean 'gyro_unit'?"]),
    "key of the whole recording below a table": (
        declare("imu", "start", value="2026-05-01T03:12:00Z"), "unknown-key",
        ["key imu.start: unknown key", "Hint: move start above the first [table]"]),
    "misspelt part": (
        declare("tacho", value={"file": "tach.csv"}), "unknown-key", ["key tacho", "did you mean 'tach'?"]),
    "misspelt key of the noise": (
        declare("imu", "noise", "giro_white", value=1e-4), "unknown-key",
        ["key imu.noise.giro_white", "did you mean 'gyro_white'?"]),
    "list too short": (
        declare("imu", "accel", value=["fx", "fy"]), "wrong-size",
        ["recording.toml, key imu.accel", "a list of three names"]),
    "list too long": (
        declare("imu", "lever_arm_m", value=[0, 0, 0, 0]), "wrong-size",
        ["key imu.lever_arm_m", "a list of three numbers"]),
    "a table that was not written whole": (
        text("imu.csv", b"t,wx,wy,wz,fx,fy,fz\n" + bytes(5000)), "unreadable-table",
        ["imu.csv: ends in null bytes"]),
    "a clock years off": (
        declare("imu", "time_offset_s", value=1e300), "bad-value",
        ["key imu.time_offset_s: is 1e+300; expected a number at most 1e+10 s"]),
    "a lever arm across the country": (
        declare("imu", "lever_arm_m", value=[1e9, 0, 0]), "bad-value", ["expected a number at most 100 m"]),
    "a wheel without pulses": (
        declare("tach", "pulses_per_rev", value=5e-324), "bad-value", ["at least 0.001 per revolution"]),
    "a sigma without bounds": (
        declare("imu", "noise", value={"gyro_white": 1e300}), "bad-sigma", ["key imu.noise.gyro_white: is 1e+300"]),
    "true for a number": (
        declare("imu", "noise", value={"gyro_white": True}), "bad-value", ["key imu.noise.gyro_white: is True"]),
    "a number in quotation marks": (
        declare("tach", "pulses_per_rev", value="90"), "bad-value", ["key tach.pulses_per_rev: is '90'"]),
    "one column for three": (
        declare("imu", "gyro", value=["wx", "wx", "wx"]), "bad-value", ["expected three different columns"]),
    "an id that databases refuse": (
        declare("id", value="a\0b"), "bad-value", ["key id"]),
    "text for a number": (
        declare("tach", "pulses_per_rev", value="many"), "bad-value", ["key tach.pulses_per_rev: is 'many'"]),
    "axes twice": (
        declare("imu", "axes", value="FLB"), "bad-value",
        ["recording.toml, key imu.axes: axes 'FLB'", "one of F/B, one of L/R and one of U/D"]),
    "no pulses per revolution": (
        forget("tach", "pulses_per_rev"), "bad-value",
        ["key tach", "kind 'pulses' needs pulses_per_rev and wheel_diameter_m"]),
    "no IMU": (forget("imu"), "missing-key", ["recording.toml, key imu: required key is missing"]),
    "no id": (forget("id"), "missing-key", ["recording.toml, key id: required key is missing", "add it: id ="]),
    "no format": (forget("format"), "format", ["key format: is missing", "trackfg-recording/1"]),
    "format of the future": (
        declare("format", value="trackfg-recording/2"), "format", ["is 'trackfg-recording/2'", "update trackfg"]),
    "TOML syntax": (
        text("recording.toml", 'format = "trackfg-recording/1"\nid = test\n'), "toml-syntax",
        ["recording.toml: Invalid value (at line 2, column 6)"]),
    "TOML in Latin-1": (text("recording.toml", b'id = "Z\xfcrich"'), "toml-syntax", ["recording.toml", "UTF-8"]),
    "part that is no table": (declare("gnss", value=5), "bad-value", ["key gnss: is not a table"]),
    "lasers that are no list": (declare("laser", value={}), "bad-value", ["key laser", "[[laser]]"]),
    "two lasers of one name": (two_lasers_of_one_name, "bad-value", ["key laser: two lasers have the name"]),
    "empty table": (emptied, "empty-table", ["tach.csv: the table is empty", "at least 2 data rows"]),
    "empty file": (text("tach.csv", ""), "missing-column", ["tach.csv, column 't'", "the file is empty"]),
    "truncated Parquet": (truncated_parquet, "unreadable-table", ["imu.parquet: cannot be read", "truncated"]),
    "dates for seconds": (
        dates_as_time, "not-numeric", ["imu.parquet, column 't': has type timestamp", "seconds since the start"]),
    "spreadsheet": (declare("fixes", "file", value="recording.toml"), "table-format", [".parquet or .csv"]),
    "column twice": (
        text("tach.csv", "t,count,count\n0,1,1\n1,2,2\n"), "repeated-column",
        ["tach.csv, column 'count': appears more than once"]),
    "absolute path": (
        declare("imu", "file", value="/etc/passwd.csv"), "path-outside", ["/etc/passwd.csv", "leads out"]),
    "path upwards": (
        declare("tach", "file", value="../tach.csv"), "path-outside", ["../tach.csv", "leads out of the recording"]),
    "Windows path": (declare("tach", "file", value="C:\\tach.csv"), "path-outside", ["leads out of the recording"]),
    "latitude and longitude exchanged": (
        declare("gnss", "position", value=["lon_deg", "lat_deg", "height_m"]), "position-range",
        ["gnss.csv, column 'lon_deg', data row 1 (t = 0 s): 139", "-90 to 90 deg", "latitude, longitude, height"]),
    "truth that is not there": (
        declare("truth", value={"file": "truth.parquet"}), "missing-file", ["truth.parquet: no such file"]),
}  # fmt: skip


def test_the_unspoilt_recording_has_no_finding(draft: Draft, tmp_path: Path) -> None:
    report = check_recording(draft.write(tmp_path / "rec"))
    assert [str(finding) for finding in report.findings] == []
    assert report.usable


@pytest.mark.parametrize("name", BROKEN)
def test_bad_input_is_found_named_and_refused(name: str, draft: Draft, tmp_path: Path) -> None:
    spoil, code, texts = BROKEN[name]
    spoil(draft)
    folder = draft.write(tmp_path / "rec")
    report = check_recording(folder)
    matching = [finding for finding in report.findings if finding.level == "error" and finding.code == code]
    assert matching, [str(finding) for finding in report.findings]
    line = str(matching[0])
    for expected in texts:
        assert expected in line
    assert "\n" not in line
    assert not report.usable
    with pytest.raises(BadInputError) as refusal:
        read_recording(folder)
    first = next(finding for finding in report.findings if finding.level == "error")
    assert str(refusal.value).startswith(str(first))


def test_a_speed_that_is_none_says_nothing_of_the_gyro(draft: Draft, tmp_path: Path) -> None:
    declare("tach", "pulses_per_rev", value=1.0)(draft)
    report = check_recording(draft.write(tmp_path / "rec"))
    assert [finding.code for finding in report.findings if finding.level == "error"] == ["tach-unit"]


def test_a_missing_folder_and_a_folder_without_description_are_findings(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for folder, words in (("nowhere", "no such folder"), ("empty", "has no recording.toml")):
        report = check_recording(tmp_path / folder)
        assert [finding.code for finding in report.findings] == ["no-recording"]
        assert words in str(report.findings[0])
        with pytest.raises(BadInputError, match=words):
            read_recording(tmp_path / folder)


def test_a_link_that_leads_out_of_the_recording_is_refused(draft: Draft, tmp_path: Path) -> None:
    folder = draft.write(tmp_path / "rec")
    (folder / "imu.csv").rename(tmp_path / "elsewhere.csv")
    (folder / "imu.csv").symlink_to(tmp_path / "elsewhere.csv")
    report = check_recording(folder)
    assert [finding.code for finding in report.findings] == ["path-outside"]
    assert "the link leads out" in str(report.findings[0])


def test_several_faults_are_all_found_at_once(draft: Draft, tmp_path: Path) -> None:
    faults = [
        "unknown gyro unit", "NaN in the gyro", "time falls", "tach backwards", "zero sigma of a fix",
        "negative sigma of GNSS", "misspelt key of the noise", "laser in mm declared as m",
    ]  # fmt: skip
    for name in faults:
        BROKEN[name][0](draft)
    report = check_recording(draft.write(tmp_path / "rec"))
    lines = [str(finding) for finding in report.findings if finding.level == "error"]
    for name in faults:
        _, code, texts = BROKEN[name]
        assert any(all(text in line for text in texts) for line in lines), (name, code, lines)
    assert len(lines) == len(faults)
    with pytest.raises(BadInputError, match=rf"\({len(faults) - 1} more errors: `trackfg check .*rec` lists all\)"):
        read_recording(tmp_path / "rec")


def test_repeated_faults_are_counted_not_listed(draft: Draft, tmp_path: Path) -> None:
    draft["imu"].loc[10:19, "wz"] = np.nan
    report = check_recording(draft.write(tmp_path / "rec"))
    assert len(report.findings) == 1
    assert "data row 11" in str(report.findings[0])
    assert "(10 such rows)" in str(report.findings[0])


def doubts(draft: Draft, folder: Path) -> dict[str, str]:
    """Code and line of each warning; there must be no error."""
    report = check_recording(draft.write(folder))
    assert report.usable, [str(finding) for finding in report.findings]
    return {finding.code: str(finding) for finding in report.findings if finding.level == "warning"}


def test_a_bridgeable_gap_is_a_warning_and_its_limit_can_be_set(draft: Draft, tmp_path: Path) -> None:
    drop_rows("imu", 2001, 2250)(draft)
    found = doubts(draft, tmp_path / "rec")
    assert set(found) == {"gap"}
    assert "data row 2001 (t = 45 s): no rows for 5.02 s" in found["gap"]
    with pytest.raises(BadInputError, match=r"no rows for 5.02 s before this one; expected at most 3 s"):
        read_recording(tmp_path / "rec", CheckLimits(imu_gap_error_s=3.0))


def test_a_jump_of_the_clock_by_years_is_a_gap_and_nothing_is_estimated_over_it(draft: Draft, tmp_path: Path) -> None:
    for table in ("imu", "tach", "gnss"):
        draft[table]["t"] += np.where(draft[table]["t"] > 40.0, 1.6e9, 0.0)
    report = check_recording(draft.write(tmp_path / "rec"))
    assert "no rows for 1.6e+09 s before this one" in str(report.findings[0])
    assert "cut the recording in two here" in str(report.findings[0])
    assert not report.estimates


def test_a_silent_tach_is_a_warning(draft: Draft, tmp_path: Path) -> None:
    drop_rows("tach", 301, 900)(draft)
    assert "no rows for 60.1 s" in doubts(draft, tmp_path / "rec")["gap"]


def test_a_signed_count_that_wraps_is_a_warning_with_its_row(draft: Draft, tmp_path: Path) -> None:
    declare("tach", "signed", value=True)(draft)
    modulus = draft["tach"]["count"].max() // 2 + 1
    draft["tach"]["count"] %= modulus
    row = int(np.argmax(np.diff(draft["tach"]["count"]) < 0.0)) + 2
    found = doubts(draft, tmp_path / "rec")["tach-jump"]
    assert f"tach.csv, column 'count', data row {row} " in found
    assert "a counter that wraps must be unwrapped first" in found


def test_a_tilted_sensor_gets_its_mounting_angles(draft: Draft, tmp_path: Path) -> None:
    angle = np.radians(18.0)
    c, s = np.cos(angle), np.sin(angle)
    for a, b in (("fy", "fz"), ("wy", "wz")):
        y, z = draft["imu"][a].copy(), draft["imu"][b].copy()
        draft["imu"][a], draft["imu"][b] = c * y + s * z, -s * y + c * z
    folder = tmp_path / "rec"
    assert "turn imu.mount_rpy_deg by roll 18.0, pitch -0.3 deg" in doubts(draft, folder)["gravity-tilt"]
    draft.toml["imu"]["mount_rpy_deg"] = [18.0, 0.0, 0.0]
    assert doubts(draft, folder) == {}


def test_stuck_saturated_and_repeated_channels_are_warnings(draft: Draft, tmp_path: Path) -> None:
    imu = draft["imu"]
    imu.loc[1000:1400, "wy"] = imu.loc[1000, "wy"]
    imu["wx"] = imu["wx"].clip(lower=-0.002)
    imu.loc[3000:3060, imu.columns[1:]] = imu.loc[3000, imu.columns[1:]].to_numpy()
    found = doubts(draft, tmp_path / "rec")
    assert "column 'wy', data row 1001 (t = 20 s): constant for 8 s" in found["stuck-channel"]
    assert "data row 3001 (t = 60 s)" in found["rows-repeated"]


def test_rows_that_were_interpolated_over_a_hole_are_a_warning(draft: Draft, tmp_path: Path) -> None:
    imu = draft["imu"]
    values = imu.columns[1:]
    imu.loc[2001:2059, values] = np.nan
    imu[values] = imu[values].interpolate()
    found = doubts(draft, tmp_path / "rec")
    assert (
        "data row 2003 (t = 40.04 s): 58 rows in which all six channels lie on straight lines"
        in found["rows-interpolated"]
    )


def test_saturation_is_a_warning(draft: Draft, tmp_path: Path) -> None:
    draft["imu"].loc[4000:4010, "fx"] = 19.62
    assert (
        "column 'fx', data row 4001 (t = 80 s): stays at its extreme 19.62"
        in doubts(draft, tmp_path / "rec")["saturated-channel"]
    )


def test_values_beyond_any_sensor_are_a_warning(draft: Draft, tmp_path: Path) -> None:
    draft["imu"].loc[[4000, 4007], "fx"] = -1e4
    draft["imu"].loc[500, "wz"] = 40.0
    findings = check_recording(draft.write(tmp_path / "rec")).findings
    said = [str(finding) for finding in findings if finding.code == "impossible-value"]
    assert len(said) == 2
    assert "column 'wz', data row 501 (t = 10 s): 40 rad/s" in said[0]
    assert "column 'fx', data row 4001 (t = 80 s): -10000 m/s^2, and 1 more such values" in said[1]


@pytest.mark.parametrize(("part", "key"), [("imu", "rigid"), ("gnss", "lever_arm_m")])
def test_what_decides_much_and_is_not_stated_is_named(draft: Draft, tmp_path: Path, part: str, key: str) -> None:
    forget(part, key)(draft)
    folder = draft.write(tmp_path / "rec")
    (finding,) = check_recording(folder).findings
    assert (finding.level, finding.code, finding.column) == ("info", "assumed", f"{part}.{key}")
    assert "is assumed" in finding.message
    assert (finding.hint or "").startswith("write ")
    assert read_recording(folder).findings == (finding,)


@pytest.mark.parametrize(("gauge_m", "named"), [(1.0, True), (1.668, True), (1.435, False)])
def test_the_base_of_the_cross_level_is_named_beside_another_gauge(
    draft: Draft, tmp_path: Path, gauge_m: float, named: bool
) -> None:
    draft.toml["track"] = {"gauge_m": gauge_m}
    found = [str(finding) for finding in check_recording(draft.write(tmp_path / "rec")).findings]
    assert len(found) == named
    for finding in found:
        assert "track.cross_level_base_m: is not stated; 1.5 m is assumed, beside a gauge of " in finding


@pytest.mark.parametrize(("base_m", "doubtful"), [(1.067, True), (1.435, False), (1.5, False)])
def test_a_base_of_the_cross_level_below_the_gauge_is_a_warning(
    draft: Draft, tmp_path: Path, base_m: float, doubtful: bool
) -> None:
    draft.toml["track"] = {"gauge_m": 1.435, "cross_level_base_m": base_m}
    found = doubts(draft, tmp_path / "rec")
    assert ("is 1.067 m, beside a gauge of 1.435 m" in found.get("track-size", "")) == doubtful


@pytest.mark.parametrize(
    ("start", "message"),
    [
        (datetime(1980, 1, 6, 0, 0, 12, tzinfo=UTC), "is 1980-01-06 00:00 UTC, which a clock shows that was not set"),
        (datetime(2000, 1, 1, 1, 30), "is 2000-01-01 01:30 UTC, which a clock shows that was not set"),
        (datetime(2945, 5, 1, tzinfo=UTC), "is 2945-05-01 00:00 UTC, which is to come"),
        (datetime(2026, 5, 1, tzinfo=UTC), None),
    ],
)
def test_a_date_that_no_run_has_is_a_warning(
    draft: Draft, tmp_path: Path, start: datetime, message: str | None
) -> None:
    draft.toml["start"] = start

    found = doubts(draft, tmp_path / "rec")

    assert ("start-date" in found) == (message is not None)
    assert (message or "") in found.get("start-date", "")


def test_a_key_with_a_fault_is_not_called_absent(draft: Draft, tmp_path: Path) -> None:
    declare("imu", "rigid", value="yes")(draft)
    assert "assumed" not in {finding.code for finding in check_recording(draft.write(tmp_path / "rec")).findings}


def test_fixes_against_the_direction_are_a_warning(draft: Draft, tmp_path: Path) -> None:
    draft.toml["track"]["direction"] = -1
    found = doubts(draft, tmp_path / "rec")
    assert "fixes.csv, column 'chainage_m', data row 2" in found["direction"]
    assert "set track.direction = 1" in found["direction"]
    draft.toml["tach"]["signed"] = True
    found = doubts(draft, tmp_path / "signed")
    assert "set track.direction = 1 if chainage grows where the vehicle moves forwards" in found["direction"]


def test_a_latitude_that_is_the_longitude_of_the_positions_is_named(draft: Draft, tmp_path: Path) -> None:
    draft.toml["track"]["latitude_deg"] = 139.0 - 90.0
    draft["gnss"]["lon_deg"] -= 90.0
    assert "exchange latitude and longitude" in doubts(draft, tmp_path / "rec")["latitude"]


def test_a_latitude_elsewhere_and_a_partial_overlap_are_warnings(draft: Draft, tmp_path: Path) -> None:
    draft.toml["track"]["latitude_deg"] = 47.0
    draft.toml["laser"][0]["time_offset_s"] = 100.0
    found = doubts(draft, tmp_path / "rec")
    assert "write 35.2" in found["latitude"]
    assert "33% of its rows are within" in found["clocks-apart"]


@pytest.mark.parametrize(
    ("keeps", "said"),
    [(lambda t: t < t.max() - 25.0, "after the IMU's last row"), (lambda t: t > 60.0, "before the IMU's first row")],
)
def test_a_wheel_that_rolls_on_without_the_imu_is_a_warning(
    keeps: Callable[[pd.Series], pd.Series], said: str, draft: Draft, tmp_path: Path
) -> None:
    draft.tables["imu.csv"] = draft["imu"][keeps(draft["imu"]["t"])]

    found = doubts(draft, tmp_path / "rec")

    assert said in found["imu-absent"]
    assert "tach.csv, column 't', data row" in found["imu-absent"]


@pytest.mark.parametrize(("diameter", "is_doubtful"), [(0.159, False), (0.86, False), (0.02, True), (2.5, True)])
def test_a_diameter_that_no_wheel_has_is_a_warning(
    diameter: float, is_doubtful: bool, draft: Draft, tmp_path: Path
) -> None:
    tach = draft.toml["tach"]
    tach |= {"pulses_per_rev": tach["pulses_per_rev"] * diameter / 0.86, "wheel_diameter_m": diameter}

    assert ("wheel-diameter" in doubts(draft, tmp_path / "rec")) == is_doubtful


def test_a_recording_in_memory_is_no_folder() -> None:
    with pytest.raises(TypeError, match=r"takes the folder of a recording, as trackfg.write_recording.* not DataFrame"):
        check_recording(pd.DataFrame())  # type: ignore[arg-type]


def test_findings_carry_their_parts(draft: Draft, tmp_path: Path) -> None:
    put("imu", 17, "wx", np.nan)(draft)
    (finding,) = check_recording(draft.write(tmp_path / "rec")).findings
    assert (finding.file, finding.column, finding.row, finding.time_s) == ("imu.csv", "wx", 17, 0.32)
    assert finding.expected == "a finite number"
    assert finding.hint


def test_the_manual_lists_every_code() -> None:
    """Codes are part of the interface: docs/recording.md has a row for each, and none that does not exist."""
    root = Path(__file__).parents[3]
    sources = "\n".join(path.read_text() for path in sorted((root / "trackfg").rglob("*.py")))
    manual = (root / "docs" / "recording.md").read_text()
    rows = re.findall(r"^\| ((?:`[a-z-]+`(?:, )?)+) \| ", manual.split("## trackfg check")[1], flags=re.MULTILINE)
    documented = {code for row in rows for code in re.findall(r"`([a-z-]+)`", row)}
    for code in documented:
        assert f'"{code}"' in sources
    raised = {code for _, code, _ in BROKEN.values()}
    assert raised <= documented


def test_the_manual_lists_every_key_with_its_default() -> None:
    manual = (Path(__file__).parents[3] / "docs" / "recording.md").read_text()
    sections = dict(re.findall(r"^### ([^\n]+)\n(.*?)(?=^##)", manual, re.DOTALL | re.MULTILINE))
    shared = set(Table.model_fields)
    models = {
        "Every table": Table, "[track]": Track, "[imu]": Imu, "[imu.noise]": ImuNoise, "[tach]": Tach,
        "[fixes]": Fixes, "[gnss]": Gnss, "[[laser]]": Laser, "[truth]": Truth,
    }  # fmt: skip
    for title, model in models.items():
        rows = re.findall(r"^\| `(\w+)` \|[^|]*\| ([^|]+) \|", sections[title], flags=re.MULTILINE)
        own = {name: info for name, info in model.model_fields.items() if model is Table or name not in shared}
        own.pop("noise", None)
        assert dict(rows).keys() == own.keys(), title
        for name, shown in rows:
            info = own[name]
            assert (shown == "required") == info.is_required(), (title, name)
            if not info.is_required() and isinstance(info.default, float):
                assert float(shown) == info.default, (title, name)
            if not info.is_required() and isinstance(info.default, str):
                assert shown == f'`"{info.default}"`', (title, name)
