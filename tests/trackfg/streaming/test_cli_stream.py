"""``trackfg stream`` through its real entry point."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trackfg.datasets.scenarios import simulate
from trackfg.results.columns import GEOMETRY_COLUMNS, TRAJECTORY_COLUMNS
from trackfg.streaming.sinks.parquet_parts import read_parts
from trackfg.streaming.stream_counts import StreamCounts

from .conftest import setting_off

TRACKFG = [sys.executable, "-m", "trackfg", "stream"]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stream") / "run"
    simulate(setting_off("trolley", 20.0), seed=0, duration_s=50.0).write(folder)
    return folder


def test_a_recording_into_parts(recording: Path, trackfg: Callable[..., Any], tmp_path: Path) -> None:
    done = trackfg("stream", recording, "--lag", "5", "-o", tmp_path / "out")
    assert done.returncode == 0
    assert "; 1 standstill" in done.stderr
    filtered, smoothed, geometry = (read_parts(tmp_path / "out", name) for name in ("filtered", "smoothed", "geometry"))
    assert tuple(filtered) == tuple(smoothed) == TRAJECTORY_COLUMNS
    assert tuple(geometry) == ("t_s", *GEOMETRY_COLUMNS)
    assert smoothed["t_s"].iloc[-1] > 48.0
    np.testing.assert_allclose(np.diff(smoothed["t_s"]), 0.1, atol=1e-9)


def test_what_came_of_a_stream_is_json(recording: Path, trackfg: Callable[..., Any], tmp_path: Path) -> None:
    done = trackfg("stream", recording, "--lag", "5", "-o", tmp_path / "out", "--json")
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert said["events"] == {"standstill": 1}
    assert said["rows_in"] >= said["rows_used"] > 0


def json_lines(duration_s: float) -> tuple[str, list[str]]:
    """The description and the rows of a run, these in the order of time."""
    description = {
        "id": "lines",
        "imu": {"gyro": ["wx", "wy", "wz"], "accel": ["fx", "fy", "fz"]},
        "tach": {"column": "s", "kind": "distance", "unit": "m", "signed": True},
    }
    run = simulate("trolley", seed=0, duration_s=duration_s).recording
    keyed = [(row[0], {"table": "tach", "t": row[0], "s": row[1]}) for row in run.tach.to_numpy().tolist()]
    names = ("t", "wx", "wy", "wz", "fx", "fy", "fz")
    keyed += [(row[0], {"table": "imu", **dict(zip(names, row, strict=True))}) for row in run.imu.to_numpy().tolist()]
    return json.dumps({"description": description}), [
        json.dumps(row) for _, row in sorted(keyed, key=lambda one: one[0])
    ]


@pytest.fixture
def stream_of_lines(trackfg: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """Return what runs ``trackfg stream -`` with options, in this process, which reads these lines."""

    def run(lines: list[str], *options: object) -> Any:
        text = io.TextIOWrapper(io.BytesIO("\n".join(lines).encode()))
        monkeypatch.setattr(sys, "stdin", text)
        return trackfg("stream", "-", *options)

    return run


def test_rows_in_random_order_are_dropped_with_a_warning(stream_of_lines: Callable[..., Any]) -> None:
    description, rows = json_lines(12.0)
    rows = np.random.default_rng(1).permutation(rows).tolist()
    done = stream_of_lines([description, *rows], "--lag", "5", "-o", "-")
    assert done.returncode == 0
    assert f" of {len(rows)} rows were dropped" in " ".join(done.stderr.split())


def test_rows_in_wrong_units_end_a_stream_that_begins_in_the_same_folder_once_corrected(
    stream_of_lines: Callable[..., Any], tmp_path: Path
) -> None:
    description, rows = json_lines(13.0)
    options = ["--lag", "5", "-o", tmp_path / "out"]
    wrong = json.loads(description)
    wrong["description"]["imu"]["accel_unit"] = "g"
    refused = stream_of_lines([json.dumps(wrong), *rows], *options)
    assert refused.returncode == 2
    assert 'Hint: the data look like m/s^2: set imu.accel_unit = "m/s^2"' in " ".join(refused.stderr.split())
    assert not list((tmp_path / "out").iterdir())
    assert stream_of_lines([description, *rows], *options).returncode == 0
    assert len(read_parts(tmp_path / "out", "filtered"))


def test_a_table_that_is_late_and_a_stream_without_estimates_are_warnings(
    stream_of_lines: Callable[..., Any],
) -> None:
    description, rows = json_lines(12.0)
    late = sorted(rows, key=lambda row: json.loads(row)["t"] + ('"tach"' in row))
    done = stream_of_lines([description, *late], "-o", "-")
    assert done.returncode == 0
    said = done.stderr.splitlines()[1:]
    count = sum('"tach"' in row for row in rows)
    assert said[0].startswith("trackfg: warning: tach: ")
    assert f" of {count} rows were left out (" in said[0]
    assert said[0].endswith(" late). Hint: a row may come 0.2 s after the IMU's of its time, not later")
    assert said[1].startswith("trackfg: warning: no estimates: ")


def test_losses_name_tables_and_what_could_not_be_read() -> None:
    counts = StreamCounts(rows_in=300, by_table=Counter(imu=100, tach=100, gnss=100))
    counts.left_out = {
        "imu": Counter(duplicate=60),
        "tach": Counter({"late": 50}),
        "gnss": Counter({"bad-sigma": 99, "late": 1}),
        "camera": Counter({"other-topic": 7}),
    }
    assert counts.losses() == [
        "gnss: 100 of 100 rows were left out (99 bad-sigma, 1 late). Hint: the table events says what was expected"
    ]
    counts.unreadable, counts.first_unreadable = 3, "line 2: is no object"
    assert len(counts.losses()) == 1
    counts.unreadable = 4
    assert counts.losses()[0] == "4 of 304 rows could not be read; the first: line 2: is no object"
    counts.broken = "run.mcap: cannot be read beyond message 9 (EndOfFile)"
    assert counts.losses()[0] == counts.broken
    counts.left_out["gnss"] = Counter({"clock-jump": 99})
    assert counts.losses()[-1].endswith(
        "how far their times are from the IMU's: correct its time_offset_s, or its time_unit"
    )


def test_json_lines_in_and_out(recording: Path) -> None:
    description, keyed = json_lines(30.0)
    lines = [description, *keyed]
    done = subprocess.run(
        [*TRACKFG, "-", "--lag", "5", "-o", "-"], input="\n".join(lines), capture_output=True, text=True, check=True
    )
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert {row["table"] for row in rows} >= {"filtered", "smoothed"}
    assert f"{len(keyed)} rows, {len(keyed)} of them used" in done.stderr
    assert "were dropped" not in done.stderr


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere", "-o", "out"], "nowhere"),
        (["-", "--real-time", "-o", "out"], "--real-time -: expected the folder of a recording"),
        (["-", "--map", "line.gpkg", "-o", "out"], "line.gpkg"),
    ],
)
def test_what_is_refused(
    arguments: list[str], said: str, trackfg: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = trackfg("stream", *arguments)
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_folder_with_something_in_it_is_refused(recording: Path, trackfg: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("mine")
    done = trackfg("stream", recording, "-o", tmp_path / "out")
    assert done.returncode == 2
    assert "a stream is never added to another" in done.stderr
