"""``trackfg estimators``, ``trackfg baseline`` and ``trackfg compare``: the smoother beside the published systems."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from trackfg.cli.options import Json, RecordingFolder, with_options
from trackfg.cli.terminal import command, next_step, note, print_unless_quiet, progress_bar, show, working


def baseline(
    name: Annotated[str, typer.Argument(metavar="NAME", help="One of `trackfg estimators`.")],
    recording: RecordingFolder,
    out: Annotated[Path, typer.Option("-o", "--out", metavar="OUT", help="Folder for its tables.")],
    as_printed: Annotated[
        bool, typer.Option("--as-printed", help="With the equations as the paper prints them, errors included.")
    ] = False,
) -> None:
    """Run one published system on a recording: trajectory, geometry and events, as far as it knows them."""
    from trackfg.comparison.estimators import estimator, refuse_foreign
    from trackfg.io.reader import read_recording

    run = estimator(name, as_printed=as_printed)
    refuse_foreign(out)
    with working(name):
        run(read_recording(recording)).write(out)
    print_unless_quiet(f"result: {out}")


def estimators() -> None:
    """List the smoother, the published systems, and other packages where they are installed."""
    from trackfg.cli import tables
    from trackfg.comparison.estimators import estimators as all_estimators

    show(tables.estimators(all_estimators()))


@dataclass(frozen=True)
class CompareOptions:
    """The options of ``trackfg compare``."""

    out: Annotated[Path, typer.Option("-o", "--out", metavar="OUT", help="Folder for the comparison.")]
    recordings: Annotated[list[Path] | None, typer.Argument(metavar="REC", help="Folders of recordings.")] = None
    scenarios: Annotated[
        list[str] | None,
        typer.Option(
            "--scenario",
            metavar="NAME",
            help="A scenario to simulate, or j-turn; may be given again. A standard set if there is no REC either.",
        ),
    ] = None
    seeds: Annotated[int, typer.Option(metavar="N", min=1, help="Runs of each scenario.")] = 3
    duration: Annotated[
        float | None,
        typer.Option(metavar="S", help="Length of every simulated run, s; that of its scenario if absent."),
    ] = None
    jobs: Annotated[int | None, typer.Option(metavar="N", min=1, help="Processes. As many as cores if absent.")] = None
    peers: Annotated[
        bool, typer.Option("--peers", help="Run other packages too, where they are installed: some are slow.")
    ] = False
    json: Json = False


@with_options(CompareOptions)
def compare(options: CompareOptions) -> None:
    """Run every applicable estimator on recordings or built-in scenarios, and score them by one code.

    Against the truth where there is one; recordings without are held against the first of them. Of a single one, a part
    of the fixes, GNSS positions or tachometer rows is withheld at a time, and predicted. An earlier comparison in OUT
    is replaced in one step.
    """
    from trackfg.cli import comparison_tables
    from trackfg.comparison.run import cases_of
    from trackfg.comparison.run import compare as run_comparison
    from trackfg.comparison.table import COMPARISON_FOLDER

    COMPARISON_FOLDER.refuse_foreign(options.out)
    cases = cases_of(
        options.recordings or (), options.scenarios or (), seeds=options.seeds, duration_s=options.duration
    )
    withheld = sum(case.kind == "withheld" for case in cases)
    if withheld:
        runs = f"every estimator runs {withheld + 1} times, with a part of the measurements withheld"
        note(f"trackfg: note: no truth: {runs}")
    with progress_bar() as progress:
        result = run_comparison(cases, peers=options.peers, jobs=options.jobs or os.cpu_count() or 1, progress=progress)
    result.write(options.out)
    if options.json:
        print(result.about.model_dump_json(indent=2))
        return
    print_unless_quiet(*comparison_tables.of_comparison(result.about), f"comparison: {options.out}")
    next_step(command("report", options.out))
