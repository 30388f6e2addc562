"""How long does the simulator take for an hour of each scenario?

Prints a table: seconds from the call to recording and truth in memory, by the clock and of the processors.
A scenario whose line has an end rests there for what remains of the hour. The target is 20 s at 200 Hz.

    python tools/simulation_speed.py [SCENARIO ...] [--hours 1] [--repeats 1]
"""

from __future__ import annotations

import argparse
from time import perf_counter, process_time

import numpy as np

from trackfg.datasets.scenarios import scenario, scenarios, simulate

SECONDS_PER_HOUR = 3600.0


def measure(name: str, hours: float, repeats: int) -> list[str]:
    """A row of the table: the shortest of so many times counts."""
    times = []
    for _ in range(repeats):
        start, work = perf_counter(), process_time()
        run = simulate(name, duration_s=hours * SECONDS_PER_HOUR)
        times.append(((perf_counter() - start) / hours, (process_time() - work) / hours))
    shortest = (f"{seconds:.1f} s" for seconds in min(times))
    travelled_km = 1e-3 * float(np.abs(np.diff(run.truth["chainage_m"])).sum())
    rate = f"{scenario(name).imu.rate_hz:g} Hz"
    return [name, rate, str(len(scenario(name).lasers)), f"{travelled_km:.1f} km", *shortest]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario", nargs="*", metavar="SCENARIO", help="all, unless some are named")
    parser.add_argument("--hours", type=float, default=1.0, help="length of the runs")
    parser.add_argument("--repeats", type=int, default=1, help="the shortest of this many times counts")
    arguments = parser.parse_args()
    simulate("parked", duration_s=10.0)  # what is done once only, such as imports
    row = "| {:<22} | {:>6} | {:>6} | {:>8} | {:>16} | {:>8} |"
    print(row.format("scenario", "IMU", "lasers", "run", "seconds per hour", "CPU time"))
    print("|------------------------|-------:|-------:|---------:|-----------------:|---------:|")
    for name in arguments.scenario or scenarios():
        print(row.format(*measure(name, arguments.hours, arguments.repeats)), flush=True)
