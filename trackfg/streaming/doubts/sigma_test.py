"""A stream tests its sigmas by comparing smoothed estimates with filtered ones.

The filtered estimate of a moment uses the rows up to it, the smoothed one also those of the lag after it. If the model
is right, they differ by an error of covariance ``P_filtered - P_smoothed`` (Bar-Shalom, Li and Kirubarajan, "Estimation
with applications to tracking and navigation", 2001, ch. 8). Squares of the whitened differences are summed along the
stream, and products of neighbours, whose correlation gives the number of independent differences.

What lasts longer than the lag shows where a fix comes. Its innovation has the variance that was predicted, if the model
is right (ibid., ch. 5), and innovations are independent.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from trackfg.numerics.arrays import Array
from trackfg.numerics.chi_square import exceeds_chance, independent_number
from trackfg.numerics.spans import Span
from trackfg.output.trajectory import QUANTITIES
from trackfg.results.events import Event, doubt_event
from trackfg.results.verdict import Quantity
from trackfg.results.widening import QUANTITY_OF_COLUMN
from trackfg.streaming.checkpoint.snapshot import DERIVED
from trackfg.streaming.events import CHANCE_OF_DOUBT

_LEAST_SHARE = 0.3
"""Least share of the filtered variance that the lag removes. Below it the sigmas are nearly equal, and estimates differ
by their linearisation points as well."""

LEAST_RATIO = 1.3
"""Below this ratio there is no doubt: runs of right sigmas have up to 1.2 (`tools/robustness.py`, clean)."""

_COLUMNS = 1 + 2 * len(QUANTITIES)
"""Columns of a trajectory: the time, and each quantity with its sigma."""

_ALSO: dict[str, tuple[Quantity, ...]] = {"roll": ("cross_level",), "pitch": ("gradient",)}
"""Quantities of the track that are the same angle, and doubted with it."""

_ADVICE = "multiply the sigmas by as much, or smooth the recording"
"""What a user may do where sigmas are too small."""

_LASTING = 0.999
"""Greatest correlation of neighbours that is assumed, so that the number of independent differences stays above 0."""


@dataclass
class SigmaTest:
    """The test keeps sums over the differences of each quantity of a trajectory.

    ``waiting``: filtered rows (17,) that have no smoothed ones yet, ``newest`` (0 or 1, 17) the newest smoothed row;
    ``sums`` (8, 3): the number of whitened differences, the sum of their squares, and that of their products with the
    one before; ``before`` (8,): the last one, NaN at first. ``lost``: between these times, s, filtered rows are of a
    window that was lost, and smoothed ones of the next, whose frame is another without GNSS.
    """

    waiting: list[Array] = field(default_factory=list)
    newest: Array = field(default_factory=lambda: np.zeros((0, _COLUMNS)))
    sums: Array = field(default_factory=lambda: np.zeros((len(QUANTITIES), 3)))
    before: Array = field(default_factory=lambda: np.full(len(QUANTITIES), np.nan))
    lost: Span = (np.inf, np.inf)
    _doubted: dict[str, bool] = field(default_factory=dict, metadata=DERIVED)
    """What :meth:`doubts` has reported of these sums, by column: it is asked with every batch of rows."""

    def expect(self, filtered: Array) -> None:
        """Take the next filtered row (17,), whose columns are those of a trajectory; smoothed ones come later."""
        self.waiting.append(filtered)

    def put(self, smoothed: pd.DataFrame) -> None:
        """Take the next smoothed rows, whose columns are those of a trajectory."""
        if not len(smoothed):
            return
        rows = np.concatenate([self.newest, smoothed.to_numpy(dtype=np.float64)])
        self.newest = rows[-1:].copy()
        waiting = np.array(self.waiting).reshape(-1, _COLUMNS)
        t, first, last = waiting[:, 0], rows[0, 0], rows[-1, 0]
        matched = waiting[(t >= first) & (t <= last) & ((t <= self.lost[0]) | (t >= self.lost[1]))]
        self.waiting = self.waiting[np.searchsorted(t, last, side="right") :]
        self._doubted = {}
        for i in range(len(QUANTITIES)):
            self._add(i, _in_sigmas(matched, rows, 1 + 2 * i, is_angle=QUANTITIES[i].endswith("_rad")))

    def events(self, until_s: float, *, positions: bool) -> tuple[Event, ...]:
        """Return an event for each quantity whose sigmas are too small beyond chance, known at the end of a stream.

        The lag hardly changes the chainage. It is doubted with what it follows: with ``positions``, if the stream has
        any, else with the speed.
        """
        worst: dict[Quantity, float] = {}
        for i, column in enumerate(QUANTITIES):
            ratio = self._ratio(i)
            quantity = QUANTITY_OF_COLUMN[column]
            if ratio >= max(LEAST_RATIO, worst.get(quantity, 0.0)):
                worst[quantity] = ratio
        followed: Quantity = "position" if positions else "speed"
        also = _ALSO | {followed: ("chainage",)}
        return tuple(_doubt((of, *also.get(of, ())), ratio, until_s) for of, ratio in worst.items())

    def doubts(self, column: str) -> bool:
        """Return whether the sigmas of a column of the trajectory are too small beyond chance so far."""
        if column not in self._doubted:
            self._doubted[column] = self._ratio(QUANTITIES.index(column)) >= LEAST_RATIO
        return self._doubted[column]

    def _add(self, i: int, z: Array) -> None:
        if not z.size:
            return
        chain = np.concatenate([[self.before[i]], z])
        self.sums[i] += [z.size, np.sum(z**2), np.nansum(chain[1:] * chain[:-1])]
        self.before[i] = z[-1]

    def _ratio(self, i: int) -> float:
        """Return the rms difference in sigmas; 1 where it is no more than chance."""
        number, squares, products = self.sums[i]
        if number < 2.0 or squares <= 0.0:
            return 1.0
        correlation = min(max(products / squares, 0.0), _LASTING)
        degrees = independent_number(number, correlation)
        mean = squares / number
        return float(np.sqrt(mean)) if exceeds_chance(mean, degrees, CHANCE_OF_DOUBT) else 1.0


def fix_doubts(number: int, squares: float, until_s: float) -> tuple[Event, ...]:
    """Return an event if fixes are further from the predicted chainage than chance allows.

    ``squares``: the sum of the squares of ``number`` innovations, each in its own variances. The event is known at the
    end of a stream, ``until_s``.
    """
    mean = squares / max(number, 1)
    if mean < LEAST_RATIO**2 or not exceeds_chance(mean, number, CHANCE_OF_DOUBT):
        return ()
    reason = f"fixes are {np.sqrt(mean):.1f} times as far from where they were expected as sigmas allow"
    return (doubt_event(("chainage", "speed"), reason, _ADVICE, t_s=until_s),)


def _doubt(quantities: tuple[Quantity, ...], ratio: float, until_s: float) -> Event:
    reason = f"smoothed and filtered estimates differ by {ratio:.1f} times what their sigmas allow"
    return doubt_event(quantities, reason, _ADVICE, t_s=until_s)


def _in_sigmas(filtered: Array, smoothed: Array, column: int, *, is_angle: bool) -> Array:
    """Return whitened differences, of the rows whose variance the lag reduced enough."""
    t = filtered[:, 0]
    values = np.unwrap(smoothed[:, column]) if is_angle else smoothed[:, column]
    difference = filtered[:, column] - np.interp(t, smoothed[:, 0], values)
    if is_angle:
        difference = np.angle(np.exp(1j * difference))
    of_filtered = filtered[:, column + 1] ** 2
    variance = of_filtered - np.interp(t, smoothed[:, 0], smoothed[:, column + 1]) ** 2
    known = variance > _LEAST_SHARE * of_filtered
    variance += _between_rows(t, smoothed[:, 0], values)
    return np.asarray(difference[known] / np.sqrt(variance[known]))


def _between_rows(t: Array, times: Array, values: Array) -> Array:
    """Return the variance of ``values`` that are interpolated at ``t``, (n,), between rows at ``times``, (r,).

    A row is as far from the mean of its neighbours as the middle between two rows is from theirs where the values are
    rough, as the pitch of a sensor that follows the rails is at speed; where they are smooth, four times as far.
    """
    if len(times) < 3:
        return np.zeros(len(t))
    middle = float(np.mean(np.diff(values, 2) ** 2)) / 4.0
    place = np.interp(t, times, np.arange(len(times)))
    share = place % 1.0
    return np.asarray(middle * (4.0 * share * (1.0 - share)) ** 2)
