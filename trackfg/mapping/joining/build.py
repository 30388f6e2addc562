"""Maps from runs: one run starts a map, every further one is recognised on it and joined.

The steps, with the modules that take them: where the run's profile lies on the map's (``recognition``), its information
on the map's variables (``joining.anchors``), its profile merged into the grid (``joining.merging``), the joint solution
of all runs (``joining.joint_solution``), and grid, landmarks and line moved to that (``joining.finishing``).

The runs in the map are not needed again: their information is kept, and the grid is their weighted mean.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from trackfg.errors import BadInputError
from trackfg.mapping.joining.finishing import finished
from trackfg.mapping.joining.joining import joined, run_facts
from trackfg.mapping.joining.survey import Survey, reopened
from trackfg.maps.feature_map import FeatureMap
from trackfg.results.result import Result

Progress = Callable[[str, float], None]


def build_map(results: Sequence[Result], *, name: str, progress: Progress | None = None) -> FeatureMap:
    """Build one map from any number of smoothed runs.

    ``progress(run, fraction)`` is called before each. Raises :class:`~trackfg.errors.BadInputError` for a run without
    track geometry, one that is there twice, has other conventions, or is not recognised.
    """
    if not results:
        raise BadInputError("a map needs at least one run")
    return _with_runs(Survey(name), results, progress)


def with_runs(feature_map: FeatureMap, results: Sequence[Result], *, progress: Progress | None = None) -> FeatureMap:
    """Return the map with more runs. Raises as :func:`build_map`."""
    return _with_runs(reopened(feature_map), results, progress)


def _with_runs(survey: Survey, results: Sequence[Result], progress: Progress | None) -> FeatureMap:
    """Join runs with fixes first, since the others are placed by them."""
    show = progress or (lambda what, done: None)
    for number, result in enumerate(sorted(results, key=lambda result: not run_facts(result).anchored)):
        show(result.summary.recording_id, number / (len(results) + 1))
        survey = joined(survey, result)
    show("landmarks", len(results) / (len(results) + 1))
    return finished(survey)
