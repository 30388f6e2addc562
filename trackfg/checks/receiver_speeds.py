"""Speeds of a satellite receiver in another unit than is declared."""

from __future__ import annotations

import numpy as np

from trackfg.checks.diagnosis_wheel import WheelScale
from trackfg.checks.limits import CheckLimits
from trackfg.checks.sizes import is_ratio_of_units
from trackfg.numerics.units import KMH, KNOT, MPH, known_units, to_si
from trackfg.recording.description import GnssSpeed
from trackfg.recording.findings import Finding

_SPEED_UNITS = {"m/s": 1.0, "km/h": KMH, "kn": KNOT, "mph": MPH, "mm/s": 1e-3, "cm/s": 1e-2}
"""Units in which receivers write their speed, m/s: NMEA has knots, UBX mm/s."""


def receiver_speed_findings(part: GnssSpeed | None, scale: WheelScale | None, limits: CheckLimits) -> list[Finding]:
    """Return where a receiver's speeds contradict its positions, or the tach, by what another unit would make."""
    if part is None or scale is None or abs(np.log(scale.scale)) < np.log(limits.speed_scale):
        return []
    true = to_si("speed", part.unit) * scale.scale
    unit = min(_SPEED_UNITS, key=lambda name: abs(np.log(_SPEED_UNITS[name] / true)))
    hint = f"check gnss_speed.unit; speeds must be multiplied by {scale.scale:.4g}"
    if is_ratio_of_units(true, _SPEED_UNITS[unit]):
        edit = f"multiply them by {scale.scale:.4g}"
        edit = f'set gnss_speed.unit = "{unit}"' if unit in known_units("speed") else edit
        hint = f"the data look like {unit}: {edit}"
    by = "the positions" if scale.source == "gnss" else "the tach"
    message = f"the vehicle is {scale.scale:.3g} times as fast as the receiver says, by {by}"
    file, key, expected = "recording.toml", "gnss_speed.unit", "about 1"
    return [Finding("warning", "gnss-speed-scale", message, file=file, column=key, expected=expected, hint=hint)]
