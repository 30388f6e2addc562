"""Positions that are wrong, worse than declared, or late."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from trackfg.datasets.scenario import Effect
from trackfg.datasets.sensors.positioning import gauss_markov
from trackfg.datasets.vehicle.random_spans import random_spans
from trackfg.datasets.vehicle.ride import Ride
from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import median_interval, within
from trackfg.recording.model import GNSS_SPEED_TABLE, Recording

FEWEST_FIXES = 5
"""With fewer fixes a wrong one cannot be identified with confidence: two may agree by chance."""
_ENU = ("east", "north", "up")


@dataclass(frozen=True)
class WrongFixes(Effect):
    """Fixes of which a share of ``magnitude`` has the chainage of another balise of the run.

    At least one is wrong of :data:`FEWEST_FIXES` or more; of fewer none, since no vote could identify it. For the
    oracle: the wrong ones are left out.
    """

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        fixes = recording.fixes
        if fixes is None or len(fixes) < FEWEST_FIXES:
            return recording
        chainage = fixes["chainage_m"].to_numpy()
        wrong = rng.permutation(len(fixes))[: max(1, round(self.magnitude * len(fixes)))]
        other = (wrong + rng.integers(1, len(fixes), len(wrong))) % len(fixes)
        if self.for_oracle:
            return replace(recording, fixes=fixes.drop(index=fixes.index[wrong]).reset_index(drop=True))
        read = chainage.copy()
        read[wrong] = chainage[other]
        return replace(recording, fixes=fixes.assign(chainage_m=read))


@dataclass(frozen=True)
class ScatteredFixes(Effect):
    """Fixes that scatter by ``magnitude`` metres (1 sigma) more than declared."""

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        fixes = recording.fixes
        if fixes is None:
            return recording
        scattered = fixes.assign(chainage_m=fixes["chainage_m"] + self.magnitude * rng.standard_normal(len(fixes)))
        if self.for_oracle:
            scattered["chainage_sd_m"] = np.hypot(fixes["chainage_sd_m"], self.magnitude)
        return replace(recording, fixes=scattered)


CANYON_S = (20.0, 60.0)
"""Shortest and longest stay between tall houses, s; the open stretches last :data:`OPEN_S` on average. Assumed."""
OPEN_S = 40.0
SPEED_PER_M = 0.04
"""By what speeds err between houses, m/s, where positions err by 1 m: 95 % of a geodetic receiver's err by 0.24 m/s or
less and of its positions by 6.8 m (Kingston, `tools/real_data_facts.py`)."""
SPEED_CORRELATION_S = 2.0
"""Correlation time of these errors, s: their autocorrelation is 0.4 after one second and 0.2 after three, there."""
CORRELATION_S = 20.0
"""Correlation time of the multipath of a moving receiver among houses, s: tens of seconds. Assumed."""


@dataclass(frozen=True)
class Canyon(Effect):
    """Satellite positions that err by ``magnitude`` metres (horizontal rms) for tens of seconds, between houses.

    Up errs by twice that of a horizontal axis, and the receiver's speeds by :data:`SPEED_PER_M` times as much. For the
    oracle: the sigmas include the errors, as if white.
    """

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        gnss = recording.gnss
        if gnss is None:
            return recording
        span_rng, error_rng = rng.spawn(2)
        t = gnss["t_s"].to_numpy()
        spans = t[0] + random_spans(1.0 / OPEN_S, CANYON_S, float(t[-1] - t[0]), span_rng)
        shadowed = within(t, spans)
        error = shadowed[:, None] * self.magnitude * np.sqrt([0.5, 0.5, 2.0])
        wandering = gauss_markov(len(t), float(np.exp(-median_interval(t) / CORRELATION_S)), error_rng)
        columns = {
            f"{axis}_m": gnss[f"{axis}_m"].to_numpy() + error[:, i] * wandering[:, i] for i, axis in enumerate(_ENU)
        }
        if self.for_oracle:
            columns |= {f"{axis}_sd_m": np.hypot(gnss[f"{axis}_sd_m"], error[:, i]) for i, axis in enumerate(_ENU)}
        others = recording.others
        if GNSS_SPEED_TABLE in others:
            speeds = self._among_houses(others[GNSS_SPEED_TABLE], spans, *rng.spawn(1))
            others = {**others, GNSS_SPEED_TABLE: speeds}
        return replace(recording, gnss=gnss.assign(**columns), others=others)

    def _among_houses(self, speeds: pd.DataFrame, spans: Array, rng: np.random.Generator) -> pd.DataFrame:
        """Return a receiver's speeds with their errors in spans (s, 2), s."""
        t, speed, sd = speeds.to_numpy().T
        phi = float(np.exp(-median_interval(t) / SPEED_CORRELATION_S))
        size = within(t, spans) * (self.magnitude * SPEED_PER_M)
        wrong = np.abs(speed + size * gauss_markov(len(t), phi, rng)[:, 0])
        return speeds.assign(speed_mps=wrong, speed_sd_mps=np.hypot(sd, size) if self.for_oracle else sd)


@dataclass(frozen=True)
class LateGnss(Effect):
    """Satellite positions stamped ``magnitude`` seconds late. For the oracle: no delay."""

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        gnss = recording.gnss
        if gnss is None or self.for_oracle:
            return recording
        speeds = {name: recording.others[name] for name in (GNSS_SPEED_TABLE,) if name in recording.others}
        late = {name: table.assign(t_s=table["t_s"] + self.magnitude) for name, table in speeds.items()}
        others = {**recording.others, **late}
        return replace(recording, gnss=gnss.assign(t_s=gnss["t_s"] + self.magnitude), others=others)
