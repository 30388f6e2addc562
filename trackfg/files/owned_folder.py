"""Folders that trackfg writes and replaces, each of a kind: what may be replaced, and what is foreign."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from trackfg.errors import BadInputError, first_line
from trackfg.files.atomic_folder import LONGER_BY, real_path, recover, refuse_working_folder
from trackfg.files.locks import CANNOT_LOCK, lock_file
from trackfg.files.small_file import json_of, read_small

_MOST_BYTES = 8 * 2**30
"""Size of a table: geometry takes 150 bytes a row in the file, so this is a run of 14,000 km."""
_MOST_HEAD_BYTES = 64 * 2**20
"""Size of the file that says what a folder is: a summary has some kB, and more with thousands of findings."""


_HEADS = {
    "recording.toml": "recording",
    "summary.json": "result",
    "comparison.json": "comparison",
    "trends.json": "folder of trends",
    "overlay.json": "overlay",
    "baseline.json": "baseline's result",
    "checkpoint": "stream",
    "store.json": "store",
}
"""What trackfg calls the folders that hold these files."""
_INSTEAD = {
    "recording": "trackfg smooth makes a result of a recording",
    "baseline's result": "trackfg compare makes pages about baselines",
    "store": "its folder results has a result for each run",
    "stream": "smooth the recording that it was made from, or read its tables",
}
"""What to do where another folder is expected, by kind."""


def kind_of(folder: Path) -> str | None:
    """Return what trackfg calls a folder, judged by its files' names alone; None where none of them is there."""
    return next((kind for name, kind in _HEADS.items() if (folder / name).exists()), None)


def hint_instead(kind: str | None) -> str:
    """Return what to do where a folder of this kind is given and another is expected, as the end of a message."""
    return f". Hint: {_INSTEAD[kind]}" if kind in _INSTEAD else ""


@dataclass(frozen=True)
class FolderKind:
    """A kind of folder: ``what`` names it in messages; its file ``head`` is JSON with a ``format`` that begins with
    ``format``; ``files`` are all that it holds, ``optional`` what it may hold besides.
    """

    what: str
    head: str
    format: str
    files: tuple[str, ...]
    optional: tuple[str, ...] = ()

    def holds(self, folder: Path) -> bool:
        """Return whether any version of trackfg wrote it: the format's name decides, not the fields of this version."""
        try:
            content = json_of(read_small(folder / self.head, _MOST_HEAD_BYTES))
        except (OSError, ValueError):
            return False
        return isinstance(content, dict) and str(content.get("format", "")).startswith(self.format)

    def refuse_foreign(self, folder: Path) -> None:
        """Raise :class:`BadInputError` unless ``folder`` may be replaced: absent, empty or of this kind.

        One with the user's own files beside is refused too, because they would be lost with it; and so is a place where
        no folder can be made, before hours of work rather than after.
        """
        refuse_unwritable(folder)
        refuse_working_folder(folder)
        if not folder.exists():
            return
        if not folder.is_dir():
            raise BadInputError(f"{folder}: is a file; expected a folder for the {self.what}")
        names = {path.name for path in folder.iterdir()}
        if not names:
            return
        if not self.holds(folder):
            raise BadInputError(
                f"{folder}: exists and is not a trackfg {self.what}; it is left alone: choose another folder"
            )
        if foreign := sorted(names - {*self.files, *self.optional}):
            raise BadInputError(
                f"{folder}: holds {', '.join(foreign)} beside the {self.what}, which replacing it would delete; "
                "move what is yours or choose another folder"
            )

    def read(self, folder: Path, names: Sequence[str] = ()) -> dict[str, bytes]:
        """Read every file, or those with these names, of one version of the folder, also while another process replaces
        it.

        An open folder stays the same one whatever happens to its name, so all files come from it; if it is deleted
        meanwhile, its successor is read instead. Raises :class:`BadInputError` if it, or a file of it, is not there.
        """
        while True:
            recover(folder)
            try:
                descriptor = _opened(folder)
            except OSError as error:
                raise BadInputError(
                    f"{folder}: expected a folder with a trackfg {self.what}: {error.strerror}"
                ) from error
            try:
                listed = os.listdir(folder if descriptor is None else descriptor)
                wanted = names or (*self.files, *(name for name in listed if name in self.optional))
                within = folder if descriptor is None else Path()
                return {name: read_small(within / name, _MOST_BYTES, folder=descriptor) for name in wanted}
            except FileNotFoundError as error:
                if descriptor is None or _still_there(folder, descriptor):
                    kind = kind_of(folder)
                    other = None if kind == self.what else kind
                    wrong = f"is a {other}" if other else f"{error.filename} is missing"
                    message = f"{folder}: {wrong}; expected a trackfg {self.what}{hint_instead(other)}"
                    raise BadInputError(message) from error
            except OSError as error:
                raise BadInputError(
                    f"{folder}: {error.filename or 'its content'} cannot be read: {error.strerror}; "
                    f"expected a trackfg {self.what}"
                ) from error
            finally:
                if descriptor is not None:
                    os.close(descriptor)


def _opened(folder: Path) -> int | None:
    """Return the open folder, which stays the same one whatever happens to its name; None where none can be opened."""
    if os.open not in os.supports_dir_fd:
        folder.lstat()
        return None
    return os.open(folder, os.O_RDONLY | os.O_DIRECTORY)


def refuse_unwritable(folder: Path) -> None:
    """Raise :class:`BadInputError` where no folder or file can be made or replaced: names, links, rights, parents."""
    try:
        target = real_path(folder)
        loops = target.is_symlink()
        parent = target.parent
        while not parent.exists():
            parent = parent.parent
        name_max = os.pathconf(parent, "PC_NAME_MAX")
    except (OSError, ValueError) as error:  # a name too long, a null byte
        reason = (error.strerror if isinstance(error, OSError) else None) or first_line(error)
        raise BadInputError(f"{folder}: {reason}; expected a place to write to") from error
    if loops:
        raise BadInputError(f"{folder}: is a link that leads in a circle; expected a place to write to")
    if not parent.is_dir():
        raise BadInputError(f"{folder}: {parent} is a file; expected a folder to write into")
    if len(os.fsencode(target.name)) + LONGER_BY > name_max:
        raise BadInputError(f"{folder}: its name is too long; expected at most {name_max - LONGER_BY} bytes")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise BadInputError(f"{folder}: {parent} cannot be written to; expected a folder of yours")


def refuse_used(path: Path, why: str) -> None:
    """Raise :class:`BadInputError` unless ``path`` is absent or an empty folder, and a folder can be made there.

    ``why`` ends the message.
    """
    refuse_unwritable(path)
    if path.exists() and not (path.is_dir() and not any(path.iterdir())):
        raise BadInputError(f"{path}: exists; {why}: choose another folder")
    refuse_working_folder(path)


@contextmanager
def sole_writer(folder: Path, *, wait: bool = False) -> Iterator[None]:
    """Keep other processes from writing to a folder, until the block ends or this one does, however it does.

    While another process does, ``wait`` for it, or raise :class:`BadInputError`. A file system without locks excludes
    no other process.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        try:
            lock_file(descriptor, wait=wait)
        except BlockingIOError:
            raise BadInputError(f"{folder}: another process is writing to it") from None
        except OSError as error:
            if error.errno not in CANNOT_LOCK:
                raise
        yield
    finally:
        os.close(descriptor)


def _still_there(folder: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(folder.stat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False
