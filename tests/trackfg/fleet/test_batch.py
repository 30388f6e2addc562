from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from typer.testing import CliRunner

from trackfg.cli.main import app
from trackfg.config import SmoothConfig
from trackfg.errors import BadInputError
from trackfg.fleet.batch import Limits, run_batch
from trackfg.fleet.catalogue import Run, read_catalogue
from trackfg.fleet.isolated_run import Outcome
from trackfg.fleet.known_content import KnownContent
from trackfg.fleet.places import PlaceError, local_files
from trackfg.fleet.planning import PlannedRun, plan
from trackfg.fleet.store import Store
from trackfg.fleet.store_head import is_store

from .conftest import StandIn

LIMITS = Limits(timeout_s=60.0, memory_bytes=200_000_000, jobs=2)


class Fleet:
    """A catalogue and a store, planned and computed again and again."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.table = folder, folder / "runs.csv"

    def write(self, *rows: str, columns: str = "recording,line,tags,run") -> None:
        self.table.write_text("\n".join((columns, *rows)) + "\n")

    def plan(self) -> list[PlannedRun]:
        store = Store(self.folder / "store")
        return plan(read_catalogue([str(self.table)]), store, KnownContent(store.known_content))

    def why(self) -> dict[str, str]:
        return {each.run.name: each.why for each in self.plan()}

    def run(self, limits: Limits = LIMITS) -> dict[str, Outcome]:
        store = Store(self.folder / "store")
        known = KnownContent(store.known_content)
        planned = plan(read_catalogue([str(self.table)]), store, known)
        return {outcome.name: outcome for outcome in run_batch(planned, store, known, limits)}

    def rows(self) -> pd.DataFrame:
        return pd.read_parquet(self.folder / "store" / "catalogue").set_index("run")


@pytest.fixture
def fleet(tmp_path: Path) -> Fleet:
    return Fleet(tmp_path)


def test_a_batch_computes_what_is_missing_and_lists_it_by_line_and_month(fleet: Fleet, stand_in: StandIn) -> None:
    stand_in.recording("a")
    stand_in.recording("b", start="2026-06-30T23:30:00-02:00")
    fleet.write("recordings/a,7,winter,a", "recordings/b,8 north/west,,b")
    assert fleet.why() == {"a": "no result yet", "b": "no result yet"}
    assert {outcome.reason for outcome in fleet.run().values()} == {None}
    rows = fleet.rows()
    assert rows["status"].to_dict() == {"a": "done", "b": "done"}
    assert rows["line"].astype(str).to_dict() == {"a": "7", "b": "8 north/west"}
    assert rows["month"].astype(str).to_dict() == {"a": "2026-05", "b": "2026-07"}
    assert rows["slips"].to_dict() == {"a": 1, "b": 1}
    assert rows.loc["a", "tags"] == "winter"
    assert (fleet.folder / "store" / rows.loc["a", "result"] / "summary.json").is_file()
    assert fleet.why() == {"a": "", "b": ""}
    assert fleet.run() == {}
    assert sorted(stand_in.calls()) == ["a", "b"]


def test_a_changed_table_of_the_recording_makes_its_result_stale_and_no_other(fleet: Fleet, stand_in: StandIn) -> None:
    for name in ("a", "b"):
        stand_in.recording(name)
    fleet.write("recordings/a,7,,a", "recordings/b,7,,b")
    fleet.run()
    stand_in.recording("b", content="t,wx\n0,2\n")
    assert fleet.why() == {"a": "", "b": "the recording changed"}
    assert list(fleet.run()) == ["b"]
    assert fleet.why() == {"a": "", "b": ""}
    os.utime(fleet.folder / "recordings" / "a" / "imu.csv")
    assert fleet.why() == {"a": "", "b": ""}, "a date is no content"


def test_other_settings_are_named_and_a_comment_is_none(fleet: Fleet, stand_in: StandIn) -> None:
    for name in ("a", "b"):
        stand_in.recording(name)
    settings = fleet.folder / "s.toml"
    settings.write_text("")
    fleet.write("recordings/a,s.toml,a", "recordings/b,,b", columns="recording,settings,run")
    fleet.run()
    settings.write_text("# as it was\n[noise]\nrounds = 3\n")
    assert fleet.why() == {"a": "", "b": ""}
    settings.write_text("[noise]\nrounds = 2\n")
    assert fleet.why() == {"a": "settings: noise.rounds is 2, not 3", "b": ""}
    stand_in.prepare("a", settings=SmoothConfig.from_toml(settings))
    assert list(fleet.run()) == ["a"]
    assert fleet.why() == {"a": "", "b": ""}


def test_another_known_line_makes_the_results_with_it_stale(fleet: Fleet, stand_in: StandIn) -> None:
    for name in ("a", "b"):
        stand_in.recording(name)
    tracks = fleet.folder / "net.geojson"
    tracks.write_text("one")
    stand_in.prepare("a", line_sha256=hashlib.sha256(b"one").hexdigest())
    fleet.write("recordings/a,net.geojson,a", "recordings/b,,b", columns="recording,known_line,run")
    fleet.run()
    assert fleet.why() == {"a": "", "b": ""}
    tracks.write_text("two")
    assert fleet.why() == {"a": "the known line changed", "b": ""}
    fleet.write("recordings/a,,a", "recordings/b,net.geojson,b", columns="recording,known_line,run")
    assert fleet.why() == {"a": "a known line is given no more", "b": "a known line is given now"}
    tracks.unlink()
    with pytest.raises(BadInputError, match=r"net\.geojson: cannot be read"):
        fleet.plan()


def test_another_algorithm_makes_every_result_stale(
    fleet: Fleet, stand_in: StandIn, monkeypatch: pytest.MonkeyPatch
) -> None:
    stand_in.recording("a")
    fleet.write("recordings/a,7,,a")
    fleet.run()
    monkeypatch.setattr("trackfg.fleet.freshness.versions", lambda: {"trackfg": "99.0"})
    assert "not trackfg 99.0" in fleet.why()["a"]


def test_a_result_that_lost_a_file_is_computed_again(fleet: Fleet, stand_in: StandIn) -> None:
    stand_in.recording("a")
    fleet.write("recordings/a,7,,a")
    fleet.run()
    (fleet.folder / "store/results/a/events.csv").unlink()
    assert fleet.why()["a"] != ""
    fleet.run()
    assert fleet.why()["a"] == ""


@pytest.mark.skipif(os.name != "posix", reason="pipes with names are made")
def test_a_pipe_in_the_place_of_a_file_is_not_waited_for(fleet: Fleet, stand_in: StandIn) -> None:
    stand_in.recording("a")
    fleet.write("recordings/a,7,,a")
    fleet.run()
    path = fleet.folder / "store/results/a/geometry.parquet"
    path.unlink()
    os.mkfifo(path)
    with (
        pytest.raises(PlaceError, match=r"geometry\.parquet: no such file that can be read"),
        local_files(str(path.parent), [path.name]),
    ):
        pass
    assert fleet.why() == {"a": "no result yet"}
    fleet.run()
    assert fleet.why() == {"a": ""}


def test_a_summary_of_absurd_depth_is_none(fleet: Fleet, stand_in: StandIn) -> None:
    stand_in.recording("a")
    fleet.write("recordings/a,7,,a")
    fleet.run()
    (fleet.folder / "store/results/a/summary.json").write_text("[" * 200_000)
    assert fleet.why() == {"a": "no result yet"}
    (fleet.folder / "store" / "store.json").write_text("[" * 200_000)
    assert not is_store(str(fleet.folder / "store"))


def test_what_a_killed_batch_did_not_list_is_listed_by_the_next(fleet: Fleet, stand_in: StandIn) -> None:
    stand_in.recording("a")
    stand_in.recording("b")
    fleet.write("recordings/a,7,,a", "recordings/b,7,,b")
    fleet.run()
    before = fleet.rows()
    (catalogue,) = (fleet.folder / "store" / "catalogue").rglob("*.parquet")
    catalogue.unlink()
    assert fleet.run() == {}
    pd.testing.assert_frame_equal(fleet.rows(), before)


def test_a_run_on_another_line_moves_in_the_catalogue(fleet: Fleet, stand_in: StandIn) -> None:
    stand_in.recording("a")
    fleet.write("recordings/a,7,,a")
    fleet.run()
    fleet.write("recordings/a,8,summer,a")
    assert fleet.run() == {}
    rows = fleet.rows()
    assert list(rows.index) == ["a"]
    assert (str(rows.loc["a", "line"]), rows.loc["a", "tags"]) == ("8", "summer")


def test_runs_that_lose_their_line_are_named(fleet: Fleet, stand_in: StandIn) -> None:
    recordings = [str(stand_in.recording(name)) for name in ("a", "b")]
    store = str(fleet.folder / "store")
    first = CliRunner().invoke(app, ["batch", *recordings, "-o", store, "--line", "7"])
    again = CliRunner().invoke(app, ["batch", *recordings, "-o", store])
    assert (first.exit_code, first.stderr.count("warning"), again.exit_code) == (0, 0, 0)
    assert "2 runs of line 7 in the store: now of line unknown, since none is named. Hint: --line 7" in again.stderr
    assert CliRunner().invoke(app, ["batch", *recordings, "-o", store]).stderr.count("warning") == 0


def test_copies_of_a_recording_are_named_when_they_are_computed(fleet: Fleet, stand_in: StandIn) -> None:
    stand_in.recording("a")
    for name in ("recordings", "prepared"):
        shutil.copytree(fleet.folder / name / "a", fleet.folder / name / "b")
    fleet.write("recordings/a,7,,a")
    arguments = ["batch", str(fleet.table), "-o", str(fleet.folder / "store")]
    said = [CliRunner().invoke(app, arguments).stderr]
    fleet.write("recordings/a,7,,a", "recordings/b,7,,b")
    said += [CliRunner().invoke(app, arguments).stderr for _ in range(2)]
    assert [text.count("trackfg: note: run a has the same files as b") for text in said] == [0, 1, 0]


def test_runs_at_fault_become_rows_and_the_others_are_done(fleet: Fleet, stand_in: StandIn) -> None:
    names = ("a", "segfault-1", "hang-1", "hog-1", "killed-1", "broken-1", "b")
    for name in names:
        stand_in.recording(name)
    fleet.write(*(f"recordings/{name},7,,{name}" for name in names))
    outcomes = fleet.run(Limits(timeout_s=3.0, memory_bytes=200_000_000, jobs=4))
    rows = fleet.rows()
    assert rows.index[rows["status"] == "done"].tolist() == ["a", "b"]
    assert outcomes["segfault-1"].reason == "crashed with SIGSEGV"
    assert "Fatal Python error" in rows.loc["segfault-1", "log"]
    assert outcomes["hang-1"].reason == "not done after 3 s (--timeout)"
    assert "more than 0.2 GB (--memory)" in str(outcomes["hog-1"].reason)
    assert outcomes["killed-1"].reason == "killed from outside by SIGKILL, 3 times"
    assert outcomes["broken-1"].reason == "imu.csv: column 't', row 5: not a number"
    assert rows.loc["broken-1", "log"].startswith("smoothing broken-1")
    assert str(rows.loc["broken-1", "month"]) == "2026-05"
    assert stand_in.calls().count("killed-1") == 3
    assert stand_in.calls().count("segfault-1") == 1
    assert sorted(path.name for path in (fleet.folder / "store/results").iterdir()) == ["a", "b"]
    assert fleet.why()["broken-1"] == "failed before: imu.csv: column 't', row 5: not a number"


def test_recordings_that_are_not_there_take_no_process(fleet: Fleet, stand_in: StandIn) -> None:
    fleet.write(*(f"recordings/absent-{row},7,,{row}" for row in range(50)))
    outcomes = fleet.run()
    assert stand_in.calls() == []
    assert len(outcomes) == len(fleet.rows()) == 50
    assert all(
        "no such folder; expected a folder with recording.toml" in str(each.reason) for each in outcomes.values()
    )


def test_the_command_names_a_hundred_failures_and_counts_them_all(fleet: Fleet) -> None:
    fleet.write(*(f"recordings/absent-{row},7,,{row}" for row in range(120)))
    arguments = ["batch", str(fleet.table), "-o", str(fleet.folder / "store")]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 1
    assert "computed 0, failed 120" in done.stdout
    assert done.stderr.count("trackfg: warning: run ") == 100
    assert done.stderr.count("trackfg: warning: further runs that fail are in the store's catalogue") == 1
    assert CliRunner().invoke(app, [*arguments, "--json"]).stdout.count('"status": "failed"') == 120


def test_lines_of_json_have_the_fresh_runs_too(fleet: Fleet, stand_in: StandIn) -> None:
    stand_in.recording("a")
    fleet.write("recordings/a,7,,a", "recordings/absent,7,,b")
    fleet.run()

    done = CliRunner().invoke(app, ["batch", str(fleet.table), "-o", str(fleet.folder / "store"), "--json"])

    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert [(row["run"], row["status"]) for row in rows] == [("a", "fresh"), ("b", "failed")]


def test_a_stale_result_stays_where_computing_it_again_fails(fleet: Fleet, stand_in: StandIn) -> None:
    stand_in.recording("a")
    fleet.write("recordings/a,7,,a")
    fleet.run()
    stand_in.recording("a", content="t,wx\n0,2\n")
    outcomes = fleet.run(Limits(timeout_s=0.0, memory_bytes=200_000_000))
    assert outcomes["a"].reason == "not done after 0 s (--timeout)"
    assert (fleet.folder / "store/results/a/summary.json").is_file()
    assert fleet.rows().loc["a", "status"] == "failed"
    assert fleet.why()["a"] == "the recording changed"


def test_a_killed_batch_takes_its_processes_with_it(fleet: Fleet, stand_in: StandIn) -> None:
    stand_in.recording("hang-1")
    fleet.write("recordings/hang-1,7,,hang-1")
    command = [sys.executable, "-m", "trackfg", "batch", str(fleet.table), "-o", str(fleet.folder / "store")]
    batch = subprocess.Popen(command)
    deadline = time.monotonic() + 60.0
    while not stand_in.calls() and time.monotonic() < deadline:
        time.sleep(0.05)
    assert running(fleet.folder)
    batch.send_signal(signal.SIGKILL)
    batch.wait()
    while running(fleet.folder) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert running(fleet.folder) == []
    assert fleet.why() == {"hang-1": "no result yet"}


def test_an_interrupted_batch_says_how_far_it_came(fleet: Fleet, stand_in: StandIn) -> None:
    for name in ("a", "hang-1"):
        stand_in.recording(name)
    fleet.write("recordings/a,7,,a", "recordings/hang-1,7,,hang-1")
    command = [sys.executable, "-m", "trackfg", "batch", str(fleet.table), "-o", str(fleet.folder / "store")]
    batch = subprocess.Popen([*command, "--jobs", "1"], stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60.0
    while not any("hang" in command for command in running(fleet.folder)) and time.monotonic() < deadline:
        time.sleep(0.05)
    batch.send_signal(signal.SIGINT)
    _, stderr = batch.communicate()
    assert batch.returncode == 130
    # The first run may be over before the command has heard of it.
    assert re.search(r"trackfg: interrupted: [01] of 2 runs done\. Hint: the same command goes on from there", stderr)


def running(folder: Path) -> list[str]:
    """The processes that smooth a recording below a folder."""
    commands = []
    for process in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            commands.append(process.read_bytes().replace(b"\0", b" ").decode(errors="replace"))
        except OSError:
            continue
    return [command for command in commands if " smooth " in command and str(folder) in command]


def test_another_folder_is_no_store(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").touch()
    with pytest.raises(BadInputError, match="exists and is not a trackfg store"):
        Store(tmp_path)


def test_two_writers_lose_no_row(tmp_path: Path, stand_in: StandIn) -> None:
    from trackfg.fleet.key_figures import failed_row

    first, second = Store(tmp_path / "store"), Store(tmp_path / "store")

    def row(name: str, line: str = "7") -> dict[str, Any]:
        return failed_row(Run(name, f"/recordings/{name}", line), "no reason", "")

    first.write([row("a"), row("b")])
    second.write([row("c")])
    first.write([row("a")])
    assert sorted(each["run"] for each in Store(tmp_path / "store").read(["run"])) == ["a", "b", "c"]


def test_an_unknown_map_is_refused_before_anything_runs(fleet: Fleet, stand_in: StandIn) -> None:
    stand_in.recording("a")
    fleet.write("recordings/a,none.gpkg,a", columns="recording,map,run")
    with pytest.raises(BadInputError, match=r"none\.gpkg: no such file"):
        fleet.run()
    assert stand_in.calls() == []


@pytest.mark.slow
def test_the_command_gives_what_smooth_gives_to_the_last_bit(
    tmp_path: Path, simulated: Callable[..., Any], trackfg: Callable[..., subprocess.CompletedProcess[str]]
) -> None:
    for seed in (1, 2):
        simulated("mainline", seed=seed, duration_s=40.0).write(tmp_path / f"run{seed}")
    batch = ("batch", tmp_path / "run*", "-o", tmp_path / "store", "--line", "7")
    done = trackfg(*batch)
    assert done.returncode == 0
    assert "computed 2, failed 0" in done.stdout
    done = trackfg(*batch, "--dry-run")
    assert done.returncode == 0
    assert done.stdout.count(": fresh\n") == 2
    alone = tmp_path / "alone"
    assert trackfg("smooth", tmp_path / "run1", "-o", alone).returncode == 0
    (result,) = (tmp_path / "store" / "results").glob("run1-*")
    for name in ("trajectory.parquet", "geometry.parquet", "covariance.parquet", "events.csv"):
        assert (result / name).read_bytes() == (alone / name).read_bytes()
