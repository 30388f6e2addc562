"""``trackfg check``: everything that is wrong, doubtful or worth knowing in a recording, at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from trackfg.checks import imu_channels
from trackfg.checks.columns import ColumnPlace
from trackfg.checks.diagnosis import diagnose
from trackfg.checks.limits import CheckLimits
from trackfg.io.reader import load
from trackfg.recording.findings import Finding, errors
from trackfg.recording.model import Recording

__all__ = ["CheckLimits", "CheckReport", "check_recording"]

_ORDER = ("error", "warning", "info")


@dataclass(frozen=True)
class CheckReport:
    """``findings``, errors first; ``estimates`` as nested mappings ready for JSON, empty if a table is unusable."""

    findings: tuple[Finding, ...]
    estimates: Mapping[str, Any] = field(default_factory=dict)

    @property
    def usable(self) -> bool:
        """Return whether the recording has no error, so that :func:`~trackfg.io.reader.read_recording` reads it."""
        return not errors(self.findings)


def check_recording(path: Path | str, limits: CheckLimits | None = None) -> CheckReport:
    """Check the recording in the folder ``path``, or described by the file ``path``. Never raises for bad input."""
    limits = limits or CheckLimits()
    loaded = load(path, limits)
    found = list(loaded.findings)
    estimates: Mapping[str, Any] = {}
    if loaded.recording is not None:
        found += _fix_order(loaded.recording)
        found += imu_channels.findings(loaded.recording.description.imu, loaded.recording.imu, limits)
        if not any(f.code == "time-unit" for f in errors(found)):  # no rate, no estimate
            values, disagreements = diagnose(loaded.recording, limits)
            found += disagreements
            estimates = values.as_dict()
    found.sort(key=lambda finding: _ORDER.index(finding.level))
    return CheckReport(tuple(found), estimates)


def _fix_order(recording: Recording) -> list[Finding]:
    """Fixes whose chainages run against the declared direction."""
    fixes, part = recording.fixes, recording.description.fixes
    if fixes is None or part is None or recording.tach is None or recording.description.tach is None:
        return []
    if recording.description.tach.signed:
        return []
    steps = recording.description.track.direction * fixes["chainage_m"].diff()
    against = (steps < -3.0 * fixes["chainage_sd_m"]).to_numpy()
    if not against.any():
        return []
    i = int(against.argmax())
    message = f"chainage runs against track.direction = {recording.description.track.direction}"
    if (count := int(against.sum())) > 1:
        message += f" ({count} such rows)"
    hint = "set track.direction = -1 if chainage falls along this run, or sort out the mixed-up fix"
    if recording.description.track.direction == -1:
        hint = hint.replace("-1", "1").replace("falls", "grows")
    place = ColumnPlace(part.file, part.chainage, fixes["t_s"].to_numpy())
    return [place.at_row("warning", "fix-order", message, i, expected="chainages in the order of the run", hint=hint)]
