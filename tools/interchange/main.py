"""What comes back through other systems' formats: a table of formats, directions and checks.

Usage: ``python tools/interchange.py [--duration S] [--seeds N]``. A simulated run is written in each foreign form,
imported, and smoothed: the chainage is compared with that of the original; copies of it are broken, which the import
must refuse. Then its result is exported in each format,
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
from trackfg.interchange.importing.proposal import GNSS_SD_M, propose
from trackfg.interchange.importing.proposals.questions import Question
from trackfg.interchange.importing.registry import source_format
from trackfg.recording.description import Tach
from trackfg.recording.model import Recording
from trackfg.smoothing.smoother import smooth

_BROKEN = 20
"""Copies of each source that are cut off or overwritten so that what is read of them changes."""
_DAMAGE_BYTES = 2000


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
    # A logger has one clock of whole ns, and in a table with a row for each sample a position is as late as that.
    samples = np.round(recording.imu["t_s"].to_numpy(), 9)
    at = np.minimum(np.searchsorted(samples, gnss["t_s"]), len(samples) - 1)
    gnss = gnss.assign(t_s=samples[at]).drop_duplicates("t_s", ignore_index=True)
    imu = recording.imu.assign(t_s=samples)
    recording = replace(recording, imu=imu, gnss=gnss, gnss_origin=np.array([46.9, 7.4, 500.0]))
    drive = Drive.of(recording)
    part = Tach(file="tach.parquet", column="distance_m", kind="distance", unit="m", integrated=True)
    description = recording.description.model_copy(update={"start": start, "tach": part})
    rolled = pd.DataFrame({"t_s": drive.t, "distance_m": cumulative_trapezoid(drive.speed, drive.t, initial=0.0)})
    sigmas = dict(zip(("east_sd_m", "north_sd_m", "up_sd_m"), GNSS_SD_M, strict=True))
    return replace(recording, description=description, tach=rolled, gnss=gnss.assign(**sigmas)), drive


def _imports(recording: Recording, drive: Drive, folder: Path) -> None:
    print("| imported | bytes | rates differ by, rad/s | forces, m/s^2 | chainage, m | refused of broken | sound |")
    print("|---|---|---|---|---|---|---|")
    for name, write in WRITERS.items():
        place = folder / name.replace(" ", "-")
        place.mkdir()
        source = write(drive, place)
        files = [source] if source.is_file() else [file for file in source.rglob("*") if file.is_file()]
        back = _imported(source, place / "recording", name)
        rate = np.abs(back.gyro - recording.gyro).max()
        force = np.abs(back.accel - recording.accel).max()
        chainage = _chainage_difference(back, recording)
        size = sum(file.stat().st_size for file in files)
        refused, sound = _refused(max(files, key=lambda file: file.stat().st_size), source, back, name)
        row = f"| {name} | {size} | {rate:.1e} | {force:.1e} | {chainage:.1e} | {refused} of {_BROKEN} | {sound} |"
        print(row, flush=True)


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
    sensors = {name: getattr(back, name) for name in tables}
    second = smooth(replace(original, description=description, imu=back.imu, fixes=None, **sensors))
    t = first.trajectory["t_s"]
    second_chainage = np.interp(t, second.trajectory["t_s"], second.trajectory["chainage_m"])
    return float(np.abs(first.trajectory["chainage_m"] - second_chainage).max())


def _refused(target: Path, source: Path, back: Recording, name: str) -> tuple[int, int]:
    """Return how many broken copies are refused, and how many more were damaged where what is read stays the same.

    Those are drawn anew: a copy is broken if other values, or other rows than the first ones, are read of it.
    """
    whole, rng = target.read_bytes(), np.random.default_rng(5)
    refused = broken = sound = 0
    while broken < _BROKEN:
        at = int(len(whole) * rng.uniform())
        cut = (broken + sound) % 2 == 0
        target.write_bytes(whole[:at] + (b"" if cut else rng.bytes(_DAMAGE_BYTES) + whole[at + _DAMAGE_BYTES :]))
        try:
            with tempfile.TemporaryDirectory() as folder:
                is_sound = _begins(back, _imported(source, Path(folder) / "damaged", name))
        except BadInputError:
            refused, is_sound = refused + 1, False
        sound, broken = sound + is_sound, broken + (not is_sound)
    target.write_bytes(whole)
    return refused, sound


def _begins(whole: Recording, part: Recording) -> bool:
    """Return whether ``part`` has the first rows of each table of ``whole``, the last one perhaps cut in a number."""
    for name in ("imu", "tach", "gnss"):
        first, second = getattr(whole, name), getattr(part, name)
        if (first is None) != (second is None):
            return False
        if first is not None and not first.iloc[: len(second) - 1].equals(second.iloc[:-1]):
            return False
    return True


def _exports(recording: Recording, folder: Path) -> None:
    result = smooth(recording)
    print(f"\n{len(result.geometry)} places, {len(result.trajectory)} instants")
    print("\n| exported | bytes | time, s |")
    print("|---|---|---|")
    for name, form in result_formats().items():
        begin = time.perf_counter()
        path = export_result(result, form, folder / f"{name}{form.suffix}")
        print(f"| {name} | {path.stat().st_size} | {time.perf_counter() - begin:.2f} |", flush=True)
