"""A body on springs does not move where it points: a sensor on it that is declared rigid shows its motion as track.

The path factor (:mod:`trackfg.factors.path`) holds for a sensor that is fixed to what follows the track, to some tenths
of a millimetre between keyframes. The level of its residuals says by how much more the body leaves its heading.
"""

from __future__ import annotations

import math

from trackfg.factors.factor_type import FactorType
from trackfg.results.verdict import Doubt
from trackfg.smoothing.leaning_body import HINT, OF_TRACK
from trackfg.smoothing.noise_levels import levels
from trackfg.smoothing.reassessment import SolvedRun

ON_SPRINGS = 10.0
"""Times its declared sigma by which a path may leave the heading: by default 2 mm in 20 m. The middle of a bogie frame
without springs, its axles 2.5 m apart, leaves it by 0.6 mm on waves of 5 m with an amplitude of 1 mm; a coach on
springs by 3 mm on good track (``tools/robustness.py --effects spring-roll-declared-rigid``)."""


def path_doubts(run: SolvedRun) -> list[Doubt]:
    """Return doubts of the geometry, where a sensor that is declared rigid leaves the direction of travel."""
    if run.problem.family(FactorType.PATH) is None:
        return []
    level = levels(run.declared, run.problem).get("path", 1.0) * run.noise_ratios.get("path", 1.0)
    return [] if level < ON_SPRINGS else [Doubt(OF_TRACK, math.inf, off_its_heading(level), HINT)]


def off_its_heading(level: float) -> str:
    """Return the sentence for residuals of the path that are ``level`` times their declared sigma."""
    return (
        f"the path leaves the direction in which the vehicle points by {level:.0f} times what is declared: the sensor "
        "is on springs and was declared rigid"
    )
