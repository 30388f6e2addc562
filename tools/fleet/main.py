"""The acceptance of `trackfg batch`, in any size.

    python tools/fleet.py                                     20 runs of 60 s
    python tools/fleet.py --runs 200 --kills 10 --map-runs 300 --out fleet   all of it, kept in a folder
    python tools/fleet.py --runs 0 --map-runs 300             maps and trends alone

Recordings are simulated once. Then they are computed by local processes, by a cluster of dask workers of which one is
killed twice, and by a command that is itself killed again and again: catalogue and results must be the same, to the
last bit. Faults of single runs must become rows, a second call must do nothing, one changed setting must do what it
affects. A map of many runs must take no more memory than a few, and one run more must cost what it costs with 30.
Growing defects of made-up lines must be found, with their rates, the dates of a limit, and tamping.
Exit status 1 where a figure misses its target. Timings are those of a machine with nothing else to do.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd
from rich.console import Console
from rich.table import Table

from fleet.faults import KINDS, write_faults
from fleet.many_runs import write_store
from fleet.runs import write_runs
from fleet.trends import FOUND_BY, trend_scores

_TRACKFG = [sys.executable, "-m", "trackfg"]
_MADE_UP = 100_000
"""Rows of the catalogue that is only planned."""
_MEASURED = 12
"""Runs that throughput is measured on: the start of the command, a second, is then a twentieth of it."""
_FEW = 30
"""Runs of the map that a longer one is held against."""
_REPEATED = 3
"""Times that a run is added: the least counts, since other processes can only cost."""


@dataclass
class Figures:
    """Figures against their targets."""

    table: Table = field(default_factory=lambda: Table("what", "figure", "target", "met"))
    missed: int = 0

    def add(self, what: str, figure: object, target: str, met: bool) -> None:
        """Add a row."""
        self.missed += not met
        self.table.add_row(what, str(figure), target, "yes" if met else "[red]no")
        print(f"{what}: {figure} ({target})", file=sys.stderr, flush=True)


def main() -> int:
    """Run the command."""
    summary, _, usage = (__doc__ or "").partition("\n\n")
    parser = argparse.ArgumentParser(
        description=summary, epilog=usage, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=60.0, help="length of a run")
    parser.add_argument("--kills", type=int, default=3, help="times that the command is killed")
    parser.add_argument("--map-runs", type=int, default=60, help="runs of a map")
    parser.add_argument("--map-km", type=float, default=5.0, help="length of these")
    parser.add_argument("--trend-lines", type=int, default=2, help="lines of 20 km with growing defects")
    parser.add_argument("--out", type=Path, help="folder to keep; a temporary one if absent")
    options = parser.parse_args()
    folder = options.out or Path(tempfile.mkdtemp(prefix="fleet-"))
    figures = Figures()
    try:
        if options.runs:
            table = write_runs(folder / "recordings", options.runs, options.seconds)
            _same_everywhere(table, folder, options.kills, figures)
            _faults(table, folder, figures)
            _second_call(table, folder, figures)
            _throughput(table, folder, figures)
        if options.map_runs:
            _maps(folder, options.map_runs, options.map_km, figures)
        if options.trend_lines:
            _trends(options.trend_lines, figures)
    finally:
        if options.out is None:
            shutil.rmtree(folder, ignore_errors=True)
    Console(width=120).print(figures.table)
    return 1 if figures.missed else 0


def _batch(table: Path, store: Path, *options: str) -> list[str]:
    return [*_TRACKFG, "batch", str(table), "-o", str(store), *options]


def _same_everywhere(table: Path, folder: Path, kills: int, figures: Figures) -> None:
    stores = {name: folder / f"store-{name}" for name in ("local", "killed", "cluster")}
    status = subprocess.run(_batch(table, stores["local"]), check=False, stdout=subprocess.DEVNULL).returncode
    figures.add("local processes: exit status", status, "0", status == 0)
    reference = _content(stores["local"])

    began, done = _killed_again_and_again(_batch(table, stores["killed"]), stores["killed"], kills)
    figures.add(f"command killed {kills} times: same bits", _same(stores["killed"], reference), "all", done)
    figures.add("  runs begun more than once for nothing", began, "0", began == 0)
    leftovers = [path.name for path in stores["killed"].rglob(".*") if path.name != ".known.sqlite"]
    figures.add("  half-written, left over", len(leftovers), "0", not leftovers)

    with _cluster(folder) as (address, lose_worker):
        command = _batch(table, stores["cluster"], "--scheduler", address)
        with subprocess.Popen(command, stdout=subprocess.DEVNULL) as batch:
            for _ in range(2):
                lose_worker(stores["cluster"])
            status = batch.wait()
    same = _same(stores["cluster"], reference)
    figures.add("cluster, a worker killed twice: same bits", same, "all", status == 0 and same == len(reference))


def _killed_again_and_again(command: list[str], store: Path, kills: int) -> tuple[int, bool]:
    """Return how many results that were there were computed again, and whether the last call did the rest."""
    chance, again = random.Random(1), 0
    for _ in range(kills):
        times_ns = {path: path.stat().st_mtime_ns for path in store.glob("results/*/summary.json")}
        with subprocess.Popen(command, stdout=subprocess.DEVNULL) as batch:
            try:
                batch.wait(chance.uniform(3.0, 30.0))
            except subprocess.TimeoutExpired:
                batch.send_signal(signal.SIGKILL)
        again += sum(path.stat().st_mtime_ns != changed for path, changed in times_ns.items())
    return again, subprocess.run(command, check=False, stdout=subprocess.DEVNULL).returncode == 0


@contextmanager
def _cluster(folder: Path):
    """Start a scheduler and two workers; give its address and what kills a worker that smooths, for a new one."""
    file = folder / "scheduler.json"
    file.unlink(missing_ok=True)
    processes: list[subprocess.Popen[bytes]] = []

    def start(which: str, *options: str) -> None:
        code = f"from distributed.cli.dask_{which} import main; main()"
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        processes.append(subprocess.Popen([sys.executable, "-c", code, *options], **quiet))

    def start_worker() -> None:
        start("worker", "--scheduler-file", str(file), "--nthreads", "1", "--no-nanny", "--no-dashboard")

    def lose_worker(store: Path) -> None:
        deadline = time.monotonic() + 300.0
        while time.monotonic() < deadline:
            for worker in processes[1:]:
                if worker.poll() is None and _smooths(worker.pid):
                    worker.kill()
                    worker.wait()
                    start_worker()
                    return
            time.sleep(0.1)
        raise SystemExit(f"no worker began a run of {store}")

    try:
        start("scheduler", "--port", "0", "--host", "127.0.0.1", "--no-dashboard", "--scheduler-file", str(file))
        while not file.exists() or not file.read_text():
            time.sleep(0.1)
        start_worker()
        start_worker()
        yield json.loads(file.read_text())["address"], lose_worker
    finally:
        for process in processes:
            process.kill()
            process.wait()


def _smooths(parent: int) -> bool:
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if int((process / "stat").read_text().rpartition(")")[2].split()[1]) == parent:
                return b"smooth" in (process / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
    return False


def _content(store: Path) -> dict[str, str]:
    """Return a digest of each result, times of computing apart, and of each file of the catalogue."""
    digests = {}
    for result in sorted((store / "results").glob("[!.]*")):
        digest = hashlib.sha256()
        for path in sorted(result.iterdir()):
            content = path.read_bytes()
            if path.name == "summary.json":
                page = json.loads(content)
                page.pop("timings_s")
                content = json.dumps(page).encode()
            digest.update(content)
        digests[result.name] = digest.hexdigest()
    for path in sorted((store / "catalogue").rglob("*.parquet")):
        digests[str(path.relative_to(store))] = hashlib.sha256(path.read_bytes()).hexdigest()
    return digests


def _same(store: Path, reference: dict[str, str]) -> int:
    content = _content(store)
    return sum(content.get(name) == digest for name, digest in reference.items())


def _rows(table: Path) -> pd.DataFrame:
    """Return the rows of a catalogue for one in another folder: with the whole paths of recordings."""
    rows = pd.read_csv(table, dtype=str)
    return rows.assign(recording=[str(table.parent / name) for name in rows["recording"]])


def _faults(table: Path, folder: Path, figures: Figures) -> None:
    rows = _rows(table)
    places = write_faults(folder / "faults", Path(rows["recording"][0]))
    faulty = pd.DataFrame({"recording": places.values(), "line": "1", "tags": "fault", "run": places.keys()})
    with_faults, store = folder / "with-faults.csv", folder / "store-faults"
    pd.concat([rows, faulty]).to_csv(with_faults, index=False)
    if not store.exists():
        shutil.copytree(folder / "store-local", store)
    environment = {**os.environ, "PYTHONPATH": str(folder / "faults" / "site")}
    command = _batch(with_faults, store, "--timeout", "60", "--memory", "2")
    status = subprocess.run(command, check=False, env=environment, stdout=subprocess.DEVNULL).returncode
    listed = pd.read_parquet(store / "catalogue").set_index("run")
    failed = listed[listed["status"] == "failed"]
    figures.add("with five faults: exit status", status, "1", status == 1)
    figures.add("  results", int((listed["status"] == "done").sum()), f"{len(rows)}", len(listed) == len(rows) + 5)
    for kind in KINDS:
        reason = failed["reason"].get(kind)
        figures.add(f"  {kind}", reason, "a reason", bool(reason))


def _second_call(table: Path, folder: Path, figures: Figures) -> None:
    store = folder / "store-local"
    fresh = set(_plan(table, store).values()) == {"fresh"}
    seconds, _ = _taken(_batch(table, store))
    figures.add("second call, s of a core", f"{seconds:.1f}", "<= 3", fresh and seconds <= 3.0)
    changed, rows = folder / "changed.csv", _rows(table)
    (folder / "other.toml").write_text("[noise]\nrounds = 2\n")
    rows["settings"] = ["other.toml" if number % 5 == 0 else "" for number in range(len(rows))]
    rows.to_csv(changed, index=False)
    plan = _plan(changed, store)
    affected = {name for name, why in plan.items() if why != "fresh"}
    expected = set(rows.loc[rows["settings"] != "", "run"])
    figures.add("one changed setting: runs to compute", len(affected), f"{len(expected)}", affected == expected)
    made_up = folder / "made-up.csv"
    names = [f"made-up/{number}" for number in range(_MADE_UP)]
    pd.DataFrame({"recording": names, "line": [str(number % 20) for number in range(_MADE_UP)]}).to_csv(
        made_up, index=False
    )
    seconds, memory = _taken(_batch(made_up, folder / "store-none", "--dry-run"))
    figures.add(f"planning {_MADE_UP} rows, s of a core", f"{seconds:.1f}", "<= 20", seconds <= 20.0)
    figures.add("  memory, GB", f"{memory:.2f}", "<= 1", memory <= 1.0)


def _plan(table: Path, store: Path) -> dict[str, str]:
    out = subprocess.run(_batch(table, store, "--dry-run"), check=True, capture_output=True, text=True).stdout
    return dict(line.split(": ", 1) for line in out.splitlines())


def _throughput(table: Path, folder: Path, figures: Figures) -> None:
    rows = _rows(table).head(_MEASURED)
    few = folder / "few.csv"
    rows.to_csv(few, index=False)
    seconds = {}
    for jobs in (1, 2):
        with _fresh(folder / "store-throughput") as store:
            seconds[jobs] = _timed(_batch(few, store, "--jobs", str(jobs)))
    with _fresh(folder / "loop") as loop:
        one_thread = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
        begin = time.perf_counter()
        for place in rows["recording"]:
            smooth = [*_TRACKFG, "smooth", place, "-o", str(loop / Path(place).name)]
            subprocess.run(smooth, check=True, capture_output=True, env=one_thread)
        plain = time.perf_counter() - begin
    gain, overhead = seconds[1] / seconds[2], (seconds[1] - plain) / len(rows)
    figures.add("two processes against one", f"{gain:.2f} times", ">= 1.8", gain >= 1.8)
    figures.add("overhead over a loop of smooth, s a run", f"{overhead:.2f}", "<= 0.3", overhead <= 0.3)


def _maps(folder: Path, runs: int, km: float, figures: Figures) -> None:
    """Build maps of few runs and of many, and add one to each, in a copy, again and again."""
    *results, last = write_store(folder / f"store-map-{km:g}", runs + 1, km)
    few, cost = min(_FEW, runs // 2), {}
    for number in sorted({few, runs}):
        place, copy = folder / f"map-{km:g}-{number}.gpkg", folder / "one-more.gpkg"
        place.unlink(missing_ok=True)
        seconds, memory = _taken([*_TRACKFG, "map", "build", *map(str, results[:number]), "-o", str(place)])
        figures.add(
            f"map of {number} runs in {seconds:.0f} s of a core: memory, GB", f"{memory:.2f}", "<= 4", memory <= 4
        )
        added = []
        for _ in range(_REPEATED):
            shutil.copy(place, copy)
            added.append(_taken([*_TRACKFG, "map", "build", str(last), "-o", str(copy)])[0])
        cost[number] = min(added)
    what = f"one run more: {cost[runs]:.2f} s of a core; against {few} runs"
    figures.add(what, f"{cost[runs] / cost[few]:.2f} times", "<= 1.5", cost[runs] <= 1.5 * cost[few])


def _trends(lines: int, figures: Figures) -> None:
    scores = trend_scores(lines)
    figures.add(f"defects found by month {FOUND_BY}", f"{scores.found:.1%}", ">= 95 %", scores.found >= 0.95)
    for what, share in (("rates within two sigmas", scores.rates), ("dates of a limit inside", scores.dates)):
        figures.add(f"  {what}", f"{share:.1%}", "90 to 98 %", 0.9 <= share <= 0.98)
    figures.add("  tamping found at its first run", f"{scores.tamped:.1%}", "100 %", scores.tamped == 1.0)
    false = scores.false_per_100_km
    figures.add("false trends in 100 km of still line", f"{false:.2f}", "< 1", false < 1.0)


def _taken(command: list[str]) -> tuple[float, float]:
    """Return the time of a core that a command took, s, and the memory of its largest process, GB."""
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, process.args)
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024e-9


@contextmanager
def _fresh(folder: Path) -> Iterator[Path]:
    shutil.rmtree(folder, ignore_errors=True)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _timed(command: list[str]) -> float:
    begin = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - begin
