// Samples at any places brought to a uniform step: trackfg.geometry.resampling.
#include <algorithm>
#include <vector>

#include "arrays.h"

namespace {

// Rows of numbers at `count` nodes, node after node (count, rows).
struct AtNodes {
    std::ptrdiff_t count, rows;
    std::vector<double> value, velocity;
};

// The means of the samples of each node, moved along the local slope from their mean place to the node.
WITH_VECTOR_UNITS
void find_values(const std::int64_t *edges, const double *mean, const double *place, const double *samples,
                 std::ptrdiff_t total, AtNodes &nodes) {
    const std::ptrdiff_t n = nodes.count, rows = nodes.rows;
    std::vector<double> means(n * rows);
    for (std::ptrdiff_t row = 0; row < rows; ++row)
        for (std::ptrdiff_t i = 0; i < n; ++i) {
            double sum = 0.0;
            for (std::int64_t j = edges[i]; j < edges[i + 1]; ++j) sum += samples[row * total + j];
            means[i * rows + row] = sum / static_cast<double>(edges[i + 1] - edges[i]);
        }
    for (std::ptrdiff_t i = 0; i < n; ++i) {
        const std::ptrdiff_t k = std::clamp<std::ptrdiff_t>(i, 1, n - 2);
        const double *before = &means[(k - 1) * rows], *after = &means[(k + 1) * rows], *own = &means[i * rows];
        const double way = mean[k + 1] - mean[k - 1], off = place[i] - mean[i];
        for (std::ptrdiff_t row = 0; row < rows; ++row)
            nodes.value[i * rows + row] = own[row] + (after[row] - before[row]) / way * off;
    }
}

// The velocities of the spline through the values: spline_velocities() in trackfg.numerics.hermite.
WITH_VECTOR_UNITS
void find_velocities(const double *place, AtNodes &nodes) {
    const std::ptrdiff_t n = nodes.count, rows = nodes.rows;
    const double *value = nodes.value.data();
    double *out = nodes.velocity.data();
    std::vector<double> upper(n);
    const auto length = [&](std::ptrdiff_t i) { return place[i + 1] - place[i]; };
    const auto slope = [&](std::ptrdiff_t i, std::ptrdiff_t row) {
        return (value[(i + 1) * rows + row] - value[i * rows + row]) / length(i);
    };
    for (std::ptrdiff_t i = 0; i < n; ++i) {
        // The row of node i is below * velocity before + own * velocity + above * velocity after.
        double below = 0.0, own, above = 0.0, first, second;
        std::ptrdiff_t k = i - 1;
        if (i == 0) {
            const double T = length(0), next = length(1), both = T + next;
            own = next, above = both, first = (T + 2.0 * both) * next / both, second = T * T / both, k = 0;
        } else if (i == n - 1) {
            const double T = length(n - 2), next = length(n - 3), both = T + next;
            below = both, own = next, first = T * T / both, second = (T + 2.0 * both) * next / both, k = n - 3;
        } else {
            const double T = length(i - 1), next = length(i);
            below = next, own = 2.0 * (T + next), above = T, first = 3.0 * next, second = 3.0 * T;
        }
        const double pivot = own - (i > 0 ? below * upper[i - 1] : 0.0);
        upper[i] = above / pivot;
        for (std::ptrdiff_t row = 0; row < rows; ++row) {
            const double right = first * slope(k, row) + second * slope(k + 1, row);
            out[i * rows + row] = (right - (i > 0 ? below * out[(i - 1) * rows + row] : 0.0)) / pivot;
        }
    }
    for (std::ptrdiff_t i = n - 2; i >= 0; --i)
        for (std::ptrdiff_t row = 0; row < rows; ++row) out[i * rows + row] -= upper[i] * out[(i + 1) * rows + row];
}

// The cubics between the nodes at cells (rows, count) from number `start` on; beyond the ends as there.
WITH_VECTOR_UNITS
void evaluate(const double *place, const AtNodes &nodes, std::ptrdiff_t start, double cell, double *out,
              std::ptrdiff_t count) {
    const std::ptrdiff_t n = nodes.count, rows = nodes.rows;
    std::ptrdiff_t k = 0;
    for (std::ptrdiff_t i = 0; i < count; ++i) {
        const double t = std::clamp(static_cast<double>(start + i) * cell, place[0], place[n - 1]);
        while (k < n - 2 && place[k + 1] <= t) ++k;
        const double T = place[k + 1] - place[k], f = (t - place[k]) / T, f2 = f * f, f3 = f2 * f;
        const double w1 = 3.0 * f2 - 2.0 * f3, w0 = 1.0 - w1, u0 = T * (f - 2.0 * f2 + f3), u1 = T * (f3 - f2);
        const double *value = &nodes.value[k * rows], *velocity = &nodes.velocity[k * rows];
        for (std::ptrdiff_t row = 0; row < rows; ++row)
            out[row * count + i] =
                value[row] * w0 + value[rows + row] * w1 + velocity[row] * u0 + velocity[rows + row] * u1;
    }
}

// Every `step`-th number of the low-pass of a row, where it fits.
WITH_VECTOR_UNITS
void decimate(const double *row, const double *taps, std::ptrdiff_t width, std::ptrdiff_t step, double *out,
              std::ptrdiff_t count) {
    constexpr std::ptrdiff_t LANES = 8;
    for (std::ptrdiff_t i = 0; i < count; ++i) {
        const double *from = row + i * step;
        double sums[LANES] = {}, total = 0.0;
        std::ptrdiff_t j = 0;
        for (; j + LANES <= width; j += LANES)
            for (std::ptrdiff_t lane = 0; lane < LANES; ++lane) sums[lane] += taps[j + lane] * from[j + lane];
        for (; j < width; ++j) total += taps[j] * from[j];
        for (const double sum : sums) total += sum;
        out[i] = total;
    }
}

}  // namespace

// resample(edges (n + 1), mean (n), place (n), samples (r, m), start, cell, step, taps (w), out (r, steps)): node i stands for
// the samples from edges[i] on, whose mean place is mean[i]; `place` ascend. The spline through the nodes at cells from number
// `start` on, low-passed by `taps`, an odd number, at every `step`-th cell.
PyObject *resample(PyObject *, PyObject *arguments) {
    PyObject *py[6];
    Py_ssize_t start, step;
    double cell;
    if (!PyArg_ParseTuple(arguments, "OOOOndnOO", &py[0], &py[1], &py[2], &py[3], &start, &cell, &step, &py[4], &py[5]))
        return nullptr;
    const Integers edges(py[0], 1);
    const Doubles mean(py[1], 1), place(py[2], 1), samples(py[3], 2), taps(py[4], 1), out(py[5], 2, true);
    if (!edges.ok() || !mean.ok() || !place.ok() || !samples.ok() || !taps.ok() || !out.ok()) return nullptr;
    const std::ptrdiff_t n = place.size(0), rows = samples.size(0), total = samples.size(1), steps = out.size(1);
    if (n < 4 || edges.size(0) != n + 1 || mean.size(0) != n || edges.data()[0] != 0 || edges.data()[n] != total)
        return refused("nodes");
    for (std::ptrdiff_t i = 0; i < n; ++i)
        if (edges.data()[i] >= edges.data()[i + 1]) return refused("nodes");
    if (step < 1 || steps < 1 || taps.size(0) % 2 == 0 || out.size(0) != rows) return refused("steps");
    Py_BEGIN_ALLOW_THREADS;
    AtNodes nodes{n, rows, std::vector<double>(n * rows), std::vector<double>(n * rows)};
    find_values(edges.data(), mean.data(), place.data(), samples.data(), total, nodes);
    find_velocities(place.data(), nodes);
    const std::ptrdiff_t width = taps.size(0), cells = (steps - 1) * step + width;
    std::vector<double> fine(rows * cells);
    evaluate(place.data(), nodes, start, cell, fine.data(), cells);
    for (std::ptrdiff_t row = 0; row < rows; ++row)
        decimate(&fine[row * cells], taps.data(), width, step, out.data() + row * steps, steps);
    Py_END_ALLOW_THREADS;
    Py_RETURN_NONE;
}
