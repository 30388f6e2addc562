// Elimination of a chain of keyframes by Householder reflections, as trackfg/solver/elimination.py describes it.
//
// Factors are read where they are: the matrix of a keyframe is made of what the one before left over and of its own
// rows, one keyframe after the other.
#include <algorithm>
#include <cmath>
#include <deque>
#include <vector>

#include "arrays.h"
#include "reflections.h"

namespace {

// How windows are laid out: see trackfg.solver.elimination.
struct Layout {
    std::ptrdiff_t keyframe, nav_start, nav, tail;

    std::ptrdiff_t pair() const { return 2 * keyframe; }

    // Copy a row over what is behind x_k in a window of `width` to its columns in that of the next keyframe, of width `next`.
    void to_next(const double *from, std::ptrdiff_t width, double *to, std::ptrdiff_t next) const {
        const std::ptrdiff_t beyond = width - pair(), nearest = beyond < nav ? beyond : nav;
        std::copy_n(from, keyframe, to);
        std::copy_n(from + keyframe, nearest, to + keyframe + nav_start);
        std::copy_n(from + keyframe + nearest, beyond - nearest, to + pair());
        std::copy_n(from + keyframe + beyond, tail, to + next);
    }
};

// Factors of a family, in order of their first keyframes: see `eliminate` below.
struct Family {
    Family(PyObject *rows_, PyObject *first_, PyObject *places_, PyObject *dims_)
        : rows(rows_, 3), first(first_, 1), places(places_, 2), dims(dims_, 1) {}

    bool ok() const { return rows.ok() && first.ok() && places.ok() && dims.ok(); }

    // Take the factors whose first keyframe is one from `begin` to before `end`, with windows of `width`. Returns whether
    // the arrays belong together and each of these factors lies in the window of its first keyframe.
    bool take(std::ptrdiff_t begin, std::ptrdiff_t end, const std::int64_t *width, std::ptrdiff_t shared) {
        const std::ptrdiff_t count = rows.size(0), slots = dims.size(0);
        if (rows.size(1) < 1 || first.size(0) != count || places.size(0) != count || places.size(1) != slots) return false;
        if (!std::is_sorted(first.data(), first.data() + count) || (count > 0 && first.data()[0] < 0)) return false;
        std::int64_t columns = 1;
        for (std::ptrdiff_t s = 0; s < slots; ++s) {
            if (dims.data()[s] < 1 || dims.data()[s] > rows.size(2)) return false;
            columns += dims.data()[s];
        }
        if (columns != rows.size(2)) return false;
        next = std::lower_bound(first.data(), first.data() + count, begin) - first.data();
        for (std::ptrdiff_t i = next; i < count && first.data()[i] < end; ++i) {
            const std::int64_t k = first.data()[i];
            for (std::ptrdiff_t s = 0; s < slots; ++s) {
                const std::int64_t place = places.data()[i * slots + s], dim = dims.data()[s];
                if (place >= 0 ? place > width[k - begin] - dim : place < -shared || -1 - place > shared - dim) return false;
            }
        }
        return true;
    }

    // How many rows the factors have whose first keyframe is `k`, the factors of earlier ones having been copied.
    std::ptrdiff_t height(std::int64_t k) const {
        std::ptrdiff_t i = next;
        while (i < rows.size(0) && first.data()[i] == k) ++i;
        return (i - next) * rows.size(1);
    }

    // Copy these into rows of A from `row` on; the window is `width` wide. Returns the row behind them.
    std::ptrdiff_t copy(std::int64_t k, Rows &A, std::ptrdiff_t row, std::ptrdiff_t width, std::ptrdiff_t tail) {
        const std::ptrdiff_t tall = rows.size(1), columns = rows.size(2), slots = dims.size(0);
        for (; next < rows.size(0) && first.data()[next] == k; ++next)
            for (std::ptrdiff_t r = 0; r < tall; ++r, ++row) {
                const double *from = rows.data() + (next * tall + r) * columns;
                for (std::ptrdiff_t s = 0; s < slots; ++s) {
                    const std::int64_t place = places.data()[next * slots + s], dim = dims.data()[s];
                    double *to = A.row(row) + (place >= 0 ? place : width - 1 - place);
                    for (std::int64_t c = 0; c < dim; ++c) to[c] = from[c];
                    from += dim;
                }
                A.row(row)[width + tail - 1] = *from;
            }
        return row;
    }

    const Doubles rows;
    const Integers first, places, dims;
    std::ptrdiff_t next = 0;
};

// Rows of the shared variables alone, of which never more are kept than a few times their columns.
struct Alone {
    Alone(std::ptrdiff_t tail_) : tail(tail_) { kept.shape(most(), tail); }

    std::ptrdiff_t most() const { return 4 * tail; }

    void add(const double *row, Workspace &work) {
        if (count == most()) compress(work);
        std::memcpy(kept.row(count++), row, tail * sizeof(double));
    }

    // Make them a triangle.
    void compress(Workspace &work) {
        triangularise(kept, count, tail, work);
        count = count < tail ? count : tail;
    }

    const std::ptrdiff_t tail;
    Rows kept;
    std::ptrdiff_t count = 0;
};

// Where the conditional of a keyframe goes.
struct Conditional {
    double *R, *S, *d, *beyond;
};

// Write it, with a positive diagonal. False where its triangle is singular.
bool write_conditional(Rows &A, std::ptrdiff_t width, const Layout &at, double indeterminate, const Conditional &out) {
    const std::ptrdiff_t K = at.keyframe, shared = at.tail - 1;
    for (std::ptrdiff_t i = 0; i < K; ++i) {
        const double *row = A.row(i), sign = std::copysign(1.0, row[i]);
        double length = 0.0;
        for (std::ptrdiff_t j = 0; j <= i; ++j) length += A.row(j)[i] * A.row(j)[i];
        if (!(std::abs(row[i]) > indeterminate * std::sqrt(length))) return false;
        for (std::ptrdiff_t j = i; j < K; ++j) out.R[i * K + j] = sign * row[j];
        double *S = out.S + i * (K + shared);
        for (std::ptrdiff_t j = 0; j < K; ++j) S[j] = sign * row[K + j];
        for (std::ptrdiff_t j = 0; j < shared; ++j) S[K + j] = sign * row[width + j];
        for (std::ptrdiff_t j = at.pair(); j < width; ++j) out.beyond[(j - at.pair()) * K + i] = sign * row[j];
        out.d[i] = sign * row[width + shared];
    }
    return true;
}

}  // namespace

// eliminate(begin, widths, (nav_start, nav_dim), indeterminate, left, left rows, R, S, d, beyond, alone, *families)
//     -> (left rows, alone rows)
//
// Of n keyframes from number `begin` on. widths (n + 2,): of the windows of the keyframe before the first, of the n, and of the one after,
// which is 0 where the chain ends. left (rows, ...): what the keyframe before left over, as many of its rows as
// left_rows, overwritten by what is left over in the end. R (n, K, K) comes zeroed; S (n, K, K + tail - 1), d (n, K) and
// beyond (columns of all windows beyond two keyframes, K) need not; alone (tail, tail) takes a triangle of the rows of
// the shared variables alone. Each family is four arrays: rows (m, r, columns) [A b]; first (m,), ascending, the
// keyframe of each, of which those of other keyframes than the n are left out; places (m, slots), the column of the window at which each slot's variables begin, or -1 - the column
// behind the window where they are shared; dims (slots,). None where the rows do not determine a keyframe.
PyObject *eliminate(PyObject *, PyObject *arguments) {
    constexpr Py_ssize_t OWN = 11, OF_FAMILY = 4;
    const Py_ssize_t given = PyTuple_Size(arguments);
    if (given < OWN || (given - OWN) % OF_FAMILY != 0) return refused("families");
    PyObject *own = PyTuple_GetSlice(arguments, 0, OWN);
    if (own == nullptr) return nullptr;
    PyObject *py_widths, *py_left, *py_R, *py_S, *py_d, *py_beyond, *py_alone;
    Py_ssize_t begin, nav_start, nav, left_rows;
    double indeterminate;
    const int parsed = PyArg_ParseTuple(own, "nO(nn)dOnOOOOO", &begin, &py_widths, &nav_start, &nav, &indeterminate, &py_left,
                                        &left_rows, &py_R, &py_S, &py_d, &py_beyond, &py_alone);
    Py_DECREF(own);  // the arguments have references, too
    if (!parsed) return nullptr;
    const Integers widths(py_widths, 1);
    const Doubles left(py_left, 1, true), R(py_R, 3, true), S(py_S, 3, true), d(py_d, 2, true);
    const Doubles beyond(py_beyond, 2, true), alone(py_alone, 2, true);
    if (!widths.ok() || !left.ok() || !R.ok() || !S.ok() || !d.ok() || !beyond.ok() || !alone.ok()) return nullptr;
    const std::ptrdiff_t n = R.size(0);
    const Layout at{R.size(1), nav_start, nav, alone.size(1)};
    const std::ptrdiff_t K = at.keyframe, tail = at.tail;
    if (widths.size(0) != n + 2 || S.size(0) != n || S.size(1) != K || d.size(0) != n || d.size(1) != K ||
        R.size(2) != K || tail < 1 || S.size(2) != K + tail - 1 || beyond.size(1) != K || alone.size(0) != tail ||
        nav_start < 0 || nav < 1 || nav > K - nav_start)
        return refused("keyframes");
    if (begin < 0 || begin > PTRDIFF_MAX - n) return refused("the first keyframe");
    const std::int64_t *width = widths.data() + 1;
    std::ptrdiff_t widest = at.pair(), columns_beyond = 0;
    for (std::ptrdiff_t k = -1; k <= n; ++k) {
        const bool end_of_chain = k == n && width[k] == 0;
        if (!end_of_chain && (width[k] < at.pair() || (width[k] - at.pair()) % nav != 0)) return refused("widths");
        if (k >= 0 && width[k] < width[k - 1] - nav && !end_of_chain) return refused("widths of neighbours");
        widest = width[k] > widest ? width[k] : widest;
        if (k < 0 || k == n) continue;
        if (width[k] - at.pair() > beyond.size(0)) return refused("rows beyond");
        columns_beyond += width[k] - at.pair();
    }
    if (beyond.size(0) != columns_beyond) return refused("rows beyond");
    const std::ptrdiff_t most_left = widest - K;
    if (left_rows < 0 || left_rows > most_left || most_left > left.total() ||
        left.total() < most_left * (most_left + tail))
        return refused("rows left over");
    std::deque<Family> families;
    for (Py_ssize_t i = OWN; i < given; i += OF_FAMILY) {
        families.emplace_back(PyTuple_GetItem(arguments, i), PyTuple_GetItem(arguments, i + 1),
                              PyTuple_GetItem(arguments, i + 2), PyTuple_GetItem(arguments, i + 3));
        if (!families.back().ok()) return nullptr;
        if (!families.back().take(begin, begin + n, width, tail - 1)) return refused("factors of a family");
    }

    bool determined = true;
    std::ptrdiff_t alone_rows = 0;
    Py_BEGIN_ALLOW_THREADS;
    Rows A;
    Workspace work;
    Alone rest(tail);
    double *own_beyond = beyond.data();
    for (std::ptrdiff_t k = 0; k < n && determined; ++k) {
        const std::ptrdiff_t columns = width[k] + tail, left_columns = width[k - 1] - K + tail;
        std::ptrdiff_t total = left_rows;
        for (const Family &one : families) total += one.height(begin + k);
        A.shape(total > K ? total : K, columns);
        for (std::ptrdiff_t i = 0; i < left_rows; ++i)
            at.to_next(left.data() + i * left_columns, width[k - 1], A.row(i), width[k]);
        std::ptrdiff_t row = left_rows;
        for (Family &one : families) row = one.copy(begin + k, A, row, width[k], tail);
        const std::ptrdiff_t pivots = width[k + 1] == 0 ? K : width[k];  // behind the last keyframe nothing is carried
        triangularise(A, total, pivots, work);
        const Conditional out{R.data() + k * K * K, S.data() + k * K * S.size(2), d.data() + k * K, own_beyond};
        determined = total >= K && write_conditional(A, width[k], at, indeterminate, out);
        if (!determined) break;
        own_beyond += (width[k] - at.pair()) * K;
        const std::ptrdiff_t end = total < pivots ? total : pivots;
        left_rows = end - K;
        for (std::ptrdiff_t i = 0; i < left_rows; ++i)
            std::memcpy(left.data() + i * (columns - K), A.row(K + i) + K, (columns - K) * sizeof(double));
        for (std::ptrdiff_t i = end; i < total; ++i) rest.add(A.row(i) + width[k], work);
    }
    rest.compress(work);
    alone_rows = rest.count;
    for (std::ptrdiff_t i = 0; i < alone_rows; ++i)
        std::memcpy(alone.data() + i * tail, rest.kept.row(i), tail * sizeof(double));
    Py_END_ALLOW_THREADS;
    if (!determined) Py_RETURN_NONE;
    return Py_BuildValue("nn", left_rows, alone_rows);
}

// Take rows (count, n + 1) into an upper triangle of n rows and n + 1 columns, by one reflection a column, of its row on the
// diagonal and of these: all rows between are zero there.
WITH_VECTOR_UNITS
void add_rows(Rows &A, double *rows, std::ptrdiff_t count, std::ptrdiff_t n) {
    const std::ptrdiff_t columns = n + 1;
    std::vector<double> products(columns);
    for (std::ptrdiff_t j = 0; j < n; ++j) {
        double *own = A.row(j), squares = 0.0;
        for (std::ptrdiff_t i = 0; i < count; ++i) squares += rows[i * columns + j] * rows[i * columns + j];
        if (squares == 0.0) continue;
        const double length = -std::copysign(std::sqrt(own[j] * own[j] + squares), own[j]), first = own[j] - length;
        double *product = products.data();
        for (std::ptrdiff_t c = j + 1; c < columns; ++c) product[c] = first * own[c];
        for (std::ptrdiff_t i = 0; i < count; ++i) {
            const double *row = rows + i * columns, by = row[j];
            for (std::ptrdiff_t c = j + 1; c < columns; ++c) product[c] += by * row[c];
        }
        for (std::ptrdiff_t c = j + 1; c < columns; ++c) own[c] += (product[c] /= length * first) * first;
        for (std::ptrdiff_t i = 0; i < count; ++i) {
            double *row = rows + i * columns;
            const double by = row[j];
            for (std::ptrdiff_t c = j + 1; c < columns; ++c) row[c] += by * product[c];
        }
        own[j] = length;
    }
}

// triangle(rows (m, n), out (min(m, n), n)): R of the QR of some rows, zero below its diagonal.
PyObject *triangle(PyObject *, PyObject *arguments) {
    PyObject *py[2];
    if (!PyArg_ParseTuple(arguments, "OO", &py[0], &py[1])) return nullptr;
    const Doubles given(py[0], 2), out(py[1], 2, true);
    if (!given.ok() || !out.ok()) return nullptr;
    const std::ptrdiff_t count = given.size(0), columns = given.size(1), kept = std::min(count, columns);
    if (out.size(0) != kept || out.size(1) != columns) return refused("rows and a triangle");
    Rows A;
    Workspace work;
    A.shape(count, columns);
    for (std::ptrdiff_t i = 0; i < count; ++i) std::copy_n(given.data() + i * columns, columns, A.row(i));
    triangularise(A, count, columns, work);
    std::fill_n(out.data(), out.total(), 0.0);
    for (std::ptrdiff_t i = 0; i < kept; ++i)
        std::copy(A.row(i) + i, A.row(i) + columns, out.data() + i * columns + i);
    Py_RETURN_NONE;
}

// eliminate_pair(triangle (t, n), further (m, n), indeterminate, R (2, K, K), S (2, K, n - 1 - K), d (2, K), R_shared (s, s), d_shared (s),
// marginal (n - 1 - K, n - K)): the square root of the information in rows [A b] of two keyframes and the shared variables,
// an upper triangle and further rows, with a positive diagonal, and what the first keyframe leaves for the others. Returns
// whether the rows determine all.
PyObject *eliminate_pair(PyObject *, PyObject *arguments) {
    PyObject *py[8];
    double indeterminate;
    if (!PyArg_ParseTuple(arguments, "OOdOOOOOO", &py[0], &py[7], &indeterminate, &py[1], &py[2], &py[3], &py[4], &py[5],
                          &py[6]))
        return nullptr;
    const Doubles given(py[0], 2), further(py[7], 2), R(py[1], 3, true), S(py[2], 3, true), d(py[3], 2, true), R_shared(py[4], 2, true),
        d_shared(py[5], 1, true), marginal(py[6], 2, true);
    if (!given.ok() || !further.ok() || !R.ok() || !S.ok() || !d.ok() || !R_shared.ok() || !d_shared.ok() || !marginal.ok()) return nullptr;
    const std::ptrdiff_t K = R.size(1), shared = d_shared.size(0), n = 2 * K + shared, behind = n - K;
    if (given.size(1) != n + 1 || further.size(1) != n + 1 || R.size(0) != 2 || R.size(2) != K || S.size(0) != 2 || S.size(1) != K ||
        S.size(2) != behind || d.size(0) != 2 || d.size(1) != K || R_shared.size(0) != shared ||
        R_shared.size(1) != shared || marginal.size(0) != behind || marginal.size(1) != behind + 1)
        return refused("rows of a pair");
    const std::ptrdiff_t count = std::min(given.size(0), n), columns = n + 1;
    Rows A;
    A.shape(n, columns);
    for (std::ptrdiff_t i = 0; i < n; ++i) {
        std::fill_n(A.row(i), columns, 0.0);
        if (i < count) std::copy(given.data() + i * columns + i, given.data() + (i + 1) * columns, A.row(i) + i);
    }
    std::vector<double> rest(further.data(), further.data() + further.total());
    add_rows(A, rest.data(), further.size(0), n);
    for (const Doubles *out : {&R, &S, &R_shared, &marginal}) std::fill_n(out->data(), out->total(), 0.0);
    for (std::ptrdiff_t i = 0; i < n; ++i) {
        double *row = A.row(i), length = 0.0;
        for (std::ptrdiff_t j = 0; j <= i; ++j) length += A.row(j)[i] * A.row(j)[i];
        if (!(std::abs(row[i]) > indeterminate * std::sqrt(length))) Py_RETURN_FALSE;
        if (row[i] < 0.0)
            for (std::ptrdiff_t j = i; j <= n; ++j) row[j] = -row[j];
        if (i >= K) std::copy(row + i, row + n + 1, marginal.data() + (i - K) * (behind + 1) + i - K);
        if (i >= 2 * K) {
            std::copy(row + i, row + n, R_shared.data() + (i - 2 * K) * shared + i - 2 * K);
            d_shared.data()[i - 2 * K] = row[n];
            continue;
        }
        const std::ptrdiff_t end = i < K ? K : 2 * K;  // of the own keyframe's columns
        std::copy(row + i, row + end, R.data() + i * K + i % K);
        std::copy(row + end, row + n, S.data() + i * behind + end - K);
        d.data()[i] = row[n];
    }
    Py_RETURN_TRUE;
}
