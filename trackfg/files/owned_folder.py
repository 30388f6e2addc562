"""Folders that trackfg writes and replaces, each of a kind: what may be replaced, and what is foreign."""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from trackfg.errors import BadInputError
from trackfg.files.atomic_folder import CANNOT_LOCK, recover


@dataclass(frozen=True)
class FolderKind:
    """``what`` names it in messages; its file ``head`` is JSON with a ``format`` that begins with ``format``; ``files``
    are all that it holds.
    """

    what: str
    head: str
    format: str
    files: tuple[str, ...]

    def holds(self, folder: Path) -> bool:
        """Return whether any version of trackfg wrote it: the format's name decides, not the fields of this version."""
        try:
            content = json.loads((folder / self.head).read_bytes())
        except (OSError, ValueError):
            return False
        return isinstance(content, dict) and str(content.get("format", "")).startswith(self.format)

    def refuse_foreign(self, folder: Path) -> None:
        """Raise :class:`BadInputError` unless ``folder`` may be replaced: absent, empty or of this kind.

        One with the user's own files beside is refused too, because they would be lost with it.
        """
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
        if foreign := sorted(names - set(self.files)):
            raise BadInputError(
                f"{folder}: holds {', '.join(foreign)} beside the {self.what}, which replacing it would delete; "
                "move what is yours or choose another folder"
            )

    def read(self, folder: Path) -> dict[str, bytes]:
        """Read every file of one version of the folder, also while another process replaces it.

        An open folder stays the same one whatever happens to its name, so all files come from it; if it is deleted
        meanwhile, its successor is read instead. Raises :class:`BadInputError` if it, or a file of it, is not there.
        """
        while True:
            recover(folder)
            try:
                descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
            except OSError as error:
                raise BadInputError(
                    f"{folder}: expected a folder with a trackfg {self.what}: {error.strerror}"
                ) from error
            try:
                return {name: _read_in(descriptor, name) for name in self.files}
            except FileNotFoundError as error:
                if _still_there(folder, descriptor):
                    raise BadInputError(
                        f"{folder}: {error.filename} is missing; expected a trackfg {self.what}"
                    ) from error
            finally:
                os.close(descriptor)


def refuse_used(path: Path, why: str) -> None:
    """Raise :class:`BadInputError` unless ``path`` is absent or an empty folder; ``why`` ends the message."""
    if path.exists() and not (path.is_dir() and not any(path.iterdir())):
        raise BadInputError(f"{path}: exists; {why}: choose another folder")


@contextmanager
def sole_writer(folder: Path, *, wait: bool = False) -> Iterator[None]:
    """Keep other processes from writing to a folder, until the block ends or this one does, however it does.

    While another process does, ``wait`` for it, or raise :class:`BadInputError`. A file system without locks excludes
    no other process.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            raise BadInputError(f"{folder}: another process is writing to it") from None
        except OSError as error:
            if error.errno not in CANNOT_LOCK:
                raise
        yield
    finally:
        os.close(descriptor)


def _read_in(folder: int, name: str) -> bytes:
    with open(os.open(name, os.O_RDONLY, dir_fd=folder), "rb") as file:
        return file.read()


def _still_there(folder: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(folder.stat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False
