"""The window solver brings the window of a relinearisation pass near its minimum.

It takes Gauss-Newton steps until one is short. Where four do not settle, the damped batch solver
(:mod:`trackfg.solver.gauss_newton`) solves the window from its own states. Where the wheel is doubted it does so too,
beginning with all rows trusted, and the cheaper of the two solutions is kept.

Until the heading is known, undamped steps often do not settle. Rows that contradict each other, as in random order,
never determine a heading, and the batch solver begins far from a minimum each time: its work on one window is bounded,
and a window that needs more is lost.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from trackfg.config import SolverConfig
from trackfg.errors import UnsolvableError
from trackfg.numerics.arrays import Array
from trackfg.output.trajectory import QUANTITIES, keyframe_variances
from trackfg.results.events import Event
from trackfg.solver.covariance import posterior_covariance
from trackfg.solver.gauss_newton import solve
from trackfg.streaming.window.window import FAILURES, Window, WindowStep

SETTLED = 15.0
"""Maximum length, in posterior sigmas, of a step that needs no second one: what is left after it is a tenth or less."""
_HEADING_SD_RAD = 0.03
"""Maximum sigma of yaw with which the heading is known, rad."""
_MOST_DAMPED = 50_000
"""Steps that the batch solver tries, times keyframes, in all, that a window is given to determine its heading. One
takes some 0.13 ms, so these take 7 s. The simulated lines that need any need 400 to 19,500.
"""
_MOVED_M = 5.0
"""Way from the first keyframe of a window, m, from which on others determine the heading: those at rest cannot."""
_DAMPED_BEFORE = 0.5
"""Share of such work that counts in the next window, where the heading stayed unknown. The 25,000 that are left for
that one are still enough for the simulated lines.
"""


@dataclass
class WindowSolver:
    """The solver of one running window.

    ``heading_known`` stays once it is; ``damped``: the batch solver has taken over before it was, which is one event;
    ``damped_work``: the steps it tried until then, times the keyframes of each, with a share of those of lost windows.
    """

    heading_known: bool = False
    damped: bool = False
    damped_work: int = 0

    def settle(
        self, window: Window, config: SolverConfig, marginalise: Collection[int], failure: str | None = None
    ) -> tuple[WindowStep, Event | None]:
        """Return the window after its step, or after what had to take over, and the event of that.

        ``marginalise``: numbers of first keyframes that may be marginalised after it; ``failure``: why the recent
        keyframes could not take their step. Raises one of :data:`~trackfg.streaming.window.window.FAILURES`.
        """
        now = float(window.t[-1])
        if failure is not None and not self.heading_known:  # undamped steps would not settle here either
            event = None if self.damped else Event("by-batch", t_s=now, detail=failure)
            self.damped = True
            return self._batch_solution(window, config).gauss_newton_step(marginalise), event
        event = None if failure is None else Event("by-window", t_s=now, detail=failure)
        try:
            step = window.settled_step(marginalise, SETTLED)
        except FAILURES as error:
            event = Event("by-batch", t_s=now, detail=str(error))
            return self._batch_solution(window, config).gauss_newton_step(marginalise), event
        if step.window.suspects_slip:
            step = self._cheaper_by_batch(window, config, step, marginalise)
        return step, event

    def finds_heading(self, step: WindowStep, lever_arm: Array) -> bool:
        """Return whether the heading is known from this step on; ``lever_arm`` (3,) is that of the IMU, m."""
        if self.heading_known:
            return False
        covariance = posterior_covariance(step.root.last(1))
        variances = keyframe_variances(step.window.states.take(slice(-1, None)), covariance, lever_arm)
        self.heading_known = bool(np.sqrt(variances[0, QUANTITIES.index("yaw_rad")]) < _HEADING_SD_RAD)
        return self.heading_known

    @property
    def damped_work_after(self) -> int:
        """The batch solver's work that counts in the window after this one, should it be lost."""
        return 0 if self.heading_known else int(_DAMPED_BEFORE * self.damped_work)

    def _cheaper_by_batch(
        self, window: Window, config: SolverConfig, step: WindowStep, marginalise: Collection[int]
    ) -> WindowStep:
        """Return the step at the window's batch solution where that exists and costs less, else the ``step`` taken."""
        try:
            batch = self._batch_solution(window, config)
            return batch.gauss_newton_step(marginalise) if batch.cost < step.window.cost else step
        except FAILURES:
            return step

    def _batch_solution(self, window: Window, config: SolverConfig) -> Window:
        """Return the window solved by the damped batch solver, from its own states.

        Raises ``UnsolvableError`` where that has been done too often while the heading is unknown.
        """
        if not self.heading_known and self.damped_work >= _MOST_DAMPED:
            raise UnsolvableError(
                f"the heading is unknown after {len(window)} keyframes: their rows contradict each other"
            )
        solution = solve(window, config)
        if not self.heading_known:
            distance = solution.states.odo.distance
            self.damped_work += solution.trials * int(np.sum(np.abs(distance - distance[0]) > _MOVED_M))
        solved = replace(window, states=solution.states)
        return self._right_way_round(solved, config) if solved.states.is_mounted_backwards else solved

    def _right_way_round(self, window: Window, config: SolverConfig) -> Window:
        """Return the solved window, or that with the other end of the vehicle ahead, whichever costs less.

        From a wrong heading the solver may end in a minimum in which the vehicle runs backwards with its mounting half
        a turn off: positions and inertial sensor agree with that, and the wheel slips all the way.
        """
        turned = replace(window, states=window.states.turned_round())
        try:
            turned = replace(turned, states=solve(turned, config).states)
        except FAILURES:
            return window
        return turned if turned.cost < window.cost else window
