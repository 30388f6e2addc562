"""Runs are computed by processes of this machine, or by the workers of a dask cluster that runs already.

Both take jobs and give futures; what a job does is the same (:mod:`trackfg.fleet.isolated_run`).
"""

from __future__ import annotations

import shutil
import tempfile
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

from trackfg.errors import BadInputError, TrackfgError, first_line
from trackfg.fleet.freshness import algorithm
from trackfg.fleet.isolated_run import ATTEMPTS, Job, Outcome, run_isolated

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
def cluster(address: str, scratch: Path) -> Iterator[Submit]:
    """Give the workers of a running cluster, which see this machine's files; ``scratch`` is a folder for them.

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
    tallies = Path(tempfile.mkdtemp(prefix=".begun-", dir=scratch))
    try:
        for worker, versions in client.run(algorithm).items():
            if versions != algorithm():
                raise BadInputError(f"worker {worker} has {versions}, this is {algorithm()}: expected the same")
        with client.get_executor(pure=False) as executor:
            yield lambda job: executor.submit(run_on_worker, job, str(tallies / job.name))
    finally:
        client.close()
        shutil.rmtree(tallies, ignore_errors=True)


def run_on_worker(job: Job, tally: str) -> Outcome:
    """Smooth a run on a worker, unless workers that had begun it were lost as often as it may be begun.

    ``tally`` is a file with a letter for each time that it was: a scheduler does not tell, and would count the runs
    that only waited on a lost worker too.
    """
    with Path(tally).open("ab") as file:
        file.write(b".")
        begun = file.tell()
    if begun > ATTEMPTS:
        return Outcome(job.name, f"its worker was lost {ATTEMPTS} times")
    return run_isolated(job)
