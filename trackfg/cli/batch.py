"""``trackfg batch``: many runs, each in a process of its own, into one store."""

from __future__ import annotations

import json as json_text
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from trackfg.cli.options import with_options
from trackfg.cli.terminal import complain, note, print_unless_quiet, shows_progress
from trackfg.errors import counted, printable

if TYPE_CHECKING:
    from trackfg.fleet.isolated_run import Outcome
    from trackfg.fleet.planning import PlannedRun
    from trackfg.fleet.store import Store

_FAILED = 1
"""Exit status where a run failed."""

_NAMED = 100
"""Failures that are named at the terminal, more than anyone reads: of a wrong path in a catalogue each run fails."""


@dataclass(frozen=True)
class BatchChoices:
    """The options of ``trackfg batch``."""

    places: Annotated[
        list[str], typer.Argument(metavar="CATALOGUE", help="A table of runs, recordings, or a pattern in quotes.")
    ]
    out: Annotated[
        str, typer.Option("-o", "--out", metavar="STORE", help="Folder or URL for results and their catalogue.")
    ]
    line: Annotated[str | None, typer.Option(metavar="NAME", help="Line of runs whose row names none.")] = None
    map_location: Annotated[
        str | None, typer.Option("--map", metavar="MAP", help="Map for runs whose row names none.")
    ] = None
    known_line: Annotated[str | None, typer.Option(metavar="FILE", help="Tracks of runs whose row names none.")] = None
    config: Annotated[str | None, typer.Option(metavar="C.toml", help="Settings of runs whose row names none.")] = None
    jobs: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, help="Runs at a time. As many as cores and memory allow if absent."),
    ] = None
    timeout: Annotated[float, typer.Option(metavar="S", min=0.0, help="Longest time for one run, s.")] = 14400.0
    memory: Annotated[float, typer.Option(metavar="GB", min=0.001, help="Most memory for one run, GB.")] = 4.0
    scheduler: Annotated[
        str | None, typer.Option(metavar="URL", help="Compute on a running dask.distributed cluster: tcp://HOST:8786.")
    ] = None
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what is to be computed and why, and stop.")] = False
    json: Annotated[bool, typer.Option("--json", help="Print JSON lines instead of text.")] = False


@with_options(BatchChoices)
def batch(options: BatchChoices) -> None:
    """Smooth many runs, each in a process of its own, and list them in the store's catalogue with their key figures.

    A result that is there and fresh is kept: the same recording, settings, version of the map and algorithm. A run that
    crashes, hangs or takes too much memory becomes a row with the reason; exit status 1 if there is one.
    """
    from trackfg.fleet.batch import Limits, run_batch
    from trackfg.fleet.catalogue import read_catalogue
    from trackfg.fleet.known_content import KnownContent
    from trackfg.fleet.planning import plan
    from trackfg.fleet.store import Store

    defaults = {
        "line": options.line,
        "map": options.map_location,
        "known_line": options.known_line,
        "settings": options.config,
    }
    runs = read_catalogue(options.places, {name: text for name, text in defaults.items() if text})
    store = Store(options.out, create=not options.dry_run)
    content = KnownContent(store.known_content)
    planned = plan(runs, store, content)
    _name_lost_lines(planned)
    if options.dry_run:
        sys.stdout.writelines(_planned_line(each, options.json) for each in planned)
        return
    wanted = sum(not each.fresh for each in planned)
    limits = Limits(
        timeout_s=options.timeout or None,
        memory_bytes=round(options.memory * 1e9),
        jobs=options.jobs,
        scheduler=options.scheduler,
    )
    with _progress(wanted) as progress:
        outcomes = run_batch(planned, store, content, limits, progress)
    failed = [outcome for outcome in outcomes if outcome.reason is not None]
    _name_copies(store, {outcome.name for outcome in outcomes if outcome.reason is None})
    if options.json:
        sys.stdout.writelines(_outcome_line(each.run.name, "fresh", None) for each in planned if each.fresh)
        sys.stdout.writelines(
            _outcome_line(outcome.name, "done" if outcome.reason is None else "failed", outcome.reason)
            for outcome in outcomes
        )
    else:
        print_unless_quiet(
            f"runs: {len(runs)}, fresh {len(runs) - wanted}, computed {wanted - len(failed)}, failed {len(failed)}"
        )
        print_unless_quiet(f"store: {options.out}")
    if failed:
        raise typer.Exit(_FAILED)


def _name_lost_lines(planned: Sequence[PlannedRun]) -> None:
    """Warn of runs that leave their line, since it is not named this time: a map of that line would miss them."""
    lost = Counter(each.lost_line for each in planned if each.lost_line)
    if not lost:
        return

    for line, runs in sorted(lost.items()):
        complain(
            f"trackfg: warning: {counted(runs, 'run')} of line {printable(line)} in the store: now of line unknown, "
            f"since none is named. Hint: --line {printable(line)}"
        )


def _name_copies(store: Store, computed: set[str]) -> None:
    """Name the runs of one recording that lies in several places, where one of them was computed: each counts."""
    runs = defaultdict(list)
    for row in store.read(("run", "status", "files_sha256")) if computed else ():
        if row["status"] == "done" and row["files_sha256"]:
            runs[row["files_sha256"]].append(row["run"])
    copies = sorted(sorted(names) for names in runs.values() if len(names) > 1 and not computed.isdisjoint(names))
    for first, *others in copies[:_NAMED]:
        note(f"trackfg: note: run {first} has the same files as {', '.join(others)}: one recording, listed for each")


def _planned_line(each: PlannedRun, json: bool) -> str:
    if json:
        page = {"run": each.run.name, "recording": each.run.recording, "fresh": each.fresh, "why": each.why}
        return json_text.dumps(page) + "\n"
    return f"{each.run.name}: {'fresh' if each.fresh else f'compute: {each.why}'}\n"


def _outcome_line(run: str, status: str, reason: str | None) -> str:
    return json_text.dumps({"run": run, "status": status, "reason": reason}) + "\n"


@contextmanager
def _progress(total: int) -> Iterator[Callable[[Outcome], None]]:
    """Name the first runs that fail; on a terminal show how many are done and how fast, the time left, and failures.

    Where the batch is interrupted, say how far it has come.
    """

    done = failed = 0

    def name_failure(outcome: Outcome, show: Callable[[str], None]) -> None:
        nonlocal done, failed
        done += 1
        if outcome.reason is None:
            return
        failed += 1
        if failed <= _NAMED:
            show(f"run {outcome.name} failed: {printable(outcome.reason)}")
        elif failed == _NAMED + 1:
            show("further runs that fail are in the store's catalogue, each with its reason")

    try:
        if not shows_progress() or total == 0:
            yield lambda outcome: name_failure(outcome, lambda text: complain(f"trackfg: warning: {text}"))
            return
        with _bar(total) as (show, advance):

            def update(outcome: Outcome) -> None:
                name_failure(outcome, show)
                advance(failed)

            yield update
    except KeyboardInterrupt:
        complain(f"trackfg: interrupted: {done} of {total} runs done. Hint: the same command goes on from there")
        raise


@contextmanager
def _bar(total: int) -> Iterator[tuple[Callable[[str], None], Callable[[int], None]]]:
    """Show a bar; give what prints a line above it, and what counts one run more, beside the number of failures."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    from trackfg.fleet.batch_progress import BatchState
    from trackfg.report.numbers import duration

    speed, failures = TextColumn("{task.fields[speed]}"), TextColumn("[red]{task.fields[failures]}")
    columns = (TextColumn("runs"), BarColumn(), MofNCompleteColumn(), speed, failures)
    began = time.time()
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("runs", total=total, speed="", failures="")

        def advance(failed: int) -> None:
            bar.advance(task)
            state = BatchState("", began, time.time(), total, int(bar.tasks[0].completed), failed)
            speed = f"{state.runs_per_minute:.3g} a minute, {duration(state.remaining_s or 0.0)} left"
            bar.update(task, speed=speed, failures=f"{failed} failed" if failed else "")

        yield lambda text: bar.console.print(text, markup=False, style="red"), advance
