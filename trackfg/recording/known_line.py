"""Tracks that are known beforehand: their centre lines, and where a vehicle can go from one to another."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from trackfg.errors import BadInputError, did_you_mean
from trackfg.numerics.arrays import Array
from trackfg.numerics.geodesy import geodetic_to_enu
from trackfg.numerics.key_figures import Outlined
from trackfg.recording.track_joints import Relation, joined

if TYPE_CHECKING:
    from trackfg.recording.model import Recording
    from trackfg.recording.track_network import TrackNetwork

_REPEATED_M = 1e-3
"""A vertex that is nearer to the one before repeats it, m: nine decimals of a degree are 0.1 mm."""


@dataclass(frozen=True, repr=False)
class KnownLine(Outlined):
    """Tracks of a file: ``ids`` and ``vertices``, each (m, 2): latitude and longitude (WGS 84, deg), or east and north
    (m) in the local frame of the recording where ``is_local``. Without ``relations`` tracks join where they touch.
    """

    name: str
    ids: tuple[str, ...]
    vertices: tuple[Array, ...]
    relations: tuple[Relation, ...] | None = None
    is_local: bool = False
    content_sha256: str | None = None
    """Digest of the file that was given beside the recording; None of one that is part of it."""

    def only(self, ids: Iterable[str]) -> KnownLine:
        """Return the line with these tracks alone. Raises :class:`BadInputError` for one that it does not have."""
        wanted = list(ids)
        for track in wanted:
            if track not in self.ids:
                hint = did_you_mean(track, self.ids) or f"the first of its {len(self.ids)} tracks is {self.ids[0]!r}"
                raise BadInputError(f"{self.name}: has no track {track!r}. Hint: {hint}")
        kept = [k for k, track in enumerate(self.ids) if track in wanted]
        relations = None if self.relations is None else tuple(r for r in self.relations if {r.a, r.b} <= set(wanted))
        ids, vertices = tuple(self.ids[k] for k in kept), tuple(self.vertices[k] for k in kept)
        return replace(self, ids=ids, vertices=vertices, relations=relations)

    def network(self, recording: Recording) -> TrackNetwork:
        """Return the tracks in the frame of a recording's positions.

        Raises :class:`BadInputError` for a recording without GNSS, where the two are not in one frame, and for a track
        without length.
        """
        origin, lines = self._origin(recording), self.vertices
        if origin is not None:
            height = float(origin[2])
            lines = tuple(
                geodetic_to_enu(np.column_stack([line, np.full(len(line), height)]), origin)[:, :2] for line in lines
            )
        lines = tuple(_without_repeats(line) for line in lines)
        for track, line in zip(self.ids, lines, strict=True):
            if len(line) < 2:
                raise BadInputError(f"{self.name}: track {track!r} has no length: expected vertices at two places")
        return joined(self.ids, lines, self.relations)

    def _origin(self, recording: Recording) -> Array | None:
        gnss, origin = recording.description.gnss, recording.gnss_origin
        if gnss is None:
            raise BadInputError(
                f"{self.name}: the recording has no GNSS: expected positions, by which its tracks are found"
            )
        if self.is_local and gnss.frame != "local":
            raise BadInputError(
                f"{self.name}: its coordinates are local, positions of the recording are geodetic: expected both in "
                "one frame. Hint: --line-crs names the reference system of the line"
            )
        if not self.is_local and origin is None:
            raise BadInputError(
                f"{self.name}: its coordinates are geodetic, positions of the recording are local: expected both in "
                "one frame. Hint: give origin in [gnss], or --line-crs local"
            )
        return None if self.is_local else origin


def _without_repeats(line: Array) -> Array:
    """Return the line without vertices that repeat the one before."""
    return np.asarray(line[np.append(True, np.linalg.norm(np.diff(line, axis=0), axis=1) > _REPEATED_M)])
