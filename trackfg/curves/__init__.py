"""Curves of a line, found in its curvature and cross-level; see docs/curves.md.

=====================  ===============================================================================================
module                 content
=====================  ===============================================================================================
``curve``              :class:`Curve`, :func:`curve_table`
``detection``          :func:`find_curves`
``cells``              a profile in cells, its holes bridged
``segments``           where on them curves are, roughly
``line``               groups of curves, and the noise of what they leave over
``structure``          which levels and transitions a group has, by the moves of ``chain_edits`` and ``settling``
``laws``               which law each transition follows, and what not knowing it for certain costs
``fit``, ``model``     least squares, and what cells see of a chain of curves
``increments``         what was measured, with its noise and the cells that a defect disturbs
``increment_noise``    coloured noise of heading and cross-level
``transition_laws``    clothoid, half-sine, sine, Bloss, Helmert
=====================  ===============================================================================================
"""

from trackfg.curves.curve import CURVE_COLUMNS, POINTS, QUANTITIES, Curve, CurveKind, CurveLaw, curve_table
from trackfg.curves.detection import find_curves

__all__ = ["CURVE_COLUMNS", "POINTS", "QUANTITIES", "Curve", "CurveKind", "CurveLaw", "curve_table", "find_curves"]
