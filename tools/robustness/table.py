"""What the seeds of a case say together, and what of it misses the acceptance."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pandas as pd

from robustness.cases import CLEAN
from robustness.scores import FLOOR, ORACLE, QUANTITIES, SMOOTHER, STREAM

MOST_FAR = 0.05
"""The share of samples beyond four sigmas that needs a verdict."""
MOST_RATIO, LEAST_COVERAGE = 1.5, 0.85
"""Of rms over sigma, and coverage, where a verdict says trusted or widened."""
CLEAN_COVERAGE = (0.90, 0.98)
"""Of coverage where there is no effect, over :data:`MANY_RUNS` or more: an offset of a run counts once in it."""
MANY_RUNS = 20
"""With fewer runs a right sigma of an offset covers all of them too often: 0.95^20 is 36 %."""
OVER_ORACLE = 2.0
"""The error of the smoother over that of an oracle."""
OVER_FLOOR = 1.05
"""The error of the smoother over that of dead reckoning."""
NAMED = ("widened", "not_trusted")
JUDGED = (SMOOTHER, STREAM)
_MARKS = {"widened": "w", "not_trusted": "x"}


def summed_up(rows: pd.DataFrame) -> pd.DataFrame:
    """Return a row per case, estimator and quantity: how many runs, pooled rms and ratio, mean coverage, and the most
    seen of the verdicts.
    """
    scored = rows[rows["quantity"] != ""]
    groups = scored.groupby(["case", "estimator", "quantity"], sort=False)
    return pd.DataFrame({
        "runs": groups.size(),
        "rms": groups["rms"].agg(_pooled),
        "ratio": groups["ratio"].agg(_pooled),
        "coverage": groups["coverage"].mean(),
        "verdict": groups["verdict"].agg(lambda verdicts: verdicts.mode().iloc[0]),
    }).reset_index()  # fmt: skip


def failures(rows: pd.DataFrame) -> Iterator[str]:
    """Yield a line per case and kind of miss, in the order of the acceptance."""
    for row in rows[rows["quantity"] == ""].itertuples():
        yield f"refused: {row.case}, seed {row.seed}, {row.estimator}: {row.findings}"
    scored = rows[rows["quantity"] != ""]
    judged = scored[scored["estimator"].isin(JUDGED)]
    silent = judged[(judged["far"] > MOST_FAR) & ~judged["verdict"].isin(NAMED)]
    yield from _lines("1 silent", silent, lambda row: f"{row.quantity} {100 * row.far:.0f} % beyond 4 sigma")
    stopped = judged[~judged["converged"].astype(bool) & (judged["verdict"] != "not_trusted")]
    yield from _lines("1 not converged", stopped, lambda row: f"{row.quantity} {row.verdict}")
    trusted = summed_up(judged[judged["verdict"] != "not_trusted"])
    trusted = trusted[trusted["ratio"].notna()]
    clean = trusted["case"].str.startswith(CLEAN) & (trusted["runs"] >= MANY_RUNS)
    honest = trusted["coverage"].between(*CLEAN_COVERAGE).where(clean, trusted["coverage"] >= LEAST_COVERAGE)
    narrow = trusted[(trusted["ratio"] > MOST_RATIO) | ~honest]
    yield from _lines(
        "2 sigmas", narrow, lambda row: f"{row.quantity} {row.ratio:.2f}, {100 * row.coverage:.0f} %, {row.verdict}"
    )
    table = summed_up(scored)
    for label, other, most in (("3 oracle", ORACLE, OVER_ORACLE), ("4 floor", FLOOR, OVER_FLOOR)):
        behind = _beside(table, other)
        behind = behind[behind["rms"] > most * behind["other"]]
        yield from _lines(label, behind, lambda row: f"{row.quantity} {row.rms:.3g} against {row.other:.3g}")


def markdown(rows: pd.DataFrame) -> str:
    """Return the table: a row per case and estimator; a cell holds rms, rms over sigma, coverage in per cent, and w
    where the sigma was widened, x where the quantity is not to be trusted.
    """
    table = summed_up(rows)
    lines = [f"| case | estimator | {' | '.join(QUANTITIES)} |", "|---" * (len(QUANTITIES) + 2) + "|"]
    for (case, estimator), scores in table.groupby(["case", "estimator"], sort=False):
        by_quantity = scores.set_index("quantity")
        cells = [_cell(by_quantity.loc[name]) if name in by_quantity.index else "-" for name in QUANTITIES]
        lines.append(f"| {case} | {estimator} | {' | '.join(cells)} |")
    return "\n".join(lines)


def floor_markdown(rows: pd.DataFrame) -> str:
    """Return the table of random runs: per quantity how the smoother's error compares with that of dead reckoning."""
    beside = _beside(summed_up(rows), FLOOR)
    head = ("quantity", "runs", "smoother, rms", f"{FLOOR}, rms", "median of ratio", "ahead or within 5 %, runs")
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for quantity, runs in beside.groupby("quantity", sort=False):
        ratio = runs["rms"] / runs["other"]
        cells = (len(runs), _text(_pooled(runs["rms"])), _text(_pooled(runs["other"])), _text(ratio.median()))
        lines.append(f"| {quantity} | {' | '.join(map(str, cells))} | {(ratio <= OVER_FLOOR).sum()} |")
    return "\n".join(lines)


def _beside(table: pd.DataFrame, other: str) -> pd.DataFrame:
    """Return the rows of the smoother with the rms of another estimator as ``other``, where both have one."""
    keys = ["case", "quantity"]
    other_rms = table[table["estimator"] == other].set_index(keys)["rms"].rename("other")
    return table[table["estimator"] == SMOOTHER].join(other_rms, on=keys).dropna(subset=["rms", "other"])


def _lines(label: str, rows: pd.DataFrame, text: Callable[[Any], str]) -> Iterator[str]:
    """Yield a line per case, seed and estimator of ``rows``, which names its quantities."""
    keys = [key for key in ("case", "seed", "estimator") if key in rows]
    for group, misses in rows.groupby(keys, sort=False):
        named = dict(zip(keys, group, strict=True))
        seed = f", seed {named['seed']}" if "seed" in named else ""
        yield f"{label}: {named['case']}{seed}, {named['estimator']}: {'; '.join(map(text, misses.itertuples()))}"


def _cell(row: pd.Series) -> str:
    if np.isnan(row["ratio"]):
        return _text(row["rms"])
    mark = _MARKS.get(row["verdict"], "")
    return f"{_text(row['rms'])} ({row['ratio']:.2f}, {100 * row['coverage']:.0f}{f', {mark}' if mark else ''})"


def _pooled(values: pd.Series) -> float:
    finite = values.dropna()
    return float(np.sqrt(np.mean(np.square(finite)))) if len(finite) else np.nan


def _text(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.2g}" if abs(value) < 100.0 else f"{value:.0f}"
