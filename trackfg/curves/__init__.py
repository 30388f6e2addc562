"""Curves of a line are found in its curvature and cross-level; see docs/curves.md.

============================  ========================================================================================
module                        content
============================  ========================================================================================
``detection``                 :func:`find_curves`: the modules below in their order
``cells``                     a profile in cells, its holes bridged
``segments``                  a first chain for each group of curves
``line``                      groups of curves, and the noise of their residuals
``structure``                 the levels and transitions of a group, by ``chain_edits`` and ``refit``
``transition_law_selection``  the law of each transition, and the covariance that a doubtful choice adds
``fit``, ``model``            least squares, and what cells see of a chain of curves
``increments``                the measured increments with their noise, and the cells that a defect disturbs
``increment_noise``           coloured noise of heading and cross-level
``transition_laws``           clothoid, half-sine, sine, Bloss, Helmert
``curve``                     :class:`Curve`, :func:`curve_table`
============================  ========================================================================================
"""

from trackfg.curves.curve import CURVE_COLUMNS, POINTS, QUANTITIES, Curve, CurveKind, CurveLaw, curve_table
from trackfg.curves.detection import find_curves

__all__ = ["CURVE_COLUMNS", "POINTS", "QUANTITIES", "Curve", "CurveKind", "CurveLaw", "curve_table", "find_curves"]
