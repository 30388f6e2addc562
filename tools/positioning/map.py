"""The map of the shuttle after one run and after ten: where its landmarks are, and the roll of the sensors' mountings.

Landmarks are held against the designed line's points. A curve of the map and a designed one belong together if they
overlap, turn the same way, and are each other's only one; the rest are missed and false. The middles of transitions
are known far better than their ends, which irregularities hide, so they have lines of their own: error
``(BTC + BCC)/2`` and the sigma of that from the covariance.

A sensor's roll is what makes the cross-level of a run's result wrong in the mean: its mounting, and what is left of the
accelerometer's bias and of the axes' misalignment, which no motion along a track separates from it. The map's is held
against the run's true one. And what is left in the map itself: its mean cross-level less the true one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from benchmark import Figure, Part, at_most, between, pooled_rms, ratio

from positioning.runs import SURVEY_RUNS, Survey, map_of_all, survey
from trackfg.evaluation.scores import rms
from trackfg.mapping import build_map
from trackfg.maps.feature_map import CURVE_POINTS, FeatureMap
from trackfg.numerics.arrays import Array

RUNS = {"one run": 1, "ten runs": SURVEY_RUNS}
ERROR_M = {"one run": 1.0, "ten runs": 0.4}
COVERAGE = (0.90, 0.98)
ROLL_MRAD = 0.1
FROM_END_M = 100.0
"""Designed curves that end nearer than this to where the map ends are not asked for."""

MIDDLES = {"middle in": ("BTC", "BCC"), "middle out": ("ECC", "ETC")}
POINTS = {**{point: (point,) for point in CURVE_POINTS}, **MIDDLES}


def measure(seed: int) -> dict[str, float]:
    """Names begin with how many runs the map is of."""
    surveyed, out = survey(seed), {}
    for name, count in RUNS.items():
        every = count == len(surveyed.results)
        feature_map = map_of_all(seed) if every else build_map(surveyed.results[:count], name=f"shuttle {seed}")
        first, last = feature_map.grid["chainage_m"].iloc[[0, -1]]
        begin, end = surveyed.designed[:, 0], surveyed.designed[:, 3]
        inside = (begin >= first + FROM_END_M) & (end <= last - FROM_END_M)
        scores = landmark_errors(feature_map.landmarks, feature_map.covariance, surveyed.designed)
        for what, points in {"ends": CURVE_POINTS, "middles": tuple(MIDDLES)}.items():
            chosen = scores.errors[scores.errors["point"].isin(points)]
            out |= {f"{name} {what} {of}": value for of, value in _scores(chosen).items()}
        out[f"{name} curves"] = float(inside.sum())
        out[f"{name} missed"] = float((inside & ~scores.seen).sum())
        out[f"{name} false"] = float(scores.false)
        out[f"{name} level mrad"] = _cross_level_error_mm(surveyed, feature_map) / _base_m(feature_map)
    return out | _rolls(surveyed, feature_map)


@dataclass(frozen=True)
class LandmarkErrors:
    """``errors``: a row per point of the curves that belong together, ``point, error_m, sd_m``; which designed curves
    have one of their own (n,); and how many curves of the map lie where none is.
    """

    errors: pd.DataFrame
    seen: np.ndarray
    false: int


def landmark_errors(landmarks: pd.DataFrame, covariance: Array, designed: Array) -> LandmarkErrors:
    """Landmarks and the covariance of their chainages (m, m) against designed curves (n, 6)."""
    points = landmarks.reset_index(drop=True)
    points = points[points["kind"].isin(CURVE_POINTS)]
    number = points.reset_index(names="row").pivot_table(index="curve_id", columns="kind", values="row")
    number = number.reindex(columns=list(CURVE_POINTS)).dropna().astype(np.int64)
    at = landmarks["chainage_m"].to_numpy()
    to_left = (landmarks["sense"].to_numpy()[number["BCC"]] == "left")[:, None]
    apart = (at[number["BCC"]][:, None] >= designed[:, 2]) | (at[number["ECC"]][:, None] <= designed[:, 1])
    overlap = ~apart & (to_left == (designed[:, 4] > 0.0))
    each_others_only = overlap & (overlap.sum(axis=0) == 1) & (overlap.sum(axis=1) == 1)[:, None]
    rows = []
    for i, j in zip(*np.nonzero(each_others_only), strict=True):
        true = dict(zip(CURVE_POINTS, designed[j, :4], strict=True))
        for point, ends in POINTS.items():
            which = number.iloc[i][list(ends)].to_numpy()
            sd = np.sqrt(covariance[np.ix_(which, which)].mean())
            rows.append((point, at[which].mean() - np.mean([true[end] for end in ends]), sd))
    errors = pd.DataFrame(rows, columns=["point", "error_m", "sd_m"])
    return LandmarkErrors(errors, each_others_only.any(axis=0), int((~overlap.any(axis=1)).sum()))


def _scores(errors: pd.DataFrame) -> dict[str, float]:
    covered = errors["error_m"].abs() <= 1.96 * errors["sd_m"]
    return {
        "count": float(len(errors)),
        "rms": rms(errors["error_m"]),
        "sigma": rms(errors["sd_m"]),
        "covered": float(covered.sum()),
        "greatest": float(errors["error_m"].abs().max()),
    }


def _base_m(feature_map: FeatureMap) -> float:
    return feature_map.conventions.cross_level_base_m


def _cross_level_error_mm(surveyed: Survey, feature_map: FeatureMap) -> float:
    """The mean over the map."""
    columns = ["chainage_m", "cross_level_mm"]
    both = feature_map.grid[columns].merge(surveyed.true_geometry[columns], on="chainage_m", suffixes=("", "_true"))
    return float((both["cross_level_mm"] - both["cross_level_mm_true"]).mean())


def _rolls(surveyed: Survey, feature_map: FeatureMap) -> dict[str, float]:
    """Of every run: the error of what the map says of its roll, and what that roll has besides the mounting."""
    runs = feature_map.runs.set_index("recording_id")
    order = [result.summary.recording_id for result in surveyed.results]
    roll = runs.loc[order, ["cross_level_bias_mm", "cross_level_bias_mm_sd"]].to_numpy() / _base_m(feature_map)
    error = roll[:, 0] - 1e3 * surveyed.roll_error_rad
    return {
        "runs": float(len(error)),
        "roll rms": rms(error),
        "roll sigma": rms(roll[:, 1]),
        "roll covered": float((np.abs(error) <= 1.96 * roll[:, 1]).sum()),
        "roll size": rms(1e3 * surveyed.roll_error_rad),
        "beside mounting rms": rms(1e3 * (surveyed.roll_error_rad - surveyed.mount_roll_rad)),
    }


def figures(measured: pd.DataFrame) -> list[Figure]:
    """The lines of the part."""
    lines = []
    for name, limit in ERROR_M.items():
        of = {column: f"{name} {column}" for column in ("ends count", "ends rms", "ends covered", "ends sigma")}
        lines += [
            at_most(
                f"{name}: error of BTC, BCC, ECC, ETC, standard deviation, m",
                pooled_rms(measured, of["ends rms"], of["ends count"]),
                limit,
                measured[of["ends rms"]],
                paper="10",
            ),
            Figure(f"{name}: their sigma, rms, m", pooled_rms(measured, of["ends sigma"], of["ends count"])),
            between(
                f"{name}: share within 1.96 sigma",
                ratio(measured, of["ends covered"], of["ends count"]),
                *COVERAGE,
                measured[of["ends covered"]] / measured[of["ends count"]],
            ),
            Figure(f"{name}: the greatest, m", measured[f"{name} ends greatest"].max()),
            Figure(
                f"{name}: error of transitions' middles, m",
                pooled_rms(measured, f"{name} middles rms", f"{name} middles count"),
                measured[f"{name} middles rms"],
            ),
            Figure(
                f"{name}: their sigma, rms, m", pooled_rms(measured, f"{name} middles sigma", f"{name} middles count")
            ),
            Figure(
                f"{name}: share within 1.96 sigma", ratio(measured, f"{name} middles covered", f"{name} middles count")
            ),
            Figure(f"{name}: curves not found, share", ratio(measured, f"{name} missed", f"{name} curves")),
            Figure(f"{name}: curves that are none, per line", measured[f"{name} false"].mean()),
            Figure(f"{name}: mean cross-level of the map, error, mrad", rms(measured[f"{name} level mrad"])),
        ]
    return [
        *lines,
        at_most(
            "roll of the sensors, error, mrad",
            pooled_rms(measured, "roll rms", "runs"),
            ROLL_MRAD,
            measured["roll rms"],
        ),
        Figure("its sigma, rms, mrad", pooled_rms(measured, "roll sigma", "runs")),
        Figure("share within 1.96 sigma", ratio(measured, "roll covered", "runs")),
        Figure("roll of the sensors, rms, mrad", pooled_rms(measured, "roll size", "runs")),
        Figure("of that not the mounting, mrad", pooled_rms(measured, "beside mounting rms", "runs")),
    ]


PART = Part(
    name="map",
    title=f"Map of {SURVEY_RUNS} runs: shuttle, 8 km, there and back, a balise at each end",
    measure=measure,
    figures=figures,
    notes=(
        "Errors are rms over all curves of all seeds, against the designed line. A sensor's roll is what makes a run's"
        " cross-level wrong in the mean: mounting, accelerometer's bias and axes' misalignment together."
    ),
)
