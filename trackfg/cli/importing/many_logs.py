"""Many logs of one device: each becomes a recording of its name in one folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from trackfg.cli.exits import sentence_of
from trackfg.cli.importing.notes import notes_of, notes_of_geometry, print_notes, shortened
from trackfg.cli.terminal import complain, note, print_unless_quiet, progress_bar

if TYPE_CHECKING:
    from trackfg.interchange.importing.conversion import Imported
    from trackfg.interchange.importing.mapping import Mapping
    from trackfg.results.result import Result

_SOME_FAILED = 1
"""Exit status where one of several sources could not be imported."""


def import_each(sources: Sequence[Path], folder: Path, from_format: str | None, plan: Mapping) -> None:
    """Import sources into a folder, each under its name; name those that fail, and go on. Exit status 1 if one does."""
    from trackfg.errors import TrackfgError, printable
    from trackfg.interchange.importing.conversion import Imported

    targets = _targets(sources, folder)
    left = [source for source, target in targets.items() if target.exists()]
    if left:
        note(f"trackfg: note: in {folder} already, and left as they are: {shortened([path.name for path in left])}")
    wanted, failed, done = {source: target for source, target in targets.items() if source not in left}, 0, 0
    try:
        with progress_bar() as progress:
            for source, target in wanted.items():
                if progress is not None:
                    progress(f"{done + 1} of {len(wanted)}", done / len(wanted))
                fault = None
                try:
                    made, notes = imported(source, target, from_format, plan)
                except (TrackfgError, OSError) as error:
                    fault = sentence_of(error) if isinstance(error, OSError) else str(error)
                else:
                    print_notes(f"{source}: {text}" for text in notes)
                    print_unless_quiet(f"{'recording' if isinstance(made, Imported) else 'result'}: {target}")
                    wrong = errors_in(made)
                    fault = f"imported, but {wrong[0]}" if wrong else None
                if fault is not None:
                    failed += 1
                    reason = fault.removeprefix(f"{source}: ").removeprefix(f"{source.name}: ")
                    complain(f"trackfg: {source}: {printable(reason)}")
                done += 1
    except KeyboardInterrupt:
        complain(f"trackfg: interrupted: {done} of {len(wanted)} done. Hint: the same command goes on from there")
        raise
    print_unless_quiet(
        f"imported: {len(wanted) - failed} of {len(targets)}, there already {len(left)}, failed {failed}"
    )
    if failed:
        raise typer.Exit(_SOME_FAILED)


def imported(source: Path, out: Path, from_format: str | None, plan: Mapping) -> tuple[Imported | Result, list[str]]:
    """Import a source by a mapping; return what was made of it, and what reading has assumed."""
    from trackfg.interchange.importing.channels.measured_geometry import measured_result
    from trackfg.interchange.importing.channels.source_geometry import geometry_in, source_tables
    from trackfg.interchange.importing.conversion import converted

    _, tables = source_tables(source, from_format, plan)
    measured = geometry_in(tables, plan, name_of(source))
    if measured is not None:
        result = measured_result(*measured)
        result.write(out)
        return result, notes_of_geometry(*measured[:2])
    conversion = converted(tables, plan, run_id=name_of(source))
    notes = notes_of(tables, conversion)
    tables.clear()  # the recording is read back, and there is no need for both in memory
    return conversion.write(out), notes


def _targets(sources: Sequence[Path], folder: Path) -> dict[Path, Path]:
    """Return the folder of each source's recording. Raises :class:`BadInputError` where two are of one name, and where
    ``folder`` is a recording itself, or a file.
    """
    from trackfg.errors import BadInputError
    from trackfg.files.owned_folder import kind_of

    if (kind := kind_of(folder)) is not None:
        raise BadInputError(f"{folder}: is a trackfg {kind}; expected a folder for the recordings of several sources")
    if folder.exists() and not folder.is_dir():
        raise BadInputError(f"{folder}: is a file; expected a folder for the recordings of several sources")
    targets = {source: folder / name_of(source) for source in sources}
    by_target = {target: source for source, target in targets.items()}
    for source, target in targets.items():
        if by_target[target] != source:
            raise BadInputError(
                f"{source} and {by_target[target]}: both would become {target}; expected sources of different names. "
                "Hint: import them into two folders"
            )
    return targets


def name_of(source: Path) -> str:
    """Return the name of a source's recording: that of a file is without its suffix."""
    whole = source if source.name not in ("", "..") else source.resolve()
    return whole.name if whole.is_dir() else whole.stem


def errors_in(made: Imported | Result) -> list[str]:
    """Return what is wrong in the tables of a recording or in a table of track geometry."""
    from trackfg.recording.findings import errors
    from trackfg.results.result import Result

    findings = made.summary.findings if isinstance(made, Result) else made.loaded.findings
    return [str(finding) for finding in errors(findings)]
