"""The graph of a run has keyframes, factors and initial values.

:func:`build_problem` makes it from a recording; docs/graph.md shows how to use it with GTSAM's own optimisers, how to
add factors, and how to look at their errors.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from trackfg.lazy_imports import lazy_imports

if TYPE_CHECKING:
    from trackfg.graph.build import Problem, build_problem
    from trackfg.graph.gtsam_export import GtsamProblem, Variable

__all__ = ["GtsamProblem", "Problem", "Variable", "build_problem"]

__getattr__ = lazy_imports(
    __name__,
    {
        "Problem": "build",
        "build_problem": "build",
        "GtsamProblem": "gtsam_export",
        "Variable": "gtsam_export",
    },
)
