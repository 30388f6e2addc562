"""What a tachometer on a second axle gains: error of the distance between fixes, with one tach and with two.

Usage: ``python tools/two_axles.py [--seeds N] [--duration S]``. The scenario ``slippery-line-two-axles`` is simulated
as it is (wet) and under leaves, where wheels slip more often; slips of the two axles are drawn independently. A third
world is wet for the first axle and dry for the second, which never slips there: no search for slips can gain more. From
the error of the distance at the keyframes a straight line through its values at two successive fixes is taken off: what
is left is the error between them.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from trackfg.config import SmoothConfig
from trackfg.datasets.scenario import Scenario
from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.datasets.sensors.further_axle import FurtherAxle
from trackfg.datasets.vehicle.adhesion import AdhesionModel
from trackfg.recording.model import Recording
from trackfg.smoothing.smoother import smooth_states


def one_axle(recording: Recording) -> Recording:
    """Return the recording without the second tach."""
    description = recording.description.model_copy(update={"further_tach": ()})
    return replace(recording, description=description, others={})


def under_leaves(plan: Scenario) -> Scenario:
    """Return the scenario with the adhesion of ``slippery-line-leaves``, for both axles."""
    adhesion = scenario("slippery-line-leaves").adhesion
    return replace(with_second_on(plan, adhesion), adhesion=adhesion)


def with_second_on(plan: Scenario, adhesion: AdhesionModel | None) -> Scenario:
    """Return the scenario with another adhesion for the second axle."""
    (axle,) = plan.further_sensors
    assert isinstance(axle, FurtherAxle)
    return replace(plan, further_sensors=(replace(axle, adhesion=adhesion),))


def sections(run: Simulation, recording: Recording) -> Iterator[tuple[bool, np.ndarray]]:
    """Yield whether the first axle slipped between two fixes, and the errors there, m."""
    smoothed = smooth_states(recording, SmoothConfig())
    t = smoothed.problem.t
    error = smoothed.solution.states.odo.distance - np.interp(t, run.truth["t_s"], run.truth["chainage_m"])
    assert recording.fixes is not None
    assert run.slips is not None
    fixes = recording.fixes["t_s"].to_numpy()
    for begin, end in pairwise(fixes):
        inside = (t >= begin) & (t <= end)
        if inside.sum() > 2:
            slipped = ((run.slips["start_s"] < end) & (run.slips["end_s"] > begin)).any()
            line = np.interp(t[inside], [begin, end], np.interp([begin, end], t, error))
            yield bool(slipped), error[inside] - line


def main(arguments: list[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--duration", type=float, default=600.0)
    options = parser.parse_args(arguments)
    wet = scenario("slippery-line-two-axles")
    plans = {"wet": wet, "leaves": under_leaves(wet), "second dry": with_second_on(wet, AdhesionModel())}
    print(f"{'rails':12}{'sections':>10}{'of them':>10}{'one tach, rms m':>18}{'two tachs, rms m':>18}{'ratio':>8}")
    for name, plan in plans.items():
        errors: dict[tuple[int, bool], list[np.ndarray]] = {}
        for seed in range(1, options.seeds + 1):
            run = simulate(plan, seed=seed, duration_s=options.duration)
            for tachs, recording in ((1, one_axle(run.recording)), (2, run.recording)):
                for slipped, error in sections(run, recording):
                    errors.setdefault((tachs, slipped), []).append(error)
        for slipped, words in ((True, "slipped"), (False, "rolled")):
            if (1, slipped) not in errors:
                continue
            single, double = (float(np.sqrt(np.mean(np.concatenate(errors[tachs, slipped]) ** 2))) for tachs in (1, 2))
            count = len(errors[1, slipped])
            print(f"{name:12}{count:10d}{words:>10}{single:18.3f}{double:18.3f}{double / single:8.2f}", flush=True)
    return 0
