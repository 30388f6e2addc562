"""``trackfg noise``: what a log at rest shows of its sensor's noise, as a recording declares it."""

from __future__ import annotations

import json as json_text
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackfg.cli.options import Json, out_file
from trackfg.cli.terminal import note, numbers, progress_bar, show_unless_written, titled
from trackfg.errors import BadInputError

if TYPE_CHECKING:
    from rich.console import RenderableType

    from trackfg.interchange.importing.proposals.questions import Question
    from trackfg.sensors.log_noise import LogNoise


def noise(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Folder of a recording, or a file to import.")],
    out: Annotated[Path | None, out_file("Allan deviations: .csv, .png, .svg or .html.")] = None,
    temperature: Annotated[
        str | None,
        typer.Option(metavar="COLUMN", help="Column of the temperature, degC; by default its name shows it."),
    ] = None,
    json: Json = False,
) -> None:
    """Print what a log at rest shows of its sensor's noise: white noise, bias instability, random walk, temperature.

    The block [imu.noise] for recording.toml is printed too. Where the log is not at rest throughout, its longest rest
    is used.
    """
    from trackfg.interchange.importing.sensor_log import read_sensor_log
    from trackfg.plots.draw import picture_path
    from trackfg.sensors.log_noise import SHORTEST_S, log_noise

    if out is not None and out.suffix not in (".csv", ".png", ".svg", ".html"):
        raise BadInputError(f"{out}: expected a file that ends in .csv, .png, .svg or .html")
    if out is not None and out.suffix != ".csv":
        picture_path(out)
    if not log.exists():
        raise BadInputError(
            f"{log}: no such file or folder; expected a recording or a log, {SHORTEST_S:.0f} s or longer"
        )
    with progress_bar() as progress:
        recording, column = read_sensor_log(log, _assume, temperature)
        try:
            result = log_noise(recording, column, progress=progress)
        except ValueError as error:
            raise BadInputError(f"{log}: {error}") from error
    rest = result.rest
    if not rest.is_whole:
        note(
            f"trackfg: note: the log is not at rest throughout: its longest rest is used, t = {rest.begin_s:.1f} s to "
            f"{rest.end_s:.1f} s ({rest.end_s - rest.begin_s:.0f} s of {rest.whole_s:.0f} s)"
        )
    if out is not None:
        _write(result, out)
    if json:
        print(json_text.dumps(result.as_json(), indent=2))
        return
    show_unless_written(_table(result), result.toml(), written=None if out is None else f"allan: {out}")


def _assume(question: Question) -> str:
    """Take the default, and say so where noise depends on it."""
    if question.key == "imu.gyro_unit":
        note(f"trackfg: note: {question.text}: {question.default} is assumed ({question.key})")
    return question.default


def _write(result: LogNoise, out: Path) -> None:
    from trackfg.files.atomic_file import write_whole
    from trackfg.plots.allan_chart import plot_allan

    if out.suffix == ".csv":
        write_whole(out, result.allan.to_csv(index=False).encode())
    else:
        plot_allan(result.allan, out, title=f"{result.recording_id}: {_length(result)} at rest, with limits of 95 %")


def _length(result: LogNoise) -> str:
    return f"{(result.rest.end_s - result.rest.begin_s) / 3600.0:.2f} h"


def _table(result: LogNoise) -> RenderableType:
    """Return a row per sensor and axis."""
    from trackfg.sensors.log_noise import SENSORS

    headings = ["white noise\nper root Hz", "bias\ninstability", "random walk\nper s and root Hz", "lowest deviation"]
    if result.temperature is not None:
        headings.append("per K")
    title = f"Noise in {_length(result)} at rest, {1.0 / result.rest.dt:.4g} Hz"
    table = titled(title, "", *numbers(*headings))
    for row in result.axes.to_dict("records"):
        cells = [_with_sd(row[name], row[f"{name}_sd"]) for name in ("white", "bias_instability", "bias_walk")]
        at = row["lowest_at_s"]
        cells.append("" if math.isnan(at) else f"{row['lowest']:.3g} at {at:.3g} s")
        if result.temperature is not None:
            cells.append(_with_sd(row["per_kelvin"], row["per_kelvin_sd"]))
        name = f"all, {SENSORS[row['sensor']]}" if row["axis"] == "all" else row["axis"]
        table.add_row(f"{row['sensor']} {name}", *cells, end_section=row["axis"] == "all")
    return table


def _with_sd(value: float, sd: float) -> str:
    if math.isnan(value):
        return ""
    if value == 0.0:
        return "none seen"
    return f"{value:.3g}" + ("" if math.isnan(sd) else f" ± {sd:.1g}")
