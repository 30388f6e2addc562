"""Assumptions are reassessed by what a solution shows of them, and the graph is solved again where they change.

    solve -> covariance -> all reassessors in turn -> solve from there, with what changed -> ...

A reassessor looks at one assumption (noise levels, which fixes are wrong, a prior too narrow) and returns the problem
with other sigmas, losses or factors where the solution contradicts it. Each further solve begins at the last solution,
so it takes few iterations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from trackfg.config import SmoothConfig
from trackfg.graph.build import Problem
from trackfg.recording.findings import Finding
from trackfg.results.verdict import Doubt
from trackfg.solver.covariance import Covariance
from trackfg.solver.gauss_newton import Solution
from trackfg.solver.variance_components import Residuals, ratios_of

LEAST_CHANGE = 1.2
"""A sigma that would change by less than this factor stays: the solution would hardly change."""

_BLAMED = 1.5
"""Ratio of seen to assumed noise of another group up to which positions are judged all the same: large errors of
positions raise those of the inertial sensors by as much."""


_OF_GNSS = ("gnss", "gnss speed")
"""The groups of a satellite receiver."""


@dataclass(frozen=True)
class SolvedRun:
    """A run's graph and its solution, with covariances and with the residuals that show its noise."""

    config: SmoothConfig
    declared: Problem
    """As it was built from the recording and the settings, before any reassessment."""
    problem: Problem
    """As it was solved."""
    solution: Solution
    covariance: Covariance
    residuals: dict[str, Residuals]
    """Of each group of factors, at the solution."""
    findings: tuple[Finding, ...] = ()
    """What the reassessors say of the solution."""
    doubts: tuple[Doubt, ...] = ()
    """Which sigmas they would widen, and why."""
    is_changing: bool = False
    """Whether a reassessor has changed the problem since it was solved."""
    judged_before: Problem | None = None
    """As the reassessor that looks at it saw the problem in the round before."""

    @cached_property
    def noise_ratios(self) -> dict[str, float]:
        """Actual over assumed noise of each group that can be judged."""
        return ratios_of(self.residuals)


@dataclass(frozen=True)
class Reassessment:
    """A reassessment is the problem as a reassessor would have it, what it has to say, and whether it changed."""

    problem: Problem
    findings: tuple[Finding, ...] = ()
    doubts: tuple[Doubt, ...] = ()
    changed: bool = False
    far: bool = False
    """Whether the new minimum may be far from the solution, so that convex losses have to lead there first."""


def others_are_worse(noise_ratios: Mapping[str, float], ratio: float) -> bool:
    """Return whether the residuals of a group that is not of GNSS exceed its sigmas by more than ``ratio``.

    It is not GNSS then which is wrong first. ``noise_ratios``: actual over assumed noise of each group.
    """
    worst = max((noise_ratio for name, noise_ratio in noise_ratios.items() if name not in _OF_GNSS), default=1.0)
    return worst > max(_BLAMED, ratio)


Reassessor = Callable[[SolvedRun], Reassessment]
"""Solution and covariance of the run are those of its last solve; its problem may have been changed since by the
reassessors before."""


RunSolver = Callable[[SmoothConfig, Problem, Problem, bool], SolvedRun]
"""``solver(config, declared, problem, far)`` solves a problem from its initial values, near to or far from the minimum;
it was ``declared`` before it was reassessed.
"""


def reassessed(run: SolvedRun, solver: RunSolver, reassessors: Sequence[Reassessor]) -> SolvedRun:
    """Return the run after as many rounds of reassessing and solving as change anything, with findings and doubts.

    The initial values of each further solve are the last solution.
    """
    seen: dict[Reassessor, Problem] = {}
    for rounds_left in reversed(range(run.config.noise.rounds + 1)):
        problem = run.problem
        reassessments: list[Reassessment] = []
        for reassessor in reassessors:
            is_changing, judged_before = any(outcome.changed for outcome in reassessments), seen.get(reassessor)
            seen[reassessor] = problem
            # A local would keep the solution when it is deleted below.
            reassessments.append(
                reassessor(replace(run, problem=problem, is_changing=is_changing, judged_before=judged_before))
            )
            problem = reassessments[-1].problem
        if not rounds_left or not any(outcome.changed for outcome in reassessments):
            break
        config, declared, problem = run.config, run.declared, replace(problem, initial=run.solution.states)
        del run  # its square root and its covariance are as large as the next ones
        run = solver(config, declared, problem, any(outcome.far for outcome in reassessments))
    findings = tuple(finding for outcome in reassessments for finding in outcome.findings)
    return replace(run, findings=findings, doubts=tuple(doubt for outcome in reassessments for doubt in outcome.doubts))
