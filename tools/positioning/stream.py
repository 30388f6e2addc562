"""Later runs on the map of the shuttle as streams: with a fix at the start alone, begun anywhere, and on other track.

The later runs of :mod:`positioning_localise`, by the fixed-lag smoother at a lag of 20 s, against the batch smoother
with the same map. *Smoothed* is what comes once the lag is over, *filtered* what comes at once. Begun anywhere: a
recording without fixes from a place in the first half of the run on, drawn at random, to its end; the place is right if
it is within 10 m wherever the stream says that it is known to 100 m. Other track: the same on a run of another seed's
shuttle.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from benchmark import Figure, Part, at_least, at_most, ratio
from streaming.run_tables import tables_of

from positioning.localise import LATER_RUNS, RIGHT_M, UNDER_WAY_MPS
from positioning.runs import SHUTTLE, cut, map_of_all, true_at, with_fixes
from trackfg.config import SmoothConfig
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.maps.feature_map import FeatureMap
from trackfg.numerics.arrays import Array
from trackfg.recording.model import Recording
from trackfg.smoothing.smoother import smooth
from trackfg.streaming.fixed_lag import FixedLagSmoother
from trackfg.streaming.sources.source import RecordingSource

LAG_S = 20.0
KNOWN_M = 100.0
NEAR_M = 2.0
OTHER_SEED = 1000


def measure(seed: int) -> dict[str, float]:
    """Counts and errors of both later runs together."""
    feature_map, rng = map_of_all(seed), np.random.default_rng([seed, 2])
    out = {"starts": 0.0, "found": 0.0, "wrong": 0.0, "on other track": 0.0, "other track located": 0.0}
    errors: dict[str, list[Array]] = {name: [] for name in ("smoothed", "filtered", "alone", "batch", "sd")}
    distances = []
    for number in LATER_RUNS:
        run = simulate(SHUTTLE, seed=seed, run=number)
        recording = with_fixes(run.recording, [0])
        for name, table in streamed(recording, feature_map)[0].items():
            errors[name].append(_errors(table, run))
            if name == "smoothed":
                errors["sd"].append(_known(table, run)["chainage_m_sd"].to_numpy())
        errors["alone"].append(_errors(streamed(recording, None)[0]["smoothed"], run))
        errors["batch"].append(_errors(smooth(recording, SmoothConfig(), feature_map=feature_map).trajectory, run))
        t = run.truth["t_s"].to_numpy()
        begin, end = float(t[np.searchsorted(_travelled(run), rng.uniform(0.0, 0.5) * _travelled(run)[-1])]), t[-1]
        tables, _ = streamed(cut(run.recording, begin, end), feature_map)
        wrong = [np.abs(_errors(table, run)) > RIGHT_M for table in tables.values()]
        rows = tables["smoothed"][tables["smoothed"]["chainage_m_sd"] < KNOWN_M]
        out["starts"] += 1.0
        out["found"] += float(len(rows) > 0)
        out["wrong"] += float(any(one.any() for one in wrong))
        if len(rows):
            distances.append(np.ptp(np.interp([begin, rows["t_s"].iloc[0]], t, _travelled(run))))
        other = simulate(SHUTTLE, seed=seed + OTHER_SEED, run=number)
        _, kinds = streamed(with_fixes(other.recording, None), feature_map)
        out["on other track"] += 1.0
        out["other track located"] += float("located" in kinds)
    size = {name: np.abs(np.concatenate(parts)) for name, parts in errors.items()}
    return out | {
        "rows": float(len(size["smoothed"])),
        "near": float((size["smoothed"] <= NEAR_M).sum()),
        "covered": float((size["smoothed"] <= 1.96 * size["sd"]).sum()),
        "greatest": float(size["smoothed"].max()),
        "found after": float(np.mean(distances)) if distances else np.nan,
        **{f"{name} p95": float(np.quantile(size[name], 0.95)) for name in ("smoothed", "filtered", "alone", "batch")},
    }


def streamed(recording: Recording, feature_map: FeatureMap | None) -> tuple[dict[str, pd.DataFrame], set[str]]:
    """The smoothed and the filtered trajectory, and the kinds of the events."""
    smoother = FixedLagSmoother(recording.description, lag_s=LAG_S, feature_map=feature_map)
    tables, counts = tables_of(RecordingSource(recording), smoother)
    return {name: tables[name] for name in ("smoothed", "filtered")}, set(counts.events)


def _known(table: pd.DataFrame, run: Simulation) -> pd.DataFrame:
    """Rows under way whose place is known."""
    moving = true_at(run, "speed_mps", table["t_s"].to_numpy()) > UNDER_WAY_MPS
    return table[moving & (table["chainage_m_sd"].to_numpy() < KNOWN_M)]


def _errors(table: pd.DataFrame, run: Simulation) -> Array:
    rows = _known(table, run)
    return np.asarray(rows["chainage_m"] - true_at(run, "chainage_m", rows["t_s"].to_numpy()))


def _travelled(run: Simulation) -> Array:
    chainage = run.truth["chainage_m"].to_numpy()
    return np.abs(chainage - chainage[0])


def figures(measured: pd.DataFrame) -> list[Figure]:
    """The lines of the part."""
    return [
        at_least(
            f"smoothed, errors along the track within {NEAR_M:g} m, share",
            ratio(measured, "near", "rows"),
            0.95,
            measured["near"] / measured["rows"],
        ),
        *(
            Figure(f"{name}, 95th percentile, m", measured[f"{key} p95"].mean(), measured[f"{key} p95"])
            for name, key in (
                ("smoothed", "smoothed"),
                ("filtered", "filtered"),
                ("batch with the map", "batch"),
                ("smoothed without the map", "alone"),
            )
        ),
        Figure("smoothed, greatest, m", measured["greatest"].max(), measured["greatest"]),
        Figure("smoothed, share within 1.96 sigma", ratio(measured, "covered", "rows")),
        Figure("begun anywhere: found, share", ratio(measured, "found", "starts")),
        Figure("begun anywhere: found after, m", measured["found after"].mean(), measured["found after"]),
        at_most("begun anywhere: wrong places", measured["wrong"].sum(), 0.0),
        at_most("on other track: located", measured["other track located"].sum(), 0.0),
    ]


PART = Part(
    name="stream",
    title=f"Later runs as streams on the map of ten: shuttle, a lag of {LAG_S:g} s",
    measure=measure,
    figures=figures,
    notes="Errors are of the rows whose place is known, under way. Found after: the way until the first smoothed row.",
)
