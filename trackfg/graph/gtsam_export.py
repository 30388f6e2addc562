"""The graph of a run is exported as GTSAM's own objects, with the meaning of their keys.

Inertial factors are GTSAM's ``ImuFactor2``; every other factor is a ``gtsam.CustomFactor`` of its family
(:mod:`trackfg.factors.gtsam_bridge`), with the family's loss as a robust noise model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pandas as pd

from trackfg.factors.family import Family
from trackfg.factors.gtsam_bridge import chain_ordering, custom_factors, states_at, with_frozen_chain
from trackfg.factors.states import Kind, States
from trackfg.numerics.arrays import Array
from trackfg.numerics.key_figures import Outlined

if TYPE_CHECKING:
    import gtsam


class Variable(NamedTuple):
    """A variable is what a GTSAM key stands for.

    ``number`` is that of the keyframe, and ``t_s`` its time, s; of a variable that the whole run shares, ``number`` is
    that among those of its kind (further sensors have one each), and ``t_s`` is None.

    Examples
    --------
    >>> import trackfg
    >>> from trackfg.graph import build_problem
    >>> exported = build_problem(trackfg.read_recording("run1"), trackfg.SmoothConfig()).to_gtsam()
    >>> variable = exported.variable(exported.values.keys()[0])
    >>> variable.kind.name, variable.number
    ('BIAS', 0)
    """

    kind: Kind
    number: int
    t_s: float | None


@dataclass(frozen=True, repr=False)
class GtsamProblem(Outlined):
    """The exported graph can be used with GTSAM's optimisers and factors.

    Attributes
    ----------
    graph : gtsam.NonlinearFactorGraph
        The inertial factors, one per interval between keyframes, then the families in their order.
    values : gtsam.Values
        A value of every variable: ``gtsam.NavState`` for ``Kind.NAV`` (attitude, position and velocity of the IMU in
        east, north, up), ``gtsam.imuBias.ConstantBias`` for ``Kind.BIAS``, vectors for all others.
    t : array, shape (n,)
        Times of the keyframes, s.
    sensors : int
        Number of further sensors of distance and speed.

    Examples
    --------
    >>> import trackfg
    >>> from trackfg.graph import build_problem
    >>> exported = build_problem(trackfg.read_recording("run1"), trackfg.SmoothConfig()).to_gtsam()
    >>> exported.graph.size() > 100
    True
    """

    graph: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    t: Array
    sensors: int

    def _count(self, kind: Kind) -> int:
        if kind is Kind.SENSOR:
            return self.sensors
        return 1 if kind.shared else len(self.t)

    def key(self, kind: Kind, number: int = 0) -> int:
        """Return the key of a variable; ``number`` counts keyframes from 0, negative ones from the end.

        Raises ``TypeError`` for what is no kind, and ``IndexError`` for a number that this graph does not have.
        """
        if not isinstance(kind, Kind):
            raise TypeError(f"{kind!r} is no kind of variable: expected one such as Kind.NAV")
        count = self._count(kind)
        if not -count <= number < count:
            numbers = f"a number from 0 to {count - 1}" if count else "another kind"
            raise IndexError(f"the graph has no variable {kind.name} {number}: expected {numbers}")
        return int(kind.keys(np.array([range(count)[number]]))[0])

    def key_at(self, kind: Kind, t_s: float) -> int:
        """Return the key of the variable at the keyframe nearest to the time ``t_s``, s.

        Raises ``ValueError`` for a time before the first or after the last keyframe by more than these are apart.
        """
        beyond = max(self.t[0] - t_s, t_s - self.t[-1])
        if not beyond <= np.max(np.diff(self.t), initial=0.0):
            raise ValueError(f"the graph has no keyframe at {t_s:g} s: expected {self.t[0]:g} to {self.t[-1]:g} s")
        return self.key(kind, int(np.argmin(np.abs(self.t - t_s))))

    def variable(self, key: int) -> Variable:
        """Return what a key stands for. Raises ``ValueError`` for one that this graph does not have."""
        import gtsam

        symbol = gtsam.Symbol(key)
        kind = next((kind for kind in Kind if ord(kind.letter) == symbol.chr()), None)
        if kind is None or symbol.index() >= self._count(kind):
            raise ValueError(f"the graph has no variable {symbol.string()}")
        number = symbol.index()
        return Variable(kind, number, None if kind.shared else self.t[number])

    @property
    def variables(self) -> pd.DataFrame:
        """All variables as a table: key, symbol, kind, number, t_s, which is missing for shared ones."""
        import gtsam

        keys = list(self.values.keys())
        rows = [(key, gtsam.Symbol(key).string(), *self.variable(key)) for key in keys]
        table = pd.DataFrame(rows, columns=["key", "symbol", "kind", "number", "t_s"])
        return table.assign(kind=[kind.name for kind in table["kind"]])

    @property
    def ordering(self) -> gtsam.Ordering:
        """The order of elimination along the chain, shared variables last: the fastest one for QR."""
        return chain_ordering(len(self.t), self.sensors)

    def states(self, values: gtsam.Values) -> States:
        """Return optimised ``values`` of this graph's variables as states."""
        return states_at(values, len(self.t), self.sensors)


def exported(native: gtsam.NonlinearFactorGraph, families: Sequence[Family], states: States, t: Array) -> GtsamProblem:
    """Return the inertial factors and the families as a graph of GTSAM's, at ``states`` of keyframes at ``t``."""
    import gtsam

    graph = gtsam.NonlinearFactorGraph(native)
    for family in families:
        for factor in custom_factors(with_frozen_chain(family, states)):
            graph.push_back(factor)
    return GtsamProblem(graph, states.to_gtsam(), t, len(states.sensor))
