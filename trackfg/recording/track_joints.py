"""Tracks are cut where others join them, and the ways from piece to piece are found.

Where a file has relations between its tracks (netrelations), these are the ways. Otherwise a way is where the end of a
track touches another one, and a vehicle can go on without turning sharply.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.recording.track_network import TrackNetwork, place_at, stations

JOINED_M = 1.0
"""Ends of tracks that are nearer to a track are joined to it, m: files give decimetres, and each end its own node."""
_SHARPEST = np.cos(np.radians(60.0))
"""Tracks that meet at a sharper angle are no way for a vehicle: of the sharpest tram curves, R 15 m, 10 m turn by 38
deg."""
_CHORD_M = 10.0
"""The direction of a track at its end is that of the chord over so much of it, m: vertices alone may be rough."""

End = tuple[int, int]
"""A piece and its end: 0 where it starts, 1 where it ends."""


class Relation(NamedTuple):
    """A vehicle can go from track ``a``, at the share ``on_a`` of its length, to ``b`` at ``on_b``, or back."""

    a: str
    on_a: float
    b: str
    on_b: float
    forth: bool = True
    back: bool = True


class _Piece(NamedTuple):
    """A piece is a stretch of a track, from ``start`` to ``end`` along it, m."""

    track: int
    start: float
    end: float
    line: Array

    def outward(self, end: int) -> Array:
        """Return the direction in which a vehicle leaves it at one of its ends."""
        length = self.end - self.start
        at = [min(_CHORD_M, length), 0.0] if end == 0 else [max(length - _CHORD_M, 0.0), length]
        chord = np.diff(place_at(self.line, np.array(at)), axis=0)[0]
        return np.asarray(chord / max(float(np.linalg.norm(chord)), 1e-9))


def joined(ids: tuple[str, ...], lines: tuple[Array, ...], relations: Sequence[Relation] | None) -> TrackNetwork:
    """Return the network of tracks with these ids and vertices, (m, 2) each, m."""
    if relations is None:
        pieces = _pieces(lines, _touched(lines))
        ways = _ways_where_ends_meet(pieces)
    else:
        places = _places(relations, ids, lines)
        cuts: list[set[float]] = [set() for _ in lines]
        for track, station in itertools.chain.from_iterable(itertools.chain.from_iterable(places)):
            cuts[track].add(station)
        pieces = _pieces(lines, cuts)
        ways = _ways_of_relations(pieces, relations, places)
    names = tuple(ids[piece.track] for piece in pieces)
    return TrackNetwork(
        names, tuple(piece.line for piece in pieces), {end: tuple(sorted(to)) for end, to in ways.items()}
    )


def _pieces(lines: tuple[Array, ...], cuts: list[set[float]]) -> list[_Piece]:
    """Cut tracks at distances along them, m; cuts near to each other or to an end are one."""
    pieces = []
    for track, (line, at) in enumerate(zip(lines, cuts, strict=True)):
        of_vertices = stations(line)
        edges = [0.0]
        for cut in sorted(at):
            if JOINED_M < cut < of_vertices[-1] - JOINED_M and cut - edges[-1] > JOINED_M:
                edges.append(cut)
        for start, end in itertools.pairwise([*edges, float(of_vertices[-1])]):
            between = of_vertices[(of_vertices > start) & (of_vertices < end)]
            its_line = place_at(line, np.concatenate([[start], between, [end]]))
            pieces.append(_Piece(track, start, end, its_line))
    return pieces


def _touched(lines: tuple[Array, ...]) -> list[set[float]]:
    """Return where each track is touched by the ends of others, m along it."""
    cuts: list[set[float]] = [set() for _ in lines]
    whole = TrackNetwork(("",) * len(lines), lines, {})
    ends = np.concatenate([line[[0, -1]] for line in lines])
    feet = whole.feet(ends, np.full(len(ends), JOINED_M))
    for end, track, along in zip(feet.point.tolist(), feet.piece.tolist(), feet.along.tolist(), strict=True):
        if end // 2 != track:
            cuts[track].add(along)
    return cuts


def _is_way(pieces: list[_Piece], a: End, b: End) -> bool:
    """Return whether a vehicle that leaves one piece at its end can go on along the other."""
    return -float(pieces[a[0]].outward(a[1]) @ pieces[b[0]].outward(b[1])) >= float(_SHARPEST)


def _ways_where_ends_meet(pieces: list[_Piece]) -> dict[End, set[End]]:
    from scipy.spatial import cKDTree  # late: only runs on a known line need it

    ways: dict[End, set[End]] = defaultdict(set)
    tree = cKDTree(np.concatenate([piece.line[[0, -1]] for piece in pieces]))
    for i, j in tree.query_pairs(JOINED_M):
        a, b = divmod(i, 2), divmod(j, 2)
        if a[0] != b[0] and _is_way(pieces, a, b):
            ways[a].add(b)
            ways[b].add(a)
    return ways


_Place = tuple[int, float]
"""A track, and m along it."""


def _places(
    relations: Sequence[Relation], ids: tuple[str, ...], lines: tuple[Array, ...]
) -> list[tuple[list[_Place], list[_Place]]]:
    """Return the places of each relation on its two tracks; a track of several parts has as many."""
    parts: dict[str, list[_Place]] = defaultdict(list)
    for track, (its_id, line) in enumerate(zip(ids, lines, strict=True)):
        parts[its_id].append((track, float(stations(line)[-1])))

    def places(its_id: str, share: float) -> list[_Place]:
        return [(track, share * length) for track, length in parts[its_id]]

    return [(places(relation.a, relation.on_a), places(relation.b, relation.on_b)) for relation in relations]


def _ways_of_relations(
    pieces: list[_Piece], relations: Sequence[Relation], places: list[tuple[list[_Place], list[_Place]]]
) -> dict[End, set[End]]:
    """Return the ways of relations, and those from piece to piece of one track.

    At its end a track is left in one sense; within it, in the one that does not turn sharply.
    """
    ways: dict[End, set[End]] = defaultdict(set)
    for k, (first, second) in enumerate(itertools.pairwise(pieces)):
        if first.track == second.track:
            ways[k, 1].add((k + 1, 0))
            ways[k + 1, 0].add((k, 1))
    at: dict[int, list[tuple[float, End]]] = defaultdict(list)
    for k, piece in enumerate(pieces):
        at[piece.track] += [(piece.start, (k, 0)), (piece.end, (k, 1))]

    def ends(places: list[_Place]) -> list[End]:
        return [end for track, station in places for place, end in at[track] if abs(place - station) <= JOINED_M]

    for relation, (on_a, on_b) in zip(relations, places, strict=True):
        pairs = list(itertools.product(ends(on_a), ends(on_b)))
        for a, b in pairs if len(pairs) == 1 else [pair for pair in pairs if _is_way(pieces, *pair)]:
            if relation.forth:
                ways[a].add(b)
            if relation.back:
                ways[b].add(a)
    return ways
