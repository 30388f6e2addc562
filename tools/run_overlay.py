"""How well `trackfg overlay` finds the known drift of made-up pairs of recording-car runs, and how long it takes.

    python tools/run_overlay.py                       errors and sigmas over noise and seeds
    python tools/run_overlay.py --km 100 --seeds 1    one long pair, with time and memory
    python tools/run_overlay.py --files A B           two tables of recording cars: shifts and repeatability

The track is random, with waves of 2 to 40 m; the runs have left and right level and alignment to 0.01 mm every 0.25 m.
The second run's chainage is 6 m off from the start and drifts by a random walk of 15 cm per 500 m.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline

from trackfg.interchange.importing.channels.source_geometry import read_geometry
from trackfg.mapping.runs.run_overlay import RunOverlay, overlaid
from trackfg.numerics.arrays import Array

STEP_M = 0.25
FINE_M = 0.125
OFFSET_M, WALK_M, WALK_EVERY_M = 6.0, 0.15, 500.0
CHANNELS = ("level_left_mm", "level_right_mm", "alignment_left_mm", "alignment_right_mm")
NOISES_MM = (0.05, 0.15, 0.5)


def irregularities(length_m: float, rng: np.random.Generator) -> CubicSpline:
    """Return waves of 2 to 40 m, of 1 mm rms, with a spectrum that falls with the square of the frequency."""
    n = int((length_m + 200.0) / FINE_M)
    f = np.fft.rfftfreq(n, FINE_M)
    shape = np.where((f > 1.0 / 40.0) & (f < 0.5), 1.0 / np.maximum(f, 1e-3), 0.0)
    z = np.fft.irfft(shape * (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f))), n)
    return CubicSpline(FINE_M * np.arange(n) - 100.0, z / z.std())


def pair(folder: Path, length_m: float, noise_mm: float, seed: int) -> CubicSpline:
    """Write runs a.csv and b.csv into a folder; return by how much the chainage of b is too great there."""
    rng = np.random.default_rng(seed)
    x = STEP_M * np.arange(round(length_m / STEP_M))
    knots = np.arange(0.0, length_m + 2.0 * WALK_EVERY_M, WALK_EVERY_M)
    drift = CubicSpline(knots, OFFSET_M + np.cumsum(WALK_M * rng.standard_normal(len(knots))))
    tables: dict[str, dict[str, Array]] = {"a": {"chainage_m": x}, "b": {"chainage_m": x}}
    for name in CHANNELS:
        track = irregularities(length_m, rng)
        for run, place in (("a", x), ("b", x - drift(x))):
            tables[run][name] = np.round(track(place) + noise_mm * rng.standard_normal(len(x)), 2)
    for run, columns in tables.items():
        pd.DataFrame(columns).to_csv(folder / f"{run}.csv", index=False)
    return drift


def overlay_of(paths: list[Path]) -> tuple[RunOverlay, float]:
    """Return the overlay of channel tables and the seconds that reading and laying them took."""
    start = time.perf_counter()
    laid = overlaid([read_geometry(path) for path in paths], [path.stem for path in paths])
    return laid, time.perf_counter() - start


def main() -> None:
    """Print a row per noise and seed, or the tables of two files."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--km", type=float, default=10.0, help="length of the runs")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--files", type=Path, nargs=2, metavar=("A", "B"))
    given = parser.parse_args()
    if given.files:
        laid, seconds = overlay_of(given.files)
        print(laid.shifts.round(3).to_string(), laid.repeatability.round(3).to_string(), f"{seconds:.1f} s", sep="\n\n")
        return
    print("noise mm  seed  sections   rms m  |error| < 0.05 m  inside 2 sigma  rms error/sigma   time s")
    for noise_mm in NOISES_MM:
        for seed in range(given.seeds):
            with tempfile.TemporaryDirectory() as folder:
                drift = pair(Path(folder), 1000.0 * given.km, noise_mm, seed)
                laid, seconds = overlay_of([Path(folder, f"{run}.csv") for run in "ab"])
            shifts = laid.shifts
            error = shifts["shift_m"].to_numpy() - drift(shifts["run_m"].to_numpy())
            z = error / shifts["shift_m_sd"].to_numpy()
            print(
                f"{noise_mm:8.2f}  {seed:4d}  {len(shifts):8d}  {np.sqrt(np.mean(error**2)):6.4f}"
                f"  {100 * np.mean(np.abs(error) < 0.05):14.1f} %  {100 * np.mean(np.abs(z) < 2.0):12.1f} %"
                f"  {np.sqrt(np.mean(z**2)):15.2f}  {seconds:7.1f}"
            )
    print(f"greatest memory: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6:.2f} GB")


if __name__ == "__main__":
    main()
