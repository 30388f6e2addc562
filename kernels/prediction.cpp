// What the inertial samples of a stream's next interval measure, and the state that they predict at its end: the numbers of
// trackfg.streaming.window.predicted_motion.
#include <algorithm>
#include <vector>

#include "arrays.h"
#include "samples.h"
#include "states.h"

namespace {

constexpr int AXES = 3, CHANNELS = 6, RATE = 9, FORCE = 18, POWER = 24, EARTH = 27;  // where parts of IMU begin
constexpr double STANDARD_GRAVITY = 9.80665;  // trackfg.numerics.units

// In the order in which predicted_motion.py writes them.
struct Setting {
    double clearly, gravity, earth_rate[AXES], earth_radius, rate_s, at_rest, position_noise, lever_arm[AXES];
    double declared[CHANNELS], excess[CHANNELS], bridged[CHANNELS];
    double distance_sd, scale_walk, rolled_at_rest, arc_sd, arc_relative;
    double lateral_sd, vertical_sd, per_speed, motion_level, path_sd, path_relative, path_level, least_turn;
};
constexpr std::ptrdiff_t SETTING = sizeof(Setting) / sizeof(double);

// Numbers that go on beyond both ends as in mirrors, .. x_1 x_0 | x_0 x_1 .., as scipy.ndimage has them; their running sum.
class Mirrored {
  public:
    explicit Mirrored(std::ptrdiff_t count) : count_(count), before_(count + 1) {}

    template <typename Values>
    void take(const Values &value) {
        for (std::ptrdiff_t i = 0; i < count_; ++i) before_[i + 1] = before_[i] + value(i);
    }
    // The mean of `width` numbers around number i.
    double mean(std::ptrdiff_t i, std::ptrdiff_t width) const {
        const std::ptrdiff_t begin = i - width / 2;
        return (sum(begin + width) - sum(begin)) / static_cast<double>(width);
    }

  private:
    double sum(std::ptrdiff_t end) const {
        if (end >= 0 && end <= count_) return before_[end];
        const std::ptrdiff_t period = 2 * count_;
        std::ptrdiff_t times = end / period, rest = end % period;
        if (rest < 0) --times, rest += period;
        const double whole = before_[count_];
        return 2.0 * static_cast<double>(times) * whole + (rest <= count_ ? before_[rest] : 2.0 * whole - before_[period - rest]);
    }
    std::ptrdiff_t count_;
    std::vector<double> before_;
};

// The samples from `begin` to `end`, which the interval has, of all that are given.
struct Span {
    const Samples &samples;
    std::ptrdiff_t begin, end;

    double seconds() const { return samples.edges[end] - samples.edges[begin]; }

    template <typename Values>
    double mean(const Values &value) const {
        double sum = 0.0;
        for (std::ptrdiff_t i = begin; i < end; ++i) sum += value(i) * (samples.edges[i + 1] - samples.edges[i]);
        return sum / seconds();
    }
    // The power of the vibration along an axis: of what is faster than means of `fast` samples, over `lasting` ones.
    double vibration(int axis, std::ptrdiff_t fast, std::ptrdiff_t lasting) const {
        const auto force = [&](std::ptrdiff_t i) { return samples.accel[AXES * i + axis]; };
        Mirrored slow(samples.count), power(samples.count);
        slow.take(force);
        power.take([&](std::ptrdiff_t i) {
            const double shaking = force(i) - slow.mean(i, fast);
            return shaking * shaking;
        });
        return mean([&](std::ptrdiff_t i) { return power.mean(i, lasting); });
    }
};

// The derivative (BIAS, IMU) of the bias by the calibration: response_terms() in trackfg.factors.bias.
void respond(const double *force, const double *rate, const double *power, const Matrix &R, const Vector &v, double *out) {
    std::fill_n(out, BIAS * IMU, 0.0);
    const Vector coriolis[2] = {{{0.0, -2.0 * v[2], 2.0 * v[1]}}, {{2.0 * v[2], 0.0, -2.0 * v[0]}}};
    for (int axis = 0; axis < AXES; ++axis) {
        double *accel = out + IMU * axis, *gyro = out + IMU * (AXES + axis);
        for (int i = 0; i < 2; ++i) accel[EARTH + i] = dot(column(R, axis), coriolis[i]);
        for (int i = 0; i < 2; ++i) {
            gyro[FORCE + 2 * axis + i] = force[i];
            gyro[EARTH + i] = R[i][axis];
        }
        for (int i = 0; i < AXES; ++i) {
            accel[AXES * axis + i] = force[i] - (i == 2 ? STANDARD_GRAVITY : 0.0);
            gyro[RATE + AXES * axis + i] = rate[i];
        }
        accel[POWER + axis] = power[axis];
    }
}

}  // namespace

// predict_interval(edges (n + 1), gyro (n, 3), accel (n, 3), bridged (n), layout, dt, setting, limits, states, results): the
// interval of the samples from layout[0] to layout[1], noise blocks of layout[2] samples, the widths layout[3] and [4] of
// vibration, increments of layout[5] samples, which usually take `dt`, s; `setting` as above, `limits` of the noise; `states` of one keyframe, which it
// begins at, as States.arrays has them. Results: means of accelerometer, gyro and vibration (3, 3); response (6, 29); bias
// and density of the noise (2, 6); increments (m, 7): durations (m), then rotations (m, 3), then velocities (m, 3); gravity
// and the frame's rate (4); delta; state at the end (15); distance, speeds at the first and last edge, how far
// the vehicle moves and turns, the mean forward force in g, and the speed at the end (7); distance
// rolled at the edges (n + 1); turns (3, 3, 3); body rates (2, 3); how far these are ahead of a steady turn (3); sigmas of
// the distance chain (2), the arc length, the path (2) and the sideways velocity (2), and of this the speed and the growth (2).
PyObject *predict_interval(PyObject *, PyObject *arguments) {
    PyObject *py[8];
    Py_ssize_t begin, end, length, fast, lasting, group;
    double dt;
    if (!PyArg_ParseTuple(arguments, "OOOO(nnnnnn)dOOOO", &py[0], &py[1], &py[2], &py[3], &begin, &end, &length, &fast,
                          &lasting, &group, &dt, &py[4], &py[5], &py[6], &py[7]))
        return nullptr;
    const Doubles edges(py[0], 1), gyro(py[1], 2), accel(py[2], 2);
    if (!edges.ok() || !gyro.ok() || !accel.ok()) return nullptr;
    const Flags bridged(py[3], 1);
    const Doubles given(py[4], 1), limits(py[5], 1);
    if (!bridged.ok() || !given.ok() || !limits.ok()) return nullptr;
    const std::ptrdiff_t n = bridged.size(0);
    if (edges.size(0) != n + 1 || gyro.size(0) != n || accel.size(0) != n || gyro.size(1) != AXES || accel.size(1) != AXES)
        return refused("samples");
    if (begin < 0 || begin >= end || end > n || length < 0 || length > n || (length & (length - 1)) != 0 ||
        (length > 0 && length < SHORTEST_BLOCK) || fast < 1 || lasting < 1 || group < 1)
        return refused("the interval");
    if (given.size(0) != SETTING || limits.size(0) != NOISE_LIMITS) return refused("settings");
    const Setting &setting = *reinterpret_cast<const Setting *>(given.data());
    const Arrays arrays(py[6]);
    if (!arrays.ok()) return nullptr;
    const Values values(arrays);
    if (!values.ok || !values.of_one_run() || values.count[OF_NAV] != 1) return refused("states");
    const std::ptrdiff_t m = (end - begin + group - 1) / group;
    const std::ptrdiff_t sizes[] = {9, BIAS * IMU, 2 * BIAS, 7 * m, 4, DELTA_SIZE, 15, 7, n + 1, 27, 6, 3, 10};
    constexpr std::ptrdiff_t RESULTS = std::size(sizes);
    const Arrays results(py[7], true);
    if (!results.ok()) return nullptr;
    if (results.count() != RESULTS) return refused("results");
    for (std::ptrdiff_t i = 0; i < RESULTS; ++i)
        if (results.total(i) != sizes[i]) return refused("results");
    double *means = results.data(0), *response = results.data(1), *bias = results.data(2), *noise = bias + BIAS;
    double *frame = results.data(4), *state = results.data(6), *motion = results.data(7), *rolled = results.data(8);

    const Samples samples = {edges.data(), gyro.data(), accel.data(), bridged.data(), n};
    const Span span = {samples, begin, end};
    const double *t = samples.edges, seconds = span.seconds();
    const NavState nav = values.nav(0);
    double *own_bias = values.value[OF_BIAS], rate[AXES];
    Vector force;  // less its bias
    for (int axis = 0; axis < AXES; ++axis) {
        means[axis] = span.mean([&](std::ptrdiff_t i) { return samples.accel[AXES * i + axis]; });
        means[AXES + axis] = span.mean([&](std::ptrdiff_t i) { return samples.gyro[AXES * i + axis]; });
        means[2 * AXES + axis] = span.vibration(axis, fast, lasting);
        rate[axis] = means[AXES + axis] - own_bias[AXES + axis];
        force.x[axis] = means[axis] - own_bias[axis];
    }
    const Vector middle = nav.v + 0.5 * seconds * (nav.R * force - Vector{{0.0, 0.0, setting.gravity}});
    respond(means, rate, means + 2 * AXES, nav.R, middle, response);
    for (int i = 0; i < BIAS; ++i) {
        bias[i] = own_bias[i];
        for (int j = 0; j < IMU; ++j) bias[i] += response[IMU * i + j] * values.value[OF_IMU][j];
    }
    const Vector gyro_bias = vector(bias + AXES), arm = vector(setting.lever_arm);

    const NoiseRule rule = {setting.declared, setting.excess, limits.data(), setting.clearly};
    const double ends[2] = {t[begin], t[end]};
    noise_between(samples, length, dt, rule, ends, 1, noise);
    for (int i = 0; i < CHANNELS; ++i) noise[i] = std::sqrt(noise[i]);
    double assumed[CHANNELS + 1];
    for (int i = 0; i < CHANNELS; ++i) {
        const double density = bridged.data()[begin] ? setting.bridged[i] : noise[i];
        assumed[i] = density * density;
    }
    assumed[CHANNELS] = setting.position_noise * setting.position_noise;

    const Increment first = {results.data(3), results.data(3) + m, results.data(3) + 4 * m};
    for (std::ptrdiff_t k = 0; k < m; ++k)
        compress_group(samples, begin + k * group, std::min(begin + (k + 1) * group, end), gyro_bias,
                       {first.duration + k, first.rotation + AXES * k, first.velocity + AXES * k});
    // GTSAM's Coriolis term counts the vehicle's turning over the Earth's curvature twice: v^2 / radius upwards.
    frame[0] = setting.gravity + (nav.v[0] * nav.v[0] + nav.v[1] * nav.v[1]) / setting.earth_radius;
    for (int i = 0; i < AXES; ++i) frame[1 + i] = setting.earth_rate[i];
    frame[1] -= nav.v[1] / setting.earth_radius, frame[2] += nav.v[0] / setting.earth_radius;
    if (!preintegrated(frame, bias, assumed, m, first, results.data(5))) return not_positive_definite();
    predicted_state(results.data(5), &nav.R.x[0][0], nav.p.x, nav.v.x, bias, state);

    // A speed that changes evenly over the interval and covers its distance.
    const Matrix R = matrix(state);
    const Vector chord = (vector(state + 9) - R * arm) - (nav.p - nav.R * arm);
    const Vector forward = 0.5 * (column(nav.R, 0) + column(R, 0));
    const double slow = dot(nav.v, column(nav.R, 0)), faster = dot(vector(state + 12), column(R, 0));
    motion[0] = std::copysign(std::sqrt(dot(chord, chord)), dot(chord, forward));
    const auto speed_at = [&](double time) {
        return slow + (faster - slow) * (time - t[begin]) / seconds + motion[0] / seconds - 0.5 * (slow + faster);
    };
    motion[1] = speed_at(t[0]), motion[2] = speed_at(t[n]);
    rolled[0] = 0.0;
    for (std::ptrdiff_t i = 0; i < n; ++i)
        rolled[i + 1] = rolled[i] + 0.5 * (speed_at(t[i]) + speed_at(t[i + 1])) * (t[i + 1] - t[i]);
    motion[3] = rolled[end] - rolled[begin], motion[4] = (means[AXES + 2] - gyro_bias[2]) * seconds, motion[5] = means[0] / setting.gravity;
    motion[6] = speed_at(t[end]);
    double *turns = results.data(9), *rates = results.data(10);
    follow_turn(samples, begin, end, gyro_bias, rolled, setting.at_rest, {turns, turns + 9, turns + 18});
    for (int k = 0; k < 2; ++k) {
        mean_around(t[k == 0 ? begin : end], setting.rate_s, t, samples.gyro, n, rates + AXES * k);
        for (int axis = 0; axis < AXES; ++axis) rates[AXES * k + axis] -= gyro_bias[axis];
    }
    ahead_of_steady(turns, turns + 9, turns + 18, setting.least_turn, results.data(11));

    // The sigmas of trackfg.graph.odometry and trackfg.graph.motion.
    double *sigmas = results.data(12);
    const double way = std::abs(motion[3]), bridge = way * std::sqrt(seconds / 12.0);
    const double of_path = (setting.path_sd + setting.path_relative * way) * setting.path_level;
    const double by_speed = setting.per_speed * std::abs(motion[6]);
    sigmas[0] = setting.distance_sd;
    sigmas[1] = setting.scale_walk * std::sqrt(way + setting.rolled_at_rest);
    sigmas[2] = setting.arc_sd + setting.arc_relative * way;
    for (int i = 0; i < 2; ++i) sigmas[3 + i] = std::hypot(of_path, noise[2 - i] * bridge);  // about z, then about y
    const double declared[2] = {setting.lateral_sd + by_speed, setting.vertical_sd + by_speed};
    sigmas[7] = std::abs(motion[6]);
    for (int i = 0; i < 2; ++i) {
        sigmas[5 + i] = declared[i] * setting.motion_level;
        sigmas[8 + i] = setting.per_speed / declared[i];
    }
    Py_RETURN_NONE;
}
