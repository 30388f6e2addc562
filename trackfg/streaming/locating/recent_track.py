"""The recent track is what a stream has passed last in one direction, to be sought on a map."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from trackfg.mapping.recognition.profiles import FEATURES, SECTION_M
from trackfg.numerics.arrays import Array
from trackfg.streaming.tables.smoothed_tables import TrackPiece

LONGEST_M = 2000.0
"""How much track is recognised at a time, m: from fewer sections its noise cannot be estimated."""

_FEATURES = ("chainage_m", *(name for feature in FEATURES for name in (feature, f"{feature}_sd")))
_COLUMNS = (*_FEATURES, "t_s", "beyond_m")


@dataclass
class RecentTrack:
    """Rows (n, c) of geometry in order of passing, by the run's chainage; ``sense`` of travel by that, 1 or -1."""

    rows: Array = field(default_factory=lambda: np.zeros((0, len(_COLUMNS))))
    sense: int = 1

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def place(self) -> Array:
        """Chainages in order of passing, m, shape (n,)."""
        return np.asarray(self.rows[:, 0])

    @property
    def passed_s(self) -> Array:
        """The times when the places were passed, s, shape (n,)."""
        return np.asarray(self.rows[:, _COLUMNS.index("t_s")])

    def append(self, piece: TrackPiece) -> None:
        """Append the next piece; where the vehicle has turned back, earlier rows are dropped."""
        if not len(piece.table):
            return
        new = np.column_stack([piece.table[list(_FEATURES)].to_numpy(), piece.t, piece.beyond])
        place = new[:, 0]
        senses = np.sign(np.diff(place))
        turns = np.flatnonzero(np.diff(senses))
        sense = int(senses[-1]) if senses.size else self.sense
        kept = self.rows
        if turns.size or sense != self.sense:
            kept, new = kept[:0], new[turns[-1] + 1 if turns.size else 0 :]
        self.sense = sense
        kept = kept[sense * (kept[:, 0] - new[0, 0]) < 0.0]
        kept = kept[sense * (place[-1] - kept[:, 0]) < LONGEST_M]
        self.rows = np.concatenate([kept, new])

    def move(self, by_m: float) -> None:
        """Shift all chainages by ``by_m``."""
        self.rows[:, 0] += by_m

    def ascending(self) -> pd.DataFrame:
        """Return the table by ascending chainage."""
        return pd.DataFrame(self.rows[:: self.sense], columns=list(_COLUMNS))

    def sections(self) -> list[int]:
        """Return where the complete sections begin, m, in order of travel; the first one may be half a section."""
        if not len(self):
            return []
        first, last = self.place[0], self.place[-1]
        half = 0.5 * SECTION_M
        low, high = (first - half, last) if self.sense > 0 else (last, first + half)
        begins = np.arange(np.ceil(low / SECTION_M), np.floor(high / SECTION_M), dtype=np.int64) * SECTION_M
        return [int(begin) for begin in begins[:: self.sense]]

    def passed_at(self, place: Array) -> tuple[Array, Array]:
        """Return when the vehicle was at places (m,), s, and by how much the distance exceeded the straight line, m."""
        table = self.ascending()
        t, beyond = (np.interp(place, table["chainage_m"], table[name]) for name in ("t_s", "beyond_m"))
        return t, beyond
