"""Folders and files at a place: a path, or a URL of any kind that fsspec opens.

An object store has neither locks nor folders that are replaced in one step. What marks a folder as whole, its head, is
taken away first and put there last, so that a folder is whole or counts as none.
"""

from __future__ import annotations

import os
import re
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from glob import glob
from pathlib import Path, PurePosixPath
from typing import Any

from trackfg.errors import TrackfgError, first_line
from trackfg.files.atomic_file import write_whole
from trackfg.files.atomic_folder import replaced_folder
from trackfg.files.small_file import read_small
from trackfg.files.temporary_folder import temporary_folder
from trackfg.io.content import content_files, named_files
from trackfg.io.description_reader import FILE_NAME, describes_recording

_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*(://|::)")
"""What a URL begins with; ``zip::`` and the like stand before the URL of what they open."""
_ARCHIVE = ".zip"
_ARCHIVE_FAULTS = (OSError, zipfile.BadZipFile, RuntimeError, ValueError)
"""What an archive that cannot be read raises. RuntimeError: encrypted, or an unknown compression; ValueError: a name in
no encoding."""

_MOST_BYTES = 2**30
"""Size of a file that is read whole: a month of a store's catalogue has 1 kB a run, 20 with the log of a failed one."""

_VERSIONS = ("ETag", "etag", "LastModified", "last_modified", "mtime", "updated", "md5Hash", "Content-MD5", "CRC")
"""Metadata of different file systems, each of which changes with the content of a file."""


class PlaceError(TrackfgError):
    """A URL that cannot be read or written; the message says why."""


def is_url(place: str) -> bool:
    """Return whether a place is a URL, not a path."""
    return _URL.match(place) is not None


def is_remote(recording: str) -> bool:
    """Return whether a recording has to be brought here before it is read: it is at a URL, or in an archive."""
    return is_url(recording) or recording.lower().endswith(_ARCHIVE)


def is_recording(path: str) -> bool:
    """Return whether a path is that of a recording: a folder, a description, or an archive with a description in it.

    A description or an archive that cannot be read counts as a recording: the run says what is wrong with it.
    """
    if os.path.isdir(path):
        return True
    if not path.endswith(_ARCHIVE):
        return path.endswith(".toml") and describes_recording(Path(path))
    try:
        with zipfile.ZipFile(path) as content:
            return any(PurePosixPath(name).name == FILE_NAME for name in content.namelist())
    except _ARCHIVE_FAULTS:
        return True


def joined(place: str, *parts: str) -> str:
    """Return the place of what lies in a place."""
    return "/".join((place.rstrip("/"), *parts))


@contextmanager
def _opened(url: str) -> Iterator[tuple[Any, str]]:
    """Give the file system of a URL and the path in it. What goes wrong there is a :class:`PlaceError`."""
    try:
        import fsspec
    except ImportError as error:
        raise PlaceError(f"{url}: URLs need fsspec: pip install 'trackfg[fleet]'") from error
    try:
        yield fsspec.core.url_to_fs(url)
    except PlaceError:
        raise
    except Exception as error:  # each kind of file system has exceptions of its own
        raise PlaceError(f"{url}: {type(error).__name__}: {first_line(error)}") from error


def exists(place: str) -> bool:
    """Return whether there is a file."""
    if not is_url(place):
        return os.path.exists(place)
    with _opened(place) as (files, path):
        return bool(files.isfile(path))


def is_file(place: str) -> bool:
    """Return whether there is a file that can be read to its end: no folder, pipe or device."""
    return exists(place) if is_url(place) else os.path.isfile(place)


def read(place: str) -> bytes:
    """Return the content of a file, which is no pipe. Raises ``OSError`` or :class:`PlaceError`."""
    if not is_url(place):
        return read_small(place, _MOST_BYTES)
    with _opened(place) as (files, path):
        return bytes(files.cat_file(path))


def write(place: str, content: bytes) -> None:
    """Write a file in one step. Raises :class:`~trackfg.errors.OutputError` or :class:`PlaceError`."""
    if not is_url(place):
        write_whole(Path(place), content)
        return
    with _opened(place) as (files, path):
        files.makedirs(path.rpartition("/")[0], exist_ok=True)
        files.pipe_file(path, content)


def remove(place: str) -> None:
    """Remove a file if it is there."""
    if not is_url(place):
        Path(place).unlink(missing_ok=True)
        return
    with _opened(place) as (files, path):
        if files.exists(path):
            files.rm_file(path)


def matching(folder: str, pattern: str) -> list[str]:
    """Return the paths, relative to a folder, of the files and folders in it that fit a pattern; hidden ones do not."""
    if not is_url(folder):
        return sorted(glob(pattern, root_dir=folder))
    with _opened(folder) as (files, path):
        files.invalidate_cache(path)
        return sorted(entry[len(path.rstrip("/")) + 1 :] for entry in files.glob(joined(path, pattern)))


def signature(folder: str, names: Sequence[str]) -> str | None:
    """Return metadata that changes with the files at a URL; None where a file or its metadata is missing."""
    parts = []
    for name in names:
        place = joined(folder, name) if name else folder
        try:
            with _opened(place) as (files, path):
                files.invalidate_cache(path.rpartition("/")[0])
                facts = files.info(path)
        except PlaceError:
            return None
        versions = [str(facts[key]) for key in _VERSIONS if facts.get(key)]
        if not versions:
            return None
        parts.append(f"{facts.get('size')} {versions}")
    return ";".join(parts)


@contextmanager
def new_folder(place: str, head: str) -> Iterator[Path]:
    """Give an empty folder to write into, which becomes ``place`` if the block ends well; what was there stays if not.

    Its file ``head`` is what marks it as whole.
    """
    if not is_url(place):
        with replaced_folder(Path(place)) as new:
            yield new
        return
    with temporary_folder() as new:
        yield new
        remove(joined(place, head))
        for path in sorted(new.iterdir(), key=lambda path: path.name == head):
            write(joined(place, path.name), path.read_bytes())


@contextmanager
def local_files(folder: str, names: Sequence[str]) -> Iterator[Path]:
    """Give a local folder with files of a place: the place itself where it is local.

    Raises :class:`PlaceError` where one is none that can be read: a pipe would be waited for.
    """
    if not is_url(folder):
        for name in names:
            if not is_file(joined(folder, name)):
                raise PlaceError(f"{joined(folder, name)}: no such file that can be read")
        yield Path(folder)
        return
    with temporary_folder() as scratch:
        for name in names:
            (scratch / name).write_bytes(read(joined(folder, name)))
        yield scratch


@contextmanager
def local_recording(place: str) -> Iterator[Path]:
    """Give the local folder of a recording, which is brought here where it is remote, and removed again.

    Raises :class:`PlaceError` for what cannot be read, and for an archive without exactly one recording.
    """
    if not is_remote(place):
        if not Path(place).exists():
            raise PlaceError(f"{place}: no such folder; expected a folder with {FILE_NAME}")
        yield Path(place)
        return
    with temporary_folder() as scratch:
        folder = scratch / "recording"
        if place.lower().endswith(_ARCHIVE):
            yield _unpacked(place, scratch, folder)
        else:
            yield _fetched(place, folder)


def _unpacked(place: str, scratch: Path, folder: Path) -> Path:
    archive = Path(place)
    if is_url(place):
        archive = scratch / "archive"
        with _opened(place) as (files, path):
            files.get_file(path, str(archive))
    try:
        with zipfile.ZipFile(archive) as content:
            content.extractall(folder)
    except _ARCHIVE_FAULTS as error:
        raise PlaceError(f"{place}: not a readable archive: {first_line(error)}") from error
    descriptions = sorted(folder.rglob(FILE_NAME))
    if len(descriptions) != 1:
        raise PlaceError(f"{place}: holds {len(descriptions)} files {FILE_NAME}; expected one recording")
    return descriptions[0].parent


def _fetched(place: str, folder: Path) -> Path:
    folder.mkdir()
    (folder / FILE_NAME).write_bytes(read(joined(place, FILE_NAME)))
    for name in named_files(folder)[1:]:
        parts = PurePosixPath(name)
        if parts.is_absolute() or ".." in parts.parts:
            continue  # reading the recording says what is wrong with it
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        with _opened(joined(place, name)) as (files, path):
            files.get_file(path, str(folder / name))
    return folder


def content_of(recording: str) -> tuple[str, tuple[str, ...]]:
    """Return the folder of a recording and the names of the files in it that are its content, or its archive.

    An archive at a URL is its own folder, with an empty name. Raises :class:`PlaceError`.
    """
    if recording.lower().endswith(_ARCHIVE):
        return (recording, ("",)) if is_url(recording) else (os.path.dirname(recording), (os.path.basename(recording),))
    if not is_url(recording):
        folder, names = content_files(recording)
        return str(folder), names
    with temporary_folder() as scratch:
        (scratch / FILE_NAME).write_bytes(read(joined(recording, FILE_NAME)))
        return recording, content_files(scratch)[1]
