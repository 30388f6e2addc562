"""The built-in scenarios: a line, a driver and sensors, by name.

The sensor grades are those of two data sheets where these give numbers (angular random walk, in-run bias stability);
the rest (accelerometer noise with the vehicle's vibration in it, turn-on biases, bias walks) is assumed. See
docs/datasets.md.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from trackfg import units
from trackfg.datasets.driving import Driver, Parked, Service, Shunting, Wandering
from trackfg.datasets.imu_errors import ImuModel
from trackfg.datasets.line_design import LineDesign
from trackfg.datasets.motion import Limits
from trackfg.datasets.odometer import TachModel
from trackfg.datasets.positioning import BaliseModel, GnssModel
from trackfg.description import ImuNoise
from trackfg.errors import BadInputError

KMH = units.KMH

ADIS16495_1 = ImuNoise(
    gyro_white=2.62e-5,  # 0.09 deg/sqrt(h)
    accel_white=1e-3,
    gyro_bias_walk=2e-7,  # reaches the in-run 0.8 deg/h in some 400 s
    accel_bias_walk=2e-6,
    gyro_bias_sd=1e-3,
    accel_bias_sd=0.02,
)

ADIS16480 = ImuNoise(
    gyro_white=8.73e-5,  # 0.3 deg/sqrt(h)
    accel_white=1.5e-3,
    gyro_bias_walk=1.5e-6,  # reaches the in-run 6 deg/h in some 400 s
    accel_bias_walk=2e-5,
    gyro_bias_sd=3.5e-3,
    accel_bias_sd=0.05,
)


@dataclass(frozen=True)
class Scenario:
    """Everything that, with a seed and a duration, makes a simulated run.

    Without a latitude the Earth stands still. Chainage is the origin's plus ``direction`` times the arc length.
    """

    name: str
    summary: str
    duration_s: float
    line: LineDesign
    driver: Driver
    imu: ImuModel
    tach: TachModel
    balises: BaliseModel | None = None
    gnss: GnssModel | None = None
    latitude_deg: float | None = None
    chainage_origin_m: float = 0.0
    direction: Literal[1, -1] = 1


def scenarios() -> dict[str, Scenario]:
    """All scenarios by name."""
    return {scenario.name: scenario for scenario in _all()}


def scenario(name: str) -> Scenario:
    """The scenario of that name. Raises :class:`~trackfg.errors.BadInputError` that lists the names there are."""
    known = scenarios()
    if name not in known:
        raise BadInputError(f"scenario {name!r}: expected one of {', '.join(known)}")
    return known[name]


MAIN_LINE = LineDesign(
    gauge_m=1.067,
    cross_level_base_m=1.067,
    line_speed_mps=95 * KMH,
    radius_m=(300.0, 1200.0),
    straight_m=(150.0, 1200.0),
    circle_m=(80.0, 500.0),
    max_turn_rad=1.0,
    cant_max_m=0.105,
    deficiency_max_m=0.070,
    usual_deficiency_m=0.030,
    transition_min_m=30.0,
    max_gradient=0.025,
    station_gradient=0.005,
    gradient_length_m=(350.0, 1200.0),
    vertical_radius_m=(3000.0, 6000.0),
    station_spacing_m=4000.0,
)

HIGH_SPEED_LINE = replace(
    MAIN_LINE,
    gauge_m=1.435,
    cross_level_base_m=1.5,
    radius_m=(400.0, 1000.0),
    straight_m=(80.0, 250.0),
    circle_m=(100.0, 300.0),
    cant_max_m=0.180,
    deficiency_max_m=0.090,
    transition_min_m=50.0,
    max_gradient=0.015,
    vertical_radius_m=(10_000.0, 15_000.0),
    line_speed_mps=120 * KMH,
)

YARD = replace(
    MAIN_LINE,
    line_speed_mps=25 * KMH,
    radius_m=(160.0, 400.0),
    straight_m=(40.0, 200.0),
    circle_m=(40.0, 120.0),
    cant_max_m=0.060,
    max_gradient=0.005,
)


def _all() -> list[Scenario]:
    service = Service(
        limits=Limits(acceleration_mps2=0.7, jerk_mps3=0.5),
        line_speed_mps=MAIN_LINE.line_speed_mps,
        start_m=50.0,
        start_rest_s=30.0,
        dwell_s=(20.0, 45.0),
    )
    mainline = Scenario(
        name="mainline",
        summary="a local train between stations some 4 km apart, R 300-1200, with a balise every 5 km",
        duration_s=3600.0,
        line=MAIN_LINE,
        driver=service,
        imu=ImuModel(rate_hz=200.0, noise=ADIS16495_1),
        tach=TachModel(creep_density=1e-3),
        balises=BaliseModel(spacing_m=5000.0, sd_m=0.3),
    )
    shunting = Scenario(
        name="shunting",
        summary="to and fro in a yard, a tachometer that tells the direction",
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
        imu=ImuModel(rate_hz=200.0, noise=ADIS16495_1),
        tach=TachModel(signed=True, creep_density=1e-3),
        balises=BaliseModel(spacing_m=200.0, sd_m=0.3),
    )
    return [
        mainline,
        replace(
            mainline,
            name="mainline-gnss",
            summary="the same train with GNSS at 1 Hz and the Earth's rotation",
            gnss=GnssModel(sd_m=(1.0, 1.0, 2.0), antenna_m=(2.0, 0.0, 3.0)),
            latitude_deg=35.2,
        ),
        Scenario(
            name="trolley",
            summary="a measuring trolley pushed at 0.92 m/s on a canted line, at rest for the first minute",
            duration_s=1200.0,
            line=HIGH_SPEED_LINE,
            driver=Wandering(
                limits=Limits(acceleration_mps2=0.3, jerk_mps3=0.3),
                speed_mps=(0.82, 1.02),
                hold_s=(5.0, 30.0),
                start_rest_s=60.0,
                start_m=5.0,
            ),
            imu=ImuModel(rate_hz=200.0, noise=ADIS16480),
            tach=TachModel(pulses_per_rev=1000.0, wheel_diameter_m=0.2, scale_sd=0.003),
            balises=BaliseModel(spacing_m=200.0, sd_m=0.05),
        ),
        shunting,
        replace(
            shunting,
            name="shunting-unsigned",
            summary="the same shunting, a tachometer that counts up whichever way it turns",
            tach=replace(shunting.tach, signed=False),
        ),
        replace(mainline, name="parked", summary="at rest all the time", duration_s=600.0, driver=Parked(place_m=50.0)),
        replace(
            mainline,
            name="no-stop",
            summary="never at rest: 40-75 km/h on the main line",
            duration_s=1200.0,
            driver=Wandering(limits=service.limits, speed_mps=(40 * KMH, 75 * KMH), hold_s=(20.0, 90.0), start_m=50.0),
        ),
    ]
