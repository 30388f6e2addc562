from __future__ import annotations

import shutil
import socket
import subprocess
import sys
import time
import urllib.request
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from trackfg.fleet import places
from trackfg.fleet.batch import Limits, run_batch
from trackfg.fleet.catalogue import Run
from trackfg.fleet.isolated_run import Outcome
from trackfg.fleet.known_content import KnownContent
from trackfg.fleet.planning import PlannedRun, plan
from trackfg.fleet.store import Store
from trackfg.io.content import content_files, files_sha256
from trackfg.io.reader import read_recording
from trackfg.smoothing.smoother import smooth

from .conftest import StandIn

fsspec = pytest.importorskip("fsspec")
LIMITS = Limits(timeout_s=60.0, memory_bytes=200_000_000, jobs=2)


@pytest.fixture
def memory(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Any]:
    """An empty file system in memory, and caches of this test's own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))
    files = fsspec.filesystem("memory")
    files.store.clear()
    files.pseudo_dirs[:] = [""]
    yield files
    files.store.clear()
    files.pseudo_dirs[:] = [""]


def planned(runs: list[Run], place: str) -> list[PlannedRun]:
    store = Store(place)
    return plan(runs, store, KnownContent(store.known_content))


def compute(runs: list[Run], place: str) -> list[Outcome]:
    store = Store(place)
    known = KnownContent(store.known_content)
    return run_batch(plan(runs, store, known), store, known, LIMITS)


def test_a_store_at_a_url_is_as_one_here(memory: Any, stand_in: StandIn) -> None:
    folder = stand_in.recording("run1")
    memory.put(str(folder), "/recordings/run1", recursive=True)
    runs = [Run("run1", "memory://recordings/run1", "7")]
    shutil.copytree(stand_in.folder / "prepared" / "run1", stand_in.folder / "prepared" / "recording")
    (outcome,) = compute(runs, "memory://store")
    assert outcome.reason is None, outcome
    assert {path.rpartition("/")[2] for path in memory.find("/store/results/run1")} == {
        "summary.json",
        "events.csv",
        "trajectory.parquet",
        "geometry.parquet",
        "covariance.parquet",
    }
    (row,) = Store("memory://store").read(["run", "status", "files_sha256"])
    assert (row["status"], row["line"], row["month"]) == ("done", "7", "2026-05")
    assert row["files_sha256"] == files_sha256(*content_files(folder))
    assert [each.why for each in planned(runs, "memory://store")] == [""]
    assert compute(runs, "memory://store") == []
    memory.pipe_file("/recordings/run1/imu.csv", b"t,wx\n0,2\n")
    assert [each.why for each in planned(runs, "memory://store")] == ["the recording changed"]


def test_a_result_whose_upload_breaks_off_counts_as_none(
    memory: Any, stand_in: StandIn, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = stand_in.recording("run1")
    runs = [Run("run1", str(folder), "7")]
    write = places.write

    def breaks_off(place: str, content: bytes) -> None:
        if place.endswith("trajectory.parquet"):
            raise places.PlaceError(f"{place}: connection lost")
        write(place, content)

    monkeypatch.setattr(places, "write", breaks_off)
    (outcome,) = compute(runs, "memory://store")
    assert outcome.reason is not None
    assert "connection lost" in outcome.reason
    assert memory.find("/store/results") != []
    assert Store("memory://store").names() == set()
    monkeypatch.setattr(places, "write", write)
    assert [each.why for each in planned(runs, "memory://store")] == [f"failed before: {outcome.reason}"]
    assert [each.reason for each in compute(runs, "memory://store")] == [None]


def test_an_archive_holds_one_recording(tmp_path: Path, stand_in: StandIn) -> None:
    folder = stand_in.recording("run1")
    archive = tmp_path / "run1.zip"
    with zipfile.ZipFile(archive, "w") as content:
        for path in folder.iterdir():
            content.write(path, f"deep/run1/{path.name}")
    with places.local_recording(str(archive)) as unpacked:
        assert files_sha256(*content_files(unpacked)) == files_sha256(*content_files(folder))
    assert not unpacked.exists()
    with zipfile.ZipFile(archive, "a") as content:
        content.writestr("other/recording.toml", "")
    with (
        pytest.raises(places.PlaceError, match=r"run1\.zip: holds 2 files recording\.toml; expected one"),
        places.local_recording(str(archive)),
    ):
        pass


def test_what_is_no_archive_becomes_a_row(tmp_path: Path, stand_in: StandIn) -> None:
    (tmp_path / "run1.zip").write_text("no archive")
    (outcome,) = compute([Run("run1", str(tmp_path / "run1.zip"))], str(tmp_path / "store"))
    assert "run1.zip: not a readable archive" in str(outcome.reason)


def test_a_table_outside_the_recording_is_not_fetched(memory: Any) -> None:
    memory.pipe_file("/secret.csv", b"1")
    memory.pipe_file(
        "/run/recording.toml", b'[imu]\nfile = "../secret.csv"\ngyro = ["a","b","c"]\naccel = ["a","b","c"]\n'
    )
    with places.local_recording("memory://run") as folder:
        assert [path.name for path in folder.parent.rglob("*.csv")] == []


@pytest.mark.parametrize("url", ["nothing://at/all", "https://127.0.0.1:9/run1.zip", "memory://missing"])
def test_a_url_that_cannot_be_read_becomes_a_row(tmp_path: Path, memory: Any, url: str) -> None:
    (outcome,) = compute([Run("run1", url)], str(tmp_path / "store"))
    assert str(outcome.reason).startswith(url.partition("/run1")[0])


def test_a_server_that_shows_no_version_is_read_every_time(memory: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    memory.pipe_file("/run/imu.csv", b"1")
    monkeypatch.setattr(type(memory), "info", lambda self, path, **kwargs: {"name": path, "size": 1})
    assert places.signature("memory://run", ["imu.csv"]) is None


@pytest.fixture
def s3(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Any]:
    """A server of S3, empty but for a bucket."""
    pytest.importorskip("moto")
    pytest.importorskip("s3fs")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    url = f"http://127.0.0.1:{port}"
    for name, value in {
        "AWS_ENDPOINT_URL": url,
        "AWS_ACCESS_KEY_ID": "test",
        "AWS_SECRET_ACCESS_KEY": "test",
        "AWS_DEFAULT_REGION": "us-east-1",
        "XDG_CACHE_HOME": str(tmp_path / "caches"),
    }.items():
        monkeypatch.setenv(name, value)
    code = f"from moto.server import main; main(['-p', '{port}'])"
    server = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        deadline = time.monotonic() + 60.0
        while time.monotonic() < deadline:
            try:
                urllib.request.urlopen(f"{url}/moto-api/", timeout=1.0).close()
                break
            except OSError:
                time.sleep(0.1)
        yield url
    finally:
        server.kill()
        server.wait()


@pytest.mark.slow
def test_recordings_and_store_in_s3_through_the_command(
    s3: str, tmp_path: Path, simulated: Callable[..., Any], capfd: pytest.CaptureFixture[str]
) -> None:
    simulated("mainline", seed=1, duration_s=30.0).write(tmp_path / "run1")
    setup = (
        "import s3fs\n"
        "files = s3fs.S3FileSystem()\n"
        "files.mkdir('fleet')\n"
        f"files.put({str(tmp_path / 'run1')!r}, 'fleet/recordings/run1', recursive=True)\n"
    )
    subprocess.run([sys.executable, "-c", setup], check=True)
    (tmp_path / "runs.csv").write_text(
        "recording,line,run\ns3://fleet/recordings/run1,7,run1\ns3://fleet/recordings/none,7,none\n"
    )
    batch = [sys.executable, "-m", "trackfg", "batch", str(tmp_path / "runs.csv"), "-o", "s3://fleet/store"]
    assert subprocess.run(batch, check=False).returncode == 1
    assert "computed 1, failed 1" in capfd.readouterr().out
    assert subprocess.run([*batch, "--dry-run"], check=False).returncode == 0
    out = capfd.readouterr().out
    assert "run1: fresh\n" in out
    assert "none: compute: failed before: s3://fleet/recordings/none/recording.toml: FileNotFoundError" in out
    fetch = f"import s3fs; s3fs.S3FileSystem().get('fleet/store', {str(tmp_path / 'store')!r}, recursive=True)"
    subprocess.run([sys.executable, "-c", fetch], check=True)
    rows = pd.read_parquet(tmp_path / "store" / "catalogue").set_index("run")
    assert rows["status"].to_dict() == {"run1": "done", "none": "failed"}
    smooth(read_recording(tmp_path / "run1")).write(tmp_path / "alone")
    for name in ("trajectory.parquet", "geometry.parquet", "covariance.parquet", "events.csv"):
        assert (tmp_path / "store/results/run1" / name).read_bytes() == (tmp_path / "alone" / name).read_bytes()
