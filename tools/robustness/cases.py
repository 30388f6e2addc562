"""What is run: each effect, at each of its magnitudes, on the train whose sensors show it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

from trackfg.datasets.catalogue import scenario
from trackfg.datasets.effects.catalogue import EFFECTS, effect
from trackfg.datasets.scenario import Scenario
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.datasets.sensors.positioning import BaliseModel, GnssModel
from trackfg.datasets.vehicle.driving import Service

CLEAN = "clean"
"""The name of the case without an effect."""

_REST_S = 20.0
_STATIONS_M = 2000.0
"""A rest first and a stop every 2 km: a run of ten minutes has three or four."""
_FIXES_M = {"fixes": 2000.0, "some fixes": 600.0, "many fixes": 300.0}
_FIX_SD_M = 0.1
_GNSS_SD_M = (2.0, 2.0, 4.0)

BASES: dict[str, tuple[str, ...]] = {
    CLEAN: ("odometry", "fixes", "gnss"),
    "rectification": ("odometry", "fixes"),
    "coarse-pulses": ("odometry", "fixes"),
    "miscounted-pulses": ("odometry", "fixes"),
    "weak-creep": ("odometry", "fixes"),
    "scale-jump": ("fixes",),
    "wrong-fixes": ("some fixes", "many fixes"),
    "scattered-fixes": ("many fixes",),
    "canyon": ("gnss", "gnss alone"),
    "late-gnss": ("gnss",),
    "late-tach": ("odometry", "gnss"),
    "wrong-wheel": ("odometry", "gnss"),
}
"""With which sensors an effect is run besides IMU and wheel; ``odometry``, without positions, where none are named."""
ORACLES = frozenset({
    ("imu-noise", 0.1),
    ("imu-noise", 10.0),
    ("aliased-vibration", 2.0),
    *(("rectification", magnitude) for magnitude in EFFECTS["rectification"].magnitudes),
    ("coarse-pulses", 1.0),
    *((name, magnitude) for name in ("whole-kmh", "cut-off-kmh") for magnitude in EFFECTS[name].magnitudes),
    ("wrong-fixes", 0.1),
    *(("canyon", magnitude) for magnitude in EFFECTS["canyon"].magnitudes),
    *(("weak-creep", magnitude) for magnitude in EFFECTS["weak-creep"].magnitudes),
})  # fmt: skip
"""Where the smoother is compared with an oracle."""
STREAMED = ("imu-noise", "aliased-vibration", "coarse-pulses", "wrong-fixes", "weak-creep", "canyon")
"""What streams go through."""
HOURS = ("long-rest",)
"""Left out unless named: hours of samples."""


@dataclass(frozen=True)
class Case:
    """An effect of a magnitude (NaN: none), seen by the sensors of a base."""

    effect: str
    magnitude: float
    base: str

    @property
    def name(self) -> str:
        """Return the case in words."""
        return (
            f"{self.effect}, {self.base}" if self.effect == CLEAN else f"{self.effect} {self.magnitude:g}, {self.base}"
        )

    @property
    def has_oracle(self) -> bool:
        """Return whether an oracle is run too."""
        return (self.effect, self.magnitude) in ORACLES

    def simulated(self, seed: int, duration_s: float, *, for_oracle: bool = False) -> Simulation:
        """Return the run, or that of the oracle."""
        plan = train(self.base)
        if self.effect != CLEAN:
            plan = replace(plan, effects=(replace(effect(self.effect, self.magnitude), for_oracle=for_oracle),))
        if self.effect in HOURS:
            duration_s += 2.0 * 3600.0 * self.magnitude
        run = simulate(plan, seed=seed, duration_s=duration_s)
        return without_tach(run) if self.base == "gnss alone" else run


def cases(names: Sequence[str]) -> list[Case]:
    """Return the cases of effects, each ``name`` or ``name=magnitude``; of all but those of hours if none is named.

    Raises :class:`~trackfg.errors.BadInputError` for an unknown name.
    """
    chosen = []
    for name in names or (CLEAN, *(one for one in EFFECTS if one not in HOURS)):
        kind, _, magnitude = name.partition("=")
        if kind == CLEAN:
            magnitudes: tuple[float, ...] = (float("nan"),)
        else:
            effect(kind)
            magnitudes = (float(magnitude),) if magnitude else EFFECTS[kind].magnitudes
        chosen += [Case(kind, size, base) for size in magnitudes for base in BASES.get(kind, ("odometry",))]
    return chosen


@cache
def train(name: str) -> Scenario:
    """Return the train with the sensors of a base."""
    plan = scenario("mainline")
    driver, line = plan.driver, plan.line
    assert isinstance(driver, Service)
    plan = replace(
        plan,
        driver=replace(driver, start_rest_s=_REST_S),
        line=replace(line, station_spacing_m=_STATIONS_M),
        balises=BaliseModel(spacing_m=_FIXES_M[name], sd_m=_FIX_SD_M) if name in _FIXES_M else None,
    )
    if name.startswith("gnss"):
        plan = replace(plan, gnss=GnssModel(sd_m=_GNSS_SD_M, antenna_m=(2.0, 0.0, 3.0)), latitude_deg=35.2)
    return plan


def without_tach(run: Simulation) -> Simulation:
    """Return the run without its tachometer."""
    recording = run.recording
    description = recording.description.model_copy(update={"tach": None})
    return replace(run, recording=replace(recording, tach=None, description=description))
