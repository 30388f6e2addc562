"""The designed cant along a line, from its curves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackfg.curves import Curve
from trackfg.curves.transition_laws import LAWS, rise
from trackfg.numerics.arrays import Array


def cant_profile(curves: Sequence[Curve], chainage: Array) -> tuple[Array, Array]:
    """Return cant and its sigma, mm, left rail higher, at ascending places (n,).

    A curve's cant rises over its first transition and falls over its last, by their laws; between two circles of a
    compound curve the fall of the one and the rise of the next are one transition, and the sum is right.
    """
    cant, variance = np.zeros(len(chainage)), np.zeros(len(chainage))
    for curve in curves:
        if not np.isfinite(curve.cant_mm):
            continue
        ends = np.array([curve.btc_m, curve.etc_m])
        first, stop = np.searchsorted(chainage, np.where(np.isnan(ends), [-np.inf, np.inf], ends)).tolist()
        on = slice(first, stop)
        share = _risen(curve.law_in, curve.btc_m, curve.bcc_m, chainage[on], 1.0)
        share = share - _risen(curve.law_out, curve.ecc_m, curve.etc_m, chainage[on], 0.0)
        cant[on] -= np.sign(curve.curvature_1pm) * curve.cant_mm * share
        variance[on] += (curve.sd("cant_mm") * share) ** 2
    return cant, np.sqrt(variance)


def _risen(law: str, begin: float, end: float, chainage: Array, unseen: float) -> Array:
    """Return the share that a transition has risen at places; ``unseen`` where the profile does not reach it."""
    if not (np.isfinite(begin) and np.isfinite(end)):
        return np.full(len(chainage), unseen)
    known_law = next((name for name in LAWS if name == law), None)
    if known_law is None or end <= begin:
        return np.asarray((chainage >= begin).astype(np.float64))
    return rise(known_law, (chainage - begin) / (end - begin))[0]
