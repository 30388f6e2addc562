"""Factors are found by their type, and reports call them by its label."""

from __future__ import annotations

from enum import Enum


class FactorType(Enum):
    """The type says what a factor measures or assumes; its value is the label in reports, tables and messages."""

    INERTIAL = "inertial"
    BIAS_WALK = "bias walk"
    DISTANCE_CHAIN = "distance chain"
    TACH_DISTANCE = "tach distance"
    TACH_READING = "tach reading"
    TACH_INCREMENT = "tach increment"
    SPEED_DISTANCE = "speed distance"
    ARC_LENGTH = "arc length"
    NON_HOLONOMIC = "non-holonomic"
    PATH = "path"
    AT_REST = "at rest"
    STANDSTILL = "standstill"
    RAIL_WITHIN = "rail within"
    RAIL_APART = "rail apart"
    ABSOLUTE_FIX = "absolute fix"
    WITHHELD_FIX = "withheld fix"
    LANDMARK = "landmark"
    BALISE_PASSAGE = "balise passage"
    GNSS_POSITION = "GNSS position"
    GNSS_SPEED = "GNSS speed"
    KNOWN_LINE = "known line"
    GRAVITY_TILT = "gravity tilt"
    PRIOR_NAV = "prior on nav"
    PRIOR_BIAS = "prior on bias"
    PRIOR_ODO = "prior on odo"
    PRIOR_MOUNT = "prior on mount"
    PRIOR_CLOCK = "prior on clock"
    PRIOR_IMU = "prior on imu"
    PRIOR_WHEEL = "prior on wheel"
    PRIOR_SENSOR = "prior on sensor"
    MARGINAL_PRIOR = "marginal prior"
    DELAYED_POSITION = "delayed position"
    CUSTOM = "custom"
    """A user's own; :attr:`trackfg.factors.family.Family.label` distinguishes them."""

    __hash__ = object.__hash__  # an Enum's own is a function in Python, and a stream looks types up by the thousand

    def __init__(self, _: str) -> None:
        self.of_further_sensor = self.name in ("TACH_INCREMENT", "SPEED_DISTANCE", "GNSS_SPEED")
        """Whether it has a further sensor's variable: it is of a tach, of a radar, or a receiver's speed."""
        self.stackable = self.name not in ("MARGINAL_PRIOR", "DELAYED_POSITION")
        """Whether families of this type may be stacked into one. A marginal's number of rows is its own."""
