"""Official kilometrage: how the addresses of a line, ``12+345.6``, belong to chainages, which run on without a jump.

Along the track lie stretches. In each the official place k (m; 12345.6 is km 12+345.6) is linear in the chainage x,

    k = k_0 + r (x - x_0),   r > 0: kilometrage ascends with chainage, r < 0: it descends,

and |r| is 1 unless the kilometrage is measured otherwise than along the track (in plan, say). Where one stretch ends
and the next does not go on at the same k, the same way, kilometrage *jumps*: official places are missing (*gap*), are
there twice (*overlap*), or begin to run back (*turn*). The stretches between two jumps are a *part*; parts are numbered
from 1 in order of chainage. So (k, part) and x are one to one, and k and x are but for the jumps. A written place that
more than one part has is followed by the part's number, ``12+345.60 (2)``; every other one needs none.

Between two neighbouring kilometre posts metres count from the post with the smaller kilometre, to as many as there are:
``12+1003.50`` lies before post 13 where the kilometre is longer than 1000 m, and is another place than ``13+003.50``.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeVar

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.km_notation import (
    KmNotation,
    metres_of,
    milepost_and_metres,
    post_and_metres,
    resolution_m,
    written_places,
)

_SAME_PLACE_M = 1e-6
"""Official places that differ by less are one, m: rounding of double precision at 1e6 m is 1e-10, that of text 1e-7."""
_Places = TypeVar("_Places", float, Array)
_PART = re.compile(r"^(?P<place>.*?)\s*\(\s*(?P<part>\d+)\s*\)$")


@dataclass(frozen=True)
class Stretch:
    """The official place is ``official_m + rate (x - chainage_m)`` from the chainage ``from_m`` on.

    ``post_km`` is the whole kilometre whose post the metres count from; None where each 1000 m begin the next one.
    Raises ``ValueError`` for numbers that are not finite (but ``from_m`` may be -inf) and for a rate of 0.
    """

    from_m: float
    chainage_m: float
    official_m: float
    rate: float = 1.0
    post_km: int | None = None

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (self.chainage_m, self.official_m, self.rate))) or math.isnan(self.from_m):
            raise ValueError(f"{self}: expected finite numbers")
        if self.rate == 0.0:
            raise ValueError(f"{self}: expected kilometrage that ascends or descends")

    def official_at(self, chainage_m: float) -> float:
        """Return the official place of a chainage, m."""
        return self.official_m + self.rate * (chainage_m - self.chainage_m)

    def chainage_of(self, official_m: _Places) -> _Places:
        """Return the chainage of an official place, m; of several as an array."""
        return self.chainage_m + (official_m - self.official_m) / self.rate


@dataclass(frozen=True)
class Jump:
    """The official place goes from ``back_m`` over to ``ahead_m`` at ``chainage_m``."""

    chainage_m: float
    back_m: float
    ahead_m: float
    kind: Literal["gap", "overlap", "turn"]


@dataclass(frozen=True)
class Kilometrage:
    """The stretches of a line in order of chainage, to ``end_m``.

    Beyond both ends the first and the last stretch go on. Raises ``ValueError`` where stretches are missing or not in
    order.
    """

    stretches: tuple[Stretch, ...]
    end_m: float = math.inf
    notation: KmNotation = "km+m"

    def __post_init__(self) -> None:
        if not self.stretches:
            raise ValueError("no stretch: expected where kilometrage begins")
        edges = [*(stretch.from_m for stretch in self.stretches), self.end_m]
        for earlier, later in itertools.pairwise(edges):
            if not earlier < later:
                raise ValueError(f"chainage {later:g} m comes after {earlier:g} m: expected ascending chainages")

    def official_m(self, chainage_m: Array) -> Array:
        """Return the official places of chainages, m. At a jump it is the one ahead. Shape (...)."""
        i = self._stretch_at(chainage_m)
        at, official, rate = self._lines
        return np.asarray(official[i] + rate[i] * (chainage_m - at[i]))

    def part(self, chainage_m: Array) -> np.ndarray:
        """Return the parts that chainages lie in, from 1. Shape (...)."""
        return np.asarray(self._part_of_stretch[self._stretch_at(chainage_m)] + 1)

    def ascends(self, chainage_m: Array) -> np.ndarray:
        """Return whether official places grow with chainage there. Shape (...)."""
        return np.asarray(self._lines[2][self._stretch_at(chainage_m)] > 0.0)

    def chainages(
        self, official_m: float, part: int | None = None, *, within_m: float = _SAME_PLACE_M
    ) -> tuple[float, ...]:
        """Return every chainage of an official place, m: none in a gap, two in an overlap; of one part where it is
        given.

        What lies up to ``within_m`` beyond the edge of a part is its edge. The ends go on where nothing else has the
        place, and of a part that is named.
        """
        inside = [x for i in self._chosen(part) for x in self._on(i, official_m, within_m)]
        if not inside:
            inside = list(self._beyond(official_m, part))
        inside.sort()
        return tuple(
            x for x, previous in zip(inside, [-math.inf, *inside], strict=False) if x - previous > 2.0 * within_m
        )

    def written(self, chainage_m: Array, *, decimals: int = 2) -> list[str]:
        """Return chainages (n,), m, as official places, ``12+345.67``, each with its part where others have it too.

        ``decimals`` are those of a metre. What is no finite number is an empty text.
        """
        chainage_m = np.asarray(chainage_m, dtype=np.float64)
        known = np.isfinite(chainage_m)
        x = np.where(known, chainage_m, 0.0)
        half = 0.5 * 10.0**-decimals
        official, part = self.official_m(x), self.part(x) - 1
        post = self._posts[self._stretch_at(x)] if self.notation == "km+m" else np.full(x.shape, np.nan)
        long = official >= 1000.0 * (post + 1.0) - half
        texts = written_places(official, self.notation, decimals=decimals, km=np.where(long, post, np.nan))
        low, high = self._extents(half).T
        among = np.searchsorted(np.sort(low), official + half, side="right")
        among = among - np.searchsorted(np.sort(high), official - half)
        inside = (low[part] <= official + half) & (high[part] >= official - half)
        first, last = self.stretches[0], self.stretches[-1]
        beyond = (x < first.from_m) & (last.chainage_of(official) > self.end_m - half)
        beyond |= (x > self.end_m) & (first.chainage_of(official) < first.from_m + half)
        several = ((among > inside) & ~long) | beyond
        if known.all() and not several.any():
            return texts
        return [
            "" if not k else f"{text} ({p + 1})" if many else text
            for text, p, many, k in zip(texts, part.tolist(), several.tolist(), known.tolist(), strict=True)
        ]

    def round_places(self, from_m: float, to_m: float, step_m: float) -> Array:
        """Return the chainages between two whose official places are multiples of a step, m, ascending (n,)."""
        places = []
        edges = [-math.inf, *self._from[1:].tolist(), math.inf]
        for stretch, begin, end in zip(self.stretches, edges, edges[1:], strict=False):
            low, high = max(from_m, begin), min(to_m, end)
            if low < high:
                least, greatest = sorted((stretch.official_at(low), stretch.official_at(high)))
                steps = np.arange(math.ceil(least / step_m), math.floor(greatest / step_m) + 1, dtype=np.float64)
                places.append(np.sort(stretch.chainage_of(np.asarray(step_m * steps))))
        return np.concatenate(places) if places else np.zeros(0)

    def read(self, text: str) -> float:
        """Return the chainage of a written place, m: ``12+345.6``, ``12.3456``, ``km 12,3456``, with its part where it
        needs one. A bare number is in kilometres.

        Raises ``ValueError`` for what is no place, for a place in a gap and for one that is there more than once.
        """
        match = _PART.match(text.strip())
        place, part = (match["place"], int(match["part"])) if match else (text.strip(), None)
        official = metres_of(place, "km")
        if official is None:
            raise ValueError(f"{text!r} is no place: expected one such as 12+345 or 12.345")
        if part is not None and not 1 <= part <= self.parts:
            raise ValueError(f"{text!r}: there is no part {part}: expected 1 to {self.parts}")
        within = 0.5 * resolution_m(place) * (1.0 + 1e-9)
        candidates = self._from_a_post(place, within) if part is None else ()
        candidates = candidates or self.chainages(official, part, within_m=within)
        if len(candidates) == 1:
            return candidates[0]
        if not candidates:
            raise ValueError(f"{text!r} is in a gap of the kilometrage: expected a place that exists")
        wish = " or ".join(self.written(np.array(candidates)))
        where = ", ".join(f"{x:.2f} m" for x in candidates)
        raise ValueError(f"{text!r} is there {len(candidates)} times, at chainages {where}: expected {wish}")

    @property
    def parts(self) -> int:
        """The number of parts."""
        return int(self._part_of_stretch[-1]) + 1

    @cached_property
    def jumps(self) -> tuple[Jump, ...]:
        """The places where kilometrage does not go on as before, in order of chainage."""
        jumps = []
        for previous, stretch in itertools.pairwise(self.stretches):
            back, ahead = previous.official_at(stretch.from_m), stretch.official_at(stretch.from_m)
            turned = (previous.rate > 0.0) != (stretch.rate > 0.0)
            if turned or abs(ahead - back) > _SAME_PLACE_M:
                missing = (ahead > back) == (stretch.rate > 0.0)
                kind: Literal["gap", "overlap", "turn"] = "turn" if turned else "gap" if missing else "overlap"
                jumps.append(Jump(stretch.from_m, back, ahead, kind))
        return tuple(jumps)

    def _stretch_at(self, chainage_m: Array) -> np.ndarray:
        return np.maximum(np.searchsorted(self._from, chainage_m, side="right") - 1, 0)

    def _chosen(self, part: int | None) -> Iterable[int]:
        return (i for i, number in enumerate(self._part_of_stretch) if part is None or number == part - 1)

    def _on(self, i: int, official_m: float, within_m: float) -> Iterator[float]:
        """Yield the chainage of an official place on stretch i, if it lies there."""
        stretch, end = self.stretches[i], self._to[i]
        low, high = self._range(i, within_m)
        if low - within_m <= official_m <= high + within_m:
            yield min(max(stretch.chainage_of(min(max(official_m, low), high)), stretch.from_m), float(end))

    def _beyond(self, official_m: float, part: int | None) -> Iterator[float]:
        """Yield the chainages of an official place before the first stretch and after the last."""
        first, last = self.stretches[0], self.stretches[-1]
        if part in (None, 1) and (x := first.chainage_of(official_m)) < first.from_m:
            yield x
        if part in (None, self.parts) and (x := last.chainage_of(official_m)) > self.end_m:
            yield x

    def _from_a_post(self, place: str, within_m: float) -> tuple[float, ...]:
        """Return the chainage of ``12+1003.5``, or of ``12 mi 5300 ft``, where lengths count from that very post."""
        if (split := post_and_metres(place)) is not None:
            if split[1] < 1000.0 - within_m:
                return ()
            official = 1000.0 * split[0] + split[1]
            counted = [i for i, stretch in enumerate(self.stretches) if stretch.post_km == split[0]]
        elif (mile := milepost_and_metres(place)) is not None:
            official = mile[0] + mile[1]
            counted = [i for i, s in enumerate(self.stretches) if abs(s.official_m - mile[0]) < _SAME_PLACE_M]
        else:
            return ()
        at = ((self.stretches[i].chainage_of(official), self._from[i], self._to[i]) for i in counted)
        return tuple(min(max(x, low), high) for x, low, high in at if low - within_m <= x <= high + within_m)

    def _range(self, i: int, within_m: float) -> tuple[float, float]:
        """Return the least and the greatest official place that a stretch has without metres above 1000."""
        stretch = self.stretches[i]
        low, high = sorted((stretch.official_at(stretch.from_m), stretch.official_at(float(self._to[i]))))
        if stretch.post_km is None or self.notation == "km":
            return low, high
        below_next = 1000.0 * (stretch.post_km + 1) - 2.0 * within_m
        return low, min(high, below_next)

    @cached_property
    def _from(self) -> Array:
        return np.array([stretch.from_m for stretch in self.stretches])

    @cached_property
    def _to(self) -> Array:
        return np.append(self._from[1:], self.end_m)

    @cached_property
    def _lines(self) -> Array:
        return np.array([(stretch.chainage_m, stretch.official_m, stretch.rate) for stretch in self.stretches]).T

    @cached_property
    def _posts(self) -> Array:
        return np.array([np.nan if stretch.post_km is None else stretch.post_km for stretch in self.stretches])

    @cached_property
    def _part_of_stretch(self) -> np.ndarray:
        """The part of each stretch, from 0."""
        return np.searchsorted(np.array([jump.chainage_m for jump in self.jumps]), self._from, side="right")

    def _extents(self, within_m: float) -> Array:
        """Return the least and the greatest official place of each part, (parts, 2)."""
        ranges = np.array([self._range(i, within_m) for i in range(len(self.stretches))])
        starts = np.flatnonzero(np.diff(self._part_of_stretch, prepend=-1))
        return np.stack([np.minimum.reduceat(ranges[:, 0], starts), np.maximum.reduceat(ranges[:, 1], starts)], axis=1)


@dataclass(frozen=True)
class KmPost:
    """A post stands at ``chainage_m`` and shows ``official_m``."""

    chainage_m: float
    official_m: float


def between_posts(posts: Sequence[KmPost], *, ascending: bool = True) -> tuple[Stretch, ...]:
    """Return the stretches between kilometre posts, in order of chainage; the first has no beginning.

    Between posts of neighbouring whole kilometres metres count from the smaller one, between others from the one with
    the smaller place. ``ascending`` is for a single post. Raises ``ValueError`` where two posts show the same place.
    """
    first, last = posts[0], posts[-1]
    stretches = []
    rate = 1.0 if ascending else -1.0
    for number, (post, next_post) in enumerate(itertools.pairwise(posts), start=1):
        if next_post.official_m == post.official_m:
            raise ValueError(f"posts {number} and {number + 1} show the same kilometre: expected different ones")
        rate = math.copysign(1.0, next_post.official_m - post.official_m)
        lower = post if rate > 0.0 else next_post
        whole = lower.official_m % 1000.0 == 0.0 and abs(next_post.official_m - post.official_m) == 1000.0
        km = int(lower.official_m // 1000.0) if whole else None
        if number == 1:
            stretches.append(Stretch(-math.inf, first.chainage_m, first.official_m, rate))
        stretches.append(Stretch(post.chainage_m, lower.chainage_m, lower.official_m, rate, km))
    beginning = last.chainage_m if stretches else -math.inf
    return (*stretches, Stretch(beginning, last.chainage_m, last.official_m, rate))


def rescaled(stretches: Sequence[Stretch], scales: Sequence[tuple[float, float]]) -> tuple[Stretch, ...]:
    """Return stretches whose kilometrage is not measured along the track: from each chainage of ``scales`` on, it has
    so many metres to one of chainage.

    What lies before the first of them has its scale. A place that a stretch counts from keeps its kilometrage.
    """
    knots, scale = (np.array(column, dtype=np.float64) for column in zip(*scales, strict=True))
    measured = np.concatenate([[0.0], np.cumsum(scale[:-1] * np.diff(knots))])

    def at(x: float) -> tuple[float, float]:
        j = max(int(np.searchsorted(knots, x, side="right")) - 1, 0)
        return float(measured[j] + scale[j] * (x - knots[j])), float(scale[j])

    pieces = []
    for stretch, end in zip(stretches, [*(s.from_m for s in stretches[1:]), math.inf], strict=True):
        origin, _ = at(stretch.chainage_m)
        inner = knots[(knots > stretch.from_m) & (knots < end)].tolist()
        for edge in [stretch.from_m, *inner]:
            x = edge if math.isfinite(edge) else min([stretch.chainage_m, *inner])
            length, factor = at(x)
            official = stretch.official_m + stretch.rate * (length - origin)
            pieces.append(Stretch(edge, x, official, stretch.rate * factor, stretch.post_km))
    return tuple(pieces)
