"""Files that are there whole, or as they were before, at any moment."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

from trackfg.errors import OutputError
from trackfg.files.atomic_folder import sync

UNFINISHED = ".unfinished-"
"""What the name of a file begins with while it is being written."""


@contextlib.contextmanager
def replaced_file(path: Path) -> Iterator[Path]:
    """Give the place of a new file beside ``path``, which takes the place of ``path`` when the block ends well.

    Folders that are missing above it are made. Raises :class:`OutputError` where the file cannot be written; an earlier
    file then stays as it is.
    """
    unfinished = path.with_name(f"{UNFINISHED}{path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield unfinished
        sync(unfinished)  # or a power cut could leave the name without its content
        unfinished.replace(path)
        sync(path.parent)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        with contextlib.suppress(OSError):
            unfinished.unlink()


def write_whole(path: Path, *content: bytes | memoryview) -> None:
    """Write a file beside its place, put it on the disk and rename it. Raises :class:`OutputError`."""
    with replaced_file(path) as new, new.open("wb") as file:
        file.writelines(content)
