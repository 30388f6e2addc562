"""Central differences check a family's Jacobians."""

from __future__ import annotations

import numpy as np

from trackfg.factors.family import Family
from trackfg.factors.states import States, retract
from trackfg.numerics.arrays import Array


def numerical_jacobians(family: Family, states: States, step: float = 1e-5) -> tuple[Array, ...]:
    """Return central differences of the residual along each tangent direction of each slot."""
    values = family.values(states)
    jacobians = []
    for j, slot in enumerate(family.slots):
        columns = []
        for c in range(slot.kind.dim):
            delta = np.zeros((len(family), slot.kind.dim))
            delta[:, c] = step
            ahead = family.evaluate(*values[:j], retract(values[j], delta), *values[j + 1 :], **family.data)[0]
            behind = family.evaluate(*values[:j], retract(values[j], -delta), *values[j + 1 :], **family.data)[0]
            columns.append((ahead - behind) / (2.0 * step))
        jacobians.append(np.stack(columns, axis=-1))
    return tuple(jacobians)


def check_jacobians(family: Family, states: States, rtol: float = 1e-6, atol: float = 1e-7) -> None:
    """Raise ``AssertionError``, naming factor, row and column, where a Jacobian differs from the numerical one."""
    analytic = family.evaluate(*family.values(states), **family.data)[1]
    for slot, ours, numeric in zip(family.slots, analytic, numerical_jacobians(family, states), strict=True):
        wrong = np.abs(ours - numeric) > atol + rtol * np.abs(numeric)
        if wrong.any():
            i, r, c = np.argwhere(wrong)[0]
            raise AssertionError(
                f"{family.name}: d residual[{r}] / d {slot.kind.name}[{c}] of factor {i} is {ours[i, r, c]:.9g}, "
                f"numerically {numeric[i, r, c]:.9g}"
            )
