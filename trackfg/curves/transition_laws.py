"""Transition laws: how curvature and cant go from one value to the next.

Over a transition of length ``L`` from ``b``, with ``u = (x - b) / L``, a quantity rises by the share ``f(u)``, 0 before
and 1 after:

* ``clothoid``: ``f = u``;
* ``half-sine``: ``f = (1 - cos(pi u)) / 2``, the Japanese one;
* ``sine``: ``f = u - sin(2 pi u) / (2 pi)``;
* ``bloss``: ``f = 3 u^2 - 2 u^3``;
* ``helmert``: ``f = 2 u^2`` and, from the middle on, ``1 - 2 (1 - u)^2``.

All are symmetric, ``f(1 - u) = 1 - f(u)``, and known here with their first and second integrals from 0, the shares of
the heading and of the lateral position. Beyond the end ``f = 1``, ``F1 = u - 1/2`` and ``F2 = ((u - 1/2)^2 + s^2) /
2``, where ``s^2``, the variance of the density ``f'``, is all that is seen from afar of law and length together: laws
whose ``s L`` are equal differ only within the transition.

Source: the curvature laws of IFC 4.3 (CLOTHOID, COSINECURVE, SINECURVE, BLOSSCURVE, HELMERTCURVE).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

from trackfg.numerics.arrays import Array

TransitionLaw = Literal["clothoid", "half-sine", "sine", "bloss", "helmert"]
LAWS: tuple[TransitionLaw, ...] = ("clothoid", "half-sine", "sine", "bloss", "helmert")

SPREAD: dict[TransitionLaw, float] = {
    "clothoid": float(np.sqrt(1.0 / 12.0)),
    "half-sine": float(np.sqrt(0.25 - 2.0 / np.pi**2)),
    "sine": float(np.sqrt(1.0 / 12.0 - 0.5 / np.pi**2)),
    "bloss": float(np.sqrt(1.0 / 20.0)),
    "helmert": float(np.sqrt(1.0 / 24.0)),
}
"""``s`` of each law."""


def _helmert(u: Array) -> tuple[Array, Array, Array]:
    v = np.minimum(u, 1.0 - u)
    late = u > 0.5
    f, first, second = 2.0 * v**2, 2.0 / 3.0 * v**3, v**4 / 6.0
    return (
        np.where(late, 1.0 - f, f),
        np.where(late, u - 0.5 + first, first),
        np.where(late, 7.0 / 48.0 - 0.5 * u * v - second, second),
    )


_INSIDE: dict[TransitionLaw, Callable[[Array], tuple[Array, Array, Array]]] = {
    "clothoid": lambda u: (u, 0.5 * u**2, u**3 / 6.0),
    "half-sine": lambda u: (
        0.5 * (1.0 - np.cos(np.pi * u)),
        0.5 * u - np.sin(np.pi * u) / (2.0 * np.pi),
        0.25 * u**2 - (1.0 - np.cos(np.pi * u)) / (2.0 * np.pi**2),
    ),
    "sine": lambda u: (
        u - np.sin(2.0 * np.pi * u) / (2.0 * np.pi),
        0.5 * u**2 - (1.0 - np.cos(2.0 * np.pi * u)) / (4.0 * np.pi**2),
        u**3 / 6.0 - u / (4.0 * np.pi**2) + np.sin(2.0 * np.pi * u) / (8.0 * np.pi**3),
    ),
    "bloss": lambda u: (3.0 * u**2 - 2.0 * u**3, u**3 - 0.5 * u**4, 0.25 * u**4 - 0.1 * u**5),
    "helmert": _helmert,
}


def rise(law: TransitionLaw, u: Array) -> tuple[Array, Array, Array]:
    """Return ``f``, ``F1 = int f`` and ``F2 = int int f`` from 0, at any ``u``. Shape (...) to three of (...)."""
    f, first, second = _INSIDE[law](np.clip(u, 0.0, 1.0))
    beyond = np.maximum(u - 1.0, 0.0)
    return f, first + beyond, second + 0.5 * beyond * (1.0 + beyond)
