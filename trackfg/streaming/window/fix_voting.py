"""Which place along the track is believed where fixes contradict each other.

In a batch many right fixes outvote a wrong one. A window has few at a time, and what left it has told its place: who
has believed a wrong fix would set all right ones aside. So the votes are kept. The innovation ``r = d - D`` of a fix at
``d``, with the variance ``V = var(D) + sigma^2``, is a vote

* for the place that is believed, where ``|r| <= GATE sqrt(V)``: it goes into the graph, with its robust loss;
* for another place, ``r`` further on, where not. It is withheld: it moves nothing, but is remembered
  (:func:`~trackfg.factors.odometry.withheld_fix`). Others near there are votes for the same place.

Votes for any place count up to ``MOST_VOTES``; one more for a place is one less for all others then. A place with more
votes than the believed one takes over: all of the window moves there, and what the past said of the distance alone is
let go, while all else that it knows stays. Up to then the distance is as sure as the vote is clear: a rival ``r`` away
adds

    P r^2,    P = 1/2 with as many votes as the believed place, 1/10 with one less, 0 with fewer

to its variance, as in a mixture of both.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, family_of
from trackfg.factors.marginal_prior import with_distance_shifted
from trackfg.factors.odometry import followed_fix, withheld_fix
from trackfg.factors.states import Kind, Odo, States, offset_in_keyframe
from trackfg.numerics.arrays import Array
from trackfg.solver.covariance import Covariance
from trackfg.streaming.events import StreamEvent
from trackfg.streaming.window.window import Interval, Window

GATE = 5.0
MOST_VOTES = 3
_PROBABILITIES = (0.5, 0.1)
"""Of a rival, by the votes that it is behind."""
_CREEP = 0.01
"""By which share of an interval's distance the wheel may be wrong, besides its scale."""
_USED = 0.5
"""The weight of a fix that a solution follows."""
_FIXES = (FactorType.ABSOLUTE_FIX, FactorType.WITHHELD_FIX)


@dataclass(frozen=True)
class Rival:
    """A place ``further`` m on than the believed one, known to ``sd`` m from ``votes`` fixes."""

    further: float
    sd: float
    votes: int


@dataclass
class PlaceVotes:
    """``votes`` for the believed place, and its ``rivals``. ``known`` (2, 2): covariance of the newest keyframe's
    distance (m) and wheel scale. ``said``: events that nobody has asked for yet.
    """

    votes: int = 0
    rivals: tuple[Rival, ...] = ()
    known: Array = field(default_factory=lambda: np.zeros((2, 2)))
    newest_m: float | None = None
    """Where the newest fix was: one that is read again, at rest, is no second vote."""
    said: tuple[StreamEvent, ...] = ()

    @property
    def doubt_m(self) -> float:
        """What the doubt adds to the distance's sigma, m."""
        behind = ((rival.further, self.votes - rival.votes) for rival in self.rivals)
        return float(
            np.sqrt(sum(_PROBABILITIES[less] * further**2 for further, less in behind if less < len(_PROBABILITIES)))
        )

    def told(self) -> tuple[StreamEvent, ...]:
        """The events since the last call."""
        said, self.said = self.said, ()
        return said

    def learn(self, covariance: Covariance) -> None:
        """How well the newest keyframe is known."""
        at = offset_in_keyframe(Kind.ODO)
        self.known = covariance.marginal[-1, at : at + 2, at : at + 2].copy()

    def begin(self, fixes: Family | None, states: States) -> None:
        """With the fixes of a window that was solved as a batch, which knows what to believe."""
        if fixes is None or fixes.loss is None:
            return
        used = fixes.weights(states) >= _USED
        for _ in range(np.count_nonzero(used)):
            self._agreed()
        for further, sigma in zip(-fixes.residual(states)[~used, 0], fixes.sigma[~used, 0], strict=True):
            like = self._like(float(further), float(sigma))
            votes = 1 if like is None else like.votes + 1
            self._replace(like, Rival(float(further), float(sigma), min(votes, self.votes)))

    def judged(self, new: Interval, here: States) -> tuple[Interval, float]:
        """The interval after ``here``, its fixes that contradict withheld; and by how much the believed place changes
        by them, m, which the interval is not moved by yet.
        """
        fixes = family_of(new.families, FactorType.ABSOLUTE_FIX)
        if fixes is None or fixes.loss is None:
            return new, 0.0
        moved, withheld = 0.0, np.zeros(len(fixes), dtype=bool)
        ends = (float(here.odo.distance[-1]), float(new.ahead.odo.distance[0]))
        gone = ends[1] - ends[0]
        for i, at in enumerate(fixes.slots[0].index.tolist()):
            along = np.array([1.0, gone if at else 0.0])
            variance = float(along @ self.known @ along) + (_CREEP * along[1]) ** 2
            place, sigma = float(fixes.data["distance"][i, 0]), float(fixes.sigma[i, 0])
            further, sd = place - ends[at] - moved, float(np.hypot(sigma, np.sqrt(variance)))
            again = self.newest_m is not None and abs(place - self.newest_m) <= sigma
            self.newest_m = place
            if abs(further) <= GATE * sd:
                if not again:
                    self._agreed()
                continue
            step = 0.0 if again else self._contradicted(further, sigma, sd)
            moved += step
            withheld[i] = not step
            if step:
                detail = f"{self.votes} fixes agree on a place {step:+.1f} m on"
                self.said += (StreamEvent("place-changed", "fixes", new.t, new.t, 0, detail),)
        if not withheld.any():
            return new, moved
        others = tuple(family for family in new.families if family is not fixes)
        own = (fixes.take(~withheld), withheld_fix(fixes.take(withheld)))
        return new._replace(families=(*others, *(family for family in own if len(family)))), moved

    def _agreed(self) -> None:
        if self.votes < MOST_VOTES:
            self.votes += 1
        else:
            self.rivals = _fewer(self.rivals)

    def _contradicted(self, further: float, sigma: float, sd: float) -> float:
        """By how much the believed place changes by a fix of another one: mostly 0."""
        like = self._like(further, sd)
        votes = 1 if like is None else like.votes + 1
        if votes <= self.votes:
            self._replace(like, Rival(further, sigma, votes))
            return 0.0
        self._replace(like, Rival(0.0, sigma, self.votes))
        self.rivals = tuple(replace(rival, further=rival.further - further) for rival in self.rivals)
        self.votes = votes
        if votes > MOST_VOTES:
            self.votes, self.rivals = MOST_VOTES, _fewer(self.rivals)
        return further

    def _like(self, further: float, sd: float) -> Rival | None:
        """The rival that a place known to ``sd`` m may be."""
        near = [rival for rival in self.rivals if abs(rival.further - further) <= GATE * np.hypot(sd, rival.sd)]
        return min(near, key=lambda rival: abs(rival.further - further), default=None)

    def _replace(self, old: Rival | None, new: Rival) -> None:
        """With a ``new`` rival in the place of an ``old`` one, if it has votes."""
        self.rivals = (*(rival for rival in self.rivals if rival is not old), *((new,) if new.votes else ()))


def _fewer(rivals: tuple[Rival, ...]) -> tuple[Rival, ...]:
    return tuple(replace(rival, votes=rival.votes - 1) for rival in rivals if rival.votes > 1)


def moved_states(states: States, by_m: float) -> States:
    """Further along the track."""
    return replace(states, odo=states.odo.moved_along(by_m))


def moved_interval(interval: Interval, by_m: float) -> Interval:
    """The same, elsewhere."""
    return interval._replace(ahead=moved_states(interval.ahead, by_m))


def moved_window(window: Window, by_m: float) -> Window:
    """The same, ``by_m`` further along the track, to about ``by_m``: what was believed of the place is let go, and of
    the window's fixes those are followed that agree.
    """
    states = moved_states(window.states, by_m)
    families = [_moved(family, by_m) for family in window.families if family.type not in _FIXES]
    fixes = [family for family in window.families if family.type in _FIXES]
    followed, withheld = [], []
    for family in fixes:
        near = np.abs(family.residual(states)[:, 0]) < 0.5 * abs(by_m)
        followed.append(followed_fix(family.take(near)))
        withheld.append(withheld_fix(family.take(~near)))
    for parts in (followed, withheld):
        filled = [part for part in parts if len(part)]
        families += [filled[0].joined(*filled[1:])] if filled else []
    return replace(window, states=states, families=tuple(families))


def _moved(family: Family, by_m: float) -> Family:
    if family.type is FactorType.MARGINAL_PRIOR:
        return with_distance_shifted(family, by_m, abs(by_m))
    if family.type is FactorType.PRIOR_ODO:
        sigma = np.hypot(family.sigma, np.array([abs(by_m), 0.0, 0.0, 0.0]))
        return replace(family, data={"mean": Odo(family.data["mean"]).moved_along(by_m).array}, sigma=sigma)
    return family
