"""Balises with known places are fixes to the smoother; what a run says of all of them is surveyed after it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from trackfg.recording.description import Fixes
from trackfg.recording.findings import Finding
from trackfg.recording.model import FIX_COLUMNS, Recording

if TYPE_CHECKING:
    from trackfg.mapping.runs.balise_survey import BaliseSurvey

_NAMED = 5
"""So many balises are named in a finding; the table has all."""


def with_balise_fixes(recording: Recording) -> Recording:
    """Return the recording with a fix for every passage of a balise whose place is known.

    Its sigma is that of the place and of the reading together. A place that is passed n times errs n times alike, which
    n fixes do not know of each other: so its variance counts n-fold in each, and once in all together.
    """
    passages, part = recording.balises, recording.description.balises
    if passages is None or part is None:
        return recording
    complete = passages.dropna()
    if complete.empty:
        return recording
    passes = complete.groupby("id")["id"].transform("size")
    sd = np.hypot(np.sqrt(passes) * complete["chainage_sd_m"], part.reading_sd_m)
    of_balises = complete.assign(chainage_sd_m=sd)[list(FIX_COLUMNS)]
    fixes = of_balises if recording.fixes is None else pd.concat([recording.fixes, of_balises])
    described = recording.description.fixes or Fixes(file=part.file, time=part.time, time_offset_s=part.time_offset_s)
    return replace(
        recording,
        fixes=fixes.sort_values("t_s", kind="stable", ignore_index=True),
        description=recording.description.model_copy(update={"fixes": described}),
    )


def balise_findings(survey: BaliseSurvey) -> tuple[Finding, ...]:
    """Return findings where a balise is not where it is planned, and where a passage was misread."""
    table, findings = survey.table, []
    wrong = table[table["verdict"].isin(("wrong", "undecided"))]
    if len(wrong):
        rows = wrong[["id", "difference_m", "difference_m_sd", "verdict"]].to_numpy().tolist()
        sure = ("", " (this or another)")
        named = [f"{one} by {off:+.2f} m (sigma {sd:.2g} m){sure[word != 'wrong']}" for one, off, sd, word in rows]
        message = f"{len(wrong)} of {len(table)} balises are not where they are planned: {_first(named)}"
        hint = "compare the plan with the line's register; balises.csv has all"
        findings.append(Finding("warning", "balises-wrong", message, hint=hint))
    if len(survey.misread):
        rows = survey.misread[["id", "t_s", "off_m"]].to_numpy().tolist()
        named = [f"{one} at {t:.1f} s ({off:+.1f} m)" for one, t, off in rows]
        message = f"{len(named)} passages contradict other passages of the same balise: {_first(named)}"
        findings.append(Finding("warning", "balises-misread", message, hint="look whether an id was read wrongly"))
    return tuple(findings)


def _first(named: list[str]) -> str:
    more = f" and {len(named) - _NAMED} more" if len(named) > _NAMED else ""
    return ", ".join(named[:_NAMED]) + more
