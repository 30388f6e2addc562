"""Where the sections of a run are, one after the other: a hidden Markov model over places.

A section is at a place of the reference (2 m each), the run's chainage is wrong by a scale (one of a few, all along the
run), and the track there is as the reference has it or changed since; or the section is nowhere on the reference. From
one section to the next

* the place moves on by the distance, times the scale, and creeps by a place with probability :data:`_CREEP` each way;
* a slip that nobody saw moves it anywhere within 50 m, with probability :data:`_SLIP`;
* track as before goes over to changed track and back (:data:`_TO_CHANGED`, :data:`_TO_SAME`): a tamped line is changed
  all along, so its sections do not speak against the place one by one;
* the run leaves the reference (:data:`_LEAVE`, or by its end) and comes back anywhere (:data:`_RETURN`).

Likelihoods are relative to "nowhere", where they are one: ``exp(curves)`` on changed track, ``exp(short + curves)`` on
track as before. Even the best section speaks against "nowhere" by :data:`_MOST` at most: it may look alike by a cause
that no likelihood knows, such as a second track beside the first.

Forward filtering and backward smoothing (Rabiner, Proc. IEEE 77, 1989); the filter's states are kept at every so
manieth section and made again where the smoother needs them, so that memory grows with the root of the sections.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from trackfg.frames import Array
from trackfg.mapping.likelihood import PLACE_M, Array32

_ON_REFERENCE = 0.5
"""Prior probability that the run is on the reference at all."""
_SAME = 0.8
"""Prior probability that track is as before."""
_TO_CHANGED, _TO_SAME = 0.02, 0.1
_CREEP = 0.1
_SLIP = 1e-3
_SLIP_PLACES = 25
_LEAVE, _RETURN = 1e-4, 1e-3
_MOST = 15.0
_SCALE_STEP = 0.01
"""Scales are so far apart: over a section of 100 m, creep bridges half of it."""
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
class _State:
    """Probabilities: ``on`` (2, scales, places), unchanged track first; ``off``."""

    on: Array32
    off: float

    def scaled(self, by: float) -> _State:
        self.on *= np.float32(by)
        self.off *= by
        return self


@dataclass
class PlaceChain:
    """The model of one run. ``short``, ``curves``: log likelihood ratios of each section at its places.

    ``known``: log prior of the places of one section, by its number, where the run's place is known.
    """

    windows: Windows
    short: Sequence[Array32]
    curves: Sequence[Array32]
    scale_sd: float
    known: tuple[int, Array] | None = None
    scales: Array = field(init=False)
    scale_prior: Array32 = field(init=False)

    def __post_init__(self) -> None:
        reach = int(np.ceil(3.0 * self.scale_sd / _SCALE_STEP)) if self.scale_sd > 0.2 * _SCALE_STEP else 0
        self.scales = _SCALE_STEP * np.arange(-reach, reach + 1)
        prior = np.exp(-0.5 * (self.scales / self.scale_sd) ** 2) if reach else np.ones(1)
        self.scale_prior = (prior / prior.sum()).astype(np.float32)
        self._lost: dict[tuple[int, ...], Array32] = {}

    def places(self) -> Places:
        """Forward and backward."""
        sections = len(self.windows.first)
        stride = max(1, int(np.sqrt(sections)))
        kept: list[_State] = []
        state = self._seen(0, self._prior())
        for k in range(sections):
            if k:
                state = self._seen(k, self._next(k, state))
            if k % stride == 0:
                kept.append(_State(state.on.copy(), state.off))
        found: list[tuple[float, ...]] = []
        near: list[Array] = []
        so_far: list[Array] = []
        future = _State(np.ones_like(state.on), 1.0)
        for block in reversed(range(len(kept))):
            states = [kept.pop()]
            for k in range(block * stride + 1, min((block + 1) * stride, sections)):
                states.append(self._seen(k, self._next(k, states[-1])))
            for k in reversed(range(block * stride, block * stride + len(states))):
                if k + 1 < sections:
                    future = self._before(k + 1, self._weighed(k + 1, future))
                mode, *rest = self._found(k, states.pop(), future)
                found.append(mode)
                near.append(rest[0])
                so_far.append(rest[1])
        mode_, mean_m, same, scale = (np.array(column[::-1]) for column in zip(*found, strict=True))
        return Places(
            mode_.astype(np.int64), mean_m, np.array(near[::-1]), np.array(so_far[::-1]), same, scale
        )

    def _prior(self) -> _State:
        count = int(self.windows.count[0])
        each = np.float32(_ON_REFERENCE / count) * np.array([_SAME, 1.0 - _SAME], dtype=np.float32)
        on = each[:, None, None] * self.scale_prior[:, None] * np.ones(count, dtype=np.float32)
        return _State(on, 1.0 - _ON_REFERENCE)

    def _weighed(self, k: int, state: _State) -> _State:
        """Times the likelihood of section ``k``, all divided by its greatest."""
        changed = self.curves[k].astype(np.float32)
        same = changed + self.short[k]
        if self.known is not None and self.known[0] == k:
            changed, same = changed + self.known[1].astype(np.float32), same + self.known[1].astype(np.float32)
        best = float(max(changed.max(), same.max()))
        nowhere = max(0.0, best - _MOST)
        greatest = np.float32(max(best, nowhere))
        on = state.on * np.exp(np.stack([same, changed]) - greatest)[:, None, :]
        return _State(on, state.off * float(np.exp(nowhere - greatest)))

    def _seen(self, k: int, state: _State) -> _State:
        state = self._weighed(k, state)
        return state.scaled(1.0 / (float(state.on.sum(dtype=np.float64)) + state.off))

    def _offsets(self, k: int) -> Array:
        """By how many of its places each scale moves the section ``k - 1`` on to ``k``, (scales,)."""
        w = self.windows
        moved = (w.start_m[k] - w.start_m[k - 1]) * (1.0 + self.scales) / PLACE_M
        return np.asarray(moved - (w.first[k] - w.first[k - 1]))

    def _next(self, k: int, state: _State) -> _State:
        """Prediction of section ``k`` from the one before."""
        count = int(self.windows.count[k])
        moved = np.stack(
            [_moved(state.on[:, i], by, count) for i, by in enumerate(self._offsets(k))], axis=1
        )
        total = float(state.on.sum(dtype=np.float64))
        left = total - float(moved.sum(dtype=np.float64)) * (1.0 - _LEAVE)
        on = np.empty_like(moved)
        np.multiply(moved[0], np.float32((1.0 - _TO_CHANGED) * (1.0 - _LEAVE) * (1.0 - _SLIP)), out=on[0])
        on[0] += np.float32(_TO_SAME * (1.0 - _LEAVE) * (1.0 - _SLIP)) * moved[1]
        np.multiply(moved[1], np.float32((1.0 - _TO_SAME) * (1.0 - _LEAVE) * (1.0 - _SLIP)), out=on[1])
        on[1] += np.float32(_TO_CHANGED * (1.0 - _LEAVE) * (1.0 - _SLIP)) * moved[0]
        anew = _box(moved.sum(axis=(0, 1))) * np.float32(_SLIP * (1.0 - _LEAVE))
        anew += np.float32(state.off * _RETURN / count)
        on += _FRESH[:, None, None] * self.scale_prior[:, None] * anew
        return _State(on, state.off * (1.0 - _RETURN) + left)

    def _before(self, k: int, future: _State) -> _State:
        """The transpose of :meth:`_next`: likelihood of all that follows, of the places of section ``k - 1``."""
        count = int(self.windows.count[k - 1])
        fresh = np.einsum("c,h,chp->p", _FRESH, self.scale_prior, future.on)
        stay = np.float32((1.0 - _LEAVE) * (1.0 - _SLIP))
        mixed = np.empty_like(future.on)
        mixed[0] = future.on[0] * (stay * np.float32(1.0 - _TO_CHANGED)) + future.on[1] * (stay * np.float32(_TO_CHANGED))
        mixed[1] = future.on[1] * (stay * np.float32(1.0 - _TO_SAME)) + future.on[0] * (stay * np.float32(_TO_SAME))
        mixed += np.float32(_SLIP * (1.0 - _LEAVE)) * _box(fresh)
        mixed += np.float32(_LEAVE * future.off)
        on = np.stack([_moved(mixed[:, i], -by, count) for i, by in enumerate(self._offsets(k))], axis=1)
        on += np.float32(future.off) * self._lost_over_the_ends(k)
        off = future.off * (1.0 - _RETURN) + _RETURN * float(fresh.mean())
        return _State(on, off).scaled(1.0 / max(float(on.max()), off))

    def _lost_over_the_ends(self, k: int) -> Array32:
        """Share of each scale and place of section ``k - 1`` that moves beyond the places of ``k``."""
        count, before = int(self.windows.count[k]), int(self.windows.count[k - 1])
        offsets = self._offsets(k)
        key = (count, before, *np.rint(1e6 * offsets).astype(int).tolist())
        if key not in self._lost:
            kept = np.stack([_moved(np.ones((1, count), dtype=np.float32), -by, before)[0] for by in offsets])
            self._lost = {key: np.float32(1) - kept}
        return self._lost[key]

    def _found(self, k: int, state: _State, future: _State) -> tuple[tuple[float, ...], Array, Array]:
        joint = state.on * future.on
        total = float(joint.sum(dtype=np.float64)) + state.off * future.off
        place = joint.sum(axis=(0, 1)).astype(np.float64) / total
        mode = int(np.argmax(np.convolve(place, np.ones(3), mode="same")))
        begin, stop = max(mode - _MODE, 0), mode + _MODE + 1
        part = joint[:, :, begin:stop].astype(np.float64)
        weight = max(float(part.sum()), np.finfo(np.float64).tiny)
        first = int(self.windows.first[k])
        middle = (first + np.arange(begin, begin + part.shape[2])) * PLACE_M + 0.5 * (PLACE_M - 1)
        found = (
            float(first + mode),
            float(part.sum(axis=(0, 1)) @ middle) / weight,
            float(part[0].sum()) / weight,
            float(part.sum(axis=(0, 2)) @ self.scales) / weight,
        )
        return found, _around(place, mode), _around(state.on.sum(axis=(0, 1)).astype(np.float64), mode)


_FRESH = np.array([_SAME, 1.0 - _SAME], dtype=np.float32)


def _moved(x: Array32, by: float, count: int) -> Array32:
    """Each place moved ``by`` places and blurred by creep, to ``count`` places. Shape (m, n) to (m, count).

    Between places the share goes to both neighbours, so that the mean moves exactly.
    """
    whole = int(np.floor(by))
    part = by - whole
    weights = np.convolve([1.0 - part, part], [_CREEP, 1.0 - 2.0 * _CREEP, _CREEP])
    out = np.zeros((x.shape[0], count), dtype=np.float32)
    for offset, weight in enumerate(weights.astype(np.float32), start=whole - 1):
        low, high = max(0, offset), min(count, x.shape[1] + offset)
        if low < high and weight > 0.0:
            out[:, low:high] += weight * x[:, low - offset : high - offset]
    return out


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
