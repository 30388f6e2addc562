"""The limits that separate good input from doubtful and from bad, in one place."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CheckLimits:
    """Every limit of the checks, with defaults for railway vehicles (road vehicles pass too).

    A gap is the time between two successive rows. The smoother bridges an IMU gap by the tach and its priors; beyond
    ``imu_gap_error_s`` attitude is as good as lost, and two recordings serve better than one.

    Examples
    --------
    >>> import trackfg
    >>> from trackfg.io.check import CheckLimits
    >>> trackfg.check_recording("run1", CheckLimits(imu_gap_warning_s=0.1)).usable
    True
    """

    imu_gap_warning_s: float = 0.5
    imu_gap_error_s: float = 10.0
    tach_gap_warning_s: float = 10.0
    tilt_warning_deg: float = 12.0
    """Median specific force against vertical: full cant (7 deg) and a steep line (4 deg) together stay below."""
    tilt_error_deg: float = 30.0
    gravity_error_mps2: float = 2.0
    """Median magnitude of specific force against 9.8 m/s^2."""
    imu_interval_s: tuple[float, float] = (2e-5, 0.26)
    """Median time between two IMU rows: 50 kHz to 4 Hz."""
    speed_error_mps: float = 170.0
    rate_error_radps: float = 1.5
    """An angular rate held for half a second: far above any curve or crossing."""
    usual_rate_radps: float = 3.0
    usual_force_mps2: float = 30.0
    """A single sample, off the median, that is ten times further than ever before in the stream: no vehicle does it."""
    possible_rate_radps: float = 35.0
    possible_force_mps2: float = 5000.0
    """A single sample: the widest ranges in use, of gyros (2000 deg/s) and of accelerometers on axle boxes (500 g)."""
    lateral_error_mps2: float = 20.0
    """Speed times yaw rate held for half a second: above what wheels can hold."""
    laser_range_m: float = 3.0
    overlap_warning: float = 0.5
    """The part of a table that lies within the time of the IMU."""
    far_row_s: float = 3600.0
    """A row further outside of the IMU's time than this, and than the IMU's record is long, is not of this run."""
    stuck_s: float = 5.0
    noise_ratio_warning: float = 3.0
    axis_correlation: float = 0.5
    """Below it, a correlation says nothing about axes and units."""
    speed_scale: float = 1.15
    """Force over the tach's acceleration, and its inverse: springs and slips make less of it (1.05 is the largest
    that tools/real_data.py prints), a wrong wheel more.
    """
    lateral_scale: float = 1.05
    """Lateral force over what speed and gyro imply, and its inverse, that a wheel or a gyro makes surely: springs make
    up to 0.95 of it, which is sure to 0.97 (scenarios rough-ride and measuring-car; 1.01 in a car, Kingston).
    """
    mounting_deg: float = 3.0
    """Pitch and yaw of the sensor against the direction of travel: 1 is the largest of scenarios and real drives."""
    delay_s: float = 0.1
    """Positions and fixes that are less late are no finding, s."""
