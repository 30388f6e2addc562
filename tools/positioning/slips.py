"""Slips and slides: distances between balises 1 km apart, and what is reported of the events.

A leg is from one balise to the next where the wheel slipped in between. The error of its distance, as a share of the
true one, is measured twice: with every balise used, and with none between the first and the last one of the run, so
that only wheel and inertial sensor measure the distance, as in the paper. Over a slip itself, from where the wheel
begins to slip until it rolls again, there is no balise either way.

Events are scored by :mod:`trackfg.evaluation.slip_scores`: recall of slips and slides with a creep of 3 % or more that
last 1 s or longer; precision of everything that is reported.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from benchmark import Figure, Part, at_least, at_most, pooled_rms, ratio
from papers.positioning import errors_percent, legs_with_slip, true_slips

from positioning.runs import with_fixes
from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.evaluation.scores import rms
from trackfg.evaluation.slip_scores import score_slips
from trackfg.results.result import Result
from trackfg.smoothing.smoother import smooth

SCENARIOS = {"line": "slippery-line", "leaves": "slippery-line-leaves"}
CREEP, LASTING_S = 0.03, 1.0
LEG_PERCENT = 0.2
FOUND = 0.95


def measure(seed: int) -> dict[str, float]:
    """Of both scenarios; names begin with the short one."""
    out = {}
    for short, name in SCENARIOS.items():
        run = simulate(name, seed=seed)
        out |= {f"{short} {what}": value for what, value in _measured(run).items()}
    return out


def _measured(run: Simulation) -> dict[str, float]:
    slips = true_slips(run)
    spans = {"legs": legs_with_slip(run), "slips": slips[["start_s", "end_s"]].to_numpy()}
    with_all = smooth(run.recording, SmoothConfig())
    ends = smooth(with_fixes(run.recording, [0, -1]), SmoothConfig())
    out = {f"{what} count": float(len(times)) for what, times in spans.items()}
    for what, times in spans.items():
        for name, result in {"all": with_all, "ends": ends}.items():
            out |= {f"{what} {name} {of}": value for of, value in _distances(run, result, times).items()}
    return out | _events(run, with_all, slips)


def _distances(run: Simulation, result: Result, spans: np.ndarray) -> dict[str, float]:
    """Of the errors in %: rms, greatest magnitude, and how many are within what is asked for."""
    error = np.abs(errors_percent(run, result.trajectory, spans, 1.0))
    return {
        "rms": rms(error),
        "greatest": float(error.max()) if error.size else np.nan,
        "within": float((error <= LEG_PERCENT).sum()),
    }


def _events(run: Simulation, result: Result, slips: pd.DataFrame) -> dict[str, float]:
    score = score_slips(result.events, slips, run.truth, creep=CREEP, duration_s=LASTING_S)
    distances = score.distances
    off = distances["removed_m"] - distances["true_m"]
    return {
        "asked": float(len(score.found) + len(score.missed)),
        "found": float(len(score.found)),
        "events": float(score.events),
        "right": float(score.events - len(score.false)),
        "removed count": float(len(distances)),
        "removed rms": rms(off),
        "removed covered": float((off.abs() <= 1.96 * distances["removed_m_sd"]).sum()),
    }


def figures(measured: pd.DataFrame) -> list[Figure]:
    """The lines of both scenarios; targets are for the first."""
    return [line for short in SCENARIOS for line in _figures(measured, short)]


def _figures(measured: pd.DataFrame, short: str) -> list[Figure]:
    column = {name.removeprefix(f"{short} "): measured[name] for name in measured if name.startswith(f"{short} ")}
    of, name = pd.DataFrame(column), SCENARIOS[short]
    leg, recall, precision = f"{name}: rms error of a leg with slip, %", f"{name}: recall", f"{name}: precision"
    legs = pooled_rms(of, "legs all rms", "legs count")
    hit_share, right = ratio(of, "found", "asked"), ratio(of, "right", "events")
    if short == "line":
        judged = [
            at_most(leg, legs, LEG_PERCENT, of["legs all rms"], paper="2"),
            at_least(recall, hit_share, FOUND, of["found"] / of["asked"]),
            at_least(precision, right, FOUND, of["right"] / of["events"]),
        ]
    else:
        judged = [
            Figure(leg, legs, of["legs all rms"], paper="2"),
            Figure(recall, hit_share, of["found"] / of["asked"]),
            Figure(precision, right, of["right"] / of["events"]),
        ]
    return [
        *judged[:1],
        Figure(f"{name}: the same, greatest", float(of["legs all greatest"].max()), of["legs all greatest"]),
        Figure(f"{name}: the same, share within {LEG_PERCENT:g} %", ratio(of, "legs all within", "legs count")),
        Figure(
            f"{name}: a leg without balises between the run's ends, rms, %",
            pooled_rms(of, "legs ends rms", "legs count"),
            of["legs ends rms"],
        ),
        Figure(f"{name}: the same, share within {LEG_PERCENT:g} %", ratio(of, "legs ends within", "legs count")),
        Figure(f"{name}: the distance of a slip, rms, %", pooled_rms(of, "slips all rms", "slips count")),
        *judged[1:],
        Figure(f"{name}: slips and slides in a run", float(of["slips count"].mean()), of["slips count"], paper="2.4"),
        Figure(f"{name}: of the size asked for", float(of["asked"].mean()), of["asked"]),
        Figure(f"{name}: distance removed less the true one, rms, m", pooled_rms(of, "removed rms", "removed count")),
        Figure(f"{name}: the same, share within 1.96 sigma", ratio(of, "removed covered", "removed count")),
    ]


PART = Part(
    name="slips",
    title="Slip and slide: slippery-line and slippery-line-leaves, 14.5 km",
    measure=measure,
    figures=figures,
    notes=(
        "A leg lies between two balises 1 km apart. Its error is that of the estimated distance in % of the true one."
        " Slips asked for have a creep of 3 % or more and last 1 s or longer."
    ),
)
