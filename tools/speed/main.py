"""How long does it take, in which memory, and how does that compare?

Measured in one run on one machine, so that ratios hold:

1. the whole ``trackfg smooth`` process on a simulated hour, and on four hours;
2. the same factors given to GTSAM's LevenbergMarquardtOptimizer;
3. the same data given to python-ins' feedback filter (``pip install "trackfg[peers]"``; left out without it).

    python tools/speed.py [--repeats 3] [--hours 1] [--write docs/performance.md]

Fewer hours make a quick trial; the targets are for one.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

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
from speed.process import ProcessUse, measure_smooth
from trackfg.config import KeyframeConfig
from trackfg.peers.python_ins import VELOCITY_HZ
from trackfg.results.summary import versions

LONGER = 4
"""How many times longer the second run is."""

OPTIMISER_S = 300.0
"""Length of the run given to GTSAM's optimiser and to python-ins."""

SPACINGS = (KeyframeConfig(), KeyframeConfig(interval_s=0.5), KeyframeConfig(interval_s=0.5, distance_m=2.5))
"""Keyframe spacings for GTSAM's optimiser, whose time grows with the square of their number: the default one, a
keyframe every 0.5 s, one every 0.5 s or 2.5 m.
"""


@dataclass(frozen=True)
class Measurements:
    """Everything measured in one run; ``filtered`` is None where python-ins is not installed."""

    hours: float
    repeats: int
    short: ProcessUse
    long: ProcessUse
    optimisers: list[OptimiserTimes]
    cholesky: CholeskyOutcome
    filtered: FilterTimes | None


def measure(hours: float, repeats: int) -> Measurements:
    """Measure it all. GTSAM on the denser keyframes, which is slow, is run once."""
    with tempfile.TemporaryDirectory(prefix="trackfg-speed-") as folder:
        short = measure_smooth(Path(folder), 3600.0 * hours, repeats)
        long = measure_smooth(Path(folder), LONGER * 3600.0 * hours, repeats)
    problems = [plain_problem(simulated(OPTIMISER_S), spacing) for spacing in SPACINGS]
    optimisers = [compare_optimisers(problem, repeats if i == 0 else 1) for i, problem in enumerate(problems)]
    cholesky = with_cholesky(problems[0])
    return Measurements(
        hours, repeats, short, long, optimisers, cholesky, compare_filter(simulated(OPTIMISER_S), repeats)
    )


def against_targets(m: Measurements) -> list[list[str]]:
    """What was measured, the target, and whether it is met; header first."""
    short, long = m.short, m.long
    once, longer = f"{m.hours:g} h ({short.distance_km:.0f} km)", f"{LONGER * m.hours:g} h against {m.hours:g} h"
    rows = [
        ["what", "measured", "target", "met"],
        [f"whole process, {once}: time", f"{short.wall_s:.1f} s", "<= 15 s", _met(short.wall_s <= 15.0)],
        [f"whole process, {once}: CPU time", f"{short.cpu_s:.1f} s", "", ""],
        [f"whole process, {once}: peak memory", f"{short.peak_gb:.2f} GB", "<= 1.5 GB", _met(short.peak_gb <= 1.5)],
    ]
    for name, ratio in (("time", long.wall_s / short.wall_s), ("peak memory", long.peak_gb / short.peak_gb)):
        rows.append([f"{longer}: {name}", f"{ratio:.2f} times", "<= 4.3 times", _met(ratio <= 4.3)])
    for times in m.optimisers:
        name = f"GTSAM's LevenbergMarquardtOptimizer, {OPTIMISER_S:g} s, {times.keyframes} keyframes"
        rows.append([name, f"{times.ratio:.0f} times slower", ">= 50 times", _met(times.ratio >= 50.0)])
    name = f"python-ins' feedback filter, {OPTIMISER_S:g} s, per IMU sample"
    if m.filtered is None:
        return [*rows, [name, "python-ins is not installed", ">= 50 times", ""]]
    ratio = m.filtered.ratio
    return [*rows, [name, f"{ratio:.0f} times slower", ">= 50 times", _met(ratio >= 50.0)]]


def _met(met: bool) -> str:
    return "yes" if met else "no"


def stages(m: Measurements) -> list[list[str]]:
    """What each stage of the process took; header first."""
    short, long = m.short, m.long
    rows = [["stage", f"{m.hours:g} h", f"{LONGER * m.hours:g} h"]]
    rows += [[stage, f"{short.stages_s[stage]:.2f} s", f"{long.stages_s[stage]:.2f} s"] for stage in short.stages_s]
    rows.append(
        ["start, imports, reading, writing", f"{short.outside_stages_s:.2f} s", f"{long.outside_stages_s:.2f} s"]
    )
    rows.append(["whole process", f"{short.wall_s:.2f} s", f"{long.wall_s:.2f} s"])
    return [*rows, ["iterations of the last solve", f"{short.iterations}", f"{long.iterations}"]]


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
    rows = [[*head, "GTSAM", "of which callbacks", "copies"]]
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
            ]
        )
    return rows


def machine() -> list[str]:
    """Processor and cores; the versions that matter."""
    cpuinfo = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    model = next((line.split(":", 1)[1].strip() for line in cpuinfo if line.startswith("model name")), "unknown")
    found = versions()
    return [
        f"{model}, {os.cpu_count()} cores",
        ", ".join(f"{name} {found[name]}" for name in ("trackfg", "python", "gtsam", "numpy", "scipy", "pandas")),
    ]


def page(m: Measurements) -> str:
    """The measurements as a Markdown page."""
    facts = "\n".join(f"- {fact}" for fact in machine())
    first, cholesky = m.optimisers[0], m.cholesky
    failed = "" if cholesky.error is None else f', raising "{cholesky.error}"'
    return f"""# Performance

Written by `python tools/speed.py --repeats {m.repeats} --hours {m.hours:g} --write docs/performance.md`, all of it
measured in that one run. Times differ from machine to machine; the ratios much less. Each time is the shortest of
{m.repeats}; GTSAM on the denser keyframes, GTSAM with Cholesky and python-ins ran once.

{facts}

{markdown(against_targets(m))}

## Where the time goes

`trackfg smooth` on the scenario `mainline`, whose IMU samples at 200 Hz: {m.short.distance_km:.0f} km and
{m.short.keyframes} keyframes in {m.hours:g} h, {m.long.distance_km:.0f} km and {m.long.keyframes} keyframes in
{LONGER * m.hours:g} h.

{markdown(stages(m))}

The work of every stage is linear in the length of the run, and so is its memory. The graph is a chain: the factors of a
keyframe touch it, its neighbour and a few scalars shared by the run. Eliminated from one end to the other, it never
fills in: each keyframe costs one QR of the same small size, by LAPACK on its rows at once and not by GTSAM's
elimination of one variable after the other. The covariances are one recursion back along the same chain. The initial
values come from a pass over the whole run that is close already, so that a longer run does not need more iterations.
Reading, standstills, compression of the IMU samples, our factors and the dense motion are array operations. What is
left to Python loops is per keyframe or per 20 ms of motion, never per pair of keyframes.

## GTSAM's optimiser on the same factors

The graph of a run on `mainline` (at a latitude, so that the Earth turns) without robust losses: both minimise the same
sum of squares from the same initial values. GTSAM's LevenbergMarquardtOptimizer with SEQUENTIAL_QR and the chain's
ordering, our factors as `gtsam.CustomFactor`, against `trackfg.solver.gauss_newton.solve`. Each stops by its own rule;
the costs tell whether they reached the same minimum.

{markdown(optimisers_table(m))}

Callbacks: linearising the graph and computing its cost outside the optimiser, over values that Python owns. Copies:
what remains of an iteration after callbacks and elimination, nearly all of it the copy of all values that each callback
is handed inside the optimiser. It grows with the square of the number of keyframes, and the ratio with their number.
trackfg has no callbacks: a family of factors is one array operation.

With MULTIFRONTAL_CHOLESKY, GTSAM's default, and the same ordering the {OPTIMISER_S:g} s run is after
{cholesky.iterations} iterations and {cholesky.seconds:.0f} s at cost {cholesky.cost:.4f}{failed}; the minimum is
{first.ours_cost:.4f}.

## python-ins on the same data

{_filter_text(m.filtered)}
"""


def _filter_text(times: FilterTimes | None) -> str:
    if times is None:
        return 'Not measured: `pip install "trackfg[peers]"`.'
    return f"""Its feedback extended Kalman filter with body velocities from the tachometer at {VELOCITY_HZ:g} Hz,
twice as often as trackfg has keyframes and cheaper for it than more; noise densities as declared. It does not estimate
the wheel's scale and is given the true one, and the true attitude at the start. The Earth turns in this run, because
python-ins always models that.

{markdown(_filter_table(times))}

Per IMU sample, after imports and compilation: all of the smoother from recording to trajectory, all of the filter. The
error is the standard deviation of cross-level along this one run after its first minute, so that the constant part,
which the accelerometer's bias makes, is not in it; a filter knows the past alone and a smoother the whole run."""


def _filter_table(times: FilterTimes) -> list[list[str]]:
    return [
        ["", "per IMU sample", "cross-level error"],
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
    parser.add_argument("--write", type=Path, metavar="FILE", help="write it all, as a Markdown page")
    arguments = parser.parse_args()
    measured = measure(arguments.hours, arguments.repeats)
    for table in (against_targets(measured), stages(measured), optimisers_table(measured)):
        print(markdown(table), end="\n\n")
    if measured.filtered is not None:
        print(markdown(_filter_table(measured.filtered)))
    if arguments.write is not None:
        arguments.write.write_text(page(measured), encoding="utf-8")
