"""Maps in files and databases: started there, or extended by more runs.

Concurrent writers are serialised: on a version conflict the newest map is read again and the runs are joined to that.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path

from trackfg.config import SmoothConfig
from trackfg.errors import BadInputError
from trackfg.io.reader import read_recording
from trackfg.mapping.joining.build import build_map, with_runs
from trackfg.maps.feature_map import FeatureMap
from trackfg.maps.location import locate
from trackfg.maps.store import MapConflictError, newest_version, read_map, write_map
from trackfg.results.result import RESULT_FOLDER, Result
from trackfg.smoothing.smoother import smooth

Progress = Callable[[str, float], None]


def build_map_file(
    folders: Sequence[Path],
    location: str | os.PathLike[str],
    *,
    name: str | None = None,
    config: SmoothConfig | None = None,
    progress: Progress | None = None,
) -> FeatureMap:
    """Join runs, results or recordings (which are smoothed first), to the map at ``location``, or start one there.

    Returns the version written. ``name`` is the line's, for a new map; if absent, that of the file or of the database
    schema. Raises :class:`~trackfg.errors.BadInputError` as :func:`trackfg.mapping.joining.build.build_map` and where a
    name is given for a map that has another.
    """
    place = locate(location)
    newest = newest_version(location)
    if newest is not None and name is not None and (stored_name := read_map(location).name) != name:
        raise BadInputError(f"{place.shown}: is the map {stored_name!r}; expected no other name, or another place")
    show = progress or (lambda what, done: None)
    share = 0.9
    results = [
        _result(folder, config, show, share * i / len(folders), share / len(folders))
        for i, folder in enumerate(folders)
    ]

    def joining(what: str, done: float) -> None:
        show(what, share + (1.0 - share) * done)

    while True:
        newest = newest_version(location)
        if newest is None:
            joined = build_map(results, name=name or place.name, progress=joining)
        else:
            joined = with_runs(read_map(location, newest), results, progress=joining)
        try:
            return write_map(joined, location, parent=newest)
        except MapConflictError:
            continue


def _result(folder: Path, config: SmoothConfig | None, show: Progress, start: float, share: float) -> Result:
    if RESULT_FOLDER.holds(folder):
        show(folder.name, start)
        return Result.read(folder)
    return smooth(
        read_recording(folder),
        config,
        progress=lambda stage, done: show(f"{folder.name}: {stage}", start + share * done),
    )
