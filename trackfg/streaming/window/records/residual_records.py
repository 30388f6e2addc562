"""The residual records of a window show how good its sensors are, and give its factors their sigmas.

Positions, speeds of the receiver, noise and walking biases have a record each. Factors of the next interval have sigmas
of the newest levels. Each relinearisation pass judges residuals anew, as the batch reassesses a solution
(:mod:`trackfg.smoothing.reassessment`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from trackfg.factors.family import Family
from trackfg.solver.covariance import Covariance, posterior_covariance
from trackfg.solver.variance_components import GROUPS, Residuals, group_residuals, ratios_of, walk_residuals
from trackfg.streaming.window.records.gnss_record import GnssRecord
from trackfg.streaming.window.records.noise_record import NoiseRecord
from trackfg.streaming.window.records.walk_record import WalkRecord
from trackfg.streaming.window.window import Window, WindowStep


@dataclass
class ResidualRecords:
    """The records of one running window.

    ``gnss`` and ``gnss_speeds`` are of a receiver's positions and speeds, ``walk`` of the biases, ``noise`` of all
    else. ``speed_doubted``: whether the sigmas of the speed are too small beyond chance so far.
    """

    gnss: GnssRecord = field(default_factory=GnssRecord)
    gnss_speeds: GnssRecord = field(default_factory=GnssRecord.of_speeds)
    noise: NoiseRecord = field(default_factory=NoiseRecord)
    walk: WalkRecord = field(default_factory=WalkRecord)
    speed_doubted: bool = False

    @property
    def rest_erred(self) -> bool:
        """Return whether positions or speeds of the receiver have been right once against all else."""
        return self.gnss.rest_erred or self.gnss_speeds.rest_erred

    def put(self, newest: Window, covariance: Covariance) -> None:
        """Remember the positions and speeds at the ``newest`` two keyframes, of which ``covariance`` is."""
        self.gnss.put(newest, covariance)
        self.gnss_speeds.put(newest, covariance)

    def weigh_others(self, families: Sequence[Family], gnss_width: float) -> tuple[Family, ...]:
        """Return the families of the next interval with newest sigmas of wheel and receiver; those of the inertial
        sensor's samples have them already.
        """
        families = self.gnss.weigh_next(self.noise.weigh_wheel(families), gnss_width)
        return self.gnss_speeds.weigh_next(families, gnss_width)

    def weigh_receiver(self, window: Window, gnss_width: float) -> Window:
        """Return the window with newest sigmas of the receiver."""
        return self.gnss_speeds.weigh(self.gnss.weigh(window, gnss_width), gnss_width)

    def forget_receiver(self) -> None:
        """Give the receiver its declared sigmas: at rest its errors last for as long as the rest."""
        self.gnss.forget()
        self.gnss_speeds.forget()

    def reassess(
        self, step: WindowStep, leaving: int, bridged: np.ndarray, *, adapts: bool, heading_known: bool
    ) -> tuple[Window, Covariance | None]:
        """Return the window with sigmas as its residuals show them, and the covariance that these were judged by, if
        they were; sigmas of the receiver change with the next pass.

        ``leaving``: how many of the first keyframes are marginalised next; ``bridged`` (n - 1,): intervals of holes of
        the inertial record. Of the receiver and all else, what is further beyond its sigmas is judged, as in the batch.
        A street canyon bends the speed, too: doubts of it only count against the other sensors where these are noisier
        than declared.
        """
        window, groups, covariance = step.window, dict[str, Residuals](), None
        if adapts and heading_known and len(window) > 1:
            covariance = posterior_covariance(step.root)
            groups = group_residuals(window, window.states, covariance, bridged)
        changes = self._judge_receiver(ratios_of(groups), heading_known=heading_known)
        if changes or covariance is None:
            return window, covariance
        walk = walk_residuals(window, window.states, covariance)
        window = window if walk is None else self.walk.weigh(window, walk, leaving, self.noise.far_off)
        return self.noise.weigh(window, groups, leaving), covariance

    def _judge_receiver(self, ratios: dict[str, float], *, heading_known: bool) -> bool:
        """Judge positions and speeds where the other sensors, of such ``ratios``, err less; return whether sigmas
        change.
        """
        changes, speed_doubted = False, self.speed_doubted and self.noise.has_risen
        for record, doubted in ((self.gnss, speed_doubted), (self.gnss_speeds, False)):
            level = float(np.median(record.usual))
            if doubted or self.noise.is_worse_than_gnss(ratios, GROUPS[record.kind], level):
                record.forget()
            else:
                changes |= record.judge(heading_known=heading_known)
        return changes
