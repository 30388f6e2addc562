"""Fixes and GNSS measure where the vehicle is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from trackfg.factors.family import Family
from trackfg.factors.gnss import gnss_position
from trackfg.factors.loss import Cauchy, Huber, Loss
from trackfg.factors.odometry import absolute_fix
from trackfg.graph.further_sensors import antenna_variable
from trackfg.graph.inputs import GraphInputs
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import nearest
from trackfg.recording.description import Gnss
from trackfg.recording.model import FIX_COLUMNS, GNSS_COLUMNS


def positions(inputs: GraphInputs) -> list[Family]:
    """Return factors of the recording's fixes and GNSS positions, robust if the settings say so."""
    config, description = inputs.config.position, inputs.recording.description
    families = []
    fixes, gnss = inputs.recording.fixes, inputs.recording.gnss
    if fixes is not None:
        families.append(_fixes(inputs, Cauchy(config.fix_width) if config.robust else None))
    if gnss is not None and len(gnss) and description.gnss is not None:
        loss = Huber(config.gnss_width) if config.robust else None
        families.append(_gnss(inputs, gnss, description.gnss, loss))
    return families


def _gnss(inputs: GraphInputs, gnss: pd.DataFrame, description: Gnss, loss: Loss | None) -> Family:
    config = inputs.config
    rows, index = _during_run(inputs, gnss, GNSS_COLUMNS)
    t, position, sd = rows[:, 0], rows[:, 1:4], rows[:, 4:]
    lever = np.array(description.lever_arm_m) - inputs.lever_arm
    # n readings of an error with correlation time tau are worth n dt / (2 tau) independent ones.
    interval = float(np.median(np.diff(t))) if t.size > 1 else np.inf
    inflation = np.sqrt(max(1.0, 2.0 * config.position.gnss_correlation_s / interval))
    sigma = sd * (config.noise.gnss * inflation)
    variable = antenna_variable(inputs.recording.description)
    return gnss_position(index, position, lever, t - inputs.t[index], sigma, loss, variable)


def _during_run(inputs: GraphInputs, table: pd.DataFrame, columns: Sequence[str]) -> tuple[Array, np.ndarray]:
    """Return these columns of the rows within the inertial record (m, c), times first, and the nearest keyframes (m,).

    Column by column: a stream asks for each keyframe, and pandas takes longer to select several.
    """
    rows = np.stack([table[column].to_numpy(dtype=np.float64) for column in columns], axis=1)
    rows = rows[(rows[:, 0] >= inputs.data.edges[0]) & (rows[:, 0] <= inputs.data.edges[-1])]
    return rows, nearest(inputs.t, rows[:, 0])


def _fixes(inputs: GraphInputs, loss: Loss | None) -> Family:
    fixes = inputs.recording.fixes
    assert fixes is not None
    rows, index = _during_run(inputs, fixes, FIX_COLUMNS)
    t, chainage, sd = rows[:, 0], rows[:, 1], rows[:, 2:]
    carried = np.interp(t, inputs.path.t, inputs.path.speed) * (t - inputs.t[index])
    return absolute_fix(index, inputs.recording.description.track.direction * chainage - carried, sd, loss)
