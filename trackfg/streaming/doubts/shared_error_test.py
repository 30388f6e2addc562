"""A stream tests whether its positions may share an error, as :mod:`trackfg.smoothing.gnss_errors` does of a run.

What they may share is held against the mean variance of what they place, at their times: in an outage it is no part of
the error.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from trackfg.numerics.arrays import Array
from trackfg.results.events import Event
from trackfg.smoothing.gnss_errors import placed_by_positions
from trackfg.streaming.doubts.reporting import event_of
from trackfg.streaming.window.records.gnss_record import GnssRecord

_PLACED = placed_by_positions(has_fixes=False)
"""All that positions may place, with its column."""


@dataclass
class SharedErrorTest:
    """The test keeps the number of ``positions``, and the ``variances`` (2,) of what they place summed up at their
    times, m^2.
    """

    positions: int = 0
    variances: Array = field(default_factory=lambda: np.zeros(len(_PLACED)))

    def put(self, smoothed: pd.DataFrame, gnss: pd.DataFrame | None) -> None:
        """Take the next rows of the trajectory, and the positions of their time."""
        if gnss is None or not len(smoothed):
            return
        t, at = smoothed["t_s"].to_numpy(), gnss["t_s"].to_numpy()
        at = at[(at >= t[0]) & (at <= t[-1])]
        self.positions += len(at)
        sds = (smoothed[f"{column}_sd"].to_numpy() for column in _PLACED.values())
        self.variances += [np.interp(at, t, sd**2).sum() for sd in sds]

    def events(self, record: GnssRecord, until_s: float, *, has_fixes: bool) -> tuple[Event, ...]:
        """Return an event for each quantity whose sigma is too small for what positions, of which ``record`` is, may
        share.
        """
        shared = record.shared_error()
        if shared is None or not self.positions:
            return ()
        usual = dict(zip(_PLACED, (self.variances / self.positions).tolist(), strict=True))
        placed = {quantity: usual[quantity] for quantity in placed_by_positions(has_fixes=has_fixes)}
        return tuple(event_of(doubt, until_s) for doubt in shared.doubts(placed))
