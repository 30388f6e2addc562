"""A run that may be anywhere on a reference, followed section by section as it goes on.

The forward half of :mod:`trackfg.mapping.recognition.recognition`, with the same likelihoods and the same chain: what
is kept is the probability of every place after the last section, so that a further one costs the same however far the
run has come. A stretch that was passed before is no further evidence: what looked alike by chance does so again.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from trackfg.mapping.recognition.likelihood import PLACE_M, scores_of
from trackfg.mapping.recognition.place_hmm import PlaceChain, State, Windows
from trackfg.mapping.recognition.profiles import FEATURES, Profile, profile_of
from trackfg.numerics.arrays import Array
from trackfg.numerics.blas_threads import one_thread

_NEAR_PLACES = 10
"""20 m."""


@dataclass(frozen=True)
class Whereabouts:
    """The most probable place of the last section: its middle in the run's chainage and on the reference, and the
    probability that it is within 20 m of there.
    """

    run_m: float
    reference_m: float
    probability: float


@dataclass
class Follower:
    """``rate_sd`` is the prior sigma of the scale error of the run's chainage, ``section_m`` as in
    :func:`~trackfg.mapping.recognition.recognition.recognise`.

    ``seen`` are the ends of the stretch that was used, m of the run's chainage; ``least`` what the reference left of
    its sections' short waves, (features,) each.
    """

    rate_sd: float
    section_m: int = 100
    state: State | None = None
    begin_m: int = 0
    seen: tuple[int, int] | None = None
    least: list[Array] = field(default_factory=list)

    def take(self, run: pd.DataFrame, begin_m: int, reference: Profile) -> Whereabouts | None:
        """Go on by the section that begins at ``begin_m``, the next in order of travel; None where it was seen before.

        ``run`` has it, and some of the run about it, with columns as in
        :func:`~trackfg.mapping.recognition.recognition.recognise`; ``reference`` is always the same
        (:func:`reference_of`).
        """
        if self.seen is not None and self.seen[0] <= begin_m <= self.seen[1]:
            return None
        ours = profile_of(run, [name for name in reference.features if name in run], "run")
        with one_thread():
            return self._taken(ours, begin_m, reference)

    def _taken(self, run: Profile, begin_m: int, reference: Profile) -> Whereabouts:
        length, before = self.section_m, self.begin_m if self.state is not None else begin_m
        follows = abs(begin_m - before) == length  # what comes next of any track depends on what was before
        cells = np.array([before, begin_m] if follows else [begin_m])
        scores = scores_of(run, reference, cells, length, self.rate_sd)
        first, stop = scores.places(length)
        self.least.append(scores.least_residuals(len(cells) - 1, first, stop))
        short, curves = scores.with_noise(np.array(self.least)).everywhere(first, stop, len(cells) - 1)
        two = np.ones(2, dtype=np.int64)
        windows = Windows(first * two, (stop - first) * two, np.array([before, begin_m], dtype=np.float64))
        chain = PlaceChain(windows, [short[0]] * 2, [curves[0]] * 2, self.rate_sd)
        self.state = chain.filtered(0 if self.state is None else 1, self.state)
        low, high = (begin_m, begin_m) if self.seen is None else self.seen
        self.begin_m, self.seen = begin_m, (min(low, begin_m), max(high, begin_m))
        return self._whereabouts(self.state)

    def _whereabouts(self, state: State) -> Whereabouts:
        place = state.places().astype(np.float64)
        padded = np.pad(place, _NEAR_PLACES)
        near = np.lib.stride_tricks.sliding_window_view(padded, 2 * _NEAR_PLACES + 1).sum(axis=1)
        at = int(np.argmax(near))
        part = padded[at : at + 2 * _NEAR_PLACES + 1]
        mean = float(part @ np.arange(-_NEAR_PLACES, _NEAR_PLACES + 1)) / max(float(part.sum()), 1e-300)
        begin = (state.first + at + mean) * PLACE_M + 0.5 * (PLACE_M - 1)
        half = 0.5 * self.section_m
        return Whereabouts(self.begin_m + half, begin + half, float(near[at]))


def reference_of(grid: pd.DataFrame) -> Profile:
    """What a run is compared with: all features that are known anywhere. Cost is linear in the grid's length."""
    return profile_of(grid, [name for name in FEATURES if name in grid and grid[name].notna().any()], "reference")
