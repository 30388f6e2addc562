"""A recording's content is its description and the files that it names, byte by byte.

Its digest shows whether a result was computed from the same content. Truth is no part of it: estimators never see it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path

from trackfg.errors import BadInputError
from trackfg.io.description_reader import locate, read_description
from trackfg.io.table_file import resolve_inside
from trackfg.recording.description import Truth

_MOST_LINE_BYTES = 4 * 2**30
"""Size of a file of tracks, bytes: the railways of a continent take less, and a digest takes seconds for this much."""


def content_files(path: Path | str) -> tuple[Path, tuple[str, ...]]:
    """Return the folder of a recording, and the names in it of its description and of the files that this names."""
    folder, toml = locate(path)
    return folder, (toml.name, *read_description(path).files)


def named_files(path: Path | str) -> tuple[str, ...]:
    """Return the names of all files that a recording is read with: its content, and those of its truth."""
    read = read_description(path)
    truth = read.parts.get("truth")
    return (locate(path)[1].name, *read.files, *(truth.files if isinstance(truth, Truth) else ()))


def file_sha256(path: Path) -> bytes:
    """Return the digest of a file, byte by byte. Raises :class:`OSError`."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").digest()


def line_sha256(path: Path) -> str:
    """Return the digest of a file of tracks. Raises :class:`BadInputError` where it is too large or cannot be read."""
    try:
        if path.stat().st_size > _MOST_LINE_BYTES:
            raise BadInputError(
                f"{path}: is larger than {_MOST_LINE_BYTES / 2**30:g} GiB; expected the tracks of a line"
            )
        return file_sha256(path).hex()
    except OSError as error:
        raise BadInputError(f"{path}: cannot be read: {error.strerror}: expected a file of tracks") from error


def files_sha256(folder: Path, names: Iterable[str]) -> str | None:
    """Return a digest of files of a folder and of their names; None where one is outside it or cannot be read."""
    digest = hashlib.sha256()
    for name in names:
        path, _ = resolve_inside(folder, name)
        if path is None:
            return None
        try:
            content = file_sha256(path)
        except OSError:
            return None
        digest.update(hashlib.sha256(name.encode("utf-8", "surrogatepass")).digest() + content)
    return digest.hexdigest()
