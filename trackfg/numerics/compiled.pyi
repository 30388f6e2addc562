"""Types of the kernels in C++ (``kernels/``), which an installation may lack: see :mod:`trackfg.numerics.kernels`."""

import numpy as np

from trackfg.numerics.arrays import Array

REVISION: int
DELTA_SIZE: int

def eliminate(
    begin: int,
    widths: np.ndarray,
    nav: tuple[int, int],
    indeterminate: float,
    left: Array,
    left_rows: int,
    R: Array,
    S: Array,
    d: Array,
    beyond: Array,
    alone: Array,
    /,
    *families: np.ndarray,
) -> tuple[int, int] | None: ...
def eliminate_pair(
    triangle: Array,
    further: Array,
    indeterminate: float,
    R: Array,
    S: Array,
    d: Array,
    R_shared: Array,
    d_shared: Array,
    marginal: Array,
    /,
) -> bool: ...
def back_substitute(
    R: Array,
    S: Array,
    beyond: Array,
    ahead: np.ndarray,
    nav: tuple[int, int],
    before: int,
    parents: Array,
    x: Array,
    /,
) -> None: ...
def triangle(rows: Array, out: Array, /) -> None: ...
def forward_substitute(
    R: Array,
    S: Array,
    beyond: Array,
    ahead: np.ndarray,
    nav: tuple[int, int],
    before: int,
    carried: Array,
    x: Array,
    /,
) -> None: ...
def covariances(
    R: Array,
    S: Array,
    beyond: Array,
    ahead: np.ndarray,
    nav: tuple[int, int],
    next: Array,
    own: Array,
    cross: Array,
    wanted: np.ndarray,
    windows: Array,
    /,
) -> None: ...
def preintegrate(
    frame: Array, bias: Array, noise: Array, duration: Array, rotation: Array, velocity: Array, delta: Array, /
) -> None: ...
def inertial_factors(deltas: Array, R: Array, p: Array, v: Array, bias: Array, rows: Array, /) -> None: ...
def predict(delta: Array, R: Array, p: Array, v: Array, bias: Array, end: Array, /) -> None: ...
def predict_interval(
    edges: Array,
    gyro: Array,
    accel: Array,
    bridged: np.ndarray,
    layout: tuple[int, int, int, int, int, int],
    dt: float,
    setting: Array,
    limits: Array,
    states: tuple[Array, ...],
    results: tuple[Array, ...],
    /,
) -> None: ...
def median_step(values: Array, /) -> float: ...
def cauchy_fit(
    rows: Array,
    right: Array,
    precision: Array,
    least_sd: float,
    per_value: float,
    limits: Array,
    out: Array,
    /,
) -> bool: ...
def noise_floor(
    edges: Array,
    gyro: Array,
    accel: Array,
    bridged: np.ndarray,
    starts: np.ndarray,
    length: int,
    dt: float,
    limits: Array,
    seen: Array,
    lost_rows: np.ndarray,
    lost: Array,
    shock_rows: np.ndarray,
    shock: Array,
    /,
) -> tuple[int, int]: ...
def noise_seen(
    edges: Array,
    gyro: Array,
    accel: Array,
    bridged: np.ndarray,
    length: int,
    dt: float,
    limits: Array,
    declared: Array,
    excess: Array,
    clearly: float,
    t: Array,
    variance: Array,
    /,
) -> None: ...
def white_noise(
    t: Array,
    knots: Array,
    seen: Array,
    declared: Array,
    clearly: float,
    lost_t: Array,
    lost: Array,
    shock_t: Array,
    shock: Array,
    variance: Array,
    /,
) -> None: ...
def compress(
    edges: Array,
    gyro: Array,
    accel: Array,
    starts: np.ndarray,
    bias: Array,
    duration: Array,
    rotation: Array,
    velocity: Array,
    /,
) -> None: ...
def turning(
    edges: Array,
    gyro: Array,
    keyframes: np.ndarray,
    bias: Array,
    distance: Array,
    at_rest: float,
    turn: Array,
    mean: Array,
    mean_by_time: Array,
    /,
) -> None: ...
def ahead_of_a_steady_turn(turn: Array, mean: Array, mean_by_time: Array, least: float, ahead: Array, /) -> None: ...
def means_around(t: Array, width: float, edges: Array, samples: Array, means: Array, /) -> None: ...
def interpolate_columns(at: Array, t: Array, values: Array, out: Array, /) -> None: ...
def tach_interval(t: Array, distance: Array, gaps: Array, uncounted: Array, interval: Array, out: Array, /) -> bool: ...
def pair_rows(
    values: tuple[Array, ...],
    deltas: Array,
    priors: tuple[tuple[object, ...], ...],
    families: tuple[tuple[object, ...], ...],
    rows: Array,
    /,
) -> bool: ...
def linear_rows(
    type: str,
    values: tuple[Array, ...],
    indices: tuple[np.ndarray, ...],
    data: tuple[Array, ...],
    sigma: Array,
    width: float,
    rows: Array,
    /,
) -> bool: ...
def marginal_prior(
    values: tuple[Array, ...],
    sensor: Array,
    keyframe: int,
    origins: tuple[Array, ...],
    sensor_origins: Array,
    A: Array,
    b: Array,
    sigma: Array,
    rows: Array,
    /,
) -> bool: ...
def retract(
    values: tuple[Array, ...], keyframes: Array, shared: Array, in_chart: bool, moved: tuple[Array, ...], /
) -> None: ...
def step_from(origin: tuple[Array, ...], values: tuple[Array, ...], keyframes: Array, shared: Array, /) -> None: ...
def marginalised_states(
    R: Array,
    S: Array,
    d: Array,
    point: tuple[Array, ...],
    next_states: tuple[Array, ...],
    sensors: Array,
    out: tuple[Array, ...],
    /,
) -> bool: ...
def quantities(R: Array, v: Array, mount: Array, lever_arm: Array, J: Array, /) -> None: ...
def quantity_variances(
    R: Array,
    v: Array,
    mount: Array,
    lever_arm: Array,
    of_keyframes: Array,
    of_shared: Array,
    variance: Array,
    with_point: Array,
    /,
) -> None: ...
def trajectory_rows(
    motion: tuple[Array, ...],
    keyframes: tuple[Array, ...],
    mount: Array,
    lever_arm: Array,
    direction: float,
    of_point: Array,
    keyframe: np.ndarray,
    out: Array,
    /,
) -> None: ...
def add_weighted_rows(rows: Array, index: np.ndarray, weights: Array, out: Array, /) -> None: ...
def add_up_rows(rows: Array, /) -> None: ...
def spread(
    rows: Array,
    first: np.ndarray,
    last: np.ndarray,
    columns: np.ndarray,
    later: np.ndarray,
    of_keyframes: Array,
    of_shared: Array,
    cross: Array,
    out: Array,
    /,
) -> None: ...
def dense_motion(
    edges: Array,
    gyro: Array,
    accel: Array,
    starts: np.ndarray,
    first: np.ndarray,
    setting: Array,
    keyframes: tuple[Array, ...],
    rows: tuple[Array, ...],
    /,
) -> None: ...
def resample(
    edges: np.ndarray,
    mean: Array,
    place: Array,
    samples: Array,
    start: int,
    cell: float,
    step: int,
    taps: Array,
    out: Array,
    /,
) -> None: ...
def hermite_at(t: Array, times: Array, places: Array, velocities: Array, out: Array, /) -> None: ...
def switch_chain(
    z: Array, transition: Array, stay_cost: float, outlier: float, inlier_before: float, first: Array, /
) -> float: ...
def spill(table: object, file: int, budget: int, limit: int, /) -> object: ...
def unspill(table: object, handler: object, /) -> None: ...
