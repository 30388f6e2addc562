"""Maps from runs: one run starts a map, every further one is recognised on it and joined.

The steps, with the modules that take them: where the run's profile lies on the map's (``recognition``), its information
on the map's variables (``joining.anchors``), its profile merged into the grid (``joining.merging``), the joint solution
of all runs (``joining.joint_solution``), in which they count as much as they agree (``joining.agreement``), and grid,
landmarks and line moved to that (``joining.finishing``).

The runs in the map are not needed again: their information is kept, and the grid is their weighted mean.

The first runs are joined one after another, the others in blocks that are added up two by two (docs/maps.md). Which
runs are in a block depends on the runs alone: the map is the same to the last bit whoever computes the blocks.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from typing import Any

from trackfg.errors import BadInputError
from trackfg.mapping.joining.agreement import disagreements, in_agreement
from trackfg.mapping.joining.finishing import finished
from trackfg.mapping.joining.joining import Part, joined, part_of_run, run_facts, together
from trackfg.mapping.joining.survey import Survey, reopened
from trackfg.maps.feature_map import FeatureMap
from trackfg.numerics.blas_threads import one_thread
from trackfg.results.result import Result
from trackfg.results.summary import Summary

Progress = Callable[[str, float], None]
Mapped = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]
"""Calls a function with each item, as ``map`` does, here or elsewhere; results come in the order of the items."""
LeaveOut = Callable[[str, BadInputError], None]
"""Called with the id of a recording that is left out, and why; it may raise that."""

_ONE_BY_ONE = 8
"""Runs that are joined one after another: their mean has a third of the noise of one, and shows the others' places
nearly as well as a mean of any number."""
_TWO_OTHERS = 2
"""Runs that do not know the first one and outvote it."""
BLOCK = 8
"""Runs that are condensed together: what is sent about, the survey and a part, is then a third of what they read."""


@dataclass(frozen=True)
class JoinableRun:
    """A run to be joined, which is ``read`` where and when it is, its summary, and the place of its result."""

    summary: Summary
    read: Callable[[], Result]
    place: str | None = None


def _raise(recording_id: str, error: BadInputError) -> None:
    raise error


@dataclass(frozen=True)
class Joining:
    """Settings of how runs are joined: ``progress(what, fraction)`` is called before each, ``mapped`` with what is done
    to blocks.

    ``leave_out`` is called for a run that cannot be joined; without it that is raised. ``warn`` is called with what a
    user should know of a run that was joined.
    """

    progress: Progress = lambda what, done: None
    mapped: Mapped = map
    leave_out: LeaveOut = _raise
    warn: Callable[[str], None] = lambda message: None


def build_map(
    runs: Sequence[Result | JoinableRun], *, name: str, progress: Progress | None = None, joining: Joining | None = None
) -> FeatureMap:
    """Build one map from any number of smoothed runs.

    Parameters
    ----------
    runs
        Results of runs over one line, in either direction.
    name
        That of the line.
    progress
        Called as ``progress(run, fraction)`` before each run.
    joining
        How runs are joined: processes or a cluster; one after the other if None.

    Returns
    -------
    FeatureMap
        Not written yet: :func:`trackfg.maps.write_map` does that.

    Raises
    ------
    BadInputError
        For a run without track geometry, one that is there twice, has other conventions, or is not recognised.

    Examples
    --------
    >>> import trackfg
    >>> from trackfg.mapping import build_map
    >>> build_map([trackfg.Result.read("out1")], name="line")
    <FeatureMap line: not written, 0.296 km, 1 runs, 0 landmarks>
    """
    if not runs:
        raise BadInputError("a map needs at least one run")
    return _with_runs(Survey(name), runs, joining or _joining(progress))


def with_runs(
    feature_map: FeatureMap,
    runs: Sequence[Result | JoinableRun],
    *,
    progress: Progress | None = None,
    joining: Joining | None = None,
) -> FeatureMap:
    """Return a map with more runs.

    Parameters
    ----------
    feature_map
        The map as it is.
    runs
        Results of further runs over the line.
    progress
        Called as ``progress(run, fraction)`` before each run.
    joining
        How runs are joined: processes or a cluster; one after the other if None.

    Returns
    -------
    FeatureMap
        Not written yet: :func:`trackfg.maps.write_map` does that.

    Raises
    ------
    BadInputError
        As :func:`build_map` does.

    Examples
    --------
    >>> import trackfg
    >>> from trackfg.mapping import with_runs
    >>> from trackfg.maps import read_map
    >>> with_runs(read_map("line.gpkg"), [trackfg.Result.read("out1")])
    Traceback (most recent call last):
    trackfg.errors.BadInputError: run mainline-seed1-run0: is in the map already, as mainline-seed1-run0
    """
    return _with_runs(reopened(feature_map), runs, joining or _joining(progress))


def _joining(progress: Progress | None) -> Joining:
    return Joining() if progress is None else Joining(progress)


def _with_runs(survey: Survey, runs: Sequence[Result | JoinableRun], joining: Joining) -> FeatureMap:
    with one_thread():
        known = set(survey.runs)
        waiting = dict(_named(survey, runs, joining.leave_out))
        steps = len(waiting) + 1
        survey, waiting = _in_turn(survey, waiting, lambda run, done: joining.progress(run, done / steps))
        while waiting:
            survey, remaining_ids = _with_blocks(survey, waiting, joining, steps)
            waiting = {run_id: run for run_id, run in waiting.items() if run_id in remaining_ids}
        if survey.grid is None:
            raise BadInputError("no run is left: a map needs at least one")
        for message in survey.doubts.values():
            joining.warn(message)
        joining.progress("landmarks", 1.0 - 1.0 / steps)
        survey, agreement = in_agreement(survey)
        for message in disagreements(survey, agreement, set(survey.runs) - known):
            joining.warn(message)
        return finished(survey)


def _in_turn(survey: Survey, runs: Mapping[str, JoinableRun], show: Progress) -> tuple[Survey, dict[str, JoinableRun]]:
    """Return the survey with the first runs, joined one after another, and the runs that are left.

    A run that begins a survey and that neither of the next two is recognised on is put last: it may be of another line.
    Runs that cannot be joined are left too, since a longer survey may know them.
    """
    empty, waiting, unknown, put_last = survey, deque(runs), list[str](), set[str]()
    while waiting and len(survey.runs) < _ONE_BY_ONE:
        run_id = waiting.popleft()
        show(runs[run_id].summary.recording_id, len(survey.runs) - len(empty.runs))
        try:
            survey = joined(survey, _part(survey, run_id, runs[run_id]))
        except BadInputError:
            unknown.append(run_id)
        outvoted = not empty.runs and len(survey.runs) == 1 and len(unknown) == _TWO_OTHERS
        if outvoted and (first := next(iter(survey.runs))) not in put_last:
            waiting.extendleft(reversed(unknown))
            waiting.append(first)
            put_last.add(first)
            survey, unknown = empty, []
    return survey, {run_id: runs[run_id] for run_id in (*unknown, *waiting)}


def _named(
    survey: Survey, runs: Sequence[Result | JoinableRun], leave_out: LeaveOut
) -> Iterator[tuple[str, JoinableRun]]:
    """Yield runs, each with an id that no other has; those with fixes first, since the others are placed by them."""
    contents = {run.facts.content_sha256: run_id for run_id, run in survey.runs.items()}
    taken, fit = set(survey.runs), []
    for run in runs:
        try:
            fit.append((run_facts(run.summary), run))
        except BadInputError as error:
            leave_out(run.summary.recording_id, error)
    for facts, run in sorted(fit, key=lambda pair: not pair[0].anchored):
        recording_id = run.summary.recording_id
        if (twin := contents.get(facts.content_sha256)) is not None:
            leave_out(recording_id, BadInputError(f"run {recording_id}: is in the map already, as {twin}"))
            continue
        number, run_id = 1, recording_id
        while run_id in taken:
            number += 1
            run_id = f"{recording_id}-{number}"
        taken.add(run_id)
        contents[facts.content_sha256] = run_id
        yield run_id, run if isinstance(run, JoinableRun) else JoinableRun(run.summary, partial(_itself, run))


def _itself(result: Result) -> Result:
    return result


@dataclass(frozen=True)
class _Block:
    """A block holds the ``part`` that its runs add together, None where there is none.

    ``longer``: by id, how many anchors are new in a run that is not in it, since it makes the survey longer. ``lost``:
    by id, why a run cannot be joined.
    """

    part: Part | None
    longer: dict[str, int]
    lost: dict[str, str]


def _with_blocks(
    survey: Survey, waiting: Mapping[str, JoinableRun], joining: Joining, steps: int
) -> tuple[Survey, set[str]]:
    """Return the survey with all runs that do not make it longer and one that does, and the ids of those left.

    Where it was not made longer, runs that cannot be joined are left out.
    """
    runs = list(waiting.items())
    cut = [runs[first : first + BLOCK] for first in range(0, len(runs), BLOCK)]
    blocks: list[_Block] = []
    for block in joining.mapped(partial(_condensed, survey), cut):
        blocks.append(block)
        run_count = len(runs) - BLOCK * len(blocks)
        joining.progress("runs", 1.0 - (max(run_count, 0) + 1) / steps)
    parts = [block.part for block in blocks if block.part is not None]
    while len(parts) > 1:
        parts = list(
            joining.mapped(partial(reduce, together), [parts[first : first + 2] for first in range(0, len(parts), 2)])
        )
    for part in parts:
        survey = joined(survey, part)
    longer = {run_id: anchors for block in blocks for run_id, anchors in block.longer.items()}
    lost = {run_id: why for block in blocks for run_id, why in block.lost.items()}
    if longer:
        longest = max(longer, key=longer.__getitem__)
        survey = joined(survey, _part(survey, longest, waiting[longest]))
        del longer[longest]
        return survey, {*longer, *lost}
    for run_id, why in lost.items():
        joining.leave_out(waiting[run_id].summary.recording_id, BadInputError(why))
    return survey, set()


def _condensed(survey: Survey, runs: Sequence[tuple[str, JoinableRun]]) -> _Block:
    whole: Part | None = None
    longer: dict[str, int] = {}
    lost: dict[str, str] = {}
    with one_thread():
        for run_id, run in runs:
            try:
                part = _part(survey, run_id, run)
            except BadInputError as error:
                lost[run_id] = str(error)
                continue
            if part.makes_longer(survey):
                longer[run_id] = len(part.place)
            else:
                whole = part if whole is None else together(whole, part)
    return _Block(whole, longer, lost)


def _part(survey: Survey, run_id: str, run: JoinableRun) -> Part:
    return part_of_run(survey, run_id, run.read(), run.place)
