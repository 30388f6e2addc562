"""Replace a folder in one step: whoever looks sees the whole old one or the whole new one, never a mixture.

The new folder is written beside the target, in a hidden *workspace* ``.NAME.trackfg-XXXXXXXX`` of the same parent,
flushed to the disk and then published by one system call:

1. nothing (or an empty folder) at the target: ``rename``;
2. a folder at the target: ``renameat2(RENAME_EXCHANGE)``, which swaps the two names atomically, so that there is no
   moment without either. A symbolic link to versioned folders would be as atomic on every file system, but a result
   would then be a link: moved, copied or packed alone, it loses its content;
3. where the file system or the platform cannot exchange (NFS, macOS): ``rename`` the old away, ``rename`` the new in.
   Between the two there is neither; a process killed just there leaves the old one in its workspace, from where the
   next :func:`recover` (every read and write calls it) puts it back.

The kernel releases the lock that a workspace holds when its process ends, however it ends. Workspaces without a living
owner are what killed processes left, and the next write to the same target removes them. Several processes may write
one target at the same time: the last to finish wins.
"""

from __future__ import annotations

import ctypes
import errno
import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from trackfg.errors import BadInputError, OutputError
from trackfg.files.locks import locked_file
from trackfg.files.temporary_folder import temporary_folder

_LOCK, _NEW, _OLD, _DISCARDED = "lock", "new", "old", "discarded"
_CONTENT = {_LOCK, _NEW, _OLD, _DISCARDED}
_NESTED = f".{_NEW}.trackfg-"
"""Begins the name of the workspace of a command that writes into a workspace, as those of ``batch`` do."""
LONGER_BY = len(".") + len(".trackfg-") + 8
"""Letters by which the name of a workspace is longer than that of its target."""
_AT_FDCWD = -100
"""Paths are relative to the working directory (Linux, fcntl.h)."""

_RENAME_EXCHANGE = 2
"""Both names change places in one step (Linux, renameat2(2))."""

_CANNOT_EXCHANGE = {errno.ENOSYS, errno.EINVAL, errno.ENOTSUP, errno.EOPNOTSUPP}
_OCCUPIED = {errno.ENOTEMPTY, errno.EEXIST}
_NO_SPACE = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


@contextmanager
def replaced_folder(target: Path) -> Iterator[Path]:
    """Yield an empty folder to write into; when the block ends without an exception, it becomes ``target``.

    With an exception (Ctrl-C included) the target stays as it was and nothing is left behind. Parents are created. What
    the target held before is deleted: whether that is allowed is for the caller to decide. Raises ``OSError`` where the
    parent cannot be written or the target is a file or a mount point, :class:`OutputError` where the disk is full, and
    :class:`BadInputError` for the working directory.
    """
    refuse_working_folder(target)
    target = real_path(target)
    target.parent.mkdir(parents=True, exist_ok=True)
    recover(target)
    _remove_leftovers(target)
    with _workspace(target) as workspace:
        try:
            new = workspace / _NEW
            new.mkdir()
            yield new
            _flush(new)
            _publish(new, target, aside=workspace / _OLD)
            sync(target.parent)
        except OSError as error:
            if error.errno not in _NO_SPACE:
                raise
            raise OutputError(f"{target}: cannot be written ({os.strerror(error.errno)})") from error
        finally:
            _settle(target, aside=workspace / _OLD)


def refuse_working_folder(target: Path) -> None:
    """Raise :class:`BadInputError` where ``target`` is the working directory or holds it.

    A folder is replaced by another one of its name: a shell that stands in it would be left in the old one, which is
    deleted, and would see nothing of what was written.
    """
    try:
        working = Path.cwd()
    except FileNotFoundError:  # it is deleted
        return
    if real_path(working).is_relative_to(real_path(target)):
        raise BadInputError(
            f"{target}: is the folder that the command runs in, or above it; it cannot be replaced from within. "
            "Hint: name a folder in it, or run the command elsewhere"
        )


def real_path(path: Path) -> Path:
    """Return the absolute path without links; a loop of links stays as it is, for whatever opens it to say so."""
    return Path(os.path.realpath(path))


def beside(folder: Path, suffix: str) -> Path:
    """Return the path of a file beside a folder and named after it, as the folder's path is written where it has its
    name: of ``.`` and of links it is absolute.
    """
    whole = real_path(folder)
    return (folder if folder.name == whole.name else whole).with_name(f"{whole.name}{suffix}")


def recover(target: Path) -> None:
    """Put back a folder whose replacement was cut short between moving it away and moving the new one in."""
    target = real_path(target)
    if target.exists():
        return
    for workspace in _workspaces(target):
        lock = _lock(workspace, wait=False)
        if lock is None:
            continue
        try:
            if (workspace / _OLD).exists():
                (workspace / _OLD).rename(target)
                return
        finally:
            os.close(lock)


def _publish(new: Path, target: Path, aside: Path) -> None:
    while True:
        try:
            new.rename(target)
        except OSError as error:
            if error.errno not in _OCCUPIED:
                raise
        else:
            return
        try:
            _exchange(new, target)
        except FileNotFoundError:
            continue  # another process took the target away in this moment
        except OSError as error:
            if error.errno not in _CANNOT_EXCHANGE:
                raise
            shutil.rmtree(aside, ignore_errors=True)
            target.rename(aside)
        else:
            return


def _settle(target: Path, aside: Path) -> None:
    """Put back what was moved away if nothing took its place; else hide it from :func:`recover`, to be taken apart."""
    if aside.exists():
        aside.rename(aside.with_name(_DISCARDED) if target.exists() else target)


def _exchange(a: Path, b: Path) -> None:
    """Swap two names atomically (renameat2 of Linux 3.15 and glibc 2.28). Raises ``OSError``, ENOSYS where missing."""
    renameat2 = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if renameat2 is None:
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS))
    status = renameat2(
        ctypes.c_int(_AT_FDCWD),
        ctypes.c_char_p(os.fsencode(a)),
        ctypes.c_int(_AT_FDCWD),
        ctypes.c_char_p(os.fsencode(b)),
        ctypes.c_uint(_RENAME_EXCHANGE),
    )
    if status != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number), str(a), None, str(b))


def _workspaces(target: Path) -> list[Path]:
    prefix = _prefix(target)
    if not target.parent.is_dir():
        return []
    return sorted(path for path in target.parent.iterdir() if path.name.startswith(prefix) and _is_workspace(path))


def _is_workspace(path: Path) -> bool:
    """Return whether this user's trackfg made it: a folder, no link, with nothing but what a workspace holds.

    A name alone is not enough: in a shared folder others can make any.
    """
    try:
        status = path.lstat()
        if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.geteuid():
            return False
        names = {entry.name for entry in path.iterdir() if not entry.name.startswith(_NESTED)}
        if _LOCK not in names:  # killed before it was locked, or while it was taken apart
            return names <= {_NEW, _DISCARDED}
        return names <= _CONTENT and stat.S_ISREG((path / _LOCK).lstat().st_mode)
    except OSError:
        return False


def _prefix(target: Path) -> str:
    return f".{target.name}.trackfg-"


@contextmanager
def _workspace(target: Path) -> Iterator[Path]:
    """Yield a workspace, which holds its lock until it is removed."""
    while True:
        with ExitStack() as held, temporary_folder(_prefix(target), target.parent) as workspace:
            lock = _lock(workspace, wait=True)
            if lock is not None:
                held.callback(os.close, lock)
                yield workspace
                return


def _lock(workspace: Path, *, wait: bool) -> int | None:
    """Return the open lock of a workspace; None where another process holds it, or has just removed it.

    Without locks on the file system, what a killed process left stays until it is removed by hand.
    """
    try:
        return locked_file(workspace / _LOCK, wait=wait)
    except (FileNotFoundError, NotADirectoryError, PermissionError):
        return None


def _remove_leftovers(target: Path) -> None:
    for workspace in _workspaces(target):
        lock = _lock(workspace, wait=False)
        if lock is not None:
            shutil.rmtree(workspace, ignore_errors=True)
            os.close(lock)


def _flush(folder: Path) -> None:
    """Put everything below ``folder`` on the disk, so that a power cut cannot publish names without content."""
    for parent, _, files in os.walk(folder):
        for name in files:
            sync(Path(parent) / name)
        sync(Path(parent))


def sync(path: Path) -> None:
    """Put a file, or the names in a folder, on the disk."""
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
