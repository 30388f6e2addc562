"""Random runs in which several effects come together, on the train whose sensors show them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from robustness.cases import train, without_tach
from trackfg.datasets.effects.catalogue import EFFECTS, effect
from trackfg.datasets.scenarios import Simulation, simulate

_BASES = ("odometry", "fixes", "some fixes", "gnss", "gnss alone")
_LENGTH_S = (200.0, 900.0)
_FEWEST, _MOST = 2, 5
"""So many effects at once, besides one of the positions in half of the runs."""

_OF_ANY_TRAIN = (
    ("imu-noise",),
    ("low-cost-imu",),
    ("body-vibration", "bogie-vibration", "aliased-vibration"),
    ("idling",),
    ("rectification",),
    ("saturation",),
    ("warming",),
    ("lever-arm",),
    ("tilt",),
    ("spring-roll", "spring-roll-declared-rigid"),
    ("delayed-stamps",),
    ("clock-jump",),
    ("earth-no-heading", "earth-undeclared"),
)
"""Effects of which a run has one of each group at most."""
_OF_WHEELS = (
    ("coarse-pulses", "whole-kmh", "cut-off-kmh", "noisy-speed", "miscounted-pulses"),
    ("late-tach",),
    ("weak-creep",),
    ("scale-jump",),
    ("curve-rolling",),
)
_OF_POSITIONS = {
    "fixes": ("wrong-fixes", "scattered-fixes"),
    "some fixes": ("wrong-fixes", "scattered-fixes"),
    "gnss": ("canyon", "late-gnss"),
    "gnss alone": ("canyon", "late-gnss"),
}
_STEPPED = ("coarse-pulses", "whole-kmh", "cut-off-kmh", "clock-jump")
"""Effects whose magnitudes are those of the catalogue, and none between."""
_LATITUDES_DEG = (20.0, 60.0)
_LEAST_NOISE = 1.0
"""Times the declared noise: sensors that are better than declared make nothing worse."""


@dataclass(frozen=True)
class CombinedRun:
    """A run of a number, which settles everything."""

    number: int

    @property
    def name(self) -> str:
        """Return what was drawn, in words."""
        place, sizes, duration_s = self._drawn()
        effects = ", ".join(f"{name} {size:.2g}" for name, size in sizes.items())
        return f"combined {self.number} ({place}, {duration_s:.0f} s: {effects})"

    def simulated(self) -> Simulation:
        """Return the run."""
        place, sizes, duration_s = self._drawn()
        plan = replace(train(place), effects=tuple(effect(name, size) for name, size in sizes.items()))
        run = simulate(plan, seed=self.number, duration_s=duration_s)
        return without_tach(run) if place == "gnss alone" else run

    def _drawn(self) -> tuple[str, dict[str, float], float]:
        rng = np.random.default_rng([20, self.number])
        place = _BASES[rng.integers(len(_BASES))]
        groups = _OF_ANY_TRAIN if place == "gnss alone" else (*_OF_ANY_TRAIN, *_OF_WHEELS)
        chosen = rng.choice(len(groups), rng.integers(_FEWEST, _MOST + 1), replace=False)
        names = [groups[i][rng.integers(len(groups[i]))] for i in sorted(chosen)]
        if place in _OF_POSITIONS and rng.random() < 0.5:
            names.append(_OF_POSITIONS[place][rng.integers(2)])
        return place, {name: _size(name, rng) for name in names}, float(rng.uniform(*_LENGTH_S))


def _size(name: str, rng: np.random.Generator) -> float:
    """Return a magnitude from half of the catalogue's least to its largest."""
    magnitudes = EFFECTS[name].magnitudes
    if name in _STEPPED:
        return float(rng.choice(magnitudes))
    if name.startswith("earth"):
        return float(rng.uniform(*_LATITUDES_DEG))
    least = _LEAST_NOISE if name == "imu-noise" else 0.5 * min(magnitudes)
    return float(np.exp(rng.uniform(np.log(least), np.log(max(magnitudes)))))
