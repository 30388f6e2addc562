"""This module finds out whether a run that is recognised on a map is of its track, or of another one with the same
curves.

Curves are enough to recognise a run by, so that one over track that was tamped is recognised; but the track beside it
has the same curves. The irregularities distinguish them: of one track a difference of two runs is the noise of both, of
two tracks it is larger than the irregularities themselves.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from trackfg.mapping.recognition.profiles import SECTION_M
from trackfg.numerics.arrays import Array
from trackfg.numerics.robust import robust_sd

TELLING = "versine_level_mm"
"""The column that distinguishes tracks: curves and transitions do not show in it."""
_NOISE = 3.0
"""Spread of a difference over its stated sigma from which it is not taken for noise."""
_SHARE_OF_PROFILE = 0.7
"""Spread of a difference over that of the profile itself from which most of the track is another. One track measured
twice has a few hundredths, two tracks 1.4."""
_FEWEST = 200
"""Rows below which nothing is decided: 50 m of them at the usual step of 0.25 m."""


def is_other_track(chainage: Array, difference: Array, sigma: Array, profile: Array, used: pd.DataFrame) -> bool:
    """Return whether a run differs from a map by as much as the map's own irregularities, and by more than noise.

    ``difference``, run less map, its stated ``sigma`` and the map's ``profile`` are those of :data:`TELLING` at places
    ``chainage`` on the map, (n,). Only places in the sections ``used`` count: elsewhere the run may lie beside its
    place (:attr:`trackfg.mapping.recognition.recognition.Recognition.used`).
    """
    middle = np.sort(used["reference_m"].to_numpy())
    if not middle.size:
        return False
    nearest = middle[np.clip(np.searchsorted(0.5 * (middle[1:] + middle[:-1]), chainage), 0, middle.size - 1)]
    known = np.isfinite(difference) & (sigma > 0.0) & np.isfinite(profile)
    known &= np.abs(chainage - nearest) <= 0.5 * SECTION_M
    if known.sum() < _FEWEST:
        return False
    size, profile_size = robust_sd(difference[known]), robust_sd(profile[known])
    return robust_sd(difference[known] / sigma[known]) > _NOISE and size > _SHARE_OF_PROFILE * profile_size


def other_track_message(run: str, name: str) -> str:
    """Return the message about such a run on the map ``name``, with a hint."""
    what = f"run {run}: its curves are those of the map {name!r}, but its irregularities are not"
    why = "it is of another track, or all of it was worked on"
    return f"{what}: {why}. Hint: keep a map for each track, and begin a new one after such work"
