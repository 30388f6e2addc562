"""A result is exported to a file that is there whole, or not at all."""

from __future__ import annotations

import contextlib
from pathlib import Path

from trackfg.errors import OutputError
from trackfg.files.atomic_file import UNFINISHED
from trackfg.interchange.exporting.result_format import ExportOptions, ResultFormat
from trackfg.results.result import Result


def export_result(result: Result, form: ResultFormat, path: Path, options: ExportOptions | None = None) -> Path:
    """Write a result to a file, in place of an earlier one, and return its path.

    Raises :class:`~trackfg.errors.BadInputError` where the result lacks what the format needs, and
    :class:`~trackfg.errors.OutputError` where the file cannot be written; an earlier file then stays as it is.
    """
    unfinished = path.with_name(f"{UNFINISHED}{path.name}")
    try:
        form.write(result, unfinished, options or ExportOptions())
        unfinished.replace(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        with contextlib.suppress(OSError):
            unfinished.unlink()
    return path
