"""Pages in a browser, and made-up results and comparisons that they are about."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackfg.comparison.table import SCORE_COLUMNS, About, ComparedCase, Comparison, LeftOut, rows_of
from trackfg.results.result import Result


@dataclass
class Opened:
    """A page in the browser; ``said``: messages of its console and errors; ``asked``: what it asked the network for."""

    tab: Any
    said: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)


@pytest.fixture(scope="session")
def open_page(browser: Any) -> Iterator[Callable[[Path], Opened]]:
    """Open a page of the disk, without a network, and wait until its charts are drawn."""
    context = browser.new_context(viewport={"width": 1280, "height": 900}, offline=True)

    def opened(path: Path) -> Opened:
        page = Opened(context.new_page())
        page.tab.on("console", lambda message: page.said.append(message.text))
        page.tab.on("pageerror", lambda error: page.said.append(str(error)))
        page.tab.on("request", lambda request: page.asked.append(request.url))
        page.tab.goto(path.as_uri())
        page.tab.wait_for_selector("html[data-charts=drawn]", timeout=120_000)
        return page

    yield opened
    context.close()


@pytest.fixture(scope="session")
def result_folder(make_result: Callable[..., Result], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """1.5 km with a peak of one row in the level at 300 m and a gap in it from 700 to 750 m."""
    result = make_result(rows=1000, noise_ratios={"gyro": 0.98, "tach": 3.0})
    chainage = result.geometry["chainage_m"].to_numpy()
    result.geometry.loc[chainage == 300.0, "level_mm"] = 9.0
    result.geometry.loc[(chainage > 700.0) & (chainage < 750.0), ["level_mm", "level_mm_sd"]] = np.nan
    return result.write(tmp_path_factory.mktemp("result") / "out1")


def score(estimator: str, quantity: str, error: float, **more: object) -> dict[str, object]:
    """A row of scores of case ``car``."""
    row = dict.fromkeys(SCORE_COLUMNS, np.nan)
    row |= {"case": "car", "seed": 0, "estimator": estimator, "quantity": quantity, "places": 100, "seconds": 2.0}
    return row | {"rms": error, "sd": error, "max": 3.0 * error, "coverage": 0.94, "distance_km": 4.0} | more


def curves(case: str = "car", shown: tuple[str, ...] = ("truth", "smoother", "rival")) -> pd.DataFrame:
    """Twist of 500 m by each of those that are shown."""
    chainage = 0.25 * np.arange(2001)
    true = 3.0 * np.sin(chainage / 7.0)
    tables = []
    for number, name in enumerate(shown):
        error = 0.1 * number * np.cos(chainage / 5.0)
        columns = {"chainage_m": chainage, "twist_mm": true + error, "twist_mm_sd": 0.1}
        if name != "truth":
            columns["twist_mm_error"] = error
        tables.append(pd.DataFrame(columns).assign(case=case, estimator=name))
    return pd.concat(tables, ignore_index=True)


@pytest.fixture(scope="session")
def comparison() -> Comparison:
    """Of the smoother and a rival, who is better in one quantity, and at low speed in another."""
    scores = pd.DataFrame(
        [
            row
            for seed, factor in enumerate((1.0, 1.1, 0.95))
            for row in (
                score("smoother", "twist_mm", 0.2 * factor, seed=seed),
                score("rival", "twist_mm", 0.15 * factor**1.1, seed=seed),
                score("smoother", "roll_mrad", 0.5 * factor, seed=seed),
                score("rival", "roll_mrad", 2.0, seed=seed),
                score("smoother", "versine_level_mm", 0.3 * factor, seed=seed),
                score("rival", "versine_level_mm", 0.6 * factor, seed=seed),
                *(score("smoother", "versine_level_mm", 0.3 * factor, from_kmh=v, seed=seed) for v in (10.0, 15.0)),
                *(score("rival", "versine_level_mm", e, from_kmh=v, seed=seed) for v, e in ((10.0, 0.29), (15.0, 0.9))),
            )
        ],
        columns=list(SCORE_COLUMNS),
    )
    about = About(
        seconds=75.0,
        cases=(ComparedCase(name="car", summary="a car", seeds=(0, 1, 2), duration_s=100.0, distance_km=4.0),),
        estimators={"smoother": "factor-graph smoother (trackfg)", "rival": "somebody's filter (2020)"},
        left_out=(LeftOut(case="car", estimator="third", reason="no lasers on this car"),),
        rows=rows_of(scores),
    )
    t = np.arange(100.0)
    positions = pd.concat(
        [
            pd.DataFrame({"t_s": t, "roll_mrad": offset + np.sin(t), "roll_mrad_sd": 0.5}).assign(
                case="car", estimator=name
            )
            for name, offset in (("smoother", 0.0), ("rival", 40.0))
        ],
        ignore_index=True,
    )
    return Comparison(about, scores, curves(), positions)


@pytest.fixture(scope="session")
def comparison_folder(comparison: Comparison, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return comparison.write(tmp_path_factory.mktemp("comparison") / "cmp")
