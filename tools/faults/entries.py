"""The entries: sound inputs of every kind that trackfg reads, and the commands that read them."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from trackfg.datasets.scenarios import scenario, simulate
from trackfg.io.reader import read_recording
from trackfg.streaming.rows import raw_columns

DURATION_S = 40.0
"""Length of the recordings, s: a standstill, a start and a piece of curved track."""
MAPPED_S = 150.0
"""Length of the runs of the map, s: 1.4 km, which a second run is recognised on."""

LINE = """format = "trackfg-line/1"
id = "branch"
heading_deg = 75.0
[[speed_limit]]
chainage_m = 0.0
kmh = 85
[[element]]
type = "straight"
length_m = 300.0
[[element]]
type = "transition"
length_m = 60.0
law = "clothoid"
[[element]]
type = "curve"
length_m = 200.0
radius_m = 400.0
cant_mm = 60.0
[[element]]
type = "transition"
length_m = 60.0
law = "clothoid"
[[element]]
type = "straight"
length_m = 1400.0
"""
SETTINGS = """[keyframes]
interval_s = 1.0
[output]
rate_hz = 10.0
[geometry]
step_m = 0.25
[solver]
max_iterations = 50
"""
LIMITS = """[[limits]]
standard = "a line's own"
parameter = "twist"
level = "alert"
kind = "peak"
value_mm = 4.0
base_m = 5.0
"""
MAPPING = """format = "trackfg-mapping/1"
[imu]
file = "log.csv"
time = "t_s"
gyro = ["wx_radps", "wy_radps", "wz_radps"]
accel = ["fx_mps2", "fy_mps2", "fz_mps2"]
[tach]
file = "log.csv"
time = "t_s"
column = "distance_m"
kind = "distance"
unit = "m"
"""


@dataclass(frozen=True)
class Entry:
    """What is read: ``inputs`` are damaged (paths below the case's folder), ``commands`` read them, the first always.

    ``stdin`` is a file that a command reads as its standard input. ``output`` is the folder or file that is written.
    """

    name: str
    inputs: tuple[str, ...]
    commands: tuple[str, ...]
    stdin: str | None = None
    output: str | None = None


ENTRIES = (
    Entry("recording", ("rec",), ("check rec", "smooth rec -o out", "baseline complementary rec -o out"), output="out"),
    Entry("recording as csv", ("csv",), ("smooth csv -o out", "check csv"), output="out"),
    Entry("stream", ("rec",), ("stream rec -o out",), output="out"),
    Entry("json lines", ("rows.jsonl",), ("stream - -o out",), stdin="rows.jsonl", output="out"),
    Entry("mcap", ("rows.mcap",), ("stream rows.mcap -o out",), output="out"),
    Entry("checkpoint", ("begun",), ("stream rec -o begun --resume",), output="begun"),
    Entry(
        "result",
        ("result",),
        (
            "report result -o page.html",
            "plot result -o chart.png",
            "limits result --limits cfr-213-class-4",
            "map build result -o new.gpkg",
            "export result --to csv -o table.csv",
        ),
    ),
    Entry(
        "map", ("line.gpkg",), ("map show line.gpkg", "map build other -o line.gpkg", "map diff line.gpkg line.gpkg")
    ),
    Entry("map for a run", ("line.gpkg",), ("smooth rec -o out --map line.gpkg",), output="out"),
    Entry("landxml", ("line.xml",), ("simulate trolley --duration 20 --line line.xml -o out",), output="out"),
    Entry("line", ("line.toml",), ("simulate trolley --duration 20 --line line.toml -o out",), output="out"),
    Entry("settings", ("settings.toml",), ("smooth rec -o out --config settings.toml",), output="out"),
    Entry("limits", ("limits.toml",), ("limits result --limits limits.toml",)),
    Entry("import", ("log.csv",), ("import log.csv -o out", "init log.csv -o out --yes"), output="out"),
    Entry("mapping", ("log.mapping.toml",), ("import log.csv -o out --mapping log.mapping.toml",), output="out"),
)


def make_inputs(folder: Path) -> None:
    """Write the sound inputs of every entry, and check that every command ends well on them."""
    simulation = simulate(scenario("mainline"), seed=2, duration_s=DURATION_S)
    simulation.write(folder / "rec")
    for run in (0, 1):
        simulate(scenario("mainline-gnss"), seed=0, run=run, duration_s=MAPPED_S).write(folder / f"run{run}")
    _as_csv(folder / "rec", folder / "csv")
    _as_json_lines(folder / "rec", folder / "rows.jsonl")
    _as_mcap(folder / "rows.jsonl", folder / "rows.mcap")
    log = pd.read_parquet(folder / "rec" / "imu.parquet")
    tach = pd.read_parquet(folder / "rec" / "tach.parquet")
    nearest = pd.merge_asof(log, tach, on="t_s", direction="backward").dropna()
    nearest.assign(distance_m=0.03 * nearest.pop("count")).to_csv(folder / "log.csv", index=False)
    texts = {"line.toml": LINE, "settings.toml": SETTINGS, "limits.toml": LIMITS, "log.mapping.toml": MAPPING}
    for name, text in texts.items():
        (folder / name).write_text(text)
    for command in (
        "smooth run0 -o result",
        "smooth run1 -o other",
        "map build result -o line.gpkg",
        "export result --to landxml -o line.xml",
    ):
        _run(command.split(), folder)
    for run in (0, 1):
        shutil.rmtree(folder / f"run{run}")
    _begin_stream(folder)


def _begin_stream(folder: Path) -> None:
    """Leave the folder of a stream that was killed after a checkpoint."""
    command = [sys.executable, "-m", "trackfg", *["stream", "rec", "-o", "begun", "--checkpoint-every", "5"]]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        checkpoint = folder / "begun" / "checkpoint"
        while process.poll() is None and not (
            checkpoint.exists() and b'"until_s": null' not in checkpoint.read_bytes()
        ):
            time.sleep(0.01)
        process.kill()


def _run(arguments: Sequence[str], folder: Path) -> None:
    done = subprocess.run([sys.executable, "-m", "trackfg", *arguments], cwd=folder, capture_output=True, text=True)
    if done.returncode not in (0, 3):
        raise SystemExit(f"trackfg {' '.join(arguments)}: {done.stderr}")


def _as_csv(recording: Path, to: Path) -> None:
    to.mkdir()
    for name in ("imu", "tach"):
        pd.read_parquet(recording / f"{name}.parquet").to_csv(to / f"{name}.csv", index=False)
    text = (recording / "recording.toml").read_text().replace(".parquet", ".csv")
    (to / "recording.toml").write_text(text.partition("[truth]")[0])


def _as_json_lines(recording: Path, to: Path) -> None:
    read = read_recording(recording)
    part = {"exclude": {"truth"}, "exclude_none": True, "mode": "json"}
    columns = raw_columns(read.description)
    lines = []
    for name in ("imu", "tach"):
        table = pd.read_parquet(recording / f"{name}.parquet")[list(columns[name])]
        lines += [(row[0], {"table": name, **dict(zip(columns[name], row, strict=True))}) for row in table.to_numpy()]
    lines.sort(key=lambda line: line[0])
    description = json.dumps({"description": read.description.model_dump(**part)})
    to.write_text("\n".join([description, *(json.dumps(values) for _, values in lines)]) + "\n")


def _as_mcap(lines: Path, to: Path) -> None:
    from mcap.writer import Writer

    with to.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channels: dict[str, int] = {}
        for number, line in enumerate(lines.read_text().splitlines()):
            values = json.loads(line)
            topic = values.pop("table", "description")
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "json", 0)
            content = values.get("description", values)
            writer.add_message(channels[topic], number, json.dumps(content).encode(), number)
        writer.finish()
