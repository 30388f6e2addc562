from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pytest

from .conftest import StandIn

SCHEDULER = "from distributed.cli.dask_scheduler import main; main()"
WORKER = "from distributed.cli.dask_worker import main; main()"


@pytest.fixture
def scheduler(tmp_path: Path) -> Iterator[str]:
    file = tmp_path / "scheduler.json"
    options = ["--port", "0", "--no-dashboard", "--host", "127.0.0.1", "--scheduler-file", str(file)]
    process = subprocess.Popen([sys.executable, "-c", SCHEDULER, *options], stderr=subprocess.DEVNULL)
    try:
        yield str(file)
    finally:
        process.kill()
        process.wait()


def start_worker(scheduler: str) -> subprocess.Popen[bytes]:
    options = ["--scheduler-file", scheduler, "--nthreads", "1", "--no-nanny", "--no-dashboard"]
    return subprocess.Popen([sys.executable, "-c", WORKER, *options], stderr=subprocess.DEVNULL)


def address(scheduler: str) -> str:
    import json

    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        if Path(scheduler).exists() and (text := Path(scheduler).read_text()):
            return str(json.loads(text)["address"])
        time.sleep(0.05)
    raise AssertionError("no scheduler")


@pytest.mark.slow
def test_a_lost_worker_costs_nothing_but_time(tmp_path: Path, stand_in: StandIn, scheduler: str) -> None:
    pytest.importorskip("distributed")
    names = [f"run{number}" for number in range(4)]
    for name in names:
        stand_in.recording(name)
    stand_in.recording("hang-once")
    (tmp_path / "runs.csv").write_text(
        "\n".join(["recording,run", *(f"recordings/{n},{n}" for n in (*names, "hang-once"))])
    )
    place = address(scheduler)
    workers = [start_worker(scheduler), start_worker(scheduler)]
    command = [sys.executable, "-m", "trackfg", "batch", str(tmp_path / "runs.csv"), "-o", str(tmp_path / "store")]
    batch = subprocess.Popen([*command, "--scheduler", place, "--timeout", "20"], stdout=subprocess.PIPE, text=True)
    try:
        for lost in (1, 2):
            workers.append(start_worker(scheduler))
            deadline = time.monotonic() + 60.0
            while stand_in.calls().count("hang-once") < lost and time.monotonic() < deadline:
                time.sleep(0.05)
            if lost == 2:
                stand_in.heal("hang-once")
            holder = worker_of("hang-once")
            os.kill(holder, signal.SIGKILL)
        out, _ = batch.communicate(timeout=120)
    finally:
        for process in (batch, *workers):
            process.kill()
            process.wait()
    assert batch.returncode == 0, out
    rows = pd.read_parquet(tmp_path / "store" / "catalogue").set_index("run")
    assert rows["status"].to_dict() == dict.fromkeys((*names, "hang-once"), "done")
    assert stand_in.calls().count("hang-once") == 3
    assert sorted(set(stand_in.calls())) == sorted((*names, "hang-once"))
    assert list((tmp_path / "store").glob(".begun-*")) == []


def worker_of(recording: str) -> int:
    """The process that started the process which smooths a recording."""
    for process in Path("/proc").glob("[0-9]*"):
        try:
            command = (process / "cmdline").read_bytes().split(b"\0")
            if b"smooth" in command and any(part.endswith(recording.encode()) for part in command):
                return int((process / "stat").read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
    raise AssertionError("nothing smooths it")


def test_a_run_that_lost_its_workers_is_named(tmp_path: Path) -> None:
    from trackfg.fleet.catalogue import Run
    from trackfg.fleet.isolated_run import Job
    from trackfg.fleet.workers import run_on_worker

    (tmp_path / "tally").write_bytes(b"...")
    job = Job(Run("a", str(tmp_path / "none")), str(tmp_path / "result"), "")
    assert run_on_worker(job, str(tmp_path / "tally")).reason == "its worker was lost 3 times"


@pytest.mark.slow
def test_a_worker_that_is_lost_while_a_batch_begins_is_done_without(tmp_path: Path, scheduler: str) -> None:
    distributed = pytest.importorskip("distributed")
    from trackfg.fleet.workers import cluster

    place = address(scheduler)
    workers = [start_worker(scheduler), start_worker(scheduler)]
    try:
        with distributed.Client(place) as client:
            client.wait_for_workers(2, timeout=60.0)
        workers[1].send_signal(signal.SIGSTOP)  # it does not answer, and then it is gone
        threading.Timer(1.0, workers[1].kill).start()
        with cluster(place, str(tmp_path)):
            assert workers[1].wait(timeout=30.0) == -signal.SIGKILL
    finally:
        for worker in workers:
            worker.kill()
            worker.wait()


@pytest.mark.slow
def test_no_scheduler_is_said_in_a_line(tmp_path: Path, stand_in: StandIn, monkeypatch: pytest.MonkeyPatch) -> None:
    from trackfg.errors import BadInputError
    from trackfg.fleet import workers

    monkeypatch.setattr(workers, "_CONNECTING_S", 0.5)
    with (
        pytest.raises(BadInputError, match=r"tcp://127\.0\.0\.1:9: no scheduler"),
        workers.cluster("tcp://127.0.0.1:9", str(tmp_path)),
    ):
        pass
