"""Forward-backward over places: a hidden Markov model of a run on a reference.

**Hidden state** of section k, one of

* *on*: it begins (at its end of lower chainage) at place p of the reference, an index of 2 m each, the run's chainage
  has the scale error e, one of a few, and the track there is c = unchanged or changed since. The scale error stays the
  same until a slip or a return to the reference, which draw e and c anew from their priors;
* *alike* p: foreign, resembling p: another line whose curves happen to be those at p (many lines have curves built by
  one rule). It competes with *on* for the evidence of the curves, so only short waves or further curves decide;
* *off*: foreign, and like no place of the reference.

**Likelihoods**, all relative to *off*, with the log ratios short and curves of
:mod:`trackfg.mapping.recognition.likelihood`:

    unchanged: exp(short(p) + curves(p)),   changed: exp(curves(p)),   alike: exp(curves(p)),   off: 1.

One section speaks against *off* by :data:`_GREATEST_LOG_RATIO` at most: it may look alike by a cause that no likelihood
contains, such as a second track beside the first.

**Transitions** from one section to the next, the run having moved by s:

* p moves by ``(1 + e) s``, and creeps by one place with probability :data:`_CREEP` each way;
* a slip of the wheel that nothing has shown moves p anywhere within 50 m, with probability :data:`_SLIP`;
* unchanged track becomes changed and back (:data:`_TO_CHANGED`, :data:`_TO_UNCHANGED`): a tamped line is changed all
  along, so its sections do not speak against the place one by one;
* the run leaves the reference (:data:`_LEAVE`, or by its end) and returns to any place (:data:`_RETURN`);
* *alike* p moves along with the run, or becomes alike another place (:data:`_TO_OTHER`) or *off* (:data:`_TO_UNLIKE`);
  *off* becomes alike some place (:data:`_TO_ALIKE`).

**Evidence of curves.** The first curve that fits at p says nothing of *on* against *alike* p. Of that state ``0.65^n``
(:data:`_GOES_ON`) is left n sections later; the rest is alike some other place, and fits a further curve there only by
chance, with probability phi. That curve is then evidence for *on* of

    -log(0.65^n + (1 - 0.65^n) phi).

**Inference.** With the forward message ``a_k(x) = P(x_k | sections 1..k)`` and the backward message
``b_k(x) ~ P(sections k+1.. | x_k = x)``,

    a_k(x) ~ likelihood_k(x) sum_x' P(x | x') a_k-1(x'),       b_k(x) ~ sum_x' P(x' | x) likelihood_k+1(x') b_k+1(x'),
    P(x_k = x | all sections) ~ a_k(x) b_k(x)

(Rabiner, Proceedings of the IEEE 77, 1989). Forward messages are kept at every sqrt(K)-th of K sections and computed
again between them where the backward pass needs them, so the memory of messages grows with the root of K. The
likelihoods of all sections at all places of their windows are held throughout.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from trackfg.mapping.recognition.likelihood import PLACE_M
from trackfg.mapping.recognition.short_wave_likelihood import Array32
from trackfg.numerics.arrays import Array

_ON_REFERENCE = 0.5
"""Prior probability that a run that may be anywhere is on the reference."""
_UNCHANGED = 0.8
"""Prior probability that track is unchanged. Chosen; see Assumptions in docs/engine.md."""
_CHANGE_PRIOR = np.array([_UNCHANGED, 1.0 - _UNCHANGED], dtype=np.float32)
"""Prior probabilities of unchanged and of changed track."""
_TO_CHANGED, _TO_UNCHANGED = 0.02, 0.1
"""Probabilities that the next section is changed where this one is not, and the reverse: on average 1 km is changed
after 5 km that are not. Chosen on simulated tamped lines; see Assumptions in docs/engine.md."""
_CREEP = 0.1
"""Probability that a place creeps by 2 m over a section, each way: some creep in every fifth section."""
_SLIP = 1e-3
"""Probability of a slip within a section that the run's chainage does not contain. Chosen; see Assumptions in
docs/engine.md."""
_SLIP_PLACES = 25
"""Longest slip to either side, places (50 m)."""
_LEAVE, _RETURN = 1e-4, 1e-3
"""Probabilities, per section, that the run leaves the reference other than by its end, and that it returns. Chosen; see
Assumptions in docs/engine.md."""
_TO_OTHER, _TO_UNLIKE, _TO_ALIKE = 0.3, 0.05, 0.1
"""Probabilities, per section of a foreign line, that it becomes alike another place, that it becomes *off*, and that
*off* becomes alike some place. Chosen on simulated lines of one design, so that a foreign one is not
recognised; see Assumptions in docs/engine.md.
"""
_GOES_ON = 1.0 - _TO_OTHER - _TO_UNLIKE
"""Probability that *alike* p moves along with the run."""
_PRIOR_UNLIKE = 0.5
"""Prior share of *off* in a foreign run; the rest is alike some place."""
_GREATEST_LOG_RATIO = 12.0
"""Greatest log ratio of one section to "off": one section in 160,000 looks alike by another cause. Chosen; see
Assumptions in docs/engine.md."""
_SCALE_STEP = 0.01
"""Step between the scale errors. One midway between two of them is 0.5 m off after a section of 100 m; creep, with a
sigma of 0.9 m, covers that."""
_SCALE_SIGMAS = 3.0
"""The scale errors reach to so many prior sigmas on either side of zero."""
_LEAST_SCALE_SD = 0.2 * _SCALE_STEP
"""Up to this prior sigma (0.2 m in a section of 100 m, a tenth of a place) the only scale error is zero."""
_NEGLIGIBLE = 1e-15
"""Share of the total probability below which the places at both ends of a message are cut off. A later section gets
there again by moving, or by a return from off the reference."""
NEAR = 32
"""Places to either side of the mode whose probabilities :class:`PlacePosterior` has: 64 m."""
_MODE = 3
"""Places to either side of the mode over which means are taken: 6 m, creep and the blur of moving."""


@dataclass(frozen=True)
class PlaceWindows:
    """Each section may begin at ``count`` places from ``first`` on, (k,) each, in order of travel.

    ``start_m``: where the sections begin in the run's chainage, (k,): the end of lower chainage, so it descends for a
    run against it.
    """

    first: NDArray[np.int64]
    count: NDArray[np.int64]
    start_m: Array


@dataclass(frozen=True)
class PlacePosterior:
    """The places of the sections given all of them, in order of travel.

    ``mode`` (k,): the most probable place, with half of the probability of its two neighbours. ``mean_m`` (k,): where
    on the reference the section begins, m, on average over the places within 6 m of the mode. ``near``, ``so_far``
    (k, 2 NEAR + 1): probabilities of the places about the mode, given all sections and given those up to this one.
    ``unchanged`` (k,): probability of unchanged track, and ``scale`` (k,):
    mean of the scale error, both if the section is at the mode.
    """

    mode: NDArray[np.int64]
    mean_m: Array
    near: Array
    so_far: Array
    unchanged: Array
    scale: Array


@dataclass
class Message:
    """A forward or backward message: probabilities, or likelihoods, of the hidden states of one section.

    ``on`` (2, scales, n): the places from ``first`` on, unchanged track first; ``alike`` (n,); ``off``.
    """

    first: int
    on: Array32
    alike: Array32
    off: float

    @property
    def stop(self) -> int:
        """The place after the last."""
        return self.first + int(self.on.shape[2])

    def places(self) -> Array32:
        """Return the sums over scales and change of track, (n,)."""
        return np.asarray(self.on.reshape(-1, self.on.shape[2]).sum(axis=0))


@dataclass
class PlaceHmm:
    """The model of one run. ``short``, ``curves``: log likelihood ratios of each section at the places of its window.

    ``scale_sd``: prior sigma of the scale error. ``place_prior``: where the run's place is known, a section's number
    and the log density of the places of its window, less its greatest. It multiplies the likelihood of *on* in that
    section and is not normalised, so of the probability of *on* it leaves the mean of that density over its places.
    ``on_reference``: prior probability that the run is on the reference, before that, uniform over the places of the
    first section's window.
    """

    windows: PlaceWindows
    short: Sequence[Array32]
    curves: Sequence[Array32]
    scale_sd: float
    place_prior: tuple[int, Array] | None = None
    on_reference: float = _ON_REFERENCE
    scales: Array = field(init=False)
    scale_prior: Array32 = field(init=False)

    def __post_init__(self) -> None:
        reach = int(np.ceil(_SCALE_SIGMAS * self.scale_sd / _SCALE_STEP)) if self.scale_sd > _LEAST_SCALE_SD else 0
        self.scales = _SCALE_STEP * np.arange(-reach, reach + 1, dtype=np.float64)
        prior = np.exp(-0.5 * (self.scales / self.scale_sd) ** 2) if reach else np.ones(1)
        self.scale_prior = (prior / prior.sum()).astype(np.float32)

    def posterior(self) -> PlacePosterior:
        """Return the places of all sections given all of them: the forward and the backward pass."""
        sections = len(self.windows.first)
        stride = max(1, int(np.sqrt(sections)))
        kept: list[Message] = []
        state: Message | None = None
        for k in range(sections):
            state = self.filtered(k, state)
            if k % stride == 0:
                kept.append(state)
        moments: list[tuple[float, ...]] = []
        near: list[Array] = []
        so_far: list[Array] = []
        future: Message | None = None
        for first in reversed(range(0, sections, stride)):
            states = [kept.pop()]
            for k in range(first + 1, min(first + stride, sections)):
                states.append(self.filtered(k, states[-1]))
            for k in reversed(range(first, first + len(states))):
                state = states.pop()
                if future is None:
                    future = Message(state.first, np.ones_like(state.on), np.ones_like(state.alike), 1.0)
                else:
                    future = self._predict_back(k + 1, state, future)
                section_moments, section_near, section_so_far = self._moments(state, future)
                moments.append(section_moments)
                near.append(section_near)
                so_far.append(section_so_far)
                future = self._update(k, future)
        mode, mean_m, unchanged, scale = (np.array(column[::-1]) for column in zip(*moments, strict=True))
        return PlacePosterior(
            mode.astype(np.int64), mean_m, np.array(near[::-1]), np.array(so_far[::-1]), unchanged, scale
        )

    def filtered(self, k: int, previous: Message | None) -> Message:
        """Return the forward message of section ``k``, without the negligible places at both ends.

        ``previous``: that of section ``k - 1``; None for the prior.
        """
        state = self._update(k, self._prior() if previous is None else self._predict(k, previous))
        places = state.places()
        total = float(places.sum()) + float(state.alike.sum()) + state.off
        likely = np.flatnonzero(places > _NEGLIGIBLE * total)
        begin, stop = (int(likely[0]), int(likely[-1]) + 1) if likely.size else (0, 1)
        on, by = state.on[:, :, begin:stop], np.float32(1.0 / total)
        on = on.copy() if 2 * (stop - begin) < len(places) else on  # a view would keep what is cut off
        on *= by
        return Message(state.first + begin, on, state.alike[begin:stop] * by, state.off / total)

    def _prior(self) -> Message:
        count = int(self.windows.count[0])
        each = _CHANGE_PRIOR[:, None] * self.scale_prior * np.float32(self.on_reference / count)
        on = np.repeat(each[:, :, None], count, axis=2)
        off = _PRIOR_UNLIKE * (1.0 - self.on_reference)
        alike = (1.0 - _PRIOR_UNLIKE) * (1.0 - self.on_reference)
        return Message(int(self.windows.first[0]), on, np.full(count, alike / count, dtype=np.float32), off)

    def _update(self, k: int, state: Message) -> Message:
        """Multiply a message by the likelihood of section ``k``, relative to the greatest, and return it.

        *Changed* is never likelier than *alike*, so the greatest is among the other three.
        """
        part = slice(state.first - int(self.windows.first[k]), state.stop - int(self.windows.first[k]))
        alike = changed = self.curves[k][part]
        unchanged = changed + self.short[k][part]
        if self.place_prior is not None and self.place_prior[0] == k:
            prior = self.place_prior[1][part].astype(np.float32)
            changed, unchanged = changed + prior, unchanged + prior
        of_best_place = float(max(alike.max(), unchanged.max()))
        off = max(0.0, of_best_place - _GREATEST_LOG_RATIO)
        greatest = np.float32(max(of_best_place, off))
        state.on[0] *= np.exp(unchanged - greatest)
        state.on[1] *= np.exp(changed - greatest)
        state.alike *= np.exp(alike - greatest)
        state.off *= float(np.exp(off - greatest))
        return state

    def _step(self, k: int) -> float:
        """Return by how many places the run moves from section ``k - 1`` to ``k``, by its own chainage."""
        return float(self.windows.start_m[k] - self.windows.start_m[k - 1]) / PLACE_M

    def _steps(self, k: int) -> Array:
        """Return :meth:`_step` with each of the scale errors, (scales,)."""
        return np.asarray(self._step(k) * (1.0 + self.scales))

    def _reach(self, k: int, previous: Message) -> tuple[int, int]:
        """Return the places of section ``k`` that can be reached: all, if the run may come back to the reference."""
        first, stop = int(self.windows.first[k]), int(self.windows.first[k] + self.windows.count[k])
        if (previous.off + float(previous.alike.sum())) * _RETURN > _NEGLIGIBLE * (stop - first):
            return first, stop
        steps = self._steps(k)
        low = previous.first + int(np.floor(steps.min())) - _SLIP_PLACES - 1
        high = previous.stop + int(np.ceil(steps.max())) + _SLIP_PLACES + 1
        low = min(max(low, first), stop - 1)
        return low, max(min(high, stop), low + 1)

    def _predict(self, k: int, previous: Message) -> Message:
        """Return the prediction of section ``k`` from that of section ``k - 1``."""
        low, high = self._reach(k, previous)
        on = np.empty((2, len(self.scales), high - low), dtype=np.float32)
        for i, step in enumerate(self._steps(k)):
            _move(previous.on[:, i], step - (low - previous.first), (1.0 - _LEAVE) * (1.0 - _SLIP), on[:, i])
            net_to_changed = np.float32(_TO_CHANGED) * on[0, i] - np.float32(_TO_UNCHANGED) * on[1, i]
            on[0, i] -= net_to_changed
            on[1, i] += net_to_changed
        moved = on.reshape(-1, high - low).sum(axis=0)
        leaving = float(previous.on.sum()) - float(moved.sum()) / (1.0 - _SLIP)
        entering = _box(moved) * np.float32(_SLIP / (1.0 - _SLIP))
        count = int(self.windows.count[k])
        all_alike = float(previous.alike.sum())
        entering += np.float32((previous.off + all_alike) * _RETURN / count)
        for c, i in np.ndindex(on.shape[:2]):
            on[c, i] += (_CHANGE_PRIOR[c] * self.scale_prior[i]) * entering
        alike = np.empty((1, high - low), dtype=np.float32)
        _move(previous.alike[None], self._step(k) - (low - previous.first), _GOES_ON, alike)
        off = _TO_UNLIKE * all_alike + (1.0 - _TO_ALIKE) * previous.off
        off += _GOES_ON * all_alike - float(alike.sum())
        alike += np.float32((_TO_OTHER * all_alike + _TO_ALIKE * previous.off) / count)
        return Message(low, on, alike[0] * np.float32(1.0 - _RETURN), off * (1.0 - _RETURN) + leaving)

    def _predict_back(self, k: int, previous: Message, future: Message) -> Message:
        """Return the backward message of section ``k - 1``, at the places of ``previous``: a prediction transposed.

        ``future`` is that of section k times its likelihood; places that were cut off have none.
        """
        low, high = self._reach(k, previous)
        count, into = previous.on.shape[2], slice(future.first - low, future.stop - low)
        fresh = np.zeros(high - low, dtype=np.float32)
        fresh[into] = np.einsum("c,h,chp->p", _CHANGE_PRIOR, self.scale_prior, future.on)
        slipped = _box(fresh) * np.float32(_SLIP * (1.0 - _LEAVE))
        slipped += np.float32(_LEAVE * future.off)
        on = np.empty((2, len(self.scales), count), dtype=np.float32)
        ahead = np.empty((3, high - low), dtype=np.float32)
        moved = np.empty((3, count), dtype=np.float32)
        ahead[2] = np.float32(1.0)
        stay = np.float32((1.0 - _LEAVE) * (1.0 - _SLIP))
        for i, step in enumerate(self._steps(k)):
            gain = future.on[1, i] - future.on[0, i]
            ahead[:2] = slipped
            ahead[0, into] += stay * (future.on[0, i] + np.float32(_TO_CHANGED) * gain)
            ahead[1, into] += stay * (future.on[1, i] - np.float32(_TO_UNCHANGED) * gain)
            _move(ahead, (low - previous.first) - step, 1.0, moved)
            # What moves over the ends of the window is off the reference.
            on[:, i] = moved[:2] + np.float32(future.off) * (np.float32(1.0) - moved[2])
        places = int(self.windows.count[k])
        back, mean_alike = _RETURN * float(fresh.sum()) / places, float(future.alike.sum()) / places
        off = back + (1.0 - _RETURN) * ((1.0 - _TO_ALIKE) * future.off + _TO_ALIKE * mean_alike)
        ahead[0], ahead[1] = 0.0, 0.0
        ahead[0, into] = future.alike
        _move(ahead, (low - previous.first) - self._step(k), 1.0, moved)
        alike = moved[0] + np.float32(future.off) * (np.float32(1.0) - moved[2])
        alike *= np.float32((1.0 - _RETURN) * _GOES_ON)
        alike += np.float32(back + (1.0 - _RETURN) * (_TO_OTHER * mean_alike + _TO_UNLIKE * future.off))
        by = 1.0 / max(float(on.max()), float(alike.max()), off)
        return Message(previous.first, on * np.float32(by), alike * np.float32(by), off * by)

    def _moments(self, state: Message, future: Message) -> tuple[tuple[float, ...], Array, Array]:
        """Return (mode, mean_m, unchanged, scale), ``near`` and ``so_far`` of one section's :class:`PlacePosterior`."""
        joint = state.on * future.on
        place = joint.reshape(-1, joint.shape[2]).sum(axis=0).astype(np.float64)
        place /= float(place.sum()) + float((state.alike * future.alike).sum()) + state.off * future.off
        beside = np.pad(place, 1)
        mode = int(np.argmax(2.0 * place + beside[:-2] + beside[2:]))
        begin, stop = max(mode - _MODE, 0), mode + _MODE + 1
        part = joint[:, :, begin:stop].astype(np.float64)
        weight = max(float(part.sum()), float(np.finfo(np.float64).tiny))
        middle = (state.first + np.arange(begin, begin + part.shape[2])) * PLACE_M + 0.5 * (PLACE_M - 1)
        moments = (
            float(state.first + mode),
            float(part.sum(axis=(0, 1)) @ middle) / weight,
            float(part[0].sum()) / weight,
            float(part.sum(axis=(0, 2)) @ self.scales) / weight,
        )
        return moments, _around(place, mode), _around(state.places().astype(np.float64), mode)


def _move(x: Array32, by: float, share: float, out: Array32) -> None:
    """Move a share of each place ``by`` places, blurred by creep: shape (m, n) into ``out`` (m, p).

    It goes to the nearest place and its two neighbours, with mean ``by`` and the variance of creep, or the least
    variance that these three allow.
    """
    whole = round(by)
    part = by - whole
    spread = max(2.0 * _CREEP, abs(part) - part**2) + part**2
    weights = share * np.array([spread - part, 2.0 - 2.0 * spread, spread + part]) / 2.0
    out[...] = 0.0
    for offset, weight in enumerate(weights.astype(np.float32), start=whole - 1):
        low, high = max(0, offset), min(out.shape[1], x.shape[1] + offset)
        if low < high and weight > 0.0:
            out[:, low:high] += weight * x[:, low - offset : high - offset]


def _box(x: Array32) -> Array32:
    """Return means over 50 m to either side, nothing beyond the ends. Shape (n,) to (n,)."""
    padded = np.pad(x.astype(np.float64), (_SLIP_PLACES + 1, _SLIP_PLACES))
    total = np.cumsum(padded)
    width = 2 * _SLIP_PLACES + 1
    return np.asarray((total[width:] - total[:-width]) / width, dtype=np.float32)


def _around(x: Array, middle: int) -> Array:
    """Return the places about the middle, zero beyond the ends. Shape (n,) to (2 NEAR + 1,)."""
    padded = np.pad(x, NEAR)
    return np.asarray(padded[middle : middle + 2 * NEAR + 1])
