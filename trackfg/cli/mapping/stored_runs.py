"""Results that a store lists or a map was made of, each read when it is its turn."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from trackfg.errors import BadInputError, first_line
from trackfg.fleet.places import PlaceError, joined, local_files, read
from trackfg.fleet.store import Store
from trackfg.mapping.joining.build import JoinableRun
from trackfg.mapping.joining.joining import place_of_result
from trackfg.maps.feature_map import FeatureMap
from trackfg.results.result import RESULT_FOLDER, Result
from trackfg.results.summary import Summary


def stored_run(place: str) -> JoinableRun:
    """Return the run whose result is at a path or URL. Raises :class:`BadInputError` where none can be read."""
    try:
        summary = Summary.model_validate_json(read(joined(place, RESULT_FOLDER.head)))
    except (OSError, ValueError, PlaceError) as error:
        raise BadInputError(f"{place}: not a readable trackfg result: {first_line(error)}") from error
    return JoinableRun(summary, partial(_read, place), place)


def _read(place: str) -> Result:
    try:
        with local_files(place, RESULT_FOLDER.files) as folder:
            return Result.read(folder)
    except PlaceError as error:
        raise BadInputError(str(error)) from error


def runs_of_store(place: str, line: str | None) -> Iterator[JoinableRun]:
    """Yield the results of a line that a store lists; the line may be None where the store has one."""
    store = Store(place, create=False)
    rows = [row for row in store.read(["run", "status"]) if row["status"] == "done"]
    lines = sorted({row["line"] for row in rows})
    if not lines:
        raise BadInputError(f"{store.place}: has no run with a result; expected one. Hint: trackfg batch adds runs")
    if line is None and len(lines) == 1:
        line = lines[0]
    if line not in lines:
        raise BadInputError(f"{store.place}: has runs of line {', '.join(lines)}: expected one of these as --line")
    for run in sorted(row["run"] for row in rows if row["line"] == line):
        yield stored_run(store.result(run))


def runs_of_map(feature_map: FeatureMap) -> tuple[list[JoinableRun], dict[str, str]]:
    """Return the dated runs of a map whose results are still where they were, and why others are not among them.

    Raises :class:`BadInputError` where there is none.
    """
    runs: list[JoinableRun] = []
    missing = {}
    for run_id, content in zip(feature_map.runs["run_id"], feature_map.runs["content_sha256"], strict=True):
        try:
            run = stored_run(place_of_result(feature_map, run_id))
        except BadInputError as error:
            missing[f"run {run_id}"] = str(error)
            continue
        facts = run.summary.run
        if facts is None or facts.content_sha256 != content:
            missing[f"run {run_id}"] = f"{run.place}: is the result of another run"
        elif facts.start_utc is None:
            missing[f"run {run_id}"] = "its recording has no start"
        else:
            runs.append(run)
    if not runs:
        why = next(iter(missing.values()))
        what = f"map {feature_map.name!r}: no result of its runs can be used: {why}"
        raise BadInputError(f"{what}. Hint: name results of recordings that have a start")
    return runs, missing
