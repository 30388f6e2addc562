"""Maps from runs: one run starts a map, every further one is recognised on it and joined.

run -> where its profile lies on the map's (``recognition``) -> what it says of the map's variables (``marks``), and its
profile merged into the grid (``merging``) -> the joint solution of all runs (``joint``) -> grid moved to it, landmarks,
line

The runs that are in the map already are not needed again: what they said of the variables is kept, and the grid is
their weighted mean.
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
    """One map from any number of smoothed runs.

    ``progress(run, fraction)`` is called before each. Raises :class:`~trackfg.errors.BadInputError` for a run that says
    nothing of the track, is there twice, has other conventions, or is not recognised.
    """
    if not results:
        raise BadInputError("a map needs at least one run")
    return _with_runs(Survey(name), results, progress)


def with_runs(feature_map: FeatureMap, results: Sequence[Result], *, progress: Progress | None = None) -> FeatureMap:
    """The map with more runs. Raises as :func:`build_map`."""
    return _with_runs(reopened(feature_map), results, progress)


def _with_runs(survey: Survey, results: Sequence[Result], progress: Progress | None) -> FeatureMap:
    """Those that fixes told where they were come first: the others are placed by them."""
    show = progress or (lambda what, done: None)
    for number, result in enumerate(sorted(results, key=lambda result: not run_facts(result).anchored)):
        show(result.summary.recording_id, number / (len(results) + 1))
        survey = joined(survey, result)
    show("landmarks", len(results) / (len(results) + 1))
    return finished(survey)
