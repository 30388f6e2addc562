"""Fixes and GNSS measure where the vehicle is."""

from __future__ import annotations

import numpy as np
import pandas as pd

from trackfg.factors.family import Family
from trackfg.factors.gnss import gnss_position
from trackfg.factors.loss import Cauchy, Huber, Loss
from trackfg.factors.odometry import absolute_fix
from trackfg.graph.inputs import GraphInputs
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import nearest
from trackfg.recording.description import Gnss


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
    table, t, index = _during_run(inputs, gnss)
    lever = np.array(description.lever_arm_m) - inputs.lever_arm
    # n readings of an error with correlation time tau are worth n dt / (2 tau) independent ones.
    interval = float(np.median(np.diff(t))) if t.size > 1 else np.inf
    inflation = np.sqrt(max(1.0, 2.0 * config.position.gnss_correlation_s / interval))
    sigma = table[["east_sd_m", "north_sd_m", "up_sd_m"]].to_numpy() * (config.noise.gnss * inflation)
    position = table[["east_m", "north_m", "up_m"]].to_numpy()
    return gnss_position(index, position, lever, t - inputs.t[index], sigma, loss)


def _during_run(inputs: GraphInputs, table: pd.DataFrame) -> tuple[pd.DataFrame, Array, np.ndarray]:
    """Return the rows within the inertial record, their times (m,), s, and the keyframes nearest to them (m,)."""
    table = table[table["t_s"].between(inputs.data.edges[0], inputs.data.edges[-1])]
    t = table["t_s"].to_numpy()
    return table, t, nearest(inputs.t, t)


def _fixes(inputs: GraphInputs, loss: Loss | None) -> Family:
    fixes = inputs.recording.fixes
    assert fixes is not None
    table, t, index = _during_run(inputs, fixes)
    carried = np.interp(t, inputs.path.t, inputs.path.speed) * (t - inputs.t[index])
    distance = inputs.recording.description.track.direction * table["chainage_m"].to_numpy() - carried
    return absolute_fix(index, distance, table[["chainage_sd_m"]].to_numpy(), loss)
