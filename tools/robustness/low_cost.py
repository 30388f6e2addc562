"""Random runs of wheeled vehicles with sensors of a few euros, most of them short and with little rest."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackfg.datasets.catalogue import scenario
from trackfg.datasets.effects.inertial import LowCost
from trackfg.datasets.effects.mounting import Tilt
from trackfg.datasets.effects.vibration import Idling, Vibration
from trackfg.datasets.effects.wheel import CoarsePulses, LateTach, NoisySpeed, WholeKmh
from trackfg.datasets.line.built_in_lines import NARROW_YARD
from trackfg.datasets.scenario import Effect, Scenario
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.datasets.sensors.imu_errors import ImuModel
from trackfg.datasets.vehicle.driving import Service, Wandering
from trackfg.datasets.vehicle.motion import Limits
from trackfg.numerics.units import KMH

_BIAS_DEGPS = (0.05, 1.0)
_RATES_HZ = (50.0, 100.0, 120.0, 200.0)
_LENGTH_S = (60.0, 400.0)
_REST_S = (3.0, 14.0)
_NO_REST = 0.25
"""Share of the runs that begin under way."""
_TILT_DEG = (0.0, 5.0)
_IDLING_MPS2 = (0.0, 2.0)
_VIBRATION_MPS2 = (0.0, 2.0)
_WHEELS: tuple[Effect | None, ...] = (None, CoarsePulses(4.0), WholeKmh(5.0), NoisySpeed(0.03), LateTach(0.3))


@dataclass(frozen=True)
class LowCostRun:
    """A run of a number, which settles everything."""

    number: int

    @property
    def name(self) -> str:
        """Return what was drawn, in words."""
        plan, duration = self._drawn()
        wheel = next((type(one).__name__ for one in plan.effects if one in _WHEELS), "fine pulses")
        driver = plan.driver
        rest = f"{driver.start_rest_s:.0f} s of rest" if isinstance(driver, Service) else "no rest"
        sizes = {type(one): one.magnitude for one in plan.effects}
        return (
            f"low-cost {self.number} (bias {sizes[LowCost]:.2f} deg/s, {plan.imu.rate_hz:g} Hz, {duration:.0f} s, "
            f"{rest}, idling {sizes[Idling]:.1f}, shaking {sizes[Vibration]:.1f} m/s^2, "
            f"tilt {sizes[Tilt]:.1f} deg, {wheel})"
        )

    def simulated(self) -> Simulation:
        """Return the run."""
        plan, duration_s = self._drawn()
        return simulate(plan, seed=self.number, duration_s=duration_s)

    def _drawn(self) -> tuple[Scenario, float]:
        rng = np.random.default_rng([16, self.number])
        limits, plan = Limits(acceleration_mps2=0.8, jerk_mps3=0.8), scenario("mainline")
        effects: list[Effect] = [
            LowCost(float(np.exp(rng.uniform(*np.log(_BIAS_DEGPS))))),
            Idling(float(rng.uniform(*_IDLING_MPS2))),
            Vibration(float(rng.uniform(*_VIBRATION_MPS2)), place="body", sampling="instant"),
            Tilt(float(rng.uniform(*_TILT_DEG))),
        ]
        wheel = _WHEELS[rng.integers(len(_WHEELS))]
        effects += [] if wheel is None else [wheel]
        rate, duration = float(rng.choice(_RATES_HZ)), float(rng.uniform(*_LENGTH_S))
        fastest = float(rng.uniform(15.0, 50.0)) * KMH
        rest = 0.0 if rng.random() < _NO_REST else float(rng.uniform(*_REST_S))
        driver: Service | Wandering = Service(
            limits, fastest_mps=fastest, start_m=5.0, start_rest_s=rest, dwell_s=(1.5, 10.0)
        )
        if rest == 0.0:
            driver = Wandering(limits, speed_mps=(0.3 * fastest, fastest), hold_s=(5.0, 30.0), start_m=5.0)
        spacing = float(rng.uniform(150.0, 800.0))
        line = replace(NARROW_YARD, line_speed_mps=fastest, station_spacing_m=spacing)
        imu = ImuModel(rate_hz=rate, noise=plan.imu.noise)
        return replace(
            plan, name="low-cost", line=line, driver=driver, imu=imu, balises=None, effects=tuple(effects)
        ), duration
