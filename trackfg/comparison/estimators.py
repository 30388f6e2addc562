"""Every estimator by name: the smoother, the published systems, and other packages where they are installed.

An estimator takes a recording and gives the smoother's tables, as far as it knows them. One that cannot use a recording
(no tachometer, no lasers) says so by a :class:`~trackfg.errors.TrackfgError`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import get_args

import numpy as np

from trackfg.baselines import (
    adaptive_ekf,
    complementary,
    composite_positioning,
    dead_reckoning,
    mid_chord,
    odometry_imm,
)
from trackfg.baselines.result import BASELINE_FOLDER, GNSS_CLOCK, BaselineResult
from trackfg.comparison.table import Task
from trackfg.errors import BadInputError, expected_one_of
from trackfg.peers import python_ins, vqf_offline
from trackfg.peers.installed import is_installed
from trackfg.recording.model import Recording
from trackfg.smoothing.smoother import smooth

SMOOTHER = "smoother"

Run = Callable[[Recording], BaselineResult]


@dataclass(frozen=True)
class Estimator:
    """An estimator takes a recording, and gives the tables of a result as far as it knows them.

    Attributes
    ----------
    title, source
        What it is and where it was published, in a line.
    run
        The estimator: from a :class:`~trackfg.Recording` to a :class:`~trackfg.baselines.result.BaselineResult`.
    tasks
        What it is for, and judged by.
    anchored
        Whether its chainage is that of the line where the recording has fixes; others count from anywhere.
    printed
        The same with the equations as the paper prints them, where they differ.

    Examples
    --------
    >>> import trackfg
    >>> from trackfg.baselines import dead_reckoning
    >>> from trackfg.comparison import Estimator
    >>> mine = Estimator("wheel and gyro", "own", dead_reckoning.run, ("distance and position",))
    >>> mine.run(trackfg.read_recording("run1")).trajectory.columns[:2].tolist()
    ['t_s', 'chainage_m']
    """

    title: str
    source: str
    run: Run
    tasks: tuple[Task, ...]
    anchored: bool = False
    printed: Run | None = None


_ATTITUDE: tuple[Task, ...] = ("attitude and cross-level", "twist")
_VERSINES: tuple[Task, ...] = ("versines",)
_PLACE: tuple[Task, ...] = ("distance and position",)

_GROVES = "Groves (2013), the floor"
_NAGANUMA = "Naganuma and Uematsu, complementary filter"
_KATO = "Kato and others, patent JP7628028B2"
_SUTO = "Suto, Tsubokawa and Yoshida (2020)"
_IWATA = "Iwata, Yamamichi, Sugiyama and Kitano"
MIYATA = "Miyata and Tsunashima, IMM-EKF"


def estimators(*, peers: bool = True) -> dict[str, Estimator]:
    """Return the estimators of a recording, the smoother first; other packages (``peers``) where they are installed."""
    attitude = partial(_printable, _ATTITUDE)
    catalogue = {
        SMOOTHER: Estimator("factor-graph smoother", "trackfg", _smoothed, get_args(Task), anchored=True),
        "dead-reckoning": Estimator(
            "gyro bias from rests, wheel, tilt", _GROVES, dead_reckoning.run, (*_ATTITUDE[:1], *_PLACE), anchored=True
        ),
        "complementary": attitude("complementary filter, T = 12.5 s", _NAGANUMA, complementary.run),
        "accelerometer": attitude(
            "accelerometer alone, low-passed at 0.5 Hz", _NAGANUMA, complementary.run, method="accelerometer"
        ),
        "gyro": attitude("gyro alone, less its straight line", _NAGANUMA, complementary.run, method="gyro"),
        "adaptive-ekf": attitude("extended Kalman filter, R by vibration", _KATO, adaptive_ekf.run),
        "fixed-ekf": attitude("extended Kalman filter, R fixed", _KATO, adaptive_ekf.run, adaptive=False),
        "mid-chord": _mid_chord("mixed waveform, the developed method", "developed"),
        "mid-chord-conventional": _mid_chord("difference below 30 km/h, inertial above 45", "conventional"),
        "mid-chord-inertial": _mid_chord("inertial mid-chord offset", "inertial"),
        "mid-chord-difference": _mid_chord("difference method", "difference"),
        "composite": _printable(
            _PLACE, "composite positioning, slips replaced", _IWATA, composite_positioning.run, anchored=True
        ),
        "imm-odometry": Estimator(
            "IMM over adhesion, slip, slide, standstill", f"after {MIYATA}", odometry_imm.run, _PLACE
        ),
    }
    if peers and is_installed("vqf"):
        catalogue["vqf"] = Estimator(
            "offline VQF, acceleration of the wheel taken out", "vqf", vqf_offline.run, _ATTITUDE
        )
    if peers and is_installed("python-ins"):
        catalogue["python-ins"] = Estimator("feedback EKF", "python-ins", python_ins.run, (*_ATTITUDE, *_PLACE))
    return catalogue


_WITHIN = 0.5
"""Least share of a trajectory's rows within the recording: other sensors may begin before the inertial one, or last."""


def with_own(known: Mapping[str, Estimator], own: Mapping[str, Estimator]) -> dict[str, Estimator]:
    """Return estimators and a user's own ones.

    Raises :class:`BadInputError` where these have the name of another or an unknown task, and ``TypeError`` for what is
    no estimator, or, when it is run, gives no result.
    """
    if taken := sorted(known.keys() & own.keys()):
        raise BadInputError(f"estimator {taken[0]!r}: the name is taken; expected another name for one of your own")
    for name, addition in own.items():
        if not isinstance(addition, Estimator):
            raise TypeError(
                f"estimator {name!r}: expected a trackfg.comparison.Estimator, not {type(addition).__name__}"
            )
        known_tasks: tuple[str, ...] = get_args(Task)
        if wrong := [addition.tasks] if isinstance(addition.tasks, str) else sorted({*addition.tasks} - {*known_tasks}):
            expected = f"expected a tuple of {', '.join(map(repr, known_tasks))}"
            raise BadInputError(f"estimator {name!r}: tasks {wrong[0]!r}; {expected}")
    return {**known, **{name: replace(one, run=partial(_own_result, name, one.run)) for name, one in own.items()}}


def _own_result(name: str, run: Run, recording: Recording) -> BaselineResult:
    result = run(_with_own_tables(recording))
    if not isinstance(result, BaselineResult):
        given = type(result).__name__
        raise TypeError(f"estimator {name!r}: expected a trackfg.baselines.result.BaselineResult, not {given}")
    clock = recording.imu["t_s"].to_numpy()
    _refuse_unusable(name, result, (float(clock[0]), float(clock[-1])))
    return result


def _with_own_tables(recording: Recording) -> Recording:
    """Return the recording with copies of its tables: others get what was measured, whatever becomes of these."""
    copied = recording.with_tables({name: table.copy() for name, table in recording.tables.items()})
    return replace(copied, balises=None if recording.balises is None else recording.balises.copy())


def _refuse_unusable(name: str, result: BaselineResult, ends_s: tuple[float, float]) -> None:
    """Raise :class:`BadInputError` where tables have the right columns but nothing that can be scored over time."""
    table, (first_s, last_s) = result.trajectory, ends_s
    if not table.drop(columns="t_s").notna().to_numpy().any():
        missing = "when it was where: chainage_m in its trajectory" if len(result.geometry) else "a value in its tables"
        raise BadInputError(f"estimator {name!r}: expected {missing}; found none")
    t = table["t_s"].to_numpy(dtype=np.float64)
    late = np.flatnonzero(~(np.diff(t) > 0.0))
    if late.size:
        row = int(late[0]) + 2
        raise BadInputError(f"estimator {name!r}: t_s of its trajectory, row {row}: expected times that grow")
    if np.count_nonzero((t >= first_s) & (t <= last_s)) < _WITHIN * t.size:
        raise BadInputError(
            f"estimator {name!r}: its trajectory is from {t[0]:g} to {t[-1]:g} s; expected seconds of the recording's "
            f"clock, {first_s:g} to {last_s:g} s"
        )


def estimator(name: str, *, as_printed: bool = False) -> Run:
    """Return the estimator of this name. Raises :class:`BadInputError` for a name that is not there, and where nothing
    printed differs from it.
    """
    catalogue = estimators()
    if name not in catalogue:
        raise BadInputError(f"no estimator {name!r}; {expected_one_of(catalogue, name)}")
    if not as_printed:
        return catalogue[name].run
    printed = catalogue[name].printed
    if printed is None:
        raise BadInputError(f"{name}: its paper prints nothing that differs from what is built")
    return printed


def _printable(
    tasks: tuple[Task, ...],
    title: str,
    source: str,
    run: Callable[..., BaselineResult],
    *,
    anchored: bool = False,
    **options: object,
) -> Estimator:
    corrected: Run = partial(run, **options)
    return Estimator(title, source, corrected, tasks, anchored, printed=partial(run, **options, as_printed=True))


def _mid_chord(title: str, method: mid_chord.Method) -> Estimator:
    return Estimator(title, _SUTO, partial(mid_chord.run, method=method), _VERSINES)


def _smoothed(recording: Recording) -> BaselineResult:
    result = smooth(recording)
    parameters: dict[str, float | str | bool] = {"converged": result.summary.converged}
    if (clock := result.summary.gnss_clock_offset_s) is not None:
        parameters[GNSS_CLOCK] = clock.value
    return BaselineResult(SMOOTHER, result.trajectory, result.geometry, result.events, parameters)


def refuse_foreign(folder: Path) -> None:
    """Raise :class:`BadInputError` where a folder holds anything but what an estimator wrote."""
    BASELINE_FOLDER.refuse_foreign(folder)
