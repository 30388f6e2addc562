"""The factors of two keyframes, linearised and stacked: what a filter step factorises.

Where compiled kernels are in use, ``kernels/pair.cpp`` does it at once for all families that have a kernel; linearising
one after the other and :func:`~trackfg.solver.elimination.stacked_pair` are its reference.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from trackfg.factors.family import Family, LinearRows, kernel_of, row_norms
from trackfg.factors.imu import InertialFactors
from trackfg.factors.marginal_prior import PriorRows
from trackfg.factors.states import KEYFRAME_DIM, SHARED_DIM, Kind, States
from trackfg.numerics.arrays import Array
from trackfg.numerics.kernels import compiled_kernels
from trackfg.solver.placed_factors import stacked_pair

_NO_INERTIAL = InertialFactors(())


def linearised_pair(states: States, families: Iterable[Family], inertial: InertialFactors = _NO_INERTIAL) -> Array:
    """Return rows [A b] over (x_0, x_1, s) of factors on the ``states`` of two keyframes, linearised there.

    Raises ``ValueError`` where a number is not finite.
    """
    filled = [family for family in families if len(family)]
    if compiled_kernels():
        return _by_kernel(states, filled, inertial)
    linear = [inertial.linearize(states)] if inertial.measured else []
    return stacked_pair([*linear, *(family.linearize(states) for family in filled)], len(states.sensor))


def _by_kernel(states: States, families: Sequence[Family], inertial: InertialFactors) -> Array:
    """Do as :func:`linearised_pair`, with the rows in another order."""
    from trackfg.numerics import compiled

    priors, of_types, typed, others = [], [], [], []
    for family in families:
        kernel = kernel_of(family)
        if isinstance(kernel, PriorRows):
            priors.append(kernel.arguments(family, states))
        elif isinstance(kernel, LinearRows):
            width = 0.0 if family.loss is None else family.loss.kernel_width
            of_types.append((kernel.name, *kernel.arguments(family), width))
            typed.append(family)
        else:
            others.append(family.linearize(states))
    begin = Kind.NAV.dim * len(inertial.measured) + sum(len(prior[-1]) for prior in priors)
    columns = 2 * KEYFRAME_DIM + SHARED_DIM + states.sensor.size + 1
    rows = np.empty((begin + sum(family.rows for family in typed), columns))
    if not compiled.pair_rows(states.arrays, inertial.deltas, tuple(priors), tuple(of_types), rows):
        raise ValueError("a residual or Jacobian of the newest keyframes is not finite")
    for family in typed:
        end = begin + family.rows
        if family.loss is not None and not family.loss.kernel_width:  # a chain, whose weights are those of all together
            weight = np.sqrt(family.loss.weight(row_norms(rows[begin:end, -1].reshape(family.sigma.shape))))
            rows[begin:end] *= weight.repeat(family.sigma.shape[1])[:, None]
        begin = end
    return np.concatenate([rows, stacked_pair(others, len(states.sensor))]) if others else rows
