"""Temporary folders are removed even where the process may open no further file."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from trackfg.files.open_files import files_in_reserve

_TO_REMOVE = 4
"""Open files that removing takes: one to list the deepest folder and one for each level, of which a result that was
replaced has two below the temporary folder."""


@contextmanager
def temporary_folder(prefix: str = "trackfg-", parent: Path | None = None) -> Iterator[Path]:
    """Yield an empty folder, which is removed with its content when the block ends.

    Removing it opens folders, and whatever fails in the block may have left no open file for that: as many as it takes
    are held from the start. Raises ``OSError`` before there is a folder where they are too few, or where ``parent``
    cannot be written.
    """
    with files_in_reserve(_TO_REMOVE) as reserve:
        folder = Path(tempfile.mkdtemp(prefix=prefix, dir=parent))
        try:
            yield folder
        finally:
            reserve.close()
            shutil.rmtree(folder, ignore_errors=True)
