"""The columns of a result's tables."""

from __future__ import annotations

_STATES = ("chainage_m", "east_m", "north_m", "up_m", "speed_mps", "roll_rad", "pitch_rad", "yaw_rad")


TRAJECTORY_COLUMNS = ("t_s", *(name for state in _STATES for name in (state, f"{state}_sd")))
"""``t_s``, then each state followed by its sigma. Chainage and position are those of the vehicle reference point."""


_CENTRE_GEOMETRY = (
    "curvature_1pm",
    "gradient_permille",
    "cross_level_mm",
    "twist_mm",
    "level_mm",
    "alignment_mm",
    "versine_level_mm",
    "versine_alignment_mm",
)


_RAIL_GEOMETRY = ("level_left_mm", "level_right_mm", "alignment_left_mm", "alignment_right_mm", "gauge_mm")


GEOMETRY_COLUMNS = (
    "chainage_m",
    "chainage_m_sd",
    "speed_mps",
    *(name for quantity in _CENTRE_GEOMETRY for name in (quantity, f"{quantity}_sd")),
)
"""The place, its sigma, the speed at which it was measured, then each quantity followed by its sigma."""


RAIL_COLUMNS = tuple(name for quantity in _RAIL_GEOMETRY for name in (quantity, f"{quantity}_sd"))
"""What lasers add: each rail by itself, and the gauge."""


BAND_COLUMNS = tuple(
    f"{quantity}{side}_{band}_mm"
    for quantity in ("level", "alignment")
    for side in ("", "_left", "_right")
    for band in ("d0", "d1", "d2", "d3")
)
"""Level and alignment in the bands of EN 13848-1, as a geometry measured by another system may have them besides."""


CHANNELS = tuple(
    name
    for name in (*GEOMETRY_COLUMNS, *RAIL_COLUMNS, *BAND_COLUMNS)
    if not name.endswith("_sd") and name not in ("chainage_m", "speed_mps")
)
"""What a geometry may have measured of the track: all its columns but the place, the speed and the sigmas."""


EVENT_COLUMNS = (
    "kind",
    "start_s",
    "end_s",
    "chainage_m",
    "chainage_m_sd",
    "distance_removed_m",
    "distance_removed_m_sd",
    "detail",
)
"""``distance_removed_m`` is the tachometer's error over the event that the smoother took out, else empty."""


BALISE_COLUMNS = (
    "id",
    "passes",
    "left_out",
    "runs",
    "planned_m",
    "planned_m_sd",
    "measured_m",
    "measured_m_sd",
    "difference_m",
    "difference_m_sd",
    "sigmas",
    "place_m",
    "place_m_sd",
    "verdict",
)
"""One row per balise: how often it was passed, how many of these passages contradict the others, in how many runs;
where it is planned; where all measurements but its own plan place it, and how far from the plan that is, in m and in
sigmas; the place by everything together; and what to make of it."""
