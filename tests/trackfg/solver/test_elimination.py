"""What the measurements leave open is refused, wherever it is, though there be rows enough."""

from __future__ import annotations

import numpy as np
import pytest

from trackfg.errors import UnsolvableError
from trackfg.factors.family import LinearFactors, Slot
from trackfg.factors.states import KEYFRAME_DIM, SHARED_DIM, Kind, offset_in_keyframe
from trackfg.solver.elimination import compressed, eliminate, eliminate_pair
from trackfg.solver.placed_factors import stacked_pair

KEYFRAMES = 2

pytestmark = pytest.mark.usefixtures("kernels")


def measured_once(mixed: Kind | None = None, apart: float = 0.0) -> list[LinearFactors]:
    """One row for each variable of two keyframes, ``x = 0``; but the first two entries of the variables ``mixed`` have
    the rows ``x + y = 0`` and ``x + (1 + apart) y = 0``, which leave ``apart / sqrt(2)`` on the diagonal.
    """
    factors = []
    for kind in Kind:
        count = 1 if kind.shared else KEYFRAMES
        rows = np.zeros((count, kind.dim, kind.dim + 1))
        rows[:, :, :-1] = np.eye(kind.dim)
        if kind is mixed:
            rows[:, :2, :2] = [[1.0, 1.0], [1.0, 1.0 + apart]]
        factors.append(LinearFactors((Slot(kind, np.arange(count)),), rows))
    return factors


def test_every_variable_measured_once_is_determined() -> None:
    root = eliminate(measured_once(), KEYFRAMES)
    np.testing.assert_allclose(root.R, np.tile(np.eye(KEYFRAME_DIM), (KEYFRAMES, 1, 1)))
    np.testing.assert_allclose(root.R_shared, np.eye(SHARED_DIM + Kind.SENSOR.dim))


@pytest.mark.parametrize("kind", list(Kind), ids=lambda kind: kind.name)
def test_two_variables_seen_by_one_row_twice_are_refused(kind: Kind) -> None:
    """There are as many rows as variables, so that only the triangle's diagonal shows it: rounding."""
    factors = measured_once(kind)
    with pytest.raises(UnsolvableError, match="do not determine the states"):
        eliminate(factors, KEYFRAMES)
    rows = stacked_pair(factors)
    half = len(rows) // 2
    with pytest.raises(UnsolvableError, match="do not determine the states"):
        eliminate_pair(compressed(rows[:half]), rows[half:])


@pytest.mark.parametrize("kind", list(Kind), ids=lambda kind: kind.name)
def test_two_rows_that_differ_by_more_than_rounding_are_two_measurements(kind: Kind) -> None:
    root = eliminate(measured_once(kind, 1e-9), KEYFRAMES)
    at = offset_in_keyframe(kind) + 1
    diagonal = np.diag(root.R_shared)[at - KEYFRAME_DIM] if kind.shared else root.R[0, at, at]
    assert diagonal == pytest.approx(1e-9 / np.sqrt(2.0), rel=1e-5)
