"""All reassessors, in the order in which they see a solution.

Levels of noise come after what would pass for noise, and are not judged in a round in which that has changed; priors
are widened in the same round, since noise makes them all look contradicted. A receiver's speeds are judged after them,
so that speeds which a phone has filtered do not take all rounds; a level of noise comes down again.
"""

from __future__ import annotations

from trackfg.smoothing.fixes.wrong_fixes import wrong_fixes
from trackfg.smoothing.gnss_errors import gnss_errors, gnss_speed_errors
from trackfg.smoothing.leaning_body import leaning_body
from trackfg.smoothing.noise_levels import noise_levels
from trackfg.smoothing.reassessment import Reassessor
from trackfg.smoothing.rectification import rectification
from trackfg.smoothing.turning_body import turning_body
from trackfg.smoothing.weightless_sensors import weightless_sensors
from trackfg.smoothing.wheel_scale import wheel_scale
from trackfg.smoothing.wide_priors import wide_priors

REASSESSORS: tuple[Reassessor, ...] = (
    wrong_fixes,
    gnss_errors,
    rectification,
    noise_levels,
    gnss_speed_errors,
    wheel_scale,
    wide_priors,
    weightless_sensors,
    leaning_body,
    turning_body,
)
