"""The whole ``trackfg smooth`` process: wall and CPU time, peak memory, and its stages' own timings."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class ProcessUse:
    """What one process took. ``stages_s`` is what the summary says of each stage."""

    wall_s: float
    cpu_s: float
    peak_gb: float
    stages_s: dict[str, float]
    distance_km: float
    keyframes: int
    iterations: int

    @property
    def outside_stages_s(self) -> float:
        """Starting, importing, reading and writing."""
        return self.wall_s - sum(self.stages_s.values())


def measure_smooth(folder: Path, duration_s: float, repeats: int) -> ProcessUse:
    """The fastest of ``repeats`` processes on a simulated run of ``mainline``; everything is written to ``folder``.

    The run is simulated by a process of its own: a process's peak memory is at least its parent's when it is started.
    """
    recording, out = folder / f"recording-{duration_s:g}", folder / f"result-{duration_s:g}"
    simulate = _trackfg("simulate", "mainline", "-o", str(recording), "--duration", str(duration_s))
    subprocess.run(simulate, check=True, stdout=subprocess.DEVNULL)
    uses = [_smooth_once(recording, out) for _ in range(repeats)]
    return min(uses, key=lambda use: use.wall_s)


def _smooth_once(recording: Path, out: Path) -> ProcessUse:
    start = time.perf_counter()
    process = subprocess.Popen(_trackfg("smooth", str(recording), "-o", str(out)), stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    wall_s = time.perf_counter() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise subprocess.CalledProcessError(process.returncode, process.args)
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    return ProcessUse(
        wall_s=wall_s,
        cpu_s=usage.ru_utime + usage.ru_stime,
        peak_gb=usage.ru_maxrss * 1024 / 1e9,
        stages_s=summary["timings_s"],
        distance_km=summary["distance_m"] / 1e3,
        keyframes=summary["keyframes"],
        iterations=summary["solver"]["iterations"],
    )


def _trackfg(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "trackfg", *arguments]
