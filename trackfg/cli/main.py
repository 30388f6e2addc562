"""The command line: arguments in, calls to the library, tables for people out. Nothing is computed here.

Exit status: 0 done, 2 bad input or usage, 3 written but not to be trusted, 1 anything else, 130 interrupted. What a
command needs is imported when it runs, so that ``--help`` and ``--version`` answer at once.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.main import get_command

from trackfg import __version__
from trackfg.cli.balises import balises
from trackfg.cli.batch import batch
from trackfg.cli.browse.command import browse
from trackfg.cli.comparing import baseline, compare, estimators
from trackfg.cli.exits import exit_statuses
from trackfg.cli.exporting import export
from trackfg.cli.importing.commands import import_recording, init
from trackfg.cli.mapping.maps import maps
from trackfg.cli.options import (
    Commands,
    Json,
    Quiet,
    RecordingFolder,
    newest_map,
    with_options,
)
from trackfg.cli.overlay import overlay
from trackfg.cli.plotting import plot
from trackfg.cli.reporting import limits, report
from trackfg.cli.sensors.noise import noise
from trackfg.cli.smoothing.options import SmoothOptions
from trackfg.cli.smoothing.settings import config
from trackfg.cli.statistics import statistics
from trackfg.cli.stream import stream
from trackfg.cli.terminal import (
    columns,
    command,
    complain,
    next_step,
    note,
    print_unless_quiet,
    progress_bar,
    set_quiet,
    show,
    titled,
)
from trackfg.errors import BadInputError

if TYPE_CHECKING:
    from trackfg.results.result import Result

app = Commands()
_NOT_TO_BE_TRUSTED = 3
"""Exit status of a command that wrote what is not to be trusted."""


def main() -> None:
    """Run the command line."""
    with exit_statuses():
        command_line()(prog_name="trackfg")


@cache
def command_line() -> Callable[..., Any]:
    """Return all commands as one, made of their functions: the processes that this one forks need not make it anew."""
    return get_command(app)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"trackfg {__version__}")
        raise typer.Exit


_FIRST_STEPS = (
    "With a log of your own: trackfg init log.csv -o run1, then trackfg smooth run1 -o out1, then trackfg report out1. "
    "Without one: trackfg demo. Each command has an example: trackfg COMMAND --help."
)


@app.callback(epilog=_FIRST_STEPS)
def trackfg(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Railway track geometry and train positioning from IMU and tachometer, by factor-graph smoothing."""
    set_quiet(quiet)


@app.command(example="trackfg demo -o demo", loads="trackfg.cli.demo")
def demo(
    out: Annotated[Path, typer.Option("-o", "--out", metavar="DIR", help="Folder to write.")] = Path("trackfg-demo"),
) -> None:
    """Simulate a measuring car, smooth its recording, and compare the published systems with it, against the truth."""
    from trackfg.cli import comparison_tables, tables
    from trackfg.cli.demo import CONTENT, run_demo

    with progress_bar() as progress:
        done = run_demo(out, progress=progress)
    _warn_unless_converged(done.result)
    print_unless_quiet(*comparison_tables.of_comparison(done.comparison.about), tables.summary(done.result))
    print_unless_quiet(*(str(done.folder / name) for name in CONTENT))


@app.command(example="trackfg scenarios")
def scenarios() -> None:
    """List the built-in scenarios that simulate can run."""
    from rich.text import Text

    table = titled("Scenarios", *columns("name", no_wrap=True), "what it is")
    for name, summary in _scenario_summaries().items():
        table.add_row(Text(name), Text(summary))
    show(table)


def _scenario_summaries() -> dict[str, str]:
    """Return what each scenario is by its name, without importing ``trackfg.datasets``, which takes a second."""
    spec = find_spec("trackfg.datasets")
    assert spec is not None
    assert spec.origin is not None
    return tomllib.loads(Path(spec.origin).with_name("summaries.toml").read_text(encoding="utf-8"))


@app.command(example="trackfg simulate mainline -o run1 --seed 3 --duration 600", loads="trackfg.datasets.scenarios")
def simulate(
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO", help="One of `trackfg scenarios`.", autocompletion=lambda: list(_scenario_summaries())
        ),
    ],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="REC", help="Folder for the recording.")],
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Another track, and all that runs on it.")] = 0,
    run: Annotated[
        int, typer.Option(metavar="N", min=0, help="Another run on the same track: other driving, other sensor errors.")
    ] = 0,
    duration: Annotated[
        float | None, typer.Option(metavar="S", help="Length in seconds, instead of the scenario's own.")
    ] = None,
    line: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Run on this line: a description (.toml) or LandXML (.xml).")
    ] = None,
    alignment: Annotated[str | None, typer.Option(metavar="NAME", help="The alignment, of several in LandXML.")] = None,
) -> None:
    """Write the recording that a simulated vehicle would make, with the truth beside it."""
    from trackfg.datasets.line.line_file import read_line_file
    from trackfg.datasets.scenarios import scenario as named
    from trackfg.datasets.scenarios import simulate as run_scenario
    from trackfg.files.atomic_folder import replaced_folder
    from trackfg.files.owned_folder import refuse_used

    refuse_used(out, "recordings are never overwritten")
    plan = named(scenario)
    if alignment is not None and line is None:
        raise BadInputError("--alignment chooses one of a LandXML file: expected --line too")
    if line is not None:
        given = read_line_file(line, alignment)
        for remark in given.remarks:
            note(f"trackfg: note: {line}: {remark}")
        plan = plan.on(given)
    with progress_bar() as progress:
        simulation = run_scenario(plan, seed=seed, run=run, duration_s=duration, progress=progress)
        with replaced_folder(out) as new:
            simulation.write(new)
    print_unless_quiet(f"recording: {out}")
    next_step(command("check", out), command("smooth", out, "-o", f"{out}-out"))


@app.command(example="trackfg check run1", loads="trackfg.io.check")
def check(recording: RecordingFolder, json: Json = False) -> None:
    """List everything that is wrong or doubtful in a recording, each with a hint.

    Also listed is what the data say by themselves. Exit status 2 if anything is wrong.
    """
    from trackfg.cli import tables
    from trackfg.io.check import check_recording

    with progress_bar() as progress:
        report = check_recording(recording, progress=progress)
    if json:
        print(tables.check_json(report))
    else:
        show(tables.findings(report.findings))
        if report.estimates:
            show(tables.estimates(report.estimates))
    if any(finding.level == "error" for finding in report.findings):
        raise typer.Exit(2)
    next_step(command("smooth", recording, "-o", f"{recording}-out"))


@app.command(example="trackfg smooth run1 -o out1", loads="trackfg.smoothing.smoother")
@with_options(SmoothOptions)
def smooth(options: SmoothOptions) -> None:
    """Smooth a recording: trajectory, track geometry and events, each with its uncertainty, and a summary.

    The summary says of each quantity whether its sigmas can be trusted. Exit status 3 if none can, since the solution
    did not converge. An earlier result in OUT is replaced in one step: until then, and if anything fails, it stays as
    it is.
    """
    from trackfg.cli import tables
    from trackfg.config import SmoothConfig
    from trackfg.io.reader import read_recording
    from trackfg.results.result import RESULT_FOLDER
    from trackfg.smoothing.smoother import smooth as run_smoother

    RESULT_FOLDER.refuse_foreign(options.out)
    settings = SmoothConfig.from_toml(options.config) if options.config else None
    feature_map = newest_map(options.map_location)
    known_line = options.known_line()
    with options.bounded_memory():
        with progress_bar(of_all=False) as progress:
            result = run_smoother(
                read_recording(options.recording),
                settings,
                feature_map=feature_map,
                known_line=known_line,
                progress=progress,
            )
        result.write(options.out)
    _warn_unless_converged(result)
    _warn_unless_located(result)
    if options.json:
        print(result.summary.model_dump_json(indent=2))
    else:
        print_unless_quiet(tables.summary(result), *tables.verdicts(result))
        if result.summary.findings:
            print_unless_quiet(tables.findings(result.summary.findings))
        print_unless_quiet(f"result: {options.out}")
        next_step(command("report", options.out))
    if not result.summary.converged:
        raise typer.Exit(_NOT_TO_BE_TRUSTED)


def _warn_unless_converged(result: Result) -> None:
    if not result.summary.converged:
        complain(f"trackfg: warning: not converged: {result.summary.reason}")


def _warn_unless_located(result: Result) -> None:
    for finding in result.summary.findings:
        if finding.code == "not-on-map":
            hint = "" if finding.hint is None else f". Hint: {finding.hint}"
            complain(f"trackfg: warning: {finding.message}{hint}")


app.command(example="trackfg baseline complementary run1 -o out1-complementary", loads="trackfg.comparison.estimators")(
    baseline
)
app.command(example="trackfg estimators", loads="trackfg.comparison.estimators")(estimators)
app.command(example="trackfg compare run1 -o comparison", loads="trackfg.comparison.run")(compare)
app.command(example="trackfg plot out1 --from 12000 --to 14000 -o chart.html", loads="trackfg.plots.strip_chart")(plot)
app.command(
    example="trackfg limits out1 --limits cfr-213-class-4 -o exceedances.csv",
    loads="trackfg.report.track_limits",
)(limits)
app.command(example="trackfg report out1 --recording run1 --limits cfr-213-class-4", loads="trackfg.report")(report)
app.command(
    "import",
    example="trackfg import log.csv -o run1 --mapping log.mapping.toml",
    loads="trackfg.interchange.importing.conversion",
)(import_recording)
app.command(example="trackfg init log.csv -o run1", loads="trackfg.interchange.importing.conversion")(init)
app.command(example="trackfg stream run1 --lag 10 -o out1", loads="trackfg.streaming.fixed_lag")(stream)
app.command(example="trackfg batch runs.csv -o store", loads="trackfg.fleet.batch")(batch)
app.command(example="trackfg browse store", loads="trackfg.cli.browse.pages")(browse)
app.command(example="trackfg statistics out1 -o statistics.csv", loads="trackfg.report.track_statistics")(statistics)
app.command(example="trackfg overlay car1.csv car2.csv -o overlay1", loads="trackfg.mapping.runs.run_overlay")(overlay)
app.command(
    example="trackfg balises out1 out2 --planned register.csv -o survey.csv",
    loads="trackfg.mapping.runs.balise_survey",
)(balises)
app.command(example="trackfg noise rest.csv -o allan.png", loads="trackfg.interchange.importing.sensor_log")(noise)
app.command(example="trackfg export out1 --to gpkg", loads="trackfg.interchange.exporting.export")(export)
app.command(example="trackfg config > settings.toml")(config)
app.add_typer(maps, name="map")
