"""A long step turns the path instead of stretching it.

A Gauss-Newton step moves positions and velocities along straight lines. Where it turns a long path by an angle a, as a
wrong heading or a wrong mounting wants, each chord of length L becomes ``L sqrt(1 + a^2)``, and the wheel contradicts
that: only a small part of the step lowers the cost. Here the part of a change that is across a chord turns it, and the
part along it makes it longer:

    c + d  ->  (L + d_along) (cos(a) c / L + sin(a) d_across / |d_across|),   a = |d_across| / L

the exponential map of length and direction. To first order in d that is the straight step, so the minimum is the same.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackfg.factors.states import Nav, States
from trackfg.numerics.arrays import Array

_WIDEST = 1.0
"""Angle, rad, beyond which a vector is moved straight: one of hardly any length, as at rest, has no direction."""


def along_arcs(before: States, moved: States) -> States:
    """Return what was ``moved`` straight with chords from keyframe to keyframe, and velocities, that are turned.

    The first position is the moved one; whatever is not position or velocity is as moved.
    """
    old, new = before.nav, moved.nav
    chords = _turned(np.diff(old.p, axis=0), np.diff(new.p, axis=0))
    p = np.cumsum(np.concatenate([new.p[:1], chords]), axis=0)
    return replace(moved, nav=Nav(new.R, p, _turned(old.v, new.v)))


def _turned(vector: Array, target: Array) -> Array:
    """Return vectors (m, 3) that are turned from ``vector`` towards ``target``, which is straight from there."""
    length = np.linalg.norm(vector, axis=1, keepdims=True)
    change = target - vector
    with np.errstate(divide="ignore", invalid="ignore"):  # what has no length or is not turned stays straight
        direction = vector / length
        along = np.sum(change * direction, axis=1, keepdims=True)
        across = change - along * direction
        turn = np.linalg.norm(across, axis=1, keepdims=True)
        angle = turn / length
        turned = (length + along) * (np.cos(angle) * direction + np.sin(angle) * across / turn)
        return np.where((turn > 0.0) & (angle < _WIDEST) & (along > -length), turned, target)
