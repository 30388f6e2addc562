"""The graph of a run has keyframes, factors and initial values.

:func:`build_problem` makes it from a recording; docs/graph.md shows how to use it with GTSAM's own optimisers, how to
add factors, and how to look at their errors.
"""

from trackfg.graph.build import Problem, build_problem
from trackfg.graph.gtsam_export import GtsamProblem, Variable

__all__ = ["GtsamProblem", "Problem", "Variable", "build_problem"]
