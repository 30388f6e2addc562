"""Contradictions of a recording and its description go into the result: no wrong recording is smoothed in silence.

The findings are those of :mod:`trackfg.checks.contradictions`, which ``trackfg check`` lists. Those that no state of
the graph can make up for are doubts about what they spoil; a scale, a bias, a noise level or an offset of a clock is
estimated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from trackfg.checks.contradictions.all_contradictions import contradictions
from trackfg.checks.diagnosis import estimates_of
from trackfg.checks.limits import CheckLimits
from trackfg.recording.findings import Finding
from trackfg.recording.model import Recording
from trackfg.results.verdict import QUANTITIES, Doubt, Quantity

PLACE: tuple[Quantity, ...] = ("chainage", "position", "speed")
"""What a wrong place spoils."""

SPOILED: dict[str, tuple[Quantity, ...]] = {
    "forward-axis": QUANTITIES,
    "gyro-sign": QUANTITIES,
    "gyro-columns": QUANTITIES,
    "gyro-scale": QUANTITIES,
    "accel-sign": QUANTITIES,
    "accel-columns": QUANTITIES,
    "speed-scale": QUANTITIES,
    "tach-silent": QUANTITIES,
    "tach-absent": QUANTITIES,
    "gnss-mirrored": (*PLACE, "yaw"),
    "fix-unit": PLACE,
    "direction": ("chainage", "cross_level", "twist", "level", "alignment", "curvature", "gradient"),
}
"""The quantities that each finding makes untrustworthy, by its code."""


_ESTIMATED = ("mounting",)
"""Findings of which a result has its own, with the estimate of the whole run (:mod:`trackfg.smoothing.wide_priors`)."""
_HINT = "cut the recording to the time in which the tach has rows"


def recording_findings(recording: Recording, limits: CheckLimits) -> tuple[Finding, ...]:
    """Return the errors and warnings that ``trackfg check`` has for the contents, but for what is estimated."""
    findings = contradictions(recording, estimates_of(recording), limits)
    return tuple(finding for finding in findings if finding.level != "info" and finding.code not in _ESTIMATED)


def recording_doubts(recording: Recording, findings: Sequence[Finding]) -> tuple[Doubt, ...]:
    """Return what the findings make untrustworthy; an absent tach spoils nothing where another sensor has the speed."""
    has_speed = recording.gnss is not None or len(recording.others) > 0
    return tuple(
        Doubt(SPOILED[finding.code], math.inf, finding.sentence, finding.hint or _HINT)
        for finding in findings
        if finding.code in SPOILED and not (finding.code == "tach-absent" and has_speed)
    )
