"""``trackfg import`` and ``trackfg init``: recordings of other systems become recordings of trackfg."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackfg.cli.terminal import note, tell

if TYPE_CHECKING:
    from trackfg.interchange.importing.conversion import Imported
    from trackfg.interchange.importing.proposal import Ask, Proposal, Question
    from trackfg.interchange.importing.source_format import DialectFor
    from trackfg.interchange.importing.source_table import SourceTable
    from trackfg.results.result import Result

Source = Annotated[
    Path, typer.Argument(metavar="SRC", help="File, folder or zip of the recording.", show_default=False)
]
Out = Annotated[Path, typer.Option("-o", "--out", metavar="REC", help="Folder for the recording.", show_default=False)]
Format = Annotated[
    str | None,
    typer.Option("--from", metavar="FORMAT", help="Its format; by default it is recognised.", show_default=False),
]

_MOST_NAMED = 12
"""Columns of a table that are not used and named: decoded CAN traces have hundreds."""


def import_recording(
    source: Source,
    out: Out,
    from_format: Format = None,
    mapping: Annotated[
        Path | None,
        typer.Option(metavar="M.toml", help="Which columns are what; by default it is guessed.", show_default=False),
    ] = None,
) -> None:
    """Turn a recording of another system into one of trackfg, or its track geometry into a result.

    Without a mapping, columns are recognised by their names and values, and what these do not show is assumed and
    listed. A table of track geometry by places, without inertial sensors, becomes a result without a trajectory.
    """
    from trackfg.interchange.importing.channels.measured_geometry import measured_result
    from trackfg.interchange.importing.channels.source_geometry import geometry_in
    from trackfg.interchange.importing.conversion import write_imported
    from trackfg.interchange.importing.mapping import read_mapping

    plan = None if mapping is None else read_mapping(mapping)
    measured = geometry_in(source, from_format, plan)
    if measured is not None:
        _report_geometry(measured_result(*measured), out)
    elif plan is None:
        proposal, made = _proposed(source, out, from_format, _assume)
        for key, reason in proposal.reasons.items():
            note(f"trackfg: note: {key}: {reason}")
        _report(made)
    else:
        tables = _tables(source, from_format or plan.source, plan.dialect)
        _report(write_imported(tables, plan, out, run_id=source.stem))


def init(
    source: Source,
    out: Out,
    from_format: Format = None,
    mapping: Annotated[
        Path | None,
        typer.Option(metavar="M.toml", help="Mapping to write; by default REC.mapping.toml.", show_default=False),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Take every default instead of asking.")] = False,
) -> None:
    """Look at a recording of another system, ask what its data cannot say, and import it.

    The answers go into a mapping, with which `trackfg import` repeats it without questions. Of a table of track
    geometry the mapping says which channel is what.
    """
    from trackfg.errors import BadInputError
    from trackfg.files.atomic_file import write_whole
    from trackfg.interchange.importing.channels.measured_geometry import measured_result
    from trackfg.interchange.importing.channels.source_geometry import geometry_in, geometry_mapping_text
    from trackfg.interchange.importing.proposal import mapping_text

    target = mapping or out.with_name(f"{out.name}.mapping.toml")
    if target.exists():
        raise BadInputError(f"{target}: exists; expected a new file. Hint: name another one with --mapping")
    measured = geometry_in(source, from_format, None)
    if measured is not None:
        _report_geometry(measured_result(*measured), out)
        write_whole(target, geometry_mapping_text(measured[1]).encode("utf-8"))
        tell(f"mapping: {target}")
        return
    proposal, made = _proposed(source, out, from_format, _assume if yes else _ask)
    write_whole(target, mapping_text(proposal).encode("utf-8"))
    tell(f"mapping: {target}")
    _report(made)


def _tables(source: Path, from_format: str | None, dialect_for: DialectFor) -> Sequence[SourceTable]:
    from trackfg.interchange.importing.registry import source_format

    return source_format(source, from_format).tables(source, dialect_for)


def _proposed(source: Path, out: Path, from_format: str | None, ask: Ask) -> tuple[Proposal, Imported]:
    """Propose a mapping and write the recording that it makes."""
    from trackfg.interchange.importing.conversion import write_imported
    from trackfg.interchange.importing.mapping import mapping_of
    from trackfg.interchange.importing.proposal import propose, unused_columns
    from trackfg.interchange.importing.registry import source_format

    form = source_format(source, from_format)
    tables = form.tables(source, lambda _: None)
    proposal = propose(tables, ask, form.mapping(tables))
    proposal.sections["source"] = form.key
    mapping = mapping_of(proposal.sections, "proposed mapping")
    for name, columns in unused_columns(proposal.sections, tables).items():
        more = f" and {len(columns) - _MOST_NAMED} more" if len(columns) > _MOST_NAMED else ""
        note(f"trackfg: note: not used of {name}: {', '.join(columns[:_MOST_NAMED])}{more}")
    return proposal, write_imported(tables, mapping, out, run_id=source.stem)


def _assume(question: Question) -> str:
    """Answer with the default, and say so."""
    note(f"trackfg: note: {question.text}: {question.default} is assumed ({question.key})")
    return question.default


def _ask(question: Question) -> str:
    """Ask in the terminal until the answer is one of the choices, or a number where the default is one."""
    from rich.markup import escape
    from rich.prompt import FloatPrompt, Prompt

    from trackfg.errors import BadInputError

    try:
        if question.choices:
            text = f"{escape(question.text)} [prompt.choices]({', '.join(question.choices)})[/]"
            return Prompt.ask(text, choices=list(question.choices), show_choices=False, default=question.default)
        if question.default.replace(".", "", 1).isdigit():
            return str(FloatPrompt.ask(escape(question.text), default=float(question.default)))
        return Prompt.ask(escape(question.text), default=question.default)
    except EOFError:
        raise BadInputError(
            f"{question.key}: nobody answers ({question.text}). Hint: take the defaults by --yes"
        ) from None


def _report_geometry(result: Result, out: Path) -> None:
    """Write the result of a channel table, and print what it holds and what was assumed of it."""
    from trackfg.cli import tables

    result.write(out)
    tell(tables.findings(result.summary.findings))
    chainage = result.geometry["chainage_m"]
    tell(f"geometry: {len(chainage)} rows from {chainage.iloc[0]:.2f} m to {chainage.iloc[-1]:.2f} m")
    tell(f"result: {out}")


def _report(made: Imported) -> None:
    """Print what was made and what is doubtful in it. Exit status 2 where something is wrong."""
    from trackfg.cli import tables

    tell(tables.findings(made.loaded.findings))
    for name, rows in made.rows.items():
        tell(f"{name}: {rows} rows")
    tell(f"recording: {made.folder}")
    if any(finding.level == "error" for finding in made.loaded.findings):
        raise typer.Exit(2)
