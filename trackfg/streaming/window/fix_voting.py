"""Fixes vote on where along the track the vehicle is, where they contradict each other.

A window holds only a few fixes, and marginalised fixes can no longer be revised: after accepting one wrong fix, the
robust loss would reject every correct one. So votes are counted per hypothesis of the vehicle's position. With the
estimated distance D, the innovation of a fix at d is ``r = d - D`` with the variance ``V = var(D) + sigma^2 + c^2``,
where c is 1 % of the way since the newest keyframe: creep that the scale does not cover. The fix

* votes for the accepted hypothesis, where ``|r| <= GATE sqrt(V)``: it goes into the graph, with its robust loss;
* or shows that the wheel crept since the last one that did, where that is likelier than that the fix is wrong
  (:mod:`trackfg.streaming.window.wheel_creep`): the place shifts, and distance and scale are less sure;
* or else for a rival hypothesis, ``r`` further along the track. It is withheld: a factor that moves nothing
  (:func:`~trackfg.factors.odometry.withheld_fix`). Other fixes that agree with it vote for the same hypothesis.

Votes for a hypothesis count up to ``MOST_VOTES``; a further one takes a vote from each rival instead. A rival with more
votes than the accepted hypothesis replaces it: the window is shifted along the track, and its marginal prior loses what
it knows of the distance alone. Until then, a rival at r adds, as in a mixture of both hypotheses, to the variance of
the distance

    P r^2,    P = 1/2 with as many votes as the accepted hypothesis, 1/10 with one less, 0 with fewer.

What was written before a rival had any vote does not know of it: its chainage is doubted once the rival is accepted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, family_of
from trackfg.factors.marginal_prior import with_distance_shifted
from trackfg.factors.odometry import followed_fix, withheld_fix
from trackfg.factors.states import Kind, Odo, States, offset_in_keyframe
from trackfg.numerics.arrays import Array
from trackfg.results.events import Event, doubt_event
from trackfg.solver.covariance import Covariance
from trackfg.streaming.window.wheel_creep import Creep
from trackfg.streaming.window.window import Interval, Window

GATE = 5.0
"""Maximum innovation that agrees with a hypothesis, in its own sigmas."""
MOST_VOTES = 3
"""Votes that a hypothesis can hold: it withstands so many wrong fixes that agree, and one more replaces it."""
_PROBABILITIES = (0.5, 0.1)
"""The probability of a rival, by how many votes it has less than the accepted hypothesis."""
_CREEP = 0.01
"""Wheel creep that the scale does not cover, as a share of an interval's distance."""
_USED = 0.5
"""A fix with a larger robust weight is followed by the solution."""
_MOST_INNOVATIONS = 300
"""So many of the newest innovations are kept: readers do not change."""
_FIXES = (FactorType.ABSOLUTE_FIX, FactorType.WITHHELD_FIX)


@dataclass(frozen=True)
class Rival:
    """A hypothesis ``further_m`` along the track from the accepted one, with the sigma ``sd_m`` and its ``votes``."""

    further_m: float
    sd_m: float
    votes: int


@dataclass
class FixVotes:
    """The ``votes`` for the accepted hypothesis, and its ``rivals``.

    ``distance_scale_covariance`` (2, 2): of the newest keyframe's distance (m) and wheel scale. ``newest_m``: position
    of the newest fix; one that is read again at rest is no second vote. ``agreed_m``, ``agreed_s``: place and time of
    the newest one that agreed. ``creep``: what a fix has shown and has not been popped; the scale walks by
    ``walk_per_sqrt_m`` until ``walks_for`` more fixes agree. ``tested``, ``squares``: the number of fixes that agreed
    after the first, and the sum of the squares of their innovations in variances; ``innovations`` (n, 3) has the
    newest, m, with the sigma of the fix, m, and the variance of its prediction, m^2. ``written_s``: up to when
    estimates are written; ``placed_s``: since when they have the accepted position, None without any. ``events`` have
    not been popped, nor has ``shift_m``, by which the position shifted.
    """

    votes: int = 0
    rivals: tuple[Rival, ...] = ()
    distance_scale_covariance: Array = field(default_factory=lambda: np.zeros((2, 2)))
    newest_m: float | None = None
    agreed_m: float | None = None
    agreed_s: float = 0.0
    tested: int = 0
    squares: float = 0.0
    innovations: Array = field(default_factory=lambda: np.zeros((0, 3)))
    written_s: float = -np.inf
    placed_s: float | None = None
    creep: Creep | None = None
    walk_per_sqrt_m: float = 0.0
    walks_for: int = 0
    events: tuple[Event, ...] = ()
    shift_m: float = 0.0

    @property
    def doubt_m(self) -> float:
        """The sigma that the rivals add to the distance, m."""
        deficits = ((rival.further_m, self.votes - rival.votes) for rival in self.rivals)
        variances = (_PROBABILITIES[k] * further**2 for further, k in deficits if k < len(_PROBABILITIES))
        return float(np.sqrt(sum(variances)))

    def pop_events(self) -> tuple[Event, ...]:
        """Return the events since the last call."""
        events, self.events = self.events, ()
        return events

    def pop_creep(self) -> Creep | None:
        """Return the creep that a fix has shown since the last call."""
        creep, self.creep = self.creep, None
        return creep

    def pop_shift(self) -> float:
        """Return by how much the accepted position has shifted since the last call, m."""
        shift_m, self.shift_m = self.shift_m, 0.0
        return shift_m

    def update_covariance(self, covariance: Covariance) -> None:
        """Take the part of the newest keyframe's covariance that predictions of fixes need."""
        at = offset_in_keyframe(Kind.ODO)
        self.distance_scale_covariance = covariance.of_keyframes[-1, at : at + 2, at : at + 2].copy()

    def count_first_window(self, fixes: Family | None, states: States, t: Array) -> None:
        """Count the fixes of a window that was solved as a batch, keyframes at ``t`` (n,), s, by whether its solution
        follows them.
        """
        if fixes is None or fixes.loss is None:
            return
        used = fixes.weights(states) >= _USED
        for keyframe, position in zip(fixes.slots[0].index[used], fixes.data["distance"][used, 0], strict=True):
            self._count_agreement(float(position), float(t[keyframe]))
        for further, sigma in zip(-fixes.residual(states)[~used, 0], fixes.sigma[~used, 0], strict=True):
            rival = self._nearest_rival(float(further), float(sigma))
            votes = 1 if rival is None else rival.votes + 1
            self._replace(rival, Rival(float(further), float(sigma), min(votes, self.votes)))

    def vote_on_fixes(self, interval: Interval, newest: States, others_sd_m: float = 0.0) -> tuple[Interval, float]:
        """Count the fixes of the interval after the ``newest`` keyframe; return it with contradicting fixes withheld.

        The second value is by how much the accepted position shifts, m; the interval is not shifted by it, nor by the
        ``creep`` that a fix may show. ``others_sd_m``: the sigma with which others than wheels locate the vehicle,
        infinite where there are none; creep beyond it would not go unnoticed.
        """
        fixes = family_of(interval.families, FactorType.ABSOLUTE_FIX)
        if fixes is None or fixes.loss is None:
            return interval, 0.0
        shift_m, withheld = 0.0, np.zeros(len(fixes), dtype=bool)
        ends = (float(newest.odo.distance[-1]), float(interval.predicted.odo.distance[0]))
        for i, keyframe in enumerate(fixes.slots[0].index.tolist()):
            along = np.array([1.0, ends[1] - ends[0] if keyframe else 0.0])
            variance = float(along @ self.distance_scale_covariance @ along) + (_CREEP * along[1]) ** 2
            position, sigma = float(fixes.data["distance"][i, 0]), float(fixes.sigma[i, 0])
            moved = shift_m + (0.0 if self.creep is None else self.creep.further_m)
            innovation, sd = position - ends[keyframe] - moved, float(np.hypot(sigma, np.sqrt(variance)))
            repeated = self.newest_m is not None and abs(position - self.newest_m) <= sigma
            self.newest_m = position
            if abs(innovation) <= GATE * sd:
                if not repeated:
                    if self.votes:
                        self._test(innovation, sigma, variance)
                    self._count_agreement(position, interval.t)
                continue
            if others_sd_m and not repeated and not shift_m:
                creep = self._creep_since_agreement(innovation, position)
                if creep is not None and creep.is_likely(sd**2, others_sd_m):
                    self._follow(creep, sd, position, interval.t)
                    continue
            shift = 0.0 if repeated else self._count_contradiction(innovation, sigma, sd, position, interval.t)
            shift_m += shift
            withheld[i] = not shift
        if not withheld.any():
            return interval, shift_m
        others = tuple(family for family in interval.families if family is not fixes)
        parted = (fixes.take(~withheld), withheld_fix(fixes.take(withheld)))
        return interval._replace(families=(*others, *(family for family in parted if len(family)))), shift_m

    def _test(self, innovation: float, sigma: float, variance: float) -> None:
        """Count the innovation of a fix with its ``sigma``, m, and the ``variance`` of its prediction, m^2."""
        self.tested, self.squares = self.tested + 1, self.squares + innovation**2 / (sigma**2 + variance)
        self.innovations = np.concatenate([self.innovations, [[innovation, sigma, variance]]])[-_MOST_INNOVATIONS:]

    def _leave_place(self, shift_m: float) -> None:
        """Add the event that rows written with the position given up are off by ``shift_m``."""
        self.shift_m += shift_m
        if self.placed_s is not None and self.placed_s < self.written_s:
            reason = f"by {shift_m:+.1f} m, as more fixes say than those that placed the vehicle"
            advice, since, until = "correct it by as much, or smooth the recording", self.placed_s, self.written_s
            self.events += (doubt_event(("chainage",), reason, advice, table="fixes", t_s=since, until_s=until),)
        self.placed_s = self.written_s

    def _count_agreement(self, position: float, t: float) -> None:
        """Count a vote of a fix at ``position``, m, and time ``t``, s, for the accepted hypothesis."""
        self.agreed_m, self.agreed_s = position, t
        if self.placed_s is None:
            self.placed_s = self.written_s
        self.walks_for = max(self.walks_for - 1, 0)
        if not self.walks_for:
            self.walk_per_sqrt_m = 0.0
        if self.votes < MOST_VOTES:
            self.votes += 1
        else:
            self.rivals = _with_vote_less(self.rivals)

    def _creep_since_agreement(self, innovation: float, position: float) -> Creep | None:
        """Return the creep that a fix at ``position``, m, would show; None where none agreed since the last creep."""
        if self.agreed_m is None or self.creep is not None:
            return None
        return Creep(innovation, position - innovation - self.agreed_m, self.agreed_s)

    def _follow(self, creep: Creep, sd: float, position: float, t: float) -> None:
        """Take it that the wheel crept, as a fix at ``position``, m, and time ``t``, s, with an innovation of sigma
        ``sd``, m, shows.
        """
        self.creep, self.walk_per_sqrt_m, self.walks_for = creep, creep.walk_per_sqrt_m, MOST_VOTES
        self.agreed_m, self.agreed_s = position, t
        moved = tuple(replace(rival, further_m=rival.further_m - creep.further_m) for rival in self.rivals)
        self.rivals = tuple(rival for rival in moved if abs(rival.further_m) > GATE * np.hypot(sd, rival.sd_m))
        self.events += (creep.event(t),)

    def _count_contradiction(self, innovation: float, sigma: float, sd: float, position: float, t: float) -> float:
        """Return by how much the accepted position shifts, m: 0 unless the fix makes a rival the accepted one.

        ``position``, m, and ``t``, s: of the fix.
        """
        rival = self._nearest_rival(innovation, sd)
        votes = 1 if rival is None else rival.votes + 1
        if votes <= self.votes:
            self._replace(rival, Rival(innovation, sigma, votes))
            return 0.0
        self._replace(rival, Rival(0.0, sigma, self.votes))
        self.rivals = tuple(replace(other, further_m=other.further_m - innovation) for other in self.rivals)
        self.votes, self.agreed_m, self.agreed_s = votes, position, t
        if votes > MOST_VOTES:
            self.votes, self.rivals = MOST_VOTES, _with_vote_less(self.rivals)
        detail = f"{'1 fix agrees' if votes == 1 else f'{votes} fixes agree'} on a place {innovation:+.1f} m on"
        self.events += (Event("place-changed", "fixes", t, t, 0, detail),)
        self._leave_place(innovation)
        return innovation

    def _nearest_rival(self, further_m: float, sd_m: float) -> Rival | None:
        """Return the nearest rival that agrees with a position ``further_m`` along, with the sigma ``sd_m``, m."""
        near = [rival for rival in self.rivals if abs(rival.further_m - further_m) <= GATE * np.hypot(sd_m, rival.sd_m)]
        return min(near, key=lambda rival: abs(rival.further_m - further_m), default=None)

    def _replace(self, old: Rival | None, new: Rival) -> None:
        """Put a new rival in the place of an old one, if it has votes."""
        self.rivals = (*(rival for rival in self.rivals if rival is not old), *((new,) if new.votes else ()))


def _with_vote_less(rivals: tuple[Rival, ...]) -> tuple[Rival, ...]:
    return tuple(replace(rival, votes=rival.votes - 1) for rival in rivals if rival.votes > 1)


def shift_interval(interval: Interval, begin: States, by_m: float) -> Interval:
    """Return the interval, which begins at the state ``begin``, ``by_m`` further along the track.

    Of its fixes those are followed that agree with the new position.
    """
    predicted = interval.predicted.moved_along(by_m)
    families = _with_fixes_followed_anew(interval.families, begin.moved_along(by_m).joined(predicted), by_m)
    return interval._replace(predicted=predicted, families=families)


def shift_window(window: Window, by_m: float) -> Window:
    """Return the window ``by_m`` further along the track, known to about ``by_m``.

    Its priors lose what they know of the distance; of its fixes those are followed that agree with the new position.
    """
    states = window.states.moved_along(by_m)
    families = _with_fixes_followed_anew([_shift_prior(family, by_m) for family in window.families], states, by_m)
    return replace(window, states=states, families=families)


def _with_fixes_followed_anew(families: Sequence[Family], states: States, by_m: float) -> tuple[Family, ...]:
    """Return families whose fixes are followed where they are nearer to these ``states`` than half the shift."""
    others = [family for family in families if family.type not in _FIXES]
    followed, withheld = [], []
    for family in families:
        if family.type in _FIXES:
            near = np.abs(family.residual(states)[:, 0]) < 0.5 * abs(by_m)
            followed.append(followed_fix(family.take(near)))
            withheld.append(withheld_fix(family.take(~near)))
    for parts in (followed, withheld):
        filled = [part for part in parts if len(part)]
        others += [filled[0].joined(*filled[1:])] if filled else []
    return tuple(others)


def _shift_prior(family: Family, by_m: float) -> Family:
    if family.type is FactorType.MARGINAL_PRIOR:
        return with_distance_shifted(family, by_m, abs(by_m))
    if family.type is FactorType.PRIOR_ODO:
        sigma = np.hypot(family.sigma, np.array([abs(by_m), 0.0, 0.0, 0.0]))
        return replace(family, data={"mean": Odo(family.data["mean"]).moved_along(by_m).array}, sigma=sigma)
    return family
