from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

import trackfg
from trackfg.cli import main
from trackfg.cli.options import SECTIONS
from trackfg.config import SmoothConfig
from trackfg.datasets.faults import drop_imu
from trackfg.datasets.scenarios import simulate
from trackfg.io.writer import write_recording
from trackfg.recording.line_kilometrage import KmEquation, LineKilometrage
from trackfg.results.result import Result
from trackfg.results.summary import RunFacts
from trackfg.results.widening import QUANTITY_OF_COLUMN, UNKNOWN_SD

COMMANDS = (
    "demo",
    "scenarios",
    "simulate",
    "check",
    "smooth",
    "batch",
    "stream",
    "estimators",
    "baseline",
    "compare",
    "plot",
    "limits",
    "report",
    "export",
    "import",
    "init",
    "statistics",
    "overlay",
    "balises",
    "noise",
    "config",
    "browse",
)
MODULE = [sys.executable, "-m", "trackfg"]


@dataclass(frozen=True)
class Done:
    status: int
    out: str
    err: str


@pytest.fixture
def run(trackfg: Callable[..., Any]) -> Callable[..., Done]:
    """Return what runs the command line in this process."""

    def run(*arguments: object) -> Done:
        done = trackfg(*arguments)
        return Done(done.returncode, done.stdout, done.stderr)

    return run


Run = Callable[..., Done]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings") / "run"
    simulate("mainline", seed=1, duration_s=60.0).write(folder)
    return folder


def test_version(run: Run) -> None:
    assert run("--version") == Done(0, f"trackfg {trackfg.__version__}\n", "")


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_an_example(run: Run, command: str) -> None:
    done = run(command, "--help")
    assert done.status == 0
    assert f"Example: trackfg {command}" in done.out


def test_help_lists_the_commands_that_work(run: Run) -> None:
    help_ = run("--help").out
    assert all(command in help_ for command in COMMANDS)
    registered = main.app.registered_commands
    assert {one.name or one.callback.__name__ for one in registered if one.callback} == set(COMMANDS)


def test_help_lists_every_command_in_a_section(run: Run) -> None:
    help_ = run("--help").out
    assert "\nTo begin with:\n" in help_
    assert "\nCommands:\n" not in help_
    assert sorted(name for names in SECTIONS.values() for name in names) == sorted([*COMMANDS, "map"])


@pytest.mark.parametrize(
    ("command", "usage", "argument"),
    [("smooth", "[OPTIONS] REC", "  REC  Folder"), ("overlay", "[OPTIONS] RUN...", "  RUN...  "),
     ("compare", "[OPTIONS] [REC...]", "  REC...  ")],
)  # fmt: skip
def test_help_names_arguments_as_they_are_typed(run: Run, command: str, usage: str, argument: str) -> None:
    help_ = run(command, "--help").out
    assert f"Usage: trackfg {command} {usage}\n" in help_
    assert argument in help_
    assert "<path>" not in help_.casefold()


def test_nothing_heavy_is_imported_for_help() -> None:
    program = (
        "import sys; sys.argv = ['trackfg', '--help']; from trackfg.cli.main import main\n"
        "try: main()\n"
        "finally: print(sorted({'numpy', 'pandas', 'gtsam', 'scipy', 'pydantic', 'matplotlib'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize(
    "arguments",
    [("bogus",), ("smooth",), ("smooth", "rec"), ("simulate", "mainline", "-o", "x", "--seed", "one"), ("check",)],
)
def test_wrong_usage(run: Run, arguments: tuple[str, ...]) -> None:
    done = run(*arguments)
    assert done.status == 2
    assert "Usage: trackfg" in done.err


def test_scenarios(run: Run) -> None:
    done = run("scenarios")
    assert done.status == 0
    assert "mainline" in done.out


def test_the_template_of_settings_holds_the_defaults(run: Run, tmp_path: Path) -> None:
    done = run("config")
    assert (done.status, done.err) == (0, "")
    assert run("config", "-o", tmp_path / "c.toml", "-q") == Done(0, "", "")
    assert (tmp_path / "c.toml").read_text(encoding="utf-8") == done.out
    assert SmoothConfig.from_toml(tmp_path / "c.toml") == SmoothConfig()
    lines = done.out.splitlines()
    keys = [i for i, line in enumerate(lines) if " = " in line and not line.startswith("#")]
    assert all(lines[i - 1].startswith("# ") for i in keys)
    assert len(keys) == sum(len(section) for section in SmoothConfig().model_dump().values())
    assert "# Longest time between keyframes in motion [s].\ninterval_s = 1.0" in done.out
    assert run("config", "-o", tmp_path / "c.toml").status == 2


def test_json_of_any_command(run: Run, tmp_path: Path) -> None:
    done = run("simulate", "trolley", "-o", tmp_path / "a", "--duration", 12, "--json")
    assert json.loads(done.out) == {"recording": str(tmp_path / "a")}
    assert json.loads(run("config", "--json").out) == SmoothConfig().model_dump(mode="json")
    (table,) = json.loads(run("scenarios", "--json", "-q").out)["tables"]
    assert {row["name"] for row in table["rows"]} >= {"mainline", "trolley"}
    done = run("stream", tmp_path / "a", "-o", tmp_path / "b", "--lag", 5, "--json", "-q")
    assert json.loads(done.out)["rows_in"] > 1000
    assert done.err == ""
    assert run("scenarios").out.startswith("Scenarios")


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_takes_quiet_and_json(run: Run, command: str) -> None:
    words = run(command, "--help").out.split()
    assert "--quiet" in words
    assert "--json" in words


def test_simulate_is_reproducible(run: Run, tmp_path: Path) -> None:
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        done = run("simulate", "mainline", "-o", tmp_path / "deep" / name, "--seed", seed, "--duration", 20)
        assert done.status == 0, done.err
    a, b, c = ((tmp_path / "deep" / name / "imu.parquet").read_bytes() for name in "abc")
    assert a == b != c


def test_simulate_another_run_on_the_same_track(run: Run, tmp_path: Path) -> None:
    for number in (0, 1):
        done = run("simulate", "mainline", "-o", tmp_path / f"{number}", "--run", number, "--duration", 60)
        assert done.status == 0, done.err
    imu = [(tmp_path / f"{number}" / "imu.parquet").read_bytes() for number in (0, 1)]
    assert imu[0] != imu[1]
    track = [pd.read_parquet(tmp_path / f"{number}" / "truth_geometry.parquet") for number in (0, 1)]
    both = track[0].merge(track[1], on="chainage_m", suffixes=("", "_again"))
    assert len(both) > 100
    assert both["gauge_mm"].equals(both["gauge_mm_again"].rename("gauge_mm"))


@pytest.fixture
def line_file(tmp_path: Path) -> Path:
    path = tmp_path / "branch.toml"
    path.write_text(
        'format = "trackfg-line/1"\nid = "branch"\ngauge_m = 1.435\nstart_chainage_m = 5000\n'
        "speed_limit = [{chainage_m = 5000, kmh = 60}]\n"
        'element = [{type = "straight", length_m = 400}, {type = "curve", radius_m = 800, length_m = 300}]\n',
        encoding="utf-8",
    )
    return path


def test_simulate_on_a_line_from_a_file(run: Run, tmp_path: Path, line_file: Path) -> None:
    done = run("simulate", "mainline", "-o", tmp_path / "out", "--line", line_file, "--duration", 60)
    assert done.status == 0
    assert done.err == (
        f"trackfg: note: {line_file}: the curvature jumps by +0.00125 1/m between elements 1 and 2 "
        "(chainage 5400.000 m)\n"
    )
    assert trackfg.read_recording(tmp_path / "out").description.track.gauge_m == 1.435
    assert pd.read_parquet(tmp_path / "out" / "truth.parquet")["chainage_m"][0] == 5050.0


@pytest.mark.parametrize(
    ("scenario", "name", "expected"),
    [
        ("no-stop", "branch.toml", "the line is 700 m long: expected"),
        ("mainline", "nowhere.toml", "nowhere.toml: cannot be read"),
        ("mainline", "nowhere.xml", "nowhere.xml"),
        ("mainline", "branch.csv", "expected a line description (.toml) or LandXML (.xml)"),
    ],
)
def test_simulate_on_a_line_that_does_not_do(
    run: Run, tmp_path: Path, line_file: Path, scenario: str, name: str, expected: str
) -> None:
    done = run("simulate", scenario, "-o", tmp_path / "out", "--line", line_file.parent / name)
    assert done.status == 2
    assert expected in done.err
    assert "Traceback" not in done.err
    assert not (tmp_path / "out").exists()


def test_simulate_never_overwrites(run: Run, recording: Path) -> None:
    before = (recording / "recording.toml").read_bytes()
    done = run("simulate", "mainline", "-o", recording, "--duration", 20)
    assert done.status == 2
    assert "never overwritten" in done.err
    assert (recording / "recording.toml").read_bytes() == before


def test_simulate_something_unknown(run: Run, tmp_path: Path) -> None:
    done = run("simulate", "monorail", "-o", tmp_path / "out")
    assert done.status == 2
    assert "mainline" in done.err
    assert list(tmp_path.iterdir()) == []


def test_check_a_sound_recording(run: Run, recording: Path) -> None:
    done = run("check", recording)
    assert done.status == 0, done.out
    assert "Estimated from the data" in done.out
    shown = {row[0].strip(): row[1].strip() for line in done.out.splitlines() if len(row := line.split("│")[1:-1]) == 2}
    assert shown["axes"] == "FLU declared, as the data show"
    assert shown["gyro bias at rest"].endswith("deg/h")


def test_check_as_json(run: Run, recording: Path) -> None:
    report = json.loads(run("check", recording, "--json").out)
    assert report.keys() == {"findings", "estimates"}
    assert not [finding for finding in report["findings"] if finding["level"] == "error"]


def test_check_a_broken_recording(run: Run, broken: Path) -> None:
    done = run("check", broken)
    assert done.status == 2
    assert "error" in done.out
    assert "imu.csv" in done.out
    assert done.err == ""
    assert json.loads(run("check", broken, "--json").out)["findings"][0]["level"] == "error"


@pytest.fixture
def broken(tmp_path: Path) -> Path:
    folder = tmp_path / "broken"
    simulate("mainline", seed=1, duration_s=20.0).write(folder, table_format="csv")
    table = pd.read_csv(folder / "imu.csv")
    table.iloc[100, 3] = float("nan")
    table.to_csv(folder / "imu.csv", index=False)
    return folder


def test_smooth(run: Run, recording: Path, tmp_path: Path) -> None:
    done = run("smooth", recording, "-o", tmp_path / "deep" / "out")
    assert done.status == 0, done.err
    assert done.err == ""  # no progress bar in a pipe
    assert "wheel scale" in done.out
    result = Result.read(tmp_path / "deep" / "out")
    assert result.trajectory["t_s"].iloc[-1] == pytest.approx(60.0, abs=0.2)


def test_smooth_passes_on_what_reading_noticed(run: Run, tmp_path: Path) -> None:
    run_with_gap = simulate("mainline", seed=1, duration_s=40.0)
    replace(run_with_gap, recording=drop_imu(run_with_gap.recording, 20.0, 22.0)).write(tmp_path / "gap")
    done = run("smooth", tmp_path / "gap", "-o", tmp_path / "out")
    assert done.status == 0, done.err
    assert "1 warning" in done.out
    assert "no rows for" in done.out
    (found,) = Result.read(tmp_path / "out").summary.findings
    assert (found.level, found.code, found.file) == ("warning", "gap", "imu.parquet")
    assert found.time_s == pytest.approx(22.0, abs=0.02)


def test_smooth_with_settings_and_json(run: Run, recording: Path, tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text("[output]\nrate_hz = 5.0\n")
    done = run("smooth", recording, "-o", tmp_path / "out", "--config", tmp_path / "c.toml", "--json")
    assert done.status == 0, done.err
    assert json.loads(done.out)["configuration"]["output"]["rate_hz"] == 5.0
    assert json.loads(done.out) == json.loads((tmp_path / "out" / "summary.json").read_text())
    assert Result.read(tmp_path / "out").trajectory["t_s"].diff().median() == pytest.approx(0.2)


def test_smooth_bad_input(run: Run, broken: Path, tmp_path: Path) -> None:
    done = run("smooth", broken, "-o", tmp_path / "out")
    assert done.status == 2
    assert done.err.startswith("trackfg: ")
    assert "imu.csv" in done.err
    assert "Traceback" not in done.err
    assert not (tmp_path / "out").exists()


def test_smooth_no_recording(run: Run, tmp_path: Path) -> None:
    done = run("smooth", tmp_path / "nowhere", "-o", tmp_path / "out")
    assert done.status == 2
    assert "nowhere" in done.err


def test_smooth_bad_settings(run: Run, recording: Path, tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text("[output]\nrate_khz = 5.0\n")
    done = run("smooth", recording, "-o", tmp_path / "out", "--config", tmp_path / "c.toml")
    assert done.status == 2
    assert "rate_khz" in done.err


def test_smooth_leaves_other_folders_alone(run: Run, recording: Path) -> None:
    """Found out before the work, not after it."""
    done = run("smooth", recording, "-o", recording)
    assert done.status == 2
    assert "not a trackfg result" in done.err


def test_smooth_unsolvable(run: Run, recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def cannot(*_: object, **__: object) -> Result:
        raise trackfg.UnsolvableError("nothing says where the vehicle is")

    monkeypatch.setattr("trackfg.smoothing.smoother.smooth", cannot)
    done = run("smooth", recording, "-o", tmp_path / "out")
    assert done == Done(1, "", "trackfg: nothing says where the vehicle is\n")


def test_a_folder_that_cannot_be_written(run: Run, recording: Path) -> None:
    done = run("smooth", recording, "-o", "/proc/trackfg/out")
    assert done.status == 1
    assert done.err.startswith("trackfg: ")


def test_a_run_that_did_not_converge_is_not_to_be_trusted(run: Run, recording: Path, tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text("[solver]\nmax_iterations = 2\n")
    settings, out = ("--config", tmp_path / "c.toml"), tmp_path / "out"
    done = run("smooth", recording, "-o", out, *settings)
    assert (done.status, done.err) == (3, "trackfg: warning: not converged: stopped after 2 iterations\n")
    assert "distance not determined" in done.out
    assert "not to be trusted" in done.out
    assert "gross" in done.out
    result = Result.read(out)
    for table in (result.trajectory, result.geometry):
        for column, quantity in QUANTITY_OF_COLUMN.items():
            if f"{column}_sd" in table:
                assert (table[f"{column}_sd"].dropna() >= UNKNOWN_SD[quantity]).all()
    assert len(result.covariance.chainage_m) == 0
    written = json.loads((out / "summary.json").read_text())
    assert {verdict["status"] for verdict in written["verdicts"]} == {"not_trusted"}
    assert written["wheel_scale"]["sd"] is written["gyro_bias_radps"]["sd"] is None
    as_json = run("smooth", recording, "-o", out, *settings, "--json")
    assert as_json.status == 3
    assert json.loads(as_json.out)["verdicts"] == written["verdicts"]
    for command in (("report", out), ("plot", out), ("limits", out, "--limits", "cfr-213-class-4")):
        assert run(*command).status == 0
    refused = run("map", "build", out, "-o", tmp_path / "map.gpkg")
    assert refused.status == 2
    assert "chainage is not to be trusted: the solution is not a minimum" in refused.err


def test_a_distance_that_nothing_measures_is_not_printed(run: Run, tmp_path: Path) -> None:
    alone = simulate("mainline", seed=1, duration_s=40.0).recording
    description = alone.description.model_copy(update={"tach": None, "fixes": None, "gnss": None})
    write_recording(replace(alone, description=description, tach=None, fixes=None, gnss=None), tmp_path / "alone")
    done = run("smooth", tmp_path / "alone", "-o", tmp_path / "out")
    assert done.status == 0, done.err
    assert "distance not determined" in done.out
    result = Result.read(tmp_path / "out")
    assert result.summary.distance_m is None
    assert (result.trajectory["chainage_m_sd"] >= 1e5).all()
    assert (result.trajectory["pitch_rad_sd"] < 0.1).all()


def test_estimators(run: Run) -> None:
    done = run("estimators")
    assert done.status == 0
    assert "adaptive-ekf" in done.out
    assert "JP7628028B2" in done.out


def test_baseline(run: Run, recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = run("baseline", "complementary", recording, "-o", out, "--as-printed")
    assert (done.status, done.err) == (0, "")
    assert pd.read_parquet(out / "geometry.parquet")["cross_level_mm"].notna().any()
    about = json.loads((out / "baseline.json").read_text())
    assert about["parameters"]["as_printed"] is True
    assert run("baseline", "gyro", recording, "-o", out).status == 0  # its own folder may be replaced


def test_baseline_bad_input(run: Run, recording: Path, tmp_path: Path) -> None:
    unknown = run("baseline", "kalman", recording, "-o", tmp_path / "out")
    assert unknown.status == 2
    assert "no estimator 'kalman'; expected one of smoother, dead-reckoning, complementary" in unknown.err
    without = run("baseline", "mid-chord", recording, "-o", tmp_path / "out")
    assert without.status == 2
    assert "lasers" in without.err
    foreign = run("baseline", "gyro", recording, "-o", recording)
    assert foreign.status == 2
    assert "is not a trackfg baseline's result" in foreign.err
    assert not (tmp_path / "out").exists()


def test_compare(run: Run, recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = run("compare", recording, "--scenario", "j-turn", "--seeds", 2, "--jobs", 1, "-o", out)
    assert (done.status, done.err) == (0, "")
    assert "twist, mm" in done.out
    assert "j-turn, friction: 2 runs" in done.out
    assert "Left out" in done.out
    about = json.loads((out / "comparison.json").read_text())
    assert {row["case"] for row in about["rows"]} == {"mainline-seed1-run0", "j-turn"}
    assert len(pd.read_parquet(out / "comparison.parquet")) > 20
    again = run("compare", "--scenario", "j-turn", "--seeds", 1, "--json", "-o", out)
    assert json.loads(again.out)["cases"][0]["seeds"] == [0]


def test_compare_bad_input(run: Run, recording: Path, tmp_path: Path) -> None:
    unknown = run("compare", "--scenario", "mainlin", "-o", tmp_path / "out")
    assert unknown.status == 2
    assert "mainlin" in unknown.err
    foreign = run("compare", recording, "-o", recording)
    assert foreign.status == 2
    assert "is not a trackfg comparison" in foreign.err
    assert not (tmp_path / "out").exists()


def test_report(run: Run, recording: Path, tmp_path: Path) -> None:
    assert run("smooth", recording, "-o", tmp_path / "out").status == 0
    done = run("report", tmp_path / "out", "--recording", recording)
    assert (done.status, done.err) == (0, "")
    assert done.out == f"report: {tmp_path / 'out.html'}\n"
    page = (tmp_path / "out.html").read_text(encoding="utf-8")
    assert "Errors of the geometry" in page
    assert f"--recording {recording}" in page
    other = run("report", tmp_path / "out", "-o", tmp_path / "deep" / "a.html")
    assert other.status == 0
    assert "Errors of the geometry" not in (tmp_path / "deep" / "a.html").read_text(encoding="utf-8")


def test_report_beside_a_recording_without_truth(run: Run, recording: Path, tmp_path: Path) -> None:
    folder = tmp_path / "own"
    shutil.copytree(recording, folder)
    text = (folder / "recording.toml").read_text(encoding="utf-8")
    (folder / "recording.toml").write_text(text.partition("[truth]")[0], encoding="utf-8")
    assert run("smooth", folder, "-o", tmp_path / "out").status == 0
    done = run("report", tmp_path / "out", "--recording", folder)
    assert done.status == 0
    assert done.err == f"trackfg: note: {folder}: has no [truth]: the page shows no errors\n"
    assert (tmp_path / "out.html").is_file()


def test_report_of_a_comparison(run: Run, tmp_path: Path) -> None:
    assert run("compare", "--scenario", "j-turn", "--seeds", 1, "--jobs", 1, "-o", tmp_path / "cmp").status == 0
    done = run("report", tmp_path / "cmp")
    assert (done.status, done.err) == (0, "")
    assert "Where a published system beats the smoother" in (tmp_path / "cmp.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("what", ["recording", "nothing"])
def test_report_of_something_else(run: Run, recording: Path, tmp_path: Path, what: str) -> None:
    done = run("report", recording if what == "recording" else tmp_path / "nothing", "-o", tmp_path / "a.html")
    assert done.status == 2
    assert "expected a folder that trackfg wrote: a result (summary.json) or a comparison" in done.err
    assert ("Hint: trackfg smooth makes a result of a recording" in done.err) == (what == "recording")
    assert len(done.err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_leaves_nothing(recording: Path, tmp_path: Path, forked: Any) -> None:
    """Interrupted as soon as it has begun to write: the hidden workspace is gone and the status is 130."""
    program = (
        "import sys, os, signal, trackfg.results.result as r\n"
        "sys.argv = ['trackfg', 'smooth', sys.argv[1], '-o', sys.argv[2]]\n"
        "r.Summary.model_dump_json = lambda *_, **__: os.kill(os.getpid(), signal.SIGINT)\n"
        "from trackfg.cli.main import main; main()"
    )
    done = forked(program, recording, tmp_path / "out")
    assert done.returncode == 130
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_while_a_compiled_library_is_imported(tmp_path: Path, forked: Any) -> None:
    """Its initialisation fails with an ImportError that was caused by the interrupt."""
    program = (
        "import sys, importlib\n"
        "def interrupted(name):\n"
        "    try: raise KeyboardInterrupt\n"
        "    except KeyboardInterrupt as interrupt: raise ImportError('initialization failed') from interrupt\n"
        "importlib.import_module('trackfg.datasets.scenarios').scenario = interrupted\n"
        "sys.argv = ['trackfg', 'simulate', 'mainline', '-o', sys.argv[1]]\n"
        "from trackfg.cli.main import main; main()"
    )
    done = forked(program, tmp_path / "rec")
    assert (done.returncode, done.stderr.strip()) == (130, "")
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_within_a_finaliser(tmp_path: Path, forked: Any) -> None:
    """Python ignores what a finaliser raises; importing runs many of them."""
    program = (
        "import importlib, sys, time\n"
        "class Lock:\n"
        "    def __del__(self): raise KeyboardInterrupt\n"
        "def interrupted(*arguments):\n"
        "    Lock()\n"
        "    for _ in range(1000): time.sleep(0.01)\n"
        "importlib.import_module('trackfg.datasets.scenarios').scenario = interrupted\n"
        "sys.argv = ['trackfg', 'simulate', 'mainline', '-o', sys.argv[1]]\n"
        "from trackfg.cli.main import main; main()"
    )
    done = forked(program, tmp_path / "rec")
    assert (done.returncode, done.stderr.strip()) == (130, "")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_ctrl_c_at_many_moments(tmp_path: Path) -> None:
    for delay_s in (0.5, 1.0, 1.5, 2.0, 2.5):
        command = [*MODULE, "simulate", "mainline", "-o", tmp_path / "rec"]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
            time.sleep(delay_s)
            process.send_signal(signal.SIGINT)
            process.communicate()
        assert process.returncode in (130, -signal.SIGINT)
        assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def result(make_result: Callable[..., Result], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_result(rows=300).write(tmp_path_factory.mktemp("results") / "run.v2")


def test_plot_beside_the_result(run: Run, result: Path) -> None:
    done = run("plot", result)
    assert (done.status, done.err) == (0, "")
    assert (result.parent / "run.v2.png").read_bytes().startswith(b"\x89PNG")
    assert done.out == f"chart: {result.parent / 'run.v2.png'}\n"
    Result.read(result)


def test_plot_of_a_result_without_geometry_is_that_of_its_trajectory(
    run: Run, make_result: Callable[..., Result], tmp_path: Path
) -> None:
    result = make_result(rows=300)
    folder = replace(result, geometry=result.geometry.iloc[:0]).write(tmp_path / "out")
    done = run("plot", folder)
    assert (done.status, done.err) == (0, "")
    assert done.out == f"chart of the trajectory, since there is no track geometry: {tmp_path / 'out.png'}\n"
    assert (tmp_path / "out.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("suffix", ["svg", "html"])
def test_plot_a_range_twice_the_same(run: Run, result: Path, tmp_path: Path, suffix: str) -> None:
    a, b = tmp_path / f"a.{suffix}", tmp_path / f"b.{suffix}"
    for path in (a, b):
        done = run(
            "plot", result, "--from", 100, "--to", 200.5, "--limits", "cfr-213", "--level", "class 4", "-o", path
        )
        assert done.status == 0, done.err
        assert "not drawn: warp" in done.err
    assert a.read_bytes() == b.read_bytes()
    text = a.read_text(encoding="utf-8")
    if suffix == "html":
        assert "100 to 200.5 m" in text
        assert "class 4 31.75" in text
        assert '"displaylogo": false' in text


def test_plot_a_range_of_official_places(run: Run, result: Path, tmp_path: Path) -> None:
    content = Result.read(result)
    line = LineKilometrage(equation=(KmEquation(chainage_m=0.0, km="12+000"),))
    facts = RunFacts(content_sha256="0" * 64, direction=1, anchored=True, mount_roll_sd_rad=0.0, kilometrage=line)
    placed = replace(content, summary=content.summary.model_copy(update={"run": facts}))
    placed.write(tmp_path / "placed")
    charts = []
    for begin, end in (("12+100", "12+200.5"), ("12+200.5", "12+100"), (100, 200.5)):
        path = tmp_path / f"{len(charts)}.svg"
        assert run("plot", tmp_path / "placed", "--from", begin, "--to", end, "-o", path).status == 0
        charts.append(path.read_bytes())
    assert charts[0] == charts[1] == charts[2]
    done = run("plot", tmp_path / "placed", "--to", "here", "-o", tmp_path / "2.svg")
    assert (done.status, done.out) == (2, "")
    assert "--to: 'here' is no place: expected one such as 12+345" in done.err


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("-o", "chart.pdf"), "expected a file that ends in .png, .svg or .html"),
        (("--from", 300, "--to", 200), "from 300 m to 200 m: expected the smaller chainage first"),
        (("--from", 1e6), "no geometry from 1e+06 m on"),
        (("--from", "12+100"), "--from 12+100: expected a chainage in m"),
        (("--limits", "nowhere.toml"), "nowhere.toml: cannot be read"),
        (("--limits", "cfr-213", "--level", "class 10"), "no limits of level 'class 10'"),
        (("--level", "class 4"), "expected --limits too"),
    ],
)
def test_plot_bad_input(
    run: Run,
    result: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[object, ...],
    expected: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    done = run("plot", result, *(() if "-o" in arguments else ("-o", "chart.png")), *arguments)
    assert (done.status, done.out) == (2, "")
    assert done.err.startswith("trackfg: ")
    assert expected in done.err
    assert done.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def limit_file(tmp_path: Path) -> Path:
    path = tmp_path / "rule.toml"
    path.write_text(
        '[[limits]]\nstandard = "rule"\nlevel = "alert"\nparameter = "level"\nband = "D1"\nkind = "peak"\n'
        "value_mm = 2.9\nspeed_to_kmh = 120\n",
        encoding="utf-8",
    )
    return path


def test_limits(run: Run, result: Path, tmp_path: Path, limit_file: Path) -> None:
    """By the entry point, as a user runs it."""
    command = ["limits", result, "--limits", limit_file, "--line-speed", "100", "-o", tmp_path / "a.csv"]
    done = subprocess.run([*MODULE, *command], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    table = pd.read_csv(tmp_path / "a.csv")
    assert f"Exceedances: {len(table)}" in done.stdout
    assert table["value_mm"].abs().max() == pytest.approx(3.0)
    assert (table["value_mm_sd"] == 0.1).all()
    as_json = run(*command, "--json")
    assert as_json.status == 0
    content = json.loads(as_json.out)
    assert [row["from_m"] for row in content["exceedances"]] == table["from_m"].tolist()
    assert sum(one["exceedances"]["alert"] for one in content["by_km"]) == len(table)
    assert "level, D1" in content["by_km"][0]["worst"]
    assert content["not_judged"] == []


def test_limits_of_the_law(run: Run, result: Path) -> None:
    done = run("limits", result, "--limits", "cfr-213-class-4")
    assert (done.status, done.err) == (0, "")
    assert "No exceedance" in done.out
    assert "Not judged" in done.out
    assert "runoff over 9.45 m" in done.out
    judged, _, where = done.out.partition("Not judged everywhere")
    assert "m chord" not in judged  # a result determines every chord of them
    assert "level, 18.9 m chord" in where  # though not at its ends
    same = run("limits", result, "--limits", "cfr-213", "--level", "class 4")
    assert same.out == done.out


@pytest.mark.parametrize("arguments", [("limits", "--limits", "cfr-213"), ("statistics",), ("export", "--to", "csv")])
def test_what_is_not_to_be_trusted_is_said(
    run: Run, make_result: Callable[..., Result], tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    doubted = {"quantity": "twist", "status": "not_trusted", "factor": None, "reasons": ["seen"], "hints": ["do"]}
    out = make_result(rows=300, verdicts=[doubted]).write(tmp_path / "out")
    done = run(arguments[0], out, *arguments[1:])
    assert done.status == 0
    assert done.err == (
        f"trackfg: warning: {out}: not to be trusted in this run: twist. Hint: trackfg report {out} says why\n"
    )


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("--limits", "nowhere.toml"), "nowhere.toml: cannot be read"),
        (("--limits", "cfr-213-class-10"), "no limits of level 'class 10'"),
        (("--limits", "cfr213"), "no limits 'cfr213': expected a file (.toml), or one of cfr-213, cfr-213-class-1 to"),
        (("--limits", "en-13848-5"), "Hint: `trackfg config --limits en-13848-5 -o limits.toml` writes a template"),
        (("--limits", "cfr-213", "--level", "alert"), "no limits of level 'alert'"),
        (("--limits", "rule.toml"), "give the line's speed"),
    ],
)
def test_limits_bad_input(
    run: Run,
    result: Path,
    tmp_path: Path,
    limit_file: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[object, ...],
    expected: str,
) -> None:
    monkeypatch.chdir(limit_file.parent)
    done = run("limits", result, *arguments, "-o", "a.csv")
    assert (done.status, done.out) == (2, "")
    assert expected in done.err
    assert done.err.count("\n") == 1
    assert not (tmp_path / "a.csv").exists()


def test_limits_never_into_the_result(run: Run, result: Path) -> None:
    done = run("limits", result, "--limits", "cfr-213", "-o", result / "a.csv")
    assert done.status == 2
    assert "holds nothing but its own files" in done.err


def test_report_with_limits(run: Run, result: Path, tmp_path: Path, limit_file: Path) -> None:
    page = tmp_path / "a.html"
    done = run("report", result, "-o", page, "--limits", limit_file, "--line-speed", 100)
    assert (done.status, done.err) == (0, "")
    text = page.read_text(encoding="utf-8")
    assert "Exceedances of limits" in text
    assert f"--limits {limit_file} --line-speed 100" in text
    without = run("report", result, "-o", page, "--level", "alert")
    assert without.status == 2
    assert "expected --limits too" in without.err


def test_plot_never_into_the_result(run: Run, result: Path) -> None:
    before = {path.name for path in result.iterdir()}
    done = run("plot", result, "-o", result / "chart.png")
    assert done.status == 2
    assert "holds nothing but its own files" in done.err
    assert {path.name for path in result.iterdir()} == before


def test_plot_a_result_without_geometry(run: Run, make_result: Callable[..., Result], tmp_path: Path) -> None:
    whole = make_result(rows=50)
    replace(whole, geometry=whole.geometry.iloc[:0]).write(tmp_path / "out")
    done = run("plot", tmp_path / "out", "--limits", "cfr-213")
    assert done.status == 2
    assert "the result has no track geometry; expected it for a strip chart" in done.err
    assert not (tmp_path / "out.png").exists()


def test_plot_no_result(run: Run, tmp_path: Path) -> None:
    done = run("plot", tmp_path / "nowhere")
    assert done.status == 2
    assert "nowhere" in done.err
