"""What comes back through other systems' formats: a table of formats, directions and checks.

Usage: ``python tools/interchange.py [--duration S] [--seeds N]``. A simulated run is written in each foreign form,
imported, and smoothed: the chainage is compared with that of the original. Then its result is exported in each format,
and sizes and times are printed; that exports hold the result's values is tested by reading them back with other
libraries (``tests/trackfg/interchange/exporting``). At last balises are surveyed, one of them planned wrong.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.integrate import cumulative_trapezoid

from interchange.balises import print_balises
from interchange.foreign_forms import WRITERS, Drive, format_key
from trackfg.datasets.scenarios import scenario, simulate
from trackfg.errors import BadInputError
from trackfg.interchange.exporting.export import export_result
from trackfg.interchange.exporting.registry import result_formats
from trackfg.interchange.importing.conversion import write_imported
from trackfg.interchange.importing.mapping import mapping_of
from trackfg.interchange.importing.proposal import GNSS_SD_M, Question, propose
from trackfg.interchange.importing.registry import source_format
from trackfg.recording.description import Tach
from trackfg.recording.model import Recording
from trackfg.smoothing.smoother import smooth

_DAMAGES = 20
"""Copies of each source that are cut off or overwritten."""


def main(arguments: list[str] | None = None) -> int:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--duration", type=float, default=120.0, help="length of the run, s")
    parser.add_argument("--seeds", type=int, default=5, help="lines of balises")
    options = parser.parse_args(arguments)
    duration, seeds = options.duration, options.seeds
    recording, drive = _run(duration)
    with tempfile.TemporaryDirectory() as folder:
        _imports(recording, drive, Path(folder))
        _exports(recording, Path(folder))
    print_balises(seeds)
    return 0


def _run(duration_s: float) -> tuple[Recording, Drive]:
    """Return a run on a rigid vehicle, with what every form can say: a speed of the wheel, GNSS, a date."""
    plan = replace(scenario("axle-box"), gnss=scenario("mainline-gnss").gnss)
    recording = simulate(plan, seed=1, duration_s=duration_s).recording
    start = datetime(2026, 5, 1, 3, 12, tzinfo=UTC)
    gnss = recording.gnss
    assert gnss is not None
    recording = replace(recording, gnss_origin=np.array([46.9, 7.4, 500.0]))
    drive = Drive.of(recording)
    part = Tach(file="tach.parquet", column="distance_m", kind="distance", unit="m", integrated=True)
    description = recording.description.model_copy(update={"start": start, "tach": part})
    rolled = pd.DataFrame({"t_s": drive.t, "distance_m": cumulative_trapezoid(drive.speed, drive.t, initial=0.0)})
    sigmas = dict(zip(("east_sd_m", "north_sd_m", "up_sd_m"), GNSS_SD_M, strict=True))
    return replace(recording, description=description, tach=rolled, gnss=gnss.assign(**sigmas)), drive


def _imports(recording: Recording, drive: Drive, folder: Path) -> None:
    print("| imported | bytes | largest difference of a rate, rad/s | of a force, m/s^2 | of chainage, m | refused |")
    print("|---|---|---|---|---|---|")
    for name, write in WRITERS.items():
        place = folder / name.replace(" ", "-")
        place.mkdir()
        source = write(drive, place)
        files = [source] if source.is_file() else [file for file in source.rglob("*") if file.is_file()]
        back = _imported(source, place / "recording", name)
        rate = np.abs(back.gyro - recording.gyro).max()
        force = np.abs(back.accel - recording.accel).max()
        chainage = _chainage_difference(back, recording)
        refused = _refused(max(files, key=lambda file: file.stat().st_size), source, place, name)
        size = sum(file.stat().st_size for file in files)
        print(f"| {name} | {size} | {rate:.1e} | {force:.1e} | {chainage:.1e} | {refused} of {_DAMAGES} |", flush=True)


def _default(question: Question) -> str:
    return question.default


def _imported(source: Path, out: Path, name: str) -> Recording:
    form = source_format(source, format_key(name))
    tables = form.tables(source, lambda _: None)
    proposal = propose(tables, _default, form.mapping(tables))
    made = write_imported(tables, mapping_of(proposal.sections, "proposal"), out, run_id=source.stem)
    assert made.loaded.recording is not None
    return made.loaded.recording


def _chainage_difference(back: Recording, original: Recording) -> float:
    """Return how far the chainages are apart at most, m, where both have the same sensors and conditions."""
    tables = ("tach", "gnss")
    common = {name: getattr(original, name) if getattr(back, name) is not None else None for name in tables}
    if common["tach"] is None and common["gnss"] is None:
        return float("nan")
    parts = {name: getattr(original.description, name) if common[name] is not None else None for name in tables}
    # Whatever a form cannot say (noise, mounting, kind of wheel) is taken from the original for both.
    description = original.description.model_copy(update={**parts, "fixes": None})
    first = smooth(replace(original, description=description, fixes=None, **common))
    own = {name: getattr(back, name) for name in tables}
    second = smooth(replace(original, description=description, imu=back.imu, fixes=None, **own))
    t = first.trajectory["t_s"]
    there = np.interp(t, second.trajectory["t_s"], second.trajectory["chainage_m"])
    return float(np.abs(first.trajectory["chainage_m"] - there).max())


def _refused(target: Path, source: Path, place: Path, name: str) -> int:
    """Return how many damaged copies are refused; the others hold what the damage left readable."""
    whole, rng, count = target.read_bytes(), np.random.default_rng(5), 0
    for i in range(_DAMAGES):
        at = int(len(whole) * (i + 0.5) / (_DAMAGES + 1))
        target.write_bytes(whole[:at] if i % 2 == 0 else whole[:at] + rng.bytes(2000) + whole[at + 2000 :])
        try:
            _imported(source, place / f"damaged-{i}", name)
        except BadInputError:
            count += 1
    target.write_bytes(whole)
    return count


def _exports(recording: Recording, folder: Path) -> None:
    result = smooth(recording)
    print(f"\n{len(result.geometry)} places, {len(result.trajectory)} instants")
    print("\n| exported | bytes | time, s |")
    print("|---|---|---|")
    for name, form in result_formats().items():
        begin = time.perf_counter()
        path = export_result(result, form, folder / f"{name}{form.suffix}")
        print(f"| {name} | {path.stat().st_size} | {time.perf_counter() - begin:.2f} |", flush=True)
