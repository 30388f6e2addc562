"""``trackfg plot``: the strip chart of a result, or of a part of it."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackfg.cli.options import Level, Limits, LineSpeed, ResultFolder, limit_choice, out_file, refuse_inside
from trackfg.cli.terminal import complain, print_unless_quiet, working
from trackfg.errors import BadInputError, counted
from trackfg.files.atomic_folder import beside

if TYPE_CHECKING:
    from trackfg.geometry.limits import LimitChoice
    from trackfg.plots.strip_chart import LimitLine
    from trackfg.results.result import Result


def plot(
    result: ResultFolder,
    out: Annotated[Path | None, out_file("Picture: .png, .svg or .html. OUT.png if absent.")] = None,
    first: Annotated[
        str | None, typer.Option("--from", metavar="M", help="First chainage, m, or official place, 12+345.")
    ] = None,
    last: Annotated[
        str | None, typer.Option("--to", metavar="M", help="Last chainage, m, or official place, 12+345.")
    ] = None,
    limits: Limits = None,
    level: Level = None,
    line_speed: LineSpeed = None,
) -> None:
    """Draw the strip chart of a result: its geometry over chainage, with bands of 95 %.

    Of a result without track geometry the trajectory over time is drawn.
    """
    from trackfg.plots.draw import picture_path
    from trackfg.plots.strip_chart import plot_geometry
    from trackfg.plots.trajectory_chart import plot_trajectory
    from trackfg.results.result import Result

    path = picture_path(out or beside(result, ".png"))
    refuse_inside(result, path)
    content = Result.read(result)
    choice = limit_choice(limits, level, line_speed)
    from_m, to_m = _range(content, first, last)
    if content.geometry.empty and choice is None and from_m is None and to_m is None:
        with working("chart"):
            plot_trajectory(content, path)
        print_unless_quiet(f"chart of the trajectory, since there is no track geometry: {path}")
        return
    lines = _limit_lines(content, choice)
    with working("chart"):
        plot_geometry(content, path, from_m=from_m, to_m=to_m, limits=lines)
    print_unless_quiet(f"chart: {path}")


def _limit_lines(result: Result, choice: LimitChoice | None) -> list[LimitLine]:
    from trackfg.plots.strip_limits import limit_lines

    if choice is None:
        return []
    lines, left_out = limit_lines(result, choice.table(), choice.line_speed_kmh)
    for reason, number in left_out.items():
        complain(f"trackfg: warning: {counted(number, 'limit')} not drawn: {reason}")
    return lines


def _range(result: Result, first: str | None, last: str | None) -> tuple[float | None, float | None]:
    """Return the chainages of ``--from`` and ``--to``, m: bare numbers, or official places of the result's line.

    Two places may be in either order, since they may fall along the run.
    """
    from_m, to_m = _chainage(result, "--from", first), _chainage(result, "--to", last)
    if from_m is None or to_m is None or _number(first) is not None or _number(last) is not None:
        return from_m, to_m
    return min(from_m, to_m), max(from_m, to_m)


def _number(text: str | None) -> float | None:
    """Return the number that an option states; None where it is absent or states something else."""
    with suppress(ValueError):
        return None if text is None else float(text)
    return None


def _chainage(result: Result, option: str, text: str | None) -> float | None:
    """Return the chainage that an option states, m, by a bare number or by an official place of the result's line."""
    from trackfg.results.official_places import shown_kilometrage

    number = _number(text)
    if text is None or number is not None:
        return number
    line = shown_kilometrage(result, None)
    if line is None:
        hint = "Hint: official places need [kilometrage] in the recording (docs/kilometrage.md)"
        raise BadInputError(f"{option} {text}: expected a chainage in m, such as 12345. {hint}")
    try:
        return line.kilometrage().read(text)
    except ValueError as error:
        raise BadInputError(f"{option}: {error}") from error
