"""Measurements in worker processes with a progress bar, and the arguments of a benchmark over seeds."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Hashable, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import Any, TypeVar

from rich.console import Console
from rich.progress import track as progress_over

Key = TypeVar("Key", bound=Hashable)
Call = tuple[Callable[..., Any], tuple[Any, ...]]


def side_by_side(calls: Mapping[Key, Call], jobs: int, description: str = "seeds") -> dict[Key, Any]:
    """What each ``function(*arguments)`` gave, in ``jobs`` processes, in the order of ``calls``.

    A call that fails ends all at once. The progress bar shows on a terminal only.
    """
    console = Console(stderr=True)
    with ProcessPoolExecutor(jobs) as pool:
        futures = {pool.submit(function, *arguments): key for key, (function, arguments) in calls.items()}
        finished = progress_over(
            as_completed(futures),
            description,
            total=len(futures),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        )
        try:
            results = {futures[future]: future.result() for future in finished}
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return {key: results[key] for key in calls}


def add_seed_arguments(parser: argparse.ArgumentParser) -> None:
    """``--seeds``, ``--first-seed`` and ``--jobs``."""
    parser.add_argument("--seeds", type=int, default=20, help="how many (default: %(default)s)")
    parser.add_argument("--first-seed", type=int, default=0, metavar="SEED", help="default: %(default)s")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: %(default)s)")


def seeds_of(parser: argparse.ArgumentParser, arguments: argparse.Namespace) -> range:
    """The seeds asked for. Ends with a usage error where there are none, or no process."""
    if arguments.seeds < 1 or arguments.jobs < 1 or arguments.first_seed < 0:
        parser.error("expected one seed, one process or more, and no negative seed")
    return range(arguments.first_seed, arguments.first_seed + arguments.seeds)
