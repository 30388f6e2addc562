"""The laws against what defines them: their derivatives, their symmetry, and the simulator's own formulas."""

from __future__ import annotations

import numpy as np
import pytest

from trackfg.curves.transition_laws import LAWS, SPREAD, TransitionLaw, rise
from trackfg.datasets.line.alignment import Element, Law, piecewise

INSIDE = np.linspace(0.01, 0.99, 99)


@pytest.mark.parametrize("law", LAWS)
def test_integrals_have_the_law_as_slope(law: TransitionLaw) -> None:
    u, h = np.concatenate([INSIDE[np.abs(INSIDE - 0.5) > 1e-3], [-0.4, 1.3, 2.0]]), 1e-5
    above, below, here = rise(law, u + h), rise(law, u - h), rise(law, u)
    for order in (0, 1):
        np.testing.assert_allclose((above[order + 1] - below[order + 1]) / (2 * h), here[order], atol=1e-9)


@pytest.mark.parametrize("law", LAWS)
def test_laws_are_symmetric_and_look_alike_from_afar(law: TransitionLaw) -> None:
    np.testing.assert_allclose(rise(law, INSIDE)[0] + rise(law, 1.0 - INSIDE)[0], 1.0, atol=1e-14)
    u = np.array([1.0, 1.5, 7.0])
    f, first, second = rise(law, u)
    np.testing.assert_allclose(f, 1.0, atol=1e-14)
    np.testing.assert_allclose(first, u - 0.5, atol=1e-14)
    np.testing.assert_allclose(second, 0.5 * ((u - 0.5) ** 2 + SPREAD[law] ** 2), rtol=1e-13)
    assert not np.any(np.concatenate(rise(law, np.array([-3.0, 0.0]))))


@pytest.mark.parametrize("law", LAWS)
def test_laws_are_those_that_lines_are_designed_with(law: TransitionLaw) -> None:
    designed: Law = "linear" if law == "clothoid" else law
    line = piecewise([Element(designed, 60.0, 0.0, 1.0)])
    np.testing.assert_allclose(rise(law, INSIDE)[0], line(60.0 * INSIDE), atol=1e-12)
