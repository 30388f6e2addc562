"""A table tells the errors of all factors at given states."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family
from trackfg.factors.imu import InertialFactors
from trackfg.factors.states import States
from trackfg.numerics.arrays import Array


def factor_errors(inertial: InertialFactors, families: Sequence[Family], states: States, t: Array) -> pd.DataFrame:
    """Return the table of :meth:`trackfg.graph.build.Problem.errors`, for keyframes at ``t`` (n,), s."""
    tables = [_of_inertial(inertial, states, t), *(_of_family(family, states, t) for family in families)]
    return pd.concat(tables, ignore_index=True)


def _of_inertial(inertial: InertialFactors, states: States, t: Array) -> pd.DataFrame:
    error = inertial.costs(states)
    return pd.DataFrame(
        {
            "factor": FactorType.INERTIAL.value,
            "first_s": t[:-1],
            "last_s": t[1:],
            "sigmas": np.sqrt(2.0 * error),
            "weight": 1.0,
            "error": error,
        }
    )


def _of_family(family: Family, states: States, t: Array) -> pd.DataFrame:
    norm, weight = np.linalg.norm(family.whitened(states), axis=1), family.weights(states)
    separate = family.loss is not None and not family.is_chained
    error = family.loss.cost(norm) if family.loss is not None and separate else 0.5 * weight * norm**2
    first, last = family.first_keyframe, family.last_keyframe
    return pd.DataFrame(
        {
            "factor": family.name,
            "first_s": np.where(first < 0, np.nan, t[first]),
            "last_s": np.where(last < 0, np.nan, t[last]),
            "sigmas": norm,
            "weight": weight,
            "error": error,
        }
    )
