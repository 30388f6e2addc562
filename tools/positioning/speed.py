"""What a map of ten runs of 70 km costs, and an eleventh run on it: time and memory beyond smoothing.

Runs are simulated and smoothed by processes of their own, two at a time, which leave results on disk, as
``trackfg smooth`` does. A fresh process then reads them, makes the map and writes it as a GeoPackage; another reads map
and eleventh result, adds the run and writes the new version. Times are of all of that but the start of the process;
memory is the most that each ever held (``VmHWM``).
"""

from __future__ import annotations

import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pandas as pd
from benchmark import Figure, Part, at_most

from positioning.runs import SURVEY_RUNS, long_shuttle
from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import simulate
from trackfg.mapping import build_map, with_runs
from trackfg.maps import read_map, write_map
from trackfg.results.result import Result
from trackfg.smoothing.smoother import smooth

LENGTH_M, DURATION_S = 70_000.0, 6300.0
"""The slowest of dozens of drawn runs arrives after 6050 s."""

BUILD_S, ADD_S, PEAK_GB = 120.0, 15.0, 4.0
SMOOTHED_AT_ONCE = 2


def measure(seed: int) -> dict[str, float]:
    """Seconds and GB."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with _processes(SMOOTHED_AT_ONCE) as pool:
            seconds = list(
                pool.map(_smoothed, [seed] * (SURVEY_RUNS + 1), range(SURVEY_RUNS + 1), [folder] * (SURVEY_RUNS + 1))
            )
        with _processes(1) as pool:
            built = pool.submit(_built, folder).result()
        with _processes(1) as pool:
            added = pool.submit(_added, folder).result()
    return {"smooth s": float(np.mean(seconds)), **built, **added}


def _processes(count: int) -> ProcessPoolExecutor:
    """Fresh ones: not forked, so that they hold nothing of this one, and each for one task."""
    return ProcessPoolExecutor(count, mp_context=get_context("spawn"), max_tasks_per_child=1)


def _result(folder: Path, run: int) -> Path:
    return folder / f"run{run}"


def _map_file(folder: Path) -> str:
    return str(folder / "line.gpkg")


def _smoothed(seed: int, run: int, folder: Path) -> float:
    recording = simulate(long_shuttle(LENGTH_M, DURATION_S), seed=seed, run=run).recording
    start = time.perf_counter()
    smooth(recording, SmoothConfig()).write(_result(folder, run))
    return time.perf_counter() - start


def _built(folder: Path) -> dict[str, float]:
    start = time.perf_counter()
    results = [Result.read(_result(folder, run)) for run in range(SURVEY_RUNS)]
    read = time.perf_counter()
    feature_map = build_map(results, name="70 km")
    built = time.perf_counter()
    write_map(feature_map, _map_file(folder), parent=None)
    end = time.perf_counter()
    return {
        "read s": read - start,
        "build s": built - read,
        "write s": end - built,
        "peak GB": _peak_gb(),
        "km": 1e-3 * float(np.ptp(feature_map.grid["chainage_m"])),
    }


def _added(folder: Path) -> dict[str, float]:
    start = time.perf_counter()
    feature_map, result = read_map(_map_file(folder)), Result.read(_result(folder, SURVEY_RUNS))
    read = time.perf_counter()
    more = with_runs(feature_map, [result])
    added = time.perf_counter()
    write_map(more, _map_file(folder), parent=feature_map.version)
    end = time.perf_counter()
    return {
        "eleventh read s": read - start,
        "eleventh add s": added - read,
        "eleventh write s": end - added,
        "eleventh peak GB": _peak_gb(),
    }


def _peak_gb() -> float:
    """The most that this process ever held. (``ru_maxrss`` has its parent's in it.)"""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    (line,) = [line for line in status.splitlines() if line.startswith("VmHWM:")]
    return float(line.split()[1]) * 1024 / 1e9


def figures(measured: pd.DataFrame) -> list[Figure]:
    """The lines of the part, of one seed."""
    of = measured.iloc[0]
    return [
        at_most("map of ten runs, s", of["read s"] + of["build s"] + of["write s"], BUILD_S),
        *(Figure(f"of it: {what}, s", of[f"{what} s"]) for what in ("read", "build", "write")),
        at_most("most memory, GB", of["peak GB"], PEAK_GB),
        at_most("eleventh run, s", sum(of[f"eleventh {what} s"] for what in ("read", "add", "write")), ADD_S),
        *(Figure(f"of it: {what}, s", of[f"eleventh {what} s"]) for what in ("read", "add", "write")),
        at_most("most memory, GB", of["eleventh peak GB"], PEAK_GB),
        Figure("smoothing one run, s", of["smooth s"]),
        Figure("length of the map, km", of["km"]),
    ]


PART = Part(
    name="speed",
    title="Cost of a map of ten runs of 70 km, and of an eleventh",
    measure=measure,
    figures=figures,
    alone=True,
)
