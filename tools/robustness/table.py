"""What the seeds of a case say together, and what of it misses the acceptance."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

from robustness.scores import FLOOR, ORACLE, SMOOTHER, STREAM

MOST_FAR = 0.05
"""The share of samples beyond four sigmas that needs a verdict."""
MOST_RATIO, LEAST_COVERAGE = 1.5, 0.85
"""Of rms over sigma, and coverage, where a verdict says trusted or widened."""
CLEAN_COVERAGE = (0.90, 0.98)
OVER_ORACLE = 2.0
"""The error of the smoother over that of an oracle."""
OVER_FLOOR = 1.05
"""The error of the smoother over that of dead reckoning."""
NAMED = ("widened", "not_trusted")

KEYS = ["case", "estimator", "quantity"]


def summed_up(rows: pd.DataFrame) -> pd.DataFrame:
    """Return a row per case, estimator and quantity: pooled rms and ratio, means of sigma, coverage and share far off,
    and how many runs had each verdict.
    """
    scored = rows[rows["quantity"] != ""]
    groups = scored.groupby(KEYS, sort=False)
    return pd.DataFrame({
        "seeds": groups.size(),
        "rms": groups["rms"].agg(_pooled),
        "mean_sd": groups["mean_sd"].mean(),
        "ratio": groups["ratio"].agg(_pooled),
        "coverage": groups["coverage"].mean(),
        "far": groups["far"].mean(),
        "verdict": groups["verdict"].agg(_counted),
        "believed": groups["verdict"].agg(lambda verdicts: bool((verdicts != "not_trusted").any())),
    }).reset_index()  # fmt: skip


def failures(rows: pd.DataFrame) -> Iterator[str]:
    """Yield a line per miss of the acceptance, of the smoother and of streams."""
    for row in rows[rows["quantity"] == ""].itertuples():
        yield f"{row.case}, seed {row.seed}: refused: {row.findings}"
    scored = rows[rows["quantity"] != ""]
    for (case, seed, estimator), runs in scored[~scored["converged"].astype(bool)].groupby(
        ["case", "seed", "estimator"]
    ):
        if (runs["verdict"] != "not_trusted").any():
            yield f"1 silent: {case}, seed {seed}, {estimator}: not converged, and not said of every quantity"
    silent = scored[
        (scored["far"] > MOST_FAR) & ~scored["verdict"].isin(NAMED) & scored["estimator"].isin([SMOOTHER, STREAM])
    ]
    for row in silent.itertuples():
        yield (
            f"1 silent: {row.case}, seed {row.seed}, {row.estimator}: {row.quantity} {100 * row.far:.0f} % beyond "
            f"4 sigma (rms {row.rms:.3g}, sigma {row.mean_sd:.3g}), verdict {row.verdict}"
        )
    table = summed_up(scored)
    believed = table[table["estimator"].isin([SMOOTHER, STREAM]) & table["believed"] & table["ratio"].notna()]
    for row in believed.itertuples():
        if row.ratio > MOST_RATIO or row.coverage < LEAST_COVERAGE:
            yield (
                f"2 sigmas: {row.case}, {row.estimator}: {row.quantity} rms/sigma {row.ratio:.2f}, coverage "
                f"{100 * row.coverage:.0f} %, verdict {row.verdict}"
            )
    for other, most, what in ((ORACLE, OVER_ORACLE, "3 oracle"), (FLOOR, OVER_FLOOR, "4 floor")):
        for case, quantity, mine, theirs in _against(table, other):
            if mine > most * theirs:
                yield f"{what}: {case}: {quantity} {mine:.3g} against {theirs:.3g}, {mine / theirs:.2f} times"


def markdown(rows: pd.DataFrame) -> str:
    """Return the table: a row per case and quantity, the smoother beside oracle and dead reckoning."""
    table = summed_up(rows)
    others = {
        other: table[table["estimator"] == other].set_index(["case", "quantity"])["rms"] for other in (ORACLE, FLOOR)
    }
    head = ("case", "estimator", "quantity", "rms", "sigma", "rms/sigma", "coverage %", "beyond 4 sigma %", "verdict")
    head = (*head, ORACLE, FLOOR)
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for row in table[table["estimator"].isin([SMOOTHER, STREAM])].itertuples():
        beside = [_text(others[other].get((row.case, row.quantity), np.nan)) for other in (ORACLE, FLOOR)]
        own = [_text(row.rms), _text(row.mean_sd), _text(row.ratio), _text(100 * row.coverage), _text(100 * row.far)]
        cells = [row.case, row.estimator, row.quantity, *own, row.verdict, *beside]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _against(table: pd.DataFrame, other: str) -> Iterator[tuple[str, str, float, float]]:
    """Yield case, quantity and the errors of the smoother and of another estimator, where both have one."""
    mine, theirs = (
        table[table["estimator"] == name].set_index(["case", "quantity"])["rms"] for name in (SMOOTHER, other)
    )
    for case, quantity in theirs.index:
        if (case, quantity) in mine.index and np.isfinite(theirs[case, quantity]):
            yield case, quantity, float(mine[case, quantity]), float(theirs[case, quantity])


def _pooled(values: pd.Series) -> float:
    known = values.dropna()
    return float(np.sqrt(np.mean(np.square(known)))) if len(known) else np.nan


def _counted(verdicts: pd.Series) -> str:
    counts = verdicts.value_counts()
    return counts.index[0] if len(counts) == 1 else ", ".join(f"{name} {count}" for name, count in counts.items())


def _text(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.3g}" if abs(value) < 1000.0 else f"{value:.0f}"
