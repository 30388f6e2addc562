// Elimination of a chain of keyframes by Householder reflections, as trackfg/solver/elimination.py describes it.
//
// The matrix of a keyframe is kept by rows. A reflection is applied as w = v'A, A -= v w, row by row, and only to rows
// whose entry in its column is not zero: what is carried from the keyframe before is a triangle already, and a factor
// touches few of the columns. (Golub and Van Loan, "Matrix Computations", 4th ed., 5.1 and 5.2.)
#include <cmath>
#include <vector>

#include "arrays.h"

namespace {

// How windows are laid out: see trackfg.solver.elimination.
struct Layout {
    std::ptrdiff_t keyframe, nav_start, nav, tail;

    std::ptrdiff_t pair() const { return 2 * keyframe; }

    // Column in the window of the next keyframe, of width `next`, of column `c` behind x_k in one of width `width`.
    std::ptrdiff_t in_next(std::ptrdiff_t c, std::ptrdiff_t width, std::ptrdiff_t next) const {
        if (c < keyframe) return c;
        const std::ptrdiff_t beyond = width - pair();
        if (c >= keyframe + beyond) return next + c - keyframe - beyond;
        return c - keyframe < nav ? keyframe + nav_start + c - keyframe : pair() + c - keyframe - nav;
    }
};

// Add `v[i] * row_i` of some rows to `sum` (n,), four rows at a time.
inline void add_rows(double *sum, const double *const *rows, const double *v, std::ptrdiff_t count, std::ptrdiff_t n) {
    std::ptrdiff_t i = 0;
    for (; i + 4 <= count; i += 4) {
        const double *a = rows[i], *b = rows[i + 1], *c = rows[i + 2], *d = rows[i + 3];
        const double va = v[i], vb = v[i + 1], vc = v[i + 2], vd = v[i + 3];
        for (std::ptrdiff_t j = 0; j < n; ++j) sum[j] += (va * a[j] + vb * b[j]) + (vc * c[j] + vd * d[j]);
    }
    for (; i < count; ++i)
        for (std::ptrdiff_t j = 0; j < n; ++j) sum[j] += v[i] * rows[i][j];
}

// Make the first `pivots` columns of A (rows, columns) zero below the diagonal.
WITH_VECTOR_UNITS
void triangularise(double *A, std::ptrdiff_t rows, std::ptrdiff_t columns, std::ptrdiff_t pivots, double **touched,
                   double *v, double *w) {
    for (std::ptrdiff_t j = 0; j < pivots && j < rows; ++j) {
        double *pivot = A + j * columns, below = 0.0;
        std::ptrdiff_t count = 1;
        for (std::ptrdiff_t i = j + 1; i < rows; ++i) {
            const double entry = A[i * columns + j];
            if (entry == 0.0) continue;
            touched[count] = A + i * columns + j + 1;
            v[count++] = entry;
            below += entry * entry;
        }
        if (count == 1) continue;  // zero below the diagonal already
        const double length = std::copysign(std::sqrt(pivot[j] * pivot[j] + below), pivot[j]);
        touched[0] = pivot + j + 1;
        v[0] = pivot[j] + length;
        const std::ptrdiff_t n = columns - j - 1;
        for (std::ptrdiff_t c = 0; c < n; ++c) w[c] = 0.0;
        add_rows(w, touched, v, count, n);
        const double factor = 1.0 / (length * v[0]);  // 2 / v'v
        for (std::ptrdiff_t c = 0; c < n; ++c) w[c] *= factor;
        for (std::ptrdiff_t i = 0; i < count; ++i) {
            const double vi = v[i];
            double *row = touched[i];
            for (std::ptrdiff_t c = 0; c < n; ++c) row[c] -= vi * w[c];
            row[-1] = 0.0;
        }
        pivot[j] = -length;
    }
}

// Write R, S and d of a keyframe, with a positive diagonal. False where its triangle is singular.
bool write_conditional(const double *A, std::ptrdiff_t width, const Layout &at, double indeterminate, double *R,
                       double *S, std::ptrdiff_t S_columns, double *d) {
    const std::ptrdiff_t K = at.keyframe, shared = at.tail - 1, columns = width + at.tail;
    for (std::ptrdiff_t i = 0; i < K; ++i) {
        const double *row = A + i * columns, sign = std::copysign(1.0, row[i]);
        double length = 0.0;
        for (std::ptrdiff_t j = i; j < K; ++j) length += row[j] * row[j];
        if (!(std::abs(row[i]) > indeterminate * std::sqrt(length))) return false;
        for (std::ptrdiff_t j = i; j < K; ++j) R[i * K + j] = sign * row[j];
        double *out = S + i * S_columns;
        for (std::ptrdiff_t j = 0; j < K; ++j) out[j] = sign * row[K + j];
        for (std::ptrdiff_t j = 0; j < shared; ++j) out[K + j] = sign * row[width + j];
        for (std::ptrdiff_t j = at.pair(); j < width; ++j) out[K + shared + j - at.pair()] = sign * row[j];
        d[i] = sign * row[columns - 1];
    }
    return true;
}

}  // namespace

// eliminate(rows, starts, widths, (nav_start, nav_dim), indeterminate, left, R, S, d, alone) -> (left rows, alone rows)
//
// rows (m, widest + tail): of n keyframes, those of keyframe k from starts[k] to starts[k + 1]; widths (n + 2,): of the
// windows of the keyframe before the first, of the n, and of the one after, which is 0 where the chain ends. left
// (rows, ...): what the keyframe before left over, as many of its rows as left_rows, overwritten by what is left over
// in the end. R (n, K, K), S (n, K, ...) and d (n, K) come zeroed; alone (rows, tail) takes rows of the shared variables
// alone. None where the rows do not determine a keyframe.
PyObject *eliminate(PyObject *, PyObject *arguments) {
    PyObject *py_rows, *py_starts, *py_widths, *py_left, *py_R, *py_S, *py_d, *py_alone;
    Py_ssize_t nav_start, nav, left_rows;
    double indeterminate;
    if (!PyArg_ParseTuple(arguments, "OOO(nn)dOnOOOO", &py_rows, &py_starts, &py_widths, &nav_start, &nav,
                          &indeterminate, &py_left, &left_rows, &py_R, &py_S, &py_d, &py_alone))
        return nullptr;
    const Doubles rows(py_rows, 2);
    const Integers starts(py_starts, 1), widths(py_widths, 1);
    const Doubles left(py_left, 1, true), R(py_R, 3, true), S(py_S, 3, true), d(py_d, 2, true), alone(py_alone, 2, true);
    if (!rows.ok() || !starts.ok() || !widths.ok() || !left.ok() || !R.ok() || !S.ok() || !d.ok() || !alone.ok())
        return nullptr;
    const std::ptrdiff_t n = R.size(0);
    const Layout at{R.size(1), nav_start, nav, alone.size(1)};
    const std::ptrdiff_t K = at.keyframe, tail = at.tail;
    if (starts.size(0) != n + 1 || widths.size(0) != n + 2 || S.size(0) != n || S.size(1) != K || d.size(0) != n ||
        d.size(1) != K || R.size(2) != K || tail < 1 || nav_start < 0 || nav < 1 || nav > K - nav_start)
        return refused("keyframes");
    const std::int64_t *start = starts.data(), *width = widths.data() + 1;
    std::ptrdiff_t tallest = 0, widest = at.pair();
    for (std::ptrdiff_t k = -1; k <= n; ++k) {
        const bool inside = k >= 0 && k < n, end_of_chain = k == n && width[k] == 0;
        if (!end_of_chain && (width[k] < at.pair() || (width[k] - at.pair()) % nav != 0)) return refused("widths");
        if (k >= 0 && width[k] < width[k - 1] - nav && !end_of_chain) return refused("widths of neighbours");
        widest = width[k] > widest ? width[k] : widest;
        if (!inside) continue;
        if (start[k] < 0 || start[k + 1] < start[k] || start[k + 1] > rows.size(0)) return refused("starts");
        if (width[k] > rows.size(1) - tail || width[k] > S.size(2) + K - tail + 1) return refused("columns");
        const std::ptrdiff_t tall = start[k + 1] - start[k];
        tallest = tall > tallest ? tall : tallest;
    }
    const std::ptrdiff_t most_left = widest - K;
    if (left_rows < 0 || left_rows > most_left || most_left > left.total() ||
        left.total() < most_left * (most_left + tail))
        return refused("rows left over");
    if (alone.size(0) < rows.size(0) + left_rows) return refused("rows alone");

    bool determined = true;
    std::ptrdiff_t alone_rows = 0;
    Py_BEGIN_ALLOW_THREADS;
    const std::ptrdiff_t most_rows = most_left + tallest;
    std::vector<double> A(most_rows * (widest + tail)), v(most_rows + 1), w(widest + tail);
    std::vector<double *> touched(most_rows + 1);
    for (std::ptrdiff_t k = 0; k < n && determined; ++k) {
        const std::ptrdiff_t columns = width[k] + tail, own = start[k + 1] - start[k], total = left_rows + own;
        const std::ptrdiff_t left_columns = width[k - 1] - K + tail;
        std::memset(A.data(), 0, left_rows * columns * sizeof(double));
        for (std::ptrdiff_t i = 0; i < left_rows; ++i)
            for (std::ptrdiff_t c = 0; c < left_columns; ++c)
                A[i * columns + at.in_next(c, width[k - 1], width[k])] = left.data()[i * left_columns + c];
        for (std::ptrdiff_t i = 0; i < own; ++i)
            std::memcpy(&A[(left_rows + i) * columns], rows.data() + (start[k] + i) * rows.size(1),
                        columns * sizeof(double));
        const std::ptrdiff_t pivots = width[k + 1] == 0 ? K : width[k];  // behind the last keyframe nothing is carried
        triangularise(A.data(), total, columns, pivots, touched.data(), v.data(), w.data());
        determined = total >= K && write_conditional(A.data(), width[k], at, indeterminate, R.data() + k * K * K,
                                                     S.data() + k * K * S.size(2), S.size(2), d.data() + k * K);
        if (!determined) break;
        const std::ptrdiff_t end = total < pivots ? total : pivots;
        left_rows = end - K;
        for (std::ptrdiff_t i = 0; i < left_rows; ++i)
            std::memcpy(left.data() + i * (columns - K), &A[(K + i) * columns + K], (columns - K) * sizeof(double));
        for (std::ptrdiff_t i = end; i < total; ++i)
            std::memcpy(alone.data() + tail * alone_rows++, &A[i * columns + width[k]], tail * sizeof(double));
    }
    Py_END_ALLOW_THREADS;
    if (!determined) Py_RETURN_NONE;
    return Py_BuildValue("nn", left_rows, alone_rows);
}
