"""What cells see of a chain of curves: derivatives, and the same as a line's own functions say."""

from __future__ import annotations

import numpy as np
import pytest

from trackfg.curves.model import CurveChain, step_turns, tilts, turns
from trackfg.datasets.line.alignment import Element, piecewise

EDGES = 100.0 + 10.0 * np.arange(60)
CHAIN = CurveChain(
    straight=(True, False, False, True, False),
    begin=(0, 2, 4, 5),
    end=(1, 3, 5, 6),
    laws=("clothoid", "half-sine", "bloss", "sine"),
    places=np.array([151.0, 203.0, 288.0, 321.0, 402.0, 455.0, 533.0]),
    curvature=np.array([0.0, 1 / 400, 1 / 700, 0.0, -1 / 500]),
    cant=np.array([0.0, -60.0, -40.0, 0.0, 70.0]),
)


@pytest.mark.parametrize("cant", [False, True])
def test_derivatives_are_those_of_the_function(cant: bool) -> None:
    see = tilts if cant else turns
    slopes = see(CHAIN, EDGES)[1]
    p, c = len(CHAIN.places), len(CHAIN.curved)
    assert slopes.shape == (len(EDGES) - 2, p + c)
    columns = [*range(p), *range(p + c * cant, p + c * (1 + cant))]
    start = CHAIN.parameters
    for column, parameter in enumerate(columns):
        h = 1e-3 if parameter < p else 1e-4 * abs(start[parameter])
        step = h * np.eye(len(start))[parameter]
        above, below = (see(CHAIN.with_parameters(start + sign * step), EDGES)[0] for sign in (1, -1))
        scale = np.abs(slopes[:, column]).max()
        np.testing.assert_allclose((above - below) / (2 * h), slopes[:, column], atol=2e-5 * scale)


def test_turns_and_tilts_are_means_of_the_line_over_cells() -> None:
    """A cell's turn is the change of the mean heading, by quadrature of the line's own polynomials."""
    lengths, levels = [51.0, 52.0, 85.0, 33.0, 81.0, 53.0, 78.0, 300.0], CHAIN.curvature
    elements = [Element("constant", lengths[0], 0.0, 0.0), Element("linear", lengths[1], 0.0, levels[1])]
    elements += [Element("constant", 85.0, levels[1], levels[1]), Element("half-sine", 33.0, levels[1], levels[2])]
    elements += [Element("constant", 81.0, levels[2], levels[2]), Element("bloss", 53.0, levels[2], 0.0)]
    elements += [Element("sine", 78.0, 0.0, levels[4]), Element("constant", 300.0, levels[4], levels[4])]
    line = piecewise(elements)
    twice = line.antiderivative(2)
    mean_heading = np.diff(twice(EDGES - 100.0)) / 10.0
    np.testing.assert_allclose(turns(CHAIN, EDGES)[0], np.diff(mean_heading), atol=1e-11)
    scaled = CurveChain(
        CHAIN.straight, CHAIN.begin, CHAIN.end, CHAIN.laws, CHAIN.places, CHAIN.curvature, 1e4 * CHAIN.curvature
    )
    mean_cant = 1e4 * np.diff(line.antiderivative()(EDGES - 100.0)) / 10.0
    np.testing.assert_allclose(tilts(scaled, EDGES)[0], np.diff(mean_cant), atol=1e-9)


def test_a_step_is_a_transition_without_length() -> None:
    chain = CurveChain((True, False), (0,), (0,), ("clothoid",), np.array([333.0]), np.array([0.0, 1.0]), np.zeros(2))
    # Transitions are never shorter than a millimetre.
    np.testing.assert_allclose(turns(chain, EDGES)[0], step_turns(np.array([333.0]), EDGES)[:, 0], atol=1e-3)
