"""Paper 003: distance and position of a train whose wheels slip, by the composite system and by the smoother.

The paper's error of a distance is that between two balises less the true one, as a share of it, with the wheel's
diameter known; its balises are 1 km apart or so. That is measured here for every pair of neighbouring balises between
which the wheel slipped (``leg``). It holds the baseline to nothing but its own distance (the chainage is not set anew
at balises, and the wheel's true scale is given to it), while the smoother knows the second balise too and not the
scale. So there is a second measure, which balises hardly help: over each slip or slide, from where the wheel begins to
slip until it rolls again, the error of the distance as a share of the true one (``stretch``).

A slip is *found* if a reported one overlaps it. The rule compares averages over 3 s, so that a slip whose wheel is
never ``3 s x 1.23 km/h/s = 3.7 km/h`` faster or slower than the train cannot exceed its threshold on the level: such
slips are *below the threshold*. A start point is *wrong* if the wheel slips there already.

Curves: the table is surveyed on another run over the same track, positions are set by curves alone, and what counts is
the error of the chainage right after.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pandas as pd
from benchmark import Part

from papers.table import Comparison, mean_of, ratio_met
from trackfg.baselines import composite_positioning
from trackfg.baselines.curve_points import curve_table
from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.numerics.arrays import Array
from trackfg.numerics.units import KMH
from trackfg.results.result import Result
from trackfg.smoothing.smoother import smooth

SCENARIOS = {"slippery-line": "line", "slippery-line-leaves": "leaves"}
THRESHOLD_MPS = 3.0 * 1.23 * KMH
SLIPS = ("slip", "slide")
WITHIN = {"baseline": 2.0, "smoother": 0.2}
"""The errors of a distance that are asked for, %."""
SET_M = 0.01
"""A correction by a curve is at least this large."""
NEAR_M = 10.0


def measure(seed: int) -> dict[str, float]:
    """Of both scenarios, names beginning with its short one (``line``, ``leaves``), and of the curves of the first."""
    out = {}
    for scenario, short in SCENARIOS.items():
        run = simulate(scenario, seed=seed)
        smoothed = smooth(run.recording, SmoothConfig())
        out |= {f"{short} {name}": value for name, value in _slips(run, smoothed).items()}
        if short == "line":
            out |= _curves(run, simulate(scenario, seed=seed, run=1), smoothed)
    return out


def _slips(run: Simulation, smoothed: Result) -> dict[str, float]:
    """Errors (%) of legs and stretches: rms, greatest, share within what is asked for; and slips that were missed."""
    systems = {
        "baseline": composite_positioning.run(run.recording, reset_at_fixes=False),
        "no setback": composite_positioning.run(run.recording, reset_at_fixes=False, setback_s=0.0),
        "no pitch": composite_positioning.run(run.recording, reset_at_fixes=False, pitch_correction=False),
    }
    tach, slips = run.recording.tach, true_slips(run)
    assert tach is not None
    out = {"slips": float(len(slips))}
    for name, (trajectory, scale) in {
        "baseline": (systems["baseline"].trajectory, run.wheel_scale),
        "wheel": (tach.rename(columns={"distance_m": "chainage_m"}), run.wheel_scale),
        "smoother": (smoothed.trajectory, 1.0),
    }.items():
        asked = WITHIN.get(name, WITHIN["baseline"])
        for what, spans in (("leg", legs_with_slip(run)), ("stretch", slips[["start_s", "end_s"]].to_numpy())):
            error = np.abs(errors_percent(run, trajectory, spans, scale))
            out[f"{name} {what} rms"] = _mean(error**2) ** 0.5
            out[f"{name} {what} greatest"] = float(error.max()) if error.size else np.nan
            out[f"{name} {what} within"] = _mean(error <= asked)
    strong = _strong(run)
    for name, events in {"baseline": systems["baseline"].events, "smoother": smoothed.events}.items():
        missed = ~_found(slips, events)
        out[f"{name} missed"] = _mean(missed)
        out[f"{name} strong missed"] = _mean(missed[strong])
    for name, system in systems.items():
        corrections = system.events[system.events["kind"].isin(SLIPS)]
        out[f"{name} wrong starts"] = _mean(_starts_in_slip(slips, corrections))
        out[f"{name} not readhered"] = _mean(corrections["detail"].str.contains("no re-adhesion").to_numpy(dtype=bool))
    return out


def _curves(run: Simulation, earlier: Simulation, smoothed: Result) -> dict[str, float]:
    """Errors of the chainage, m, where the baseline was set by a curve, and the smoother's there."""
    table = curve_table(*composite_positioning.survey(earlier.recording).to_numpy().T)
    without = composite_positioning.run(run.recording, reset_at_fixes=False).trajectory
    baseline = composite_positioning.run(run.recording, curve_points=table, reset_at_fixes=False)
    steps = np.diff(baseline.trajectory["chainage_m"] - without["chainage_m"])
    t = baseline.trajectory["t_s"].to_numpy()[np.flatnonzero(np.abs(steps) > SET_M) + 1]
    true = np.interp(t, run.truth["t_s"], run.truth["chainage_m"])
    out = {"curves used": float(len(t)), "curves refused": float((baseline.events["kind"] == "curve refused").sum())}
    for name, trajectory in (("baseline", baseline.trajectory), ("smoother", smoothed.trajectory)):
        error = np.interp(t, trajectory["t_s"], trajectory["chainage_m"]) - true
        out[f"{name} curve rms"] = _mean(error**2) ** 0.5
        out[f"{name} curve within"] = _mean(np.abs(error) <= NEAR_M)
    return out


def true_slips(run: Simulation) -> pd.DataFrame:
    assert run.slips is not None
    return run.slips.astype({"start_s": float, "end_s": float, "peak_creep": float})


def errors_percent(run: Simulation, trajectory: pd.DataFrame, spans: Array, scale: float) -> Array:
    """Errors of the distances run in ``spans`` (n, 2) s, in % of them."""
    distance = scale * np.diff(np.interp(spans, trajectory["t_s"], trajectory["chainage_m"]), axis=1)[:, 0]
    true = np.diff(np.interp(spans, run.truth["t_s"], run.truth["chainage_m"]), axis=1)[:, 0]
    return np.asarray(100.0 * (distance / true - 1.0))


def legs_with_slip(run: Simulation) -> Array:
    """When two neighbouring balises were passed with slip between them, s. Shape (n, 2)."""
    fixes, slips = run.recording.fixes, true_slips(run)
    assert fixes is not None
    legs = [
        (begin, end)
        for begin, end in pairwise(fixes["t_s"])
        if ((slips["start_s"] < end) & (slips["end_s"] > begin)).any()
    ]
    return np.array(legs, dtype=float).reshape(-1, 2)


def _strong(run: Simulation) -> np.ndarray:
    """Slips in which wheel and train may differ enough in speed for the baseline's rule. Shape (n,) of bool."""
    slips = true_slips(run)
    ends = slips[["start_s", "end_s"]].to_numpy()
    speed = np.interp(ends, run.truth["t_s"], run.truth["speed_mps"]).max(axis=1, initial=0.0)
    return np.asarray(slips["peak_creep"].abs().to_numpy() * speed > THRESHOLD_MPS)


def _found(slips: pd.DataFrame, events: pd.DataFrame) -> np.ndarray:
    """Slips that an event overlaps, of bool."""
    reported = events[events["kind"].isin(SLIPS)]
    begins, ends = (slips[name].to_numpy()[:, None] for name in ("start_s", "end_s"))
    overlap: np.ndarray = (reported["start_s"].to_numpy() < ends) & (reported["end_s"].to_numpy() > begins)
    return overlap.any(axis=1)


def _starts_in_slip(slips: pd.DataFrame, corrections: pd.DataFrame) -> np.ndarray:
    """Corrections whose start point lies in a slip, of bool."""
    begin = corrections["start_s"].to_numpy(dtype=float)[:, None]
    inside: np.ndarray = (begin > slips["start_s"].to_numpy()) & (begin < slips["end_s"].to_numpy())
    return inside.any(axis=1)


def _mean(values: np.ndarray) -> float:
    """NaN where there are none."""
    return float(np.mean(values)) if values.size else np.nan


def figures(measured: pd.DataFrame) -> list[Comparison]:
    """The lines of 003."""
    column = measured.to_dict("list")
    lines = []
    for short, scenario in {short: scenario for scenario, short in SCENARIOS.items()}.items():
        lines += _distances(column, short, scenario) + _detection(column, short, scenario)
    baseline, smoother = column["baseline curve rms"], column["smoother curve rms"]
    near = mean_of(baseline) <= NEAR_M
    lines += [
        Comparison("curves: chainage after one, rms, m", "10", "baseline <= 10", baseline, smoother, near),
        Comparison(
            "curves: share within 10 m", "-", "-", column["baseline curve within"], column["smoother curve within"]
        ),
        Comparison("curves: used in a run", "-", "-", column["curves used"]),
        Comparison("curves: refused in a run", "-", "-", column["curves refused"]),
    ]
    return lines


def _distances(column: dict[str, list[float]], short: str, scenario: str) -> list[Comparison]:
    lines = []
    for what, label in (("leg", "between balises with slip"), ("stretch", "of a slip")):
        baseline, smoother, wheel = (
            {of: column[f"{short} {name} {what} {of}"] for of in ("rms", "greatest", "within")}
            for name in ("baseline", "smoother", "wheel")
        )
        small = mean_of(smoother["rms"]) <= WITHIN["smoother"]
        quarter = ratio_met(smoother["rms"], baseline["rms"], 0.25)
        every = mean_of(baseline["within"]) == 1.0
        distance = f"{scenario}, distance {label}"
        lines += [
            Comparison(f"{distance}: rms, %", "-", "smoother <= 0.2", baseline["rms"], smoother["rms"], small),
            Comparison("the same", "-", "smoother <= 0.25 of it", baseline["rms"], smoother["rms"], quarter),
            Comparison(f"{distance}: share within 2 %", "about all", "baseline 1", baseline["within"], None, every),
            Comparison(f"{distance}: share within 0.2 %", "-", "-", None, smoother["within"]),
            Comparison(f"{distance}: greatest, %", "2", "-", baseline["greatest"], smoother["greatest"]),
            Comparison(f"{distance}: rms, %, of the wheel alone", "-", "-", wheel["rms"]),
        ]
    return lines


def _detection(column: dict[str, list[float]], short: str, scenario: str) -> list[Comparison]:
    def of(name: str) -> list[float]:
        return column[f"{short} {name}"]

    without, with_setback = of("no setback wrong starts"), of("baseline wrong starts")
    fewer = mean_of(without) > mean_of(with_setback)
    return [
        Comparison(f"{scenario}: slips in a run", "2.4", "-", of("slips")),
        Comparison(
            f"{scenario}: share of slips missed",
            "0",
            "baseline 0",
            of("baseline missed"),
            of("smoother missed"),
            mean_of(of("baseline missed")) == 0.0,
        ),
        Comparison(
            f"{scenario}: the same, above the threshold",
            "0",
            "baseline 0",
            of("baseline strong missed"),
            of("smoother strong missed"),
            mean_of(of("baseline strong missed")) == 0.0,
        ),
        Comparison(f"{scenario}: wrong start points, setback 0", "0.09", "more than with it", without, None, fewer),
        Comparison(f"{scenario}: wrong start points, setback 2.1 s", "0.02", "-", with_setback),
        Comparison(f"{scenario}: no re-adhesion, pitch corrected", "0.02", "-", of("baseline not readhered")),
        Comparison(f"{scenario}: no re-adhesion, pitch as measured", "more", "-", of("no pitch not readhered")),
    ]


PAPERS = (
    Part(
        name="003",
        title="Composite train positioning: scenarios slippery-line and slippery-line-leaves, 20 min each",
        measure=measure,
        figures=figures,
        notes=(
            "Errors of distances in % of them, magnitudes; one figure a run, runs without slip left out. The baseline"
            " is given the wheel's true scale, as in the paper, and no balise; the smoother estimates the scale and has"
            " the balises. Shares are of slips, or of corrections for start points and re-adhesion. Above the"
            " threshold: the wheel's speed differs from the train's by 3.7 km/h or more, below which the rule does not"
            " see a slip on the level."
        ),
    ),
)
