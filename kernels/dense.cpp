// The smoothed motion between keyframes, at about the rate of the IMU: trackfg.output.dense_motion.
#include <algorithm>
#include <vector>

#include "samples.h"
#include "states.h"

namespace {

// In the order in which dense_motion.py writes them.
struct Setting {
    double gravity, earth_radius, earth_rate[3], gyro_bias[3], forward[3];
};
constexpr std::ptrdiff_t SETTING = sizeof(Setting) / sizeof(double);

// A row within an interval: the attitude relative to the interval's start before the row's samples, what these say of the
// velocity, their duration, the row's share of the interval's time, and what adds up before it.
struct Row {
    Matrix turned, R;
    Vector velocity, rate, faster, moved;
    double duration, share, travelled;
};

struct End {
    Matrix R;
    Vector p, v;
    double distance;
};

// The rows of one interval of `span` seconds between two keyframes, which it closes at.
WITH_VECTOR_UNITS
void follow(const Setting &setting, const End &start, const End &end, double span, std::vector<Row> &rows) {
    const Vector earth = vector(setting.earth_rate), forward = vector(setting.forward), mean = 0.5 * (start.v + end.v);
    const Vector turning = earth + (1.0 / setting.earth_radius) * Vector{{-mean[1], mean[0], 0.0}};
    Matrix turned = IDENTITY;
    for (Row &row : rows) {
        row.turned = turned;
        turned = turned * Rotation(row.duration * row.rate).exponential();
    }
    const auto frame = [&](double time) { return Rotation(-time * turning).exponential() * start.R; };
    const Vector closure = logarithm(transposed(frame(span) * turned) * end.R);
    const Vector down = {{0.0, 0.0, -setting.gravity}}, both = earth + turning;
    const Vector fall = down - cross(both, start.v), fall_later = down - cross(both, end.v) - fall;
    Vector faster = {{0, 0, 0}}, moved = {{0, 0, 0}};
    double travelled = 0.0;
    for (Row &row : rows) {
        row.R = frame(row.share * span) * row.turned * Rotation(row.share * closure).exponential();
        row.faster = faster, row.moved = moved, row.travelled = travelled;
        const double h = row.duration, middle = row.share + 0.5 * h / span;
        const Vector gained = row.R * row.velocity + h * (fall + middle * fall_later);
        const Vector step = h * (start.v + faster + 0.5 * gained);
        faster = faster + gained, moved = moved + step, travelled += dot(step, row.R * forward);
    }
    const Vector left_p = end.p - start.p - moved, left_v = end.v - start.v - faster;
    const double left_distance = end.distance - start.distance - travelled, left_speed = dot(left_v, end.R * forward);
    for (Row &row : rows) {  // the cubic with the required end values and slopes
        const double f = row.share, f2 = f * f, f3 = f2 * f, w = 3 * f2 - 2 * f3, u = span * (f3 - f2);
        const double w_rate = 6 * (f - f2) / span, u_rate = 3 * f2 - 2 * f;
        row.moved = start.p + row.moved + w * left_p + u * left_v;
        row.faster = start.v + row.faster + w_rate * left_p + u_rate * left_v;
        row.travelled = start.distance + row.travelled + w * left_distance + u * left_speed;
    }
}

}  // namespace

// dense_motion(edges (n + 1), gyro (n, 3), accel (n, 3), starts (m + 1), first (k + 1), setting, keyframes, rows): row i
// begins with sample starts[i], interval j with row first[j]. Of the k + 1 keyframes: time (k + 1), attitude (.., 3, 3),
// position, velocity (.., 3), distance (..) and bias (.., 6). Of the rows: time (m), attitude (m, 3, 3), position, velocity
// (m, 3), distance (m), body rate (m, 3), duration and fraction of the interval (m).
PyObject *dense_motion(PyObject *, PyObject *arguments) {
    PyObject *py[8];
    if (!PyArg_ParseTuple(arguments, "OOOOOOOO", &py[0], &py[1], &py[2], &py[3], &py[4], &py[5], &py[6], &py[7]))
        return nullptr;
    const Doubles edges(py[0], 1), gyro(py[1], 2), accel(py[2], 2), given(py[5], 1);
    const Integers starts(py[3], 1), first(py[4], 1);
    if (!edges.ok() || !gyro.ok() || !accel.ok() || !given.ok() || !starts.ok() || !first.ok()) return nullptr;
    const Arrays keyframes(py[6]);
    if (!keyframes.ok()) return nullptr;
    const Arrays out(py[7], true);
    if (!out.ok()) return nullptr;
    const std::ptrdiff_t n = gyro.size(0), m = starts.size(0) - 1, intervals = first.size(0) - 1;
    if (edges.size(0) != n + 1 || accel.size(0) != n || gyro.size(1) != 3 || accel.size(1) != 3) return refused("samples");
    if (given.size(0) != SETTING) return refused("settings");
    constexpr std::ptrdiff_t KEYFRAME_ARRAYS = 6, ROW_ARRAYS = 8;
    const std::ptrdiff_t of_keyframe[KEYFRAME_ARRAYS] = {1, 9, 3, 3, 1, 6}, of_row[ROW_ARRAYS] = {1, 9, 3, 3, 1, 3, 1, 1};
    if (keyframes.count() != KEYFRAME_ARRAYS || out.count() != ROW_ARRAYS) return refused("keyframes");
    for (std::ptrdiff_t i = 0; i < keyframes.count(); ++i)
        if (!keyframes.has(i, intervals + 1, of_keyframe[i])) return refused("keyframes");
    for (std::ptrdiff_t i = 0; i < out.count(); ++i)
        if (!out.has(i, m, of_row[i])) return refused("rows");
    const std::int64_t *sample = starts.data(), *row_of = first.data();
    if (intervals < 1 || row_of[0] != 0 || row_of[intervals] != m || !std::is_sorted(row_of, row_of + intervals + 1) ||
        m < 1 || sample[0] < 0 || sample[m] > n || !std::is_sorted(sample, sample + m + 1))
        return refused("intervals");
    const Setting &setting = *reinterpret_cast<const Setting *>(given.data());
    const Samples samples = {edges.data(), gyro.data(), accel.data(), nullptr, n};
    const auto end_at = [&](std::ptrdiff_t k) {
        return End{matrix(keyframes.data(1) + 9 * k), vector(keyframes.data(2) + 3 * k), vector(keyframes.data(3) + 3 * k),
                   keyframes.data(4)[k]};
    };
    const auto write = [&](std::ptrdiff_t i, std::ptrdiff_t row, const Vector &from) {
        std::copy(from.x, from.x + 3, out.data(i) + 3 * row);
    };
    Py_BEGIN_ALLOW_THREADS;
    std::vector<Row> rows;
    for (std::ptrdiff_t k = 0; k < intervals; ++k) {
        const double begin = keyframes.data(0)[k], span = keyframes.data(0)[k + 1] - begin, *bias = keyframes.data(5) + 6 * k;
        rows.resize(row_of[k + 1] - row_of[k]);
        for (std::ptrdiff_t i = row_of[k]; i < row_of[k + 1]; ++i) {
            Row &row = rows[i - row_of[k]];
            Vector rotation, velocity;
            compress_group(samples, sample[i], sample[i + 1], vector(setting.gyro_bias),
                           {&row.duration, rotation.x, velocity.x});
            row.rate = (1.0 / row.duration) * rotation - vector(bias + 3);
            row.velocity = velocity - row.duration * vector(bias);
            row.share = (samples.edges[sample[i]] - begin) / span;
        }
        follow(setting, end_at(k), end_at(k + 1), span, rows);
        for (std::ptrdiff_t i = row_of[k]; i < row_of[k + 1]; ++i) {
            const Row &row = rows[i - row_of[k]];
            out.data(0)[i] = samples.edges[sample[i]];
            std::copy(&row.R.x[0][0], &row.R.x[0][0] + 9, out.data(1) + 9 * i);
            write(2, i, row.moved), write(3, i, row.faster), write(5, i, row.rate);
            out.data(4)[i] = row.travelled, out.data(6)[i] = row.duration, out.data(7)[i] = row.share;
        }
    }
    Py_END_ALLOW_THREADS;
    Py_RETURN_NONE;
}
