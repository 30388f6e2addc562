"""The sources of a run's events: rests, holes, the wheel, and the factors whose outliers are events."""

from __future__ import annotations

from dataclasses import dataclass

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, family_of
from trackfg.graph.build import Problem
from trackfg.numerics.arrays import Array
from trackfg.sensors.tach import Wheel


@dataclass(frozen=True)
class EventSources:
    """A batch run has them in its problem; a stream keeps them for keyframes that it has marginalised.

    ``t`` (n,) s are the keyframes' times, ``rests`` (r, 2) and ``gaps`` of the inertial record (g, 2) are spans in s;
    ``clock_origin`` (s) is when the offsets of other clocks are what the states say; ``direction`` is that of chainage;
    ``usual_gnss`` (3,) what the sigmas of GNSS positions usually are in declared ones, None where the families show it.
    """

    t: Array
    direction: int
    rests: Array
    gaps: Array
    wheel: Wheel | None
    clock_origin: float
    families: tuple[Family, ...]
    usual_gnss: Array | None = None

    @classmethod
    def of(cls, problem: Problem) -> EventSources:
        """Take them from a whole problem."""
        return cls(
            t=problem.t,
            direction=problem.run.direction,
            rests=problem.rests,
            gaps=problem.gaps,
            wheel=problem.wheel,
            clock_origin=problem.clock_origin,
            families=(*problem.families, *problem.withheld),
        )

    def family(self, kind: FactorType) -> Family | None:
        """Return the first family of that type; None where there is none."""
        return family_of(self.families, kind)
