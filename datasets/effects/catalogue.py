"""The effects by name, the magnitudes at which robustness is measured, and where those come from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from trackfg.datasets.effects.clocks import ClockJump, DelayedStamps, FilledHoles, LateAccelerometer
from trackfg.datasets.effects.driving import Creeping, LongRest, TurningEarth
from trackfg.datasets.effects.inertial import LowCost, Noise, Slow, Warming
from trackfg.datasets.effects.mounting import LeverArm, RoughTrack, SpringRoll, Tilt
from trackfg.datasets.effects.positions import Canyon, LateGnss, ScatteredFixes, WrongFixes
from trackfg.datasets.effects.vibration import Idling, PlaceName, Rectification, Sampling, Saturation, Vibration
from trackfg.datasets.effects.wheel import (
    CoarsePulses,
    CurveRolling,
    LateTach,
    MiscountedPulses,
    NoisySpeed,
    ScaleJump,
    WeakCreep,
    WholeKmh,
    WrongWheel,
)
from trackfg.datasets.scenario import Effect
from trackfg.errors import BadInputError, expected_one_of


@dataclass(frozen=True)
class EffectKind:
    """An effect without its magnitude: ``magnitudes``, realistic ones from mild to severe, in ``unit``; ``source`` says
    where they come from.
    """

    summary: str
    make: Callable[[float], Effect]
    unit: str
    magnitudes: tuple[float, ...]
    source: str


_IEC_61373 = "IEC 61373, functional random vibration, rms: body 1.0, bogie 5.4, axle 38 m/s^2 vertically"
_MPU_6050 = "MPU-6050 data sheet; gyro bias 0.3-1 deg/s is what recorded runs of such sensors have at rest"
_CATEGORY_1 = "IEC 61373, category 1, is 1.0 m/s^2; a diesel car at rest 0.2-2 m/s^2, as recorded in road vehicles"
_ASSUMED = "assumed"


def _at(place: PlaceName, sampling: Sampling) -> Callable[[float], Effect]:
    return partial(Vibration, place=place, sampling=sampling)


EFFECTS: dict[str, EffectKind] = {
    "imu-noise": EffectKind(
        "white noise of the IMU, times the declared level",
        Noise,
        "times",
        (0.1, 3.0, 10.0),
        "data sheets give noise at rest; densities of a phone in a car are 3-10 times its data sheet's (comma2k19)",
    ),
    "body-vibration": EffectKind(
        "vibration of a car body, samples are means", _at("body", "average"), "m/s^2", (0.3, 1.0), _IEC_61373
    ),
    "bogie-vibration": EffectKind(
        "vibration of a bogie, low pass before sampling", _at("bogie", "filtered"), "m/s^2", (2.0, 10.0), _IEC_61373
    ),
    "axle-box-vibration": EffectKind(
        "vibration of an axle box, low pass before sampling",
        _at("axle-box", "filtered"),
        "m/s^2",
        (30.0, 200.0),
        f"{_IEC_61373}; 10-500 on axle boxes by track and speed",
    ),
    "aliased-vibration": EffectKind(
        "vibration of a bogie sampled without a filter", _at("bogie", "instant"), "m/s^2", (2.0, 10.0), _IEC_61373
    ),
    "idling": EffectKind(
        "an engine that runs, at rest too: harmonics of 10-30 Hz", Idling, "m/s^2", (0.5, 2.0), _CATEGORY_1
    ),
    "rectification": EffectKind(
        "an accelerometer bias that grows with the power of 5 m/s^2 of vibration",
        Rectification,
        "m/s^2 per (m/s^2)^2",
        (1e-3, 6.5e-3),
        "ADXL354/355 data sheet: up to 0.4 g at 2.5 g rms, 6.5e-3",
    ),
    "saturation": EffectKind(
        "shocks at rail joints beyond a range of 4 g",
        Saturation,
        "m/s^2",
        (60.0, 200.0),
        "IEC 61373, shocks: bogie 300 m/s^2",
    ),
    "warming": EffectKind(
        "biases and scale factors drift as the sensor warms up by so much",
        Warming,
        "K",
        (10.0, 40.0),
        "ADIS16495 data sheet: 0.1 deg/s, 2 mg, 0.1 % over 125 K",
    ),
    "low-cost-imu": EffectKind(
        "a sensor of a few euros of which nothing is declared", LowCost, "deg/s", (0.3, 1.0), _MPU_6050
    ),
    "slow-imu": EffectKind(
        "an IMU whose filter leaves half of the power at such a frequency",
        Slow,
        "Hz",
        (20.0, 5.0),
        "MPU-6050 register map: low passes of 260 to 5 Hz; loggers that keep means of 0.1 s (4.4 Hz)",
    ),
    "coarse-pulses": EffectKind(
        "a tachometer with few pulses per revolution", CoarsePulses, "pulses", (4.0, 1.0), "reed contacts and magnets"
    ),
    "whole-kmh": EffectKind(
        "speed in whole km/h, rounded, so many times a second", WholeKmh, "Hz", (5.0, 1.0), "OBD-II: whole km/h, 1-5 Hz"
    ),
    "cut-off-kmh": EffectKind(
        "speed in whole km/h, cut off, so many times a second",
        partial(WholeKmh, cut_off=True),
        "Hz",
        (5.0, 1.0),
        "the car of the Kingston recording cuts off (1 Hz)",
    ),
    "noisy-speed": EffectKind(
        "speed at 10 Hz with noise, at rest too", NoisySpeed, "m/s", (0.03, 0.1), "radar and GNSS speeds: 0.03-0.1 m/s"
    ),
    "late-tach": EffectKind(
        "a tachometer stamped late", LateTach, "s", (0.3, 1.0), "Iwata et al.: 0.3 s; displays on a bus up to 1 s"
    ),
    "miscounted-pulses": EffectKind(
        "a share of all pulses missed, and as many counted twice", MiscountedPulses, "", (0.002, 0.02), _ASSUMED
    ),
    "weak-creep": EffectKind(
        "60 s at speed during which the axle turns too fast by a share",
        WeakCreep,
        "",
        (0.01, 0.02),
        "creep below the limit of adhesion: 0.1-2 % under traction",
    ),
    "scale-jump": EffectKind(
        "a wheel scale that jumps half-way", ScaleJump, "", (0.005, 0.02), "wear: 5 % of a diameter in a wheel's life"
    ),
    "wrong-wheel": EffectKind(
        "distances times a factor", WrongWheel, "", (1.3, 3.6, -1.0), "another wheel; km/h for m/s; a wrong sign"
    ),
    "curve-rolling": EffectKind(
        "a wheelset that rolls outside the centre line in curves",
        CurveRolling,
        "m",
        (0.3, 0.53),
        "at most half the distance of the rails: bounded by flange play (Wickens)",
    ),
    "wrong-fixes": EffectKind(
        "a share of the fixes has the chainage of another balise", WrongFixes, "", (0.1, 0.2), _ASSUMED
    ),
    "scattered-fixes": EffectKind(
        "fixes that scatter more than declared", ScatteredFixes, "m", (0.5, 2.0), "ETCS: 1 m for a balise's centre"
    ),
    "canyon": EffectKind(
        "GNSS errors of tens of seconds between houses",
        Canyon,
        "m",
        (5.0, 10.0),
        "BESTGPSPOS of the Kingston recording: 5-10 m for tens of seconds, 79 m at most",
    ),
    "late-gnss": EffectKind("GNSS positions stamped late", LateGnss, "s", (1.0, 2.0), "receivers on serial lines"),
    "lever-arm": EffectKind("a lever arm that is not declared", LeverArm, "m", (1.0, 10.0), "the length of a car"),
    "tilt": EffectKind("a sensor turned about three axes, not declared", Tilt, "deg", (1.0, 3.0), "mounted by eye"),
    "spring-roll": EffectKind(
        "a car body that leans by a share of the cant deficiency", SpringRoll, "", (0.2, 0.4), "UIC 505-5: 0.2-0.4"
    ),
    "spring-roll-declared-rigid": EffectKind(
        "the same, declared rigid", partial(SpringRoll, declared_rigid=True), "", (0.2, 0.4), "UIC 505-5: 0.2-0.4"
    ),
    "rough-track": EffectKind(
        "a car body that bounces, pitches and sways on its springs over track of such a level in the band D1",
        RoughTrack,
        "mm",
        (3.0, 6.0),
        "twice and four times what track of ORE B176 with high irregularities has, 1.6 mm",
    ),
    "delayed-stamps": EffectKind(
        "IMU samples stamped on arrival, exponential delays", DelayedStamps, "ms", (1.0, 5.0), "USB and serial drivers"
    ),
    "clock-jump": EffectKind("the IMU's clock jumps ahead", ClockJump, "s", (1.0, 5.0), "a clock set while recording"),
    "filled-holes": EffectKind(
        "a tenth of the IMU's samples is lost in holes of such a length, and interpolated",
        FilledHoles,
        "s",
        (0.1, 1.5),
        "packets of a serial line; the log of the KITTI drive has holes of 1.6 s",
    ),
    "late-accelerometer": EffectKind(
        "an accelerometer later than the gyro",
        LateAccelerometer,
        "ms",
        (5.0, 20.0),
        "MPU-6050 register map: low passes of 44 and 5 Hz are late by 4.9 and 19 ms; others set them apart",
    ),
    "creeping": EffectKind("creeping along at 0.2 to 1 times the speed", Creeping, "m/s", (0.5, 0.1), _ASSUMED),
    "earth-no-heading": EffectKind(
        "a line with loops on the turning Earth, heading not declared", TurningEarth, "deg", (35.0, 60.0), "latitudes"
    ),
    "earth-undeclared": EffectKind(
        "the same, nor the latitude", partial(TurningEarth, latitude_declared=False), "deg", (35.0, 60.0), "latitudes"
    ),
    "long-rest": EffectKind("parked for hours before the run", LongRest, "h", (1.0, 5.0), "a vehicle left switched on"),
}


def effect(name: str, magnitude: float | None = None) -> Effect:
    """Return an effect by name, of the severest of its magnitudes if none is given.

    Raises :class:`~trackfg.errors.BadInputError` that lists the names there are.
    """
    if name not in EFFECTS:
        raise BadInputError(f"effect {name!r}: {expected_one_of(EFFECTS, name)}")
    kind = EFFECTS[name]
    return kind.make(kind.magnitudes[-1] if magnitude is None else magnitude)
