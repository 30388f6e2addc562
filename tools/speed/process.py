"""The whole ``trackfg smooth`` process: wall and CPU time, peak memory, and the CPU time of its stages."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from trackfg.factors.states import KEYFRAME_DIM, SHARED_DIM


@dataclass(frozen=True)
class ProcessUse:
    """What one process took, and the CPU time of each stage (:mod:`speed.stages`); ``rows``: of the linear system."""

    wall_s: float
    cpu_s: float
    peak_gb: float
    stages_s: dict[str, float]
    distance_km: float
    keyframes: int
    iterations: int
    rows: int
    recording: Path
    result: Path


def measure_smooth(folder: Path, duration_s: float, repeats: int, scenario: str = "mainline") -> ProcessUse:
    """The process of ``repeats`` with the least CPU time on a simulated run; all goes to ``folder``.

    The run is simulated by a process of its own: a process's peak memory is at least its parent's when it is started.
    """
    recording, out = (folder / f"{kind}-{scenario}-{duration_s:g}" for kind in ("recording", "result"))
    simulate = trackfg_command("simulate", scenario, "-o", str(recording), "--duration", str(duration_s))
    subprocess.run(simulate, check=True, stdout=subprocess.DEVNULL)
    wall_s, cpu_s, peak_gb = least_cpu(trackfg_command("smooth", str(recording), "-o", str(out)), repeats)
    stages = subprocess.run(
        [sys.executable, "-m", "speed.stages", str(recording.resolve()), str(out.resolve())],
        check=True,
        capture_output=True,
        cwd=Path(__file__).resolve().parents[1],
    )
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    keyframes, solver = summary["keyframes"], summary["solver"]
    return ProcessUse(
        wall_s=wall_s,
        cpu_s=cpu_s,
        peak_gb=peak_gb,
        stages_s=json.loads(stages.stdout),
        distance_km=summary["distance_m"] / 1e3,
        keyframes=keyframes,
        iterations=solver["iterations"],
        rows=solver["degrees_of_freedom"] + keyframes * KEYFRAME_DIM + SHARED_DIM,
        recording=recording,
        result=out,
    )


def help_cpu_s(repeats: int) -> float:
    """CPU time of ``trackfg --help``."""
    return least_cpu(trackfg_command("--help"), repeats)[1]


def least_cpu(command: list[str], repeats: int) -> tuple[float, float, float]:
    """Wall time, CPU time (s) and peak memory (GB) of the process of ``repeats`` that took the least CPU time."""
    return min((measured(command) for _ in range(repeats)), key=lambda use: use[1])


def measured(command: list[str], packages: Path | None = None) -> tuple[float, float, float]:
    """Wall time, CPU time (s) and peak memory (GB) of one process, which imports from ``packages`` first.

    Python keeps the bytecode of what it imports, as it does for users: where the environment forbids that, every
    process would compile all sources anew.
    """
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    if packages is not None:
        environment["PYTHONPATH"] = str(packages)
    start = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, env=environment, cwd=packages)
    _, status, usage = os.wait4(process.pid, 0)
    wall_s = time.perf_counter() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise subprocess.CalledProcessError(process.returncode, process.args)
    return wall_s, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024 / 1e9


def trackfg_command(*arguments: str) -> list[str]:
    """The command line of ``trackfg`` in this interpreter."""
    return [sys.executable, "-m", "trackfg", *arguments]
