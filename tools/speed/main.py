"""How long does it take, in which memory, and how does that compare?

Measured in one run on one machine, so that ratios hold:

1. the whole ``trackfg smooth`` process on a simulated hour, and on four hours;
2. the same factors given to GTSAM's LevenbergMarquardtOptimizer;
3. the same data given to python-ins' feedback filter (``pip install "trackfg[peers]"``; left out without it).

    python tools/speed.py [--repeats 3] [--hours 1] [--write docs/performance.md]

Fewer hours make a quick trial; the targets are for one. ``--process`` measures the first alone.
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
from speed.process import ProcessUse, help_cpu_s, measure_smooth
from trackfg.config import KeyframeConfig
from trackfg.numerics.blas_threads import one_thread
from trackfg.numerics.kernels import compiled_kernels
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


SHORT_S = 600.0
"""Length of a run of which starting and importing are a large part."""


@dataclass(frozen=True)
class ProcessTimes:
    """The whole process: on a run of ``hours``, on one :data:`LONGER`, on ten minutes; and ``trackfg --help``."""

    hours: float
    repeats: int
    short: ProcessUse
    long: ProcessUse
    ten_minutes: ProcessUse
    help_s: float


@dataclass(frozen=True)
class Measurements:
    """Everything measured in one run; ``filtered`` is None where python-ins is not installed."""

    process: ProcessTimes
    optimisers: list[OptimiserTimes]
    cholesky: CholeskyOutcome
    filtered: FilterTimes | None


def measure_process(hours: float, repeats: int) -> ProcessTimes:
    """Measure the whole process."""
    with tempfile.TemporaryDirectory(prefix="trackfg-speed-") as folder:
        once = measure_smooth(Path(folder), 3600.0 * hours, repeats)
        longer = measure_smooth(Path(folder), LONGER * 3600.0 * hours, repeats)
        ten_minutes = measure_smooth(Path(folder), SHORT_S, repeats)
    return ProcessTimes(hours, repeats, once, longer, ten_minutes, help_cpu_s(repeats))


@one_thread()
def measure(hours: float, repeats: int) -> Measurements:
    """Measure it all. GTSAM on the denser keyframes, which is slow, is run once."""
    process = measure_process(hours, repeats)
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

    return [
        ["what", "measured", "target", "met"],
        row(f"whole process, {once}: CPU time", short.cpu_s, "s", 7.0 if compiled_kernels() else 11.0),
        row(f"whole process, {once}: wall time", short.wall_s, "s", 6.0),
        row(f"whole process, {once}: peak memory", short.peak_gb, "GB", 1.0),
        row(f"{longer}: CPU time", long.cpu_s / short.cpu_s, "times", 4.1),
        row(f"{longer}: peak memory", long.peak_gb / short.peak_gb, "times", 4.1),
        row("whole process, 10 min: CPU time", p.ten_minutes.cpu_s, "s", 1.8),
        row("trackfg --help: CPU time", p.help_s, "s", 0.4),
    ]


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
    found = versions()
    return [
        f"{model}, {os.cpu_count()} cores",
        ", ".join(
            f"{name} {found[name]}" for name in ("trackfg", "kernels", "python", "gtsam", "numpy", "scipy", "pandas")
        ),
    ]


def page(m: Measurements) -> str:
    """The measurements as a Markdown page."""
    facts = "\n".join(f"- {fact}" for fact in machine())
    first, cholesky, p = m.optimisers[0], m.cholesky, m.process
    failed = "" if cholesky.error is None else f', raising "{cholesky.error}"'
    return f"""# Performance

Written by `python tools/speed.py --repeats {p.repeats} --hours {p.hours:g} --write docs/performance.md`, all of it
measured in that one run. Times differ from machine to machine; the ratios much less. Each time is the shortest of
{p.repeats}; GTSAM on the denser keyframes, GTSAM with Cholesky and python-ins ran once. All but wall times are CPU
times, user and system: wall times scatter with what else the machine does.

{facts}

{markdown(against_targets(m))}

## Where the time goes

`trackfg smooth` on the scenario `mainline`, whose IMU samples at 200 Hz: {p.short.distance_km:.0f} km and
{p.short.keyframes} keyframes in {p.hours:g} h, {p.long.distance_km:.0f} km and {p.long.keyframes} keyframes in
{LONGER * p.hours:g} h.

{markdown(stages(p))}

Stages by the CPU time that `trackfg.smooth` takes for them, in a process of its own. The work of every stage is linear
in the length of the run, and so is its memory, that of the covariance of places included: of more than 500 places it is
kept by blocks, each tied to the next one.

The graph is a chain: the factors of a keyframe touch it, its neighbour and a few scalars shared by the run. Eliminated
from one end to the other, it never fills in: each keyframe costs one QR of the same small size, on its rows at once (by
LAPACK or a compiled kernel) and not by GTSAM's elimination of one variable after the other. The covariances are one
recursion back along the same chain. The initial values come from a pass over the whole run that is close already, so
that a longer run does not need more iterations, and what is tested in every stretch of a run has limits by the number
of stretches, so that it does not need more rounds of reassessment by chance. Reading, standstills, compression of the
IMU samples, our factors and the dense motion are array operations. What is left to Python loops is per keyframe or per
20 ms of motion, never per pair of keyframes.

Linear algebra runs on one thread (`trackfg.numerics.blas_threads`): with matrices of 20 to 60 rows a second one waits
for the first. What the process frees it keeps (`trackfg.cli.freed_memory`): glibc maps each temporary above 32 MB anew,
and the kernel clears it.

## Compiled kernels

Where the installation finds a C++ compiler, it compiles `kernels/` (some seconds, nothing to configure): the QR of the
chain, and preintegration and linearisation of the inertial factors by GTSAM's equations. Without one, `pip install`
says so in a line (`--verbose` shows it) and LAPACK and GTSAM compute the same: they are the reference that the tests
hold each kernel against, to 1e-8 of a sigma. `TRACKFG_KERNELS=numpy` in the environment has them compute in any
installation; `versions` in a result's `summary.json` has `kernels`, `compiled` or `numpy`. The kernels take arrays
through Python's buffer protocol and its stable interface: one build serves Python 3.11 and later, and building needs no
package but setuptools.

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

QR alone: elimination of the linear graph, the same rows with the same variables, and the step. GTSAM's is native code
(`eliminateSequential` with `EliminateQR`, no callback and no copy of values): the least that any optimiser of GTSAM
would take for an iteration.

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
    parser.add_argument("--process", action="store_true", help="measure the whole process alone, and not the peers")
    parser.add_argument("--write", type=Path, metavar="FILE", help="write it all, as a Markdown page")
    arguments = parser.parse_args()
    if arguments.process and arguments.write is not None:
        parser.error("--write needs the peers too: leave --process out")
    if arguments.process:
        process = measure_process(arguments.hours, arguments.repeats)
        for table in (process_against_targets(process), stages(process)):
            print(markdown(table), end="\n\n")
        return
    measured = measure(arguments.hours, arguments.repeats)
    for table in (against_targets(measured), stages(measured.process), optimisers_table(measured)):
        print(markdown(table), end="\n\n")
    if measured.filtered is not None:
        print(markdown(_filter_table(measured.filtered)))
    if arguments.write is not None:
        arguments.write.write_text(page(measured), encoding="utf-8")
