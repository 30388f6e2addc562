"""Priors: what is known of a run before its measurements, by the recording's description and by convention."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackfg.factors.bias import EARTH, OF_ACCELEROMETER, OF_GYRO, response_sigmas
from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, changed
from trackfg.factors.prior import nav_prior, prior
from trackfg.factors.states import Kind, States
from trackfg.graph.further_sensors import sensor_priors
from trackfg.graph.inputs import GraphInputs
from trackfg.numerics.arrays import Array
from trackfg.numerics.geodesy import EARTH_RATE
from trackfg.recording.description import ImuNoise
from trackfg.sensors.dead_reckoning import InitialPath

_ANYWHERE_SD_M = 1e5
"""Sigma of a start that may be anywhere along the track, m: wider than any line between two fixes."""

_BEYOND_SIGMAS = 3.0
"""A bias is as declared up to so many of the declared sigmas: 3 in 1000 would be further off."""

CALIBRATION_FACTOR = 10.0
"""Calibrations are at most so many times worse than declared: errors that the graph does not model (vibration, a moving
point of reference, a late clock) look like scale factors and misalignments too, and data sheets are not wrong by more:
typical to worst of one kind of sensor is a factor of 10."""

_CONSUMER_MISALIGNMENT_RAD = 0.01
"""Sigma of the axes of a sensor of a few euros: 2 % of another axis's input at most (InvenSense, *MPU-6000 and MPU-6050
Product Specification*, revision 3.4, sections 6.1 and 6.2)."""

SET_SD_M = 1e-4
"""Sigma of a place that is 0 by convention, m."""

SET_OFFSET_SD_MPS = 1e-6
"""Sigma of a speed signal's offset where nothing makes one, m/s: 1 mm in a quarter of an hour."""

_SET_SD_RAD = 1e-4
"""Sigma of a heading that is 0 by convention, rad: more than half the product of roll's and pitch's initial errors, by
which the third component of the prior's turn differs from the heading."""


def priors(inputs: GraphInputs, states: States) -> list[Family]:
    """Return the priors of the first keyframe, of the shared variables and of further sensors."""
    noise, config = inputs.recording.description.imu.noise, inputs.config
    first = np.array([0])
    georeferenced = inputs.recording.gnss is not None
    # Without GNSS the start defines the frame: its position and heading are known by convention.
    yaw_sd, position_sd = (3.0, 1e4) if georeferenced else (_SET_SD_RAD, SET_SD_M)
    nav_sd = np.array([[0.2, 0.2, yaw_sd, *[position_sd] * 3, 10.0, 10.0, 10.0]])
    bias, bias_sd = _bias_prior(inputs.path, noise)
    tach = inputs.recording.description.tach
    scale_sd = 1e-2 if tach is None else tach.scale_sd
    start_sd = _ANYWHERE_SD_M if inputs.recording.fixes is not None and len(inputs.recording.fixes) else SET_SD_M
    odo_sd = np.array([[start_sd, scale_sd, 1.0, 1e-3]])
    tach_clock = config.tach
    clock_sd = np.array(
        [[tach_clock.clock_offset_sd_s, tach_clock.clock_drift_sd, config.position.gnss_clock_offset_sd_s]]
    )
    imu_sd = _calibration_sd(inputs.path, noise, inputs.world.unknown_rate_sd)[None]
    offset_sd = SET_OFFSET_SD_MPS if inputs.wheel is None else max(inputs.wheel.offset_sd_mps, SET_OFFSET_SD_MPS)
    wheel_sd = np.array([[tach_clock.rail_offset_sd_m] * 2 + [tach_clock.creep_per_traction_sd] * 2 + [offset_sd]])
    lever_arm_sd = inputs.recording.description.imu.lever_arm_sigma_m
    mount_sd = np.array([[*[np.radians(config.motion.mount_sd_deg)] * 2, *lever_arm_sd]])
    start = replace(states.nav[:1], p=states.nav.p[:1] - states.nav.R[0] @ inputs.lever_arm)
    return [
        nav_prior(first, start, nav_sd, inputs.lever_arm),
        prior(Kind.BIAS, first, bias[None], bias_sd[None]),
        prior(Kind.ODO, first, states.odo.array[:1] * [1.0, 1.0, 1.0, 0.0], odo_sd),
        prior(Kind.MOUNT, first, np.zeros((1, Kind.MOUNT.dim)), mount_sd),
        prior(Kind.CLOCK, first, np.zeros((1, 3)), clock_sd),
        prior(Kind.IMU, first, np.zeros((1, Kind.IMU.dim)), imu_sd),
        prior(Kind.WHEEL, first, np.zeros((1, Kind.WHEEL.dim)), wheel_sd),
        *sensor_priors(inputs.recording.description, config),
    ]


def _bias_prior(path: InitialPath, noise: ImuNoise) -> tuple[Array, Array]:
    """Return mean and sigma of the biases at the start, (6,) each.

    The declared sigmas are a data sheet's, or a guess: where biases show that they do not allow, those are their level.
    What is known of the vertical gyro bias from how straight tracks are is in no factor, and is the prior.
    """
    mean, sd = np.zeros(6), _declared_bias_sd(noise)
    if path.start is not None:
        level = np.array([path.start.accel_level] * 3 + [path.start.gyro_level] * 3)
        sd = np.where(level > _BEYOND_SIGMAS * sd, level, sd)
        if path.start.vertical_sd is not None:
            mean[5], sd[5] = path.start.gyro[0, 2], path.start.vertical_sd
    return mean, sd


def _declared_bias_sd(noise: ImuNoise) -> Array:
    return np.array([noise.accel_bias_sd] * 3 + [noise.gyro_bias_sd] * 3)


def imu_grade(path: InitialPath, noise: ImuNoise) -> Array:
    """Return how many times worse than declared each calibration of an inertial sensor is, at most ten times. (dim,)

    Within a class of sensors what is large is large together: an accelerometer whose bias is 50 mg has a scale that is
    off by 1 %. A gyro's own bias shows the class of the gyro. Where either is beyond what the worst of one kind have
    (:data:`CALIBRATION_FACTOR`), the whole sensor is of another kind than declared: both are in one package.
    """
    accel, gyro = _bias_ratios(path, noise)
    grade = np.ones(Kind.IMU.dim)
    of_another_kind = max(accel, gyro) > CALIBRATION_FACTOR
    grade[OF_ACCELEROMETER], grade[OF_GYRO] = (max(accel, gyro),) * 2 if of_another_kind else (accel, gyro)
    return np.clip(grade, 1.0, CALIBRATION_FACTOR)


def _bias_ratios(path: InitialPath, noise: ImuNoise) -> tuple[float, float]:
    """Return how many times as large as declared the biases of accelerometer and gyro are."""
    ratio = _bias_prior(path, noise)[1] / _declared_bias_sd(noise)
    return ratio[:3].max(), ratio[3:5].max()  # the vertical gyro's sigma may be that of a guess by what tracks are like


def _calibration_sd(path: InitialPath, noise: ImuNoise, unknown_rate_sd: float) -> Array:
    """Return the prior's sigmas of an inertial sensor's calibration (dim,): those declared, by their grade. A sensor of
    another kind than declared is one of a few euros, and its axes are no straighter.
    """
    scales = noise.accel_scale_sd, noise.gyro_scale_sd
    rest = noise.g_sensitivity_sd, noise.rectification_sd, unknown_rate_sd
    declared = response_sigmas(*scales, noise.misalignment_sd_rad, *rest)
    sd = imu_grade(path, noise) * declared
    if max(_bias_ratios(path, noise)) <= CALIBRATION_FACTOR:
        return sd
    return np.maximum(sd, response_sigmas(0.0, 0.0, _CONSUMER_MISALIGNMENT_RAD, 0.0, 0.0, 0.0))


def with_free_start(families: tuple[Family, ...]) -> tuple[Family, ...]:
    """Return the families with a start that may be anywhere along the track."""

    def anywhere(family: Family) -> Family:
        sigma = family.sigma.copy()
        sigma[:, 0] = _ANYWHERE_SD_M
        return family.with_sigma(sigma)

    return changed(families, FactorType.PRIOR_ODO, anywhere)


def with_turning_earth(families: tuple[Family, ...]) -> tuple[Family, ...]:
    """Return the families with an Earth that turns, at a latitude and in a direction that are not known.

    The sigma about each horizontal axis is that of the equator, where the most is horizontal.
    """

    def turning(family: Family) -> Family:
        sigma = family.sigma.copy()
        sigma[:, EARTH] = EARTH_RATE / np.sqrt(2.0)
        return family.with_sigma(sigma)

    return changed(families, FactorType.PRIOR_IMU, turning)
