"""Tracking of a run that may be anywhere on a reference, section by section while it goes on.

This is the forward filter of :mod:`trackfg.mapping.recognition.place_hmm` with the likelihoods of
:mod:`trackfg.mapping.recognition.likelihood`. What is kept is the probability of every place after the last section, so
a further section costs the same however far the run has come. A stretch that was passed before is no further evidence:
what looked alike by chance does so again.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from trackfg.mapping.recognition.likelihood import PLACE_M, log_likelihoods_of
from trackfg.mapping.recognition.place_hmm import Message, PlaceHmm, PlaceWindows
from trackfg.mapping.recognition.profiles import FEATURES, SECTION_M, FeatureProfile, common_step, profile_of
from trackfg.numerics.arrays import Array
from trackfg.numerics.blas_threads import one_thread

_NEAR_PLACES = 10
"""Places to either side that count as the same place: 20 m. With the middle one they are 21 places, 42 m."""


@dataclass(frozen=True)
class TrackedPlace:
    """The most probable place of the last section.

    ``run_m``, ``reference_m``: its middle in the run's chainage and on the reference, the mean over those 42 m of
    places that hold the greatest probability. ``probability``: of these.
    """

    run_m: float
    reference_m: float
    probability: float


@dataclass
class PlaceTracker:
    """A forward filter over the places of a reference.

    ``rate_sd``: prior sigma of the scale error of the run's chainage. ``section_m``: as in
    :func:`~trackfg.mapping.recognition.recognition.recognise`. ``state``: the forward message of the section that
    begins at ``begin_m``. ``seen``: the ends of the stretch that was used, m of the run's chainage. ``least``: what the
    reference left of the sections' short waves, (features,) each.
    """

    rate_sd: float
    section_m: int = SECTION_M
    state: Message | None = None
    begin_m: int = 0
    seen: tuple[int, int] | None = None
    least: list[Array] = field(default_factory=list)

    def take(self, run: pd.DataFrame, begin_m: int, reference: FeatureProfile) -> TrackedPlace | None:
        """Go on by the next section in order of travel, at ``begin_m``; return None if it was seen before.

        ``run`` has it, and some of the run about it, with columns as in
        :func:`~trackfg.mapping.recognition.recognition.recognise`; ``reference`` is always the same
        (:func:`reference_of`).
        """
        if self.seen is not None and self.seen[0] <= begin_m <= self.seen[1]:
            return None
        profile = profile_of(run, [name for name in reference.features if name in run], reference.step_m, "run")
        with one_thread():
            self._update(profile, begin_m, reference)
            return self._place()

    def _update(self, run: FeatureProfile, begin_m: int, reference: FeatureProfile) -> None:
        """Take the forward step to the section that begins at ``begin_m``."""
        length, previous_m = self.section_m, self.begin_m if self.state is not None else begin_m
        adjacent = abs(begin_m - previous_m) == length  # the density of curves on any track depends on the last ones
        cells = np.array([previous_m, begin_m] if adjacent else [begin_m])
        ratios = log_likelihoods_of(run, reference, cells, length, self.rate_sd)
        first, stop = ratios.places(length)
        self.least.append(ratios.least_residuals(len(cells) - 1, first, stop))
        short, curves = ratios.with_noise(np.array(self.least)).everywhere(first, stop, len(cells) - 1)
        # The model has the previous section and this one; only this one's likelihood is read, so it stands for both.
        two = np.ones(2, dtype=np.int64)
        windows = PlaceWindows(first * two, (stop - first) * two, np.array([previous_m, begin_m], dtype=np.float64))
        model = PlaceHmm(windows, [short[0]] * 2, [curves[0]] * 2, self.rate_sd)
        self.state = model.filtered(0 if self.state is None else 1, self.state)
        low, high = (begin_m, begin_m) if self.seen is None else self.seen
        self.begin_m, self.seen = begin_m, (min(low, begin_m), max(high, begin_m))

    def _place(self) -> TrackedPlace:
        """Return the mean place of the 42 m that hold the greatest probability."""
        state = self.state
        assert state is not None
        place = state.places().astype(np.float64)
        padded = np.pad(place, _NEAR_PLACES)
        near = np.lib.stride_tricks.sliding_window_view(padded, 2 * _NEAR_PLACES + 1).sum(axis=1)
        at = int(np.argmax(near))
        part = padded[at : at + 2 * _NEAR_PLACES + 1]
        mean = float(part @ np.arange(-_NEAR_PLACES, _NEAR_PLACES + 1)) / max(float(part.sum()), 1e-300)
        begin = (state.first + at + mean) * PLACE_M + 0.5 * (PLACE_M - 1)
        half = 0.5 * self.section_m
        return TrackedPlace(self.begin_m + half, begin + half, float(near[at]))


def reference_of(grid: pd.DataFrame) -> FeatureProfile:
    """Return the profile of a grid with all features that it knows anywhere, in time linear in its length."""
    names = [name for name in FEATURES if name in grid and grid[name].notna().any()]
    return profile_of(grid, names, common_step(grid, grid), "reference")
