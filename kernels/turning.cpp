// How a body turns and what it accelerates from sample to sample: trackfg.sensors.imu_intervals, without its arrays of
// rotations on the way.
#include <algorithm>

#include "arrays.h"
#include "rotations.h"
#include "samples.h"

namespace {

// Whether groups of samples begin one after the other within a record of so many.
bool in_order(const Integers &starts, std::ptrdiff_t samples) {
    const std::int64_t *at = starts.data();
    const std::ptrdiff_t count = starts.size(0);
    if (count < 1 || at[0] < 0 || at[count - 1] > samples) return false;
    return std::is_sorted(at, at + count);
}

Vector difference_times(const double *rate, const Vector &bias, double h) {
    return {{(rate[0] - bias[0]) * h, (rate[1] - bias[1]) * h, (rate[2] - bias[2]) * h}};
}

void write(double *to, const Vector &from) { std::copy(from.x, from.x + 3, to); }
void write(double *to, const Matrix &from) { std::copy(&from.x[0][0], &from.x[0][0] + 9, to); }

// The rotation vector of a mean of rotations, which is none itself: that of its quaternion of any length (Shepperd's
// method), as so3_log() in trackfg.numerics.rotations has it.
Vector mean_turn(const Matrix &R) {
    const double trace = R[0][0] + R[1][1] + R[2][2];
    double q[4] = {1 + trace, R[2][1] - R[1][2], R[0][2] - R[2][0], R[1][0] - R[0][1]};
    if (!(trace > 0)) {
        int best = 0;
        double squares[4] = {q[0]};
        for (int i = 0; i < 3; ++i) {
            squares[1 + i] = 1 + 2 * R[i][i] - trace;
            if (squares[1 + i] > squares[best]) best = 1 + i;
        }
        if (best > 0) {
            const int k = best - 1;
            q[0] = q[best];
            for (int i = 0; i < 3; ++i) q[1 + i] = i == k ? squares[best] : R[i][k] + R[k][i];
        }
    }
    const Vector axis = vector(q + 1);
    const double norm = std::sqrt(dot(axis, axis)), along = std::abs(q[0]);
    const double factor = norm < 1e-8 * along ? 2 / along : 2 * std::atan2(norm, along) / norm;
    return std::copysign(factor, q[0]) * axis;
}

}  // namespace

void compress_group(const Samples &samples, std::ptrdiff_t begin, std::ptrdiff_t end, const Vector &bias,
                    const Increment &increment) {
    const double *t = samples.edges;
    Matrix turned = IDENTITY;
    Vector sum = {{0.0, 0.0, 0.0}};
    for (std::ptrdiff_t i = begin; i < end; ++i) {
        const double h = t[i + 1] - t[i];
        const Vector turn = difference_times(samples.gyro + 3 * i, bias, h), force = h * vector(samples.accel + 3 * i);
        const Vector change = force + 0.5 * cross(turn, force);
        sum = sum + (i == begin ? change : turned * change);
        if (end - begin > 1) turned = turned * Rotation(turn).exponential();
    }
    *increment.duration = t[end] - t[begin];
    const Vector own = end - begin == 1 ? (t[end] - t[begin]) * vector(samples.gyro + 3 * begin)
                                        : logarithm(turned) + (t[end] - t[begin]) * bias;
    write(increment.rotation, own);
    write(increment.velocity, sum);
}

void follow_turn(const Samples &samples, std::ptrdiff_t begin, std::ptrdiff_t end, const Vector &bias,
                 const double *distance, double at_rest, const Turned &turning) {
    const double *t = samples.edges;
    const double span = t[end] - t[begin], length = distance[end] - distance[begin];
    const bool moves = std::abs(length) > at_rest;
    Matrix turned = IDENTITY, by_way = 0.0 * IDENTITY, by_time = 0.0 * IDENTITY;
    double before = 0.0;  // half the share of the sample before: the trapezoid rule
    for (std::ptrdiff_t i = begin; i < end; ++i) {
        const double h = t[i + 1] - t[i];
        const double half = 0.5 * (moves ? (distance[i + 1] - distance[i]) / length : h / span);
        const Matrix weighted = (before + half) * turned;
        by_way = by_way + weighted;
        by_time = by_time + ((t[i] - t[begin]) / span) * weighted;
        turned = turned * Rotation(difference_times(samples.gyro + 3 * i, bias, h)).exponential();
        before = half;
    }
    const Matrix last = before * turned;
    write(turning.turn, turned);
    write(turning.mean, by_way + last);
    write(turning.mean_by_time, by_time + last);
}

void ahead_of_steady(const double *turn, const double *mean, const double *mean_by_time, double least, double *ahead) {
    const Vector v = logarithm(matrix(turn));
    const Matrix late = matrix(mean_by_time);
    const double square = dot(v, v), trace = late[0][0] + late[1][1] + late[2][2];
    const double part = square > least * least ? dot(v, late * v) / square : trace / 3.0;
    write(ahead, mean_turn(matrix(mean)) + (-part) * v);
}

void mean_around(double time, double width, const double *t, const double *values, std::ptrdiff_t n, double *mean) {
    const auto within = [&](double at) { return std::min(std::max(at, t[0]), t[n]); };
    const double begin = within(time - 0.5 * width), end = within(time + 0.5 * width);
    Vector sum = {{0.0, 0.0, 0.0}};
    for (std::ptrdiff_t i = std::max<std::ptrdiff_t>(std::upper_bound(t, t + n, begin) - t - 1, 0); i < n && t[i] < end; ++i)
        sum = sum + (std::min(t[i + 1], end) - std::max(t[i], begin)) * vector(values + 3 * i);
    for (int axis = 0; axis < 3; ++axis) mean[axis] = sum[axis] / (end - begin);
}

// compress(edges (n + 1), gyro (n, 3), accel (n, 3), starts (m + 1), bias (3), duration (m), rotation (m, 3),
// velocity (m, 3)): the increments of groups of samples.
PyObject *compress(PyObject *, PyObject *arguments) {
    PyObject *py[8];
    if (!PyArg_ParseTuple(arguments, "OOOOOOOO", &py[0], &py[1], &py[2], &py[3], &py[4], &py[5], &py[6], &py[7]))
        return nullptr;
    const Doubles edges(py[0], 1), gyro(py[1], 2), accel(py[2], 2);
    if (!edges.ok() || !gyro.ok() || !accel.ok()) return nullptr;
    const Integers starts(py[3], 1);
    if (!starts.ok()) return nullptr;
    const Doubles gyro_bias(py[4], 1), duration(py[5], 1, true), rotation(py[6], 2, true), velocity(py[7], 2, true);
    if (!gyro_bias.ok() || !duration.ok() || !rotation.ok() || !velocity.ok()) return nullptr;
    const std::ptrdiff_t n = gyro.size(0), groups = duration.size(0);
    if (edges.size(0) != n + 1 || accel.size(0) != n || gyro.size(1) != 3 || accel.size(1) != 3 ||
        gyro_bias.size(0) != 3)
        return refused("samples");
    if (starts.size(0) != groups + 1 || rotation.size(0) != groups || velocity.size(0) != groups ||
        rotation.size(1) != 3 || velocity.size(1) != 3 || !in_order(starts, n))
        return refused("groups of samples");
    const Vector bias = vector(gyro_bias.data());
    const Samples samples = {edges.data(), gyro.data(), accel.data(), nullptr, n};
    Py_BEGIN_ALLOW_THREADS;
    for (std::ptrdiff_t g = 0; g < groups; ++g)
        compress_group(samples, starts.data()[g], starts.data()[g + 1], bias,
                       {duration.data() + g, rotation.data() + 3 * g, velocity.data() + 3 * g});
    Py_END_ALLOW_THREADS;
    Py_RETURN_NONE;
}

// turning(edges (n + 1), gyro (n, 3), keyframes (m + 1), bias (3), distance (n + 1), turn (m, 3, 3), mean (m, 3, 3),
// mean_by_time (m, 3, 3)): the attitude along each interval. Less than `at_rest` of distance is none.
PyObject *turning(PyObject *, PyObject *arguments) {
    PyObject *py[8];
    double at_rest;
    if (!PyArg_ParseTuple(arguments, "OOOOOdOOO", &py[0], &py[1], &py[2], &py[3], &py[4], &at_rest, &py[5], &py[6],
                          &py[7]))
        return nullptr;
    const Doubles edges(py[0], 1), gyro(py[1], 2);
    if (!edges.ok() || !gyro.ok()) return nullptr;
    const Integers keyframes(py[2], 1);
    if (!keyframes.ok()) return nullptr;
    const Doubles gyro_bias(py[3], 1), distance(py[4], 1), turn(py[5], 3, true), mean(py[6], 3, true),
        mean_by_time(py[7], 3, true);
    if (!gyro_bias.ok() || !distance.ok() || !turn.ok() || !mean.ok() || !mean_by_time.ok()) return nullptr;
    const std::ptrdiff_t n = gyro.size(0), intervals = turn.size(0);
    if (edges.size(0) != n + 1 || distance.size(0) != n + 1 || gyro.size(1) != 3 || gyro_bias.size(0) != 3)
        return refused("samples");
    if (keyframes.size(0) != intervals + 1 || turn.size(1) != 3 || turn.size(2) != 3 || mean.size(0) != intervals ||
        mean.size(1) != 3 || mean.size(2) != 3 || mean_by_time.size(0) != intervals || mean_by_time.size(1) != 3 ||
        mean_by_time.size(2) != 3 || !in_order(keyframes, n))
        return refused("intervals");
    const Vector bias = vector(gyro_bias.data());
    const Samples samples = {edges.data(), gyro.data(), nullptr, nullptr, n};
    Py_BEGIN_ALLOW_THREADS;
    for (std::ptrdiff_t k = 0; k < intervals; ++k)
        follow_turn(samples, keyframes.data()[k], keyframes.data()[k + 1], bias, distance.data(), at_rest,
                    {turn.data() + 9 * k, mean.data() + 9 * k, mean_by_time.data() + 9 * k});
    Py_END_ALLOW_THREADS;
    Py_RETURN_NONE;
}

// ahead_of_a_steady_turn(turn (m, 3, 3), mean (m, 3, 3), mean_by_time (m, 3, 3), least, ahead (m, 3)): see
// trackfg.factors.path. A turn by less than `least` has no axis.
PyObject *ahead_of_a_steady_turn(PyObject *, PyObject *arguments) {
    PyObject *py[4];
    double least;
    if (!PyArg_ParseTuple(arguments, "OOOdO", &py[0], &py[1], &py[2], &least, &py[3])) return nullptr;
    const Doubles turn(py[0], 3), mean(py[1], 3), mean_by_time(py[2], 3), ahead(py[3], 2, true);
    if (!turn.ok() || !mean.ok() || !mean_by_time.ok() || !ahead.ok()) return nullptr;
    const std::ptrdiff_t intervals = turn.size(0);
    for (const Doubles *one : {&turn, &mean, &mean_by_time})
        if (one->size(0) != intervals || one->size(1) != 3 || one->size(2) != 3) return refused("intervals");
    if (ahead.size(0) != intervals || ahead.size(1) != 3) return refused("intervals");
    for (std::ptrdiff_t k = 0; k < intervals; ++k)
        ahead_of_steady(turn.data() + 9 * k, mean.data() + 9 * k, mean_by_time.data() + 9 * k, least, ahead.data() + 3 * k);
    Py_RETURN_NONE;
}

// means_around(t (m), width, edges (n + 1), samples (n, 3), means (m, 3)): means over `width` around each time.
PyObject *means_around(PyObject *, PyObject *arguments) {
    PyObject *py[4];
    double width;
    if (!PyArg_ParseTuple(arguments, "OdOOO", &py[0], &width, &py[1], &py[2], &py[3])) return nullptr;
    const Doubles times(py[0], 1), edges(py[1], 1), samples(py[2], 2), means(py[3], 2, true);
    if (!times.ok() || !edges.ok() || !samples.ok() || !means.ok()) return nullptr;
    const std::ptrdiff_t n = samples.size(0), m = times.size(0);
    if (n < 1 || edges.size(0) != n + 1 || samples.size(1) != 3) return refused("samples");
    if (means.size(0) != m || means.size(1) != 3) return refused("times");
    Py_BEGIN_ALLOW_THREADS;
    for (std::ptrdiff_t k = 0; k < m; ++k)
        mean_around(times.data()[k], width, edges.data(), samples.data(), n, means.data() + 3 * k);
    Py_END_ALLOW_THREADS;
    Py_RETURN_NONE;
}

// interpolate_columns(at (m), t (n), values (n, c), out (m, c)): linearly, constant before the first and after the last time.
PyObject *interpolate_columns(PyObject *, PyObject *arguments) {
    PyObject *py[4];
    if (!PyArg_ParseTuple(arguments, "OOOO", &py[0], &py[1], &py[2], &py[3])) return nullptr;
    const Doubles at(py[0], 1), times(py[1], 1), values(py[2], 2), out(py[3], 2, true);
    if (!at.ok() || !times.ok() || !values.ok() || !out.ok()) return nullptr;
    const std::ptrdiff_t n = times.size(0), columns = values.size(1);
    if (n < 1 || values.size(0) != n) return refused("values");
    if (out.size(0) != at.size(0) || out.size(1) != columns) return refused("results");
    const double *t = times.data();
    for (std::ptrdiff_t i = 0; i < at.size(0); ++i) {
        const std::ptrdiff_t next = std::upper_bound(t, t + n, at.data()[i]) - t;
        const double *late = values.data() + std::min(next, n - 1) * columns;
        const double *early = values.data() + std::max<std::ptrdiff_t>(next - 1, 0) * columns;
        const double share = next > 0 && next < n ? (at.data()[i] - t[next - 1]) / (t[next] - t[next - 1]) : 0.0;
        for (std::ptrdiff_t c = 0; c < columns; ++c)
            out.data()[i * columns + c] = early[c] + share * (late[c] - early[c]);
    }
    Py_RETURN_NONE;
}
