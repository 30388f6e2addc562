"""Sound inputs of every entry, as short as they can be."""

from __future__ import annotations

import json
import os
import shutil
import signal
import time
from dataclasses import replace
from functools import reduce
from pathlib import Path

import numpy as np
import pandas as pd
from interchange import foreign_forms

from faults.entries import ENTRIES
from faults.runner import Conditions, Running, run
from trackfg.datasets.scenarios import Scenario, Simulation, scenario, simulate
from trackfg.datasets.vehicle.driving import Service
from trackfg.io.reader import read_recording
from trackfg.streaming.rows import raw_columns

REST_AT_START_S = 10.0
"""Time that vehicles stand before they start, s: a stream begins after as long."""
DURATION_S = 20.0
"""Length of the recordings, s: a standstill, a start and a piece of curved track."""
RATE_HZ = 50.0
"""Rate of their inertial sensors, Hz: rows are what reading and checking take time for."""
FOREIGN_S = 15.0
"""Length of the logs of other systems, s."""
REST_S, REST_RATE_HZ = 80.0, 20.0
"""Length and rate of a log at rest, s, Hz: `noise` asks for a minute."""
MAPPED_S = 130.0
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
COARSE = """[geometry]
step_m = 0.5
"""
"""Settings of the runs of the map: half the rows of geometry, which reports, charts and maps take time for."""
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
CHANNELS = """[[channel]]
name = "km"
column = "km+m"
[[channel]]
name = "Curvature [10000/m]"
column = "curvature_1pm"
factor = 10000.0
decimals = 3
"""
FIXES = """
[fixes]
file = "fixes.csv"
time = "t"
chainage = "chainage_m"
sd = "sd_m"
"""
BALISES = """
[balises]
file = "balises.csv"
places = "places.csv"
"""


def make_inputs(folder: Path) -> None:
    """Write the sound inputs of every entry, and check that what is made of others ends well."""
    for number in range(3):
        made = simulate(_slow("mainline-gnss"), seed=0, run=number, duration_s=MAPPED_S)
        made.write(folder / f"run{number}")
        _pass_balises(made, folder / f"run{number}")
        _begin_in_month(number + 1, folder / f"run{number}" / "recording.toml")
    _recordings(folder)
    _logs(folder)
    texts = {
        "line.toml": LINE,
        "settings.toml": SETTINGS,
        "coarse.toml": COARSE,
        "limits.toml": LIMITS,
        "log.mapping.toml": MAPPING,
        "channels.toml": CHANNELS,
        "runs.csv": "recording,line,settings,run\nrec,7,settings.toml,a\ngnss,7,,b\n",
        "half.csv": "recording,line,settings,run\ngnss,7,,b\n",
    }
    for name, text in texts.items():
        (folder / name).write_text(text)
    shutil.copy(folder / "run0" / "places.csv", folder / "planned.csv")
    for command in (
        "smooth run0 -o result --config coarse.toml",
        "smooth run1 -o other --config coarse.toml",
        "smooth run2 -o third --config coarse.toml",
        "map build result -o line.gpkg",
        "export result --to landxml -o line.xml",
        "export result --to geojson -o known.geojson",
        "export result --to gpkg -o known.gpkg",
        "export other --to channels -o channels.csv",
        "batch half.csv -o store",
        "compare gnss -o compared",
        "map trends line.gpkg result other third -o grown",
    ):
        run_sound(command, folder)
    shutil.copytree(folder / "store", folder / "half")
    run_sound("batch runs.csv -o store", folder)
    for number in range(3):
        shutil.rmtree(folder / f"run{number}")
    _begin_stream(folder)


def _recordings(folder: Path) -> None:
    """Write short recordings in every form."""
    simulate(_slow("mainline"), seed=2, duration_s=DURATION_S).write(folder / "rec")
    simulate(_slow("measuring-car"), seed=2, duration_s=DURATION_S).write(folder / "car")
    made = simulate(_slow("mainline-gnss"), seed=0, duration_s=DURATION_S)
    made.write(folder / "gnss")
    moving = simulate(_slow("no-stop"), seed=0, duration_s=DURATION_S)
    moving.write(folder / "passed")
    _pass_balises(moving, folder / "passed")
    _place_fixes(made, folder / "gnss")
    _as_csv(folder / "rec", folder / "csv")
    _as_json_lines(folder / "rec", folder / "rows.jsonl")
    if "mcap" in {entry.name for entry in ENTRIES}:
        _as_mcap(folder / "rows.jsonl", folder / "rows.mcap")


def _slow(name: str) -> Scenario:
    """Return a scenario with inertial sensors of few rows, and a start after a short standstill."""
    plan = scenario(name)
    driver = replace(plan.driver, start_rest_s=REST_AT_START_S) if isinstance(plan.driver, Service) else plan.driver
    return replace(plan, driver=driver, imu=replace(plan.imu, rate_hz=RATE_HZ))


def _begin_in_month(month: int, description: Path) -> None:
    """Give a recording, and what is made of it, a date."""
    description.write_text(f"start = 2026-{month:02d}-01T03:12:00Z\n{description.read_text()}")


def _passages(made: Simulation, count: int) -> pd.DataFrame:
    """Return times and true chainages, m, of passages that are evenly spread."""
    truth = made.truth[made.truth["speed_mps"] > 1.0]
    return truth.iloc[np.linspace(0, len(truth) - 1, count + 2).astype(int)[1:-1]][["t_s", "chainage_m"]]


def _pass_balises(made: Simulation, recording: Path) -> None:
    """Give a recording three balises every 150 m, the last without a known place."""
    truth = made.truth
    places = np.arange(1.0, 4.0) * min(150.0, truth["chainage_m"].iloc[-1] / 4.0)
    times = np.interp(places, truth["chainage_m"], truth["t_s"])
    pd.DataFrame({"t": times, "id": ["4711", "4712", "km 1"]}).to_csv(recording / "balises.csv", index=False)
    table = pd.DataFrame({"id": ["4711", "4712", "km 1"], "chainage_m": places, "sd_m": [0.2, 0.2, np.nan]})
    table.loc[2, "chainage_m"] = np.nan
    table.to_csv(recording / "places.csv", index=False)
    with (recording / "recording.toml").open("a") as file:
        file.write(BALISES)


def _place_fixes(made: Simulation, recording: Path) -> None:
    """Give a recording fixes."""
    _passages(made, 3).rename(columns={"t_s": "t"}).assign(sd_m=0.2).to_csv(recording / "fixes.csv", index=False)
    with (recording / "recording.toml").open("a") as file:
        file.write(FIXES)


def _logs(folder: Path) -> None:
    """Write logs of other systems, each by its format's own library."""
    log = pd.read_parquet(folder / "rec" / "imu.parquet")
    tach = pd.read_parquet(folder / "rec" / "tach.parquet")
    nearest = pd.merge_asof(log, tach, on="t_s", direction="backward").dropna()
    nearest.assign(distance_m=0.03 * nearest.pop("count")).to_csv(folder / "log.csv", index=False)
    noise = np.random.default_rng(0).standard_normal((int(REST_S * REST_RATE_HZ), 6)) * [*[1e-4] * 3, *[1e-2] * 3]
    rest = pd.DataFrame(noise + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 9.8]), columns=log.columns[1:7])
    rest.insert(0, "t_s", np.arange(len(rest)) / REST_RATE_HZ)
    rest.assign(temp_degC=25.0 + 0.01 * rest["t_s"]).to_csv(folder / "rest.csv", index=False)
    made = simulate(_slow("mainline-gnss"), seed=0, duration_s=FOREIGN_S).recording
    assert made.tach is not None
    distance = made.tach.set_axis(["t_s", "distance_m"], axis=1)
    drive = foreign_forms.Drive.of(replace(made, tach=distance))
    for entry in ENTRIES:
        name = entry.name.removeprefix("import ")
        if name != entry.name and name in foreign_forms.WRITERS:
            foreign_forms.WRITERS[name](drive, folder)
    axes = {f"gyro_{a}": drive.gyro[:, i] for i, a in enumerate("xyz")}
    axes |= {f"acc_{a}": drive.accel[:, i] for i, a in enumerate("xyz")}
    (folder / "receiver").mkdir()
    pd.DataFrame({"time": drive.ns, **axes}).to_csv(folder / "receiver" / "imu.csv", index=False)
    sentences = ["GNZDA,031200.00,01,05,2026,00,00"]
    for second in range(int(FOREIGN_S)):
        sentences.append(f"GNGST,0312{second:02d}.00,,,,,1.1,1.2,2.0")
        sentences.append(f"GNGGA,0312{second:02d}.00,4654.0000,N,00724.0000,E,1,10,0.9,450.0,M,50.0,M,,")
    (folder / "receiver" / "track.nmea").write_text("".join(map(_sentence, sentences)))


def _sentence(text: str) -> str:
    """Return a sentence of NMEA 0183 with its checksum."""
    return f"${text}*{reduce(lambda checksum, byte: checksum ^ byte, text.encode()):02X}\r\n"


def _begin_stream(folder: Path) -> None:
    """Leave the folder of a stream that was killed after a checkpoint."""
    running = Running("stream rec -o begun --checkpoint-every 5", folder, Conditions())
    checkpoint = folder / "begun" / "checkpoint"
    while not running.has_ended() and not (checkpoint.exists() and b'"until_s": null' not in checkpoint.read_bytes()):
        time.sleep(0.01)
    os.kill(running.process, signal.SIGKILL)
    running.end()


def run_sound(command: str, folder: Path) -> None:
    """Run a command that has to end well."""
    end = run(command, folder, Conditions())
    if end.status not in (0, 3):
        raise SystemExit(f"trackfg {command}: {end.err}")


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
