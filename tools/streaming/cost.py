"""What an update of the fixed-lag smoother costs, and whether it stays so over hours.

A run of ``mainline`` is simulated by a process of its own, which leaves its rows in files. Another one streams them in
batches of 0.1 s, as a recorder would send them, to Parquet parts, and takes the time of each batch, from its arrival to
its estimates: the latency where it made a keyframe complete. Memory is read once a simulated minute.

How many times faster than real time it is, is measured on the first ``STORED_HOURS`` once more, in the batches in which
a stored recording is read, with the same keyframes and with the default ones. A keyframe every 0.5 s makes 1.6 times as
many keyframes of ``mainline`` as the default, every 20 m or 1 s, which ``trackfg stream`` has. Reading of rows, writing
of Parquet parts and checks are included; the start of a process, and the checks of a stored recording, are not.

All times are CPU times: other work on the machine does not count, except for what it does to caches. A latency is that
of the thread that estimates; from a store the threads that write count as well.

A machine whose own speed moves by a quarter over a quarter of an hour would be taken for growth. So a fixed computation
of the same sort (:func:`control`) is timed every ``CONTROL_S`` beside the updates, and growth is that of their ratio to
it, times its mean.

The slopes are those of straight lines through a median a minute with their sigmas, the first tenth of the run left out:
buffers fill. What they make of the whole run is within noise if it is below ``NOISE`` of the mean or twice its sigma.
"""

from __future__ import annotations

import contextlib
import gc
import itertools
import os
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pandas as pd
from benchmark import Figure, Part, at_least, at_most
from scipy import stats

from streaming.base_cases import CONFIG
from trackfg import FixedLagSmoother
from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import simulate
from trackfg.numerics.arrays import Array
from trackfg.numerics.blas_threads import one_thread
from trackfg.recording.description import RecordingDescription
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.rows import recording_rows
from trackfg.streaming.run import run_stream, write_estimates
from trackfg.streaming.sinks.parquet_parts import ParquetParts
from trackfg.streaming.sources.source import BATCH_S, STORED_BATCH_S, Batch

SCENARIO = "mainline"
LAG_S = 10.0
P50_MS, P99_MS, TIMES_REAL_TIME = 5.0, 3.0, 200.0
STORED_HOURS = 1.0
NOISE = 0.05
WARM_UP = 0.1
CONTROL_S = 2.0
_DESCRIPTION = "description.json"
_MINUTE_S = 60.0
_KEPT = {"puts": ["t_s", "ms", "keyframes"], "controls": ["t_s", "ms"], "memory": ["t_s", "mb"]}


@dataclass(frozen=True)
class RowFiles:
    """A source that reads the rows of a simulated run from files, whole minutes, up to ``until_s``."""

    folder: Path
    batch_s: float = BATCH_S
    until_s: float = np.inf
    canonical, live, length = True, False, None
    gnss_origin = None
    first_rows = ""

    @property
    def description(self) -> RecordingDescription:
        return RecordingDescription.model_validate_json((self.folder / _DESCRIPTION).read_bytes())

    def __iter__(self) -> Iterator[Batch]:
        paths = sorted(self.folder.glob("*.rows"))
        with contextlib.ExitStack() as stack:
            readers = {path.stem: _Reader(stack.enter_context(path.open("rb"))) for path in paths}
            for minute in itertools.count(1):
                tables = {name: reader.until(minute * _MINUTE_S) for name, reader in readers.items()}
                if not len(tables["imu"]) or (minute - 1) * _MINUTE_S >= self.until_s:
                    return
                edges = (minute - 1) * _MINUTE_S + self.batch_s * np.arange(1, round(_MINUTE_S / self.batch_s) + 1)
                cuts = {name: np.append(0, np.searchsorted(rows[:, 0], edges)) for name, rows in tables.items()}
                for i in range(len(edges)):
                    parts = {name: rows[cuts[name][i] : cuts[name][i + 1]] for name, rows in tables.items()}
                    if batch := {name: rows for name, rows in parts.items() if len(rows)}:
                        yield Batch(batch)


class _Reader:
    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._columns = int(np.fromfile(self._file, count=1)[0])
        self._ahead = np.empty((0, self._columns))

    def until(self, end: float) -> Array:
        """The rows before ``end``, s, that have not been given yet."""
        while not len(self._ahead) or self._ahead[-1, 0] < end:
            more = np.fromfile(self._file, count=4096 * self._columns).reshape(-1, self._columns)
            if not len(more):
                break
            self._ahead = np.concatenate([self._ahead, more])
        count = int(np.searchsorted(self._ahead[:, 0], end))
        rows, self._ahead = self._ahead[:count], self._ahead[count:].copy()
        return rows


def write_rows(folder: Path, seed: int, duration_s: float) -> None:
    """Simulate, and leave the rows in files."""
    recording = simulate(SCENARIO, seed=seed, duration_s=duration_s).recording
    (folder / _DESCRIPTION).write_text(recording.description.model_dump_json(), encoding="utf-8")
    for name, rows in recording_rows(recording).tables().items():
        if len(rows):
            np.concatenate([[float(rows.shape[1])], rows.ravel()]).tofile(folder / f"{name}.rows")


_CONTROL = np.random.default_rng(0).normal(size=(60, 50))  # about what a step of two keyframes eliminates


def control() -> float:
    """The time, ms, of a computation that is always the same: small matrices and Python, as an update is."""
    start = time.thread_time()
    for _ in range(10):
        upper = np.linalg.qr(_CONTROL, mode="r")
        sums = {row: float(np.dot(upper[row], upper[row])) for row in range(len(upper))}
        sorted(sums, key=sums.__getitem__)
    return 1e3 * (time.thread_time() - start)


@one_thread()  # as a stream does that runs by itself
def stream(rows: Path, out: Path) -> tuple[pd.DataFrame, ...]:
    """``puts``, ``controls`` and ``memory``: times and numbers of keyframes of the batches; memory once a minute."""
    source, sink = RowFiles(rows), ParquetParts(out)
    intake, smoother = Intake.of(source), FixedLagSmoother(source.description, CONFIG, lag_s=LAG_S)
    kept = {name: out.with_suffix(f".{name}") for name in _KEPT}
    due = next_control = 0.0
    with contextlib.ExitStack() as stack:
        # In files: half a million numbers in memory would look like the stream's.
        files = {name: stack.enter_context(path.open("wb")) for name, path in kept.items()}
        for batch in source:
            start = time.thread_time()
            ready, events = intake.push(batch)
            estimates = smoother.put(ready)
            taken = time.thread_time() - start
            write_estimates(sink, estimates, (*events, *estimates.events))
            t = float(batch.tables["imu"][-1, 0]) if "imu" in batch.tables else np.nan
            files["puts"].write(np.array([t, 1e3 * taken, len(estimates.filtered)]).tobytes())
            if t >= next_control:
                files["controls"].write(np.array([t, control()]).tobytes())
                next_control += CONTROL_S
            if t >= due:
                gc.collect()
                files["memory"].write(np.array([t, _resident_mb()]).tobytes())
                due += _MINUTE_S
    return tuple(
        pd.DataFrame(np.fromfile(kept[name]).reshape(-1, len(columns)), columns=columns)
        for name, columns in _KEPT.items()
    )


def times_real_time(rows: Path, out: Path, hours: float, config: SmoothConfig) -> float:
    """Return how many times faster than real time so many hours go from their rows to Parquet parts."""
    source, start = RowFiles(rows, STORED_BATCH_S, 3600.0 * hours), time.process_time()
    run_stream(source, FixedLagSmoother(source.description, config, lag_s=LAG_S), ParquetParts(out))
    return 3600.0 * hours / (time.process_time() - start)


def _resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def per_minute(puts: pd.DataFrame, controls: pd.DataFrame, memory: pd.DataFrame) -> pd.DataFrame:
    """A row a minute: the median update with a keyframe, the mean of all batches and the median control, ms; memory."""
    minute = _minute(puts)
    return pd.DataFrame(
        {
            "update_ms": puts[puts["keyframes"] > 0].groupby(minute)["ms"].median(),
            "all_ms": puts.groupby(minute)["ms"].sum() * BATCH_S / _MINUTE_S,
            "control_ms": controls.groupby(_minute(controls))["ms"].median(),
            "mb": memory.groupby(_minute(memory))["mb"].first(),
        }
    )


def _minute(rows: pd.DataFrame) -> pd.Series:
    return (rows["t_s"] // _MINUTE_S).astype("Int64")


def beside_control(minutes: pd.DataFrame, column: str) -> pd.Series:
    """Times as they would be if the control had always taken what it took in the mean."""
    return minutes[column] / minutes["control_ms"] * minutes["control_ms"].mean()


def slope(minutes: pd.Series) -> tuple[float, float, float]:
    """Per hour, its sigma, and the mean, of values a minute."""
    kept = minutes.iloc[int(np.ceil(WARM_UP * len(minutes))) :].dropna()
    if len(kept) < 3:
        return np.nan, np.nan, np.nan
    line = stats.linregress(kept.index.to_numpy(dtype=np.float64) / 60.0, kept.to_numpy(dtype=np.float64))
    return float(line.slope), float(line.stderr), float(kept.mean())


def measure(seed: int, hours: float) -> dict[str, float]:
    """Everything that the lines of the table need."""
    with tempfile.TemporaryDirectory() as name:
        rows, out = Path(name) / "rows", Path(name) / "out"
        rows.mkdir()
        fresh = get_context("spawn")
        with ProcessPoolExecutor(1, mp_context=fresh) as pool:
            pool.submit(write_rows, rows, seed, 3600.0 * hours).result()
        with ProcessPoolExecutor(1, mp_context=fresh) as pool:
            puts, controls, memory = pool.submit(stream, rows, out).result()
        stored = min(hours, STORED_HOURS)
        speeds = {}
        for keyframes, config in (("same", CONFIG), ("default", SmoothConfig())):
            with ProcessPoolExecutor(1, mp_context=fresh) as pool:
                results = Path(name) / f"stored {keyframes}"
                speeds[f"times real time, {keyframes}"] = pool.submit(
                    times_real_time, rows, results, stored, config
                ).result()
    minutes = per_minute(puts, controls, memory)
    # The first keyframe of a stream is the batch of its first seconds.
    latency = puts.loc[puts["keyframes"] > 0, "ms"].iloc[1:]
    measured = {
        "hours": hours,
        "p50 ms": float(latency.quantile(0.5)),
        "p99 ms": float(latency.quantile(0.99)),
        "max ms": float(latency.max()),
        "longest ms": float(puts["ms"].iloc[int(latency.index[0]) :].max()),
        "first ms": float(puts.loc[puts["keyframes"] > 0, "ms"].iloc[0]),
        **speeds,
        "stored": stored,
    }
    for what, values in (
        ("update", beside_control(minutes, "update_ms")),
        ("all", beside_control(minutes, "all_ms")),
        ("control", minutes["control_ms"]),
        ("memory", minutes["mb"]),
    ):
        measured |= dict(zip((f"{what} slope", f"{what} sigma", f"{what} mean"), slope(values), strict=True))
    return measured


def figures(measured: pd.DataFrame) -> list[Figure]:
    """The lines of the part, of one seed."""
    of = measured.iloc[0]
    return [
        at_most("latency of a keyframe, median, ms", of["p50 ms"], P50_MS),
        at_most("latency of a keyframe, 99 %, ms", of["p99 ms"], P99_MS),
        Figure("latency of a keyframe, longest, ms", of["max ms"]),
        Figure("longest batch of any sort, ms", of["longest ms"]),
        Figure("the batch that ends the first seconds, ms", of["first ms"]),
        Figure(f"times real time, {of['stored']:g} h from a store", of["times real time, same"]),
        at_least(
            f"times real time, {of['stored']:g} h from a store, default keyframes",
            of["times real time, default"],
            TIMES_REAL_TIME,
        ),
        Figure(
            "the machine: growth of a fixed computation, of its mean",
            of["control slope"] * of["hours"] / of["control mean"],
        ),
        *_slopes(of, "update", "update beside it, median of a minute", "ms"),
        *_slopes(of, "all", "mean of all batches of a minute beside it", "ms"),
        *_slopes(of, "memory", "memory", "MB"),
        Figure("hours streamed", of["hours"]),
    ]


def _slopes(of: pd.Series, what: str, text: str, unit: str) -> list[Figure]:
    growth, sigma, mean = (
        of[f"{what} {part}"] * scale for part, scale in (("slope", of["hours"]), ("sigma", of["hours"]), ("mean", 1.0))
    )
    noise = max(NOISE * mean, 2.0 * sigma)
    return [
        Figure(f"{text}, {unit}", mean),
        Figure(
            f"{text}: growth over the run, {unit} (sigma {sigma:.2g})",
            growth,
            target=f"<= {noise:.2g}",
            met=bool(growth <= noise),
        ),
    ]


PART = Part(
    name="cost",
    title=f"Cost of an update: {SCENARIO}, 200 Hz, lag {LAG_S:g} s, a keyframe every 0.5 s, batches of {BATCH_S:g} s",
    measure=lambda seed: measure(seed, 6.0),
    figures=figures,
    alone=True,
)
