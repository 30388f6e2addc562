"""A map that does not fit its own description is refused when it is made."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackfg.maps import FeatureMap, RunInformation

MakeMap = Callable[..., FeatureMap]


def changed(table: pd.DataFrame, column: str, value: Any) -> pd.DataFrame:
    """Its first row's value replaced."""
    values = table[column].to_numpy(copy=True)
    values[0] = value
    return table.assign(**{column: values})


@pytest.mark.parametrize(
    ("field", "change", "message"),
    [
        ("grid", lambda table: table.drop(columns="cant_mm"), "grid: columns"),
        ("grid", lambda table: changed(table, "chainage_m", 0.1), "grid: expected ascending chainage_m on whole"),
        ("grid", lambda table: table.iloc[::-1], "grid: expected ascending chainage_m on whole"),
        ("grid", lambda table: changed(table, "cant_mm", np.inf), "grid: cant_mm: expected finite numbers"),
        ("grid", lambda table: changed(table, "curvature_1pm_sd", -1.0), "curvature_1pm_sd: expected no negative"),
        ("grid", lambda table: table.assign(observations=1.0), "observations is float64: expected integers"),
        ("landmarks", lambda table: changed(table, "kind", "BVC"), "kind: expected one of 'BTC'"),
        ("landmarks", lambda table: changed(table, "sense", "L"), "sense: expected one of 'left'"),
        ("landmarks", lambda table: changed(table, "landmark_id", table["landmark_id"][1]), "every landmark_id once"),
        ("landmarks", lambda table: changed(table, "chainage_m", 1e6), "landmarks: expected ascending chainage_m"),
        ("landmarks", lambda table: changed(table, "chainage_m_sd", 9.0), "covariance: expected the squares"),
        ("landmarks", lambda table: changed(table, "chainage_m", np.nan), "chainage_m: expected finite numbers"),
        ("landmarks", lambda table: table.assign(name=None), "name: expected text"),
        ("covariance", lambda matrix: matrix[1:, 1:], "as many as landmarks"),
        ("covariance", lambda matrix: np.triu(matrix), "symmetric"),
        ("line", lambda table: table.iloc[::-1], "line: expected ascending chainage_m"),
        ("runs", lambda table: changed(table, "direction", 0), "direction: expected one of 1, -1"),
        ("runs", lambda table: table.iloc[:1], "information of run1: not among the runs"),
        ("origin", lambda _: (135.0, 35.0, 0.0), "expected latitude and longitude"),
    ],
)
def test_refuses(make_map: MakeMap, field: str, change: Callable[[Any], Any], message: str) -> None:
    good = make_map(cells=41)
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(good, **{field: change(getattr(good, field))})


@pytest.mark.parametrize(
    ("variables", "R", "d", "message"),
    [
        (("a", "a"), np.eye(2), np.zeros(2), "named twice"),
        (("a", "b"), np.eye(3), np.zeros(3), r"expected \(m, 2\)"),
        (("a", "b"), np.eye(2), np.zeros(3), r"expected \(m, 2\)"),
        (("a", "b"), np.full((2, 2), np.nan), np.zeros(2), "finite"),
    ],
)
def test_refuses_information(variables: tuple[str, ...], R: np.ndarray, d: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        RunInformation(variables, R, d)
