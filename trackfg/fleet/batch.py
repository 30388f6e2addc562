"""A batch computes what a plan says is missing or stale, and keeps the store's catalogue up to date meanwhile.

Each run is a job for an executor of :mod:`concurrent.futures`, here a thread that waits for the run's own process. The
catalogue is written run by run. A batch that is killed loses nothing but the runs under way, and the next one lists
what the catalogue lacks.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import tomli_w

from trackfg.errors import first_line
from trackfg.fleet.catalogue import Run
from trackfg.fleet.isolated_run import Job, Outcome, run_isolated
from trackfg.fleet.key_figures import done_row, failed_row
from trackfg.fleet.known_content import KnownContent, Sight, sight
from trackfg.fleet.machine import processes
from trackfg.fleet.planning import PlannedRun
from trackfg.fleet.store import Store
from trackfg.io.content import content_files

Progress = Callable[[Outcome], None]
"""Called with the outcome of each run that was computed."""


@dataclass(frozen=True)
class Limits:
    """What a run may take at most, and how many run at a time here; as many as cores and memory allow for None."""

    timeout_s: float | None
    memory_bytes: int
    jobs: int | None = None


def run_batch(
    planned: Sequence[PlannedRun],
    store: Store,
    known: KnownContent,
    limits: Limits,
    progress: Progress = lambda outcome: None,
) -> list[Outcome]:
    """Compute what is not fresh, and list all in the store's catalogue. Returns the outcomes of what was computed.

    Nothing is raised for a run that fails: its outcome and its row in the catalogue have the reason.
    """
    store.write(_row(store, each.run, Outcome(each.run.name)) for each in planned if each.fresh and not each.listed)
    wanted = {each.run.name: each for each in planned if not each.fresh}
    outcomes: list[Outcome] = []
    with _executor(limits, len(wanted)) as (executor, stop):
        seen: dict[str, Sight] = {}

        def work(each: PlannedRun) -> Outcome:
            seen[each.run.name] = sight(each.run.recording, *content_files(each.run.recording))
            return run_isolated(_job(each, store, limits), stop)

        for finished in _in_groups({executor.submit(work, each): name for name, each in wanted.items()}):
            rows = [_row(store, wanted[outcome.name].run, outcome) for outcome in finished]
            store.write(rows)
            for row in rows:
                if digest := row["files_sha256"]:
                    known.remember(seen[row["run"]], digest)
            known.save()
            outcomes += finished
            for outcome in finished:
                progress(outcome)
    return outcomes


def _job(each: PlannedRun, store: Store, limits: Limits) -> Job:
    return Job(
        name=each.run.name,
        recording=each.run.recording,
        result=str(store.result(each.run.name)),
        settings=tomli_w.dumps(each.settings.model_dump(mode="json")),
        map=each.run.map,
        timeout_s=limits.timeout_s,
        memory_bytes=limits.memory_bytes,
    )


def _row(store: Store, run: Run, outcome: Outcome) -> dict[str, Any]:
    if outcome.reason is not None:
        return failed_row(run, outcome.reason, outcome.log)
    folder = store.result(run.name)
    try:
        return done_row(run, folder, str(folder.relative_to(store.folder)))
    except (OSError, ValueError) as error:
        return failed_row(run, f"the result cannot be read: {first_line(error)}", "")


@contextmanager
def _executor(limits: Limits, runs: int) -> Iterator[tuple[Executor, threading.Event]]:
    """Give threads that each wait for one process; with an exception, Ctrl-C included, all processes are ended."""
    stop = threading.Event()
    workers = max(1, min(limits.jobs or processes(limits.memory_bytes), runs))
    with ThreadPoolExecutor(workers, thread_name_prefix="run") as pool:
        try:
            yield pool, stop
        except BaseException:
            stop.set()
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _in_groups(names: Mapping[Future[Outcome], str]) -> Iterator[list[Outcome]]:
    """Yield outcomes as they come, those that came meanwhile together."""
    pending = set(names)
    while pending:
        done, pending = wait(pending, return_when="FIRST_COMPLETED")
        yield sorted((_outcome(future, names[future]) for future in done), key=lambda outcome: outcome.name)


def _outcome(future: Future[Outcome], name: str) -> Outcome:
    error = future.exception()
    return future.result() if error is None else Outcome(name, f"{type(error).__name__}: {first_line(error)}")
