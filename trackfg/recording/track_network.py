"""A network of tracks in plan: what is near a point, and where a vehicle gets from there."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.key_figures import Outlined

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

_VERTEX_M = 10.0
"""Vertices are at most so far apart where they are searched, m: less than the distances that are searched."""
_ON_TRACK_M = 1.0
"""Slack of the search for the foot on a given piece, m, over the largest distance that the earlier foot allows."""


class Feet(NamedTuple):
    """The foot of each of several points on each piece that is near: one row per pair, in order of the points.

    ``point``, ``piece``: which. ``along`` m from the piece's start; ``across`` m, positive where the point is to the
    left of the piece; ``place`` (k, 2), m; ``normal`` (k, 2), to the left; ``beyond`` m past an end of the piece.
    """

    point: np.ndarray
    piece: np.ndarray
    along: Array
    across: Array
    place: Array
    normal: Array
    beyond: Array

    def take(self, rows: np.ndarray) -> Feet:
        """Return some rows."""
        return Feet(*(column[rows] for column in self))


@dataclass(frozen=True, repr=False)
class TrackNetwork(Outlined):
    """Pieces of tracks in plan, and the ways from one to another.

    ``track`` (p,) is the id of each piece; ``lines`` its vertices, (m, 2) east and north, m. ``ways`` leads from
    (piece, end) to where a vehicle gets that leaves it there: pieces and the ends at which it enters; ends are 0 and 1.
    """

    track: tuple[str, ...]
    lines: tuple[Array, ...]
    ways: dict[tuple[int, int], tuple[tuple[int, int], ...]]

    @cached_property
    def length_m(self) -> Array:
        """The length of each piece, m, shape (p,)."""
        return np.array([stations(line)[-1] for line in self.lines])

    @cached_property
    def _segments(self) -> _Segments:
        return _Segments.of(self.lines)

    def feet(self, points: Array, within_m: Array) -> Feet:
        """Return the feet of ``points`` (n, 2) on all pieces within ``within_m`` (n,), the nearest of each piece."""
        return self._segments.feet(points, within_m)

    def feet_on(self, earlier: Feet, points: Array) -> Feet:
        """Return the feet of ``points`` (n, 2) on the pieces of ``earlier`` feet, one for each point."""
        moved = np.linalg.norm(points - earlier.place, axis=1)
        feet = self.feet(points, moved + earlier.beyond + _ON_TRACK_M + _VERTEX_M)
        count = len(self.lines)
        rows = np.searchsorted(feet.point * count + feet.piece, np.arange(len(points)) * count + earlier.piece)
        return feet.take(rows)

    def reached(self, start: tuple[int, float, int], most_m: float) -> dict[tuple[int, int], float]:
        """Return the ends of pieces that a vehicle enters within ``most_m``, and the distance to each, m.

        ``start``: piece, m along it, and in which sense of the piece it goes, 1 or -1.
        """
        piece, along, sense = start
        to_end_m = float(self.length_m[piece] - along if sense > 0 else along)
        entered: dict[tuple[int, int], float] = {}
        leaving = [((piece, 1 if sense > 0 else 0), to_end_m)]
        while leaving:
            end, distance = leaving.pop()
            if distance > most_m:
                continue
            for way in self.ways.get(end, ()):
                if distance < entered.get(way, np.inf):
                    entered[way] = distance
                    leaving.append(((way[0], 1 - way[1]), distance + float(self.length_m[way[0]])))
        return entered


class _Segments(NamedTuple):
    """The segments of all pieces, none longer than :data:`_VERTEX_M`, and a tree of their starts.

    ``piece`` (s,), ``start`` and ``end`` (s, 2), ``station`` (s,) of the start along its piece; ``first`` and ``last``
    mark those at the ends of a piece.
    """

    piece: np.ndarray
    start: Array
    end: Array
    station: Array
    first: np.ndarray
    last: np.ndarray
    tree: cKDTree

    @classmethod
    def of(cls, lines: tuple[Array, ...]) -> _Segments:
        from scipy.spatial import cKDTree  # late: only runs on a known line need it

        dense = [_dense(line) for line in lines]
        counts = [len(line) - 1 for line in dense]
        start = np.concatenate([line[:-1] for line in dense])
        end = np.concatenate([line[1:] for line in dense])
        station = np.concatenate([stations(line)[:-1] for line in dense])
        ends = np.cumsum(counts) - 1
        first, last = np.zeros((2, len(start)), dtype=bool)
        first[np.append(0, ends[:-1] + 1)], last[ends] = True, True
        return cls(np.repeat(np.arange(len(lines)), counts), start, end, station, first, last, cKDTree(start))

    def feet(self, points: Array, within_m: Array) -> Feet:
        near = self.tree.query_ball_point(points, within_m + _VERTEX_M)
        counts = [len(segments) for segments in near]
        point = np.repeat(np.arange(len(points)), counts)
        k = np.concatenate([np.asarray(segments, dtype=np.int64) for segments in near]) if sum(counts) else point
        step = self.end[k] - self.start[k]
        length = np.linalg.norm(step, axis=1)
        tangent = step / length[:, None]
        offset = points[point] - self.start[k]
        free = np.sum(offset * tangent, axis=1)
        along = np.clip(free, np.where(self.first[k], -np.inf, 0.0), np.where(self.last[k], np.inf, length))
        beyond = np.abs(along - np.clip(along, 0.0, length))
        place = self.start[k] + along[:, None] * tangent
        normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
        apart = points[point] - place
        distance = np.hypot(apart[:, 0], apart[:, 1])
        across = np.copysign(distance, np.sum(offset * normal, axis=1))  # also at a corner, beside both segments
        distance = np.hypot(distance, beyond)
        piece = self.piece[k]
        order = np.lexsort((distance, piece, point))
        nearest = np.ones(len(order), dtype=bool)
        nearest[1:] = (np.diff(point[order]) != 0) | (np.diff(piece[order]) != 0)
        rows = order[nearest & (distance <= within_m[point])[order]]
        return Feet(point, piece, self.station[k] + along, across, place, normal, beyond).take(rows)


def stations(line: Array) -> Array:
    """Return how far each vertex (m, 2) is along its line, m, shape (m,)."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])


def place_at(line: Array, station: Array) -> Array:
    """Return the places (n, 2) at distances ``station`` (n,) along a line, m."""
    of_vertices = stations(line)
    return np.stack([np.interp(station, of_vertices, line[:, k]) for k in (0, 1)], axis=-1)


def _dense(line: Array) -> Array:
    of_vertices = stations(line)
    lengths = np.diff(of_vertices)
    parts = np.maximum(np.ceil(lengths / _VERTEX_M).astype(int), 1)
    share = np.concatenate([np.arange(n) / n for n in parts])
    between = np.repeat(of_vertices[:-1], parts) + share * np.repeat(lengths, parts)
    return place_at(line, np.append(between, of_vertices[-1]))
