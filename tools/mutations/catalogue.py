"""The errors: for each source file the tests of its part, and what may go wrong in it.

A fragment is as short as leaves no doubt about its place, and stands exactly once in its file; whoever rewrites the
line moves the fragment along. Each error changes a result: one that does not, such as another order of a sum, teaches
nothing.
"""

from __future__ import annotations

from typing import NamedTuple


class Mutation(NamedTuple):
    """One error. ``sentence`` says what is wrong then; ``changes`` are the fragments and what is put in their place."""

    sentence: str
    changes: tuple[tuple[str, str], ...]


class Part(NamedTuple):
    """A source file, the tests that have to notice errors in it, and the errors."""

    file: str
    tests: tuple[str, ...]
    mutations: tuple[Mutation, ...]


def _one(sentence: str, fragment: str, replacement: str, *more: tuple[str, str]) -> Mutation:
    return Mutation(sentence, ((fragment, replacement), *more))


_FAMILIES = "tests/factors/test_families.py"

_FACTORS = (
    Part(
        "factors/odometry.py",
        ("tests/factors/test_odometry.py", _FAMILIES),
        (
            _one(
                "the tach's clock offset has the other sign, in the derivative too",
                "(count[:, 0] - rate[:, 0] * offset)",
                "(count[:, 0] + rate[:, 0] * offset)",
                ("= rate[:, 0], rate[:, 0] * since[:, 0]", "= -rate[:, 0], -rate[:, 0] * since[:, 0]"),
            ),
            _one("the tach's clock does not drift", "clock[:, 1] * since[:, 0]", "0.0 * clock[:, 1] * since[:, 0]"),
            _one("a wheel to the left rolls more in a curve to the left", "[-turned, way", "[turned, way"),
            _one("a wheel to the outside rolls less", "way * np.abs(turned)", "-way * np.abs(turned)"),
            _one("traction and braking change places", "np.maximum(along, 0.0)", "np.minimum(along, 0.0)"),
            _one(
                "what curves and force add is counted twice the other way",
                "distance - explained",
                "distance + explained",
                ("-response[:, None, :]", "response[:, None, :]"),
            ),
            _one("an arc is as long as its chord", "phi / sine)", "0.0 * phi + 1.0)"),
        ),
    ),
    Part(
        "factors/gnss.py",
        ("tests/factors/test_gnss.py", _FAMILIES),
        (
            _one(
                "the age of a receiver's speeds has the other sign",
                "late = delay + sensor[:, 1:]",
                "late = delay - sensor[:, 1:]",
                ("np.sum(towards * force, axis=1)]", "-np.sum(towards * force, axis=1)]"),
            ),
            _one(
                "the antenna swings the other way",
                "swing = np.cross(measured.angular_rate, lever_arm)",
                "swing = np.cross(lever_arm, measured.angular_rate)",
            ),
            _one(
                "the receiver's clock offset has the other sign",
                "late = delay + clock[:, 2:]",
                "late = delay - clock[:, 2:]",
                ("d_clock[:, :, 2] = nav.v", "d_clock[:, :, 2] = -nav.v"),
            ),
            _one(
                "the antenna is on the other side of the sensor",
                'np.einsum("mij,mj->mi", nav.R, lever_arm)',
                'np.einsum("mij,mj->mi", nav.R, -lever_arm)',
                ("-nav.R @ skew(lever_arm)", "nav.R @ skew(lever_arm)"),
            ),
        ),
    ),
    Part(
        "factors/gravity.py",
        ("tests/factors/test_gravity.py", _FAMILIES),
        (
            _one(
                "the bias has the other sign", "up + bias[:, :3]", "up - bias[:, :3]", ("= np.eye(3)", "= -np.eye(3)")
            ),
            _one(
                "gravity pulls up",
                "up = nav.R[:, 2, :] * gravity",
                "up = -nav.R[:, 2, :] * gravity",
            ),
        ),
    ),
    Part(
        "factors/marginal_prior.py",
        ("tests/factors/test_marginal_prior.py",),
        (
            _one("yaw is not wrapped", "2.0 * np.pi * np.round(", "0.0 * np.pi * np.round("),
            _one(
                "the calibration's part in the bias has the other sign",
                "-= A[:, at_bias",
                "+= A[:, at_bias",
                ("bias=bias + imu @", "bias=bias - imu @"),
            ),
            _one("velocities are not compared in the vehicle's own axes", "- cross(velocity, turn)", "- 0.0 * turn"),
            _one("a jump along the track is known to a sigma", "Odo.DISTANCE] = sd_m", "Odo.DISTANCE] = 1.0"),
        ),
    ),
    Part(
        "factors/motion.py",
        ("tests/factors/test_motion.py", _FAMILIES),
        (
            _one(
                "the swing of the lever arm has the other sign",
                "body - np.cross(angular_rate",
                "body + np.cross(angular_rate",
            ),
            _one("yaw of the mounting turns the other way", "-sy, cy * sp, sy * cp", "sy, cy * sp, sy * cp"),
        ),
    ),
    Part(
        "factors/path.py",
        ("tests/factors/test_path.py", _FAMILIES),
        (
            _one(
                "the gyro's error bends the path the other way",
                "d_c_by_e = -mean_by_time",
                "d_c_by_e = mean_by_time",
            ),
            _one(
                "the lever arm is left out at one end", "second.R, from_track)) - (", "second.R, 0 * from_track)) - ("
            ),
        ),
    ),
    Part(
        "factors/rail.py",
        ("tests/factors/test_rail.py",),
        (
            _one(
                "the gyro's turn begins at the interval's end", "late = so3_exp(h1 * e)", "late = so3_exp((1 - h1) * e)"
            ),
            _one("the detail of the path is taken away", "u1 * end.v + detail", "u1 * end.v - detail"),
        ),
    ),
    Part(
        "factors/bias.py",
        ("tests/factors/test_bias.py", _FAMILIES),
        (
            _one(
                "the calibration's part in the change has the other sign",
                "residual = second - first - np",
                "residual = second - first + np",
                ("(-same, same, -change)", "(-same, same, change)"),
            ),
            _one("the Coriolis force is mirrored", "-2.0 * (in_body", "2.0 * (in_body"),
            _one(
                "g-sensitivity and gyro scale change places",
                "9 + 3 * axis : 12 + 3 * axis] = rate",
                "9 + 3 * axis : 12 + 3 * axis] = force",
            ),
        ),
    ),
    Part(
        "factors/landmark.py",
        ("tests/factors/test_landmark.py", _FAMILIES),
        (
            _one("the share of the time is the derivative by the wrong keyframe", "= 1.0 - f, f", "= f, 1.0 - f"),
            _one(
                "the lever arm points the other way",
                "nav.p - np.einsum",
                "nav.p + np.einsum",
                ("by_body, skew(lever_arm)", "by_body, -skew(lever_arm)"),
            ),
            _one(
                "errors of a line do not last",
                "second_offset - correlation * first_offset",
                "second_offset - 0.0 * correlation * first_offset",
                ("-correlation[:, :, None] * d_first", "-0.0 * correlation[:, :, None] * d_first"),
            ),
            _one("a balise is passed before its time", "odo.distance + carried", "odo.distance - carried"),
        ),
    ),
    Part(
        "trackfg/mapping/runs/balise_survey.py",
        ("tests/trackfg/mapping/runs/test_balise_survey.py",),
        (
            _one("readings are too exact", '"reading_m_sd"].to_numpy() ** 2', '"reading_m_sd"].to_numpy() ** 4'),
            _one("a balise is on the other side of its plan", "np.nan, -in_sigmas * sd", "np.nan, in_sigmas * sd"),
            _one("a wheel erred before, not behind", "of_run[::-1]], axis=1)[:, ::-1]", "of_run], axis=1)"),
        ),
    ),
    Part(
        "trackfg/smoothing/fixes/balise_fixes.py",
        ("tests/trackfg/smoothing/fixes/test_balises.py",),
        (_one("a place that is passed again is known better each time", "np.sqrt(passes) * ", ""),),
    ),
    Part(
        "trackfg/graph/balise_ties.py",
        ("tests/trackfg/smoothing/fixes/test_balises.py",),
        (_one("ties are twice as exact as readings", "sigma = read * ", "sigma = 0.5 * read * "),),
    ),
    Part(
        "factors/switching.py",
        ("tests/factors/test_switching.py",),
        (
            _one("a slip never ends", "leave = 1.0 - np.exp(", "leave = 0.01 - 0.01 * np.exp("),
            _one("a lone outlier may be half as wide", "0.5 * width**2)", "0.125 * width**2)"),
        ),
    ),
    Part(
        "factors/family.py",
        (_FAMILIES,),
        (
            _one(
                "the right-hand side of the linear factors has the other sign",
                "-residual[:, :, None]",
                "residual[:, :, None]",
            ),
            _one(
                "a weight acts in full on the residual instead of by its root",
                "np.sqrt(self.loss.weight(row_norms(rows[:, :, -1])))",
                "self.loss.weight(row_norms(rows[:, :, -1]))",
            ),
        ),
    ),
)

_GRAPH = (
    Part(
        "trackfg/graph/fix_consensus.py",
        ("tests/trackfg/graph/test_fix_consensus.py",),
        (
            _one(
                "a fix is wrong where it is likelier right",
                "erred <= np.log(WRONG / line_m)",
                "erred > np.log(WRONG / line_m)",
            ),
            _one("a wrong fix is as likely near as far", "np.square(error) / variance + np.log", "0.0 + np.log"),
        ),
    ),
    Part(
        "trackfg/graph/motion.py",
        ("tests/trackfg/graph/test_motion.py",),
        (_one("the gyro's bridge is twice as wide", "durations / 12.0", "durations / 3.0"),),
    ),
    Part(
        "trackfg/graph/creeping_wheel.py",
        ("tests/trackfg/graph/test_creeping_wheel.py",),
        (
            _one("the wheel that creeps most is taken for the best", "rolls, rate, np.inf", "rolls, -rate, np.inf"),
            _one("creep goes against the force", "np.sign(pushed) *", "-np.sign(pushed) *"),
            _one("an error that lasts counts as if it did not", "_LASTS_S * duration", "duration**2"),
            _one("a wheel that does not roll may be the best", "> _ROLLS", "> -1.0"),
            _one("noise is taken for creep", "lead**2 - variance - variance[least, k]", "lead**2"),
        ),
    ),
    Part(
        "trackfg/graph/odometry.py",
        ("tests/trackfg/graph/test_motion.py", "tests/trackfg/graph/test_odometry.py"),
        (
            _one("drift counts from the start of the clock", "at - inputs.clock_origin", "at"),
            _one("creep per force does not depend on how long the interval is", "** 2 / duration", "** 2"),
        ),
    ),
    Part(
        "trackfg/graph/positions.py",
        ("tests/trackfg/graph/test_positions.py",),
        (
            _one("a fix is carried the wrong way by the speed", "* chainage - carried", "* chainage + carried"),
            _one("the antenna's lever arm counts from the vehicle", "lever_arm_m) - inputs.lever_arm", "lever_arm_m)"),
            _one("errors that last do not widen GNSS", "max(1.0, 2.0 * config", "max(1.0, 0.0 * config"),
            _one(
                "time from keyframe to position has the other sign",
                "t - inputs.t[index], sigma",
                "inputs.t[index] - t, sigma",
            ),
        ),
    ),
    Part(
        "trackfg/graph/inertial.py",
        ("tests/trackfg/graph/test_build.py", "tests/trackfg/graph/test_inertial.py"),
        (
            _one(
                "the level frame does not turn over the round Earth",
                "earth + transport_rate(velocity)",
                "earth + 0.0 * transport_rate(velocity)",
            ),
            _one("biases walk in proportion to time", "np.sqrt(t[1:] - t[:-1])", "(np.diff(t))"),
        ),
    ),
    Part(
        "trackfg/graph/keyframes.py",
        ("tests/trackfg/graph/test_keyframes.py",),
        (
            _one(
                "keyframes are as dense at rest as in motion",
                "1.0 / config.interval_at_rest_s",
                "1.0 / config.interval_s",
            ),
        ),
    ),
    Part(
        "trackfg/numerics/spans.py",
        ("tests/trackfg/graph/test_keyframes.py",),
        (
            _one(
                "the nearest grid point is the next one",
                "(values - grid[right - 1] < grid[right] - values)",
                "(values < grid[right - 1])",
            ),
        ),
    ),
    Part(
        "trackfg/graph/forward_force.py",
        ("tests/trackfg/graph/test_wheel_slip.py",),
        (
            _one(
                "gravity pulls uphill",
                "acceleration = force[:, 0] + gravity",
                "acceleration = force[:, 0] - gravity",
            ),
        ),
    ),
    Part(
        "trackfg/graph/wheel_slip.py",
        ("tests/trackfg/graph/test_wheel_slip.py",),
        (
            _one(
                "a filter that goes on without what it measured",
                "v += with_v / variance * innovation",
                "v -= with_v / variance * innovation",
            ),
        ),
    ),
)

_SOLVER = (
    Part(
        "trackfg/solver/elimination.py",
        ("tests/trackfg/solver/test_elimination.py", "tests/trackfg/solver/test_covariance.py"),
        (
            _one("a singular triangle is not noticed", "if not _determined(R):", "if False:"),
            _one("only an exact zero counts as singular", "diagonal > _INDETERMINATE", "diagonal > 0.0"),
            _one("signs of rows are left as they come", "return R * sign[..., None], sign", "return R, sign"),
            _one(
                "what is left of shared variables is lost",
                "alone.append(rest[next_height:, ",
                "alone.append(0 * rest[next_height:, ",
            ),
        ),
    ),
    Part(
        "trackfg/solver/gauss_newton.py",
        ("tests/trackfg/solver/test_steps.py",),
        (
            _one("a step may raise the cost fourfold", "cost * (1.0 + 1e-12)", "cost * 4.0"),
            _one("it may stop before the losses are on", "if robust and length < config", "if length < config"),
            _one("no step is doubled", "_LONGEST = 8.0", "_LONGEST = 1.0"),
            _one("the losses never apply", "robust, families = True, problem.families", "robust = True"),
        ),
    ),
    Part(
        "trackfg/solver/arcs.py",
        ("tests/trackfg/solver/test_arcs.py",),
        (
            _one("a path is turned the other way", "+ np.sin(angle) * across", "- np.sin(angle) * across"),
            _one("what is along a chord is lost", "(length + along) *", "length *"),
        ),
    ),
    Part(
        "trackfg/solver/square_root.py",
        ("tests/trackfg/solver/test_covariance.py", "tests/trackfg/numerics/test_compiled.py"),
        (
            _one(
                "a keyframe is regressed on the next with the other sign",
                "return np.asarray(np.negative(product, out=product))",
                "return np.asarray(product)",
            ),
            _one(
                "samples do not follow the next keyframe",
                "(x[k] - self.on_parents(k) @ window)",
                "(x[k] - 0.0 * self.on_parents(k) @ window)",
            ),
        ),
    ),
    Part(
        "trackfg/solver/covariance.py",
        ("tests/trackfg/solver/test_covariance.py",),
        (
            _one("the spread of a keyframe given the next is left out", "@ A.T + spread[k]", "@ A.T"),
            _one(
                "functions have the second keyframe's part with the other sign",
                "D[:, :KEYFRAME_DIM] += functions",
                "D[:, :KEYFRAME_DIM] -= functions",
            ),
            _one(
                "functions of two keyframes lose the second",
                "right[:, second] += functions",
                "right[:, second] -= functions",
            ),
        ),
    ),
    Part(
        "trackfg/solver/variance_components.py",
        ("tests/trackfg/solver/test_variance_components.py",),
        (
            _one(
                "residuals are held against their number",
                "weights(states)[:, None] - _spread(",
                "weights(states)[:, None] + 0 * _spread(",
            ),
        ),
    ),
)

_OUTPUT = (
    Part(
        "trackfg/output/track_geometry.py",
        ("tests/trackfg/output/test_geometry_sigmas.py",),
        (
            _one("white noise grows with the stride", "every**-0.5", "every**0.5"),
            _one("the gyro's bridge has one end only", "* f * (1.0 - f)", "* f"),
            _one(
                "tilt of the rails is over the base",
                "(z_left - z_right) / self.meaning.tops_apart_m",
                "(z_left - z_right) / self.meaning.cross_level_base_m",
            ),
        ),
    ),
    Part(
        "trackfg/output/rail_profiles.py",
        ("tests/trackfg/output/test_geometry_sigmas.py",),
        (
            _one("the right rail up is positive", "apart[2] / distance", "-apart[2] / distance"),
            _one("sides do not change down the line", "left, right = right, left", "pass"),
        ),
    ),
    Part(
        "trackfg/output/profile_samples.py",
        ("tests/trackfg/output/test_profile_samples.py",),
        (
            _one("the accelerometer's noise grows with the interval as the gyro's does", "_span**1.5", "_span**0.5"),
            _one("a point below swings the other way", "cross(arm, direction)", "cross(direction, arm)"),
            _one("a bridge has one end only", "fraction - 1.0, -fraction]", "fraction - 1.0, 0 * fraction]"),
            _one(
                "a path that is turned as a whole seems to bend",
                "np.add(ahead[1:], ahead[:-1], out=bent[1:])",
                "pass",
            ),
        ),
    ),
    Part(
        "trackfg/output/slip_events.py",
        ("tests/trackfg/output/test_slip_events.py",),
        (
            _one("the tach's clock offset has the other sign", "wheel.at(t - offset -", "wheel.at(t + offset -"),
            _one("drift counts from the start of the clock", ".clock_origin))", ".clock_origin * 0))"),
        ),
    ),
    Part(
        "trackfg/output/dense_motion.py",
        ("tests/trackfg/output/test_dense_motion.py",),
        (
            _one(
                "what is left of the turn is put in all at once",
                "closure.take(i, axis=1) * rows.f)",
                "closure.take(i, axis=1))",
            ),
            _one("the gyro's bias is added", "/ rows.dt - bias_gyro", "/ rows.dt + bias_gyro"),
            _one("what is left of the velocity is taken away", "left_v * u[:, None]", "left_v * -u[:, None]"),
        ),
    ),
    Part(
        "trackfg/output/trajectory.py",
        ("tests/trackfg/output/test_trajectory.py",),
        (
            _one(
                "the reference point is on the other side of the sensor",
                "p = nav.p - matrices_times(nav.R, lever_arm)",
                "p = nav.p + matrices_times(nav.R, lever_arm)",
            ),
            _one("speed is that of the sensor", "nav.own_velocity - cross(motion.gyro, arm[None])", "nav.own_velocity"),
            _one(
                "speed is that of the reference point",
                "arm = lever_arm - tracking_point(states.mount)[0]",
                "arm = lever_arm",
            ),
            _one(
                "chainage grows whichever way the run goes",
                "columns = [run.direction * motion.distance",
                "columns = [motion.distance",
            ),
            _one("the white noise in between is left out", "+= gyro * bridge[:, None]", "+= 0 * bridge[:, None]"),
        ),
    ),
    Part(
        "trackfg/output/place_covariance.py",
        ("tests/trackfg/output/test_place_covariance.py",),
        (
            _one(
                "the share of the time is that of the other keyframe",
                "(1.0 - f) * rows[keyframe], f * rows",
                "f * rows[keyframe], (1.0 - f) * rows",
            ),
        ),
    ),
)

_GEOMETRY_TESTS = ("tests/trackfg/geometry/test_slopes.py", "tests/trackfg/geometry/test_versines.py")
_GEOMETRY = (
    Part(
        "trackfg/geometry/twist.py",
        _GEOMETRY_TESTS,
        (
            _one(
                "twist has the other sign",
                "ends = {0: 1.0, -base: -1.0}",
                "ends = {0: -1.0, -base: 1.0}",
            ),
        ),
    ),
    Part(
        "trackfg/geometry/versines.py",
        _GEOMETRY_TESTS,
        (
            _one(
                "the ends of an asymmetrical chord change places",
                "-p: -q / (p + q), q: -p / (p + q)",
                "-p: -p / (p + q), q: -q / (p + q)",
            ),
            _one(
                "a curve to the left has positive versines",
                "{0: 1.0, -p: -q / (p + q), q: -p / (p + q)}",
                "{0: -1.0, -p: q / (p + q), q: p / (p + q)}",
            ),
        ),
    ),
    Part(
        "trackfg/geometry/grid.py",
        _GEOMETRY_TESTS,
        (
            _one(
                "curvature is positive to the right, the gradient downhill",
                "{half: 1.0 / base_m, -half: -1.0 / base_m}",
                "{half: -1.0 / base_m, -half: 1.0 / base_m}",
            ),
            _one(
                "curvature and gradient are over half the base",
                "{half: 1.0 / base_m, -half: -1.0 / base_m}",
                "{half: 2.0 / base_m, -half: -2.0 / base_m}",
            ),
        ),
    ),
    Part(
        "trackfg/geometry/cross_level.py",
        _GEOMETRY_TESTS,
        (
            _one(
                "the inner rail is the outer one",
                "np.where(left_is_outer, 1.0, -1.0)",
                "np.where(left_is_outer, -1.0, 1.0)",
            ),
        ),
    ),
    Part(
        "trackfg/geometry/bands.py",
        ("tests/trackfg/geometry/test_bands.py",),
        (
            _one("the band is of the second order", "detuning**8", "detuning**4"),
            _one("the second difference is of the first order", "second /= step_m**2", "second /= step_m"),
        ),
    ),
    Part(
        "trackfg/geometry/moving_average.py",
        ("tests/trackfg/geometry/test_moving_average.py",),
        (_one("the ends of the window count in full", "sums -= 0.5 * (y", "sums -= 0.0 * (y"),),
    ),
    Part(
        "trackfg/geometry/design_versine.py",
        ("tests/trackfg/geometry/test_design_versine.py",),
        (_one("curvature counts evenly between steps", "[1.0, 4.0, 1.0]", "[2.0, 2.0, 2.0]"),),
    ),
)

_SENSORS = (
    Part(
        "trackfg/sensors/imu_intervals.py",
        ("tests/trackfg/sensors/test_imu_intervals.py", "tests/factors/test_path.py"),
        (
            _one("sculling is left out", "change += 0.5 * cross(turn, change)", "change += 0.0 * cross(turn, change)"),
            _one(
                "the turn inside a group is left out",
                "matrix_from_quaternion(running), change)",
                "np.broadcast_to(np.eye(3), (len(change), 3, 3)), change)",
            ),
            _one(
                "the attitude's weight is that of the sample after it only",
                "0.5 * (share + np.append(0.0, share[:-1]))",
                "share",
            ),
            _one("any two rows are a hole", "np.maximum(_HOLE_INTERVALS", "np.minimum(_HOLE_INTERVALS"),
        ),
    ),
    Part(
        "trackfg/sensors/dead_reckoning.py",
        ("tests/trackfg/sensors/test_dead_reckoning.py",),
        (
            _one(
                "a path is turned the wrong way onto GNSS",
                "np.angle(np.sum(np.conj(a) * b))",
                "-np.angle(np.sum(np.conj(a) * b))",
            ),
        ),
    ),
    Part(
        "trackfg/sensors/starting_bias.py",
        ("tests/trackfg/sensors/test_starting_bias.py", "tests/trackfg/sensors/test_dead_reckoning.py"),
        (
            _one(
                "the sideways acceleration of curves is taken for cant",
                "self.speed * w[:, 2], -self.speed * w[:, 1]",
                "0 * w[:, 2], -self.speed * w[:, 1]",
            ),
            _one(
                "rests show nothing of the Earth's rate", "- [0.0, 0.0, earth_rate[2]]", "+ [0.0, 0.0, earth_rate[2]]"
            ),
        ),
    ),
    Part(
        "trackfg/smoothing/noise_levels.py",
        ("tests/trackfg/smoothing/test_noise_levels.py",),
        (
            _one(
                "levels fall below what is declared",
                "significant, np.sqrt(variance), 1.0",
                "significant, np.sqrt(variance), 0.5",
            ),
            _one(
                "the gyro's walk says nothing of the accelerometer's",
                '_WALKS["accel_walk"], walk, grade)',
                '_WALKS["accel_walk"], walk)',
            ),
            _one("a stretch agrees with what is declared", "_AGREEING * over_all**2", "_AGREEING * 1.0"),
        ),
    ),
    Part(
        "trackfg/streaming/window/records/noise_record.py",
        ("tests/trackfg/streaming/window/records/test_noise_record.py",),
        (
            _one("levels are of assumed sigmas, not of declared ones", "* level**2", "* 1.0"),
            _one(
                "intervals to come have the oldest level",
                "self.newest, self.others = inertial[-1]",
                "self.newest, self.others = inertial[0]",
            ),
            _one("nothing is forgotten", "window.t[leaving]) / _REMEMBERED_S)", "window.t[leaving]) * 0.0)"),
            _one("what nothing checks has a level", "if redundancy > LEAST_REDUNDANCY else", "if True else"),
            _one(
                "GNSS is worse if all else is far from what is declared",
                "or declared > max(FAR_OFF",
                "or declared < 0.0 * max(FAR_OFF",
            ),
            _one("rests show what comes alone", "density**2 + factor**2 * part", "density**2 + 0.0 * part"),
            _one("stretches before say nothing of their like", "self.sums[i], self.all_sums[i])", "self.sums[i])"),
            _one("motion passes for noise", '[levels["accel"] > FAR_OFF', '[levels["accel"] > 1e3 * FAR_OFF'),
        ),
    ),
    Part(
        "trackfg/sensors/gnss_clock.py",
        ("tests/trackfg/sensors/test_gnss_clock.py",),
        (
            _one("the antenna is on the other side", "path + complex(forward, left)", "path - complex(forward, left)"),
            _one("an antenna is where none is declared", "if is_declared(part):", "if True:"),
        ),
    ),
    Part(
        "trackfg/smoothing/doubts/path_doubts.py",
        ("tests/trackfg/smoothing/doubts/test_path_doubts.py",),
        (_one("a body on springs is as good as a rigid one", "level < ON_SPRINGS", "level < 1e3 * ON_SPRINGS"),),
    ),
    Part(
        "trackfg/results/widening.py",
        ("tests/trackfg/results/test_verdict.py",),
        (_one("a height is as good as the position in plan", '"up_m": "height"', '"up_m": "position"'),),
    ),
    Part(
        "trackfg/sensors/displacement.py",
        ("tests/trackfg/sensors/test_displacement.py",),
        (
            _one("a reading counts the other way", "position_m[axis] + channel", "position_m[axis] - channel"),
            _one("a mean is as uncertain as a reading", "max(1.0, self.rate_hz * window_s)", "1.0"),
        ),
    ),
    Part(
        "trackfg/sensors/tach.py",
        ("tests/trackfg/sensors/test_tach.py",),
        (
            _one("a count is rounded by half of what it is", "np.sqrt(12.0)", "np.sqrt(48.0)"),
            _one("an unsigned tach never goes backwards", "< _CLEARLY_BACKWARDS *", "< 9 * _CLEARLY_BACKWARDS *"),
            _one("the rate is the distance over the half window", "/ (2.0 * half_window_s)", "/ half_window_s"),
        ),
    ),
    Part(
        "trackfg/sensors/tach_rests.py",
        (
            "tests/trackfg/sensors/test_tach_rests.py",
            "tests/trackfg/sensors/test_standstills.py",
            "tests/trackfg/sensors/test_rests_of_any_ride.py",
        ),
        (
            _one("whatever does not turn the wheel is at rest", "< _LAST_SECOND_M)", "< 1e3 * _LAST_SECOND_M)"),
            _one("a speed in steps is zero only at rest", "x = 1.5 * (np.sqrt", "x = 1e3 + 1.5 * (np.sqrt"),
        ),
    ),
    Part(
        "trackfg/sensors/averages.py",
        ("tests/trackfg/sensors/test_averages.py",),
        (_one("a mean is an integral", "for name in IMU_COLUMNS[1:])) / step", "for name in IMU_COLUMNS[1:]))"),),
    ),
)

_WINDOW_TEST = "tests/trackfg/streaming/window/test_window.py"
_STREAMING = (
    Part(
        "trackfg/streaming/window/window.py",
        (_WINDOW_TEST,),
        (
            _one(
                "keyframes that are gone do not follow the next one",
                "root.back_substituted(d[:, :, None].copy(), behind)",
                "d[:, :, None].copy(), behind",
            ),
            _one("the first keyframe's bias is not that of its interval", "if len(self) == 1:", "if False:"),
        ),
    ),
    Part(
        "trackfg/streaming/window/filter_step.py",
        (_WINDOW_TEST,),
        (
            _one(
                "what the wheel adds counts from the wrong place",
                "others[:, -1] += others",
                "others[:, -1] += 0.0 * others",
            ),
            _one(
                "the new prior is at the older keyframe",
                "pair.states.take(slice(1, 2))",
                "pair.states.take(slice(0, 1))",
            ),
        ),
    ),
    Part(
        "trackfg/streaming/window/fix_voting.py",
        ("tests/trackfg/streaming/window/test_fix_voting.py",),
        (
            _one("the first fix that contradicts is followed", "if votes <= self.votes:", "if False:"),
            _one(
                "a place that changes goes the other way",
                "other.further_m - innovation)",
                "other.further_m + innovation)",
            ),
            _one("a fix read again at rest votes again", "if not repeated:", "if True:"),
        ),
    ),
    Part(
        "trackfg/streaming/window/wheel_creep.py",
        ("tests/trackfg/streaming/window/test_wheel_creep.py",),
        (
            _one("any fix is creep", "return not wrong_is_likelier(", "return True or wrong_is_likelier("),
            _one("GNSS notices no creep", "1.0 / others_sd_m**2", "0.0"),
            _one("the place stays where creep shows", "+= creep.further_m * since", "+= 0.0 * since"),
            _one("the likelihood of a walk is not asked", "return gain > (", "return gain > 1e9 + ("),
        ),
    ),
    Part(
        "trackfg/streaming/window/marginalised.py",
        (_WINDOW_TEST,),
        (
            _one(
                "a keyframe merged away leaves its right-hand side",
                "d = d - S @ np.concatenate",
                "d = d + S @ np.concatenate",
            ),
        ),
    ),
    Part(
        "trackfg/streaming/window/next_interval.py",
        (_WINDOW_TEST,),
        (
            _one(
                "a wheel that is believed puts the vehicle behind",
                "nav.p + further * forward",
                "nav.p - further * forward",
            ),
        ),
    ),
    Part(
        "trackfg/streaming/window/predicted_motion.py",
        (_WINDOW_TEST,),
        (_one("backwards counts as forwards", "chord[0] @ forward))", "abs(chord[0] @ forward)))"),),
    ),
    Part(
        "trackfg/streaming/window/records/gnss_record.py",
        ("tests/trackfg/streaming/window/records/test_gnss_record.py",),
        (
            _one("positions get their weight back at once", "np.all(self.given[longest:, 0] > _LITTLE)", "True"),
            _one("positions never get it back", "return little and have_grown", "return False and have_grown"),
        ),
    ),
    Part(
        "trackfg/streaming/intake/row_checks.py",
        ("tests/trackfg/streaming/intake/test_intake.py",),
        (
            _one(
                "a count over the end of its range turns back",
                "(reach, previous - counted)",
                "(reach, counted - previous)",
            ),
            _one(
                "a count out of a range goes over its end", "max(abs(previous), abs(counted)) < reach and", "True and"
            ),
        ),
    ),
    Part(
        "trackfg/streaming/doubts/reporting.py",
        ("tests/trackfg/streaming/doubts/test_reporting.py",),
        (_one("a doubt is reported again and again", "self.reported += tuple", "_ = tuple"),),
    ),
    Part(
        "trackfg/streaming/doubts/sigma_test.py",
        ("tests/trackfg/streaming/doubts/test_sigma_test.py",),
        (
            _one(
                "what lies between rows is taken for an error",
                "variance += _between_rows(t, smoothed[:, 0], values)",
                "variance += 0.0",
            ),
            _one("rows of a lost window count", "((t <= self.lost[0]) |", "((t <= np.inf) |"),
        ),
    ),
    Part(
        "trackfg/streaming/window/tach_buffer.py",
        (_WINDOW_TEST,),
        (
            _one("an unsigned tach keeps its sense backwards", "float(np.sign(speed))", "1.0"),
            _one("a departure has the sense of the rest", "self._sense_at(speeds[1])", "old_sense"),
            _one("a slow tach is not waited for", "until >= max(end, t + self.late_s)", "until >= end"),
        ),
    ),
)

PARTS = (*_FACTORS, *_GRAPH, *_SOLVER, *_OUTPUT, *_GEOMETRY, *_SENSORS, *_STREAMING)
