"""Gauss-Newton with step control minimises a graph whose values Python owns.

Each iteration linearises the inertial factors (:class:`trackfg.factors.imu.InertialFactors`) and our families, all as
arrays, eliminates along the chain by QR (:mod:`trackfg.solver.elimination`), and takes the step if the cost falls, else
a shorter one.

The stop rule is on the whitened step. With the square root R of the information, ``|R d|`` is the length of the step d
in posterior sigmas: no linear combination of the variables moves by more than that many of its own sigmas. Under robust
losses, whose weights settle slowly, a step that hardly lowers the cost ends the iteration too. The reason is part of
the result.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from trackfg.factors.states import KEYFRAME_DIM, SHARED_DIM, States
from trackfg.numerics.key_figures import KeyFigures
from trackfg.solver.arcs import along_arcs
from trackfg.solver.elimination import eliminate

if TYPE_CHECKING:
    import gtsam

    from trackfg.config import SolverConfig
    from trackfg.factors.family import Family
    from trackfg.factors.imu import InertialFactors
    from trackfg.solver.square_root import SquareRoot

_SHORTEST = 2.0**-10
"""A step is halved no further than this share of it."""

_LONGEST = 8.0
"""A step is doubled no further than this multiple of it."""

_AS_EXPECTED = 2.0**-5
"""Deviation from the expected decrease of the cost, as a share of it, up to which the cost is taken for quadratic along
the step. Then twice the step has the cost of none: the deviation would have to grow with more than the fifth power of
the step's length for it to be lower than that of the step.
"""

_ROUGH = 3.0
"""In sigmas per square root of the number of variables: until a step is shorter, gentler losses stand in."""


class Graph(Protocol):
    """A graph is factors, and the values of its variables from which a solver begins."""

    @property
    def inertial(self) -> InertialFactors:
        """The inertial factors."""

    @property
    def families(self) -> tuple[Family, ...]:
        """All other factors."""

    @property
    def initial(self) -> States:
        """The values to begin with."""


@dataclass(frozen=True, repr=False)
class Solution(KeyFigures):
    """A solution is the minimum, the square root of the information at the last step, and how it was reached.

    ``trials``: how many steps, shortened and lengthened ones with them, were tried in all ``iterations``.

    Examples
    --------
    >>> import trackfg
    >>> from trackfg import graph, solver
    >>> problem = graph.build_problem(trackfg.read_recording("run1"), trackfg.SmoothConfig())
    >>> solution = solver.solve(problem, trackfg.SmoothConfig().solver)
    >>> solution.converged, solution.iterations
    (True, 3)
    """

    states: States
    root: SquareRoot
    converged: bool
    reason: str
    iterations: int
    trials: int
    cost: float
    initial_cost: float
    degrees_of_freedom: int

    def key_figures(self) -> dict[str, str]:
        """Return whether the solver converged and why it stopped, iterations, costs and degrees of freedom."""
        return {
            "solution": "converged" if self.converged else "not converged",
            "reason": self.reason,
            "iterations": f"{self.iterations} iterations",
            "cost": f"cost {self.cost:.6g} after {self.initial_cost:.6g}",
            "degrees of freedom": f"{self.degrees_of_freedom} degrees of freedom",
        }

    @property
    def values(self) -> gtsam.Values:
        """The states that inertial factors touch, as GTSAM has them."""
        return self.states.inertial_values


class _Stop(NamedTuple):
    converged: bool
    reason: str


def solve(
    problem: Graph, config: SolverConfig, progress: Callable[[float], None] | None = None, *, near: bool = False
) -> Solution:
    """Minimise the cost of a graph, beginning at its initial values.

    Parameters
    ----------
    problem : Graph
        What :func:`trackfg.graph.build_problem` returns, with any families added; or a window of a stream.
    config : SolverConfig
        When to stop: the ``solver`` section of a ``SmoothConfig``.
    progress : callable, optional
        Called after each iteration with the share of ``config.max_iterations`` that is done.
    near : bool
        Whether the initial values are a solution of much the same graph, so that robust losses apply at once.

    Returns
    -------
    Solution
        The states at the minimum, the square root of their information, and why the iteration stopped.

    Raises
    ------
    UnsolvableError
        Where the measurements do not determine the states.
    TypeError
        For a ``config`` that is not such a section.

    Examples
    --------
    >>> import trackfg
    >>> from trackfg.graph import build_problem
    >>> from trackfg.solver import solve
    >>> settings = trackfg.SmoothConfig()
    >>> solve(build_problem(trackfg.read_recording("run1"), settings), settings.solver).converged
    True
    """
    if not hasattr(config, "step_tolerance"):
        given = type(config).__name__
        raise TypeError(f"solve takes the section solver of settings, such as SmoothConfig().solver, not {given}")
    keyframes = len(problem.initial)
    variables = KEYFRAME_DIM * keyframes + SHARED_DIM + problem.initial.sensor.size
    states = problem.initial
    families = problem.families if near else tuple(family.convex_start() for family in problem.families)
    robust = near
    cost = initial_cost = _cost(problem, families, states)
    stop = None
    root: SquareRoot | None = None
    iterations = trials = 0
    while stop is None and iterations < config.max_iterations:
        iterations += 1
        root = None  # the next one needs its memory
        linear = [problem.inertial.linearize(states), *(family.linearize(states) for family in families)]
        root = eliminate(linear, keyframes)
        del linear  # the step needs its memory, and so do the next rows
        length = root.length
        if progress is not None:
            progress(iterations / config.max_iterations)
        if robust and length < config.step_tolerance:
            stop = _Stop(True, f"the step is {length:.2g} posterior sigmas, below {config.step_tolerance:g}")
            break
        moved, tried = _step(problem, families, states, root, cost)
        trials += tried
        if moved is not None:
            fell = cost - moved[1]
            states, cost = moved
            if robust and fell < config.cost_tolerance:
                stop = _Stop(True, f"the cost fell by {fell:.2g}, less than {config.cost_tolerance:g}")
        elif robust:
            short = length < 1.0
            stop = _Stop(short, f"no shorter step lowers the cost; the step was {length:.2g} posterior sigmas")
        if not robust and (moved is None or length < _ROUGH * np.sqrt(variables)):
            # Close enough that a large residual is an outlier and not a poor start.
            robust, families = True, problem.families
            cost = _cost(problem, families, states)
    assert root is not None  # there is at least one iteration
    stop = stop or _Stop(False, f"stopped after {config.max_iterations} iterations")
    rows = 9 * (keyframes - 1) + sum(family.rows for family in families)
    return Solution(states, root, stop.converged, stop.reason, iterations, trials, cost, initial_cost, rows - variables)


def _cost(problem: Graph, families: tuple[Family, ...], states: States) -> float:
    return problem.inertial.cost(states) + sum(family.cost(states) for family in families)


def _step(
    problem: Graph, families: tuple[Family, ...], states: States, root: SquareRoot, cost: float
) -> tuple[tuple[States, float] | None, int]:
    """Return the best of the halved or doubled steps of a linear system, None if none lowers the cost, and how many
    were tried.

    Where a step straight ahead does not lower the cost, the same one along arcs may.

    Reweighted least squares steps are too short where robust weights still change, so a step that helps is doubled for
    as long as that helps more; but not where the cost falls by what the linear system expects, ``|R d|^2 / 2``.
    """
    trials = 0
    enough = cost * (1.0 + 1e-12)
    step, expected = root.solution(), 0.5 * root.length**2

    def tried(moved: States) -> tuple[States, float]:
        nonlocal trials
        trials += 1
        new = _cost(problem, families, moved)
        return moved, new if np.isfinite(new) else np.inf

    def attempt(scale: float) -> tuple[States, float]:
        straight = tried(states.moved(step.scaled(scale)))
        return straight if straight[1] <= enough else tried(along_arcs(states, straight[0]))

    scale = 1.0
    best = attempt(scale)
    while best[1] > enough:
        scale *= 0.5
        if scale < _SHORTEST:
            return None, trials
        best = attempt(scale)
    if scale == 1.0 and abs(cost - best[1] - expected) < _AS_EXPECTED * expected:
        return best, trials
    while scale >= 1.0 and scale < _LONGEST and (longer := attempt(2.0 * scale))[1] < best[1]:
        best, scale = longer, 2.0 * scale
    return best, trials
