"""The built-in scenarios, by name.

The sensor grades are those of :mod:`trackfg.datasets.sensors.imu_grades`. See docs/datasets.md.
"""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

from trackfg.datasets.effects.clocks import DelayedStamps
from trackfg.datasets.effects.inertial import Noise, Warming
from trackfg.datasets.effects.mounting import LeverArm, SpringRoll, Tilt
from trackfg.datasets.effects.positions import Canyon, LateGnss, WrongFixes
from trackfg.datasets.effects.vibration import Idling, Rectification, Saturation, Vibration
from trackfg.datasets.effects.wheel import CurveRolling, LateTach, MiscountedPulses, WeakCreep
from trackfg.datasets.line.built_in_lines import GOOD_TRACK, HIGH_SPEED_LINE, MAIN_LINE, WORN_TRACK, YARD
from trackfg.datasets.line.defects import Defect
from trackfg.datasets.scenario import Recorder, Scenario
from trackfg.datasets.sensors.clocks import ClockModel, DropModel
from trackfg.datasets.sensors.further_axle import FurtherAxle
from trackfg.datasets.sensors.imu_grades import ADIS16480, ADIS16495_1
from trackfg.datasets.sensors.lasers import two_units
from trackfg.datasets.sensors.odometer import TachModel
from trackfg.datasets.sensors.positioning import BaliseModel, GnssModel
from trackfg.datasets.sensors.speed_over_ground import SpeedModel
from trackfg.datasets.vehicle.adhesion import AdhesionModel
from trackfg.datasets.vehicle.driving import Parked, Service, Shunting, SpeedRestrictions, Wandering
from trackfg.datasets.vehicle.motion import Limits
from trackfg.datasets.vehicle.vehicle import CarBody, Rigid
from trackfg.errors import BadInputError, expected_one_of
from trackfg.numerics.units import KMH

_SUMMARIES: dict[str, str] = tomllib.loads(Path(__file__).with_name("summaries.toml").read_text(encoding="utf-8"))
"""What each scenario is: a file, which ``trackfg scenarios`` reads without importing what scenarios are made of."""


def scenarios() -> dict[str, Scenario]:
    """Return all scenarios by name.

    Returns
    -------
    dict of str to Scenario
        In the order in which ``trackfg scenarios`` lists them.

    Examples
    --------
    >>> from trackfg.datasets import scenarios
    >>> list(scenarios())[:2]
    ['mainline', 'mainline-gnss']
    """
    return {scenario.name: scenario for scenario in _all()}


def scenario(name: str) -> Scenario:
    """Return the scenario of that name. Raises :class:`~trackfg.errors.BadInputError` with the names there are."""
    catalogue = scenarios()
    if name not in catalogue:
        raise BadInputError(f"scenario {name!r}: {expected_one_of(catalogue, str(name))}")
    return catalogue[name]


_SERVICE = Service(
    limits=Limits(acceleration_mps2=0.7, jerk_mps3=0.5),
    fastest_mps=MAIN_LINE.line_speed_mps,
    start_m=50.0,
    start_rest_s=30.0,
    dwell_s=(20.0, 45.0),
    hurry=(0.7, 1.0),
    restrictions=SpeedRestrictions(per_km=0.15, speed_mps=(5 * KMH, 60 * KMH), length_m=(50.0, 200.0)),
)
"""How a passenger train runs on the main line. All figures are assumed."""


def _named(name: str) -> dict[str, Any]:
    return {"name": name, "summary": _SUMMARIES[name]}


def _all() -> list[Scenario]:
    mainline = _mainline()
    return [
        mainline,
        replace(
            mainline,
            **_named("mainline-gnss"),
            gnss=GnssModel(sd_m=(1.0, 1.0, 2.0), antenna_m=(2.0, 0.0, 3.0)),
            latitude_deg=35.2,
        ),
        _in_the_field(mainline),
        _trolley(),
        *_shunting(),
        _axle_box(),
        *_measuring_cars(),
        *_slippery_lines(),
        _shuttle(),
        _rough_ride(mainline),
        replace(mainline, **_named("parked"), duration_s=600.0, driver=Parked(place_m=50.0)),
        replace(
            mainline,
            **_named("no-stop"),
            duration_s=1200.0,
            driver=Wandering(limits=_SERVICE.limits, speed_mps=(40 * KMH, 75 * KMH), hold_s=(20.0, 90.0), start_m=50.0),
        ),
    ]


def _mainline() -> Scenario:
    """Return the scenario of a local train on the main line, from which others differ by a part."""
    return Scenario(
        **_named("mainline"),
        duration_s=3600.0,
        line=MAIN_LINE,
        driver=_SERVICE,
        imu=ADIS16495_1.imu(200.0),
        tach=TachModel(creep_density=1e-3),
        irregularities=GOOD_TRACK,
        balises=BaliseModel(spacing_m=5000.0, sd_m=0.3),
    )


def _trolley() -> Scenario:
    """Return the scenario of a pushed trolley, whose tach is on a small measuring wheel."""
    return Scenario(
        **_named("trolley"),
        duration_s=1200.0,
        line=HIGH_SPEED_LINE,
        driver=Wandering(
            limits=Limits(acceleration_mps2=0.3, jerk_mps3=0.3),
            speed_mps=(0.82, 1.02),
            hold_s=(5.0, 30.0),
            start_rest_s=60.0,
            start_m=5.0,
        ),
        imu=ADIS16480.imu(200.0),
        tach=TachModel(pulses_per_rev=1000.0, wheel_diameter_m=0.2, scale_sd=0.003),
        irregularities=GOOD_TRACK,
        vehicle=Rigid(wheelbase_m=0.5),
        balises=BaliseModel(spacing_m=200.0, sd_m=0.05),
    )


def _shunting() -> list[Scenario]:
    """Return scenarios of an engine that goes to and fro in a yard, with a tach that knows the direction and one that
    does not.
    """
    signed = Scenario(
        **_named("shunting"),
        duration_s=600.0,
        line=YARD,
        driver=Shunting(
            limits=Limits(acceleration_mps2=0.5, jerk_mps3=0.5),
            speed_mps=(10 * KMH, 25 * KMH),
            near_m=20.0,
            far_m=620.0,
            shortest_m=80.0,
            start_rest_s=20.0,
            dwell_s=(10.0, 25.0),
        ),
        imu=ADIS16495_1.imu(200.0),
        tach=TachModel(signed=True, creep_density=1e-3),
        irregularities=WORN_TRACK,
        balises=BaliseModel(spacing_m=200.0, sd_m=0.3),
    )
    return [signed, replace(signed, **_named("shunting-unsigned"), tach=replace(signed.tach, signed=False))]


def _in_the_field(mainline: Scenario) -> Scenario:
    """Return a scenario with what recorders and receivers do to data outside a laboratory. All figures are assumed."""
    return replace(
        mainline,
        **_named("mainline-field"),
        duration_s=1800.0,
        gnss=GnssModel(
            sd_m=(1.0, 1.0, 2.0),
            antenna_m=(2.0, 0.0, 3.0),
            outages_per_hour=6.0,
            multipath_sd_m=(1.5, 1.5, 3.0),
            outlier_probability=0.005,
        ),
        recorders={
            "imu": Recorder(ClockModel(jitter_sd_s=5e-5), DropModel(probability=1e-5)),
            "tach": Recorder(
                ClockModel(offset_s=0.08, drift=2e-5, jitter_sd_s=1e-3), DropModel(1e-4, bursts_per_hour=2.0)
            ),
            "gnss": Recorder(ClockModel(offset_s=0.12, jitter_sd_s=5e-3)),
        },
        latitude_deg=35.2,
    )


def _axle_box() -> Scenario:
    """Return a slow run through sharp, twisted curves, as in the patent on an axle-box sensor (JP7628028B2)."""
    return Scenario(
        **_named("axle-box"),
        duration_s=300.0,
        line=replace(
            YARD,
            line_speed_mps=11 * KMH,
            radius_m=(100.0, 101.0),
            circle_m=(60.0, 100.0),
            straight_m=(40.0, 80.0),
        ),
        driver=Wandering(
            limits=Limits(acceleration_mps2=0.3, jerk_mps3=0.3),
            speed_mps=(4 * KMH, 11 * KMH),
            hold_s=(5.0, 20.0),
            start_rest_s=20.0,
            start_m=30.0,
        ),
        imu=ADIS16480.imu(500.0),
        tach=TachModel(creep_density=1e-3),
        irregularities=WORN_TRACK,
        flange_knocks=True,
        defects=tuple(
            Defect("twist", at_m=at, size_m=size, length_m=5.0)
            for at, size in ((80.0, 0.04), (140.0, -0.03), (220.0, 0.02), (290.0, -0.04), (380.0, 0.035))
        ),
        balises=BaliseModel(spacing_m=200.0, sd_m=0.1),
    )


def _measuring_cars() -> list[Scenario]:
    """Return scenarios of two units of lasers on a car body, as in Suto, Tsubokawa and Yoshida (2020)."""
    steady = Scenario(
        **_named("measuring-car-b"),
        duration_s=1200.0,
        line=replace(MAIN_LINE, line_speed_mps=100 * KMH, station_spacing_m=3000.0),
        driver=replace(
            _SERVICE,
            limits=Limits(acceleration_mps2=0.6, jerk_mps3=0.4),
            fastest_mps=100 * KMH,
            dwell_s=(20.0, 40.0),
            restrictions=SpeedRestrictions(per_km=0.4, speed_mps=(5 * KMH, 60 * KMH), length_m=(50.0, 250.0)),
        ),
        imu=replace(ADIS16495_1.imu(200.0), lever_arm_m=(0.0, 0.0, 0.6)),
        tach=TachModel(creep_density=1e-3, rate_hz=100.0),
        irregularities=GOOD_TRACK,
        vehicle=CarBody(),
        lasers=two_units(2.5, -2.5, half_width_m=0.5335, height_m=0.6),
        balises=BaliseModel(spacing_m=1000.0, sd_m=0.1),
    )
    drifting = ADIS16495_1.noise.model_copy(update={"accel_bias_walk": 3e-4, "accel_bias_sd": 0.05})
    return [
        replace(steady, **_named("measuring-car"), imu=replace(steady.imu, noise=drifting)),
        steady,
    ]


def _slippery_lines() -> list[Scenario]:
    """Return scenarios of a local train on wet rails, as in Iwata et al. on composite train positioning: 44 slips and
    slides in 18 runs.
    """
    wet = Scenario(
        **_named("slippery-line"),
        duration_s=1200.0,
        line=replace(
            MAIN_LINE, line_speed_mps=100 * KMH, radius_m=(300.0, 500.0), max_gradient=0.0159, station_spacing_m=1500.0
        ),
        driver=Service(
            limits=Limits(acceleration_mps2=0.8, jerk_mps3=0.6),
            fastest_mps=100 * KMH,
            start_m=50.0,
            start_rest_s=30.0,
            dwell_s=(20.0, 40.0),
        ),
        imu=replace(ADIS16480.imu(100.0), lever_arm_m=(0.0, 0.0, 1.2)),
        tach=TachModel(wheel_diameter_m=0.816, pulses_per_rev=90.0, creep_density=1e-3),
        irregularities=GOOD_TRACK,
        vehicle=CarBody(),
        adhesion=AdhesionModel(stretches_per_km=0.15, stretch_m=(100.0, 500.0), mu_factor=(0.05, 0.4)),
        balises=BaliseModel(spacing_m=1000.0, sd_m=0.1),
        length_m=14_500.0,
    )
    radar = SpeedModel(place_m=(3.0, 0.0, -0.5), dropouts_per_hour=20.0)
    leaves = AdhesionModel(stretches_per_km=1.0, stretch_m=(200.0, 800.0), mu_factor=(0.05, 0.3))
    return [
        wet,
        replace(wet, **_named("slippery-line-leaves"), adhesion=leaves),
        replace(wet, **_named("slippery-line-radar"), further_sensors=(radar,)),
        replace(
            wet,
            **_named("slippery-line-two-axles"),
            further_sensors=(FurtherAxle(replace(wet.tach, wheel_diameter_m=0.83, clock_offset_s=0.03), wet.adhesion),),
        ),
    ]


def _shuttle() -> Scenario:
    """Return the scenario of one line, many runs, odd ones back: for repeatability and for maps."""
    length_m = 8000.0
    return Scenario(
        **_named("shuttle"),
        duration_s=1000.0,
        line=replace(MAIN_LINE, line_speed_mps=90 * KMH, radius_m=(300.0, 600.0)),
        driver=replace(
            _SERVICE,
            fastest_mps=90 * KMH,
            dwell_s=(20.0, 40.0),
            hurry=(0.5, 1.0),
            restrictions=SpeedRestrictions(per_km=0.1, speed_mps=(15 * KMH, 60 * KMH), length_m=(50.0, 200.0)),
        ),
        imu=replace(ADIS16495_1.imu(200.0), mount_sd_rad=5e-4, mount_roll_sd_rad=1e-3),
        tach=TachModel(creep_density=1e-3),
        irregularities=GOOD_TRACK,
        balises=BaliseModel(spacing_m=1000.0, sd_m=0.1, places_m=(100.0, length_m - 100.0)),
        length_m=length_m,
        both_ways=True,
        runs_per_vehicle=2,
    )


def _rough_ride(mainline: Scenario) -> Scenario:
    """Return the scenario with realistic amounts of everything that a description does not mention. The sources are
    those of the effects (:mod:`trackfg.datasets.effects.catalogue`).
    """
    return replace(
        mainline,
        **_named("rough-ride"),
        duration_s=1200.0,
        line=replace(MAIN_LINE, line_speed_mps=100 * KMH, radius_m=(300.0, 600.0), station_spacing_m=2000.0),
        imu=ADIS16480.imu(200.0),
        adhesion=AdhesionModel(stretches_per_km=0.15, stretch_m=(100.0, 500.0), mu_factor=(0.05, 0.4)),
        balises=BaliseModel(spacing_m=1000.0, sd_m=0.1),
        gnss=GnssModel(sd_m=(2.0, 2.0, 4.0), antenna_m=(2.0, 0.0, 3.0), outages_per_hour=12.0),
        latitude_deg=35.2,
        effects=(
            LeverArm(1.0),
            SpringRoll(0.2),
            CurveRolling(0.3),
            LateTach(0.3),
            Noise(3.0),
            Vibration(0.5, place="body", sampling="instant"),
            Rectification(2e-3, vibration=Vibration(0.5, place="body", sampling="filtered")),
            Idling(0.3),
            Saturation(30.0),
            Warming(10.0),
            Tilt(0.5),
            DelayedStamps(2.0),
            MiscountedPulses(0.002),
            WeakCreep(0.01),
            WrongFixes(0.1),
            Canyon(5.0),
            LateGnss(0.3),
        ),
    )
