"""What a power cut leaves: of each file what was put on the disk, under the names that were, old or new and whole."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from trackfg.files import atomic_file, atomic_folder
from trackfg.files.atomic_file import replaced_file, write_whole
from trackfg.files.atomic_folder import recover, replaced_folder
from trackfg.streaming.checkpoint.checkpoint import Checkpoint, Checkpoints

Content = dict[str, bytes]


class Disk:
    """Keeps, by inode, what ``fsync`` has put on the disk, and writes what a power cut leaves at each system call.

    Two disks are modelled: one that forgets every name that was not synced, and one that keeps all names, but of files
    only the content that was synced. What lies between the two is a mixture of both.
    """

    def __init__(self, root: Path, patch: pytest.MonkeyPatch) -> None:
        self.root = root
        self._files: dict[int, bytes] = {}
        self._names: dict[int, dict[str, int]] = {}
        self._held: list[int] = []  # open, so that no inode is used again
        self.states: list[Content] = []
        for path in [root, *root.rglob("*")]:
            self.sync(os.open(path, os.O_RDONLY))
        fsync, replace, rename = os.fsync, Path.replace, Path.rename

        def synced(descriptor: int) -> None:
            self.cut()
            fsync(descriptor)
            self.sync(os.dup(descriptor))
            self.cut()

        def around(call: Callable[[Path, Path], Path]) -> Callable[[Path, Path], Path]:
            def called(path: Path, target: Path) -> Path:
                self.cut()
                done = call(path, target)
                self.cut()
                return done

            return called

        patch.setattr(os, "fsync", synced)
        patch.setattr(Path, "replace", around(replace))
        patch.setattr(Path, "rename", around(rename))
        exchange = atomic_folder._exchange
        patch.setattr(atomic_folder, "_exchange", lambda a, b: (self.cut(), exchange(a, b), self.cut()))

    def sync(self, descriptor: int) -> None:
        self._held.append(descriptor)
        inode, path = os.fstat(descriptor).st_ino, Path(f"/proc/self/fd/{descriptor}").resolve()
        if path.is_dir():
            self._names[inode] = {each.name: each.lstat().st_ino for each in path.iterdir()}
        else:
            self._files[inode] = path.read_bytes()

    def cut(self) -> None:
        """Note what a power cut leaves now on either disk."""
        self.states.append(self._forgetful(self.root.stat().st_ino, ""))
        named = {path: path.lstat().st_ino for path in self.root.rglob("*") if path.is_file()}
        self.states.append(
            {str(path.relative_to(self.root)): self._files.get(inode, b"") for path, inode in named.items()}
        )

    def _forgetful(self, folder: int, prefix: str) -> Content:
        found: Content = {}
        for name, inode in self._names.get(folder, {}).items():
            if inode in self._names:
                found |= self._forgetful(inode, f"{prefix}{name}/")
            else:
                found[prefix + name] = self._files.get(inode, b"")
        return found


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Callable[[], Disk]]:
    if not Path("/proc/self/fd").exists():
        pytest.skip("open files cannot be looked up")
    with pytest.MonkeyPatch.context() as patch:
        yield lambda: Disk(tmp_path, patch)


def _visible(state: Content, name: str) -> Content:
    return {path: content for path, content in state.items() if path == name or path.startswith(f"{name}/")}


def test_a_file_is_the_old_or_the_new_one(tmp_path: Path, disk: Callable[[], Disk]) -> None:
    path = tmp_path / "page.html"
    path.write_bytes(b"old")
    watched = disk()
    write_whole(path, b"new")
    with replaced_file(path) as place:
        pd.DataFrame({"x": np.arange(1000.0)}).to_csv(place, index=False)
    table = path.read_bytes()
    seen = {state["page.html"] for state in watched.states}
    assert seen == {b"old", b"new", table}
    assert watched.states[-2]["page.html"] == table  # it is on the disk when the call is over


@pytest.mark.parametrize("exchanges", [True, False])
def test_a_folder_is_the_old_or_the_new_one(
    *, exchanges: bool, tmp_path: Path, disk: Callable[[], Disk], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "a").write_bytes(b"old a")
    (out / "b").write_bytes(b"old b")
    old = {"out/a": b"old a", "out/b": b"old b"}
    new = {"out/a": b"new a", "out/c/d": b"new d"}
    if not exchanges:

        def refuse(*_: object) -> None:
            raise OSError(38, "not here")

        monkeypatch.setattr(atomic_folder, "_exchange", refuse)
    watched = disk()
    with replaced_folder(out) as folder:
        (folder / "a").write_bytes(b"new a")
        (folder / "c").mkdir()
        (folder / "c" / "d").write_bytes(b"new d")
    for number, state in enumerate(watched.states):
        left = _visible(state, "out")
        if left in (old, new):
            continue
        assert not left  # moved away, between two renames: the next look puts it back
        place = tmp_path / f"cut{number}"
        for name, content in state.items():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            (place / name).write_bytes(content)
        recover(place / "out")
        assert {f"out/{path.name}": path.read_bytes() for path in (place / "out").iterdir()} == old
    assert _visible(watched.states[-2], "out") == new


def test_a_checkpoint_is_the_old_or_the_new_one(tmp_path: Path, disk: Callable[[], Disk]) -> None:
    checkpoints = Checkpoints(tmp_path / "checkpoint", every_s=1.0)
    checkpoints.write(Checkpoint({"lag_s": 1.0}, {"rows": 1}))
    first = checkpoints.path.read_bytes()
    watched = disk()
    checkpoints.write(Checkpoint({"lag_s": 1.0}, {"rows": 2}))
    second = checkpoints.path.read_bytes()
    assert {state["checkpoint"] for state in watched.states} == {first, second}


def test_a_file_that_is_not_put_on_the_disk_is_found_out(
    tmp_path: Path, disk: Callable[[], Disk], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "page.html"
    path.write_bytes(b"old")
    watched = disk()
    monkeypatch.setattr(atomic_file, "sync", lambda _: None)
    write_whole(path, b"new")
    watched.cut()
    assert b"" in {state["page.html"] for state in watched.states}
