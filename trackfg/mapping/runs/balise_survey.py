"""Balises are surveyed by one run or many: where each is, whether its plan is right, and which passages were misread.

Each balise b has a place L_b and each run r an offset o_r. What runs measured of their passages i
(:mod:`trackfg.results.balise_passages`), and the plans, are

    y_i = L_b + o_r + e,   e ~ N(0, C_r + reading_sd^2),        z_b = L_b + e,   e ~ N(0, planned_sd^2):

the graph of all states of all runs, condensed to its landmarks. A fix without an id is passed once and has a plan, so
that its place drops out of the difference ``y_i - z_i = o_r + e``. Together ``l = A x + e`` with covariance S. That one
thing is wrong is a hypothesis, which adds a column a with a free factor to A:

* the plan of a balise is wrong, a fix is, or a passage was misread: a is 1 in its row;
* the wheel of a run erred unnoticed between two passages: a is 1 in the rows behind, of that run.

With the residuals' projector P of the whitened A, and l, a whitened, the size of the error is ``a'Pl / a'Pa``, its
variance ``1 / a'Pa``, and the one over the root of the other what it explains (Baarda, "A testing procedure for use in
geodetic networks", 1968). The greatest goes into A until none is beyond the gate. For a plan this size is how far all
measurements but itself place the balise from it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.linalg import block_diag, cholesky, solve_triangular
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from trackfg.errors import BadInputError
from trackfg.numerics.arrays import Array
from trackfg.numerics.key_figures import Outlined
from trackfg.results.balise_passages import BalisePassages
from trackfg.results.columns import BALISE_COLUMNS
from trackfg.results.result import Result

GATE_SIGMAS = 4.0
"""A plan, a passage or a wheel that is off by more is wrong: 6e-5 of right ones are off by as much."""

_STAYS_SIGMAS = 3.0
"""An error that is in A and, beside those found later, smaller than this goes out again."""

_LEAST_FREE = 1e-6
"""Least share of a measurement's own variance that is left in its residual: below it nothing else says what it says,
and the rest is rounding."""

_AS_LIKELY = 2.0 * np.log(10.0)
"""Difference of the squares of what two hypotheses explain below which neither is ten times as likely as the other."""

_SAME = 1e-6
"""Relative difference of what two hypotheses explain that is rounding: a plan and the only passage of its balise."""

_SAME_PLAN_M = 1e-6
"""Runs have the same plan of a balise if it differs by less, m: rounding of files."""

_OF_PLACES = ("plan", "fix")
"""Errors of where something is, not of what was read there."""

MISREAD_COLUMNS = ("run", "t_s", "id", "off_m", "off_m_sd")
SLIP_COLUMNS = ("run", "from_s", "to_s", "off_m", "off_m_sd")


@dataclass(frozen=True, repr=False)
class BaliseSurvey(Outlined):
    """A survey's ``table`` has the columns :data:`~trackfg.results.columns.BALISE_COLUMNS`, in order of the places.

    ``misread``: passages that contradict the others and were left out, columns :data:`MISREAD_COLUMNS`. ``slips``:
    where a wheel erred unnoticed, columns :data:`SLIP_COLUMNS`.
    """

    table: pd.DataFrame
    misread: pd.DataFrame
    slips: pd.DataFrame


class _Error(NamedTuple):
    """A hypothesis: an error of ``kind`` "plan", "fix", "passage" or "wheel" in a ``row`` of the measurements.

    The row of a wheel's error is the first passage behind it.
    """

    kind: str
    row: int


@dataclass(frozen=True)
class _Network:
    """The measurements are passages, columns ``run, t_s, id, balise`` (number, -1 of a fix without an id), then plans.

    ``measured`` l (m,) and ``A`` (m, n), whitened by the inverse of the root of their covariance, ``whitening``
    (m, m). The first columns of A are the places of ``names``; ``plan_of`` (p,) are the numbers of balises with plans.
    """

    passages: pd.DataFrame
    names: list[str]
    plan_of: np.ndarray
    whitening: Array
    measured: Array
    A: Array
    anchored: np.ndarray
    """Which balises are tied to a plan, by whatever runs, shape (b,)."""

    def possible_errors(self) -> tuple[list[_Error], Array]:
        """Return all hypotheses, those first that are named where two explain the same, and their whitened columns."""
        run, m = self.passages["run"].to_numpy(), len(self.passages)
        behind = np.flatnonzero(run[1:] == run[:-1]) + 1
        has_id = self.passages["balise"].to_numpy() >= 0
        fixes, passages = np.flatnonzero(~has_id), np.flatnonzero(has_id)
        rows = {"plan": np.arange(m, len(self.measured)), "fix": fixes, "passage": passages, "wheel": behind}
        later = np.empty((len(self.measured), m))
        for run_number in np.unique(run):
            of_run = np.flatnonzero(run == run_number)
            later[:, of_run] = np.cumsum(self.whitening[:, of_run[::-1]], axis=1)[:, ::-1]
        alone = [self.whitening[:, rows[kind]] for kind in ("plan", "fix", "passage")]
        columns = np.hstack([*alone, later[:, behind]])
        return [_Error(kind, int(row)) for kind, some in rows.items() for row in some], columns


@dataclass(frozen=True)
class _Estimate:
    """The solution ``x`` with ``errors`` in A: places, offsets, their sizes; ``basis`` (m, n) spans A, orthonormal."""

    errors: tuple[_Error, ...]
    x: Array
    covariance: Array
    basis: Array

    @property
    def sizes(self) -> tuple[Array, Array]:
        """The sizes of the errors in A, m, and their sigmas, each (e,)."""
        first = len(self.x) - len(self.errors)
        return self.x[first:], np.sqrt(np.diag(self.covariance)[first:])

    def residual(self, columns: Array) -> Array:
        """Return the part of columns (m, c), or of one (m,), that A does not explain."""
        return np.asarray(columns - self.basis @ (self.basis.T @ columns))


def surveyed_by_results(
    results: Sequence[Result], names: Sequence[str], planned: pd.DataFrame | None = None
) -> BaliseSurvey:
    """Survey the balises of smoothed runs as :func:`surveyed` does.

    Raises :class:`BadInputError` too for a result without passages of balises, and for a run that is there twice.
    """
    name_of: dict[str, str] = {}
    for result, name in zip(results, names, strict=True):
        if not len(result.passages):
            raise BadInputError(
                f"{name}: has no passages of balises: expected the result of a recording with [balises], whose "
                "chainage is to be trusted. Hint: smooth the recording again if it has them"
            )
        content = name if result.summary.run is None else result.summary.run.content_sha256
        if content in name_of:
            raise BadInputError(f"{name}: is the same run as {name_of[content]}: expected each run once")
        name_of[content] = name
    return surveyed([result.passages for result in results], names, planned)


def surveyed(runs: Sequence[BalisePassages], names: Sequence[str], planned: pd.DataFrame | None = None) -> BaliseSurvey:
    """Survey the balises that runs passed.

    ``planned`` holds instead of the runs' own plans, columns ``id, chainage_m, chainage_sd_m``, NaN where not known;
    those of its balises that no run passed are in the table too. Raises :class:`BadInputError` where the runs' own
    plans of a balise differ, and where no run passed any.
    """
    passages = _passages(runs, names)
    plans = _plans(passages, names) if planned is None else planned.set_index("id").rename_axis("name")
    network = _network(runs, passages, plans)
    possible, columns = network.possible_errors()
    estimate, undecided = _estimated(network, possible, columns)
    table = _table(network, plans, estimate, _tested(network, columns, estimate), undecided)
    return BaliseSurvey(table, *_left_out(network, names, estimate))


def _passages(runs: Sequence[BalisePassages], names: Sequence[str]) -> pd.DataFrame:
    """Return the passages of all runs."""
    tables = [run.table.assign(run=number) for number, run in enumerate(runs) if len(run)]
    if not tables:
        raise BadInputError(f"{', '.join(names)}: no balise with an id was passed: expected [balises] in the recording")
    return pd.concat(tables, ignore_index=True)


def _plans(passages: pd.DataFrame, names: Sequence[str]) -> pd.DataFrame:
    """Return the runs' own plans, by name. Raises :class:`BadInputError` where they differ."""
    named = passages[passages["id"] != ""].rename(columns={"id": "name"})
    stated = named[["name", "run"]].assign(chainage_m=named["planned_m"], chainage_sd_m=named["planned_m_sd"])
    by_name = stated.groupby("name", sort=False)[["chainage_m", "chainage_sd_m"]]
    apart = (by_name.transform("max") - by_name.transform("min")).max(axis=1)
    if (apart > _SAME_PLAN_M).any():
        name = stated["name"].iloc[int(apart.to_numpy().argmax())]
        some = stated[stated["name"] == name].drop_duplicates("chainage_m")[["run", "chainage_m", "chainage_sd_m"]]
        places = ", ".join(
            f"{x:.10g} m (sigma {sd:.3g} m) in {names[int(run)]}" for run, x, sd in some.to_numpy().tolist()
        )
        raise BadInputError(
            f"balise {name!r} is planned at {places}. Hint: give the places that hold for all runs as --planned FILE"
        )
    return by_name.first()


def _network(runs: Sequence[BalisePassages], passages: pd.DataFrame, plans: pd.DataFrame) -> _Network:
    number, names = pd.factorize(passages["id"].mask(passages["id"] == ""))
    is_fix, run = number < 0, passages["run"].to_numpy()
    plans = plans.reindex(names)
    known = plans.notna().all(axis=1).to_numpy()
    plan_of = np.flatnonzero(known)
    m, b, r = len(passages), len(names), int(run.max()) + 1
    A = np.zeros((m + len(plan_of), b + r))
    A[np.flatnonzero(~is_fix), number[~is_fix]] = 1.0
    A[np.arange(m), b + run] = 1.0
    A[m + np.arange(len(plan_of)), plan_of] = 1.0
    tied = coo_array((np.ones(int((~is_fix).sum())), (number[~is_fix], b + run[~is_fix])), shape=(b + r,) * 2)
    _, part = connected_components(tied, directed=False)
    anchored = np.isin(part, part[np.append(plan_of, b + np.unique(run[is_fix]))])
    # Where no plan says where a line begins, its first run does; a run without passages has no offset.
    _, first, of_part = np.unique(part[b:], return_index=True, return_inverse=True)
    is_origin = ~anchored[b:] & (first[of_part] == np.arange(r))
    free = np.append(np.ones(b, dtype=bool), np.isin(np.arange(r), run) & ~is_origin)
    covariances = [run.covariance + np.diag(_own_variance(run.table)) for run in runs if len(run)]
    roots = [solve_triangular(cholesky(S, lower=True), np.eye(len(S)), lower=True) for S in covariances]
    whitening = block_diag(*roots, np.diag(1.0 / plans["chainage_sd_m"].to_numpy()[plan_of]))
    passage_m = passages["chainage_m"].to_numpy() - np.where(is_fix, passages["planned_m"].to_numpy(), 0.0)
    measured = np.concatenate([passage_m, plans["chainage_m"].to_numpy()[plan_of]])
    return _Network(
        passages.assign(balise=number),
        list(names),
        plan_of,
        whitening,
        whitening @ measured,
        whitening @ A[:, free],
        anchored[:b],
    )


def _own_variance(table: pd.DataFrame) -> Array:
    """Return what passages (m,) add to the covariance of the run, m^2: of reading, and of the place of a fix."""
    planned = table["planned_m_sd"].where(table["id"] == "", 0.0)
    return np.asarray(table["reading_m_sd"].to_numpy() ** 2 + planned.to_numpy() ** 2)


def _estimated(network: _Network, possible: list[_Error], columns: Array) -> tuple[_Estimate, set[_Error]]:
    """Return the solution with all errors that there are in it, and plans that may be wrong as well as the named."""
    kept: list[int] = []
    removed: set[int] = set()
    undecided: set[_Error] = set()
    while True:
        estimate = _solution(network, [possible[i] for i in kept], columns[:, kept])
        size, sd = estimate.sizes
        in_sigmas = np.abs(size) / sd
        if in_sigmas.min(initial=np.inf) < _STAYS_SIGMAS:
            removed.add(kept.pop(int(np.argmin(in_sigmas))))
            continue
        explained = np.abs(_explained(network, estimate, columns)[0])
        explained[[*kept, *removed]] = 0.0
        greatest = float(explained.max(initial=0.0))
        if greatest < GATE_SIGMAS:
            return estimate, undecided
        kept.append(int(np.argmax(explained > greatest * (1.0 - _SAME))))
        rivals = np.flatnonzero(explained**2 > greatest**2 - _AS_LIKELY)
        plans = {possible[i] for i in rivals if possible[i].kind in _OF_PLACES}
        if possible[kept[-1]].kind in _OF_PLACES and len(plans) > 1:
            undecided |= plans


def _solution(network: _Network, errors: list[_Error], columns: Array) -> _Estimate:
    basis, R = np.linalg.qr(np.hstack([network.A, columns]))
    inverse = solve_triangular(R, np.eye(len(R)))
    return _Estimate(tuple(errors), inverse @ (basis.T @ network.measured), inverse @ inverse.T, basis)


def _explained(network: _Network, estimate: _Estimate, columns: Array) -> tuple[Array, Array]:
    """Return the size of each error (c,) in sigmas and its sigma, m; 0 and NaN where nothing else is measured of it."""
    residual = estimate.residual(columns)
    power = np.sum(residual**2, axis=0)
    seen = power > _LEAST_FREE * np.sum(columns**2, axis=0)
    sd = np.where(seen, 1.0 / np.sqrt(np.where(seen, power, 1.0)), np.nan)
    return np.where(seen, (residual.T @ network.measured) * np.where(seen, sd, 0.0), 0.0), sd


def _tested(network: _Network, columns: Array, estimate: _Estimate) -> tuple[Array, Array]:
    """Return how far the other measurements place balises from their plans, m, and the sigma, each (p,)."""
    in_sigmas, sd = _explained(network, estimate, columns[:, : len(network.plan_of)])
    off = np.where(np.isnan(sd), np.nan, -in_sigmas * sd)
    m = len(network.passages)
    for error, size, size_sd in zip(estimate.errors, *estimate.sizes, strict=True):
        if error.kind == "plan":
            off[error.row - m], sd[error.row - m] = -size, size_sd
    return off, sd


def _table(
    network: _Network, plans: pd.DataFrame, estimate: _Estimate, off: tuple[Array, Array], undecided: set[_Error]
) -> pd.DataFrame:
    passages, b, m = network.passages, len(network.names), len(network.passages)
    misread = passages.iloc[[error.row for error in estimate.errors if error.kind == "passage"]]
    table = pd.DataFrame({"id": network.names})
    table["passes"] = passages.groupby("balise").size().reindex(range(b))
    table["left_out"] = misread.groupby("balise").size().reindex(range(b), fill_value=0)
    table["runs"] = passages.groupby("balise")["run"].nunique().reindex(range(b))
    stated = plans.reindex(network.names)
    table["planned_m"], table["planned_m_sd"] = stated["chainage_m"].to_numpy(), stated["chainage_sd_m"].to_numpy()
    place, place_sd = estimate.x[:b], np.sqrt(np.diag(estimate.covariance)[:b])
    measured, measured_sd = place.copy(), place_sd.copy()
    difference_sd = place_sd.copy()
    planned, planned_sd = (table[name].to_numpy()[network.plan_of] for name in ("planned_m", "planned_m_sd"))
    measured[network.plan_of] = planned + off[0]
    measured_sd[network.plan_of] = np.sqrt(np.maximum(off[1] ** 2 - planned_sd**2, _LEAST_FREE * off[1] ** 2))
    difference_sd[network.plan_of] = off[1]
    table["measured_m"], table["measured_m_sd"] = measured, measured_sd
    table["difference_m"] = table["measured_m"] - table["planned_m"]
    table["difference_m_sd"] = np.where(table["difference_m"].notna(), difference_sd, np.nan)
    table["sigmas"] = (table["difference_m"] / table["difference_m_sd"]).where(table["planned_m_sd"].notna())
    table["place_m"], table["place_m_sd"] = place, place_sd
    verdict = np.where(network.anchored, "surveyed", "relative").astype(object)
    verdict[network.plan_of] = np.where(np.isnan(off[0]), "unchecked", "agrees")
    named = dict.fromkeys(estimate.errors, "wrong") | dict.fromkeys(undecided, "undecided")
    for error, word in named.items():
        if error.kind == "plan":
            verdict[network.plan_of[error.row - m]] = word
    table["verdict"] = verdict
    table = table.sort_values("place_m", ignore_index=True)
    return pd.concat([table, _not_passed(plans, network.names)], ignore_index=True)[list(BALISE_COLUMNS)]


def _not_passed(plans: pd.DataFrame, names: list[str]) -> pd.DataFrame:
    """Return the rows of balises that are planned and were not passed."""
    other = plans[~plans.index.isin(names)]
    rows = pd.DataFrame(np.nan, index=range(len(other)), columns=list(BALISE_COLUMNS))
    rows[["passes", "left_out", "runs"]] = 0
    planned = {"planned_m": other["chainage_m"].to_numpy(), "planned_m_sd": other["chainage_sd_m"].to_numpy()}
    return rows.assign(id=other.index.to_numpy(), verdict="not passed", **planned)


def _left_out(network: _Network, names: Sequence[str], estimate: _Estimate) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the passages that were misread, and where wheels erred."""
    misread, slips = [], []
    at = network.passages[["run", "t_s", "id"]].to_dict("records")
    for error, size, sd in zip(estimate.errors, *estimate.sizes, strict=True):
        if error.kind == "passage":
            passage = at[error.row]
            misread.append((names[passage["run"]], passage["t_s"], passage["id"], size, sd))
        elif error.kind == "wheel":
            start, end = at[error.row - 1], at[error.row]
            slips.append((names[end["run"]], start["t_s"], end["t_s"], size, sd))
    return pd.DataFrame(misread, columns=list(MISREAD_COLUMNS)), pd.DataFrame(slips, columns=list(SLIP_COLUMNS))
