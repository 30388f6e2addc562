"""Score reported slips and slides against the true ones.

A reported event and a true one *match* if they are of one kind and the time they share is at least half of the shorter
one. A slip may be reported in pieces, and slips that follow each other closely as one: each piece, each slip has its
match then. Of the true ones all can be matched, but only those of some size are asked for:

* recall: the share of true slips *of the asked size* that have a match;
* precision: the share of reported events that match a true slip *of any size*: a small one that is found is no mistake.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from trackfg.numerics.arrays import Array

KINDS = ("slip", "slide")
SHARED_PART = 0.5
"""Of the shorter of two events: what they must have in common to match."""


@dataclass(frozen=True)
class SlipScore:
    """``found`` and ``missed``: the true slips of the asked size, ``found`` with ``start_error_s`` and ``end_error_s``
    of the first and last event that match (reported less true). ``false``: the events that match nothing, of ``events``
    reported ones. ``distances``: a row per group of slips and events that match each other, with the true distance
    error ``true_m``, ``removed_m`` and its sigma ``removed_m_sd``.
    """

    found: pd.DataFrame
    missed: pd.DataFrame
    false: pd.DataFrame
    distances: pd.DataFrame
    events: int

    @property
    def recall(self) -> float:
        """Return the recall; NaN where nothing was to be found."""
        asked = len(self.found) + len(self.missed)
        return len(self.found) / asked if asked else np.nan

    @property
    def precision(self) -> float:
        """Return the precision; NaN where nothing was reported."""
        return 1.0 - len(self.false) / self.events if self.events else np.nan


def score_slips(
    events: pd.DataFrame,
    true_slips: pd.DataFrame,
    truth: pd.DataFrame,
    *,
    creep: float = 0.03,
    duration_s: float = 1.0,
) -> SlipScore:
    """Score the slips and slides among ``events`` (:data:`trackfg.results.columns.EVENT_COLUMNS`).

    ``true_slips`` has ``start_s, end_s, kind, distance_error_m, peak_creep``. Asked for are those with a peak creep of
    at least ``creep`` either way that last ``duration_s`` or longer before the end of ``truth``, a trajectory.
    """
    last = float(truth["t_s"].iloc[-1])
    slips = true_slips.assign(end_s=true_slips["end_s"].astype(float).clip(upper=last)).reset_index(drop=True)
    reported = events[events["kind"].isin(KINDS)].reset_index(drop=True)
    match = _matches(slips, reported)
    lasting = slips["end_s"] - slips["start_s"] >= duration_s
    asked = (lasting & (slips["peak_creep"].astype(float).abs() >= creep)).to_numpy(dtype=bool)
    seen = match.any(axis=1)
    hits, pieces = slips[asked & seen], match[asked & seen]
    nothing = np.flatnonzero(~match.any(axis=0))
    start, end = (reported[name].to_numpy(dtype=float) for name in ("start_s", "end_s"))
    first_start = np.where(pieces, start, np.inf).min(axis=1, initial=np.inf)
    over = np.where(pieces, end, -np.inf).max(axis=1, initial=-np.inf)
    return SlipScore(
        found=hits.assign(start_error_s=first_start - hits["start_s"], end_error_s=over - hits["end_s"]),
        missed=slips[asked & ~seen],
        false=reported.iloc[nothing],
        distances=_distances(slips, reported, match),
        events=len(reported),
    )


def together(scores: Sequence[SlipScore]) -> SlipScore:
    """Return the score of many runs as of one: every slip and every event has one weight."""
    tables = {
        name: pd.concat([getattr(score, name) for score in scores], ignore_index=True)
        for name in ("found", "missed", "false", "distances")
    }
    return SlipScore(**tables, events=sum(score.events for score in scores))


def _matches(slips: pd.DataFrame, reported: pd.DataFrame) -> np.ndarray:
    """Return which true slip (rows) matches which event (columns), of bool."""
    (a, b), (c, d) = (
        (table["start_s"].to_numpy(dtype=float), table["end_s"].to_numpy(dtype=float)) for table in (slips, reported)
    )
    common = np.minimum(b[:, None], d) - np.maximum(a[:, None], c)
    shorter = np.minimum((b - a)[:, None], d - c)
    alike = slips["kind"].to_numpy()[:, None] == reported["kind"].to_numpy()
    match: np.ndarray = alike & (common > 0.0) & (common >= SHARED_PART * shorter)
    return match


def _distances(slips: pd.DataFrame, reported: pd.DataFrame, match: np.ndarray) -> pd.DataFrame:
    """Return true and removed distance of each group."""
    n = len(slips)
    row, column = np.nonzero(match)
    graph = coo_array((np.ones(row.size), (row, n + column)), shape=(n + len(reported),) * 2)
    label = connected_components(graph, directed=False)[1]
    groups = np.unique(label[row])

    def total(values: pd.Series, labels: np.ndarray) -> Array:
        return np.array([values.to_numpy(dtype=float)[labels == group].sum() for group in groups])

    return pd.DataFrame(
        {
            "true_m": total(slips["distance_error_m"], label[:n]),
            "removed_m": total(reported["distance_removed_m"], label[n:]),
            "removed_m_sd": np.sqrt(total(reported["distance_removed_m_sd"] ** 2, label[n:])),
        }
    )
