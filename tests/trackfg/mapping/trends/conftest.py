"""Monthly runs over half a kilometre with one dip, which grows with the load that passes: more of it from May on."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest

from trackfg.geometry.limits import Limit
from trackfg.mapping.trends.series import QUANTITIES, Series
from trackfg.mapping.trends.trends import trends_of
from trackfg.mapping.trends.wear import Wear
from trackfg.results.trends import Trends

DATES = tuple(datetime(2026, month, 1, tzinfo=UTC) for month in range(1, 9))
LOAD_MT = np.array([10.0, 11.0, 12.0, 13.0, 14.0, 18.0, 22.0, 26.0])
SD_MM, MM_PER_MT = 0.1, 0.5


@pytest.fixture(scope="session")
def dip() -> Series:
    rng, chainage = np.random.default_rng(4), np.arange(0.0, 500.0, 0.5)
    kernel = np.hanning(12)[1:-1]
    kernel /= np.sqrt(np.sum(kernel**2))

    def errors() -> np.ndarray:
        return SD_MM * np.array([np.convolve(rng.standard_normal(chainage.size), kernel, "same") for _ in DATES])

    value = {name: 3.0 * np.sin(chainage / 7.0) + errors() for name in QUANTITIES}
    shape = np.maximum(1.0 - ((chainage - 250.0) / 3.0) ** 2, 0.0) ** 3
    value["versine_level_mm"] += np.outer(MM_PER_MT * (LOAD_MT - LOAD_MT[0]), shape)
    sd = {name: np.full((len(DATES), chainage.size), SD_MM) for name in QUANTITIES}
    names = tuple(f"run{number}" for number in range(len(DATES)))
    return Series(names, DATES, chainage, 0.5, value, sd, ("",) * len(DATES))


@pytest.fixture(scope="session")
def load() -> Wear:
    """Known to the end of the year, a million tonnes a month from August on."""
    days = [date.timestamp() / 86400.0 for date in (*DATES, datetime(2027, 1, 1, tzinfo=UTC))]
    return Wear(np.array(days), np.append(LOAD_MT, 31.0), "mt")


@pytest.fixture(scope="session")
def by_load(dip: Series, load: Wear) -> Trends:
    limit = Limit(standard="ours", parameter="level", level="limit", kind="peak", value_mm=7.0, chord_m=10.0)
    return trends_of(dip, [(limit, "versine_level_mm")], load=load)
