"""A track wears with time, or with the load that passes over it: what the rates of trends are per.

Settlement after maintenance follows the tonnage that has passed rather than the calendar, so that rates per million
tonnes compare lines and years of different traffic (C. Esveld, *Modern Railway Track*, 2nd ed., 2001).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np

from trackfg.errors import BadInputError
from trackfg.numerics.arrays import Array

MONTH_DAYS = 365.25 / 12.0
DAY_S = 86400.0


@dataclass(frozen=True)
class Wear:
    """The traffic that had passed in all (n,) at ``days`` (n,) since 1970, ascending, and ``per`` what: ``month``, or
    ``mt``.

    Between the rows it grows evenly, and after the last at the mean rate of all.
    """

    days: Array
    passed: Array
    per: str

    @property
    def months_each(self) -> float:
        """Return the months in which one more passed, on average."""
        return float((self.days[-1] - self.days[0]) / (self.passed[-1] - self.passed[0]) / MONTH_DAYS)

    def at(self, dates: Sequence[datetime]) -> Array:
        """Return what had passed at dates. Raises :class:`BadInputError` for one that the rows do not reach to."""
        days = _days(dates)
        for day, date in zip(days, dates, strict=True):
            if not self.days[0] <= day <= self.days[-1]:
                raise BadInputError(
                    f"the load is not known on {date:%Y-%m-%d}: expected rows before and after each run"
                )
        return np.asarray(np.interp(days, self.days, self.passed))

    def days_at(self, passed: Array) -> Array:
        """Return the days since 1970 at which so much will have passed; infinite where that is."""
        beyond = self.days[-1] + (passed - self.passed[-1]) * self.months_each * MONTH_DAYS
        return np.where(passed > self.passed[-1], beyond, np.interp(passed, self.passed, self.days))


def months(dates: Sequence[datetime]) -> Wear:
    """Return the months that pass between the first and the last of some dates."""
    days = _days([min(dates), max(dates)])
    return Wear(days, (days - days[0]) / MONTH_DAYS, "month")


def _days(dates: Sequence[datetime]) -> Array:
    return np.array([date.timestamp() / DAY_S for date in dates])
