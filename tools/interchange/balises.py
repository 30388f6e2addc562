"""Balises of simulated runs: unknown ones surveyed, one planned wrong, by one run and by several together."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from trackfg.datasets.scenarios import simulate
from trackfg.mapping.runs.balise_survey import BaliseSurvey, surveyed_by_results
from trackfg.numerics.arrays import Array
from trackfg.recording.description import Balises
from trackfg.recording.model import Recording
from trackfg.results.result import Result
from trackfg.smoothing.smoother import smooth

COUNT, OFF_M = 40, 9.0
_PLANNED_SD, _READING_SD = 0.2, 0.1
"""Of plans and of readings, m."""
_RUNS = 3
_DURATION_S = 120.0
"""Of a run, s: a train has gone more than 1 km by then."""
_WRONG = COUNT // 2
_UNKNOWN = np.arange(3, COUNT, 6)
"""Balises without a plan."""


@dataclass(frozen=True)
class _Line:
    """Where balises are (m,) and where they are planned, NaN where unknown."""

    places: Array
    planned: Array

    def with_wrong(self) -> _Line:
        """Return the line with one plan that is wrong."""
        return replace(self, planned=self.planned + OFF_M * (np.arange(COUNT) == _WRONG))


def print_balises(seeds: int) -> None:
    """Print how wrong plans are found and unknown places surveyed, by one run and by several."""
    print(f"\n{COUNT} balises, one planned {OFF_M:g} m off, {len(_UNKNOWN)} without a plan; {seeds} seeds")
    print("\n| runs | wrong plan, sigmas at least | others named | bends the rest at most, m | within 2 sigma | rms |")
    print("|---|---|---|---|---|---|")
    by_count: dict[int, list[tuple[float, int, float, Array]]] = {1: [], _RUNS: []}
    for seed in range(seeds):
        wrong, right, line = _smoothed(seed)
        for count, rows in by_count.items():
            rows.append(_scores(_survey(wrong[:count]), _survey(right[:count]), line))
    for count, rows in by_count.items():
        sigmas, named, bent, normalised = zip(*rows, strict=True)
        z = np.concatenate(normalised)
        within, rms = 100.0 * np.mean(np.abs(z) < 2.0), np.sqrt(np.mean(z**2))
        print(
            f"| {count} | {min(sigmas):.1f} | {sum(named)} | {max(bent):.3f} | {within:.1f} % | {rms:.2f} |", flush=True
        )


def _smoothed(seed: int) -> tuple[list[Result], list[Result], _Line]:
    """Return the results of some runs of one line, with the wrong plan and without, and the line."""
    rng = np.random.default_rng(seed)
    runs = [simulate("mainline", seed=seed, run=number, duration_s=_DURATION_S) for number in range(_RUNS)]
    way = [run.truth["chainage_m"].to_numpy()[[0, -1]] for run in runs]
    places = np.linspace(max(first for first, _ in way) + 10.0, min(last for _, last in way) - 10.0, COUNT)
    planned = places + _PLANNED_SD * rng.normal(size=COUNT)
    planned[_UNKNOWN] = np.nan
    line = _Line(places, planned)
    wrong, right = [], []
    for run in runs:
        chainage, t = run.truth["chainage_m"].to_numpy(), run.truth["t_s"].to_numpy()
        passage_t = np.interp(places + _READING_SD * rng.normal(size=COUNT), chainage, t)
        wrong.append(smooth(_with_balises(run.recording, passage_t, line.with_wrong())))
        right.append(smooth(_with_balises(run.recording, passage_t, line)))
    return wrong, right, line


def _with_balises(recording: Recording, passage_t: Array, line: _Line) -> Recording:
    table = pd.DataFrame({"t_s": passage_t, "id": [str(number) for number in range(COUNT)], "chainage_m": line.planned})
    table["chainage_sd_m"] = np.where(np.isnan(line.planned), np.nan, _PLANNED_SD)
    balises = Balises(file="balises.csv", reading_sd_m=_READING_SD)
    description = recording.description.model_copy(update={"fixes": None, "balises": balises})
    return replace(recording, fixes=None, balises=table, description=description)


def _survey(results: list[Result]) -> BaliseSurvey:
    return surveyed_by_results(results, [f"run {number}" for number in range(len(results))])


def _scores(wrong: BaliseSurvey, right: BaliseSurvey, line: _Line) -> tuple[float, int, float, Array]:
    """Return the sigmas of the wrong plan, how many others are named, how far others moved, and normalised errors."""
    with_wrong, without = (one.table.set_index(one.table["id"].astype(int)).sort_index() for one in (wrong, right))
    named = with_wrong["verdict"].isin(("wrong", "undecided")) & ~without["verdict"].isin(("wrong", "undecided"))
    others = with_wrong.index != _WRONG
    bent = float(np.abs(with_wrong["place_m"] - without["place_m"])[others].max())
    surveyed = with_wrong.loc[_UNKNOWN]
    normalised = (surveyed["place_m"] - line.places[_UNKNOWN]) / surveyed["place_m_sd"]
    sigmas = abs(float(with_wrong.loc[_WRONG, "sigmas"])) if named[_WRONG] else 0.0
    return sigmas, int(named[others].sum()), bent, normalised.to_numpy()
