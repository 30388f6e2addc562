"""The frame of the benchmarks: parts, the lines of their tables, targets, and measurements in worker processes.

A part is a module with ``PART``, a :class:`Part`. It holds two functions of the module (by name: they cross to worker
processes):

* ``measure(seed) -> dict[str, float]``: everything measured on one seed, under names of the part's choice; it runs in a
  worker and returns nothing but floats (NaN: not to be had).
* ``figures(measured) -> list[Figure]``: the lines of the table from one row per seed, a column per name (index: seed).
  The papers' have a table, and so lines, of their own.

What is counted is pooled: the share of all curves of all seeds, not the mean of the seeds' shares.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Hashable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pandas as pd
from rich.console import Console
from rich.progress import track as progress_over

Key = TypeVar("Key", bound=Hashable)
Call = tuple[Callable[..., Any], tuple[Any, ...]]


@dataclass(frozen=True)
class Figure:
    """One line of a table. ``by_seed`` is the same of each seed; None where seeds say little by themselves."""

    quantity: str
    value: float
    by_seed: Sequence[float] | None = None
    target: str = "-"
    met: bool | None = None
    paper: str = "-"


@dataclass(frozen=True)
class Part:
    """One part of the benchmark. ``alone``: its times count, so it runs by itself, on the first seed only."""

    name: str
    title: str
    measure: Callable[[int], dict[str, float]]
    figures: Callable[[pd.DataFrame], list[Any]]
    notes: str = ""
    alone: bool = False


def at_most(
    quantity: str, value: float, limit: float, by_seed: Sequence[float] | None = None, *, paper: str = "-"
) -> Figure:
    """A figure that is to be at most ``limit``. What could not be measured does not meet it."""
    return Figure(quantity, value, by_seed, f"<= {limit:g}", bool(value <= limit), paper)


def below(quantity: str, value: float, limit: float, by_seed: Sequence[float] | None = None) -> Figure:
    """A figure that is to be less than ``limit``."""
    return Figure(quantity, value, by_seed, f"< {limit:g}", bool(value < limit))


def at_least(
    quantity: str, value: float, limit: float, by_seed: Sequence[float] | None = None, *, paper: str = "-"
) -> Figure:
    """A figure that is to be at least ``limit``."""
    return Figure(quantity, value, by_seed, f">= {limit:g}", bool(value >= limit), paper)


def between(quantity: str, value: float, low: float, high: float, by_seed: Sequence[float] | None = None) -> Figure:
    """A figure that is to lie from ``low`` to ``high``."""
    return Figure(quantity, value, by_seed, f"{low:g} - {high:g}", bool(low <= value <= high))


def ratio(measured: pd.DataFrame, part: str, whole: str) -> float:
    """The share of all seeds together; NaN where there is nothing to share."""
    total = measured[whole].sum()
    return float(measured[part].sum() / total) if total else np.nan


def pooled_rms(measured: pd.DataFrame, rms: str, count: str) -> float:
    """The rms over all seeds together, from that of each seed and how many errors it is of."""
    rows = measured[measured[count] > 0]
    return float(np.sqrt((rows[rms] ** 2 * rows[count]).sum() / rows[count].sum())) if len(rows) else np.nan


def yes_or_no(met: bool | None) -> str:
    """Whether a target is met, as the tables have it: empty where there is none."""
    return {True: "yes", False: "NO", None: ""}[met]


def table_of(part: Part, figures: Sequence[Figure]) -> pd.DataFrame:
    """A row per figure; ``least`` and ``greatest`` are of a seed."""
    rows = []
    for figure in figures:
        by_seed = np.asarray([] if figure.by_seed is None else figure.by_seed, dtype=np.float64)
        by_seed = by_seed[np.isfinite(by_seed)]
        rows.append(
            {
                "part": part.name,
                "quantity": figure.quantity,
                "paper": figure.paper,
                "value": figure.value,
                "least": by_seed.min() if by_seed.size else np.nan,
                "greatest": by_seed.max() if by_seed.size else np.nan,
                "target": figure.target,
                "met": yes_or_no(figure.met),
            }
        )
    return pd.DataFrame(rows)


def printed(table: pd.DataFrame) -> str:
    """A table of :func:`table_of` for reading: the value, then the range over seeds."""
    shown = pd.DataFrame(
        {
            "quantity": table["quantity"],
            "paper": table["paper"],
            "measured": table["value"].map(_text),
            "by seed": [
                "" if np.isnan(least) else f"{_text(least)} .. {_text(greatest)}"
                for least, greatest in zip(table["least"], table["greatest"], strict=True)
            ],
            "target": table["target"],
            "met": table["met"],
        }
    )
    return shown.to_string(index=False)


def show(part: Part, table: str, seeds: int | None = None) -> None:
    """Print a part's table under its title, and its notes below it."""
    count = "" if seeds is None else f"; {seeds} seed{'s' if seeds > 1 else ''}"
    print(f"\n{part.name}  {part.title}{count}\n\n{table}")
    if part.notes:
        print(f"\n{part.notes}")


def finish(tables: Sequence[pd.DataFrame], out: Path | None, start: float) -> None:
    """Say how long it took since ``start`` (of ``time.perf_counter``), and write all lines to a CSV file, if wanted."""
    print(f"\n{time.perf_counter() - start:.0f} s in all", file=sys.stderr)
    if out is not None:
        pd.concat(tables, ignore_index=True).to_csv(out, index=False)


def _text(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.3g}" if abs(value) < 1000.0 else f"{value:.0f}"


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
