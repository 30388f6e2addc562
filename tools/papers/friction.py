"""Paper 001: slip angle and friction of a car in a J-turn, by IMM-EKFs of 3, 7 and 10 modes and by the graph.

The road is in three stretches of 6 s. Slip angle: rms of the error, over a stretch and over the whole run. Friction:
its mean over a stretch from 2 s into it on, when the filters have settled.

What the measurements can say of friction at all is shown by the graph on each stretch by itself, friction constant in
it: it is given the times at which friction jumps.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from benchmark import Part

from papers.table import Comparison, mean_of, ratio_met
from trackfg.datasets.j_turn import FRICTION, STRETCHES_S, JTurn, j_turn
from trackfg.friction import imm_ekf
from trackfg.friction.smoother import FrictionModel, smooth_friction

MODES = (3, 7, 10)
SETTLED_S = 2.0
NEAR = 0.03
"""How near friction is to be."""
CONSTANT = FrictionModel(walk_density=1e-6, jump_width=1e3)
"""No walk to speak of, and no jumps."""


def measure(seed: int) -> dict[str, float]:
    """Of every method, ``3 modes`` to ``graph``: ``slip`` and ``slip MU``, mrad; ``friction MU`` and ``sigma MU``, the
    mean of its own sigma; ``off``, the largest error of the three frictions. ``constant MU`` and ``constant off``: of
    the graph on each stretch by itself.
    """
    drive = j_turn(seed)
    tables = {f"{modes} modes": imm_ekf.run(drive.measured, modes=modes).table for modes in MODES}
    tables["graph"] = smooth_friction(drive.measured)
    constant = {
        f"constant {mu:g}": _constant_friction(drive, *span) for mu, span in zip(FRICTION, STRETCHES_S, strict=True)
    }
    constant["constant off"] = max(abs(estimate - mu) for estimate, mu in zip(constant.values(), FRICTION, strict=True))
    return constant | {
        f"{name} {quantity}": value
        for name, table in tables.items()
        for quantity, value in _scores(table, drive).items()
    }


def _constant_friction(drive: JTurn, start: float, end: float) -> float:
    inside = drive.measured["t_s"].between(start - 1e-6, end - 1e-6)
    return float(smooth_friction(drive.measured[inside], model=CONSTANT)["friction"].mean())


def _scores(table: pd.DataFrame, drive: JTurn) -> dict[str, float]:
    t = table["t_s"].to_numpy()
    error = 1e3 * (table["slip_angle_rad"] - drive.truth["slip_angle_rad"]).to_numpy()
    out = {"slip": float(np.sqrt(np.mean(error**2))), "off": 0.0}
    for mu, (start, end) in zip(FRICTION, STRETCHES_S, strict=True):
        inside = (t > start - 1e-6) & (t < end - 1e-6)
        settled = inside & (t > start + SETTLED_S)
        out[f"slip {mu:g}"] = float(np.sqrt(np.mean(error[inside] ** 2)))
        out[f"friction {mu:g}"] = float(table["friction"][settled].mean())
        out[f"sigma {mu:g}"] = float(table["friction_sd"][settled].mean())
        out["off"] = max(out["off"], abs(out[f"friction {mu:g}"] - mu))
    return out


def figures(measured: pd.DataFrame) -> list[Comparison]:
    """Slip angle, then friction, then single runs."""
    return [*_slip_lines(measured), *_friction_lines(measured), *_single_runs(measured)]


def _slip_lines(measured: pd.DataFrame) -> list[Comparison]:
    column = measured.to_dict("list")
    names = [f"{modes} modes" for modes in MODES]
    order = sorted(names, key=lambda name: mean_of(column[f"{name} slip"]))
    of_paper = dict(zip(names, ("poor", "poor at low mu", "good"), strict=True))
    lines = []
    for name in names:
        wanted = name == order[0]
        filtered, graph = column[f"{name} slip"], column["graph slip"]
        met = ratio_met(graph, filtered, 0.5) if wanted else None
        target = "smoother <= 0.5 of the best" if wanted else "-"
        lines.append(Comparison(f"slip angle rms, mrad, {name}", of_paper[name], target, filtered, graph, met))
    for mu in FRICTION:
        lines += [
            Comparison(f"at mu {mu:g}, {name}", "-", "-", column[f"{name} slip {mu:g}"], column[f"graph slip {mu:g}"])
            for name in names
        ]
    return [*lines, Comparison(f"ordering: {' < '.join(order)}", "10 < 7 < 3 modes", "as measured", None)]


def _friction_lines(measured: pd.DataFrame) -> list[Comparison]:
    column = measured.to_dict("list")
    lines = []
    for mu in FRICTION:
        for modes in MODES:
            frictions = column[f"{modes} modes friction {mu:g}"]
            near = _near(frictions, mu) if modes > min(MODES) else None
            target = "-" if near is None else f"baseline within {NEAR:g}"
            lines.append(
                Comparison(f"friction at mu {mu:g}, {modes} modes", f"near {mu:g}", target, frictions, None, near)
            )
        graph = column[f"graph friction {mu:g}"]
        within = f"smoother within {NEAR:g}"
        lines.append(Comparison(f"friction at mu {mu:g}, graph", "-", within, None, graph, _near(graph, mu)))
        lines.append(Comparison("its own sigma", "-", "-", None, column[f"graph sigma {mu:g}"]))
        lines.append(Comparison("the graph, given the jumps", "-", "-", None, column[f"constant {mu:g}"]))
    return lines


def _single_runs(measured: pd.DataFrame) -> list[Comparison]:
    filters = [(f"{modes} modes", measured[f"{modes} modes off"]) for modes in MODES]
    graphs = [("graph", measured["graph off"]), ("graph, given the jumps", measured["constant off"])]
    lines = []
    for number, rows in enumerate((filters, graphs)):
        for name, off in rows:
            for text, values in (
                (f"largest error of a run's 3 frictions, {name}", off),
                (f"share of runs within {NEAR:g} on all 3, {name}", (off <= NEAR).astype(float)),
            ):
                baseline, smoother = (values.tolist(), None) if number == 0 else (None, values.tolist())
                lines.append(Comparison(text, "-", "-", baseline, smoother))
    return lines


def _near(frictions: list[float], mu: float) -> bool:
    return bool(abs(mean_of(frictions) - mu) <= NEAR)


PAPERS = (
    Part(
        name="001",
        title="IMM-EKF: slip angle and friction of a car in the paper's J-turn",
        measure=measure,
        figures=figures,
        notes="Verdicts on means over seeds; the smoother's counterpart is the friction graph.",
    ),
)
