"""This module lists the errors of all factors at given states in a table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family
from trackfg.factors.imu import InertialFactors
from trackfg.factors.states import States
from trackfg.numerics.arrays import Array

_COLUMNS = ("factor", "first_s", "last_s", "sigmas", "weight", "error")


def factor_errors(inertial: InertialFactors, families: Sequence[Family], states: States, t: Array) -> pd.DataFrame:
    """Return the table of :meth:`trackfg.graph.build.Problem.errors`, for keyframes at ``t`` (n,), s."""
    error = inertial.costs(states)
    parts: list[tuple[str | float | Array, ...]] = [
        (FactorType.INERTIAL.value, t[:-1], t[1:], np.sqrt(2.0 * error), 1.0, error)
    ]
    parts += [_of_family(family, states, t) for family in families]
    tables = [pd.DataFrame(dict(zip(_COLUMNS, part, strict=True))) for part in parts]
    return pd.concat(tables, ignore_index=True)


def _of_family(family: Family, states: States, t: Array) -> tuple[str | Array, ...]:
    norm, weight = np.linalg.norm(family.whitened(states), axis=1), family.weights(states)
    alone = None if family.is_chained else family.loss
    error = 0.5 * weight * norm**2 if alone is None else alone.cost(norm)
    first, last = (np.where(k < 0, np.nan, t[k]) for k in (family.first_keyframe, family.last_keyframe))
    return family.name, first, last, norm, weight, error
