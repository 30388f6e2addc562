"""Distance and speed from tachometer and accelerometer by an IMM filter: adhesion, slip, slide, standstill.

The railway's counterpart of the road friction's IMM-EKF (:mod:`trackfg.friction.imm_ekf`): the modes are what
the measured wheel does. State, stepped by ``dt``:

    s distance, m                       b bias of the accelerometer, m/s^2: gravity on gradients is in it
    v speed, m/s                        c creep speed, m/s: by how much the wheel's rim outruns the vehicle
    a acceleration, m/s^2               w distance that the wheel has rolled, m

In every mode but standstill

    s' = s + v dt + a dt^2/2      v' = v + a dt      a' = a + j      b' = b + N(0, bias_walk^2 dt)

with the jerk's integral ``j ~ N(0, jerk_sd^2 dt)``, of which v' gets ``j dt/2`` and s' ``j dt^2/6`` too. The modes
differ in the creep; e ~ N(0, 1), ``m`` is the mean creep speed of a slip, ``k = exp(-dt/creep_time)``:

    adhesion     c' = adhesion_creep_sd e                       w' = w + (s' - s) + c' dt
    slip         c' = k c + (1 - k) m + m sqrt(1 - k^2) e       w' = w + (s' - s) + (c + c') dt/2
    slide        c' = k c - (1 - k) m + m sqrt(1 - k^2) e       w' = w + (s' - s) + (c + c') dt/2
    standstill   s' = s,  v' = a' = c' = 0,  w' = w             b as above

so that in a slip the tach says next to nothing of the speed, and the accelerometer carries it. Measured are

    W = w + N(0, rounding^2)      f = a + b + N(0, accel_sd^2)

the tach's count at nominal scale and the mean forward specific force over a step around its time. The equations are
linear: the extended Kalman filter of them is a Kalman filter. The modes follow each other at constant rates; how long
each lasts in the mean is a parameter, and a slip does not turn into a slide.

A filter decides as it goes. A slip that begins so gently that adhesion explains it has raised speed and bias by the
time the wheel catches again; that looks like a slide then, and may be held for one until the vehicle stops.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
import pandas as pd

from trackfg.baselines.attitude import required_wheel
from trackfg.baselines.result import BaselineResult, filled
from trackfg.numerics.arrays import Array
from trackfg.numerics.imm import Modes, ModeSteps, interacting_multiple_models, measured
from trackfg.numerics.spans import true_runs
from trackfg.recording.model import Recording
from trackfg.results.columns import EVENT_COLUMNS, TRAJECTORY_COLUMNS
from trackfg.sensors.imu_intervals import intervals, means_around
from trackfg.sensors.tach import Wheel

MODES = ("adhesion", "slip", "slide", "standstill")
_S, _V, _A, _B, _C, _W = range(6)
"""Places of the states in x, in the order of the module's docstring."""
_STILL_SD = 1e-4
"""m, m/s, m/s^2: what a vehicle at rest still moves, lest a covariance become singular."""
_LONGEST_GAP_S = 0.5
"""A longer silence of the tachometer while moving is a gap, s: five steps of the filter. Chosen here."""
_NO_READING_SD = 1e4
"""1-sigma of the count inside a gap, m: as good as none."""


@dataclass(frozen=True)
class OdometryParameters:
    """Densities are per square root of a second; ``mean_*_s`` are how long a mode lasts."""

    step_s: float = 0.1
    window_s: float = 0.6
    jerk_sd: float = 0.5
    bias_walk: float = 0.04
    bias_sd: float = 0.3
    accel_sd: float = 0.1
    adhesion_creep_sd: float = 0.05
    creep_mps: float = 2.0
    creep_time_s: float = 1.0
    mean_adhesion_s: float = 60.0
    mean_slip_s: float = 4.0
    mean_standstill_s: float = 30.0


def run(recording: Recording) -> BaselineResult:
    """Estimate chainage, speed and events of the run, one row per step.

    Chainage is 0 at the start and grows or falls with the track's direction; the wheel has its nominal scale, and
    positions are not used. Sigmas are those of the filter, which knows nothing of the scale's error. Raises
    :class:`~trackfg.errors.BadInputError` without a tachometer.
    """
    p = OdometryParameters()
    wheel, data = required_wheel(recording, _LONGEST_GAP_S), intervals(recording)
    t = np.arange(data.edges[0], data.edges[-1], p.step_s)
    force = means_around(t, p.step_s, data.edges, data.accel)[:, 0]
    modes = _filter(t, wheel, force, p)
    direction = recording.description.track.direction
    sd = np.sqrt(np.diagonal(modes.covariance, axis1=1, axis2=2))
    columns = {
        "t_s": t,
        "chainage_m": direction * modes.state[:, _S],
        "chainage_m_sd": sd[:, _S],
        "speed_mps": modes.state[:, _V],
        "speed_mps_sd": sd[:, _V],
    }
    return BaselineResult(
        name="IMM odometry",
        trajectory=filled(TRAJECTORY_COLUMNS, columns),
        events=_events(t, modes, direction),
        parameters=asdict(p),
    )


def _filter(t: Array, wheel: Wheel, force: Array, p: OdometryParameters) -> Modes:
    rolled = wheel.at(t) - wheel.at(t[:1])
    F, mean, Q = _dynamics(p)
    H = np.zeros((2, 6))
    H[0, _W] = H[1, _A] = H[1, _B] = 1.0
    reading_sd = np.where(wheel.covers(t), wheel.rounding_sd, _NO_READING_SD)
    y = np.column_stack([rolled, force])
    R = np.zeros((len(t), 2, 2))
    R[:, 0, 0], R[:, 1, 1] = reading_sd**2, p.accel_sd**2
    observes = np.broadcast_to(H, (len(MODES), 2, 6))

    def step(k: int, x: Array, P: Array) -> ModeSteps:
        predicted = (F @ x[..., None])[..., 0] + mean
        spread = F @ P @ F.swapaxes(1, 2) + Q
        return measured(predicted, spread, y[k] - predicted @ H.T, observes, R[k])

    start = np.zeros(6)
    start[_V] = wheel.rate(t[:1])[0]
    start_sd = np.array([_STILL_SD, 1.0, 1.0, p.bias_sd, p.adhesion_creep_sd, wheel.rounding_sd])
    return interacting_multiple_models(
        step,
        state=np.tile(start, (len(MODES), 1)),
        covariance=np.tile(np.diag(start_sd**2), (len(MODES), 1, 1)),
        probability=np.full(len(MODES), 1.0 / len(MODES)),
        transition=_transition(p),
        steps=len(t) - 1,
        window=max(1, round(p.window_s / p.step_s)),
    )


def _dynamics(p: OdometryParameters) -> tuple[Array, Array, Array]:
    """Return ``x' = F x + mean + N(0, Q)`` of each mode: (4, 6, 6), (4, 6), (4, 6, 6)."""
    dt = p.step_s
    moving = np.eye(6)
    moving[_S, [_V, _A]] = moving[_W, [_V, _A]] = dt, 0.5 * dt**2
    moving[_V, _A] = dt
    moving[_C, _C] = 0.0
    # White jerk over a step moves the acceleration, the speed and both distances together.
    by_jerk = np.zeros(6)
    by_jerk[[_S, _V, _A, _W]] = dt**2 / 6.0, dt / 2.0, 1.0, dt**2 / 6.0
    noise = p.jerk_sd**2 * dt * np.outer(by_jerk, by_jerk)
    noise[_B, _B] += p.bias_walk**2 * dt

    def creeping(kept: float, mean: float, sd: float, of_new: float) -> tuple[Array, Array, Array]:
        """Return ``c' = kept c + (1 - kept) mean + sd e``; w gains ``(1 - of_new) c dt + of_new c' dt``."""
        to_w = of_new * dt
        F, offset, Q = moving.copy(), np.zeros(6), noise.copy()
        F[_C, _C] = kept
        F[_W, _C] = (1.0 - of_new) * dt + to_w * kept
        offset[[_C, _W]] = (1.0 - kept) * mean * np.array([1.0, to_w])
        by_creep = np.zeros(6)
        by_creep[[_C, _W]] = 1.0, to_w
        return F, offset, Q + sd**2 * np.outer(by_creep, by_creep)

    kept = float(np.exp(-dt / p.creep_time_s))
    swing = p.creep_mps * float(np.sqrt(1.0 - kept**2))
    adhesion = creeping(0.0, 0.0, p.adhesion_creep_sd, 1.0)
    # Under adhesion the creep before does not count: the wheel has caught again.
    adhesion[0][_W, _C] = 0.0
    slip, slide = (creeping(kept, sign * p.creep_mps, swing, 0.5) for sign in (1.0, -1.0))
    still = np.zeros((6, 6))
    still[[_S, _B, _W], [_S, _B, _W]] = 1.0
    rest = _STILL_SD**2 * np.eye(6)
    rest[_B, _B] = p.bias_walk**2 * dt
    F, offset, Q = (np.stack(part) for part in zip(adhesion, slip, slide, (still, np.zeros(6), rest), strict=True))
    return F, offset, Q


def _transition(p: OdometryParameters) -> Array:
    """Return ``p_ij`` over a step, rows and columns in the order of :data:`MODES`."""
    leaves_adhesion, leaves_slip, leaves_rest = (
        p.step_s / mean for mean in (p.mean_adhesion_s, p.mean_slip_s, p.mean_standstill_s)
    )
    to = np.array(
        [
            [0.0, 1 / 3, 1 / 3, 1 / 3],
            [0.99, 0.0, 0.0, 0.01],
            [0.99, 0.0, 0.0, 0.01],
            [0.98, 0.01, 0.01, 0.0],
        ]
    )
    leaves = np.array([leaves_adhesion, leaves_slip, leaves_slip, leaves_rest])
    return np.asarray(np.diag(1.0 - leaves) + leaves[:, None] * to)


def _events(t: Array, modes: Modes, direction: int) -> pd.DataFrame:
    """Return spans in which wheel slip (or slide, or standstill) is likelier than not."""
    probability, state = modes.probability, modes.state
    slipping = probability[:, 1] + probability[:, 2]
    rows = []
    for i, j in true_runs(slipping > 0.5):
        first, last = max(i - 1, 0), j - 1
        kind = "slip" if probability[i:j, 1].sum() > probability[i:j, 2].sum() else "slide"
        gained = state[last] - state[first]
        rows.append((kind, first, last, float(gained[_W] - gained[_S])))
    rows += [("standstill", i, j - 1, np.nan) for i, j in true_runs(probability[:, 3] > 0.5)]
    sd = np.sqrt(modes.covariance[:, _S, _S])
    table = [
        (kind, t[i], t[j], direction * state[i, _S], sd[i], removed, np.nan, "")
        for kind, i, j, removed in sorted(rows, key=lambda row: row[1])
    ]
    return pd.DataFrame(table, columns=list(EVENT_COLUMNS))
