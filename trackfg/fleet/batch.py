"""A batch computes what a plan says is missing or stale, and keeps the store's catalogue up to date meanwhile.

Each run is a job for the workers of :mod:`trackfg.fleet.workers`. The catalogue is written run by run. A batch that is
killed loses nothing but the runs under way, and the next one lists what the catalogue lacks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any

import tomli_w

from trackfg.errors import first_line
from trackfg.fleet.batch_progress import ALIVE_S, shown_progress
from trackfg.fleet.catalogue import Run
from trackfg.fleet.isolated_run import Job, Outcome
from trackfg.fleet.key_figures import done_row, failed_row
from trackfg.fleet.known_content import KnownContent
from trackfg.fleet.machine import processes
from trackfg.fleet.places import PlaceError, local_files
from trackfg.fleet.planning import PlannedRun
from trackfg.fleet.store import Store
from trackfg.fleet.workers import Submit, cluster, local_processes
from trackfg.results.result import RESULT_FOLDER

Progress = Callable[[Outcome], None]
"""Called with the outcome of each run that was computed."""


@dataclass(frozen=True)
class Limits:
    """Limits of a run's time and memory, and where runs are computed.

    They are computed by the cluster of ``scheduler``, or on this machine if that is None: ``jobs`` at a time, None for
    as many as cores and memory allow.
    """

    timeout_s: float | None
    memory_bytes: int
    jobs: int | None = None
    scheduler: str | None = None


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
    store.write(_listed(store, each.run) for each in planned if each.fresh and not each.listed)
    wanted = {each.run.name: each for each in planned if not each.fresh}
    outcomes: list[Outcome] = []
    with shown_progress(store.place, len(wanted)) as show, _workers(store, limits, len(wanted)) as submit:
        settings = {each.run.settings: each.settings for each in wanted.values()}
        texts = {place: tomli_w.dumps(values.model_dump(mode="json")) for place, values in settings.items()}
        jobs = (_job(each.run, store, texts[each.run.settings], limits) for each in wanted.values())
        for finished in _in_groups({submit(job): job.run.name for job in jobs}):
            store.write(_row(wanted[outcome.name].run, outcome) for outcome in finished)
            for outcome in finished:
                if outcome.row is not None and outcome.recording is not None:
                    known.remember(outcome.recording, outcome.row["files_sha256"])
                progress(outcome)
            known.save()
            outcomes += finished
            show(len(outcomes), sum(outcome.reason is not None for outcome in outcomes))
    return outcomes


def _workers(store: Store, limits: Limits, runs: int) -> AbstractContextManager[Submit]:
    if limits.scheduler is not None:
        return cluster(limits.scheduler, store.place)
    return local_processes(max(1, min(limits.jobs or processes(limits.memory_bytes), runs)))


def _job(run: Run, store: Store, settings: str, limits: Limits) -> Job:
    return Job(run, store.result(run.name), settings, timeout_s=limits.timeout_s, memory_bytes=limits.memory_bytes)


def _row(run: Run, outcome: Outcome) -> dict[str, Any]:
    return outcome.row or failed_row(run, outcome.reason or "", outcome.log)


def _listed(store: Store, run: Run) -> dict[str, Any]:
    """Return the row of a run whose result is there."""
    try:
        with local_files(store.result(run.name), RESULT_FOLDER.files) as folder:
            return done_row(run, folder)
    except (OSError, ValueError, PlaceError) as error:
        return failed_row(run, f"the result cannot be read: {first_line(error)}", "")


def _in_groups(futures: Mapping[Future[Outcome], str]) -> Iterator[list[Outcome]]:
    """Yield outcomes as runs end, in groups of those that ended meanwhile; an empty group where none does for a while.

    ``futures``: each with its run's name.
    """
    done: SimpleQueue[Future[Outcome]] = SimpleQueue()
    for future in futures:
        future.add_done_callback(done.put)
    remaining = len(futures)
    while remaining:
        finished = []
        with suppress(Empty):
            finished.append(done.get(timeout=ALIVE_S))
        while not done.empty():
            finished.append(done.get())
        remaining -= len(finished)
        yield sorted((_outcome(future, futures[future]) for future in finished), key=lambda outcome: outcome.name)


def _outcome(future: Future[Outcome], name: str) -> Outcome:
    error = future.exception()
    return future.result() if error is None else Outcome(name, f"{type(error).__name__}: {first_line(error)}")
