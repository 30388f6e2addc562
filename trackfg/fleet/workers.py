"""Runs are computed by processes of this machine, or by the workers of a dask cluster that runs already.

Both take jobs and give futures; what a job does is the same (:mod:`trackfg.fleet.isolated_run`).
"""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from uuid import uuid4

from trackfg.errors import BadInputError, TrackfgError, first_line
from trackfg.fleet.freshness import algorithm
from trackfg.fleet.isolated_run import ATTEMPTS, Job, Outcome, run_isolated
from trackfg.fleet.places import exists, is_url, joined, read, remove, write

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
def cluster(address: str, store: str) -> Iterator[Submit]:
    """Give the workers of a running cluster, which see what this machine sees, for runs into a store.

    Raises :class:`BadInputError` where there is no scheduler, and where a worker has other versions of what computes.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise TrackfgError("a cluster needs dask.distributed: pip install 'trackfg[fleet]'") from error
    try:
        client = Client(address, timeout=_CONNECTING_S)
    except (OSError, ValueError) as error:
        raise BadInputError(f"{address}: no scheduler of dask.distributed answers: {first_line(error)}") from error
    tallies = joined(store, f".begun-{uuid4().hex}")
    try:
        for worker, versions in client.run(algorithm).items():
            if versions != algorithm():
                raise BadInputError(f"worker {worker} has {versions}, this is {algorithm()}: expected the same")
        with client.get_executor(pure=False) as executor:
            yield lambda job: executor.submit(run_on_worker, job, joined(tallies, job.run.name))
    finally:
        client.close()
        if not is_url(tallies):
            shutil.rmtree(tallies, ignore_errors=True)


def run_on_worker(job: Job, tally: str) -> Outcome:
    """Smooth a run on a worker, unless as many workers that had begun it were lost as it may be begun.

    ``tally`` is a file with a letter for each time that the run was begun; it is removed when the run ends. The
    scheduler's own count would include the times that the run only waited on a lost worker.
    """
    begun = read(tally) if exists(tally) else b""
    if len(begun) >= ATTEMPTS:
        outcome = Outcome(job.run.name, f"its worker was lost {ATTEMPTS} times")
    else:
        write(tally, begun + b".")
        outcome = run_isolated(job)
    remove(tally)
    return outcome
