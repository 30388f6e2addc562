"""The last of the track that a stream has passed in one direction, for who looks for it on a map."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from trackfg.mapping.recognition.profiles import FEATURES, SECTION_M
from trackfg.numerics.arrays import Array
from trackfg.streaming.tables.smoothed_tables import Sight

LONGEST_M = 2000.0
"""So much is recognised at a time: fewer sections would not tell the noise."""

_FEATURES = ("chainage_m", *(name for feature in FEATURES for name in (feature, f"{feature}_sd")))
_COLUMNS = (*_FEATURES, "t_s", "beyond_m")


@dataclass
class SeenTrack:
    """``rows`` (n, c) in order of passing, by the run's chainage; ``sense`` of travel by that, 1 or -1."""

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
        """When the places were passed, s, shape (n,)."""
        return np.asarray(self.rows[:, _COLUMNS.index("t_s")])

    def append(self, sight: Sight) -> None:
        """What was passed since; where the vehicle has turned back, what came before is dropped."""
        if not len(sight.table):
            return
        new = np.column_stack([sight.table[list(_FEATURES)].to_numpy(), sight.t, sight.beyond])
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
        """All chainages are ``by_m`` greater than they were said to be."""
        self.rows[:, 0] += by_m

    def ascending(self) -> pd.DataFrame:
        """The table by ascending chainage."""
        return pd.DataFrame(self.rows[:: self.sense], columns=list(_COLUMNS))

    def sections(self) -> list[int]:
        """Where the complete sections of the run begin, m, in order of travel; the first one may be half a section."""
        if not len(self):
            return []
        first, last = self.place[0], self.place[-1]
        half = 0.5 * SECTION_M
        low, high = (first - half, last) if self.sense > 0 else (last, first + half)
        begins = np.arange(np.ceil(low / SECTION_M), np.floor(high / SECTION_M), dtype=np.int64) * SECTION_M
        return [int(begin) for begin in begins[:: self.sense]]

    def passed_at(self, place: Array) -> tuple[Array, Array]:
        """When the vehicle was at places (m,), s, and by how much the distance then was beyond the straight line."""
        table = self.ascending()
        t, beyond = (np.interp(place, table["chainage_m"], table[name]) for name in ("t_s", "beyond_m"))
        return t, beyond
