"""The lines of the papers' tables: what the paper says, the baseline, the smoother.

Each part has ``PAPERS``, a tuple of :class:`benchmark.Part`, named by the paper's number; ``figures`` gives lines of
this module. A target is judged by the part, as the seeds' mean unless the line says otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from benchmark import Part, yes_or_no
from scipy import stats


@dataclass(frozen=True)
class Comparison:
    """One line of a paper's table."""

    quantity: str
    """What it is, with its unit: ``max |error| of cross-level, mm``."""
    paper: str
    """The paper's own figure as text, ``-`` where it has none."""
    target: str
    """What is asked for, as text: ``baseline <= 1.0``, ``smoother <= 0.5 of baseline``; ``-`` where nothing is."""
    baseline: Sequence[float] | None
    """One per seed."""
    smoother: Sequence[float] | None = None
    """One per seed."""
    met: bool | None = None
    """Whether the target is met; None where there is none."""


def mean_of(values: Sequence[float] | None) -> float:
    """The mean over the seeds that have a value; NaN if none has."""
    finite = _known(values)
    return float(finite.mean()) if finite.size else float("nan")


def ratio_met(smoother: Sequence[float], baseline: Sequence[float], limit: float) -> bool:
    """Whether the smoother's mean over seeds is at most ``limit`` times the baseline's."""
    return bool(mean_of(smoother) <= limit * mean_of(baseline))


def statistics(values: Sequence[float] | None) -> dict[str, float]:
    """``mean``, ``margin`` (half its 95 % interval, Student's t over seeds), ``least``, ``greatest``, ``seeds``."""
    finite = _known(values)
    if finite.size == 0:
        return {"mean": np.nan, "margin": np.nan, "least": np.nan, "greatest": np.nan, "seeds": 0}
    margin = np.nan
    if finite.size > 1:
        margin = float(stats.t.ppf(0.975, finite.size - 1) * finite.std(ddof=1) / np.sqrt(finite.size))
    return {
        "mean": float(finite.mean()),
        "margin": margin,
        "least": float(finite.min()),
        "greatest": float(finite.max()),
        "seeds": finite.size,
    }


def table_of(part: Part, figures: Sequence[Comparison]) -> pd.DataFrame:
    """A row per figure: statistics of baseline and smoother, ``ratio`` of their means."""
    rows = []
    for figure in figures:
        baseline, smoother = statistics(figure.baseline), statistics(figure.smoother)
        rows.append(
            {
                "paper": part.name,
                "quantity": figure.quantity,
                "paper_figure": figure.paper,
                **{f"baseline_{name}": value for name, value in baseline.items()},
                **{f"smoother_{name}": value for name, value in smoother.items()},
                "ratio": smoother["mean"] / baseline["mean"] if baseline["mean"] else np.nan,
                "target": figure.target,
                "met": yes_or_no(figure.met),
            }
        )
    return pd.DataFrame(rows)


def printed(table: pd.DataFrame) -> str:
    """A table of :func:`table_of` for reading: mean +- margin [least .. greatest]."""
    shown = pd.DataFrame(
        {
            "quantity": table["quantity"],
            "paper": table["paper_figure"],
            "baseline": _texts(table, "baseline"),
            "smoother": _texts(table, "smoother"),
            "ratio": table["ratio"].map(lambda ratio: "-" if np.isnan(ratio) else f"{ratio:.2f}"),
            "target": table["target"],
            "met": table["met"],
        }
    )
    return shown.to_string(index=False)


def _texts(table: pd.DataFrame, name: str) -> list[str]:
    columns = [f"{name}_{of}" for of in ("mean", "margin", "least", "greatest", "seeds")]
    return [_text(*row) for row in table[columns].itertuples(index=False)]


def _text(mean: float, margin: float, least: float, greatest: float, seeds: int) -> str:
    if seeds == 0:
        return "-"
    if seeds == 1:
        return f"{mean:.3g}"
    return f"{mean:.3g} +- {margin:.2g} [{least:.3g} .. {greatest:.3g}]"


def _known(values: Sequence[float] | None) -> np.ndarray:
    array = np.asarray([] if values is None else values, dtype=np.float64)
    return array[np.isfinite(array)]
