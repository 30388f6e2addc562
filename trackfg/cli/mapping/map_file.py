"""Maps in files and databases: started there, or extended by more runs.

Runs are results, recordings, or all results of a line in a store. Concurrent writers are serialised: on a version
conflict the newest map is read again and the runs are joined to that.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path

from trackfg.cli.mapping.stored_runs import runs_of_store, stored_run
from trackfg.cli.terminal import complain
from trackfg.config import SmoothConfig
from trackfg.errors import BadInputError, printable
from trackfg.files.owned_folder import refuse_unwritable
from trackfg.fleet.machine import processes
from trackfg.fleet.store_head import is_store
from trackfg.fleet.workers import mapped_here, mapped_on_cluster
from trackfg.io.reader import read_recording
from trackfg.mapping.joining.build import BLOCK, JoinableRun, Joining, Mapped, build_map, with_runs
from trackfg.maps.feature_map import FeatureMap
from trackfg.maps.location import locate
from trackfg.maps.store import MapConflictError, newest_version, read_map, write_map
from trackfg.results.result import RESULT_FOLDER, Result
from trackfg.smoothing.smoother import smooth

Progress = Callable[[str, float], None]
Runs = Sequence[Result | JoinableRun]

_MEMORY_BYTES = 1_000_000_000
"""Memory that a process needs to condense runs: 0.6 GB were measured with 5 km, of which libraries are a half."""


@dataclass(frozen=True)
class FleetRuns:
    """The runs of a store that are joined to a map, those of ``line``, and where that is computed.

    ``scheduler``: on its cluster; None for this machine, in ``jobs`` processes, None for as many as fit.
    """

    line: str | None = None
    jobs: int | None = None
    scheduler: str | None = None


def build_map_file(
    places: Sequence[str | os.PathLike[str]],
    location: str | os.PathLike[str],
    *,
    name: str | None = None,
    config: SmoothConfig | None = None,
    fleet: FleetRuns | None = None,
    progress: Progress | None = None,
) -> FeatureMap:
    """Join runs, results or recordings (which are smoothed first), to the map at ``location``, or start one there.

    A place may be a store too: then its runs that are in the map already are passed over, and those that cannot be
    joined are named on standard error. Returns the version written, or the newest where there is nothing to add.
    ``name`` is the line's, for a new map; if absent, that of the file or of the database schema. Raises
    :class:`~trackfg.errors.BadInputError` as :func:`trackfg.mapping.joining.build.build_map` and where a name is given
    for a map that has another.
    """
    place, fleet = locate(location), fleet or FleetRuns()
    newest = newest_version(location)
    if newest is not None and name is not None and (stored_name := read_map(location).name) != name:
        raise BadInputError(f"{place.shown}: is the map {stored_name!r}; expected no other name, or another place")
    if newest is None and place.path is not None:
        refuse_unwritable(place.path)
    show = progress or (lambda what, done: None)
    stores = [str(given) for given in places if is_store(str(given))]
    if fleet.line is not None and not stores:
        raise BadInputError("--line chooses among the runs of a store: expected one")
    recordings = [Path(given) for given in places if str(given) not in stores]
    share = 0.9 * len(recordings) / max(len(places), 1)
    given = [
        _result(folder, config, show, share * i / len(recordings), share / len(recordings))
        for i, folder in enumerate(recordings)
    ]
    stored = [run for store in stores for run in runs_of_store(store, fleet.line)]
    while True:
        newest = newest_version(location)
        old_map = None if newest is None else read_map(location, newest)
        contents = set() if old_map is None else set(old_map.runs["content_sha256"])
        added = [run for run in stored if run.summary.run is None or run.summary.run.content_sha256 not in contents]
        runs: Runs = [*given, *added]
        if not runs and old_map is not None:
            return old_map
        with _mapped(fleet, len(runs)) as mapped:
            joining = Joining(lambda what, done: show(what, share + (1.0 - share) * done), mapped, warn=_warn)
            if stores:
                joining = replace(joining, leave_out=_name)
            if old_map is None:
                built = build_map(runs, name=name or place.name, joining=joining)
            else:
                built = with_runs(old_map, runs, joining=joining)
                if len(built.runs) == len(old_map.runs):
                    return old_map  # of a store, each run was left out
        if place.path is not None:
            place.path.parent.mkdir(parents=True, exist_ok=True)
        try:
            return write_map(built, location, parent=newest)
        except MapConflictError:
            continue


def _mapped(fleet: FleetRuns, runs: int) -> AbstractContextManager[Mapped]:
    if runs > BLOCK and fleet.scheduler is not None:
        return mapped_on_cluster(fleet.scheduler)
    return mapped_here(max(1, min(fleet.jobs or processes(_MEMORY_BYTES), runs // BLOCK)))


def _name(recording_id: str, error: BadInputError) -> None:
    _warn(f"left out: {error}")


def _warn(message: str) -> None:
    complain(f"trackfg: warning: {printable(message)}")


def _result(
    folder: Path, config: SmoothConfig | None, show: Progress, start: float, share: float
) -> Result | JoinableRun:
    if RESULT_FOLDER.holds(folder):
        return stored_run(os.path.abspath(folder))
    return smooth(
        read_recording(folder),
        config,
        progress=lambda stage, done: show(f"{folder.name}: {stage}", start + share * done),
    )
