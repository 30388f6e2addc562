"""The landmarks of a map: the points of the curves in its profile, with covariance, and ids that last.

A curve gives up to four points, BTC, BCC, ECC and ETC; what the profile does not show is none. Points that coincide are
one landmark, of the circle rather than of the transition, and of the curve before rather than the one after. So a
transition between two circles is bounded by the ECC of the first and the BCC of the next, a circle without transition
begins at its BCC, and where a curve begins as the reverse one before it ends there is the ETC of that one.

The covariance of the chainages is the sum of two: that of the map's own chainage where the landmarks are, common to
neighbours, and that of the points on the profile. Of the latter each :class:`~trackfg.curves.Curve` has its own four;
two curves with points in common are independent given these.

Ids: ``C0001`` for a curve, ``C0001-BTC`` for its point. A curve that is one of the previous version
(:mod:`trackfg.mapping.joining.curve_identity`) keeps its id, another gets a number above all of that version's.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from trackfg.curves import POINTS, QUANTITIES, Curve
from trackfg.mapping.joining.curve_identity import CurveFeatures, paired
from trackfg.maps.feature_map import CURVE_POINTS, LANDMARK_COLUMNS
from trackfg.numerics.arrays import Array

_PREFERRED = (1, 2, 3, 0)
"""Which of a curve's points a landmark is where several coincide: BCC, ECC, ETC, BTC."""


def landmarks(
    curves: Sequence[Curve],
    previous: pd.DataFrame | None,
    place_covariance: Callable[[Array], Array],
    position: Callable[[Array], tuple[Array, Array]] | None,
    observations: Callable[[Array], Array],
) -> tuple[pd.DataFrame, Array]:
    """Return the table of landmarks and the covariance of their chainages, m^2 (n, n).

    The columns are :data:`~trackfg.maps.feature_map.LANDMARK_COLUMNS`, in order of chainage. ``curves`` are those of
    the map's profile, in order of chainage; ``previous`` is the table of the version before. For chainages (n,),
    ``place_covariance`` returns the covariance of the map's chainage, m^2 (n, n), ``position`` east, north, up and
    their sigmas, m, each (n, 3), and ``observations`` the number of runs there (n,).
    """
    nodes, of_profile = _nodes(curves)
    chainage = np.array([node.chainage_m for node in nodes])
    covariance = of_profile + place_covariance(chainage)
    sd = np.sqrt(np.diag(covariance))
    ids = _ids(curves, nodes, sd, previous)
    places, places_sd = np.full((2, len(nodes), 3), np.nan) if position is None else position(chainage)
    counts = observations(chainage)
    rows = []
    for k, node in enumerate(nodes):
        curve, curve_id = curves[node.curve], ids[node.curve]
        law, length = (curve.law_in, "length_in_m") if node.point < 2 else (curve.law_out, "length_out_m")
        has_start = law not in ("none", "unseen")
        rows.append(
            {
                "landmark_id": f"{curve_id}-{node.kind}",
                "kind": node.kind,
                "name": "",
                "curve_id": curve_id,
                "sense": curve.sense,
                "law": law if has_start else "",
                "chainage_m": node.chainage_m,
                "chainage_m_sd": sd[k],
                **_measured("radius_m", curve, "radius_m"),
                **_measured("transition_length_m", curve, length if has_start else None),
                **_measured("arc_length_m", curve, "arc_length_m"),
                **_measured("cant_mm", curve, "cant_mm"),
                **{name: places[k, axis] for axis, name in enumerate(("east_m", "north_m", "up_m"))},
                **{name: places_sd[k, axis] for axis, name in enumerate(("east_m_sd", "north_m_sd", "up_m_sd"))},
                "observations": int(counts[k]),
            }
        )
    table = pd.DataFrame(rows, columns=list(LANDMARK_COLUMNS))
    if table.empty:
        table = table.astype({name: np.float64 for name in LANDMARK_COLUMNS if name.endswith(("_m", "_mm", "_sd"))})
        table = table.astype({"observations": np.int64})
    return table, covariance


@dataclass(frozen=True)
class _Node:
    """A place where a landmark is: point ``point`` (0 to 3, as in CURVE_POINTS) of curve number ``curve``."""

    chainage_m: float
    curve: int
    point: int

    @property
    def kind(self) -> str:
        """The kind of the point: "BTC" and so on."""
        return CURVE_POINTS[self.point]


def _nodes(curves: Sequence[Curve]) -> tuple[list[_Node], Array]:
    """Return the landmarks in order of chainage, and the covariance of their places on the profile."""
    nodes: list[_Node] = []
    covariance = np.zeros((0, 0))
    for number, curve in enumerate(curves):
        values = [float(getattr(curve, name)) for name in POINTS]
        shared = {node.chainage_m: k for k, node in enumerate(nodes) if number and node.curve >= number - 1}
        # This curve's points by place, each the one that it is preferred to be.
        point_at: dict[float, int] = {}
        for point in _PREFERRED:
            if np.isfinite(values[point]):
                point_at.setdefault(values[point], point)
        for place, point in point_at.items():
            if place in shared and point in (1, 2) and nodes[shared[place]].point in (0, 3):
                nodes[shared[place]] = _Node(place, number, point)
        common = [place for place in point_at if place in shared]
        further = [place for place in point_at if place not in shared]
        at = {place: QUANTITIES.index(POINTS[point]) for place, point in point_at.items()}
        covariance = _joined(
            covariance,
            curve.covariance,
            [shared[p] for p in common],
            [at[p] for p in common],
            [at[p] for p in further],
        )
        nodes += [_Node(place, number, point_at[place]) for place in further]
    order = np.argsort([node.chainage_m for node in nodes], kind="stable")
    return [nodes[k] for k in order], covariance[np.ix_(order, order)]


def _joined(covariance: Array, other: Array, rows: list[int], shared: list[int], added: list[int]) -> Array:
    """Return the ``covariance`` (n, n) extended by the variables ``added`` of the covariance ``other``.

    ``shared`` of its variables are ``rows`` of the first; given these, the added ones are independent of the rest.
    """
    gain = other[np.ix_(added, shared)] @ np.linalg.pinv(other[np.ix_(shared, shared)], hermitian=True)
    across = gain @ covariance[rows]
    conditional = other[np.ix_(added, added)] - gain @ other[np.ix_(shared, added)]
    return np.block([[covariance, across.T], [across, conditional + across[:, rows] @ gain.T]])


def _ids(curves: Sequence[Curve], nodes: Sequence[_Node], sd: Array, previous: pd.DataFrame | None) -> list[str]:
    """Return the curves' ids: those of the same curves of the version before, and new ones."""
    old: dict[str, CurveFeatures] = {} if previous is None else _features_of_table(previous)
    sigmas = {node.chainage_m: float(sd[k]) for k, node in enumerate(nodes)}
    new = [_features_of(curve, sigmas) for curve in curves]
    names = list(old)
    numbers = [0] if previous is None else [0, *(_number(text) for text in previous["curve_id"])]
    highest = max(numbers)
    ids = []
    for match in paired(list(old.values()), new):
        highest += match is None
        ids.append(f"C{highest:04d}" if match is None else names[match])
    return ids


def _number(curve_id: str) -> int:
    digits = re.fullmatch(r"C(\d+)", curve_id)
    return int(digits[1]) if digits else 0


def _features_of(curve: Curve, sigmas: dict[float, float]) -> CurveFeatures:
    places = {kind: float(getattr(curve, name)) for kind, name in zip(CURVE_POINTS, POINTS, strict=True)}
    return CurveFeatures(
        sense=curve.sense,
        radius_m=(curve.radius_m, curve.sd("radius_m")),
        arc_length_m=(curve.arc_length_m, curve.sd("arc_length_m")),
        points_m={kind: (place, sigmas[place]) for kind, place in places.items() if np.isfinite(place)},
    )


def _features_of_table(table: pd.DataFrame) -> dict[str, CurveFeatures]:
    """Return the features of the curves of a table by their ids, in order of chainage."""
    features = {}
    for curve_id, rows in table[table["kind"].isin(CURVE_POINTS)].groupby("curve_id", sort=False):
        row = rows.iloc[0]
        features[str(curve_id)] = CurveFeatures(
            sense=str(row["sense"]),
            radius_m=(float(row["radius_m"]), float(row["radius_m_sd"])),
            arc_length_m=(float(row["arc_length_m"]), float(row["arc_length_m_sd"])),
            points_m={
                str(kind): (float(place), float(place_sd))
                for kind, place, place_sd in zip(rows["kind"], rows["chainage_m"], rows["chainage_m_sd"], strict=True)
            },
        )
    return features


def _measured(column: str, curve: Curve, name: str | None) -> dict[str, float]:
    """Return a quantity of a curve and its sigma, as two columns."""
    value, sd = (np.nan, np.nan) if name is None else (float(getattr(curve, name)), curve.sd(name))
    return {column: value, f"{column}_sd": sd}
