"""The variables of the graph are held as arrays, and are passed to and from GTSAM.

=========  ====  =================================================================================================
kind       dim   content and tangent
=========  ====  =================================================================================================
``NAV``    9     attitude ``R`` (body to navigation), position ``p`` and velocity ``v`` of the IMU in n; retracted
                 as ``R Exp(d[:3])``, ``p + R d[3:6]``, ``v + R d[6:9]``, the chart of ``gtsam.NavState``
``BIAS``   6     accelerometer bias (m/s^2), then gyro bias (rad/s), as in ``gtsam.imuBias.ConstantBias``
``ODO``    4     along-track distance (m), wheel scale, wheel distance as the tach counts it (m), distance since the
                 previous keyframe (m)
``MOUNT``  5     shared: pitch and yaw of the direction of travel relative to the IMU's forward axis (rad); where the
                 point that follows the track is, from the vehicle reference point, in IMU axes (m)
``IMU``    29    shared: scale factors, misalignments and rectification of the inertial sensor, and the turning of the
                 Earth that it measures, as :mod:`trackfg.factors.bias` says
``CLOCK``  3     shared: what to add to other clocks' times to bring them to the IMU's: the tach's offset (s) in the
                 middle of the run and its drift (s/s), the GNSS receiver's offset (s)
``WHEEL``  5     shared: where the wheel runs in curves, to the left and to the outside of the centre line (m), its
                 creep per force in traction and in braking (share of the distance per g), and by how much a speed
                 signal is too high in motion (m/s), as :func:`trackfg.factors.odometry.tach_distance` says
``SENSOR`` 2     shared, one per further sensor of distance or speed: what its scale is off by (share of the distance),
                 and its clock's offset (s) or the tangent of its mounting's yaw; behind these one for every two balises
                 that are passed again: the distances along the track at which they are (m)
=========  ====  =================================================================================================

Position and velocity of one keyframe are one variable with its attitude, and the odometer's scalars are another: the
cost of elimination counts variables as well as dimensions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cache, cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from trackfg.numerics.arrays import Array
from trackfg.numerics.kernels import compiled_kernels, kernel_argument
from trackfg.numerics.key_figures import Outlined
from trackfg.numerics.rotations import so3_exp, so3_log

if TYPE_CHECKING:
    import gtsam


class Kind(Enum):
    """A kind of variable has a GTSAM symbol and a dimension, and is shared by the whole run or not."""

    NAV = ("n", 9, False)
    BIAS = ("b", 6, False)
    ODO = ("o", 4, False)
    MOUNT = ("m", 5, True)
    CLOCK = ("c", 3, True)
    IMU = ("i", 29, True)
    WHEEL = ("w", 5, True)
    SENSOR = ("s", 2, True)

    __hash__ = object.__hash__  # an Enum's own is a function in Python, and a stream looks kinds up by the thousand

    def __init__(self, letter: str, dim: int, shared: bool) -> None:
        self.letter = letter
        self.dim = dim
        self.shared = shared
        self.attribute = self.name.lower()
        """Of :class:`States`."""

    def keys(self, index: np.ndarray) -> np.ndarray:
        """Return GTSAM keys of variables ``index``, as ``gtsam.symbol`` makes them: the letter in the top byte."""
        return (np.uint64(ord(self.letter)) << np.uint64(56)) | np.asarray(index, dtype=np.uint64)


ELIMINATION_ORDER = (Kind.ODO, Kind.BIAS, Kind.NAV)
"""Within a keyframe: the order measured to be cheapest, the odometer (few neighbours) first."""

KEYFRAME_DIM = sum(kind.dim for kind in ELIMINATION_ORDER)
SHARED = (Kind.MOUNT, Kind.CLOCK, Kind.IMU, Kind.WHEEL)
SHARED_DIM = sum(kind.dim for kind in SHARED)
"""Without further sensors: of these a run has any number, none as a rule. They follow the other shared variables."""


@cache
def offset_in_keyframe(kind: Kind) -> int:
    """Return where ``kind`` starts in the stacked tangent of one keyframe, which the shared variables follow."""
    if kind is Kind.SENSOR:
        return KEYFRAME_DIM + SHARED_DIM
    if kind.shared:
        return KEYFRAME_DIM + sum(k.dim for k in SHARED[: SHARED.index(kind)])
    preceding = ELIMINATION_ORDER[: ELIMINATION_ORDER.index(kind)]
    return sum(k.dim for k in preceding)


@dataclass(frozen=True, repr=False)
class Nav(Outlined):
    """A navigation state has attitudes (m, 3, 3), positions (m, 3) and velocities (m, 3)."""

    R: Array
    p: Array
    v: Array

    def __getitem__(self, index: np.ndarray | slice) -> Nav:
        return Nav(self.R[index], self.p[index], self.v[index])

    def __len__(self) -> int:
        return len(self.R)

    @property
    def own_velocity(self) -> Array:
        """The velocity in the body's axes, m/s, shape (m, 3)."""
        return np.asarray(np.einsum("mji,mj->mi", self.R, self.v))


@dataclass(frozen=True, repr=False)
class Odo(Outlined):
    """The odometer's states are an ``array`` (m, 4), its columns have names."""

    array: Array

    DISTANCE, SCALE, COUNT, STEP = range(4)
    """The columns, as tangents and Jacobians have them too."""

    @classmethod
    def of(cls, distance: Array, scale: Array, count: Array, step: Array) -> Odo:
        """Make the states from their columns, each of shape (m,)."""
        return cls(np.stack([distance, scale, count, step], axis=1))

    def __getitem__(self, index: np.ndarray | slice) -> Odo:
        return Odo(self.array[index])

    def __len__(self) -> int:
        return len(self.array)

    @property
    def distance(self) -> Array:
        """Distance along the track, m, shape (m,)."""
        return self.array[:, self.DISTANCE]

    @property
    def scale(self) -> Array:
        """True distance per distance that the tach counts, shape (m,)."""
        return self.array[:, self.SCALE]

    @property
    def count(self) -> Array:
        """Distance as the tach would count it without rounding, m, shape (m,)."""
        return self.array[:, self.COUNT]

    @property
    def step(self) -> Array:
        """Distance since the previous keyframe, m, shape (m,)."""
        return self.array[:, self.STEP]

    def moved_on(self, way_m: float) -> Odo:
        """Return the states of the next keyframes after ``way_m`` that the wheel counts in full."""
        array = self.array + np.array([way_m, 0.0, way_m, 0.0])
        array[:, self.STEP] = way_m
        return Odo(array)

    def moved_along(self, by_m: float) -> Odo:
        """Return the states with ``by_m`` added to the distance along the track."""
        return Odo(self.array + np.array([by_m, 0.0, 0.0, 0.0]))

    def turned_round(self) -> Odo:
        """Return the states of a way in the other direction from the first one on; the wheel counts as before."""
        array = self.array.copy()
        array[:, self.DISTANCE] = 2.0 * array[0, self.DISTANCE] - array[:, self.DISTANCE]
        array[:, self.STEP] *= -1.0
        return Odo(array)


Value = Nav | Odo | Array
"""The values of one kind of variable: ``Nav``, ``Odo``, or an array (m, dim)."""


def retract(value: Value, delta: Array) -> Value:
    """Move ``value`` by the tangent vectors ``delta``, shape (m, dim)."""
    if isinstance(value, Nav):
        p = value.p + np.einsum("mij,mj->mi", value.R, delta[:, 3:6])
        v = value.v + np.einsum("mij,mj->mi", value.R, delta[:, 6:9])
        return Nav(value.R @ so3_exp(delta[:, :3]), p, v)
    if isinstance(value, Odo):
        return Odo(value.array + delta)
    return value + delta


def vectors(value: Value) -> Array:
    """Return the values of a kind of variable other than ``NAV`` as an array (m, dim)."""
    if isinstance(value, Nav):
        raise TypeError("NAV is no vector")
    return value.array if isinstance(value, Odo) else value


@dataclass(frozen=True, repr=False)
class States(Outlined):
    """The states are the values of all variables of a run.

    There are n of nav, bias and odo, one per keyframe; one of each shared kind, (1, dim); one for each further sensor,
    (m, dim).
    """

    nav: Nav
    bias: Array
    odo: Odo
    mount: Array
    clock: Array
    imu: Array
    wheel: Array = field(default_factory=lambda: np.zeros((1, Kind.WHEEL.dim)))
    sensor: Array = field(default_factory=lambda: np.zeros((0, Kind.SENSOR.dim)))

    def __len__(self) -> int:
        return len(self.nav)

    def take(self, rows: slice | np.ndarray) -> States:
        """Return the keyframes of some rows, with the shared variables."""
        nav, bias, odo = self.nav[rows], self.bias[rows], self.odo[rows]
        return States(nav, bias, odo, self.mount, self.clock, self.imu, self.wheel, self.sensor)

    def joined(self, *later: States) -> States:
        """Return these keyframes, then the later ones; shared variables are those of the last."""
        every = (self, *later)
        parts = [(states.nav.R, states.nav.p, states.nav.v, states.bias, states.odo.array) for states in every]
        R, p, v, bias, odo = map(np.concatenate, zip(*parts, strict=True))
        last = every[-1]
        return States(Nav(R, p, v), bias, Odo(odo), last.mount, last.clock, last.imu, last.wheel, last.sensor)

    def with_bias(self, bias: Array) -> States:
        """Return the states with other biases (n, 6)."""
        return States(self.nav, bias, self.odo, self.mount, self.clock, self.imu, self.wheel, self.sensor)

    def with_motion(self, nav: Nav, odo: Odo) -> States:
        """Return the states with another motion."""
        return States(nav, self.bias, odo, self.mount, self.clock, self.imu, self.wheel, self.sensor)

    @cached_property
    def arrays(self) -> tuple[Array, ...]:
        """All values as the compiled kernels take them, without those of further sensors."""
        nav, others = self.nav, (self.bias, self.odo.array, self.mount, self.clock, self.imu, self.wheel)
        return tuple(map(kernel_argument, (nav.R, nav.p, nav.v, *others)))

    def of(self, kind: Kind) -> Value:
        """Return all values of one kind."""
        value: Value = getattr(self, kind.attribute)
        return value

    def to_gtsam(self) -> gtsam.Values:
        """Return a fresh ``gtsam.Values`` that holds every variable.

        They are moved there from zero: inserting attitudes and biases one by one takes ten times as long.
        """
        nav = np.concatenate([so3_log(self.nav.R), self.nav.p, self.nav.v], axis=1)
        parts = {Kind.NAV: nav, Kind.BIAS: self.bias, Kind.ODO: self.odo.array}
        keyframes = np.concatenate([parts[kind] for kind in ELIMINATION_ORDER], axis=1)
        shared = np.concatenate([vectors(self.of(kind)).ravel() for kind in (*SHARED, Kind.SENSOR)])
        return _zero(len(self), len(self.sensor)).retract(Step(keyframes, shared).to_gtsam())

    @cached_property
    def inertial_values(self) -> gtsam.Values:
        """The variables that inertial factors touch, alone. They are kept, and must not be changed."""
        nav = np.concatenate([so3_log(self.nav.R), self.nav.p, self.nav.v], axis=1)
        at_zero = _few_at_zero if len(self) <= _SHORT else _many_at_zero
        return at_zero(len(self)).retract(_vectors({Kind.NAV: nav, Kind.BIAS: self.bias}))

    def moved(self, step: Step) -> States:
        """Return every variable retracted by its part of a step."""
        if compiled_kernels():
            return self.moved_by_kernel(step, in_chart=False)
        parts = {kind: retract(self.of(kind), step.of(kind)) for kind in Kind}
        nav, odo = parts[Kind.NAV], parts[Kind.ODO]
        assert isinstance(nav, Nav)
        assert isinstance(odo, Odo)
        shared = (vectors(parts[kind]) for kind in (*SHARED, Kind.SENSOR))
        return States(nav, vectors(parts[Kind.BIAS]), odo, *shared)

    def moved_by_kernel(self, step: Step, *, in_chart: bool) -> States:
        """Do as :meth:`moved`, in ``kernels/chart.cpp``; ``in_chart``: in the chart of a marginal prior."""
        from trackfg.numerics import compiled

        moved = tuple(np.empty_like(values) for values in self.arrays)
        compiled.retract(self.arrays, kernel_argument(step.keyframes), kernel_argument(step.shared), in_chart, moved)
        R, p, v, bias, odo, mount, clock, imu, wheel = moved
        states = States(Nav(R, p, v), bias, Odo(odo), mount, clock, imu, wheel, self.sensor + step.of(Kind.SENSOR))
        vars(states)["arrays"] = moved
        return states

    def moved_along(self, by_m: float) -> States:
        """Return the states ``by_m`` further along the track."""
        return replace(self, odo=self.odo.moved_along(by_m))

    @property
    def is_mounted_backwards(self) -> bool:
        """Return whether the direction of travel is behind the sensor, which no declaration of its axes makes it."""
        return bool(np.abs(np.angle(np.exp(1j * self.mount[0, 1]))) > 0.5 * np.pi)

    def turned_round(self) -> States:
        """Return the states with the other end of the vehicle ahead: sensor and path as they are, mounting and odometer
        half a turn on.
        """
        mount = self.mount.copy()
        mount[:, 1] = np.angle(np.exp(1j * (mount[:, 1] + np.pi)))
        return replace(self, odo=self.odo.turned_round(), mount=mount)


@dataclass(frozen=True, repr=False)
class Step(Outlined):
    """A step has the tangents of all variables, stacked: keyframes (n, KEYFRAME_DIM), shared variables (SHARED_DIM,).

    Those of further sensors follow the other shared ones.
    """

    keyframes: Array
    shared: Array

    def of(self, kind: Kind) -> Array:
        """Return the tangents of one kind: (n, dim), or (1, dim) for a shared one, (m, dim) of further sensors."""
        start = offset_in_keyframe(kind)
        if kind is Kind.SENSOR:
            return self.shared[start - KEYFRAME_DIM :].reshape(-1, kind.dim)
        if kind.shared:
            return self.shared[None, start - KEYFRAME_DIM : start - KEYFRAME_DIM + kind.dim]
        return self.keyframes[:, start : start + kind.dim]

    def scaled(self, scale: float) -> Step:
        """Return the step times ``scale``."""
        return Step(scale * self.keyframes, scale * self.shared)

    def to_gtsam(self) -> gtsam.VectorValues:
        """Return the step as ``gtsam.Values.retract`` takes it."""
        return _vectors({kind: self.of(kind) for kind in Kind})


def _vectors(tangents: Mapping[Kind, Array]) -> gtsam.VectorValues:
    import gtsam

    out = gtsam.VectorValues()
    for kind, vectors in tangents.items():
        for key, vector in zip(_keys(kind, len(vectors)), vectors, strict=True):
            out.insert(key, vector)
    return out


_SHORT = 64
"""Keyframes: values of so few are kept for every number, since a stream asks for them again and again."""


@lru_cache
def _keys(kind: Kind, count: int) -> tuple[int, ...]:
    return tuple(kind.keys(np.arange(count)).tolist())


def _zero(keyframes: int, sensors: int) -> gtsam.Values:
    """Return all variables at zero, attitudes at the identity."""
    values = _no_motion(keyframes)
    for key in _keys(Kind.ODO, keyframes):
        values.insert(key, np.zeros(Kind.ODO.dim))
    for kind, count in (*((kind, 1) for kind in SHARED), (Kind.SENSOR, sensors)):
        for key in _keys(kind, count):
            values.insert(key, np.zeros(kind.dim))
    return values


def _no_motion(keyframes: int) -> gtsam.Values:
    """Return the variables of inertial factors alone at zero, all of one kind after the other."""
    import gtsam

    values = gtsam.Values()
    for kind, zero in ((Kind.NAV, gtsam.NavState()), (Kind.BIAS, gtsam.imuBias.ConstantBias())):
        for key in _keys(kind, keyframes):
            values.insert(key, zero)
    return values


_few_at_zero, _many_at_zero = lru_cache(maxsize=_SHORT)(_no_motion), lru_cache(maxsize=1)(_no_motion)
