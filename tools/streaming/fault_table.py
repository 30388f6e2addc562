"""The table of faults: by kind, how many cases failed each check, and how honest the sigmas are afterwards."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from streaming.faults import CHECKS, JUDGED, Outcome
from trackfg.evaluation.scores import COVERED


def by_kind(outcomes: Sequence[Outcome]) -> pd.DataFrame:
    """A row per kind and one for all: ``cases``, how many failed each check, the share of errors after the fault within
    the interval of 95 % in per cent, and the median and the greatest of the cases' worst errors in sigmas.
    """
    kinds = sorted({outcome.kind for outcome in outcomes})
    rows = [_row(kind, [outcome for outcome in outcomes if outcome.kind == kind]) for kind in kinds]
    return pd.DataFrame([*rows, _row("all", outcomes)])


def _row(kind: str, outcomes: Sequence[Outcome]) -> dict[str, float | str]:
    z = [np.concatenate(list(outcome.z.values())) for outcome in outcomes if outcome.z]
    pooled = np.abs(np.concatenate([np.zeros(0), *z]))
    worst = np.array([np.abs(of_case).max() for of_case in z if len(of_case)])
    return {
        "kind": kind,
        "cases": len(outcomes),
        "failed": sum(bool(outcome.failed) for outcome in outcomes),
        **{check: sum(check in outcome.failed for outcome in outcomes) for check in CHECKS},
        "within_percent": 100.0 * float(np.mean(pooled <= COVERED)) if len(pooled) else np.nan,
        "worst_median": float(np.median(worst)) if len(worst) else np.nan,
        "worst": float(worst.max()) if len(worst) else np.nan,
        "seconds": float(np.mean([outcome.seconds for outcome in outcomes])),
    }


def of_quantities(outcomes: Sequence[Outcome]) -> pd.DataFrame:
    """A row per table and quantity: errors over sigma after the fault, all cases together: median of the magnitude over
    that of a normal distribution, share within the interval of 95 % in per cent.
    """
    rows = []
    for name in [f"{table} {quantity}" for table in ("filtered", "smoothed") for quantity in JUDGED]:
        z = np.abs(np.concatenate([np.zeros(0), *(outcome.z[name] for outcome in outcomes if name in outcome.z)]))
        if len(z):
            ratio, within = float(np.median(z)) / 0.6745, 100.0 * float(np.mean(z <= COVERED))
            rows.append({"quantity": name, "rows": len(z), "median_ratio": ratio, "within_percent": within})
    return pd.DataFrame(rows)


def of_case(outcome: Outcome) -> pd.DataFrame:
    """A row that says all about one case."""
    worst = max((float(np.abs(z).max()) for z in outcome.z.values() if len(z)), default=np.nan)
    row = {
        "case": f"{outcome.kind}:{outcome.seed}",
        "ground": outcome.ground,
        "fault": outcome.said,
        "seconds": outcome.seconds,
        "worst": worst,
        "events": ", ".join(f"{count} {kind}" for kind, count in sorted(outcome.events.items())),
        **{check: outcome.failed.get(check, "") for check in CHECKS},
    }
    return pd.DataFrame([row])
