"""A stream learns how good its GNSS positions and speeds are from their residuals, as the batch does from a run's.

A receiver's errors last: in a street canyon it is off by 5-10 m for tens of seconds where it declares 2 m, and
positions that share an error count once. The record holds each position's residual after its keyframe's estimate, and
at each relinearisation pass the batch's own judgement of level and correlation
(:mod:`trackfg.smoothing.lasting_errors`) says by what factor the declared sigmas are too small: of the positions in the
window each its own, of those to come that of the newest one. A stream only widens them: what it has marginalised it
cannot doubt any more.

Residuals of positions are those of wheel and inertial sensor where these err by more than is assumed of them. So GNSS
is not judged, and what was learnt is forgotten, while another group of residuals is further beyond its sigmas
(:mod:`~trackfg.streaming.window.records.noise_record`), or while the sigmas of the speed are doubted
(:mod:`trackfg.streaming.doubts.sigma_test`) and residuals have shown another group to be noisier than declared.

If the stream is what errs, its residuals grow as positions lose their weight, and they would lose more. So where they
have had little for longer than a receiver's errors last, and residuals are beyond the level that was seen when that
began, positions get their weight back, and what was written meanwhile is doubted.

Speeds of the receiver have a record of their own, of the same kind, with one value each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, changed, family_of
from trackfg.factors.loss import Huber
from trackfg.numerics.arrays import Array
from trackfg.results.events import Event, doubt_event
from trackfg.smoothing.gnss_errors import FEWEST, SharedError, shared_error
from trackfg.smoothing.lasting_errors import LONGEST_S, errors_seen, have_changed, have_grown, without_outliers
from trackfg.solver.covariance import Covariance
from trackfg.solver.leave_one_out import predicted
from trackfg.streaming.rows import SAME_S
from trackfg.streaming.window.window import Window

_MOST = 600
"""Positions that are remembered: ten minutes of them once a second, as long as the runs that the batch's judgement was
tried on; errors change with the surroundings."""

_FAR = 10.0
"""Declared sigmas that no receiver is off most of the time, also where houses stand: 2 m declared are 5-10 m there.
Positions with east and north exchanged are off by thousands."""

_LITTLE = 3.0
"""Factor on the declared sigmas from which on positions have little weight: a ninth of what they would have."""

_LATELY_S = 30.0
"""Residuals of so long, s, are held against the level: the errors of some independent positions."""


@dataclass
class GnssRecord:
    """The record holds the newest positions, one a row: time ``t`` (m,), s; ``residual`` and ``variance`` of the
    predicted position, both in declared sigmas; and the ``declared`` sigma, m; each of shape (m, 3).

    ``factor`` (m, 3) is what sigmas are multiplied by, ``expected`` (3,) what those of the next positions are, and
    ``given`` (m, 3) what they were when the position came. ``level`` (m, 3) is that of the errors then, and
    ``newest_level`` (3,) that of the next. ``regained`` (k, 2): from when to when positions had too little weight, s.
    ``lasting``: the root of the number of positions that share an error; whether one is an outlier is judged without
    it, so the loss is as much narrower. All of it is learnt from positions after ``since_s``. A record of speeds, of
    that ``kind`` of factor, has one column instead of three, and m/s for m.
    """

    t: Array = field(default_factory=lambda: np.zeros(0))
    residual: Array = field(default_factory=lambda: np.zeros((0, 3)))
    variance: Array = field(default_factory=lambda: np.zeros((0, 3)))
    declared: Array = field(default_factory=lambda: np.zeros((0, 3)))
    factor: Array = field(default_factory=lambda: np.ones((0, 3)))
    expected: Array = field(default_factory=lambda: np.ones(3))
    given: Array = field(default_factory=lambda: np.ones((0, 3)))
    level: Array = field(default_factory=lambda: np.ones((0, 3)))
    newest_level: Array = field(default_factory=lambda: np.ones(3))
    regained: Array = field(default_factory=lambda: np.zeros((0, 2)))
    lasting: float = 1.0
    since_s: float = -np.inf
    kind: FactorType = FactorType.GNSS_POSITION

    @classmethod
    def of_speeds(cls) -> GnssRecord:
        """Return the record of a receiver's speeds before the first."""
        none, ones, unit = np.zeros((0, 1)), np.ones((0, 1)), np.ones(1)
        return cls(
            residual=none,
            variance=none,
            declared=none,
            factor=ones,
            expected=unit,
            given=ones,
            level=ones,
            newest_level=unit,
            kind=FactorType.GNSS_SPEED,
        )

    def put(self, window: Window, covariance: Covariance) -> None:
        """Remember the positions at the last two keyframes of a window, of which ``covariance`` is."""
        family, older = family_of(window.families, self.kind), len(window) - 2
        if family is None or family.loss is None:
            return
        family = family.take(family.slots[0].index >= older)
        family = family.take(_times(family, window.t) > (self.t[-1] + SAME_S if self.t.size else -np.inf))
        if not len(family):
            return
        residual, S = predicted(family.shifted(-older), window.states.take(slice(older, None)), covariance)
        declared = family.sigma / self.expected
        rows = {
            "t": _times(family, window.t),
            "residual": residual / declared,
            "variance": np.diagonal(S, axis1=1, axis2=2) / declared**2,
            "declared": declared,
            "factor": np.tile(self.expected, (len(family), 1)),
            "given": np.tile(self.expected, (len(family), 1)),
            "level": np.tile(self.newest_level, (len(family), 1)),
        }
        for name, new in rows.items():
            setattr(self, name, np.concatenate([getattr(self, name), new])[-_MOST:])

    @property
    def usual(self) -> Array:
        """The usual sigmas of positions, in declared ones, (3,)."""
        judged = self.factor[self.t > self.since_s]
        return np.median(judged, axis=0) if len(judged) else np.ones_like(self.expected)

    def judge(self, *, heading_known: bool) -> bool:
        """Compute the factors anew, and return whether they have changed.

        Only a vehicle that has shown its heading, in motion, also determines its own position.
        """
        previous = self.factor.copy()
        if heading_known and self._err_less_than_the_rest():
            self._regain()
        judged = self.t > self.since_s
        if np.count_nonzero(judged) >= FEWEST:
            weighted = bool(np.any(self.factor[judged] > 1.0))
            errors = errors_seen(self.t[judged], self.residual[judged], self.variance[judged], weighted=weighted)
            self.factor[judged] = np.maximum(errors.factor, 1.0)
            self.lasting = float(np.sqrt(np.median(errors.correlation)))
            self.newest_level = np.maximum(errors.level[-1], 1.0)
        return len(previous) > 0 and have_changed(previous, self.factor)

    @property
    def rest_erred(self) -> bool:
        """Return whether positions have been right once against all else: the wheel's scale walks from then on."""
        return len(self.regained) > 0

    def _err_less_than_the_rest(self) -> bool:
        """Return whether positions had little weight for longer than their errors last, and residuals have grown."""
        if not self.t.size or self.t[-1] - max(self.t[0], self.since_s) < LONGEST_S:
            return False
        longest, lately = np.searchsorted(self.t, self.t[-1] - np.array([LONGEST_S, _LATELY_S]))
        little = bool(np.all(self.given[longest:, 0] > _LITTLE))
        level = self.level[longest]
        return little and have_grown(without_outliers(self.kind, self.residual[lately:], level), level)

    def _regain(self) -> None:
        """Forget, and remember that positions had too little weight."""
        enough = np.flatnonzero(self.given[:, 0] <= _LITTLE)
        since = max(float(self.t[enough[-1] + 1] if enough.size else self.t[0]), self.since_s)
        self.regained = np.concatenate([self.regained, [[since, self.t[-1]]]])
        self.forget()

    def forget(self) -> None:
        """Give positions to come their declared weight, and learn from them only; those that were keep theirs."""
        if self.t.size:
            self.since_s = float(self.t[-1])
        self.expected, self.newest_level = np.ones_like(self.expected), np.ones_like(self.expected)
        self.lasting = 1.0

    def events(self, until_s: float) -> tuple[Event, ...]:
        """Return an event for each span in which positions had too little weight, and one if most of the newest are
        further off than any receiver's, known at the end of a stream.
        """
        if self.kind is FactorType.GNSS_SPEED:
            quantities: tuple[str, ...] = ("chainage", "speed")
            name, declared = "speeds of the receiver", "gnss_speed.unit and its sigmas"
        else:
            quantities, name = ("position", "yaw", "chainage", "speed"), "GNSS positions"
            declared = "the order, unit and sigmas of gnss.position and the axes of the gyro"
        less, advice = f"{name} had too little weight", "smooth the recording"
        spans = tuple(
            doubt_event(quantities, less, advice, table="gnss", t_s=since, until_s=until)
            for since, until in self.regained.tolist()
        )
        off = float(np.median(np.linalg.norm(self.residual[:, :2], axis=1))) if len(self.t) >= FEWEST else 0.0
        if off < _FAR:
            return spans
        reason = f"most {name} are {off:.0f} declared sigmas or more from where the other sensors have them"
        advice = f"check {declared}, or smooth the recording"
        return (*spans, doubt_event(quantities, reason, advice, t_s=until_s))

    def shared_error(self) -> SharedError | None:
        """Return the error that the newest positions may share; None where they scatter by what is declared."""
        judged = self.t > self.since_s
        if np.count_nonzero(judged) < FEWEST:
            return None
        errors = errors_seen(self.t[judged], self.residual[judged], self.variance[judged])
        return shared_error(errors.level, self.declared[judged])

    def weigh(self, window: Window, width: float) -> Window:
        """Return the window with the sigmas of its positions multiplied by their factors, and a loss of that ``width``
        for errors that do not last.
        """
        if not self.t.size:
            return window

        def weighed(family: Family) -> Family:
            row, known = self._rows(_times(family, window.t))
            return self._weighed(
                family, np.where(known[:, None], self.declared[row] * self.factor[row], family.sigma), width
            )

        return replace(window, families=changed(window.families, self.kind, weighed))

    def weigh_next(self, families: Sequence[Family], width: float) -> tuple[Family, ...]:
        """Return the families of the next interval with the sigmas of its positions multiplied by the newest factor."""
        if self.t.size and self.t[-1] > self.since_s:
            self.expected = self.factor[-1].copy()

        def weighed(family: Family) -> Family:
            return self._weighed(family, family.sigma * self.expected, width)

        return changed(families, self.kind, weighed)

    def _rows(self, t: Array) -> tuple[np.ndarray, np.ndarray]:
        """Return the row of each of the positions at ``t`` (m,), s, and whether it has one, (m,)."""
        row = np.clip(np.searchsorted(self.t, t - SAME_S), 0, len(self.t) - 1)
        return row, np.abs(self.t[row] - t) <= SAME_S

    def _weighed(self, family: Family, sigma: Array, width: float) -> Family:
        return family if family.loss is None else family.with_sigma(sigma).with_loss(Huber(width / self.lasting))


def _times(family: Family, t: Array) -> Array:
    """Return the times of positions, s, whose keyframes are at ``t`` (n,), s."""
    return np.asarray(t[family.slots[0].index] + family.data["delay"][:, 0])
