"""Files that are there whole, or as they were before, at any moment."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from trackfg.errors import OutputError
from trackfg.files.atomic_folder import sync

UNFINISHED = ".unfinished-"
"""What the name of a file begins with while it is being written."""


def write_whole(path: Path, *content: bytes | memoryview) -> None:
    """Write a file beside its place, put it on the disk and rename it. Raises :class:`OutputError`."""
    unfinished = path.with_name(f"{UNFINISHED}{path.name}")
    try:
        with unfinished.open("wb") as file:
            file.writelines(content)
            file.flush()
            os.fsync(file.fileno())
        unfinished.replace(path)
        sync(path.parent)
    except OSError as error:
        with contextlib.suppress(OSError):
            unfinished.unlink()
        raise OutputError(f"{path}: cannot be written ({error.strerror})") from error
