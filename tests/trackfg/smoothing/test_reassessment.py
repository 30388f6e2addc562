"""The loop of solving and reassessing: in which order, how often, and what is left of what was said."""

import weakref
from dataclasses import replace
from typing import Any

from trackfg.config import SmoothConfig
from trackfg.graph.build import Problem
from trackfg.recording.findings import Finding
from trackfg.smoothing.reassessment import Reassessment, Reassessor, SolvedRun, reassessed
from trackfg.smoothing.smoother import smooth_states


def raising(times: int, seen: list[float]) -> Reassessor:
    """Return a reassessor that raises a family's sigma ``times`` times, and notes what it was."""

    def reassessor(run: SolvedRun) -> Reassessment:
        first, *others = run.problem.families
        seen.append(float(first.sigma[0, 0] / run.declared.families[0].sigma[0, 0]))
        again = len(seen) <= times
        problem = replace(run.problem, families=(replace(first, sigma=2.0 * first.sigma), *others))
        return Reassessment(problem, (Finding("info", f"round-{len(seen)}", "seen"),), changed=again)

    return reassessor


def silent(run: SolvedRun) -> Reassessment:
    return Reassessment(run.problem, (Finding("info", "silent", "nothing to change"),))


def test_solves_while_anything_changes_and_keeps_the_last_word(simulated: Any) -> None:
    run = smooth_states(simulated("mainline", duration_s=60.0).recording, SmoothConfig())
    solves: list[bool] = []

    def solver(config: SmoothConfig, declared: Problem, problem: Problem, far: bool) -> SolvedRun:
        solves.append(far)
        return replace(run, config=config, declared=declared, problem=problem)

    seen: list[float] = []
    after = reassessed(run, solver, [raising(2, seen), silent])
    assert seen == [1.0, 2.0, 4.0]
    assert solves == [False, False]
    assert [finding.code for finding in after.findings] == ["round-3", "silent"]
    assert after.problem.families[0].sigma[0, 0] == 4.0 * run.declared.families[0].sigma[0, 0]


def test_a_solution_is_given_up_before_the_next_one_is_made(simulated: Any) -> None:
    """Its square root and its covariance are as large."""
    run, alive = smooth_states(simulated("mainline", duration_s=60.0).recording, SmoothConfig()), []
    solutions: list[weakref.ref[Any]] = []

    def solved() -> SolvedRun:
        solution = replace(run.solution)
        solutions.append(weakref.ref(solution))
        return replace(run, solution=solution)

    def solver(config: SmoothConfig, declared: Problem, problem: Problem, far: bool) -> SolvedRun:
        alive.append(solutions[-1]() is not None)
        return replace(solved(), problem=problem)

    reassessed(solved(), solver, [raising(2, []), silent])
    assert alive == [False, False]


def test_a_reassessor_that_never_rests_is_stopped(simulated: Any) -> None:
    run = smooth_states(simulated("mainline", duration_s=60.0).recording, SmoothConfig())
    seen: list[float] = []
    reassessed(run, lambda config, declared, problem, far: replace(run, problem=problem), [raising(100, seen)])
    assert len(seen) == 4


def test_a_reassessor_is_given_the_problem_as_it_saw_it_in_the_round_before(simulated: Any) -> None:
    run, before = smooth_states(simulated("mainline", duration_s=60.0).recording, SmoothConfig()), []

    def watching(run: SolvedRun) -> Reassessment:
        before.append((run.judged_before, run.problem))
        return Reassessment(run.problem)

    def solver(config: SmoothConfig, declared: Problem, problem: Problem, far: bool) -> SolvedRun:
        return replace(run, problem=problem)

    reassessed(run, solver, [raising(1, []), watching])
    assert before[0][0] is None
    assert before[1][0] is before[0][1]
