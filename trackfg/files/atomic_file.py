"""Files that are there whole, or as they were before, at any moment."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from trackfg.errors import OutputError
from trackfg.files.atomic_folder import sync
from trackfg.files.locks import locked_file

UNFINISHED = ".unfinished-"
"""What the name of a file begins with while it is being written."""


@contextlib.contextmanager
def replaced_file(path: Path) -> Iterator[Path]:
    """Give the place of a new file beside ``path``, which takes the place of ``path`` when the block ends well.

    Folders that are missing above it are made. Others that write the same file wait for each other, and the last wins.
    Raises :class:`OutputError` where the file cannot be written; an earlier file then stays as it is.
    """
    unfinished = path.with_name(f"{UNFINISHED}{path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with _locked(unfinished.with_name(f"{unfinished.name}.lock")):
            try:
                yield unfinished
                sync(unfinished)  # or a power cut could leave the name without its content
                unfinished.replace(path)
                sync(path.parent)
            finally:
                with contextlib.suppress(OSError):
                    unfinished.unlink()
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error


@contextlib.contextmanager
def _locked(lock: Path) -> Iterator[None]:
    """Hold the lock of a file that is being written; it goes with the block, and one that was left is taken over."""
    descriptor = None
    while descriptor is None:
        descriptor = locked_file(lock, wait=True)
    try:
        yield
    finally:
        lock.unlink(missing_ok=True)
        os.close(descriptor)


def write_whole(path: Path, *content: bytes | memoryview) -> None:
    """Write a file beside its place, put it on the disk and rename it. Raises :class:`OutputError`."""
    with replaced_file(path) as new, new.open("wb") as file:
        file.writelines(content)
