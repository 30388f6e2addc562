"""``trackfg check``: everything that is wrong, doubtful or worth knowing in a recording, at once."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from trackfg.checks.contradictions.all_contradictions import diagnose
from trackfg.checks.limits import CheckLimits
from trackfg.io.reader import load
from trackfg.numerics.blas_threads import one_thread
from trackfg.numerics.key_figures import KeyFigures
from trackfg.recording.findings import Finding, errors

__all__ = ["CheckLimits", "CheckReport", "check_recording"]

_ORDER = ("error", "warning", "info")

_NO_CLOCK = ("time-unit", "gap")
"""Errors with which nothing is estimated: the rate is not that of the data, or a clock may have jumped by years."""

_UNTIL_READ = 0.3
"""Share of the time that reading takes, of an hour of the scenario measuring-car."""


@dataclass(frozen=True, repr=False)
class CheckReport(KeyFigures):
    """``findings``, errors first; ``estimates`` as nested mappings ready for JSON, empty if a table or clock is bad.

    Examples
    --------
    >>> import trackfg
    >>> report = trackfg.check_recording("run1")
    >>> len(report.findings)
    0
    >>> round(report.estimates["imu_rate_hz"])
    200
    """

    findings: tuple[Finding, ...]
    estimates: Mapping[str, Any] = field(default_factory=dict)

    def key_figures(self) -> dict[str, str]:
        """Return whether the recording is usable, which findings there are, and how much was estimated."""
        codes = ", ".join(dict.fromkeys(finding.code for finding in self.findings))
        return {
            "recording": "usable" if self.usable else "not usable",
            "findings": f"findings {codes or 'none'}",
            "estimates": f"{len(self.estimates)} estimates",
        }

    @property
    def usable(self) -> bool:
        """Return whether the recording has no error, so that :func:`~trackfg.io.reader.read_recording` reads it."""
        return not errors(self.findings)


@one_thread()
def check_recording(
    path: Path | str, limits: CheckLimits | None = None, *, progress: Callable[[str, float], None] | None = None
) -> CheckReport:
    """Check a recording, and estimate what its data say of sensor, clocks and wheel. Never raises for bad input.

    Parameters
    ----------
    path
        The recording's folder, or its ``recording.toml``.
    limits
        Beyond which values are doubtful, and beyond which they are wrong; the defaults suit a railway vehicle.
    progress
        Called as ``progress(stage, fraction)`` when the stages "reading" and "checking" begin.

    Returns
    -------
    CheckReport
        Every finding, errors first, and the estimates.

    Raises
    ------
    TypeError
        For anything but a path: a recording in memory is written first.

    Examples
    --------
    >>> import trackfg
    >>> report = trackfg.check_recording("run1")
    >>> report.usable
    True
    >>> trackfg.check_recording("no-such-run").findings[0].message
    'no such folder'
    """
    if not isinstance(path, str | os.PathLike):
        raise TypeError(
            "check_recording takes the folder of a recording, as trackfg.write_recording(recording, folder) writes it, "
            f"not {type(path).__name__}"
        )
    limits, begin = limits or CheckLimits(), progress or (lambda stage, done: None)
    begin("reading", 0.0)
    loaded = load(path, limits)
    findings = list(loaded.findings)
    estimates: Mapping[str, Any] = {}
    has_clock = not any(finding.code in _NO_CLOCK for finding in errors(findings))
    if loaded.recording is not None and has_clock:
        begin("checking", _UNTIL_READ)
        values, disagreements = diagnose(loaded.recording, limits)
        findings += disagreements
        estimates = values.as_dict()
    findings.sort(key=lambda finding: _ORDER.index(finding.level))
    return CheckReport(tuple(findings), estimates)
