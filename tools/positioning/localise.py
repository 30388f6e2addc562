"""Later runs on the map of the shuttle: with a fix at the start alone, and begun anywhere with no fix at all.

Runs after those of the map, by vehicles that are not in it, there and back. *Under way* is what is faster than 0.5 m/s.
The **margin** is the greatest ``5 sigma`` of the chainage in the whole run, either side of the estimate: what a train
would have to keep clear so as to be beyond it once in 1.7 million; it is worth what the sigmas are worth, so the errors
are held against it too. The paper's margin is 2 % of the distance since the last landmark and 20 m for one slip.

Begun anywhere: recordings are cut out of these runs from a place drawn at random until the vehicle has passed the
first, second and third curve after it, and 60 m more. A place is *accepted* from a probability of 0.99 on, and right if
the chainage at the end is within 10 m.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from benchmark import Figure, Part, at_least, at_most, ratio

from positioning.runs import SHUTTLE, SURVEY_RUNS, cut, error_of, map_of_all, survey, true_at, with_fixes
from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.maps.feature_map import FeatureMap
from trackfg.numerics.arrays import Array
from trackfg.smoothing.smoother import smooth

LATER_RUNS = (SURVEY_RUNS, SURVEY_RUNS + 1)
STARTS = 3
"""Of each later run."""

UNDER_WAY_MPS = 0.5
NEAR_M, SHARE = 2.0, 0.95
MARGIN_SIGMAS, MARGIN_M = 5.0, 20.0
BELIEVED = 0.99
RIGHT_M = 10.0
CURVES = (1, 2, 3)
PAST_CURVE_M = 60.0


def measure(seed: int) -> dict[str, float]:
    """Counts and errors of both later runs together."""
    surveyed = survey(seed)
    feature_map = map_of_all(seed)
    runs = [simulate(SHUTTLE, seed=seed, run=number) for number in LATER_RUNS]
    length = float(np.ptp(feature_map.grid["chainage_m"]))
    out = {"curves per km": 1e3 * len(surveyed.designed) / length}
    out |= _located(runs, feature_map)
    rng = np.random.default_rng([seed, 1])
    cuts = [each for run in runs for each in _cuts(run, surveyed.designed, rng)]
    for count in CURVES:
        chosen = [(run, start, until[count - 1]) for run, start, until in cuts]
        out |= {f"{count} {name}": value for name, value in _begun_anywhere(chosen, feature_map).items()}
    return out


def _located(runs: list[Simulation], feature_map: FeatureMap) -> dict[str, float]:
    errors, sigmas, alone = [], [], []
    for run in runs:
        recording = with_fixes(run.recording, [0])
        result = smooth(recording, SmoothConfig(), feature_map=feature_map)
        moving = true_at(run, "speed_mps", result.trajectory["t_s"].to_numpy()) > UNDER_WAY_MPS
        errors.append(error_of(result, run, "chainage_m")[moving])
        sigmas.append(result.trajectory["chainage_m_sd"].to_numpy()[moving])
        alone.append(error_of(smooth(recording, SmoothConfig()), run, "chainage_m")[moving])
    error, sd, without = np.abs(np.concatenate(errors)), np.concatenate(sigmas), np.abs(np.concatenate(alone))
    return {
        "rows": float(len(error)),
        "near": float((error <= NEAR_M).sum()),
        "p95": float(np.quantile(error, 0.95)),
        "greatest": float(error.max()),
        "covered": float((error <= 1.96 * sd).sum()),
        "within margin": float((error <= MARGIN_SIGMAS * sd).sum()),
        "margin": MARGIN_SIGMAS * float(sd.max()),
        "without p95": float(np.quantile(without, 0.95)),
    }


def _cuts(run: Simulation, designed: Array, rng: np.random.Generator) -> list[tuple[Simulation, float, Array]]:
    """Where recordings begin, s, and when the vehicle has passed the first, second, ... curve after that."""
    truth, direction = run.truth, run.ride.direction
    t, along = truth["t_s"].to_numpy(), direction * truth["chainage_m"].to_numpy()
    begin, end = (np.sort(direction * designed[:, [0, 3]], axis=1)).T
    order = np.argsort(begin)
    begin, end = begin[order], end[order] + PAST_CURVE_M
    begin, end = begin[end < along[-1]], end[end < along[-1]]
    cuts = []
    for place in rng.uniform(along[0], begin[-max(CURVES)], STARTS):
        ahead = end[begin > place][: max(CURVES)]
        start = t[np.searchsorted(along, place)]
        cuts.append((run, float(start), t[np.searchsorted(along, ahead)]))
    return cuts


def _begun_anywhere(cuts: list[tuple[Simulation, float, float]], feature_map: FeatureMap) -> dict[str, float]:
    """How many recordings (run, start, end) there are, how many places are accepted, and how many of these right."""
    accepted = right = 0
    probability = []
    for run, start, end in cuts:
        result = smooth(cut(run.recording, start, end), SmoothConfig(), feature_map=feature_map)
        use = result.summary.map
        assert use is not None
        probability.append(use.probability)
        if use.probability >= BELIEVED and use.sections:
            accepted += 1
            right += abs(float(error_of(result, run, "chainage_m")[-1])) <= RIGHT_M
    return {
        "starts": float(len(cuts)),
        "accepted": float(accepted),
        "right": float(right),
        "wrong": float(accepted - right),
        "probability": float(np.mean(probability)),
    }


def figures(measured: pd.DataFrame) -> list[Figure]:
    """The lines of the part."""
    lines = [
        at_least(
            f"errors along the track within {NEAR_M:g} m, share",
            ratio(measured, "near", "rows"),
            SHARE,
            measured["near"] / measured["rows"],
        ),
        Figure("95th percentile, m", measured["p95"].mean(), measured["p95"]),
        Figure("greatest, m", measured["greatest"].max(), measured["greatest"]),
        Figure("share within 1.96 sigma", ratio(measured, "covered", "rows"), measured["covered"] / measured["rows"]),
        at_most("margin, m", measured["margin"].max(), MARGIN_M, measured["margin"], paper="180 -> 80"),
        Figure("share within its margin", ratio(measured, "within margin", "rows")),
        Figure("95th percentile without the map, m", measured["without p95"].mean(), measured["without p95"]),
        Figure("curves per km", measured["curves per km"].mean(), measured["curves per km"]),
    ]
    for count in CURVES:
        condition = f"begun anywhere, after {count} curve{'s' if count > 1 else ''}"
        name = f"{condition}: right place, accepted, share"
        share = ratio(measured, f"{count} right", f"{count} starts")
        by_seed = measured[f"{count} right"] / measured[f"{count} starts"]
        lines += [
            at_least(name, share, BELIEVED, by_seed) if count == max(CURVES) else Figure(name, share, by_seed),
            Figure(f"{condition}: mean probability", measured[f"{count} probability"].mean()),
            at_most(f"{condition}: wrong places accepted", measured[f"{count} wrong"].sum(), 0.0),
        ]
    starts = measured[f"{CURVES[0]} starts"].sum()
    return [*lines, Figure("begun anywhere: places in all", starts)]


PART = Part(
    name="localise",
    title="Later runs on the map of ten: shuttle, a fix at the start, and none",
    measure=measure,
    figures=figures,
    notes=(
        f"Margin: the greatest {MARGIN_SIGMAS:g} sigma of the chainage in a run, either side, and of all seeds."
        " The paper's: 2 % of the distance since the last landmark and 20 m for a slip. A place is accepted from a"
        f" probability of {BELIEVED:g} on and right within {RIGHT_M:g} m."
    ),
)
