"""A scenario is everything that, with a seed, a run and a duration, makes a simulated run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from trackfg.datasets.line.defects import Defect
from trackfg.datasets.line.irregularities import IrregularityModel
from trackfg.datasets.line.line import GivenLine
from trackfg.datasets.line.line_design import LineDesign
from trackfg.datasets.sensors.clocks import ClockModel, DropModel
from trackfg.datasets.sensors.further_sensor import FurtherSensor
from trackfg.datasets.sensors.imu_errors import ImuModel
from trackfg.datasets.sensors.lasers import LaserModel
from trackfg.datasets.sensors.odometer import TachModel
from trackfg.datasets.sensors.positioning import BaliseModel, GnssModel
from trackfg.datasets.vehicle.adhesion import AdhesionModel
from trackfg.datasets.vehicle.driving import Driver
from trackfg.datasets.vehicle.ride import Ride
from trackfg.datasets.vehicle.vehicle import Rigid, Vehicle
from trackfg.numerics.key_figures import KeyFigures
from trackfg.recording.model import Recording

TableName = Literal["imu", "tach", "fixes", "gnss", "lasers", "further"]


@dataclass(frozen=True)
class Recorder:
    """The recorder of one table: its clock, and the rows that it loses. It adds to the sensor's own delay, if any."""

    clock: ClockModel = field(default_factory=ClockModel)
    drops: DropModel = field(default_factory=DropModel)


@dataclass(frozen=True)
class Effect:
    """A disturbance of the world that the recording's description does not mention (:mod:`trackfg.datasets.effects`).

    ``magnitude`` is its size, in the effect's own unit. With ``for_oracle`` the same disturbance is declared in the
    description, or left out where no field could declare it: an estimator that gets such a recording is an oracle.
    """

    magnitude: float
    for_oracle: bool = False

    def planned(self, plan: Scenario) -> Scenario:
        """Return the scenario with what the effect changes before the run."""
        return plan

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """Return the recording with the effect. ``rng`` draws the same numbers with and without ``for_oracle``."""
        return recording


@dataclass(frozen=True, repr=False)
class Scenario(KeyFigures):
    """A line, its condition, a vehicle with its driver, and sensors.

    ``line`` is drawn within the ranges of a design, ``length_m`` long or as long as the duration needs, or is given.
    Without irregularities the track lies as designed; without adhesion the wheel rolls; without a latitude the Earth
    stands still. ``recorders`` are those of the tables whose stamps are wrong or whose rows get lost. With
    ``flange_knocks`` the wheels strike the outer rail of curves below R 400 (:mod:`trackfg.datasets.vehicle.flange`).
    Chainage is the origin's plus ``direction`` times the arc length; with ``both_ways`` the odd runs go back.
    ``runs_per_vehicle`` runs one after the other are of one vehicle, which keeps its wheel and its IMU in its mounting.
    ``effects`` happen one after the other; the truth is that of the ride, which none of them changes after it is made.

    Examples
    --------
    >>> from trackfg.datasets import scenarios
    >>> scenarios()["mainline"]
    <Scenario mainline: a local train between stations some 4 km apart, R 300-1200, with a balise every 5 km, 3600 s>
    """

    name: str
    summary: str
    duration_s: float
    line: LineDesign | GivenLine
    driver: Driver
    imu: ImuModel
    tach: TachModel
    irregularities: IrregularityModel | None = None
    defects: tuple[Defect, ...] = ()
    vehicle: Vehicle = field(default_factory=Rigid)
    flange_knocks: bool = False
    lasers: tuple[LaserModel, ...] = ()
    adhesion: AdhesionModel | None = None
    balises: BaliseModel | None = None
    gnss: GnssModel | None = None
    further_sensors: tuple[FurtherSensor, ...] = ()
    recorders: Mapping[TableName, Recorder] = field(default_factory=dict)
    latitude_deg: float | None = None
    chainage_origin_m: float = 0.0
    direction: Literal[1, -1] = 1
    length_m: float | None = None
    both_ways: bool = False
    runs_per_vehicle: int = 1
    effects: tuple[Effect, ...] = ()

    def key_figures(self) -> dict[str, str]:
        """Return the name, the summary, and the duration of a run for which none is given."""
        return {"scenario": self.name, "summary": self.summary, "length": f"{self.duration_s:.0f} s"}

    @property
    def georeferenced(self) -> bool:
        """Return whether the heading in ENU has a meaning."""
        return self.gnss is not None or self.latitude_deg is not None

    def planned(self) -> Scenario:
        """Return the scenario as its effects have changed it before the run."""
        plan = self
        for effect in self.effects:
            plan = effect.planned(plan)
        return plan

    def on(self, given: GivenLine) -> Scenario:
        """Return the same on a given line, whose gauge, base of the cross-level, chainage and heading come with it.

        Irregularities come along; defects and balises at places of the old line do not: balises come at their spacing.
        """
        return replace(
            self,
            name=f"{self.name}-on-{given.name}",
            line=given,
            chainage_origin_m=given.chainage_origin_m,
            direction=1,
            length_m=None,
            defects=(),
            balises=None if self.balises is None else replace(self.balises, places_m=()),
        )
