"""A refit makes a chain after an edit a possible line again.

Points are in order, curves are not too wide, and there is a straight between curves of opposite sign.
"""

from __future__ import annotations

import numpy as np

from trackfg.curves.chain_edits import level_length, merged, straightened, swapped, with_crossing
from trackfg.curves.fit import Fit, Stretch, fitted
from trackfg.curves.model import WIDEST_RADIUS_M, CurveChain

_TURNED_M = 1.0
"""A transition the wrong way round by more than this, m, is turned; a shorter one loses its length."""


def refitted(chain: CurveChain, stretch: Stretch) -> Fit | None:
    """Fit a chain, and correct it until its points are in order and its curves not too wide.

    None without a curve, or where its points leave the stretch.
    """
    turned: set[int] = set()
    for _ in range(4 * len(chain.straight) + 8):
        fit = fitted(chain, stretch)
        points, nodes = fit.chain.points, fit.chain.nodes
        if points.min() < stretch.edges[0] or points.max() > stretch.edges[-1]:
            # Some curve of the chain is none, and its points went astray: the one that turns least.
            if len(chain.curved) == 1:
                return None
            turn = [abs(chain.curvature[level]) * level_length(chain, int(level)) for level in chain.curved]
            chain = straightened(chain, int(chain.curved[np.argmin(turn)]))
            continue
        back = np.where(nodes[1:] != nodes[:-1], points[:-1] - points[1:], -np.inf)
        if back.size and back.max() >= 0.0:
            j = int(np.argmax(back))
            a, b = int(nodes[j]), int(nodes[j + 1])
            # A transition the wrong way round is as good as the right way round: no reason to take its length away.
            if j % 2 == 0 and back.max() > _TURNED_M and j not in turned:
                turned.add(j)
                chain = swapped(fit.chain, a, b)
            else:
                chain = merged(fit.chain, a, b)
            continue
        curved = fit.chain.curved
        flattest = int(curved[np.argmin(np.abs(fit.chain.curvature[curved]))])
        if abs(fit.chain.curvature[flattest]) * WIDEST_RADIUS_M < 1.0:
            chain = straightened(fit.chain, flattest)
            if not chain.curved.size:
                return None
            continue
        crossing = with_crossing(fit.chain)
        if crossing is None:
            return fit
        chain = crossing
    return fit
