"""``trackfg init`` and ``trackfg import`` through the real entry point, with the log that once took an hour."""

from __future__ import annotations

import io
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import tomli_w

from trackfg.datasets.scenarios import simulate
from trackfg.errors import BadInputError
from trackfg.interchange.importing.columns.column_names import meaning
from trackfg.interchange.importing.columns.time_columns import time_columns
from trackfg.interchange.importing.conversion import write_imported
from trackfg.interchange.importing.mapping import mapping_of, read_mapping
from trackfg.interchange.importing.proposal import propose
from trackfg.interchange.importing.proposals.questions import choice_in, number_in
from trackfg.interchange.importing.registry import source_format, source_formats
from trackfg.io.reader import read_recording
from trackfg.smoothing.smoother import smooth


@pytest.fixture
def answered(
    trackfg: Callable[..., subprocess.CompletedProcess[str]], monkeypatch: pytest.MonkeyPatch
) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Return what runs the command line in this process, its questions answered from a pipe."""

    def run(*arguments: object, answers: str) -> subprocess.CompletedProcess[str]:
        monkeypatch.setattr(sys, "stdin", io.StringIO(answers))
        return trackfg(*arguments)

    return run


def vendor_log(folder: Path) -> tuple[Path, object]:
    """Semicolons, decimal commas, cp1252, dates, stamps of 10 ms at 200 Hz, posts as 12+345 in a spreadsheet."""
    simulation = simulate("mainline", seed=2, duration_s=60.0)
    recording = simulation.recording
    imu, tach = recording.imu, recording.tach
    start = pd.Timestamp("2026-05-01T03:12:00")
    written = (start + pd.to_timedelta(imu["t_s"], unit="s")).dt.floor("10ms")
    stamps = written.dt.strftime("%d.%m.%Y %H:%M:%S,%f").str[:-3]
    count = np.floor(np.interp(imu["t_s"], tach["t_s"], tach["distance_m"]) / (np.pi * 0.92 / 90)).astype(int)
    values = [*(imu.iloc[:, 1 + i].to_numpy() * 180 / np.pi for i in range(3)), *(imu.iloc[:, 4 + i] for i in range(3))]
    cells = [[f"{v:.6f}".replace(".", ",") for v in column] for column in values]
    rows = [";".join(row) for row in zip(stamps, *cells, map(str, count), strict=True)]
    head = ["Messfahrt 12;;;;;;;", "Gerät: Prüfwagen;;;;;;;"]
    names = "Zeit;GyrX;GyrY;GyrZ;BeschlX;BeschlY;BeschlZ;Impulse"
    units = "[];[°/s];[°/s];[°/s];[m/s²];[m/s²];[m/s²];[-]"
    source = folder / "vendor"
    source.mkdir()
    (source / "log.csv").write_bytes(("\r\n".join([*head, names, units, *rows]) + "\r\n").encode("cp1252"))
    at = np.array([10.0, 30.0, 50.0])
    place = 12_345.0 + np.interp(at, simulation.truth["t_s"], simulation.truth["chainage_m"])
    posts = pd.DataFrame({"Zeit": start + pd.to_timedelta(at, unit="s")})
    posts["Station"] = [f"{int(m // 1000)}+{m % 1000:07.3f}".replace(".", ",") for m in place]
    posts.to_excel(source / "posts.xlsx", index=False)
    return source, recording


def test_a_vendor_s_log_needs_one_command_and_no_script(trackfg, tmp_path):
    source, original = vendor_log(tmp_path)
    out = tmp_path / "run"

    command = [sys.executable, "-m", "trackfg", "init", source, "-o", out]
    answers = "90\n920\n0.92\nnowhere\nUTC\n\n\n"
    done = subprocess.run(command, capture_output=True, text=True, input=answers, timeout=120)

    assert done.returncode == 0, done.stderr
    said = " ".join(done.stdout.split())
    assert "920 is not understood; expected a number such as 0.92, up to 2" in said
    assert "nowhere is not understood; expected a zone such as Europe/Zurich" in said
    assert "time_zone" not in done.stderr  # it was answered
    assert "trackfg check says whether they agree" in done.stdout
    recording = read_recording(out)
    imu = ["wx_radps", "wy_radps", "wz_radps", "fx_mps2", "fy_mps2", "fz_mps2"]
    np.testing.assert_allclose(recording.imu[imu], original.imu[imu], atol=2e-6)
    np.testing.assert_allclose(recording.imu["t_s"] - original.imu["t_s"], -0.005, atol=0.002)  # stamps were cut off
    assert recording.fixes["chainage_m"].iloc[0] > 12_000.0
    mapping = tmp_path / "run.mapping.toml"
    assert "pulses_per_rev" in mapping.read_text()
    other = trackfg("init", source, "-o", out)
    assert other.returncode == 2
    assert f"to change its answers, edit it, remove {out} and run: trackfg import {source}" in other.stderr
    again = trackfg("import", source, "-o", tmp_path / "again", "--mapping", mapping)
    assert again.returncode == 0
    assert "assumed" not in again.stderr
    assert (tmp_path / "again" / "imu.parquet").read_bytes() == (out / "imu.parquet").read_bytes()
    assert (tmp_path / "again" / "recording.toml").read_text() == (out / "recording.toml").read_text()


def test_a_mapping_of_one_file_takes_the_next_one_whatever_its_name(trackfg, tmp_path):
    runs = tmp_path / "logs"
    runs.mkdir()
    names = ("run of Monday.csv", "run of Friday.csv")
    for seed, name in enumerate(names):
        recording = simulate("trolley", seed=seed, duration_s=80.0).recording
        table = recording.imu.iloc[::4].reset_index(drop=True)
        table["distance_m"] = np.interp(table["t_s"], recording.tach["t_s"], recording.tach["distance_m"])
        table.to_csv(runs / name, index=False)
    made = trackfg("init", runs / names[0], "-o", tmp_path / "a", "--yes")
    assert made.returncode == 0, made.stderr
    mapping = tmp_path / "a.mapping.toml"

    again = trackfg("import", runs / names[1], "-o", tmp_path / "b", "--mapping", mapping)
    assert again.returncode == 0, again.stderr
    assert read_recording(tmp_path / "b").imu["wz_radps"].equals(pd.read_csv(runs / names[1])["wz_radps"])

    both = trackfg("import", runs, "-o", tmp_path / "c")
    assert both.returncode == 0, both.stderr
    (said,) = [line for line in both.stderr.splitlines() if "not used" in line]
    assert f"which have the columns of {min(names)}. Hint: other runs are imported each by itself" in said
    wrong = trackfg(
        "import", runs, "-o", tmp_path / "d", "--mapping", _mapping_of(mapping, "run of Tuesday.csv", tmp_path)
    )
    assert wrong.returncode == 2
    assert "Hint: did you mean 'run of Monday.csv'? A pattern, such as 'log*.csv'," in wrong.stderr


def test_many_logs_of_one_device_become_recordings_in_one_folder(trackfg, tmp_path):
    logs, out = tmp_path / "logs", tmp_path / "recordings"
    logs.mkdir()
    for seed, name in enumerate(("monday", "tuesday", "wednesday")):
        recording = simulate("trolley", seed=seed, duration_s=80.0).recording
        table = recording.imu.iloc[::4].reset_index(drop=True)
        table["distance_m"] = np.interp(table["t_s"], recording.tach["t_s"], recording.tach["distance_m"])
        table.to_csv(logs / f"{name}.csv", index=False)
    mapping = tmp_path / "device.toml"
    made = trackfg("init", logs / "monday.csv", "-o", tmp_path / "first", "--mapping", mapping, "--yes")
    assert made.returncode == 0, made.stderr
    (logs / "broken.csv").write_text("t_s,wx_radps\n0.0,1.0\n0.1,2.0\n")
    days = [logs / f"{name}.csv" for name in ("monday", "broken", "tuesday")]

    done = trackfg("import", *days, "-o", out, "--mapping", mapping)
    assert done.returncode == 1
    (fault,) = [line for line in done.stderr.splitlines() if "note" not in line]
    assert fault.startswith(f"trackfg: {logs / 'broken.csv'}: ")
    assert fault.count("broken.csv") == 1
    assert "no column" in fault
    assert sorted(path.name for path in out.iterdir()) == ["monday", "tuesday"]
    assert "imported: 2 of 3, there already 0, failed 1" in done.stdout
    assert read_recording(out / "tuesday").imu["wz_radps"].equals(pd.read_csv(days[2])["wz_radps"])
    assert read_recording(out / "tuesday").description.id == "tuesday"

    next_day = trackfg("import", days[0], logs / "wednesday.csv", "-o", out, "--mapping", mapping)
    assert next_day.returncode == 0, next_day.stderr
    assert f"in {out} already, and left as they are: monday.csv" in next_day.stderr
    assert "imported: 1 of 2, there already 1, failed 0" in next_day.stdout
    assert (out / "wednesday" / "recording.toml").exists()


@pytest.mark.parametrize(
    ("sources", "out", "mapping", "message"),
    [
        (("a.csv", "b.csv"), "all", None, "several sources are imported by one mapping"),
        (("a.csv", "x/a.csv"), "all", "m.toml", "both would become"),
        (("a.csv", "b.csv"), "taken", "m.toml", "is a trackfg recording; expected a folder for the recordings"),
        (("a.csv", "b.csv"), "m.toml", "m.toml", "m.toml: is a file; expected a folder for the recordings"),
    ],
)
def test_sources_that_cannot_go_together_are_refused_before_any_is_read(
    sources, out, mapping, message, answered, tmp_path
):
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "recording.toml").write_text("")
    (tmp_path / "m.toml").write_text('format = "trackfg-mapping/1"\n[imu]\nfile = "a.csv"\n')
    by = [] if mapping is None else ["--mapping", tmp_path / mapping]
    done = answered("import", *(tmp_path / name for name in sources), "-o", tmp_path / out, *by, answers="")
    assert done.returncode == 2
    assert message in done.stderr
    assert not (tmp_path / "all").exists()


def _mapping_of(mapping, name, folder):
    other = folder / "other.toml"
    other.write_text(mapping.read_text().replace("run of Monday.csv", name))
    return other


def test_init_keeps_the_answers_where_the_log_is_not_usable(trackfg, answered, tmp_path):
    source, _ = vendor_log(tmp_path)
    log = source / "log.csv"
    rows = [row.split(b";") for row in log.read_bytes().splitlines()]
    for i, row in enumerate(rows[4:]):
        row[1] = row[1] if i % 3 == 0 else b""
    log.write_bytes(b"\r\n".join(b";".join(row) for row in rows) + b"\r\n")
    mapping = tmp_path / "run.mapping.toml"

    done = answered("init", source, "-o", tmp_path / "run", answers="90\n0.92\nUTC\n\n\n")

    assert done.returncode == 2
    assert "column 'GyrX'" in done.stderr
    assert f"the answers are in {mapping}: correct it and state imu.axes, then run: trackfg import" in done.stderr
    assert not (tmp_path / "run").exists()
    assert tomllib.loads(mapping.read_text())["tach"]["pulses_per_rev"] == 90
    again = trackfg("import", source, "-o", tmp_path / "run", "--mapping", mapping)
    assert again.returncode == 2
    assert "column 'GyrX'" in again.stderr


def test_what_has_no_default_is_not_said_to_be_assumed(trackfg, tmp_path):
    source, _ = vendor_log(tmp_path)

    done = trackfg("import", source, "-o", tmp_path / "run")

    assert done.returncode == 2
    assert "tach.pulses_per_rev: the source does not say it" in done.stderr
    assert "(tach.pulses_per_rev)" not in done.stderr


def test_a_recording_is_not_imported_as_if_its_truth_were_measured(tmp_path):
    simulate("mainline", duration_s=20.0).write(tmp_path / "run")

    with pytest.raises(BadInputError, match=r"is a trackfg recording; .* Hint: trackfg check and smooth take it"):
        source_format(tmp_path / "run")
    assert source_format(tmp_path / "run", "text").key == "text"


def test_a_result_is_no_source_but_a_folder_with_a_summary_of_another_system_is(tmp_path):
    smooth(simulate("mainline", duration_s=20.0).recording).write(tmp_path / "out")

    with pytest.raises(BadInputError, match="is a trackfg result; expected a recording of another system"):
        source_format(tmp_path / "out")
    (tmp_path / "log").mkdir()
    (tmp_path / "log" / "summary.json").write_text("{}")
    (tmp_path / "log" / "imu.csv").write_text("t,gx\n")
    assert source_format(tmp_path / "log").key == "text"


@pytest.mark.parametrize(
    ("answer", "within", "number"),
    [
        ("1,435", (0.3, 4.0), 1.435),  # bounds say which comma it is
        ("0,92", (0.0, 2.0), 0.92),
        ("1,024", (0.0, np.inf), None),  # pulses per turn: a thousand, or one
        ("90,0", (0.0, np.inf), 90.0),
        ("1,234.5", (0.0, np.inf), 1234.5),
        ("-3", (0.0, np.inf), None),
        ("ninety", (0.0, np.inf), None),
    ],
)
def test_a_number_may_have_a_decimal_comma(answer, within, number):
    assert number_in(answer, within) == number


@pytest.mark.parametrize(
    ("answer", "choice"),
    [("y", "yes"), ("Oui", "yes"), ("sí", "yes"), ("ne", "no"), ("Nein", "no"), ("maybe", None), ("", None)],
)
def test_yes_and_no_may_be_said_in_other_languages(answer, choice):
    assert choice_in(answer, ("yes", "no")) == choice


def test_init_says_what_it_recognised_and_takes_the_place_where_the_run_begins(answered, tmp_path):
    recording = simulate("trolley", seed=1, duration_s=80.0).recording
    imu = recording.imu.iloc[::4]
    table = pd.DataFrame({"Time (s)": imu["t_s"].round(3)})
    for i, axis in enumerate("XYZ"):
        table[f"Gyro {axis} (deg/s)"] = np.degrees(imu.iloc[:, 1 + i]).round(4)
        table[f"Acc {axis} (m/s2)"] = imu.iloc[:, 4 + i].round(4)
    table["Distance (m)"] = np.interp(imu["t_s"], recording.tach["t_s"], recording.tach["distance_m"]).round(3)
    source = tmp_path / "trolley.csv"
    table.to_csv(source, index=False)

    done = answered("init", source, "-o", tmp_path / "run", answers="maybe\ny\n1435\n\nnowhere\n12+300\nn\n")

    assert done.returncode == 0, done.stderr
    said = " ".join(done.stdout.split())
    assert "expected yes or no" in said  # a choice may be begun, not guessed
    assert "1435 is not understood; expected a number such as 1.435, from 0.3 to 4" in said
    assert "nowhere is not understood; expected a place such as 12+345" in said
    assert "Recognised in trolley.csv" in said
    toml = tomllib.loads((tmp_path / "run" / "recording.toml").read_text())
    assert toml["imu"]["rigid"] is True
    assert toml["kilometrage"] == {"direction": "descending", "equation": [{"chainage_m": 0.0, "km": "12+300"}]}
    unanswered = answered("init", source, "-o", tmp_path / "other", answers="Ja\n1,067\n")
    assert unanswered.returncode == 0, unanswered.stderr  # where it begins need not be known
    toml = tomllib.loads((tmp_path / "other" / "recording.toml").read_text())
    assert toml["imu"]["rigid"] is True
    assert toml["track"]["gauge_m"] == pytest.approx(1.067)
    assert "kilometrage" not in toml
    ended = answered("init", source, "-o", tmp_path / "third", answers="yes\n")
    assert ended.returncode == 2
    assert "track.gauge_m: no answer to: Track gauge, m. Hint: take the defaults by --yes" in ended.stderr
    table.rename(columns={"Distance (m)": "Pulses"}).to_csv(source, index=False)
    ended = answered("init", source, "-o", tmp_path / "fourth", answers="")
    assert "Pulses. Hint: state it in a mapping, for trackfg import (docs/importing.md)" in ended.stderr  # no default


def test_a_recording_is_never_overwritten_and_nothing_is_left_of_a_failed_import(trackfg, tmp_path):
    source, _ = vendor_log(tmp_path)
    out = tmp_path / "run"
    out.mkdir()
    (out / "mine.txt").write_text("keep")

    done = trackfg("import", source, "-o", out)

    assert done.returncode == 2
    assert done.stderr.count("\n") == 1 or "note" in done.stderr
    assert [file.name for file in out.iterdir()] == ["mine.txt"]
    assert trackfg("import", tmp_path / "nothing", "-o", tmp_path / "x").returncode == 2
    assert not (tmp_path / "x").exists()


def _tables(folder: Path, **files: str):
    for name, text in files.items():
        (folder / f"{name}.csv").write_text(text)
    return source_format(folder).tables(folder, lambda _: None)


def _imu_text(rows: int = 50, rate: float = 100.0, columns: str = "gx,gy,gz,ax,ay,az") -> str:
    lines = [f"t,{columns}"]
    lines += [f"{i / rate:.4f},0.01,0.02,{0.001 * i:.4f},0.1,0.2,9.8" for i in range(rows)]
    return "\n".join(lines) + "\n"


IMU = {"time": "t", "gyro": ["gx", "gy", "gz"], "accel": ["ax", "ay", "az"]}


def _mapping(**sections: object):
    return mapping_of({"format": "trackfg-mapping/1", **sections}, "m.toml")


def test_two_tables_of_one_imu_meet_at_the_times_of_the_faster_one(tmp_path):
    gyro = "t,x,y,z\n" + "".join(f"{i * 0.01:.2f},{0.1 * i:.2f},0,0\n" for i in range(200))
    accel = "t,x,y,z\n" + "".join(f"{0.005 + i * 0.02:.3f},{1.0 * i:.1f},0,9.8\n" for i in range(100))
    source = tmp_path / "s"
    source.mkdir()
    tables = _tables(source, gyro=gyro, accel=accel)
    axes = {"gyro": ["x", "y", "z"], "accel": ["x", "y", "z"]}

    made = write_imported(
        tables, _mapping(imu={"file": ["gyro.csv", "accel.csv"], "time": "t", **axes}), tmp_path / "r", run_id="r"
    )

    imu = made.loaded.recording.imu
    np.testing.assert_allclose(imu["t_s"], np.arange(1, 199) * 0.01, atol=1e-9)  # as long as both go
    np.testing.assert_allclose(imu["wx_radps"], 0.1 * np.arange(1, 199), atol=1e-9)
    np.testing.assert_allclose(imu["fx_mps2"], (imu["t_s"] - 0.005) / 0.02, atol=1e-6)


def test_increments_become_rates_and_foreign_units_known_ones(tmp_path):
    source = tmp_path / "s"
    source.mkdir()
    tables = _tables(source, imu=_imu_text())

    def first(**units: str):
        out = tmp_path / "_".join(units.values()).replace("/", "-")
        made = write_imported(tables, _mapping(imu={"file": "imu.csv", **IMU, **units}), out, run_id="r")
        return made.loaded.recording.imu.iloc[0]

    assert first(gyro_unit="rad", accel_unit="m/s")["wx_radps"] == pytest.approx(1.0)
    assert first(gyro_unit="deg/h", accel_unit="mg")["wx_radps"] == pytest.approx(0.01 * np.pi / 180 / 3600)
    assert first(gyro_unit="mrad/s", accel_unit="gal")["fz_mps2"] == pytest.approx(0.098)


def test_one_wide_table_serves_sensors_of_different_rates(tmp_path):
    lines = ["t,gx,gy,gz,ax,ay,az,v,km"]
    for i in range(100):
        speed, km = (f"{0.1 * i:.2f}" if i % 10 == 0 else ""), ("1.5" if i == 50 else "")
        lines.append(f"{i * 0.01:.2f},0,0,0,0,0,9.8,{speed},{km}")
    source = tmp_path / "s"
    source.mkdir()
    tables = _tables(source, all="\n".join(lines) + "\n")
    own = {"file": "all.csv", "time": "t"}

    made = write_imported(
        tables,
        _mapping(
            imu={"file": "all.csv", **IMU},
            tach={**own, "column": "v", "kind": "speed", "unit": "m/s"},
            fixes={**own, "chainage": "km", "chainage_unit": "km", "sd": 2},
        ),
        tmp_path / "r",
        run_id="r",
    )

    assert made.rows == {"imu.parquet": 100, "tach.parquet": 10, "fixes.parquet": 1}
    assert made.loaded.recording.fixes.iloc[0].tolist() == [0.5, 1500.0, 2.0]


TACH = {"file": "imu.csv", "time": "t", "column": "gx", "unit": "m/s"}


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        ({}, "no section"),
        ({"imu": {"file": "imu.csv", **IMU}, "odometer": {}}, "unknown key 'odometer'"),
        ({"imu": {"file": "imu.csv", **IMU, "gyro": ["gx", "gy", "nope"]}}, "no column 'nope'"),
        ({"imu": {"file": "other.csv", **IMU}, "tach": TACH}, "no such table; expected one of imu.csv"),
        ({"imu": {"file": "*.csv", **IMU, "gyro": ["gx", "gy"]}}, "gyro"),
        ({"imu": {"file": "imu.csv", **IMU, "time_unit": "fortnights"}}, "time_unit"),
        ({"imu": {"file": "imu.csv", **IMU}, "tach": {"file": "imu.csv", "time": "t"}}, "no key 'column'"),
        ({"imu": {"file": "imu.csv", **IMU, "axes": "XYZ"}}, "axes"),
        ({"imu": {"file": "imu.csv", **IMU, "time": "gx"}}, "m.toml"),
        ({"imu": 5}, "expected a table"),
        ({"imu": {"file": "imu.csv", **IMU}, "start": "yesterday"}, "start"),
        ({"imu": {"file": "", **IMU}}, "'': no such table"),
        ({"imu": {"file": "imu.csv", **IMU, "gyro_unit": {"x": "rad/s"}}}, "gyro_unit"),
        ({"imu": {"file": "imu.csv", **IMU}, "tach": {"file": "imu.csv", "time": "t", "column": []}}, "are empty"),
    ],
)
def test_a_mapping_that_does_not_fit_is_refused_by_name(tmp_path, sections, message):
    source = tmp_path / "s"
    source.mkdir()
    tables = _tables(source, imu=_imu_text())

    with pytest.raises(BadInputError, match=message):
        write_imported(tables, _mapping(**sections), tmp_path / "r", run_id="r")
    assert not (tmp_path / "r").exists()


def test_dates_and_clocks_from_zero_need_a_start(tmp_path):
    source = tmp_path / "s"
    source.mkdir()
    posts = "when,km\n2026-05-01T03:12:00.2Z,1+000\n"
    tables = _tables(source, imu=_imu_text(), posts=posts)
    sections = {
        "imu": {"file": "imu.csv", **IMU},
        "fixes": {"file": "posts.csv", "time": "when", "chainage": "km", "sd": 1.0},
    }

    with pytest.raises(BadInputError, match="state start"):
        write_imported(tables, _mapping(**sections), tmp_path / "r", run_id="r")
    start = pd.Timestamp("2026-05-01T03:12:00Z").to_pydatetime()
    made = write_imported(tables, _mapping(start=start, **sections), tmp_path / "r", run_id="r")
    assert made.loaded.recording.fixes["t_s"].iloc[0] == pytest.approx(0.2)


def _posts(folder: Path, *cells: str):
    folder.mkdir()
    rows = "".join(f"{0.1 * (i + 1):.1f},{cell}\n" for i, cell in enumerate(cells))
    return _tables(folder, imu=_imu_text(), posts="t,place\n" + rows)


_REBUILT = {
    "line": "4201",
    "track": "2",
    "equation": [{"chainage_m": 12_000.0, "km": "12+000"}, {"chainage_m": 12_500.0, "km": "12+400"}],
}
"""Kilometrage falls back by 100 m at chainage 12500 m."""
_POSTS = {"file": "posts.csv", "time": "t", "chainage": "place", "sd": 1.0}


def test_official_places_become_chainages_by_the_mapping_s_kilometrage_which_the_recording_gets(tmp_path):
    tables = _posts(tmp_path / "s", "12+350", "12+450 (2)", "km 12.600", "12700")
    mapping = _mapping(imu={"file": "imu.csv", **IMU}, fixes=_POSTS, kilometrage=_REBUILT)

    recording = write_imported(tables, mapping, tmp_path / "r", run_id="r").loaded.recording

    np.testing.assert_allclose(recording.fixes["chainage_m"], [12_350.0, 12_550.0, 12_700.0, 12_700.0])
    official = recording.description.kilometrage
    assert (official.line, official.track) == ("4201", "2")
    written = official.kilometrage().written(recording.fixes["chainage_m"].to_numpy())
    assert written[:2] == ["12+350.00", "12+450.00 (2)"]


def test_numbers_of_kilometres_are_official_places_on_a_descending_line(tmp_path):
    tables = _posts(tmp_path / "s", "84.9", "84.6")
    descending = {"direction": "descending", "equation": [{"chainage_m": 0.0, "km": "85+000"}]}
    mapping = _mapping(imu={"file": "imu.csv", **IMU}, fixes={**_POSTS, "chainage_unit": "km"}, kilometrage=descending)

    recording = write_imported(tables, mapping, tmp_path / "r", run_id="r").loaded.recording

    np.testing.assert_allclose(recording.fixes["chainage_m"], [100.0, 400.0], atol=1e-6)


@pytest.mark.parametrize(
    ("cell", "kilometrage", "message"),
    [
        ("12+450", _REBUILT, r"posts.csv: column 'place', row 2: '12\+450' is there 2 times.*12\+450.00 \(1\) or"),
        ("bridge", _REBUILT, "posts.csv: column 'place', row 2: 'bridge' is no place"),
        ("12+450", {"equations": []}, "m.toml: key equations: unknown key"),
        ("12+450", {"equation": [{"chainage_m": 0.0, "km": "far"}]}, "m.toml: key equation.*expected a place"),
    ],
)
def test_a_place_that_the_kilometrage_does_not_have_is_refused_with_its_row(tmp_path, cell, kilometrage, message):
    tables = _posts(tmp_path / "s", cell)

    with pytest.raises(BadInputError, match=message):
        write_imported(
            tables,
            _mapping(imu={"file": "imu.csv", **IMU}, fixes=_POSTS, kilometrage=kilometrage),
            tmp_path / "r",
            run_id="r",
        )


def test_a_mapping_file_that_is_none_is_refused(tmp_path):
    path = tmp_path / "m.toml"
    for text, message in (("x = [", "not valid TOML"), (tomli_w.dumps({"format": "other/1"}), "trackfg-mapping/1")):
        path.write_text(text)
        with pytest.raises(BadInputError, match=message):
            read_mapping(path)
    with pytest.raises(BadInputError, match="cannot be read"):
        read_mapping(tmp_path / "none.toml")


def test_a_format_is_found_by_name_or_refused_with_the_nearest():
    with pytest.raises(BadInputError, match="did you mean 'ros'"):
        source_format(Path("."), "rso")
    assert set(source_formats()) >= {"text", "ros", "mdf", "tdms", "rcm-dx", "hdf5", "gnss", "phyphox", "sensor-logger"}


def test_a_row_for_each_value_becomes_a_column_for_each_signal(tmp_path):
    rows = ["Timestamp,Message,Signal,Value,Unit"]
    for i in range(40):
        for signal, value, unit in (("GyroX", 0.5 * i, "deg/s"), ("AccX", 9.8, "m/s^2")):
            rows.append(f"{1773480413 + 0.01 * i:.3f},IMU,{signal},{value},{unit}")
        if i % 2 == 0:
            rows.append(f"{1773480413 + 0.01 * i + 0.002:.3f},TCU,Pulses,{(65530 + i) % 65536},-")
    (source := tmp_path / "s").mkdir()

    imu, pulses = _tables(source, trace="\n".join(rows) + "\n")

    assert (imu.name, imu.columns, imu.units["GyroX"]) == (
        "trace.csv/GyroX",
        ["Timestamp", "GyroX", "AccX"],
        "deg/s",
    )
    assert pulses.columns == ["Timestamp", "Pulses"]
    np.testing.assert_array_equal(imu.frame["GyroX"], 0.5 * np.arange(40))
    assert len(pulses.frame) == 20


def test_a_counter_of_pulses_that_starts_again_goes_on(tmp_path):
    rows = "".join(f"{0.1 * i:.1f},{(65_000 + 100 * i) % 65_536}\n" for i in range(12))
    (source := tmp_path / "s").mkdir()
    tables = _tables(source, imu=_imu_text(200), wheel="t,count\n" + rows)
    wheel = {"file": "wheel.csv", "time": "t", "column": "count", "kind": "pulses"}

    made = write_imported(
        tables,
        _mapping(imu={"file": "imu.csv", **IMU}, tach={**wheel, "pulses_per_rev": 100.0, "wheel_diameter_m": 0.9}),
        tmp_path / "r",
        run_id="r",
    )

    rolled = made.loaded.recording.tach["distance_m"].to_numpy()
    np.testing.assert_allclose(np.diff(rolled), np.pi * 0.9)


def test_a_date_in_parts_is_one_time(tmp_path):
    names = "PacketCounter,UTC_Year,UTC_Month,UTC_Day,UTC_Hour,UTC_Minute,UTC_Second,UTC_Nano,Acc_X"
    rows = [f"{i},2026,3,14,23,59,{59 if i < 50 else 0},{(500 + 10 * i) % 1000 * 1_000_000},1" for i in range(50)]
    (source := tmp_path / "s").mkdir()

    (table,) = _tables(source, log="\n".join([names, *rows]) + "\n")

    (column,) = time_columns(table)
    ns = table.numbers(column)
    assert pd.Timestamp(int(ns[0])) == pd.Timestamp("2026-03-14T23:59:59.5")
    assert meaning("PacketCounter") is None


def test_sparse_events_count_like_the_inertial_sensor_beside_them(tmp_path):
    (source := tmp_path / "s").mkdir()
    tables = _tables(source, imu=_imu_text(30_000), posts="t,km\n40.8,84+400\n68.9,84+900\n200.0,86+900\n")

    proposal = propose(tables, lambda question: question.default)

    assert proposal.sections["fixes"]["time_unit"] == "s"


def test_a_channel_without_any_value_is_named(tmp_path):
    (source := tmp_path / "s").mkdir()
    text = _imu_text(columns="Gyro X,Gyro Y,Gyro Z,Acc X,Acc Y,Acc Z").replace(",0.02,", ",NaN,")

    with pytest.raises(
        BadInputError, match=r"no three columns of the gyro .*\(no value in any row of Gyro Y\); expected"
    ):
        propose(_tables(source, imu=text), lambda question: question.default)


def test_a_header_above_rows_that_are_mostly_text_is_found(tmp_path):
    rows = "".join(f"{i * 0.1:.1f},bogie,front,left,ok,{i}\n" for i in range(60))
    (source := tmp_path / "s").mkdir()

    (table,) = _tables(source, log="time,place,end,side,state,value\n" + rows)

    assert table.columns == ["time", "place", "end", "side", "state", "value"]
    assert len(table.frame) == 60


def test_init_refuses_a_place_where_nothing_can_be_written_before_it_asks(answered, tmp_path):
    source, _ = vendor_log(tmp_path)
    simulate("mainline", duration_s=20.0).write(tmp_path / "run")

    for place, reason in (
        ("run", "exists; recordings are never overwritten"),
        ("log.txt/run", "is a file; expected a"),
    ):
        (tmp_path / "log.txt").touch()
        done = answered("init", source, "-o", tmp_path / place, answers="")
        assert (done.returncode, done.stdout) == (2, "")
        assert reason in done.stderr
    assert not (tmp_path / "run.mapping.toml").exists()


@pytest.mark.parametrize("answer", ["AngularRateX", "angular", "UncompGyroX"])
def test_a_column_is_chosen_by_its_name_or_its_beginning_whatever_its_capitals(answered, tmp_path, answer):
    imu = simulate("trolley", seed=1, duration_s=80.0).recording.imu.iloc[::4]
    table = pd.DataFrame({"t_s": imu["t_s"].round(3)})
    for name, first in (("UncompGyro", 1), ("AngularRate", 1), ("Accel", 4)):
        for i, axis in enumerate("XYZ"):
            table[f"{name}{axis}"] = imu.iloc[:, first + i]
    table.to_csv(tmp_path / "log.csv", index=False)
    answers = f"{answer}\n\n\n\nFLU\nrad/s\n"
    done = answered("init", tmp_path / "log.csv", "-o", tmp_path / "run", answers=answers)
    assert done.returncode == 0, done.stderr
    gyro = tomllib.loads((tmp_path / "run.mapping.toml").read_text())["imu"]["gyro"]
    assert gyro[0] == ("AngularRateX" if answer.startswith(("A", "a")) else "UncompGyroX")
