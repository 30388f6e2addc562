"""A run is placed on another run over the same line, section by section, with a sigma each.

The run's sections are recognised on the reference (:mod:`trackfg.mapping.recognition`). They are searched at the place
of the same chainage, to the sigmas of both; where that finds too few, within two kilometres; and at last anywhere. Of
the columns that both tables have, those of one meaning are compared: where another system measured one of the two, its
versines may be of a band alone, so level and alignment in a band are compared instead.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
from trackfg.mapping.recognition.profiles import KINDS
from trackfg.mapping.recognition.recognition import Recognition, recognise
from trackfg.mapping.recognition.warp import Warp, warped
from trackfg.numerics.arrays import Array
from trackfg.results.result import Result

SHIFT_COLUMNS = ("run", "from_m", "to_m", "run_m", "shift_m", "shift_m_sd", "probability")

_SCALE_SD = 5e-3
"""Prior sigma of the scale of one chainage against another, relative: wheels are worn by 1 % at most."""
_FAR_SD_M = 500.0
"""Sigma of the place in the second search, m: chainages of one line that count from different posts."""
_MOST_PLACES = 2e7
"""Sections times metres of reference up to which a run is sought anywhere: half a gigabyte."""
_ENOUGH = 0.5
"""Share of the sections that lie on both runs by their chainages which a search has to find, or the next is tried."""


def aligned(run: Result, reference: Result, name: str, section_m: float) -> tuple[pd.DataFrame, Warp]:
    """Return the shifts of a run over a reference, and the function from its chainage to the reference's.

    The shifts have a row per section, columns :data:`SHIFT_COLUMNS`: the stretch on the reference, the chainage of its
    middle by the run, by how much that is more than by the reference, and the sigma of that. Raises
    :class:`BadInputError` where the run is recognised nowhere on the reference.
    """
    step_m = reference.summary.geometry.step_m
    band_only = run.summary.solver is None or reference.summary.solver is None
    tables = [_compared(result, step_m, band_only=band_only) for result in (run, reference)]
    facts = run.summary.run
    recognition = _recognised(tables[0], tables[1], 1 if facts is None else facts.direction, section_m)
    warp = None if recognition is None else recognition.warp
    if recognition is None or warp is None:
        of_run, of_reference = (f"{t['chainage_m'].iloc[0]:.0f} m to {t['chainage_m'].iloc[-1]:.0f} m" for t in tables)
        raise BadInputError(
            f"{name}: no overlap: its track, {of_run}, is recognised nowhere on that of "
            f"{reference.summary.recording_id}, {of_reference}"
        )
    return _shifts(recognition, name, section_m), warp


def _recognised(run: pd.DataFrame, reference: pd.DataFrame, direction: int, section_m: float) -> Recognition | None:
    """Return what the first search finds that finds enough, else the one that finds most."""
    x, y = run["chainage_m"].to_numpy(), reference["chainage_m"].to_numpy()
    expected = _ENOUGH * (min(x[-1], y[-1]) - max(x[0], y[0])) / section_m
    best: Recognition | None = None
    for place_sd in _searches(run, reference, section_m):
        candidate = recognise(
            run, reference, place_sd_m=place_sd, rate_sd=_SCALE_SD, direction=direction, section_m=section_m
        )
        if candidate.warp is not None and (best is None or len(candidate.used) > len(best.used)):
            best = candidate
        if best is not None and len(best.used) >= max(expected, 2.0):
            break
    return best


def _searches(run: pd.DataFrame, reference: pd.DataFrame, section_m: float) -> Iterator[Array | None]:
    """Yield prior sigmas of the place, the narrowest first; None is anywhere."""
    x, y = run["chainage_m"].to_numpy(), reference["chainage_m"].to_numpy()
    stated = run["chainage_m_sd"].to_numpy()
    of_reference = float(np.median(reference["chainage_m_sd"]))
    near = np.hypot(stated, of_reference)
    if x[0] - y[-1] < 4.0 * near.max() and y[0] - x[-1] < 4.0 * near.max():
        yield near
    if near.max() < _FAR_SD_M and x[0] - y[-1] < 4.0 * _FAR_SD_M and y[0] - x[-1] < 4.0 * _FAR_SD_M:
        yield np.full(len(run), _FAR_SD_M)
    if np.ptp(x) / section_m * np.ptp(y) < _MOST_PLACES:
        yield None


def _compared(result: Result, step_m: float, *, band_only: bool) -> pd.DataFrame:
    """Return the columns of a geometry that runs are compared by, on the reference's step."""
    table = result.geometry_for("laying runs over each other")
    names = [name for kind in KINDS for name in kind if name in table and table[name].notna().any()]
    for quantity in ("level", "alignment"):
        if band_only and f"{quantity}_mm" in names and f"versine_{quantity}_mm" in names:
            names.remove(f"versine_{quantity}_mm")
    sigmas = [f"{name}_sd" for name in names if f"{name}_sd" in table and table[f"{name}_sd"].notna().any()]
    out = table[["chainage_m", "chainage_m_sd", *names, *sigmas]].copy()
    for quantity in ("level", "alignment"):
        left, right = (f"{quantity}_{side}_mm" for side in ("left", "right"))
        if left in table and table[left].notna().any():
            out[f"{quantity}_difference_mm"] = table[left] - table[right]
    if result.summary.geometry.step_m != step_m:
        out = warped(out, Warp(np.zeros(1), np.zeros(1)), step_m)
    return out


def _shifts(recognition: Recognition, name: str, section_m: float) -> pd.DataFrame:
    used = recognition.used
    reference = used["reference_m"].to_numpy()
    return pd.DataFrame(
        {
            "run": name,
            "from_m": reference - 0.5 * section_m,
            "to_m": reference + 0.5 * section_m,
            "run_m": used["run_m"].to_numpy(),
            "shift_m": used["run_m"].to_numpy() - reference,
            "shift_m_sd": used["match_sd_m"].to_numpy(),
            "probability": used["probability"].to_numpy(),
        }
    )
