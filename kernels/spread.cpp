// The variances of predicted residuals: trackfg.solver.variance_components.
#include <algorithm>
#include <vector>

#include "states.h"

// spread(rows (m, r, c + 1), first (m), last (m), columns (c), later (c), of_keyframes (n, K, d), of_shared (d - K, d - K),
// cross (n - 1, K, K), out (m, r)): the diagonals of J P J' of factors [J b] on keyframes `first` and `last`, which is the
// same or the next one. Column j of J is column columns[j] of a keyframe's tangent and the shared ones behind it; of the
// last keyframe where later[j] is true. P is given by the covariances of a keyframe's tangent with itself and the shared
// variables, that of these, and those of a keyframe's tangent with the next one's.
PyObject *spread(PyObject *, PyObject *arguments) {
    PyObject *py[9];
    if (!PyArg_ParseTuple(arguments, "OOOOOOOOO", &py[0], &py[1], &py[2], &py[3], &py[4], &py[5], &py[6], &py[7], &py[8]))
        return nullptr;
    const Doubles rows(py[0], 3), of_keyframes(py[5], 3), of_shared(py[6], 2), cross(py[7], 3), out(py[8], 2, true);
    const Integers first(py[1], 1), last(py[2], 1), columns(py[3], 1);
    const Flags later(py[4], 1);
    for (const Doubles *one : {&rows, &of_keyframes, &of_shared, &cross, &out})
        if (!one->ok()) return nullptr;
    if (!first.ok() || !last.ok() || !columns.ok() || !later.ok()) return nullptr;
    const std::ptrdiff_t m = rows.size(0), tall = rows.size(1), c = columns.size(0), n = of_keyframes.size(0);
    const std::ptrdiff_t shared = of_shared.size(0), d = KEYFRAME + shared;
    if (rows.size(2) != c + 1 || first.size(0) != m || last.size(0) != m || later.size(0) != c || out.size(0) != m ||
        out.size(1) != tall)
        return refused("factors");
    if (of_shared.size(1) != shared || of_keyframes.size(1) != KEYFRAME || of_keyframes.size(2) != d ||
        cross.size(0) + 1 != n || cross.size(1) != KEYFRAME || cross.size(2) != KEYFRAME)
        return refused("covariances");
    for (std::ptrdiff_t j = 0; j < c; ++j)
        if (columns.data()[j] < 0 || columns.data()[j] >= (later.data()[j] ? KEYFRAME : d)) return refused("columns");
    for (std::ptrdiff_t k = 0; k < m; ++k) {
        const std::int64_t begin = first.data()[k], end = last.data()[k];
        if (begin < 0 || end >= n || (end != begin && end != begin + 1)) return refused("keyframes");
    }
    std::vector<std::ptrdiff_t> used;
    for (std::ptrdiff_t k = 0; k < m; ++k) {
        const double *own = of_keyframes.data() + first.data()[k] * KEYFRAME * d;
        const double *next = of_keyframes.data() + last.data()[k] * KEYFRAME * d;
        const double *with_next = cross.data() + first.data()[k] * KEYFRAME * KEYFRAME;  // where it is not the last one
        const auto between = [&](std::ptrdiff_t i, std::ptrdiff_t j) {
            std::int64_t a = columns.data()[i], b = columns.data()[j];
            bool a_later = later.data()[i], b_later = later.data()[j];
            if (a >= KEYFRAME && b >= KEYFRAME) return of_shared.data()[(a - KEYFRAME) * shared + b - KEYFRAME];
            if (a >= KEYFRAME || (a_later && !b_later && b < KEYFRAME)) std::swap(a, b), std::swap(a_later, b_later);
            if (b >= KEYFRAME) return (a_later ? next : own)[a * d + b];
            if (b_later && !a_later && next != own) return with_next[a * KEYFRAME + b];
            return (a_later ? next : own)[a * d + b];
        };
        for (std::ptrdiff_t row = 0; row < tall; ++row) {
            const double *J = rows.data() + (k * tall + row) * (c + 1);
            used.clear();
            for (std::ptrdiff_t j = 0; j < c; ++j)
                if (J[j] != 0.0) used.push_back(j);
            double sum = 0.0;
            for (std::size_t i = 0; i < used.size(); ++i) {
                double with_others = 0.0;
                for (std::size_t j = i + 1; j < used.size(); ++j) with_others += J[used[j]] * between(used[i], used[j]);
                sum += J[used[i]] * (J[used[i]] * between(used[i], used[i]) + 2.0 * with_others);
            }
            out.data()[k * tall + row] = sum;
        }
    }
    Py_RETURN_NONE;
}
