"""What canonical rows in order must satisfy besides being finite: sigmas above zero, and steps that a wheel can make.

A counter that starts again, or loses its place, makes one impossible step and is sound afterwards. Rows after such a
step are refused until ``RESET_ROWS`` in succession go together; from then on the count is taken up where it stood, so
that of the distance only what was rolled during the step itself is lost, and an event ``tach-reset`` says when.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackfg.io.formats.tach import FASTEST_MPS
from trackfg.numerics.arrays import Array
from trackfg.recording.description import RecordingDescription
from trackfg.streaming.events import LossReport, StreamEvent

RESET_ROWS = 10
COARSEST_STEP_M = 10.0
"""No tach counts in coarser steps: so much more than the fastest speed gives may come between two rows."""

_SIGMAS = {"fixes": slice(2, 3), "gnss": slice(4, 7)}


class RowChecks:
    """Passes sound rows on and sends the others to the report."""

    def __init__(self, description: RecordingDescription) -> None:
        self._signed = description.tach is not None and description.tach.signed
        self._last: tuple[float, float] | None = None
        self._offset_m = 0.0
        self._refused: list[tuple[float, float]] = []

    def sound(self, tables: Mapping[str, Array], report: LossReport) -> dict[str, Array]:
        """The rows that can be used. Distances of the tach are free of its resets."""
        out = dict(tables)
        for name, sigmas in _SIGMAS.items():
            if name in out:
                wrong = (out[name][:, sigmas] <= 0.0).any(axis=1)
                report.lose("bad-sigma", name, out[name][wrong, 0])
                out[name] = out[name][~wrong]
        if "tach" in out and out["tach"].shape[0]:
            out["tach"] = self._tach(out["tach"], report)
        return out

    def _tach(self, rows: Array, report: LossReport) -> Array:
        placed = rows + np.array([0.0, self._offset_m]) if self._offset_m else rows
        chain = placed if self._last is None else np.concatenate([[self._last], placed])
        if not self._refused and self._possible(*np.diff(chain, axis=0).T).all():
            self._last = (float(placed[-1, 0]), float(placed[-1, 1]))
            return placed
        kept, lost = [], []
        for t, counted in rows.tolist():
            if self._last is None or self._follows(self._last, (t, counted + self._offset_m)):
                self._refused = []
            elif not self._taken_up(t, counted, report):
                lost.append(t)
                continue
            self._last = (t, counted + self._offset_m)
            kept.append(self._last)
        report.lose("tach-jump", "tach", np.array(lost))
        return np.array(kept).reshape(-1, 2)

    def _taken_up(self, t: float, counted: float, report: LossReport) -> bool:
        """Whether this row ends a succession that is sound in itself: the count goes on from here."""
        if self._refused and not self._follows(self._refused[-1], (t, counted)):
            self._refused = []
        if self._last is None or len(self._refused) < RESET_ROWS:
            self._refused.append((t, counted))
            return False
        self._offset_m = self._last[1] - self._refused[0][1]
        detail = f"the count goes on from where it stood; up to {self._refused[0][0]:.3f} s nothing was counted"
        report.note(StreamEvent("tach-reset", "tach", self._last[0], t, 0, detail))
        self._refused = []
        return True

    def _follows(self, a: tuple[float, float], b: tuple[float, float]) -> bool:
        return bool(self._possible(np.float64(b[0] - a[0]), np.float64(b[1] - a[1])))

    def _possible(self, seconds: Array | np.float64, metres: Array | np.float64) -> NDArray[np.bool_] | np.bool_:
        limit = FASTEST_MPS * seconds + COARSEST_STEP_M
        return np.abs(metres) <= limit if self._signed else (metres >= 0.0) & (metres <= limit)

    def state(self) -> dict[str, Any]:
        """What carries over to the next batch, as JSON values."""
        return {"last": self._last, "offset_m": self._offset_m, "refused": self._refused}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a :meth:`state`."""
        self._last = None if state["last"] is None else tuple(state["last"])
        self._offset_m = state["offset_m"]
        self._refused = [tuple(row) for row in state["refused"]]
