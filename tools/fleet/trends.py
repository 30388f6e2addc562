"""How well trends are found: a year of runs over lines with growing defects, tamped in one month, and over still lines.

Only what trends are found from is made up: what each run says at each place, with errors that are alike over some
metres and between runs are not. Recordings, smoothing and recognition on a map are not in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np
import pandas as pd

from trackfg.geometry.limits import Limit
from trackfg.mapping.trends.series import QUANTITIES, Series
from trackfg.mapping.trends.trends import trends_of
from trackfg.mapping.trends.wear import MONTH_DAYS
from trackfg.results.trends import Trends

KM = 20.0
DEFECTS = 40
FOUND_BY = 6
"""Month by which a growing defect is to be found."""
TAMPED_IN = 7
_STEP_M, _SD_MM = 1.0, 0.4
_AT_M = 250.0 + 490.0 * np.arange(DEFECTS)
_RATES = np.linspace(0.5, 2.0, DEFECTS) * np.where(np.arange(DEFECTS) % 2, 1.0, -1.0)
_QUANTITY = "versine_level_mm"
_LIMIT_MM = 20.0
_FIRST = datetime(2026, 1, 5, tzinfo=UTC)


@dataclass(frozen=True)
class TrendScores:
    """Shares of defects found, ``rates`` within two sigmas, ``dates`` in their interval, tampings found at their run.

    ``false_per_100_km`` counts the trends of still lines.
    """

    found: float
    rates: float
    dates: float
    tamped: float
    false_per_100_km: float


def trend_scores(lines: int) -> TrendScores:
    """Return what comes of so many lines with defects, and as many still ones."""
    shares, rates, dates, tamped, false = [], [], [], [], 0
    limit = Limit(standard="made up", parameter="level", level="limit", kind="peak", value_mm=_LIMIT_MM, chord_m=10.0)
    for seed in range(lines):
        trends = trends_of(_line(FOUND_BY + 1, _RATES, seed), [(limit, _QUANTITY)])
        at_defects = _at_defects(trends.trends).groupby("defect").first()
        shares.append(len(at_defects) / DEFECTS)
        error = at_defects["rate_mm_per_month"] - _RATES[at_defects.index]
        rates += list(np.abs(error) < 2.0 * at_defects["rate_mm_per_month_sd"])
        dates += list(_dates_inside(trends))
        tamped_trends = trends_of(_line(TAMPED_IN + 1, _RATES, seed + 1000, tamped=True))
        steps = _at_defects(tamped_trends.steps)
        large = np.flatnonzero(np.abs(_RATES) * TAMPED_IN >= _LARGE_STEP_MM)
        on_time = steps[steps["date"] == _date(TAMPED_IN).date().isoformat()]["defect"]
        tamped += list(np.isin(large, on_time))
        false += len(trends_of(_line(FOUND_BY + 1, np.zeros(DEFECTS), seed + 2000)).trends)
    return TrendScores(
        float(np.mean(shares)),
        float(np.mean(rates)),
        float(np.mean(dates)),
        float(np.mean(tamped)),
        false / (lines * KM / 100.0),
    )


_LARGE_STEP_MM = 4.9
"""Steps that tamping is to be found by, mm: of defects of 0.7 mm a month and more after seven months."""


def _date(month: int) -> datetime:
    return _FIRST + timedelta(days=MONTH_DAYS * month)


def _line(months: int, rates: np.ndarray, seed: int, *, tamped: bool = False) -> Series:
    """Return runs a month apart; errors of a run are alike over some 5 m, as a versine's are."""
    rng = np.random.default_rng(seed)
    chainage = np.arange(0.0, 1e3 * KM, _STEP_M)
    kernel = np.hanning(round(5.0 / _STEP_M) + 2)[1:-1]
    kernel /= np.sqrt(np.sum(kernel**2))
    shape = np.zeros(chainage.size)
    for at, rate in zip(_AT_M, rates, strict=True):
        shape += rate * np.maximum(1.0 - (2.0 * (chainage - at) / 6.0) ** 2, 0.0) ** 3
    grown = np.arange(months, dtype=np.float64)
    grown[TAMPED_IN:] -= TAMPED_IN * tamped
    value = {}
    for name in QUANTITIES:
        errors = [np.convolve(rng.standard_normal(chainage.size), kernel, "same") for _ in range(months)]
        value[name] = 3.0 * np.sin(chainage / 7.0) + _SD_MM * np.array(errors)
    value[_QUANTITY] += grown[:, None] * shape
    sd = {name: np.full((months, chainage.size), _SD_MM) for name in QUANTITIES}
    runs = tuple(f"run{month}" for month in range(months))
    return Series(runs, tuple(map(_date, range(months))), chainage, _STEP_M, value, sd, ("",) * months)


def _at_defects(table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows at a defect, each with its number."""
    rows = table[table["quantity"] == _QUANTITY]
    nearest = np.abs(rows["at_m"].to_numpy()[:, None] - _AT_M).argmin(axis=1)
    return rows.assign(defect=nearest)[np.abs(rows["at_m"] - _AT_M[nearest]) < 5.0]


def _dates_inside(trends: Trends) -> list[bool]:
    """Return for each date at which the limit is reached whether the true one is in its interval."""
    inside = []
    for row in _at_defects(trends.reached).to_dict("records"):
        rate = _RATES[row["defect"]] * max(1.0 - (2.0 * (row["at_m"] - _AT_M[row["defect"]]) / 6.0) ** 2, 0.0) ** 3
        now = 3.0 * np.sin(row["at_m"] / 7.0)
        months = (np.copysign(_LIMIT_MM, rate) - now) / rate
        true = _date(0) + timedelta(days=MONTH_DAYS * months)
        latest = row["latest"] or "9999-12-31"
        inside.append(row["earliest"] <= true.date().isoformat() <= latest)
    return inside
