"""``trackfg demo``: the whole story on input that is there wherever trackfg is installed.

A measuring car runs over a line for ten minutes, with an inertial sensor, a tachometer and displacement sensors over
the rails. Its recording is smoothed; the published systems run on it too, and all are held against the simulated truth.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from trackfg.comparison.run import cases_of, compare
from trackfg.comparison.table import Comparison
from trackfg.datasets.scenarios import simulate
from trackfg.errors import BadInputError
from trackfg.files.atomic_folder import replaced_folder
from trackfg.files.libraries import library
from trackfg.files.owned_folder import refuse_unwritable
from trackfg.io.reader import read_recording
from trackfg.plots.strip_chart import plot_geometry
from trackfg.report import write_report
from trackfg.results.result import Result
from trackfg.smoothing.smoother import smooth

SCENARIO, SEED, DURATION_S = "measuring-car", 0, 600.0
"""What the demo simulates: a scenario, its seed, and how long, s."""

RECORDING, RESULT, PICTURE, RESULT_PAGE, COMPARISON, COMPARISON_PAGE = CONTENT = (
    "recording",
    "result",
    "strip-chart.png",
    "result.html",
    "comparison",
    "comparison.html",
)

_UNTIL_SMOOTHED = 0.4
"""Share of the time."""


@dataclass(frozen=True)
class Demo:
    """``folder`` holds :data:`CONTENT`."""

    folder: Path
    result: Result
    comparison: Comparison


def run_demo(folder: str | os.PathLike[str], *, progress: Callable[[str, float], None] | None = None) -> Demo:
    """Simulate, smooth, compare, and write recording, result, comparison, picture and pages into ``folder``.

    An earlier demo there is replaced in one step. Raises :class:`BadInputError` if the folder holds anything else.
    """
    folder = Path(folder)
    for drawing in ("matplotlib", "plotly"):
        library(drawing, "charts")
    refuse_unwritable(folder)
    _refuse_foreign_folder(folder)
    show = progress or (lambda stage, done: None)
    with replaced_folder(folder) as new:
        show("simulation", 0.0)
        simulate(SCENARIO, seed=SEED, duration_s=DURATION_S).write(new / RECORDING)
        result = smooth(read_recording(new / RECORDING), progress=lambda stage, _: show(stage, 0.0))
        result.write(new / RESULT)
        plot_geometry(result, new / PICTURE)
        with contextlib.chdir(new):  # a page says how it was made: by a command to be given in the demo's folder
            write_report(Path(RESULT), Path(RESULT_PAGE), recording=Path(RECORDING))
        comparison = compare(
            cases_of([new / RECORDING]),
            peers=False,
            progress=lambda stage, done: show(stage, _UNTIL_SMOOTHED + (1.0 - _UNTIL_SMOOTHED) * done),
        )
        comparison.write(new / COMPARISON)
        with contextlib.chdir(new):
            write_report(Path(COMPARISON), Path(COMPARISON_PAGE))
    return Demo(folder, result, comparison)


def _refuse_foreign_folder(folder: Path) -> None:
    if not folder.exists():
        return
    foreign = not folder.is_dir() or {path.name for path in folder.iterdir()} - set(CONTENT)
    if foreign:
        raise BadInputError(f"{folder}: exists and is not an earlier demo; it is left alone: choose another folder")
