"""Faults in a stream: what comes out must be whole, in time, and right again within its sigma.

A case is a kind and a seed, and can be run again by itself. It streams a run of a minute with one fault in it, in a
process of its own, so that even a crash of the interpreter or a hang is one result among others. Checked are

==========  ==========================================================================================================
crash       an exception, or the end of the process
hang        no result within ``CPU_S`` of the processor's time, or ``LONGEST_S`` of the clock
loss        rows in = rows used + rows in events; the smoothed table has every tenth of a second from first to last; a
            filtered row for every keyframe, up to the end; no NaN
before      filtered rows of before the fault are those of the run without it, bit by bit; where it is a kill or a disk
            that is full: what was written is whole, and resumed in the end all that is written without it
outside     from ``SETTLE_S`` after the fault on, roll, pitch, chainage and speed, filtered and smoothed, are within
            ``SIGMAS`` of the truth
==========  ==========================================================================================================
"""

from __future__ import annotations

import resource
import signal
import time
import traceback
import warnings
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait

import numpy as np
import pandas as pd

from streaming.arrivals import Stream
from streaming.base_cases import BASE_CASES, CONFIG, LAG_S, base_case
from streaming.fault_injection import DAMAGES, BaseCase, Damaged
from streaming.kill_and_resume import BREAKS
from streaming.run_tables import tables_of
from trackfg import FixedLagSmoother
from trackfg.numerics.arrays import Array
from trackfg.results.columns import TRAJECTORY_COLUMNS
from trackfg.streaming.stream_counts import StreamCounts

KINDS = (*DAMAGES, *BREAKS)
CHECKS = ("crash", "hang", "loss", "before", "outside")
CPU_S, LONGEST_S = 180, 3600.0
SETTLE_S = 5.0
SIGMAS = 4.0
_KEYFRAME_S = 0.7
"""Two keyframes are at most so far apart, s: half a second, or a little more up to a fix."""
_UNTOUCHED_S = 0.5
"""A filtered row needs rows 0.3 s younger than itself."""

JUDGED = {"roll_rad": 1e-4, "pitch_rad": 1e-4, "chainage_m": 0.02, "speed_mps": 0.005}
"""And by how much an error may exceed its sigmas: the truth's rows are 50 ms apart, and interpolated."""


@dataclass
class Outcome:
    """What came of one case. ``failed``: the checks that it did not pass, and why. ``z``: errors over sigma after the
    fault, by table and quantity.
    """

    kind: str
    seed: int
    ground: str = ""
    said: str = ""
    failed: dict[str, str] = field(default_factory=dict)
    z: dict[str, Array] = field(default_factory=dict)
    events: dict[str, int] = field(default_factory=dict)
    seconds: float = 0.0


@dataclass(frozen=True)
class Streamed:
    """What a stream gave."""

    counts: StreamCounts
    tables: dict[str, pd.DataFrame]


def streamed(stream: Stream) -> Streamed:
    """All of it through the smoother."""
    tables, counts = tables_of(stream.source(), FixedLagSmoother(stream.description, CONFIG, lag_s=LAG_S))
    return Streamed(counts, tables)


def case(kind: str, seed: int, undamaged: dict[str, dict[str, pd.DataFrame]]) -> Outcome:
    """One case; ``undamaged`` are the tables of the base cases."""
    rng = np.random.default_rng([seed, zlib.crc32(kind.encode())])
    base = base_case(BASE_CASES[seed % len(BASE_CASES)])
    outcome = Outcome(kind, seed, base.name)
    start = time.perf_counter()
    try:
        if kind in BREAKS:
            outcome.said, outcome.failed = BREAKS[kind](base, rng, undamaged[base.name])
        else:
            damaged = DAMAGES[kind](base, rng)
            outcome.said = f"{damaged.said} at {damaged.begin_s:.2f} s"
            with damaged.within:
                result = streamed(damaged.stream)
            outcome.events = dict(result.counts.events)
            judge(outcome, base, damaged, result, undamaged[base.name]["filtered"])
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        outcome.failed["crash"] = f"{type(error).__name__}: {error} ({place.filename}:{place.lineno})"[:300]
    outcome.seconds = time.perf_counter() - start
    return outcome


def judge(outcome: Outcome, base: BaseCase, damaged: Damaged, result: Streamed, reference: pd.DataFrame) -> None:
    """Fill in what was not passed, and the errors over sigma."""
    filtered, smoothed = result.tables.get("filtered"), result.tables.get("smoothed")
    if filtered is None or smoothed is None:
        outcome.failed["loss"] = "no rows at all"
        return
    losses = list(_losses(damaged, result, filtered, smoothed))
    ahead = float(filtered["t_s"].iloc[-1] - reference["t_s"].iloc[-1])
    if "clock" not in outcome.kind and abs(ahead) > 0.1 + _silent_at_end(damaged):
        losses.append(f"filtered rows end {-ahead:.2f} s early")
    if losses:
        outcome.failed["loss"] = "; ".join(losses)
    until = damaged.begin_s - _UNTOUCHED_S
    ours, reference_rows = (table[table["t_s"] < until].to_numpy() for table in (filtered, reference))
    if ours.shape != reference_rows.shape or not np.array_equal(ours, reference_rows):
        outcome.failed["before"] = (
            f"{len(ours)} filtered rows before {until:.2f} s differ from the {len(reference_rows)}"
        )
    outside = []
    for name, table in (("filtered", filtered), ("smoothed", smoothed)):
        later = table[table["t_s"] > damaged.end_s + ahead + SETTLE_S]
        for quantity, error, sd in errors(base, damaged, later, ahead):
            z = error / sd
            outcome.z[f"{name} {quantity}"] = z
            if not len(z):
                outside.append(f"no {name} rows after the fault")
            elif (worst := np.abs(z).max()) > SIGMAS:
                at = later["t_s"].iloc[int(np.abs(z).argmax())]
                outside.append(f"{name} {quantity} by {worst:.1f} sigma at {at:.1f} s")
    if outside:
        outcome.failed["outside"] = "; ".join(dict.fromkeys(outside))


def _silent_at_end(damaged: Damaged) -> float:
    """How much of the end of the stream may be missing, because its last rows came late."""
    return 2.0 if damaged.end_s > 50.0 else 0.0


def _losses(damaged: Damaged, result: Streamed, filtered: pd.DataFrame, smoothed: pd.DataFrame) -> Iterator[str]:
    counts, given = result.counts, sum(len(table.at) for table in damaged.stream.tables.values())
    events = result.tables.get("events")
    lost = 0 if events is None else int(events["rows"].sum())
    if counts.rows_in != given:
        yield f"{given} rows given, {counts.rows_in} taken"
    if counts.rows_in != counts.rows_used + lost:
        yield f"{counts.rows_in} rows in, {counts.rows_used} used, {lost} in events"
    if counts.keyframes != len(filtered):
        yield f"{counts.keyframes} keyframes, {len(filtered)} filtered rows"
    t = filtered["t_s"].to_numpy()
    if (np.diff(t) <= 0.0).any():
        yield "filtered rows are not in order"
    if np.diff(t).max() > _KEYFRAME_S:
        i = int(np.diff(t).argmax())
        yield f"no filtered row from {t[i]:.2f} to {t[i + 1]:.2f} s"
    tenths = np.round(10.0 * smoothed["t_s"].to_numpy()).astype(np.int64)
    if not np.array_equal(tenths, np.arange(tenths[0], tenths[-1] + 1)):
        yield f"smoothed rows do not follow each other: {len(tenths)} from {tenths[0] / 10:g} to {tenths[-1] / 10:g} s"
    if tenths[0] > 0 or 0.1 * tenths[-1] < t[-1] - 0.11:
        yield f"smoothed rows from {tenths[0] / 10:g} to {tenths[-1] / 10:g} s, filtered ones to {t[-1]:.2f} s"
    for name, table in (("filtered", filtered), ("smoothed", smoothed)):
        wrong = table[list(TRAJECTORY_COLUMNS)].columns[~np.isfinite(table.to_numpy()).all(axis=0)]
        if len(wrong):
            yield f"{name}: NaN in {', '.join(wrong)}"


def errors(base: BaseCase, damaged: Damaged, table: pd.DataFrame, ahead_s: float) -> Iterator[tuple[str, Array, Array]]:
    """Of each quantity the errors of the rows, less what cannot be known, and their sigmas."""
    truth, t = base.run.truth, table["t_s"].to_numpy() - ahead_s
    clock = truth["t_s"].to_numpy()
    for quantity, small in JUDGED.items():
        true = truth[quantity].to_numpy()
        rate = np.abs(np.interp(t, clock, np.gradient(true, clock)))
        error = table[quantity].to_numpy() - np.interp(t, clock, true)
        unsure = small + damaged.unsure_s * rate
        yield quantity, np.sign(error) * np.maximum(np.abs(error) - unsure, 0.0), table[f"{quantity}_sd"].to_numpy()


def undamaged(names: Sequence[str], jobs: int) -> dict[str, dict[str, pd.DataFrame]]:
    """The tables of some base cases as they are."""
    tables = dict(_each_in_a_process([(_undamaged, (name,)) for name in names], jobs))
    for i, name in enumerate(names):
        if "filtered" not in tables[i]:
            raise RuntimeError(f"{name} without any fault: {tables[i]}")
    return {name: tables[i] for i, name in enumerate(names)}


def _undamaged(name: str) -> dict[str, pd.DataFrame]:
    return streamed(base_case(name).stream).tables


def outcomes(cases: Sequence[tuple[str, int]], jobs: int) -> Iterator[Outcome]:
    """Of every case, as they come."""
    names = [name for i, name in enumerate(BASE_CASES) if any(seed % len(BASE_CASES) == i for _, seed in cases)]
    for name in names:
        base_case(name)  # here, for all processes
    references = undamaged(names, jobs)
    calls = [(case, (kind, seed, references)) for kind, seed in cases]
    for i, outcome in _each_in_a_process(calls, jobs):
        if isinstance(outcome, Outcome):
            yield outcome
        else:
            yield Outcome(*cases[i], BASE_CASES[cases[i][1] % len(BASE_CASES)], failed=outcome)


def _each_in_a_process(calls: Sequence[tuple[Callable, tuple]], jobs: int) -> Iterator[tuple[int, object]]:
    """The number of each call and what it gave, or ``{"crash": why}`` or ``{"hang": how long}``."""
    fork = get_context("fork")
    running: dict[Connection, tuple[int, object, float]] = {}
    waiting = list(enumerate(calls))[::-1]
    while waiting or running:
        while waiting and len(running) < jobs:
            i, (function, arguments) = waiting.pop()
            ours, child_end = fork.Pipe(duplex=False)
            process = fork.Process(target=_send, args=(child_end, function, arguments))
            process.start()
            child_end.close()
            running[ours] = (i, process, time.monotonic() + LONGEST_S)
        ready = wait(list(running), timeout=1.0)
        for pipe, (i, process, until) in list(running.items()):
            if pipe in ready:
                try:
                    yield i, pipe.recv()
                except EOFError:
                    process.join()
                    if process.exitcode == -signal.SIGXCPU:
                        yield i, {"hang": f"no result within {CPU_S} s of the processor's time"}
                    else:
                        yield i, {"crash": f"the process ended with {process.exitcode}"}
            elif time.monotonic() > until:
                process.kill()
                yield i, {"hang": f"no result within {LONGEST_S:g} s"}
            else:
                continue
            process.join()
            pipe.close()
            del running[pipe]


def _send(pipe: Connection, function: Callable, arguments: tuple) -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S + 10))
    warnings.simplefilter("ignore")  # what they warn of is found in the tables
    pipe.send(function(*arguments))
    pipe.close()
