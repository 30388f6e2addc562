"""Runs are computed by processes of this machine, or by the workers of a dask cluster that runs already.

Both take jobs and give futures; what a job does is the same (:mod:`trackfg.fleet.isolated_run`). Both also call a
function with many items, as ``map`` does: that is how maps are made of runs.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from typing import TYPE_CHECKING
from uuid import uuid4

from trackfg.errors import BadInputError, TrackfgError, first_line
from trackfg.fleet.die_with_parent import die_with
from trackfg.fleet.freshness import algorithm
from trackfg.fleet.isolated_run import ATTEMPTS, Job, Outcome, run_isolated
from trackfg.fleet.places import exists, is_url, joined, read, remove, write

if TYPE_CHECKING:
    from distributed import Client

    from trackfg.mapping.joining.build import Mapped

Submit = Callable[[Job], "Future[Outcome]"]

_CONNECTING_S = 30.0
"""Longest time to reach a scheduler, s."""


@contextmanager
def local_processes(number: int) -> Iterator[Submit]:
    """Give threads that each wait for one process; with an exception, Ctrl-C included, all processes are ended."""
    stop = threading.Event()
    with ThreadPoolExecutor(number, thread_name_prefix="run") as pool:
        try:
            yield lambda job: pool.submit(run_isolated, job, stop)
        except BaseException:
            stop.set()
            pool.shutdown(wait=False, cancel_futures=True)
            raise


@contextmanager
def mapped_here(number: int) -> Iterator[Mapped]:
    """Give a ``map`` that calls its function in so many processes; in this one, if that is one."""
    if number == 1:
        yield map
        return
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(number, mp_context=fresh, initializer=die_with, initargs=(os.getpid(),)) as pool:
        yield pool.map


@contextmanager
def mapped_on_cluster(address: str) -> Iterator[Mapped]:
    """Give a ``map`` that calls its function on the workers of a cluster. Raises as :func:`cluster`."""
    with _connected(address) as client, client.get_executor(pure=False) as executor:
        yield executor.map


@contextmanager
def cluster(address: str, store: str) -> Iterator[Submit]:
    """Give the workers of a running cluster, which see what this machine sees, for runs into a store.

    Raises :class:`BadInputError` where there is no scheduler, and where a worker has other versions of what computes.
    """
    tallies = joined(store, f".begun-{uuid4().hex}")
    try:
        with _connected(address) as client, client.get_executor(pure=False) as executor:
            yield lambda job: executor.submit(run_on_worker, job, joined(tallies, job.run.name))
    finally:
        if not is_url(tallies):
            shutil.rmtree(tallies, ignore_errors=True)


@contextmanager
def _connected(address: str) -> Iterator[Client]:
    """Give a client of a running cluster whose workers all have the versions that are here, but for lost ones."""
    try:
        from distributed import Client
    except ImportError as error:
        raise TrackfgError("a cluster needs dask.distributed: pip install 'trackfg[fleet]'") from error
    try:
        client = Client(address, timeout=_CONNECTING_S)
    except (OSError, ValueError) as error:
        raise BadInputError(f"{address}: no scheduler of dask.distributed answers: {first_line(error)}") from error
    try:
        for worker, versions in client.run(algorithm, on_error="return").items():
            if isinstance(versions, OSError):  # it was lost meanwhile; others compute its runs
                continue
            if isinstance(versions, Exception):
                raise BadInputError(f"worker {worker} cannot compute: {first_line(versions)}") from versions
            if versions != algorithm():
                raise BadInputError(f"worker {worker} has {versions}, this is {algorithm()}: expected the same")
        yield client
    finally:
        client.close()


def run_on_worker(job: Job, tally: str) -> Outcome:
    """Smooth a run on a worker, unless as many workers that had begun it were lost as it may be begun.

    ``tally`` is a file with a letter for each time that the run was begun; it is removed when the run ends. The
    scheduler's own count would include the times that the run only waited on a lost worker.
    """
    marks = read(tally) if exists(tally) else b""
    if len(marks) >= ATTEMPTS:
        outcome = Outcome(job.run.name, f"its worker was lost {ATTEMPTS} times")
    else:
        write(tally, marks + b".")
        outcome = run_isolated(job)
    remove(tally)
    return outcome
