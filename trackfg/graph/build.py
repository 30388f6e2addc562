"""A recording becomes a factor graph with initial values.

==================  =============================================================================================
native factors      inertial factors, GTSAM's own
families            priors, bias walk, distance chain, tach, arc length, path, non-holonomic, standstill, fixes, GNSS
==================  =============================================================================================

Each accelerometer sample is counted once: it is in the inertial factors, and no gravity factor uses it again. A
recording in which nothing measures speed (no tach, no GNSS) is the exception: there the inertial factors' accelerometer
gets no weight and gravity tilt factors carry the samples instead, with a sigma that covers the unknown accelerations.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from trackfg.config import KeyframeConfig, SmoothConfig
from trackfg.errors import UnsolvableError
from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, changed, family_of
from trackfg.factors.imu import InertialFactors, Preintegration
from trackfg.factors.states import Kind, Odo, States
from trackfg.graph.errors import factor_errors
from trackfg.graph.further_sensors import (
    further_distances,
    further_sensors,
    measures_speed,
    with_distance_by_speed,
)
from trackfg.graph.gtsam_export import GtsamProblem, exported
from trackfg.graph.inertial import own_bias_walk, preintegrated, tilt
from trackfg.graph.inputs import GraphInputs, World, world_of
from trackfg.graph.keyframes import place_keyframes
from trackfg.graph.miscount import with_miscount
from trackfg.graph.motion import motion
from trackfg.graph.odometry import odometer
from trackfg.graph.positions import positions
from trackfg.graph.priors import SET_SD_M, imu_grade, priors
from trackfg.graph.run_context import RunContext, geometry_conventions
from trackfg.graph.wheel_slip import Rolling, rolling
from trackfg.numerics.arrays import Array
from trackfg.numerics.key_figures import KeyFigures
from trackfg.numerics.spans import nearest, union, within
from trackfg.recording.model import Recording, refuse_other_than_recording
from trackfg.sensors.dead_reckoning import InitialPath, initial_path
from trackfg.sensors.imu_intervals import Intervals, intervals
from trackfg.sensors.imu_noise.noise_floor import NoiseFloor
from trackfg.sensors.speed_noise import speed_noise
from trackfg.sensors.standstills import counted_standstills, find_standstills
from trackfg.sensors.tach import Wheel, read_wheel
from trackfg.sensors.tach_steps import at_steps

if TYPE_CHECKING:
    import gtsam


@dataclass(frozen=True, repr=False)
class Problem(KeyFigures):
    """A problem is a graph to be solved, and what is needed to interpret the solution.

    docs/graph.md shows how to look into it, add to it, and take it to GTSAM.

    Examples
    --------
    >>> import trackfg
    >>> from trackfg.graph import build_problem
    >>> problem = build_problem(trackfg.read_recording("run1"), trackfg.SmoothConfig())
    >>> len(problem.t)  # keyframes
    38
    >>> problem.errors(problem.initial).columns.tolist()
    ['factor', 'first_s', 'last_s', 'sigmas', 'weight', 'error']
    """

    run: RunContext
    measured: tuple[Preintegration, ...]
    """By the inertial sensor, one per interval."""
    families: tuple[Family, ...]
    initial: States
    rests: Array
    """Spans in which the vehicle stands, s, shape (r, 2)."""
    gaps: Array
    """Holes of the inertial record, s, shape (g, 2)."""
    wheel: Wheel | None
    clock_origin: float
    """When the offsets of other clocks are what the states say, s: before and after, they drift."""
    response: Array
    """The derivative of each keyframe's bias by the IMU's calibration, shape (n, 6, dim)."""
    imu_grade: Array = field(default_factory=lambda: np.ones(Kind.IMU.dim))
    """How many times worse than declared each calibration of the inertial sensor is assumed to be, by the size of the
    biases, shape (dim,)."""
    withheld: tuple[Family, ...] = ()
    """Measurements that are taken for wrong: no part of the graph, but their residuals are reported."""
    gnss_level: Mapping[FactorType, Array] = field(default_factory=dict)
    """Level of the errors of GNSS that its sigmas were widened for, over the declared ones, by type, shape (m, d)."""

    def key_figures(self) -> dict[str, str]:
        """Return the number of keyframes, the time that they span, and the number of factors of each type."""
        counts = Counter({"inertial": len(self.measured)})
        for family in self.families:
            counts[family.name] += len(family)
        figures = {"problem": f"{len(self.t)} keyframes", "length": f"{np.ptp(self.t):.1f} s"}
        return figures | {name: f"{count} {name}" for name, count in counts.items()}

    @property
    def t(self) -> Array:
        """Keyframe times, s, shape (n,)."""
        return self.run.t

    @cached_property
    def inertial(self) -> InertialFactors:
        """The inertial factors."""
        return InertialFactors.of(self.measured)

    @property
    def native(self) -> gtsam.NonlinearFactorGraph:
        """The inertial factors as GTSAM's own."""
        return self.inertial.graph

    def family(self, kind: FactorType) -> Family | None:
        """Return the first family of that type; None where the graph has none."""
        return family_of(self.families, kind)

    def with_family(self, family: Family) -> Problem:
        """Return the problem with one more family of factors, besides any of the same type.

        Raises ``IndexError`` where the family touches variables that the problem does not have.
        """
        for slot in family.slots:
            count, index = len(self.initial.of(slot.kind)), np.asarray(slot.index)
            if index.size and not (index.dtype.kind in "iu" and index.min() >= 0 and index.max() < count):
                numbers = f"whole numbers from 0 to {count - 1}" if count else "no factor of that kind"
                given = f"{index.min()} to {index.max()}"
                raise IndexError(f"{family.name}: touches {slot.kind.name} {given}; expected {numbers}")
        return replace(self, families=(*self.families, family))

    def to_gtsam(self, states: States | None = None) -> GtsamProblem:
        """Return the whole graph as GTSAM's own objects, with values at ``states``, by default the initial ones.

        Factors of a chained loss (the tach's) get the weights that they have at ``states``: at the solution the graph
        has its minimum there, from elsewhere the weights have to be renewed by another export.
        """
        return exported(self.native, self.families, self.initial if states is None else _checked(states), self.t)

    def errors(self, states: States) -> pd.DataFrame:
        """Return how well each factor fits ``states``: one row per factor, in the order of :meth:`to_gtsam`'s graph.

        Columns: ``factor``, its type or label; ``first_s`` and ``last_s``, the times of the first and the last
        keyframe that it touches, s, NaN for a factor on shared variables alone; ``sigmas``, the norm of its whitened
        residual; ``weight``, what its loss leaves of it, 1 without a loss; ``error``, its part of the cost. For a
        chained loss, whose cost is that of the whole chain, ``error`` is ``weight sigmas^2 / 2``.
        """
        return factor_errors(self.inertial, self.families, _checked(states), self.t)


def _checked(states: States) -> States:
    """Return the states. Raises ``TypeError`` for anything else, such as the solution that has them."""
    if not isinstance(states, States):
        raise TypeError(f"expected states, such as solution.states, not {type(states).__name__}")
    return states


def build_problem(
    recording: Recording, config: SmoothConfig, data: Intervals | None = None, *, steps: bool = True
) -> Problem:
    """Build the factor graph of a recording, with initial values.

    Parameters
    ----------
    recording : Recording
        What :func:`trackfg.read_recording` returns, or the ``recording`` of a simulation.
    config : SmoothConfig
        The settings; ``SmoothConfig()`` has the defaults.
    data : Intervals, optional
        The inertial samples laid edge to edge, if that has been done already.
    steps : bool, optional
        Whether a coarse tach is read at its steps. A stream, which goes on with rows as they come, reads its rows.

    Returns
    -------
    Problem
        Keyframes, factors and initial values, for :func:`trackfg.solver.solve` or :meth:`Problem.to_gtsam`.

    Raises
    ------
    UnsolvableError
        For a run too short to hold a graph.
    TypeError
        For anything but a recording: a path, say, or a simulation, which has one.

    Examples
    --------
    >>> import trackfg
    >>> from trackfg.graph import build_problem
    >>> problem = build_problem(trackfg.read_recording("run1"), trackfg.SmoothConfig())
    >>> len(problem.errors(problem.initial)) > 100  # factors
    True
    """
    refuse_other_than_recording(recording, "build_problem")
    data = data or intervals(recording)
    if len(data) < 10 or data.edges[-1] - data.edges[0] < 0.5:
        raise too_short(recording, data.edges[-1] - data.edges[0])
    inputs = _inputs(recording, config, data, steps=steps)
    speedless = _is_speedless(recording, inputs.wheel)
    sensors = np.zeros((len(further_sensors(recording.description)), Kind.SENSOR.dim))
    states = replace(inputs.initial_states(), sensor=sensors)
    families = [
        *priors(inputs, states),
        own_bias_walk(inputs),
        *odometer(inputs),
        *([tilt(inputs)] if speedless else motion(inputs)),
        *positions(inputs),
        *further_distances(inputs),
    ]
    return Problem(
        run=_run_context(inputs),
        measured=preintegrated(inputs, states, speedless),
        families=tuple(family for family in families if len(family)),
        initial=states,
        rests=inputs.rests,
        gaps=data.gaps(),
        wheel=inputs.wheel,
        clock_origin=inputs.clock_origin,
        response=inputs.response,
        imu_grade=imu_grade(inputs.path, recording.description.imu.noise),
    )


def _inputs(recording: Recording, config: SmoothConfig, data: Intervals, *, steps: bool) -> GraphInputs:
    """Return what the factors of a recording are made from: rests, a first guess of the motion, and keyframes."""
    world = world_of(recording)
    wheel = read_wheel(recording, config.tach.max_gap_s)
    if wheel is not None and steps:
        wheel = _with_noise(at_steps(wheel), data, world.gravity, config)
    floor = NoiseFloor.of(data)
    rests, path, rolls, wheel = _first_pass(recording, config, world, data, floor, wheel)
    required = _required_times(recording, data.gaps(), rests)
    edges = place_keyframes(data.edges, path.t, path.speed, rests, required, _spacing(recording, config))
    t = data.edges[edges]
    return GraphInputs(
        recording=recording,
        config=config,
        world=world,
        data=data,
        floor=floor.with_rests(data, rests),
        wheel=wheel,
        rests=rests,
        path=path,
        rolling=rolls,
        edges=edges,
        t=t,
        clock_origin=0.5 * (t[0] + t[-1]),
    )


def _is_speedless(recording: Recording, wheel: Wheel | None) -> bool:
    """Return whether nothing in a recording measures the speed."""
    return wheel is None and recording.gnss is None and not measures_speed(recording)


def _run_context(inputs: GraphInputs) -> RunContext:
    description = inputs.recording.description
    return RunContext(
        t=inputs.t,
        edges=inputs.edges,
        inertial=inputs.data,
        world=inputs.world,
        lever_arm=inputs.lever_arm,
        noise=inputs.noise,
        mount_roll_sd=np.radians(description.imu.mount_roll_sd_deg),
        direction=description.track.direction,
        conventions=geometry_conventions(inputs.config.geometry, description.track),
    )


def too_short(recording: Recording, seconds: float) -> UnsolvableError:
    """Return the error of a recording whose IMU has too few samples for a graph, with what was dropped of them."""
    dropped = "".join(f"; {finding.message}" for finding in recording.findings if finding.code == "imu-rows-dropped")
    return UnsolvableError(
        f"the IMU record has {len(recording.imu)} samples over {seconds:.3g} s: "
        f"at least 10 samples and 0.5 s are needed{dropped}"
    )


def _first_pass(
    recording: Recording,
    config: SmoothConfig,
    world: World,
    data: Intervals,
    floor: NoiseFloor,
    wheel: Wheel | None,
) -> tuple[Array, InitialPath, Rolling | None, Wheel | None]:
    """Find rests and initial path, both without the slips, where the wheel rolls, and the wheel without noise in rests.

    Slips spoil the attitude of the initial path, and by it the speed that shows them: where there are any, once more.
    """
    wheel_rolling, guide, quantum = None, wheel, None if wheel is None else wheel.quantum
    speedless, counted = _is_speedless(recording, wheel), np.zeros((0, 2))
    if wheel is None and recording.gnss is None and not speedless:
        recording = with_distance_by_speed(recording)
        guide = read_wheel(recording, config.tach.max_gap_s)
    for attempt in range(3):
        rests = np.zeros((0, 2))
        if not speedless:
            rests = find_standstills(recording, config.motion.min_rest_s, quantum_m=quantum)
        if attempt == 0 and wheel is not None:
            counted, doubtful = counted_standstills(recording, rests, config.tach.clock_offset_sd_s)
            wheel = wheel.with_doubtful(doubtful)
        rests = union(np.concatenate([rests, counted]))
        rests = data.edges[nearest(data.edges, rests.ravel())].reshape(-1, 2)
        rests = rests[rests[:, 1] > rests[:, 0]]  # a tach may go on after the inertial sensor
        wheel = None if wheel is None else wheel.standing(rests)
        rolled = wheel_rolling.wheel.standing(rests) if wheel_rolling is not None else wheel or guide
        path = initial_path(recording, data, rolled, rests, world.earth_rate, world.start_yaw)
        if wheel is None or attempt == 2:
            break
        wheel_rolling = rolling(wheel, data, floor, path, rests, world.gravity, config)
        if wheel_rolling.rolls.all():
            break
        corrected = pd.DataFrame({"t_s": wheel_rolling.wheel.t, "distance_m": wheel_rolling.wheel.distance})
        recording = replace(recording, tach=corrected)
    return rests, path, wheel_rolling, wheel


def _with_noise(wheel: Wheel, data: Intervals, gravity: float, config: SmoothConfig) -> Wheel:
    """Return the wheel with the noise of a speed signal, or the errors of a count, as its rows show them.

    A noise that the settings give stays.
    """
    if not wheel.integrates_speed:
        return with_miscount(wheel, data, gravity, config)
    if config.tach.speed_noise_mps > 0.0:
        return wheel
    noise = speed_noise(wheel, data)
    return wheel if noise is None else wheel.with_speed_noise(noise)


def _spacing(recording: Recording, config: SmoothConfig) -> KeyframeConfig:
    """Return the spacing of keyframes: closer together with lasers, since the rails tie the motion there."""
    wanted, laser = config.keyframes, config.laser
    if not recording.description.laser:
        return wanted
    closer = {
        "interval_s": min(wanted.interval_s, laser.keyframe_interval_s),
        "distance_m": min(wanted.distance_m, laser.keyframe_distance_m),
    }
    return wanted.model_copy(update=closer)


def _required_times(recording: Recording, gaps: Array, rests: Array) -> Array:
    tables = (table for table in (recording.fixes, recording.balises) if table is not None)
    times = [gaps.ravel(), *(table["t_s"].to_numpy() for table in tables)]
    if recording.gnss is not None:
        gnss = recording.gnss["t_s"].to_numpy()
        times.append(gnss[~within(gnss, rests)])
    return np.concatenate(times)


def with_start_at(problem: Problem, distance: float, sd: float) -> Problem:
    """Return the problem with a start ``distance`` m along the track, known to ``sd`` m."""
    shift = distance - float(problem.initial.odo.distance[0])

    def moved(family: Family) -> Family:
        sigma = family.sigma.copy()
        sigma[:, 0] = max(sd, SET_SD_M)
        return replace(family, data={"mean": Odo(family.data["mean"]).moved_along(shift).array}, sigma=sigma)

    initial = replace(problem.initial, odo=problem.initial.odo.moved_along(shift))
    return replace(problem, initial=initial, families=changed(problem.families, FactorType.PRIOR_ODO, moved))
