"""How well are curves found, and how honest are their sigmas?

Random main lines (clothoids, and the same with half-sine transitions) with the irregularities of good and of worn track
are turned into geometry tables without any sensor: what is left of the errors is the irregularities' doing. Each curve
found is compared with the designed one that it overlaps. Per quantity: rms of the error, median sigma, rms of
error / sigma, and the share within 1.96 sigma, per cent. Then curves missed and false, laws that were right, the same
for straight track, and the time of one core per 100 km.

    python tools/curve_detection.py [--seeds 20] [--km 20]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table

from trackfg.curves import QUANTITIES, Curve, find_curves
from trackfg.datasets.line.alignment import Element, piecewise
from trackfg.datasets.line.built_in_lines import GOOD_TRACK, MAIN_LINE, WORN_TRACK
from trackfg.datasets.line.irregularities import IrregularityModel, draw_irregularities
from trackfg.datasets.line.line import Line, piecewise_linear
from trackfg.datasets.line.line_design import random_line
from trackfg.datasets.line.track import SimulatedTrack
from trackfg.datasets.line.truth_geometry import truth_geometry
from trackfg.numerics.arrays import Array

TRACKS = {"good": GOOD_TRACK, "worn": WORN_TRACK}
LAWS = ("clothoid", "half-sine")
SD_1PM = 1e-8
SHOWN = (*QUANTITIES, "radius_m", "middle_in_m", "middle_out_m")


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20, help="how many lines of each kind (default 20)")
    parser.add_argument("--km", type=float, default=20.0, help="length of each line (default 20)")
    arguments = parser.parse_args()
    console = Console(width=120)
    for track, model in TRACKS.items():
        for law in LAWS:
            console.print(*scores(f"{track} track, {law}", model, law, arguments.seeds, 1e3 * arguments.km))
        false = sum(len(find_curves(profile(straight_line(50e3), model, seed))) for seed in range(arguments.seeds))
        console.print(f"{track} track, {50 * arguments.seeds} km of straight: {false} false curves\n")


def scores(title: str, model: IrregularityModel, law: str, seeds: int, length_m: float) -> tuple[Table, str]:
    """The table of one kind of line, and what else there is to say."""
    away, sd, right, sure = [], [], [], []
    designed_count = found_count = 0
    seconds = 0.0
    for seed in range(seeds):
        line = random_line(MAIN_LINE, length_m, np.random.default_rng(seed))
        truth = designed_curves(line)
        if law == "half-sine":
            line = with_half_sines(line)
        table = profile(line, model, seed)
        start = time.process_time()
        curves = find_curves(table)
        seconds += time.process_time() - start
        designed_count += len(truth)
        found_count += len(curves)
        for row, curve in matched(truth, curves):
            away.append([value(curve, name) - value_of(row, name) for name in SHOWN])
            sd.append([curve.sd(name) for name in SHOWN])
            right += [curve.law_in == law, curve.law_out == law]
            sure += [curve.law_in_probability, curve.law_out_probability]
    errors, sigmas = np.array(away), np.array(sd)
    table = Table("quantity", "rms error", "median sigma", "rms error/sigma", "within 1.96 sigma %", title=title)
    for k, name in enumerate(SHOWN):
        ratio = errors[:, k] / sigmas[:, k]
        rms, share = np.sqrt(np.mean(errors[:, k] ** 2)), 100.0 * np.mean(np.abs(ratio) < 1.96)
        table.add_row(
            name, f"{rms:.3g}", f"{np.median(sigmas[:, k]):.3g}", f"{np.sqrt(np.mean(ratio**2)):.2f}", f"{share:.1f}"
        )
    text = (
        f"{designed_count} curves: {designed_count - len(errors)} missed, {found_count - len(errors)} false; "
        f"laws right {100.0 * np.mean(right):.1f} % (mean probability {100.0 * np.mean(sure):.1f} %); "
        f"{seconds / seeds / length_m * 1e5:.1f} s of one core per 100 km\n"
    )
    return table, text


def matched(designed: Iterable[Array], curves: Sequence[Curve]) -> Iterator[tuple[Array, Curve]]:
    """Yield designed curves, each with the found one that overlaps it and bends alike, where there is only one such."""
    for row in designed:
        overlapping = [c for c in curves if c.bcc_m < row[2] and c.ecc_m > row[1] and c.curvature_1pm * row[4] > 0.0]
        if len(overlapping) == 1:
            yield row, overlapping[0]


def value(curve: Curve, name: str) -> float:
    """A quantity of a curve found."""
    return float(getattr(curve, name))


def value_of(row: Array, name: str) -> float:
    """The same of a designed one: BTC, BCC, ECC, ETC, curvature, cant."""
    derived = {"radius_m": 1.0 / abs(row[4]), "middle_in_m": row[:2].mean(), "middle_out_m": row[2:4].mean()}
    return float(derived[name] if name in derived else row[QUANTITIES.index(name)])


def designed_curves(line: Line) -> Array:
    """The quantities of the curves of a line of straights, clothoids and circles. Shape (n, 6)."""
    x = line.curvature.x
    middles = 0.5 * (x[1:] + x[:-1])
    level, flat = line.curvature(middles), np.abs(line.curvature(middles, 1)) < 1e-12
    cant = -1e3 * np.sign(level) * line.cant(middles)
    rows = [i for i in range(1, len(middles) - 1) if flat[i] and level[i] != 0.0]
    return np.array([[*x[i - 1 : i + 3], level[i], cant[i]] for i in rows])


def with_half_sines(line: Line) -> Line:
    """The same line with all its transitions half-sines, the cant's ramps too."""
    x = np.unique(line.curvature.x)

    def bent(values: Array) -> list[Element]:
        pairs = zip(np.diff(x), values[:-1], values[1:], strict=True)
        return [Element("constant" if a == b else "half-sine", length, a, b) for length, a, b in pairs]

    return replace(
        line, curvature=piecewise(bent(line.curvature(x))), cant=piecewise(bent(line.cant(np.clip(x, 0, x[-1]))))
    )


def straight_line(length_m: float) -> Line:
    """A level line without curves."""
    nothing = piecewise_linear(np.array([0.0, length_m]), np.zeros(2))
    return Line(
        curvature=nothing,
        cant=nothing,
        grade=nothing,
        length_m=length_m,
        cross_level_base_m=MAIN_LINE.cross_level_base_m,
        limit_from_m=np.zeros(1),
        limit_mps=np.full(1, 30.0),
        stations_m=np.zeros(0),
    )


def profile(line: Line, model: IrregularityModel, seed: int) -> pd.DataFrame:
    """The geometry table of a line with irregularities."""
    track = SimulatedTrack(
        line, draw_irregularities(model, line.length_m, np.random.default_rng([seed, 1])), MAIN_LINE.gauge_m
    )
    table = truth_geometry(track, chainage_origin_m=0.0, direction=1, s_from=0.0, s_to=line.length_m)
    return table[["chainage_m", "curvature_1pm", "cross_level_mm"]].assign(curvature_1pm_sd=SD_1PM)
