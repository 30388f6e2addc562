"""A result is exported to a file that is there whole, or not at all."""

from __future__ import annotations

from pathlib import Path

from trackfg.errors import BadInputError
from trackfg.files.atomic_file import replaced_file
from trackfg.interchange.exporting.located_tables import origin_of
from trackfg.interchange.exporting.registry import result_formats
from trackfg.interchange.exporting.result_format import ON_COMMAND_LINE, ExportOptions, ResultFormat
from trackfg.results.result import Result


def export_result(result: Result, form: ResultFormat, path: Path, options: ExportOptions | None = None) -> Path:
    """Write a result to a file, in place of an earlier one, and return its path.

    Raises :class:`~trackfg.errors.BadInputError` where the result lacks what the format needs, or the format does not
    take one of the ``options``, and
    :class:`~trackfg.errors.OutputError` where the file cannot be written; an earlier file then stays as it is.
    """
    wanted = options or ExportOptions()
    _refuse_unused(form, wanted)
    if form.needs_place and origin_of(result) is None:
        raise BadInputError(
            f"{result.summary.recording_id}: its recording has no GNSS, so that it has no positions on the Earth; "
            f"expected them for {form.key}. Hint: csv, channels, xlsx and tum need none"
        )
    if form.needs_trajectory and result.trajectory.empty:
        raise BadInputError(
            f"{result.summary.recording_id}: its geometry was measured by another system, without a trajectory; "
            f"expected one for {form.key}. Hint: csv, channels and xlsx need none"
        )
    with replaced_file(path) as new:
        form.write(result, new, wanted)
    return path


def _refuse_unused(form: ResultFormat, options: ExportOptions) -> None:
    """Raise :class:`BadInputError` for an option that says nothing of what the format writes."""
    for name, option in ON_COMMAND_LINE.items():
        if name not in form.takes and getattr(options, name) != getattr(ExportOptions(), name):
            others = ", ".join(key for key, other in result_formats().items() if name in other.takes)
            raise BadInputError(f"{option}: {form.key} does not take it; expected it with one of {others}")
