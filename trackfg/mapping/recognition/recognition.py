"""Recognition of a run on a reference: the map's grid, or another run's geometry table.

:func:`recognise` cuts the run into sections and takes the steps that the package describes: profiles, the likelihood of
each place (:mod:`trackfg.mapping.recognition.likelihood`), the probability of each place given all sections
(:mod:`trackfg.mapping.recognition.place_hmm`), the exact place about the most probable one
(:mod:`trackfg.mapping.recognition.fine_match`), and the decision which sections are certain enough to be used.

Both tables face increasing chainage. A run's chainage may be wrong by an offset, a scale, creep and slips; the
reference is taken as it is, and the result is where the run was in the reference's chainage.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from trackfg.errors import BadInputError
from trackfg.mapping.recognition.fine_match import Sections, match_sections
from trackfg.mapping.recognition.likelihood import PLACE_M, LogLikelihoods, log_likelihoods_of
from trackfg.mapping.recognition.place_hmm import NEAR, PlaceHmm, PlacePosterior, PlaceWindows
from trackfg.mapping.recognition.profiles import (
    KINDS,
    LONG_M,
    SECTION_M,
    FeatureProfile,
    common_features,
    common_step,
    profile_of,
)
from trackfg.mapping.recognition.warp import Warp
from trackfg.numerics.arrays import Array
from trackfg.numerics.blas_threads import one_thread
from trackfg.numerics.key_figures import Outlined

COLUMNS = (
    "run_m",
    "reference_m",
    "match_sd_m",
    "probability",
    "probability_so_far",
    "cross_level_bias_mm",
    "cross_level_bias_mm_sd",
    "used",
)

SURE = 0.99
"""Probability above which a section's place is used. A wrong one is an outlier to the loss of its landmark factor."""
_GREATEST_SD_M = 5.0
"""Greatest sigma of a match that is used, m: a quarter of what counts as the same place."""
_SIGMAS = 3.0
"""A section lies at its place if it is within so many sigmas of the match."""
_LOCATED_M = 20.0
"""Distance within which a section without a match counts as being at its place, m."""
_WINDOW_SIGMAS = 4.0
"""Prior sigmas within which a place is sought: one normal value in 16,000 is beyond."""
_WINDOW_M = 10.0
"""Distance, m, that is added to this: five places of the search."""
_ON_KNOWN_LINE = 0.95
"""Prior probability that a run whose place is known is on the reference. Chosen; see Assumptions in docs/engine.md."""
_LOST_BELOW = 0.5
"""Probability of a place below which it counts as lost again."""
_LEAST_MEASURED = 0.5
"""Least share of the first and of the last section that the run measured."""


@dataclass(frozen=True, repr=False)
class Recognition(Outlined):
    """The places of a run's sections on a reference.

    ``sections`` has one row each, ascending ``run_m``, with the columns :data:`COLUMNS`:

    * ``run_m``, ``reference_m``: the section's middle in the run's chainage and on the reference;
    * ``match_sd_m``: sigma of this match by itself (noise of both profiles and creep within the section, not the prior;
      NaN where there is nothing to match);
    * ``probability``: that the middle is within three of these sigmas and 3 m (a place of 2 m and half of one for
      rounding) of ``reference_m``, or within 21 m where nothing could be matched, given all sections;
    * ``probability_so_far``: that it is within 20 m of there, given this section and those before it in order of
      travel;
    * ``cross_level_bias_mm``: mean of run minus reference over the section;
    * ``used``: a probability above :data:`SURE` and a match better than 5 m.

    ``probability``, of the whole run, is the greatest of the column's. ``found_after_m``: distance
    travelled from the first section until its place was known with :data:`SURE` and stayed known; NaN if never.

    Examples
    --------
    >>> import trackfg
    >>> from trackfg.mapping import recognise
    >>> from trackfg.maps import read_map
    >>> run, line = trackfg.Result.read("out1"), read_map("line.gpkg")  # which was made of this run
    >>> sections = recognise(run.geometry, line.grid, place_sd_m=None, rate_sd=1e-3, direction=1).sections
    >>> bool(((sections["reference_m"] - sections["run_m"]).abs() < 0.1).all())
    True
    """

    sections: pd.DataFrame
    probability: float
    found_after_m: float

    @classmethod
    def none(cls) -> Recognition:
        """Return that of a run without sections."""
        columns = {name: np.zeros(0, bool if name == "used" else float) for name in COLUMNS}
        return cls(pd.DataFrame(columns), 0.0, np.nan)

    @property
    def used(self) -> pd.DataFrame:
        """The rows of ``sections`` whose places are used."""
        used: pd.DataFrame = self.sections[self.sections["used"]]
        return used

    @property
    def warp(self) -> Warp | None:
        """The function from the run's chainage to the reference's.

        None where not even two sections are used, or where their places do not ascend: then no one function holds.
        """
        run_m, reference_m = (self.used[name].to_numpy() for name in ("run_m", "reference_m"))
        return Warp(run_m, reference_m) if len(run_m) > 1 and np.all(np.diff(reference_m) > 0.0) else None


def recognise(
    run: pd.DataFrame,
    reference: pd.DataFrame,
    *,
    place_sd_m: Array | None,
    rate_sd: float,
    direction: int,
    section_m: float = SECTION_M,
) -> Recognition:
    """Find a run on a reference.

    Sections begin at whole multiples of ``section_m``, from the first to the last that the run measured at least half.
    Those between are kept however little of them was measured: the model moves on through them. A run that is too short
    gives no sections and probability 0, and so does one that knows nothing of the track, such as one at rest.

    Parameters
    ----------
    run
        A table with ``chainage_m`` ascending on whole multiples of one step, which is a whole part of 1 m (rows may be
        missing, values NaN), and any columns of :data:`~trackfg.mapping.recognition.profiles.KINDS`, with ``_sd`` or
        without.
    reference
        Another such table, which the run is to be found on.
    place_sd_m
        Prior sigma, m, of reference chainage minus run chainage at every row of the run, (n,); None: anywhere.
    rate_sd
        Prior sigma of the scale error of the run's chainage.
    direction
        Order of travel, +1 or -1.
    section_m
        Length of a section, m: a whole multiple of 20.

    Returns
    -------
    Recognition
        Places of the sections, m with sigmas, and the probability that the run is on the reference.

    Raises
    ------
    BadInputError
        For tables on other grids or with no feature in common, for sigmas that are negative, not finite or not one per
        row, and for any other direction or section.

    Examples
    --------
    >>> import trackfg
    >>> from trackfg.mapping import recognise
    >>> track = trackfg.Result.read("out1").geometry
    >>> found = recognise(track, track, place_sd_m=None, rate_sd=1e-3, direction=1)
    >>> found.probability > 0.99
    True
    """
    _check(run, place_sd_m, rate_sd, direction, section_m)
    columns = [name for kind in KINDS for name in kind if name in run]
    if columns and not run[columns].notna().any(axis=None):
        return Recognition.none()
    features = common_features(run, reference)
    step_m = common_step(run, reference)
    of_run = profile_of(run, features, step_m, "run")
    of_reference = profile_of(reference, features, step_m, "reference")
    length = round(section_m)
    first_cells = _first_cells(of_run, length)[::direction]
    if first_cells.size == 0:
        return Recognition.none()
    ratios = log_likelihoods_of(of_run, of_reference, first_cells, length, rate_sd)
    with one_thread():
        if place_sd_m is None:
            model = _model_anywhere(ratios, first_cells, length, rate_sd)
        else:
            chainage, middle = run["chainage_m"].to_numpy(dtype=np.float64), first_cells + 0.5 * length
            sd = np.interp(middle, chainage, np.asarray(place_sd_m, dtype=np.float64))
            model = _model_about(ratios, first_cells, sd, rate_sd)
        posterior = model.posterior()
    return _recognition(of_run, of_reference, first_cells, length, rate_sd, posterior)


def _check(run: pd.DataFrame, place_sd_m: Array | None, rate_sd: float, direction: int, section_m: float) -> None:
    """Raise ``BadInputError`` for arguments of :func:`recognise` that are not as it describes them."""
    if place_sd_m is not None:
        sd = np.asarray(place_sd_m, dtype=np.float64)
        if sd.shape != (len(run),) or not (np.isfinite(sd).all() and np.all(sd >= 0.0)):
            raise BadInputError(f"place_sd_m {sd.shape}: expected {len(run)} sigmas, one for each row of the run")
    if not (np.isfinite(rate_sd) and rate_sd >= 0.0):
        raise BadInputError(f"rate_sd is {rate_sd!r}; expected a sigma")
    if direction not in (1, -1):
        raise BadInputError(f"direction is {direction!r}; expected 1 or -1")
    if not (section_m > 0.0 and float(section_m / LONG_M).is_integer()):
        raise BadInputError(f"section_m is {section_m!r}; expected a whole multiple of {LONG_M} m")


def _first_cells(run: FeatureProfile, length: int) -> NDArray[np.int64]:
    """Return the first cells of the sections, m, from the first to the last that is measured at least half."""
    known = np.any([np.isfinite(values) for values in run.features.values()], axis=0)
    row = np.flatnonzero(known) + run.first
    if row.size == 0:
        return np.zeros(0, dtype=np.int64)
    rows = length * run.rows_per_cell
    number = row // rows
    measured = np.flatnonzero(np.bincount(number - number[0]) >= _LEAST_MEASURED * rows)
    if measured.size == 0:
        return np.zeros(0, dtype=np.int64)
    return np.asarray((number[0] + np.arange(measured[0], measured[-1] + 1)) * length, dtype=np.int64)


def _model_anywhere(ratios: LogLikelihoods, first_cells: NDArray[np.int64], length: int, rate_sd: float) -> PlaceHmm:
    """Return the model of a run that may be anywhere on the reference, or reach over its ends by half a section."""
    begin, stop = ratios.places(length)
    every = np.ones(len(first_cells), dtype=np.int64)
    short, curves = ratios.with_noise_of(begin * every, stop * every).everywhere(begin, stop)
    windows = PlaceWindows(begin * every, (stop - begin) * every, first_cells.astype(np.float64))
    return PlaceHmm(windows, list(short), list(curves), rate_sd)


def _model_about(ratios: LogLikelihoods, first_cells: NDArray[np.int64], sd: Array, rate_sd: float) -> PlaceHmm:
    """Return the model of a run whose places are known to a sigma each (k,): sought within four of them.

    The prior counts once, where the sigma is least: all of them come from the same few fixes.
    """
    reach = _WINDOW_M + np.minimum(_WINDOW_SIGMAS * sd, float(ratios.cells))
    begin = np.floor((first_cells - reach) / PLACE_M).astype(np.int64)
    count = np.ceil((first_cells + reach) / PLACE_M).astype(np.int64) - begin
    ratios = ratios.with_noise_of(begin, begin + count)
    parts = [ratios.at(slice(k, k + 1), int(begin[k]), int(begin[k] + count[k])) for k in range(len(first_cells))]
    short, curves = ([part[i][0] for part in parts] for i in (0, 1))
    best = int(np.argmin(sd))
    away = (begin[best] + np.arange(count[best])) * PLACE_M + 0.5 * (PLACE_M - 1) - first_cells[best]
    prior = -0.5 * away**2 / (sd[best] ** 2 + PLACE_M**2 / 12.0)
    windows = PlaceWindows(begin, count, first_cells.astype(np.float64))
    return PlaceHmm(windows, short, curves, rate_sd, (best, prior - prior.max()), _ON_KNOWN_LINE)


def _recognition(
    run: FeatureProfile,
    reference: FeatureProfile,
    first_cells: NDArray[np.int64],
    length: int,
    rate_sd: float,
    posterior: PlacePosterior,
) -> Recognition:
    """Return the fine matches about the modes of the posterior, and which of them are used."""
    half = 0.5 * length
    middle: Array = first_cells.astype(np.float64) + half
    sections = Sections(
        middle,
        length,
        about_m=posterior.mean_m + half * (1.0 + posterior.scale),
        scale=posterior.scale,
        unchanged=posterior.unchanged > 0.5,
    )
    matches = match_sections(run, reference, sections, rate_sd)
    tolerance = np.where(np.isfinite(matches.sd_m), _SIGMAS * matches.sd_m + PLACE_M, _LOCATED_M)
    # The distance of the section's middle from its match, if the section lay at each of the places near the mode.
    offset = np.arange(-NEAR, NEAR + 1)
    begin_m = (posterior.mode[:, None] + offset) * PLACE_M + 0.5 * (PLACE_M - 1)
    away = np.abs(begin_m + half * (1.0 + posterior.scale[:, None]) - matches.reference_m[:, None])
    probability = np.minimum((posterior.near * (away <= tolerance[:, None] + 0.5 * PLACE_M)).sum(axis=1), 1.0)
    so_far = np.minimum((posterior.so_far * (away <= _LOCATED_M)).sum(axis=1), 1.0)
    table = pd.DataFrame(
        {
            "run_m": middle,
            "reference_m": matches.reference_m,
            "match_sd_m": matches.sd_m,
            "probability": probability,
            "probability_so_far": so_far,
            "cross_level_bias_mm": matches.cross_level_bias_mm,
            "cross_level_bias_mm_sd": matches.cross_level_bias_mm_sd,
            "used": (probability > SURE) & (matches.sd_m < _GREATEST_SD_M),
        }
    )
    ordered = table.sort_values("run_m", ignore_index=True)
    return Recognition(ordered, float(probability.max()), _found_after(so_far, float(length)))


def _found_after(so_far: Array, length: float) -> float:
    """Return the distance to the end of the section from which on the place was known, in order of travel, (k,).

    A run may leave the reference in the end: what follows the last certain section does not count.
    """
    certain = np.flatnonzero(so_far > SURE)
    if certain.size == 0:
        return np.nan
    lost = np.flatnonzero(so_far[: certain[-1]] < _LOST_BELOW)
    start = lost[-1] + 1 if lost.size else 0
    return length * (int(certain[certain >= start][0]) + 1)
