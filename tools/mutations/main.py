"""What the tests hold: errors put into the equations on purpose, each of which a test of its part has to notice.

Each mutation of :mod:`mutations.catalogue` is put into a copy of the project, never into the project itself, and the
tests of its part are run there. A mutation that no test notices survives: that error would pass.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from mutations.catalogue import PARTS, Mutation, Part

ROOT = Path(__file__).resolve().parents[2]

_LEFT_OUT = (".*", "__pycache__", "*.egg-info", "build", "dist", "demo")
_MAPPED = ("factors", "datasets")
"""Packages that stand beside ``trackfg`` and are installed into it."""

_LONGEST_S = 600.0
"""s. The tests of a part take some seconds, all of them some minutes; what runs on for so long was noticed."""

_PASSED, _FAILED = 0, 1
"""What pytest exits with; anything else says that it could not run the tests."""


def main(arguments: list[str] | None = None) -> int:
    """Run the mutations and print which survive; 1 if any does, 2 if the list or the tests are at fault."""
    parser = argparse.ArgumentParser(
        description="Put errors into a copy of the project, one at a time, and see whether the tests notice.",
        epilog="exit status: 0 none survives, 1 some do, 2 a fragment is not in its file once or tests fail anyway",
    )
    parser.add_argument("--only", metavar="WORD", help="those whose file or sentence has this word")
    parser.add_argument("--list", action="store_true", help="name the mutations and their tests, run nothing")
    given = parser.parse_args(arguments)

    chosen = [(part, one) for part in PARTS for one in part.mutations if _is_meant(given.only, part, one)]
    if given.list:
        for part, mutation in chosen:
            print(f"{part.file}: {mutation.sentence}  [{' '.join(part.tests)}]")
        return 0
    misplaced = list(faults(ROOT, (part for part, _ in chosen)))
    if misplaced:
        print(*misplaced, sep="\n", file=sys.stderr)
        return 2
    if not chosen:
        print(f"no mutation has {given.only!r} in its file or sentence. Hint: --list names all", file=sys.stderr)
        return 2
    with _copy_of_the_project() as copy:
        return _run(copy, chosen)


def faults(root: Path, parts: Iterable[Part]) -> Iterator[str]:
    """Name the fragments that do not stand exactly once in their file, and the files and tests that are missing."""
    for part in dict.fromkeys(parts):
        missing = [name for name in (part.file, *part.tests) if not (root / name).exists()]
        if missing:
            yield f"{', '.join(missing)}: there is no such file. Hint: correct tools/mutations/catalogue.py"
            continue
        text = (root / part.file).read_text()
        for mutation in part.mutations:
            for fragment, _ in mutation.changes:
                if (count := text.count(fragment)) != 1:
                    yield (
                        f"{part.file}: {fragment!r} is there {count} times, expected once ({mutation.sentence}). "
                        "Hint: correct tools/mutations/catalogue.py"
                    )


def _run(copy: Path, chosen: list[tuple[Part, Mutation]]) -> int:
    status, report = _tested(copy, list(dict.fromkeys(test for part, _ in chosen for test in part.tests)))
    if status != _PASSED:
        print(f"the tests fail without any mutation\n{report}", file=sys.stderr)
        return 2
    survivors, notices = [], Counter[str]()
    for count, (part, mutation) in enumerate(chosen, 1):
        begin = time.monotonic()
        with _mutated(copy / _installed(part.file), mutation):
            status, report = _tested(copy, part.tests)
        if status not in (_PASSED, _FAILED):
            print(f"{part.file}: {mutation.sentence}: the tests could not be run\n{report}", file=sys.stderr)
            return 2
        notices[part.file] += status == _FAILED
        if status == _PASSED:
            survivors.append((part, mutation))
        outcome = "killed" if status == _FAILED else "SURVIVES"
        took_s = time.monotonic() - begin
        print(f"{count:3d}/{len(chosen)}  {outcome:8s} {took_s:5.1f} s  {part.file}: {mutation.sentence}")
        sys.stdout.flush()
    every = Counter(part.file for part, _ in chosen)
    print(f"\n{'file':44s} {'mutations':>9s} {'killed':>6s} {'survive':>7s}")
    for file, number in every.items():
        print(f"{file:44s} {number:9d} {notices[file]:6d} {number - notices[file]:7d}")
    print(f"{'all':44s} {len(chosen):9d} {notices.total():6d} {len(survivors):7d}")
    for part, mutation in survivors:
        print(f"survives: {part.file}: {mutation.sentence} {mutation.changes}")
    return 1 if survivors else 0


def _is_meant(word: str | None, part: Part, mutation: Mutation) -> bool:
    return word is None or word in part.file or word in mutation.sentence


def _installed(file: str) -> str:
    """Return where a source file is once it is installed."""
    return f"trackfg/{file}" if file.split("/")[0] in _MAPPED else file


@contextmanager
def _copy_of_the_project() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="trackfg-mutations-") as folder:
        copy = Path(folder) / "project"
        shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(*_LEFT_OUT))
        for name in _MAPPED:
            (copy / name).rename(copy / "trackfg" / name)
        # Compiled files that are held against the source's content: two mutations in one second may be of one size.
        compile_all = [sys.executable, "-m", "compileall", "-q", "--invalidation-mode", "checked-hash", "trackfg"]
        subprocess.run(compile_all, cwd=copy, check=True)
        yield copy


@contextmanager
def _mutated(file: Path, mutation: Mutation) -> Iterator[None]:
    sound = mutant = file.read_text()
    for fragment, replacement in mutation.changes:
        mutant = mutant.replace(fragment, replacement)
    file.write_text(mutant)
    try:
        yield
    finally:
        file.write_text(sound)


def _tested(copy: Path, tests: Sequence[str]) -> tuple[int, str]:
    """Return pytest's exit status for some tests, run in the copy, and the end of what it printed."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-m", "not slow", *tests]
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1", "OPENBLAS_NUM_THREADS": "1"}
    try:
        done = subprocess.run(
            command, cwd=copy, env=environment, capture_output=True, text=True, timeout=_LONGEST_S, check=False
        )
    except subprocess.TimeoutExpired:
        return _FAILED, f"no end after {_LONGEST_S:g} s"
    return done.returncode, "\n".join(done.stdout.splitlines()[-10:])
