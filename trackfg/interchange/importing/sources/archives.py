"""Archives, .zip and .tar, are unpacked as far as their files hold tables."""

from __future__ import annotations

import lzma
import shutil
import tarfile
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path, PurePosixPath
from typing import IO

from trackfg.errors import BadInputError

_LARGEST_BYTES = 20_000_000_000
"""Of an archive, unpacked: more is a mistake or an attack."""
_LONGEST_LINE_BYTES = 65_536
"""A longer first line holds no names of columns."""
_TAR = (".tar", ".tgz", ".tbz2", ".txz", ".tar.gz", ".tar.bz2", ".tar.xz")
UNREADABLE = (
    OSError,
    zipfile.BadZipFile,
    tarfile.TarError,
    RuntimeError,
    EOFError,
    ValueError,
    zlib.error,
    lzma.LZMAError,
)
"""What damaged archives raise: zipfile has RuntimeError for encrypted members and, as NotImplementedError, for an
unknown compression; EOFError and zlib.error are of data that are cut short or damaged, ValueError of a name that is not
UTF-8."""


def is_archive(path: Path) -> bool:
    """Return whether a file is an archive by its name."""
    name = path.name.casefold()
    return name.endswith((".zip", *_TAR))


def names_in(path: Path) -> list[str]:
    """Return the names of the files in an archive; none where it is damaged, or no archive."""
    try:
        return [name for name, *_ in _members(path)] if is_archive(path) and path.is_file() else []
    except UNREADABLE:
        return []


def first_lines(path: Path, wanted: Callable[[str], bool]) -> list[str]:
    """Return the first lines of the files of a folder or an archive whose name is ``wanted``; none where damaged."""
    try:
        if path.is_dir():
            files = (file for file in path.rglob("*") if wanted(file.name) and file.is_file())
            return [_first_line(file.open("rb")) for file in files]
        return [_first_line(opened()) for name, _, opened in _members(path) if wanted(PurePosixPath(name).name)]
    except UNREADABLE:
        return []


def _first_line(opened: IO[bytes]) -> str:
    with opened as stream:
        return stream.readline(_LONGEST_LINE_BYTES).decode("utf-8", "replace")


def unpacked(path: Path, folder: Path, wanted: Callable[[str], bool]) -> list[tuple[str, Path]]:
    """Unpack files whose name is ``wanted`` into ``folder``; return names and paths in order.

    A name is that of the file, or with its folders where several have the same. Raises :class:`BadInputError` where the
    archive is damaged or too large.
    """
    files: list[tuple[str, Path]] = []
    try:
        if sum(size for _, size, _ in _members(path)) > _LARGEST_BYTES:
            raise BadInputError(f"{path.name}: is above {_LARGEST_BYTES / 1e9:g} GB unpacked; expected a recording")
        for i, (member, _, opened) in enumerate(_members(path)):
            name = PurePosixPath(member.replace("\\", "/"))
            if not wanted(name.name) or "__MACOSX" in name.parts:
                continue
            target = folder / str(i) / name.name
            target.parent.mkdir()
            with opened() as source, target.open("wb") as out:
                shutil.copyfileobj(source, out, 1 << 20)
            files.append((str(name), target))
    except UNREADABLE as error:
        raise BadInputError(f"{path.name}: cannot be unpacked ({error}); expected an archive") from error
    bare = Counter(target.name for _, target in files)
    return sorted((target.name if bare[target.name] == 1 else name, target) for name, target in files)


def _members(path: Path) -> Iterator[tuple[str, int, Callable[[], IO[bytes]]]]:
    """Yield the files of an archive: the name, the size, and what opens it."""
    if path.suffix.casefold() == ".zip":
        with zipfile.ZipFile(path) as archive:
            for info in archive.infolist():
                if not info.is_dir():
                    yield info.filename, info.file_size, partial(archive.open, info)
        return
    with tarfile.open(path) as tape:
        for member in tape:
            stream = tape.extractfile(member) if member.isfile() else None
            if stream is not None:
                yield member.name, member.size, lambda stream=stream: stream  # type: ignore[misc]
