"""The factors of a satellite receiver's own speeds over ground.

A receiver measures Doppler shifts, so that its speed is better than what its positions differ by, also between houses.
It has one ``SENSOR`` variable: an offset of the speeds, and one of their stamps. That is not the offset of the
positions' stamps: of the u-blox of comma2k19 positions are 0.06 s late and speeds 0.14 s, and phones filter more.
"""

from __future__ import annotations

import numpy as np

from trackfg.factors.family import Family
from trackfg.factors.gnss import ReceiverSpeeds, gnss_speed
from trackfg.factors.loss import Huber
from trackfg.graph.inputs import GraphInputs
from trackfg.numerics.spans import nearest
from trackfg.recording.model import GNSS_SPEED_COLUMNS, GNSS_SPEED_TABLE
from trackfg.sensors.imu_intervals import means_between

OFFSET_SD_MPS = 0.01
"""Sigma of what all speeds are too high by, m/s: those of a geodetic receiver are by 0.002 to 0.004 m/s in the median
of each range of speeds (Kingston, `tools/real_data_facts.py`). Whole km/h that are cut off contradict it."""

_LEAST_SIGMAS = 5.0
"""Speeds below so many of their sigmas are left out. From there on noise makes them too large by s / (2 u) = 0.1 of a
sigma at most. That is in the factor, but receivers smooth more near rest than their sigmas say: with all rows of
Kingston, 467 of them below 0.2 m/s, the offset of the speeds came out as -0.013 m/s, and is 0.002 m/s."""

_FORCE_S = 0.25
"""The force that carries a speed from its keyframe to its time is averaged over so much more at either end, s: a
vibration is none of the motion."""


def gnss_speeds(inputs: GraphInputs, variable: int) -> Family:
    """Return the factors of the receiver's speeds between the first keyframe and the last, at the nearest ones.

    Speeds near 0 are left out: they are of noise, of a receiver that holds its position, or of a phone that does not
    know. So are those at rest, where there is a keyframe every few seconds only.
    """
    config, description, t = inputs.config.position, inputs.recording.description.gnss, inputs.t
    table = inputs.recording.others.get(GNSS_SPEED_TABLE)
    rows = np.zeros((0, 3)) if table is None else table[list(GNSS_SPEED_COLUMNS)].to_numpy()
    rows = rows[(rows[:, 0] > t[0]) & (rows[:, 0] <= t[-1]) & (rows[:, 1] > _LEAST_SIGMAS * rows[:, 2])]
    rows = rows[~inputs.still[np.searchsorted(t, rows[:, 0]) - 1]]
    stamps, speed, sd = rows[:, 0], rows[:, 1], rows[:, 2:]
    index = nearest(t, stamps)
    begin, end = np.minimum(t[index], stamps) - _FORCE_S, np.maximum(t[index], stamps) + _FORCE_S
    force = means_between(begin, end, inputs.data.edges, inputs.data.accel)
    measured = ReceiverSpeeds(speed, stamps - t[index], inputs.body_rate[index], force, sd)
    antenna = np.zeros(3) if description is None else np.array(description.lever_arm_m)
    loss = Huber(config.gnss_width) if config.robust else None
    return gnss_speed(index, variable, measured, antenna - inputs.lever_arm, sd, loss)
