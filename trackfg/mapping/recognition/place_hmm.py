"""Where the sections of a run are, one after the other: a hidden Markov model over places.

A section is at a place of the reference (2 m each), the run's chainage is wrong by a scale (one of a few, all along the
run), and the track there is as the reference has it or changed since; or the section is nowhere on the reference. From
one section to the next

* the place moves on by the distance, times the scale, and creeps by a place with probability :data:`_CREEP` each way;
* a slip that nobody saw moves it anywhere within 50 m, with probability :data:`_SLIP`;
* track as before goes over to changed track and back (:data:`_TO_CHANGED`, :data:`_TO_SAME`): a tamped line is changed
  all along, so its sections do not speak against the place one by one;
* the run leaves the reference (:data:`_LEAVE`, or by its end) and comes back anywhere (:data:`_RETURN`).

A run that is nowhere on the reference still has curves like many there, built by the same rules. So "nowhere" is unlike
any place, or **alike** one: its curves are as there, its short waves are not, and with every section it may go on there
or be alike any other place (:data:`_TO_OTHER`) or none. One curve that fits then proves little, and each further one
that fits in its place as much as finding one among all places would by chance.

Likelihoods are relative to "nowhere", where they are one: ``exp(curves)`` on changed track and alike, ``exp(short +
curves)`` on track as before. Even the best section speaks against "nowhere" by :data:`_MOST` at most: it may look alike
by a cause that no likelihood knows, such as a second track beside the first.

Forward filtering and backward smoothing (Rabiner, Proc. IEEE 77, 1989); the filter's states are kept at some
sections and made again between them where the smoother needs them: memory grows with the root of their number.
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
"""Prior probability that the run is on the reference at all."""
_SAME = 0.8
"""Prior probability that track is as before."""
_TO_CHANGED, _TO_SAME = 0.02, 0.1
_CREEP = 0.1
_SLIP = 1e-3
_SLIP_PLACES = 25
_LEAVE, _RETURN = 1e-4, 1e-3
_TO_OTHER, _TO_UNLIKE, _TO_ALIKE = 0.3, 0.05, 0.1
_GOES_ON = 1.0 - _TO_OTHER - _TO_UNLIKE
_MOST = 12.0
_SCALE_STEP = 0.01
"""Scales are so far apart: over a section of 100 m, creep bridges half of it."""
_NEGLIGIBLE = 1e-15
"""Probability of a place below which it is not followed; it may come back only from nowhere."""
NEAR = 32
"""Places to either side of the most probable one of which probabilities are given."""
_MODE = 3
"""Places to either side that belong to the most probable one."""


@dataclass(frozen=True)
class Windows:
    """The places that each section may be at, in order of travel: ``first`` (k,), the number of each ``count`` (k,).

    ``start_m``: where the sections begin in the run's chainage, (k,).
    """

    first: NDArray[np.int64]
    count: NDArray[np.int64]
    start_m: Array


@dataclass(frozen=True)
class Places:
    """What is known of each section's place, in order of travel.

    ``mode`` (k,): the most probable place. ``mean_m`` (k,): where on the reference the section begins, on average
    about it. ``near``, ``so_far`` (k, 2 NEAR + 1): probabilities of the places about the mode, given all sections and
    given those up to this one. ``same`` (k,): probability of unchanged track, and ``scale`` (k,): the mean of the
    scale error, both if the section is there.
    """

    mode: NDArray[np.int64]
    mean_m: Array
    near: Array
    so_far: Array
    same: Array
    scale: Array


@dataclass
class State:
    """Probabilities (or likelihoods) of one section's places from ``first`` on: ``on`` (2, scales, n), unchanged track
    first; ``alike`` (n,); and of being nowhere, ``off``."""

    first: int
    on: Array32
    alike: Array32
    off: float

    @property
    def stop(self) -> int:
        return self.first + int(self.on.shape[2])

    def places(self) -> Array32:
        """Shape (n,)."""
        return np.asarray(self.on.reshape(-1, self.on.shape[2]).sum(axis=0))


@dataclass
class PlaceChain:
    """The model of one run. ``short``, ``curves``: log likelihood ratios of each section at the places of its window.

    ``known``: log prior of the places of one section, by its number, where the run's place is known;
    ``on_reference``: prior probability that the run is on the reference at all.
    """

    windows: Windows
    short: Sequence[Array32]
    curves: Sequence[Array32]
    scale_sd: float
    known: tuple[int, Array] | None = None
    on_reference: float = _ON_REFERENCE
    scales: Array = field(init=False)
    scale_prior: Array32 = field(init=False)

    def __post_init__(self) -> None:
        reach = int(np.ceil(3.0 * self.scale_sd / _SCALE_STEP)) if self.scale_sd > 0.2 * _SCALE_STEP else 0
        self.scales = _SCALE_STEP * np.arange(-reach, reach + 1, dtype=np.float64)
        prior = np.exp(-0.5 * (self.scales / self.scale_sd) ** 2) if reach else np.ones(1)
        self.scale_prior = (prior / prior.sum()).astype(np.float32)

    def places(self) -> Places:
        """Forward and backward."""
        sections = len(self.windows.first)
        stride = max(1, int(np.sqrt(sections)))
        kept: list[State] = []
        state: State | None = None
        for k in range(sections):
            state = self.filtered(k, state)
            if k % stride == 0:
                kept.append(state)
        found: list[tuple[float, ...]] = []
        near: list[Array] = []
        so_far: list[Array] = []
        future: State | None = None
        for first in reversed(range(0, sections, stride)):
            states = [kept.pop()]
            for k in range(first + 1, min(first + stride, sections)):
                states.append(self.filtered(k, states[-1]))
            for k in reversed(range(first, first + len(states))):
                state = states.pop()
                if future is None:
                    future = State(state.first, np.ones_like(state.on), np.ones_like(state.alike), 1.0)
                else:
                    future = self._before(k + 1, state, future)
                one, *more = self._found(state, future)
                found.append(one)
                near.append(more[0])
                so_far.append(more[1])
                future = self._weighed(k, future)
        mode, mean_m, same, scale = (np.array(column[::-1]) for column in zip(*found, strict=True))
        return Places(mode.astype(np.int64), mean_m, np.array(near[::-1]), np.array(so_far[::-1]), same, scale)

    def filtered(self, k: int, before: State | None) -> State:
        """Probabilities given the sections up to ``k``; the negligible ones at both ends are cut off."""
        state = self._weighed(k, self._prior() if before is None else self._next(k, before))
        places = state.places()
        total = float(places.sum()) + float(state.alike.sum()) + state.off
        likely = np.flatnonzero(places > _NEGLIGIBLE * total)
        begin, stop = (int(likely[0]), int(likely[-1]) + 1) if likely.size else (0, 1)
        on, by = state.on[:, :, begin:stop], np.float32(1.0 / total)
        on = on.copy() if 2 * (stop - begin) < len(places) else on  # do not keep what was cut off
        on *= by
        return State(state.first + begin, on, state.alike[begin:stop] * by, state.off / total)

    def _prior(self) -> State:
        count = int(self.windows.count[0])
        each = _FRESH[:, None] * self.scale_prior * np.float32(self.on_reference / count)
        nowhere = 0.5 * (1.0 - self.on_reference)
        on = np.repeat(each[:, :, None], count, axis=2)
        return State(int(self.windows.first[0]), on, np.full(count, nowhere / count, dtype=np.float32), nowhere)

    def _weighed(self, k: int, state: State) -> State:
        """Times the likelihood of section ``k``, as a share of the greatest. Changes ``state``."""
        part = slice(state.first - int(self.windows.first[k]), state.stop - int(self.windows.first[k]))
        alike = changed = self.curves[k][part]
        same = changed + self.short[k][part]
        if self.known is not None and self.known[0] == k:
            prior = self.known[1][part].astype(np.float32)
            changed, same = changed + prior, same + prior
        best = float(max(alike.max(), same.max()))
        nowhere = max(0.0, best - _MOST)
        greatest = np.float32(max(best, nowhere))
        state.on[0] *= np.exp(same - greatest)
        state.on[1] *= np.exp(changed - greatest)
        state.alike *= np.exp(alike - greatest)
        state.off *= float(np.exp(nowhere - greatest))
        return state

    def _step(self, k: int) -> float:
        """By how many places the run moves from section ``k - 1`` to ``k``."""
        return float(self.windows.start_m[k] - self.windows.start_m[k - 1]) / PLACE_M

    def _steps(self, k: int) -> Array:
        """The same with each scale error, (scales,)."""
        return np.asarray(self._step(k) * (1.0 + self.scales))

    def _reach(self, k: int, before: State) -> tuple[int, int]:
        """Places of section ``k`` that are worth looking at: all, if the run may come back from nowhere."""
        first, stop = int(self.windows.first[k]), int(self.windows.first[k] + self.windows.count[k])
        if (before.off + float(before.alike.sum())) * _RETURN > _NEGLIGIBLE * (stop - first):
            return first, stop
        steps = self._steps(k)
        low = before.first + int(np.floor(steps.min())) - _SLIP_PLACES - 1
        high = before.stop + int(np.ceil(steps.max())) + _SLIP_PLACES + 1
        low = min(max(low, first), stop - 1)
        return low, max(min(high, stop), low + 1)

    def _next(self, k: int, before: State) -> State:
        """Prediction of section ``k`` from the one before."""
        low, high = self._reach(k, before)
        on = np.empty((2, len(self.scales), high - low), dtype=np.float32)
        for i, step in enumerate(self._steps(k)):
            _move(before.on[:, i], step - (low - before.first), (1.0 - _LEAVE) * (1.0 - _SLIP), on[:, i])
            exchanged = np.float32(_TO_CHANGED) * on[0, i] - np.float32(_TO_SAME) * on[1, i]
            on[0, i] -= exchanged
            on[1, i] += exchanged
        moved = on.reshape(-1, high - low).sum(axis=0)
        left = float(before.on.sum()) - float(moved.sum()) / (1.0 - _SLIP)
        anew = _box(moved) * np.float32(_SLIP / (1.0 - _SLIP))
        count = int(self.windows.count[k])
        elsewhere = float(before.alike.sum())
        anew += np.float32((before.off + elsewhere) * _RETURN / count)
        for c, i in np.ndindex(on.shape[:2]):
            on[c, i] += (_FRESH[c] * self.scale_prior[i]) * anew
        alike = np.empty((1, high - low), dtype=np.float32)
        _move(before.alike[None], self._step(k) - (low - before.first), _GOES_ON, alike)
        off = _TO_UNLIKE * elsewhere + (1.0 - _TO_ALIKE) * before.off
        off += _GOES_ON * elsewhere - float(alike.sum())
        alike += np.float32((_TO_OTHER * elsewhere + _TO_ALIKE * before.off) / count)
        return State(low, on, alike[0] * np.float32(1.0 - _RETURN), off * (1.0 - _RETURN) + left)

    def _before(self, k: int, before: State, future: State) -> State:
        """Likelihood of all sections from ``k`` on, of the places of ``before``: the transpose of :meth:`_next`.

        ``future`` is the likelihood with that of ``k`` itself; places that were cut off have none.
        """
        low, high = self._reach(k, before)
        count, into = before.on.shape[2], slice(future.first - low, future.stop - low)
        fresh = np.zeros(high - low, dtype=np.float32)
        fresh[into] = np.einsum("c,h,chp->p", _FRESH, self.scale_prior, future.on)
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
            ahead[1, into] += stay * (future.on[1, i] - np.float32(_TO_SAME) * gain)
            _move(ahead, (low - before.first) - step, 1.0, moved)
            # What moves over the ends of the window is off the reference.
            on[:, i] = moved[:2] + np.float32(future.off) * (np.float32(1.0) - moved[2])
        places = int(self.windows.count[k])
        back, any_alike = _RETURN * float(fresh.sum()) / places, float(future.alike.sum()) / places
        off = back + (1.0 - _RETURN) * ((1.0 - _TO_ALIKE) * future.off + _TO_ALIKE * any_alike)
        ahead[0], ahead[1] = 0.0, 0.0
        ahead[0, into] = future.alike
        _move(ahead, (low - before.first) - self._step(k), 1.0, moved)
        alike = moved[0] + np.float32(future.off) * (np.float32(1.0) - moved[2])
        alike *= np.float32((1.0 - _RETURN) * _GOES_ON)
        alike += np.float32(back + (1.0 - _RETURN) * (_TO_OTHER * any_alike + _TO_UNLIKE * future.off))
        by = 1.0 / max(float(on.max()), float(alike.max()), off)
        return State(before.first, on * np.float32(by), alike * np.float32(by), off * by)

    def _found(self, state: State, future: State) -> tuple[tuple[float, ...], Array, Array]:
        joint = state.on * future.on
        place = joint.reshape(-1, joint.shape[2]).sum(axis=0).astype(np.float64)
        place /= float(place.sum()) + float((state.alike * future.alike).sum()) + state.off * future.off
        beside = np.pad(place, 1)
        mode = int(np.argmax(2.0 * place + beside[:-2] + beside[2:]))
        begin, stop = max(mode - _MODE, 0), mode + _MODE + 1
        part = joint[:, :, begin:stop].astype(np.float64)
        weight = max(float(part.sum()), float(np.finfo(np.float64).tiny))
        middle = (state.first + np.arange(begin, begin + part.shape[2])) * PLACE_M + 0.5 * (PLACE_M - 1)
        found = (
            float(state.first + mode),
            float(part.sum(axis=(0, 1)) @ middle) / weight,
            float(part[0].sum()) / weight,
            float(part.sum(axis=(0, 2)) @ self.scales) / weight,
        )
        return found, _around(place, mode), _around(state.places().astype(np.float64), mode)


_FRESH = np.array([_SAME, 1.0 - _SAME], dtype=np.float32)


def _move(x: Array32, by: float, share: float, out: Array32) -> None:
    """A share of each place moved ``by`` places and blurred by creep. Shape (m, n) into ``out`` (m, p).

    To the nearest place and its two neighbours, with mean ``by`` and the variance of creep, or its least there.
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
    """Mean over 50 m to either side, nothing beyond the ends. Shape (n,) to (n,)."""
    padded = np.pad(x.astype(np.float64), (_SLIP_PLACES + 1, _SLIP_PLACES))
    total = np.cumsum(padded)
    width = 2 * _SLIP_PLACES + 1
    return np.asarray((total[width:] - total[:-width]) / width, dtype=np.float32)


def _around(x: Array, middle: int) -> Array:
    """Places about the middle, zero beyond the ends. Shape (n,) to (2 NEAR + 1,)."""
    padded = np.pad(x, NEAR)
    return np.asarray(padded[middle : middle + 2 * NEAR + 1])
