"""Distance while the wheel slips: the specific force along the vehicle less gravity, integrated twice.

In the paper's signs, in which pitch ``theta`` and its rate are positive nose-up, roll ``psi`` left side up and yaw to
the left (its equations agree with one another in no others):

    A_x = a_x - G sin theta                                                                 (2)
    theta_0 = asin((a_x0 - A_p0) / G)                                                       (3)
    theta' = w_y cos psi + w_z sin psi                                                      (4), (5)
    psi' = w_x - yaw' sin theta,   yaw' = (w_z cos psi - w_y sin psi) / cos theta           (6)
    psi_0 = asin((a_y0 - v0 w_z0) / G)                                                      (7) - (11)

The vehicle axes of trackfg have the pitch rate nose-down: ``w_y`` here is its negative.

``as_printed`` restores (5), (6) and (11) as docs/baselines/composite-positioning.md has them. *Equation (12)*, off
unless asked for, subtracts ``k w_x sin psi``, k = +1 in a left-hand curve and -1 in a right-hand one, from the pitch
rate: no such term is in the kinematics of Euler's angles.

*Bound.* The error of the distance after t = 10 s is bounded by (13), ``a t^2 / 2 + c t^3 / 6``, with a = 0.1 km/h/s
from the accelerometer and 1.23 km/h/s from a start point at which the wheel slipped already, and c = 0.0615 km/h/s per
s from the gyro (0.1 deg/s): 18.5 m + 2.8 m = 21.3 m.

Source: Iwata, Yamamichi, Sugiyama and Kitano, section 3.1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfg.baselines.slip_detection import Cycles
from trackfg.numerics.arrays import Array
from trackfg.numerics.units import KMH, STANDARD_GRAVITY


@dataclass(frozen=True)
class Coasting:
    """``speed``, m/s, ``distance``, m, ``pitch`` nose-up, ``roll`` left up, rad, from cycle ``start`` on, all (n,)."""

    start: int
    speed: Array
    distance: Array
    pitch: Array
    roll: Array


@dataclass(frozen=True)
class VehicleState:
    """The state at the end of cycle ``cycle``: speed, m/s; pitch nose-up and roll left up, rad."""

    cycle: int
    speed: float
    pitch: float
    roll: float


def start_state(cycles: Cycles, picked: int, *, as_printed: bool) -> VehicleState:
    """Return the state by (3) and (11) from the averages at cycle ``picked``, for the middle of their time."""
    a_x, a_y, a_z = cycles.mean_accel[picked]
    along = (a_x - cycles.wheel_acceleration[picked]) / STANDARD_GRAVITY
    across = a_y - cycles.mean_speed[picked] * cycles.mean_gyro[picked, 2]
    roll = np.arctan(across / a_z) if as_printed else np.arcsin(np.clip(across / STANDARD_GRAVITY, -1.0, 1.0))
    return VehicleState(
        cycle=max(picked - cycles.window // 2, 0),
        speed=float(cycles.mean_speed[picked]),
        pitch=float(np.arcsin(np.clip(along, -1.0, 1.0))),
        roll=float(roll),
    )


def coast(
    cycles: Cycles,
    start: VehicleState,
    longest_s: float,
    *,
    pitch_correction: bool = True,
    eq12: bool = False,
    as_printed: bool = False,
) -> Coasting:
    """Integrate from ``start`` for ``longest_s``, or to the end of the record.

    Without ``pitch_correction`` pitch follows the pitch rate alone, (4) with ``w_y`` as it is measured.
    """
    rows = slice(start.cycle + 1, min(start.cycle + 1 + round(longest_s / cycles.step_s), len(cycles)))
    dt = cycles.step_s
    pitch, roll = [start.pitch], [start.roll]
    for w_x, nose_down, w_z in cycles.gyro[rows]:
        w_y, nose_up, psi = -nose_down, pitch[-1], roll[-1]
        yaw_rate = (w_z * np.cos(psi) - w_y * np.sin(psi)) / np.cos(nose_up)
        roll.append(psi + dt * (w_x if as_printed else w_x - yaw_rate * np.sin(nose_up)))
        psi = 0.5 * (psi + roll[-1])
        pitch_rate = w_y if as_printed else w_y * np.cos(psi)
        pitch_rate += w_z * np.sin(psi)
        if eq12:
            pitch_rate -= np.sign(w_z) * w_x * np.sin(psi)
        pitch.append(nose_up + dt * (pitch_rate if pitch_correction else w_y))
    theta: Array = np.array(pitch)
    # The force is the mean over the cycle, and so is to be gravity along it.
    gained = cycles.accel[rows, 0] - STANDARD_GRAVITY * np.sin(0.5 * (theta[1:] + theta[:-1]))
    speed = start.speed + np.concatenate([[0.0], np.cumsum(gained * dt)])
    distance = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * dt)])
    return Coasting(start.cycle, speed, distance, theta, np.array(roll))


def readhesion(
    cycles: Cycles, coasting: Coasting, detected: int, *, threshold_kmhps: float, speed_tolerance_kmhps: float
) -> int | None:
    """Return the first cycle from ``detected`` on at which the wheel rolls again (3.1.3); None if there is none.

    The accelerations agree to the threshold of (1), and the speeds to ``speed_tolerance_kmhps`` times the time since
    the start.
    """
    cycle = coasting.start + np.arange(len(coasting.speed))
    since = cycles.step_s * np.arange(len(cycle))
    alike = np.abs(cycles.disagreement[cycle]) <= threshold_kmhps * KMH
    close = np.abs(coasting.speed - cycles.speed[cycle]) < speed_tolerance_kmhps * KMH * since
    candidates = np.flatnonzero(alike & close & (cycle >= detected))
    return int(cycle[candidates[0]]) if candidates.size else None
