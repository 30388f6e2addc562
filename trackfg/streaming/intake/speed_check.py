"""A receiver's speeds have to be those of its positions, or of the tach, as those of a whole recording.

In km/h, declared as m/s, they would pull on all that is estimated, and robust weights take them for what they say at
first. So each minute the newest ten minutes are compared, as ``trackfg check`` compares a recording, until they show
the scale of the speeds. Where that is another unit's an event says so, and speeds are left out from then on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from trackfg.checks.diagnosis_wheel import receiver_speed_scale
from trackfg.checks.limits import CheckLimits
from trackfg.checks.receiver_speeds import receiver_speed_findings
from trackfg.numerics.arrays import Array
from trackfg.recording.description import GnssSpeed
from trackfg.recording.model import GNSS_COLUMNS, GNSS_SPEED_COLUMNS, GNSS_SPEED_TABLE, TACH_COLUMNS
from trackfg.results.events import doubt_event
from trackfg.streaming.events import LossReport

EVERY_S = 60.0
"""Time between comparisons, s: they cost some milliseconds."""
LONGEST_S = 600.0
"""Rows of so long are compared, s. A vehicle at rest shows nothing, however long."""
LEAST_ROLLED_M = 1000.0
"""Way by the tach from which on it determines a scale: a slip of one departure is no more than a tenth of it."""
_SIGMAS = 3.0
"""A scale is another one from so many of its sigmas beyond the limit on."""

_COLUMNS = {GNSS_SPEED_TABLE: GNSS_SPEED_COLUMNS, "gnss": GNSS_COLUMNS, "tach": TACH_COLUMNS}


@dataclass
class SpeedCheck:
    """Keeps canonical rows by table until the scale of the speeds is known: ``waiting``, None from then on.

    ``next_s``: time of the next comparison; ``contradicted``: whether speeds are left out.
    """

    limits: CheckLimits
    waiting: dict[str, list[Array]] | None = field(default_factory=dict)
    next_s: float | None = None
    contradicted: bool = False

    def sound(self, tables: Mapping[str, Array], part: GnssSpeed | None, report: LossReport) -> dict[str, Array]:
        """Return the next rows without speeds that are contradicted, which are reported."""
        out = dict(tables)
        if part is None:
            return out
        if self.contradicted:
            if GNSS_SPEED_TABLE in out:
                report.lose("contradicted", GNSS_SPEED_TABLE, out.pop(GNSS_SPEED_TABLE)[:, 0])
        elif self.waiting is not None:
            self._take(out, self.waiting, part, report)
        return out

    def _take(
        self, tables: Mapping[str, Array], waiting: dict[str, list[Array]], part: GnssSpeed, report: LossReport
    ) -> None:
        for name in _COLUMNS:
            if name in tables and len(tables[name]):
                waiting.setdefault(name, []).append(tables[name].copy())
        if not waiting:
            return
        now_s = max(float(parts[-1][-1, 0]) for parts in waiting.values())
        if self.next_s is None or now_s < self.next_s:
            self.next_s = now_s + EVERY_S if self.next_s is None else self.next_s
            return
        self.next_s = now_s + EVERY_S
        rows = {name: np.concatenate(parts) for name, parts in waiting.items()}
        newest = {name: table[table[:, 0] > now_s - LONGEST_S] for name, table in rows.items()}
        rows = {name: table for name, table in newest.items() if len(table)}
        waiting.clear()
        waiting.update({name: [table] for name, table in rows.items()})
        self._compare(rows, part, report)

    def _compare(self, rows: Mapping[str, Array], part: GnssSpeed, report: LossReport) -> None:
        frames = {name: pd.DataFrame(table, columns=list(_COLUMNS[name])) for name, table in rows.items()}
        speeds, gnss, tach = (frames.get(name) for name in _COLUMNS)
        if gnss is None and (tach is None or np.abs(np.diff(tach["distance_m"])).sum() < LEAST_ROLLED_M):
            return
        scale = receiver_speed_scale(speeds, gnss, tach)
        if scale is None:
            return
        findings = receiver_speed_findings(part, scale, self.limits)
        beyond = abs(np.log(scale.scale)) - np.log(self.limits.speed_scale)
        if findings and gnss is not None and beyond < _SIGMAS * scale.sd / scale.scale:
            return
        self.waiting, self.contradicted = None, bool(findings)
        for finding in findings:
            first_s, last_s = rows[GNSS_SPEED_TABLE][[0, -1], 0].tolist()
            reason = f"{finding.message}; its speeds are left out from now on"
            advice, quantities = f"{finding.hint}, and begin anew", ("speed", "chainage", "position")
            report.note(doubt_event(quantities, reason, advice, table=GNSS_SPEED_TABLE, t_s=first_s, until_s=last_s))
