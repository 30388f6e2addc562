"""Is the working tree slower than a commit? The whole ``trackfg smooth`` of both, in pairs, one after the other; or
``trackfg stream`` of the recording's folder.

Both are installed, compiled kernels included, into folders of their own, and smooth one simulated recording in turns:
what else the machine does slows both of a pair down. It fails where CPU time or peak memory, as the median of the
pairs' ratios, has grown by more than 10 %::

    python tools/paired_speed.py [--against HEAD] [--minutes 20] [--pairs 7] [--stream]
"""

from __future__ import annotations

import argparse
import io
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Callable
from pathlib import Path
from statistics import median

from speed.process import measured, trackfg_command

ROOT = Path(__file__).resolve().parents[2]

MOST_GROWTH = 1.1
"""Ratio of CPU times or of peak memories above which a change is a loss."""

Use = tuple[float, float, float]
"""Wall time and CPU time, s, and peak memory, GB, of a process."""


def installed(source: Path, target: Path) -> Path:
    """Install a source tree into a folder, without what it depends on."""
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", str(target), str(source)]
    subprocess.run(command, check=True)
    return target


def checked_out(commit: str, folder: Path) -> Path:
    """Write the files of a commit into a folder."""
    archive = subprocess.run(["git", "archive", commit], cwd=ROOT, check=True, capture_output=True).stdout
    with tarfile.open(fileobj=io.BytesIO(archive)) as files:
        files.extractall(folder, filter="data")
    return folder


def in_pairs(old: Callable[[], Use], new: Callable[[], Use], pairs: int) -> list[tuple[Use, Use]]:
    """Run both in turns; each is the first of every other pair."""
    uses = []
    for i in range(pairs):
        if i % 2:
            later = new()
            uses.append((old(), later))
        else:
            uses.append((old(), new()))
    return uses


def growth(uses: list[tuple[Use, Use]]) -> dict[str, float]:
    """The median of the pairs' ratios, after to before."""
    quantities = {"CPU time": 1, "peak memory": 2}
    return {name: median(new[i] / old[i] for old, new in uses) for name, i in quantities.items()}


def main() -> int:
    """Print the medians and their ratios; 1 where one has grown by more than :data:`MOST_GROWTH`."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", default="HEAD", metavar="COMMIT", help="what the working tree is compared with")
    parser.add_argument("--minutes", type=float, default=20.0, help="length of the recording")
    parser.add_argument("--pairs", type=int, default=7, help="how often both are run")
    parser.add_argument("--stream", action="store_true", help="stream the recording, and do not smooth it")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="trackfg-bench-") as name:
        folder = Path(name)
        old = installed(checked_out(asked.against, folder / "source"), folder / "before")
        new = installed(ROOT, folder / "after")
        recording = folder / "recording"
        seconds = ["--duration", f"{60.0 * asked.minutes:g}"]
        measured(trackfg_command("simulate", "mainline", "-o", str(recording), *seconds), new)

        def run(packages: Path) -> Use:
            with tempfile.TemporaryDirectory(dir=folder) as results:  # a finished stream is not added to
                asked_for = "stream" if asked.stream else "smooth"
                return measured(trackfg_command(asked_for, str(recording), "-o", f"{results}/result"), packages)

        run(old), run(new)  # reads files and compiles modules for the first time
        uses = in_pairs(lambda: run(old), lambda: run(new), asked.pairs)
    ratios = growth(uses)
    for (what, ratio), i, unit in zip(ratios.items(), (1, 2), ("s", "GB"), strict=True):
        sides = (median(pair[side][i] for pair in uses) for side in (0, 1))
        print("{}: {:.2f} {unit} at {commit}, {:.2f} {unit} now".format(what, *sides, unit=unit, commit=asked.against))
        print(f"    the median of {len(uses)} pairs' ratios is {ratio:.3f}")
    return int(max(ratios.values()) > MOST_GROWTH)
