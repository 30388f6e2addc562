"""The first rows of the IMU have to show gravity where the description says, as those of a whole recording.

In wrong units or on a wrong axis they would make estimates that look right: speeds and curves with the wrong sign, and
sigmas that say nothing of it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from trackfg.checks.limits import CheckLimits
from trackfg.errors import BadInputError
from trackfg.numerics.arrays import Array
from trackfg.recording.description import Imu
from trackfg.recording.findings import errors
from trackfg.recording.model import IMU_COLUMNS

FIRST_S = 10.0
"""Rows of so many seconds are judged, s: those that the first window is made from."""
_LONGEST_INTERVAL_S = 0.5
"""A hole counts as no more than this, s."""


@dataclass
class GravityCheck:
    """Keeps the IMU's first rows until they are enough: ``waiting``, canonical; None once they have been judged."""

    limits: CheckLimits
    waiting: list[Array] | None = field(default_factory=list)

    def take(self, rows: Array, imu: Imu) -> None:
        """Take the next rows (n, 7). Raises :class:`~trackfg.errors.BadInputError` where they show gravity elsewhere
        than the description says, or none.
        """
        if self.waiting is None or not len(rows):
            return
        self.waiting.append(rows.copy())
        times = np.concatenate([part[:, 0] for part in self.waiting])
        if np.minimum(np.diff(times), _LONGEST_INTERVAL_S).sum() < FIRST_S:
            return
        # Late: it loads SciPy, which takes as long as many rows.
        from trackfg.checks.inertial.inertial_units import gravity_findings

        table = pd.DataFrame(np.concatenate(self.waiting), columns=list(IMU_COLUMNS))
        self.waiting = None
        if faults := errors(gravity_findings(imu, table, "description", self.limits)):
            place = "description" if faults[0].file == "description" else "imu"
            raise BadInputError(f"the first {FIRST_S:g} s of the stream: {replace(faults[0], file=place)}")
