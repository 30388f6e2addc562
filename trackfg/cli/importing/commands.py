"""``trackfg import`` and ``trackfg init``: recordings of other systems become recordings of trackfg."""

from __future__ import annotations

import sys
from collections.abc import Container
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackfg.cli.importing.many_logs import errors_in, import_each, imported, name_of
from trackfg.cli.importing.notes import notes_of, notes_of_geometry, notes_of_unused, print_notes
from trackfg.cli.terminal import (
    command,
    interruptible,
    next_step,
    note,
    print_unless_quiet,
    titled,
    working,
)

if TYPE_CHECKING:
    from typing import TextIO

    from rich.console import Console
    from rich.table import Table
    from rich.text import TextType

    from trackfg.interchange.importing.conversion import Imported
    from trackfg.interchange.importing.geometry_reading import GeometryReading
    from trackfg.interchange.importing.proposals.questions import Ask, Proposal, Question
    from trackfg.interchange.importing.source_format import SourceFormat
    from trackfg.interchange.importing.source_table import SourceTable
    from trackfg.results.result import Result

Source = Annotated[Path, typer.Argument(metavar="SRC", help="File, folder or zip of the recording.")]
Sources = Annotated[
    list[Path], typer.Argument(metavar="SRC...", help="File, folder or zip of a recording; several with a mapping.")
]
Out = Annotated[Path, typer.Option("-o", "--out", metavar="REC", help="Folder for the recording.")]
OutOfEach = Annotated[
    Path, typer.Option("-o", "--out", metavar="REC", help="Folder for the recording; of several sources for them all.")
]
Format = Annotated[
    str | None, typer.Option("--from", metavar="FORMAT", help="Format of the source; by default it is recognised.")
]

_SHOWN = {
    "imu": {
        "time": ("time", "time_unit"),
        "time_zone": ("its zone", ""),
        "gyro": ("gyro", "gyro_unit"),
        "accel": ("accelerometer", "accel_unit"),
        "axes": ("axes", ""),
        "mount_rpy_deg": ("turned by", ""),
        "rigid": ("follows the track", ""),
    },
    "tach": {"column": ("wheel", "unit"), "pulses_per_rev": ("pulses per turn", ""), "signed": ("knows direction", "")},
    "gnss": {"position": ("positions", ""), "crs": ("their reference system", ""), "sd": ("their sigmas", "")},
    "gnss_speed": {"column": ("receiver's speed", "unit"), "sd": ("its sigma", "unit")},
    "balises": {"id": ("balises", ""), "chainage": ("their places", "chainage_unit")},
    "fixes": {"chainage": ("fixes", "chainage_unit"), "sd": ("their sigma", "")},
    "track": {"gauge_m": ("gauge, m", "")},
}
"""What is shown of a proposed mapping: by section and key its name, and the key of its unit."""


def import_recording(
    sources: Sources,
    out: OutOfEach,
    from_format: Format = None,
    mapping: Annotated[
        Path | None, typer.Option(metavar="M.toml", help="Which columns are what; by default it is guessed.")
    ] = None,
) -> None:
    """Turn a recording of another system into one of trackfg, or its track geometry into a result.

    Without a mapping, columns are recognised by their names and values, and what these do not show is assumed and
    listed. A table of track geometry by places, without inertial sensors, becomes a result without a trajectory.

    Several sources of one device become recordings of their names in one folder, by one mapping. Those that are there
    already are left as they are; exit status 1 if one fails.
    """
    from trackfg.errors import BadInputError
    from trackfg.interchange.importing.channels.source_geometry import geometry_in, source_tables
    from trackfg.interchange.importing.mapping import read_mapping

    plan = None if mapping is None else read_mapping(mapping)
    if len(sources) > 1:
        if plan is None:
            first = command("init", sources[0], "-o", out / name_of(sources[0]), "--mapping", "device.toml")
            raise BadInputError(
                f"--mapping: several sources are imported by one mapping; expected one. Hint: make it by: {first}"
            )
        import_each(sources, out, from_format, plan)
        return
    (source,) = sources
    if plan is not None:
        with working("reading"):
            made, notes = imported(source, out, from_format, plan)
        print_notes(notes)
        _report(made, out)
        return
    with working("reading"):
        form, tables = source_tables(source, from_format, None)
        measured = geometry_in(tables, None, source.stem)
    if measured is not None:
        _write_geometry(*measured, out)
        return
    proposal, proposed = _proposed(source, out, form, tables, _assume)
    _note_reasons(proposal)
    _report(proposed, out)


def init(
    source: Source,
    out: Out,
    from_format: Format = None,
    mapping: Annotated[
        Path | None, typer.Option(metavar="M.toml", help="Mapping to write; by default REC.mapping.toml.")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Take every default instead of asking.")] = False,
) -> None:
    """Look at a recording of another system, ask what its data cannot say, and import it.

    The answers go into a mapping, with which `trackfg import` repeats it without questions. Of a table of track
    geometry the mapping says which channel is what.
    """
    from trackfg.errors import BadInputError
    from trackfg.files.atomic_file import write_whole
    from trackfg.interchange.importing.channels.source_geometry import geometry_in, geometry_mapping_text, source_tables
    from trackfg.interchange.importing.proposal import mapping_text

    target = mapping or out.with_name(f"{out.name}.mapping.toml")
    if target.exists():
        again = command("import", source, "-o", out, "--mapping", target)
        raise BadInputError(
            f"{target}: exists; expected a new file. Hint: name another one with --mapping; or to change its answers, "
            f"edit it, remove {out} and run: {again}"
        )
    with working("reading"):
        form, tables = source_tables(source, from_format, None)
        measured = geometry_in(tables, None, source.stem)
    if measured is not None:
        _write_geometry(*measured, out)
        write_whole(target, geometry_mapping_text(measured[1]).encode("utf-8"))
        print_unless_quiet(f"mapping: {target}")
        return
    proposal, made = _proposed(source, out, form, tables, _assume if yes else _ask, kept=target)
    write_whole(target, mapping_text(proposal).encode("utf-8"))
    _note_reasons(proposal, shown={f"{section}.{key}" for section, keys in _SHOWN.items() for key in keys})
    print_unless_quiet(_recognised(proposal, source), f"mapping: {target}")
    _report(made, out)


def _proposed(
    source: Path, out: Path, form: SourceFormat, tables: list[SourceTable], ask: Ask, kept: Path | None = None
) -> tuple[Proposal, Imported]:
    """Propose a mapping and write the recording that it makes of the tables, which are taken out of their list; where
    that fails, write the mapping alone, if ``kept``.
    """
    from trackfg.errors import BadInputError
    from trackfg.files.atomic_file import write_whole
    from trackfg.files.owned_folder import refuse_unwritable, refuse_used
    from trackfg.interchange.importing.conversion import converted
    from trackfg.interchange.importing.mapping import mapping_of
    from trackfg.interchange.importing.proposal import mapping_text, propose_columns
    from trackfg.interchange.importing.proposals.evident_by_force import settle_by_force

    refuse_used(out, "recordings are never overwritten")  # before questions are asked in vain
    if kept is not None:
        refuse_unwritable(kept)
    with interruptible("reading") as interrupted:

        def ask_alone(question: Question) -> str:
            with interrupted():
                return ask(question)

        proposal = propose_columns(tables, ask_alone, form.mapping(tables))
        proposal.sections["source"] = form.key
        try:
            settle_by_force(proposal, tables, ask_alone)
            mapping = mapping_of(proposal.sections, "proposed mapping")
            conversion = converted(tables, mapping, run_id=source.stem)
            notes = notes_of(tables, conversion)
            notes += notes_of_unused(proposal, tables)
            tables.clear()  # as above
            made = conversion.write(out)
        except BadInputError:
            if kept is not None:
                write_whole(kept, mapping_text(proposal).encode("utf-8"))
                edit = "correct it" if "axes" in proposal.sections["imu"] else "correct it and state imu.axes"
                again = command("import", source, "-o", out, "--mapping", kept)
                print_notes([f"the answers are in {kept}: {edit}, then run: {again}"])
            raise
    print_notes(notes)
    return proposal, made


def _recognised(proposal: Proposal, source: Path) -> Table:
    """Return what each sensor is made from, for the user to look at."""
    from rich.text import Text

    table = titled(f"Recognised in {source.name}", show_header=False)
    for section, rows in _SHOWN.items():
        content = proposal.sections.get(section, {})
        for key, (name, unit) in rows.items():
            if key in content:
                value, why = content[key], proposal.reasons.get(f"{section}.{key}")
                shown = ", ".join(map(str, value)) if isinstance(value, list) else str(value)
                shown = {"True": "yes", "False": "no"}.get(shown, shown)
                shown += f", in {content[unit]}" if unit in content else ""
                table.add_row(name, Text(f"{shown}; {why}" if why else shown))
    return table


def _note_reasons(proposal: Proposal, shown: Container[str] = ()) -> None:
    """Print why keys of a mapping are what they are, but for those that are ``shown`` otherwise."""
    print_notes(f"{key}: {reason}" for key, reason in proposal.reasons.items() if key not in shown)


def _assume(question: Question) -> str:
    """Answer with the default, and say so unless there is none or no answer is needed."""
    if question.default and not question.optional:
        note(f"trackfg: note: {question.text}: {question.default} is assumed ({question.key})")
    return question.default


def _ask(question: Question) -> str:
    """Ask in the terminal until the answer can be taken; where the input has ended, an optional question has none."""
    from rich.markup import escape
    from rich.prompt import InvalidResponse, Prompt

    from trackfg.errors import BadInputError
    from trackfg.interchange.importing.proposals.questions import choice_in

    class Answer(Prompt):
        """Takes the beginning of a choice, or a translated yes, for the whole of it, and refuses what is not accepted.

        Answers that do not come from a terminal are shown, as those that are typed.
        """

        @classmethod
        def get_input(cls, console: Console, prompt: TextType, password: bool, stream: TextIO | None = None) -> str:
            answer = super().get_input(console, prompt, password, stream)
            if not sys.stdin.isatty():
                print(answer)
            return answer

        def process_response(self, value: str) -> str:
            answer = value.strip()
            if question.choices:
                choice = choice_in(answer, question.choices)
                if choice is None:
                    raise InvalidResponse(f"[prompt.invalid]expected {' or '.join(question.choices)}")
                return choice
            if not answer or not question.accepts(answer):
                refused = escape(answer) or "An empty answer"
                raise InvalidResponse(
                    f"[prompt.invalid]{refused} is not understood; expected {escape(question.expected)}"
                )
            return answer

    text = escape(question.text)
    if question.choices:
        text += f" [prompt.choices]({', '.join(question.choices)})[/]"
    try:
        if question.default or question.optional:
            return Answer.ask(text, default=question.default, show_default=bool(question.default))
        return Answer.ask(text)
    except EOFError:
        if question.optional:
            return question.default
        by_mapping = "state it in a mapping, for trackfg import (docs/importing.md)"
        hint = "take the defaults by --yes" if question.default else by_mapping
        raise BadInputError(f"{question.key}: no answer to: {question.text}. Hint: {hint}") from None


def _write_geometry(table: SourceTable, reading: GeometryReading, name: str, out: Path) -> None:
    """Write a channel table as a result, and report on it."""
    from trackfg.interchange.importing.channels.measured_geometry import measured_result

    result = measured_result(table, reading, name)
    result.write(out)
    print_notes(notes_of_geometry(table, reading))
    _report(result, out)


def _report(made: Imported | Result, out: Path) -> None:
    """Print what was made and what is doubtful in it. Exit status 2 where a recording's tables are wrong."""
    from trackfg.cli import tables
    from trackfg.results.result import Result

    if isinstance(made, Result):
        print_unless_quiet(tables.findings(made.summary.findings, "No fault in the table itself."))
        chainage = made.geometry["chainage_m"]
        print_unless_quiet(f"geometry: {len(chainage)} rows from {chainage.iloc[0]:.2f} m to {chainage.iloc[-1]:.2f} m")
        print_unless_quiet(f"result: {out}")
        return
    none = "No fault in the tables themselves: trackfg check says whether they agree."
    print_unless_quiet(tables.findings(made.loaded.findings, none))
    for name, rows in made.rows.items():
        print_unless_quiet(f"{name}: {rows} rows")
    print_unless_quiet(f"recording: {out}")
    if errors_in(made):
        raise typer.Exit(2)
    next_step(command("check", out), command("smooth", out, "-o", f"{out}-out"))
