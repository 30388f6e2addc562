"""Chainages as a page writes them: in km, or as official places where the page is asked for those."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.kilometrage import Kilometrage
from trackfg.report.charts import OfficialAxis, OfficialStretch


@dataclass(frozen=True)
class PagePlaces:
    """Writes chainages, m; ``kilometrage`` is None where no official places are wanted."""

    kilometrage: Kilometrage | None = None

    def written(self, chainage_m: ArrayLike) -> list[str]:
        """Return places (n,) to a metre or better, empty where a chainage is not known."""
        chainage = np.atleast_1d(np.asarray(chainage_m, dtype=np.float64))
        if self.kilometrage is not None:
            return self.kilometrage.written(chainage)
        return [f"{1e-3 * x:.3f}" if np.isfinite(x) else "" for x in chainage]

    def axis(self, chainage_m: Array, scale: float) -> OfficialAxis | None:
        """Return the official places of an axis on which ``scale`` brings metres; None where none are wanted."""
        if self.kilometrage is None:
            return None
        low, high = float(chainage_m.min()), float(chainage_m.max())
        stretches = self.kilometrage.stretches
        ends = [*(stretch.from_m for stretch in stretches[1:]), np.inf]
        return OfficialAxis(
            tuple(
                OfficialStretch(
                    scale * max(stretch.from_m, low),
                    scale * stretch.chainage_m,
                    stretch.official_m,
                    stretch.rate / scale,
                    stretch.post_km,
                )
                for stretch, end in zip(stretches, ends, strict=True)
                if stretch.from_m <= high and end > low
            ),
            self.kilometrage.notation == "km+m",
        )
