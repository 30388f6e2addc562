"""Defects of 3 mm that came after the map was made: which are found, and what is reported where nothing changed.

Two later runs over the shuttle's track, there and back, by vehicles that are not in the map: once with the defects of
:func:`defects`, and once on the track as the map knows it. A defect is found if a change is reported within 20 m of
it (a gradient over 25 m and a twist over 5 m show it that far off); a change further off from every defect is a false
alarm.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from benchmark import Figure, Part, at_least, below, ratio

from positioning.runs import SHUTTLE, SURVEY_RUNS, map_of_all, with_defects
from trackfg.config import SmoothConfig
from trackfg.datasets.line.defects import Defect
from trackfg.datasets.scenarios import simulate
from trackfg.mapping import find_changes
from trackfg.mapping.changes.changes import Changes
from trackfg.smoothing.smoother import smooth

LATER_RUNS = (SURVEY_RUNS, SURVEY_RUNS + 1)
SIZE_M = 3e-3
KINDS = ("dip", "dip of one rail", "kink", "twist")
FIRST_M, APART_M, SPREAD_M = 500.0, 1800.0, 1000.0
NEAR_M = 20.0
FALSE_PER_10_KM = 1.0


def defects(seed: int) -> tuple[Defect, ...]:
    """One of each of :data:`KINDS`, 5 m long, at places drawn at random, 800 m apart or more."""
    places = FIRST_M + APART_M * np.arange(4) + np.random.default_rng([seed, 2]).uniform(0.0, SPREAD_M, 4)
    dip, one_rail, kink, twist = places.tolist()
    return (
        Defect("dip", dip, SIZE_M, 5.0),
        Defect("dip", one_rail, SIZE_M, 5.0, rail="left"),
        Defect("kink", kink, SIZE_M, 5.0),
        Defect("twist", twist, SIZE_M, 5.0),
    )


def measure(seed: int) -> dict[str, float]:
    """Defects found by kind, false alarms and what was compared, of all later runs together."""
    feature_map, placed = map_of_all(seed), defects(seed)
    out = {f"{kind} found": 0.0 for kind in KINDS} | {"runs": float(len(LATER_RUNS)), "false": 0.0, "km": 0.0}
    for plan, placed_defects in ((with_defects(placed), placed), (SHUTTLE, ())):
        for number in LATER_RUNS:
            result = smooth(simulate(plan, seed=seed, run=number).recording, SmoothConfig())
            changes = find_changes(result, feature_map)
            near = near_defects(changes.table, placed_defects)
            for kind, hit in zip(KINDS, near.any(axis=0), strict=False):
                out[f"{kind} found"] += float(hit)
            out["false"] += float((~near.any(axis=1)).sum())
            out["km"] += _compared_km(changes)
    return out


def near_defects(table: pd.DataFrame, placed: tuple[Defect, ...]) -> np.ndarray:
    """Which change (rows) is near which defect (columns), of bool."""
    first, last = (table[name].to_numpy(dtype=float)[:, None] for name in ("from_m", "to_m"))
    extent = np.array([defect.extent_m for defect in placed]).reshape(-1, 2)
    near: np.ndarray = (first <= extent[:, 1] + NEAR_M) & (last >= extent[:, 0] - NEAR_M)
    return near


def _compared_km(changes: Changes) -> float:
    chainage = changes.cells["chainage_m"]
    return 1e-3 * float(chainage.iloc[-1] - chainage.iloc[0])


def figures(measured: pd.DataFrame) -> list[Figure]:
    """The lines of the part."""
    every = measured.assign(
        found=measured[[f"{kind} found" for kind in KINDS]].sum(axis=1), placed=len(KINDS) * measured["runs"]
    )
    return [
        at_least(
            "defects of 3 mm found, share", ratio(every, "found", "placed"), 1.0, every["found"] / every["placed"]
        ),
        *(Figure(f"{kind}, share found", ratio(every, f"{kind} found", "runs")) for kind in KINDS),
        below(
            "false alarms per 10 km",
            10.0 * ratio(every, "false", "km"),
            FALSE_PER_10_KM,
            10.0 * every["false"] / every["km"],
        ),
        Figure("km compared", every["km"].sum()),
    ]


PART = Part(
    name="changes",
    title="Defects of 3 mm since the map of ten: shuttle, there and back, and the same without defects",
    measure=measure,
    figures=figures,
    notes=(
        "A dip of both rails, a dip of one, a kink and a twist on 5 m; found if a change is reported within"
        f" {NEAR_M:g} m."
    ),
)
