"""How long does it take, in which memory, and how does that compare?

Measured in one run on one machine, so that ratios hold:

1. the whole ``trackfg smooth`` process on a simulated hour, on ten minutes, on four hours, and on an hour with lasers;
   with ``--day`` on 24 hours, which takes 10 GB of memory to simulate;
2. the same factors given to GTSAM's LevenbergMarquardtOptimizer;
3. the same data given to python-ins' feedback filter (``pip install "trackfg[peers]"``; left out without it).

    python tools/speed.py [--repeats 3] [--hours 1] [--day] [--write docs/performance.md]

Fewer hours make a quick trial; the targets are for one. ``--process`` measures the first alone. ``--write`` fills the
tables of the page with what was measured; its sentences, and the tables of what was not, stay.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

from speed.limits import limits_table, measured_machine
from speed.page import filled
from speed.peers import (
    CholeskyOutcome,
    FilterTimes,
    OptimiserTimes,
    compare_filter,
    compare_optimisers,
    plain_problem,
    simulated,
    with_cholesky,
)
from speed.process import ProcessUse, help_cpu_s, measure_smooth
from trackfg.config import KeyframeConfig
from trackfg.numerics.blas_threads import one_thread
from trackfg.numerics.kernels import compiled_kernels
from trackfg.results.summary import versions

LONGER = 4
"""How many times longer the second run is."""

OPTIMISER_S = 300.0
"""Length of the run given to GTSAM's optimiser and to python-ins."""

SPACINGS = (KeyframeConfig(), KeyframeConfig(interval_s=0.5), KeyframeConfig(interval_s=0.5, distance_m=2.5))
"""Keyframe spacings for GTSAM's optimiser, whose time grows with the square of their number: the default one, a
keyframe every 0.5 s, one every 0.5 s or 2.5 m.
"""


SHORT_S = 600.0
"""Length of a run of which starting and importing are a large part."""

LASERS = "measuring-car"
"""A scenario whose lasers tie keyframes far apart."""

DAY_H = 24.0

PARTS = ("how", "targets", "stages", "limits", "lengths", "optimisers", "cholesky", "python-ins")
"""What the page has places for."""


@dataclass(frozen=True)
class ProcessTimes:
    """The whole process: on a run of ``hours``, on one :data:`LONGER`, on ten minutes, with lasers; on a day, if it was
    measured; ``trackfg --help``; and each stage's least time.
    """

    hours: float
    repeats: int
    short: ProcessUse
    long: ProcessUse
    ten_minutes: ProcessUse
    lasers: ProcessUse
    day: ProcessUse | None
    help_s: float
    limits: list[list[str]]


@dataclass(frozen=True)
class Measurements:
    """Everything measured in one run; ``filtered`` is None where python-ins is not installed."""

    process: ProcessTimes
    optimisers: list[OptimiserTimes]
    cholesky: CholeskyOutcome
    filtered: FilterTimes | None


def measure_process(hours: float, repeats: int, *, day: bool = False) -> ProcessTimes:
    """Measure the whole process, each length as many times: a ratio is that of the least times of both."""
    with tempfile.TemporaryDirectory(prefix="trackfg-speed-") as name:
        folder = Path(name)
        once = measure_smooth(folder, 3600.0 * hours, repeats)
        return ProcessTimes(
            hours=hours,
            repeats=repeats,
            short=once,
            long=measure_smooth(folder, LONGER * 3600.0 * hours, repeats),
            ten_minutes=measure_smooth(folder, SHORT_S, repeats),
            lasers=measure_smooth(folder, 3600.0 * hours, repeats, LASERS),
            day=measure_smooth(folder, 3600.0 * DAY_H, repeats) if day else None,
            help_s=help_cpu_s(repeats),
            limits=limits_table(once, measured_machine()),
        )


@one_thread()
def measure(hours: float, repeats: int, *, day: bool = False) -> Measurements:
    """Measure it all. GTSAM on the denser keyframes, which is slow, is run once."""
    process = measure_process(hours, repeats, day=day)
    problems = [plain_problem(simulated(OPTIMISER_S), spacing) for spacing in SPACINGS]
    optimisers = [compare_optimisers(problem, repeats if i == 0 else 1) for i, problem in enumerate(problems)]
    cholesky = with_cholesky(problems[0])
    return Measurements(process, optimisers, cholesky, compare_filter(simulated(OPTIMISER_S), repeats))


def process_against_targets(p: ProcessTimes) -> list[list[str]]:
    """What was measured of the process, the target, and whether it is met; header first."""
    short, long = p.short, p.long
    once, longer = f"{p.hours:g} h ({short.distance_km:.0f} km)", f"{LONGER * p.hours:g} h against {p.hours:g} h"

    def row(what: str, value: float, unit: str, limit: float | None) -> list[str]:
        digits = 2 if value < 5.0 else 1
        target = ["", ""] if limit is None else [f"<= {limit:g} {unit}", _met(value <= limit)]
        return [what, f"{value:.{digits}f} {unit}", *target]

    laser = f"{LASERS}, {p.hours:g} h ({p.lasers.distance_km:.0f} km)"
    rows = [
        ["what", "measured", "target", "met"],
        row(f"whole process, {once}: CPU time", short.cpu_s, "s", 7.0 if compiled_kernels() else 11.0),
        row(f"whole process, {once}: wall time", short.wall_s, "s", 6.0),
        row(f"whole process, {once}: peak memory", short.peak_gb, "GB", 1.0),
        row(f"{longer}: CPU time", long.cpu_s / short.cpu_s, "times", 4.1),
        row(f"{longer}: peak memory", long.peak_gb / short.peak_gb, "times", 4.1),
        row("whole process, 10 min: CPU time", p.ten_minutes.cpu_s, "s", 1.8),
        row("trackfg --help: CPU time", p.help_s, "s", 0.4),
        row(f"{laser}: CPU time", p.lasers.cpu_s, "s", 15.0),
        row(f"{laser}: peak memory", p.lasers.peak_gb, "GB", 1.5),
    ]
    if p.day is not None:
        rows.append(row(f"{DAY_H:g} h against {p.hours:g} h: CPU time", p.day.cpu_s / short.cpu_s, "times", 25.0))
        rows.append(row(f"{DAY_H:g} h: peak memory", p.day.peak_gb, "GB", 2.0))
    return rows


def against_targets(m: Measurements) -> list[list[str]]:
    """What was measured, the target, and whether it is met; header first."""
    rows = process_against_targets(m.process)
    for times in m.optimisers:
        name = f"GTSAM's LevenbergMarquardtOptimizer, {OPTIMISER_S:g} s, {times.keyframes} keyframes"
        rows.append([name, f"{times.ratio:.0f} times slower", ">= 50 times", _met(times.ratio >= 50.0)])
        ratio = times.gtsam_qr_s / times.ours_qr_s
        name = f"GTSAM's native sequential QR of the same rows, {times.keyframes} keyframes"
        rows.append([name, f"{ratio:.1f} times slower", ">= 1 times", _met(ratio >= 1.0)])
    name = f"python-ins' feedback filter, {OPTIMISER_S:g} s, per IMU sample"
    if m.filtered is None:
        return [*rows, [name, "python-ins is not installed", ">= 50 times", ""]]
    ratio = m.filtered.ratio
    return [*rows, [name, f"{ratio:.0f} times slower", ">= 50 times", _met(ratio >= 50.0)]]


def _met(met: bool) -> str:
    return "yes" if met else "no"


def stages(p: ProcessTimes) -> list[list[str]]:
    """The CPU time of each stage; header first."""
    short, long = p.short, p.long
    rows = [["stage", f"{p.hours:g} h", f"{LONGER * p.hours:g} h", "times"]]
    for stage, seconds in short.stages_s.items():
        rows.append(
            [stage, f"{seconds:.2f} s", f"{long.stages_s[stage]:.2f} s", f"{long.stages_s[stage] / seconds:.1f}"]
        )
    rows.append(["whole process", f"{short.cpu_s:.2f} s", f"{long.cpu_s:.2f} s", f"{long.cpu_s / short.cpu_s:.1f}"])
    return [*rows, ["iterations of the last solve", f"{short.iterations}", f"{long.iterations}", ""]]


def optimisers_table(m: Measurements) -> list[list[str]]:
    """Both optimisers on the same plain problems; header first."""
    head = [
        "keyframe every",
        "number",
        "factors",
        "trackfg",
        "GTSAM",
        "cost: trackfg",
        "GTSAM",
        "per iteration: trackfg",
    ]
    rows = [[*head, "GTSAM", "of which callbacks", "copies", "QR alone: trackfg", "GTSAM"]]
    for spacing, times in zip(SPACINGS, m.optimisers, strict=True):
        ours_s, gtsam_s = times.ours_s / times.ours_iterations, times.gtsam_s / times.gtsam_iterations
        rows.append(
            [
                f"{spacing.interval_s:g} s or {spacing.distance_m:g} m",
                f"{times.keyframes}",
                f"{times.factors}",
                f"{times.ours_s:.2f} s",
                f"{times.gtsam_s:.1f} s",
                f"{times.ours_cost:.4f}",
                f"{times.gtsam_cost:.4f}",
                f"{ours_s:.3f} s",
                f"{gtsam_s:.2f} s",
                f"{100.0 * times.callbacks_s / gtsam_s:.0f} %",
                f"{100.0 * times.copies_share:.0f} %",
                f"{times.ours_qr_s:.3f} s",
                f"{times.gtsam_qr_s:.3f} s",
            ]
        )
    return rows


def machine() -> list[str]:
    """Processor and cores; the versions that matter."""
    cpuinfo = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    model = next((line.split(":", 1)[1].strip() for line in cpuinfo if line.startswith("model name")), "unknown")
    version_of = versions()
    return [
        f"{model}, {os.cpu_count()} cores",
        ", ".join(
            f"{name} {version_of[name]}"
            for name in ("trackfg", "kernels", "python", "gtsam", "numpy", "scipy", "pandas")
        ),
    ]


def lengths(p: ProcessTimes) -> list[list[str]]:
    """Time and memory by the length of the run; header first."""
    rows = [["length", "distance", "keyframes", "CPU time", "wall time", "peak memory", f"against {p.hours:g} h"]]
    uses = [("10 min", p.ten_minutes)]
    uses += [(f"{hours:g} h", use) for hours, use in ((p.hours, p.short), (LONGER * p.hours, p.long), (DAY_H, p.day))]
    for name, use in uses:
        if use is not None:
            against = f"{use.cpu_s / p.short.cpu_s:.2f} times"
            cpu, wall = f"{use.cpu_s:.1f} s", f"{use.wall_s:.1f} s"
            km, number = f"{use.distance_km:.0f} km", f"{use.keyframes}"
            rows.append([name, km, number, cpu, wall, f"{use.peak_gb:.2f} GB", against])
    return rows


def parts(m: Measurements) -> dict[str, str]:
    """What the page says of the measurements, by the names of its parts (:mod:`speed.page`)."""
    texts = (
        _how_text(m.process),
        *map(markdown, (against_targets(m), stages(m.process), m.process.limits, lengths(m.process))),
        markdown(optimisers_table(m)),
        _cholesky_text(m),
        None if m.filtered is None else markdown(_filter_table(m.filtered)),
    )
    return {name: text for name, text in zip(PARTS, texts, strict=True) if text is not None}


def _how_text(p: ProcessTimes) -> str:
    asked = f"--repeats {p.repeats} --hours {p.hours:g}" + (" --day" if p.day is not None else "")
    facts = "\n".join(f"- {fact}" for fact in machine())
    return f"""Measured by `python tools/speed.py {asked} --write docs/performance.md`, all of it in that one run. Each
time is the shortest of {p.repeats}; GTSAM on the denser keyframes, GTSAM with Cholesky and python-ins ran once.
All but wall times are CPU times, user and system.

{facts}"""


def _cholesky_text(m: Measurements) -> str:
    failed = "" if m.cholesky.error is None else f', raising "{m.cholesky.error}"'
    return f"""With MULTIFRONTAL_CHOLESKY, GTSAM's default, and the same ordering the {OPTIMISER_S:g} s run is after
{m.cholesky.iterations} iterations and {m.cholesky.seconds:.0f} s at cost {m.cholesky.cost:.4f}{failed}; the minimum is
{m.optimisers[0].ours_cost:.4f}."""


def _filter_table(times: FilterTimes) -> list[list[str]]:
    return [
        ["system", "per IMU sample", "cross-level error"],
        ["trackfg", f"{1e6 * times.smoother_s:.1f} us", f"{times.smoother_mm:.2f} mm"],
        ["python-ins", f"{1e6 * times.filter_s:.0f} us", f"{times.filter_mm:.2f} mm"],
    ]


def markdown(rows: list[list[str]]) -> str:
    """A table, header first, aligned so that it reads as well unrendered."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = [
        "| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) + " |" for row in rows
    ]
    rule = "|" + "|".join("-" * (width + 2) for width in widths) + "|"
    return "\n".join([lines[0], rule, *lines[1:]])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=3, help="the shortest of this many times counts")
    parser.add_argument("--hours", type=float, default=1.0, help="length of the run of the whole process")
    parser.add_argument("--process", action="store_true", help="measure the whole process alone, and not the peers")
    parser.add_argument("--day", action="store_true", help="measure a run of 24 hours as well")
    parser.add_argument("--write", type=Path, metavar="FILE", help="fill the tables of this Markdown page")
    arguments = parser.parse_args()
    if arguments.process and arguments.write is not None:
        parser.error("--write needs the peers too: leave --process out")
    if arguments.process:
        process = measure_process(arguments.hours, arguments.repeats, day=arguments.day)
        for table in (process_against_targets(process), stages(process), process.limits, lengths(process)):
            print(markdown(table), end="\n\n")
        return
    measured = measure(arguments.hours, arguments.repeats, day=arguments.day)
    sections = parts(measured)
    print("\n\n".join(sections.values()))
    if arguments.write is not None:
        page = arguments.write.read_text(encoding="utf-8")
        arguments.write.write_text(filled(page, sections), encoding="utf-8")
