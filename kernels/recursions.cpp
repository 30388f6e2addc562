// Recursions back along a chain of keyframes, as trackfg/solver/square_root.py and covariance.py describe them.
#include <algorithm>
#include <vector>

#include "arrays.h"

namespace {

// The conditionals R_k x_k + S_k y_k, with y_k = (x_{k+1}, s, navigation states of k + 2 and so on).
class Conditionals {
  public:
    // `before`: how many navigation states the keyframe before the first has ahead.
    Conditionals(PyObject *R, PyObject *S, PyObject *beyond, PyObject *ahead, std::ptrdiff_t nav_start,
                 std::ptrdiff_t nav, std::ptrdiff_t before = 0)
        : R_(R, 3), S_(S, 3), beyond_(beyond, 2), ahead_(ahead, 1), nav_start_(nav_start), nav_(nav), before_(before) {}

    bool ok() const { return R_.ok() && S_.ok() && beyond_.ok() && ahead_.ok(); }

    // Whether the arrays belong together; to be asked before anything else.
    bool fits() {
        const std::ptrdiff_t K = R_.size(1);
        if (n() < 1 || K < 1 || R_.size(2) != K || S_.size(0) != n() || S_.size(1) != K || S_.size(2) < K ||
            beyond_.size(1) != K || ahead_.size(0) != n() || nav_start_ < 0 || nav_ < 1 || nav_ > K - nav_start_ ||
            before_ < 0 || before_ > reach(0) + 1)
            return false;
        widest_ = width(-1);
        const std::ptrdiff_t most = beyond_.size(0) / nav_;
        begins_.assign(1, 0);
        for (std::ptrdiff_t k = 0; k < n(); ++k) {
            if (reach(k) < 0 || reach(k) > most || reach(k) < reach(k - 1) - 1) return false;
            begins_.push_back(begins_.back() + nav_ * reach(k));
            if (begins_.back() > beyond_.size(0)) return false;
            widest_ = width(k) > widest_ ? width(k) : widest_;
        }
        return begins_.back() == beyond_.size(0);
    }

    std::ptrdiff_t n() const { return R_.size(0); }
    std::ptrdiff_t dim() const { return R_.size(1); }
    std::ptrdiff_t size() const { return S_.size(2); }      // of (x_k, s)
    std::ptrdiff_t widest() const { return widest_; }
    std::ptrdiff_t reach(std::ptrdiff_t k) const { return k < 0 ? before_ : ahead_.data()[k]; }
    std::ptrdiff_t width(std::ptrdiff_t k) const { return size() + nav_ * reach(k); }  // of y_k
    const double *R(std::ptrdiff_t k) const { return R_.data() + k * dim() * dim(); }

    // Write -S_k (K, width).
    void minus_S(std::ptrdiff_t k, double *out) const {
        const std::ptrdiff_t K = dim(), p = width(k);
        const double *S = S_.data() + k * K * size(), *beyond = beyond_.data() + begins_[k] * K;
        for (std::ptrdiff_t i = 0; i < K; ++i) {
            for (std::ptrdiff_t c = 0; c < size(); ++c) out[i * p + c] = -S[i * size() + c];
            for (std::ptrdiff_t c = size(); c < p; ++c) out[i * p + c] = -beyond[(c - size()) * K + i];
        }
    }

    // Where in y_k the entry `c` of y_{k-1} is that stands behind x_k.
    std::ptrdiff_t kept(std::ptrdiff_t c) const {
        if (c < size()) return c;
        return c < size() + nav_ ? nav_start_ + c - size() : c - nav_;  // that of x_{k+1} comes first
    }

  private:
    const Doubles R_, S_, beyond_;
    const Integers ahead_;
    const std::ptrdiff_t nav_start_, nav_, before_;
    std::vector<std::ptrdiff_t> begins_;
    std::ptrdiff_t widest_ = 0;
};

// Add A B to C: A (1, inner), B (inner, columns). Four rows of B at a time.
WITH_VECTOR_UNITS
void add_row(const double *A, const double *B, double *C, std::ptrdiff_t inner, std::ptrdiff_t columns) {
    std::ptrdiff_t l = 0;
    for (; l + 4 <= inner; l += 4) {
        const double *b = B + l * columns, a0 = A[l], a1 = A[l + 1], a2 = A[l + 2], a3 = A[l + 3];
        for (std::ptrdiff_t j = 0; j < columns; ++j)
            C[j] += (a0 * b[j] + a1 * b[columns + j]) + (a2 * b[2 * columns + j] + a3 * b[3 * columns + j]);
    }
    for (; l < inner; ++l)
        for (std::ptrdiff_t j = 0; j < columns; ++j) C[j] += A[l] * B[l * columns + j];
}

// The same of two rows of A and C, for which B is read once.
WITH_VECTOR_UNITS
void add_two_rows(const double *A, const double *B, double *C, std::ptrdiff_t inner, std::ptrdiff_t columns) {
    double *__restrict c = C, *__restrict f = C + columns;
    const double *E = A + inner;
    std::ptrdiff_t l = 0;
    for (; l + 4 <= inner; l += 4) {
        const double *b = B + l * columns, a0 = A[l], a1 = A[l + 1], a2 = A[l + 2], a3 = A[l + 3];
        const double e0 = E[l], e1 = E[l + 1], e2 = E[l + 2], e3 = E[l + 3];
        for (std::ptrdiff_t j = 0; j < columns; ++j) {
            const double b0 = b[j], b1 = b[columns + j], b2 = b[2 * columns + j], b3 = b[3 * columns + j];
            c[j] += (a0 * b0 + a1 * b1) + (a2 * b2 + a3 * b3);
            f[j] += (e0 * b0 + e1 * b1) + (e2 * b2 + e3 * b3);
        }
    }
    for (; l < inner; ++l)
        for (std::ptrdiff_t j = 0; j < columns; ++j) {
            c[j] += A[l] * B[l * columns + j];
            f[j] += E[l] * B[l * columns + j];
        }
}

// Add A B to C: A (rows, inner), B (inner, columns).
void add_product(const double *A, const double *B, double *C, std::ptrdiff_t rows, std::ptrdiff_t inner,
                 std::ptrdiff_t columns) {
    std::ptrdiff_t i = 0;
    for (; i + 2 <= rows; i += 2) add_two_rows(A + i * inner, B, C + i * columns, inner, columns);
    for (; i < rows; ++i) add_row(A + i * inner, B, C + i * columns, inner, columns);
}

// Solve R x = b (K, columns) in place; R is an upper triangle.
WITH_VECTOR_UNITS
void solve_triangle(const double *R, double *b, std::ptrdiff_t K, std::ptrdiff_t columns) {
    for (std::ptrdiff_t i = K - 1; i >= 0; --i) {
        double *own = b + i * columns;
        for (std::ptrdiff_t l = i + 1; l < K; ++l) {
            const double r = R[i * K + l], *later = b + l * columns;
            for (std::ptrdiff_t j = 0; j < columns; ++j) own[j] -= r * later[j];
        }
        const double inverse = 1.0 / R[i * K + i];
        for (std::ptrdiff_t j = 0; j < columns; ++j) own[j] *= inverse;
    }
}

// Solve R' x = b (K, columns) in place; R is an upper triangle.
WITH_VECTOR_UNITS
void solve_transposed(const double *R, double *b, std::ptrdiff_t K, std::ptrdiff_t columns) {
    for (std::ptrdiff_t i = 0; i < K; ++i) {
        double *own = b + i * columns;
        const double inverse = 1.0 / R[i * K + i];
        for (std::ptrdiff_t j = 0; j < columns; ++j) own[j] *= inverse;
        for (std::ptrdiff_t l = i + 1; l < K; ++l) {
            const double r = R[i * K + l];
            double *later = b + l * columns;
            for (std::ptrdiff_t j = 0; j < columns; ++j) later[j] -= r * own[j];
        }
    }
}

void transpose(const double *A, std::ptrdiff_t rows, std::ptrdiff_t columns, double *out) {
    for (std::ptrdiff_t i = 0; i < rows; ++i)
        for (std::ptrdiff_t j = 0; j < columns; ++j) out[j * rows + i] = A[i * columns + j];
}

}  // namespace

// back_substitute(R, S, beyond, ahead, (nav_start, nav_dim), before, parents, x): from x (n, K, m), right-hand sides, to
// the solution of R_k x_k + S_k y_k = x_k. The first rows of parents (widest y, m) are y_{n-1}; they take y_{-1}, of which
// the keyframe before the first has `before` navigation states ahead.
PyObject *back_substitute(PyObject *, PyObject *arguments) {
    PyObject *R, *S, *beyond, *ahead, *py_parents, *py_x;
    Py_ssize_t nav_start, nav, before;
    if (!PyArg_ParseTuple(arguments, "OOOO(nn)nOO", &R, &S, &beyond, &ahead, &nav_start, &nav, &before, &py_parents, &py_x))
        return nullptr;
    Conditionals own(R, S, beyond, ahead, nav_start, nav, before);
    const Doubles given(py_parents, 2, true), x(py_x, 3, true);
    if (!own.ok() || !given.ok() || !x.ok()) return nullptr;
    if (!own.fits()) return refused("conditionals");
    const std::ptrdiff_t K = own.dim(), m = x.size(2);
    if (x.size(0) != own.n() || x.size(1) != K || given.size(0) != own.widest() || given.size(1) != m)
        return refused("right-hand sides");
    Py_BEGIN_ALLOW_THREADS;
    std::vector<double> S_k(K * own.widest()), next(own.widest() * m);
    std::vector<double> window(given.data(), given.data() + own.widest() * m);
    for (std::ptrdiff_t k = own.n() - 1; k >= 0; --k) {
        double *x_k = x.data() + k * K * m;
        own.minus_S(k, S_k.data());
        add_product(S_k.data(), window.data(), x_k, K, own.width(k), m);
        solve_triangle(own.R(k), x_k, K, m);
        std::memcpy(next.data(), x_k, K * m * sizeof(double));
        for (std::ptrdiff_t c = K; c < own.width(k - 1); ++c)
            std::memcpy(next.data() + c * m, window.data() + own.kept(c) * m, m * sizeof(double));
        window.swap(next);
    }
    std::memcpy(given.data(), window.data(), own.width(-1) * m * sizeof(double));
    Py_END_ALLOW_THREADS;
    Py_RETURN_NONE;
}

// forward_substitute(R, S, beyond, ahead, (nav_start, nav_dim), before, carried, x): from x (n, K, m), right-hand sides of
// the transposed system of keyframes along a chain, to its solution. The first rows of carried (widest y, m) are what is
// to be added to the right-hand sides of y_{-1}, of which the keyframe before the first, that has `before` navigation
// states ahead, is a part; they take what is to be added to those of y_{n-1}.
PyObject *forward_substitute(PyObject *, PyObject *arguments) {
    PyObject *R, *S, *beyond, *ahead, *py_carried, *py_x;
    Py_ssize_t nav_start, nav, before;
    if (!PyArg_ParseTuple(arguments, "OOOO(nn)nOO", &R, &S, &beyond, &ahead, &nav_start, &nav, &before, &py_carried, &py_x))
        return nullptr;
    Conditionals own(R, S, beyond, ahead, nav_start, nav, before);
    const Doubles given(py_carried, 2, true), x(py_x, 3, true);
    if (!own.ok() || !given.ok() || !x.ok()) return nullptr;
    if (!own.fits()) return refused("conditionals");
    const std::ptrdiff_t K = own.dim(), m = x.size(2), n = own.n();
    if (x.size(0) != n || x.size(1) != K || given.size(0) != own.widest() || given.size(1) != m)
        return refused("right-hand sides");
    Py_BEGIN_ALLOW_THREADS;
    std::vector<double> S_k(K * own.widest()), transposed(K * own.widest()), next(own.widest() * m);
    std::vector<double> carried(given.data(), given.data() + own.widest() * m);
    for (std::ptrdiff_t k = 0; k < n; ++k) {
        double *x_k = x.data() + k * K * m;
        const std::ptrdiff_t p = own.width(k);
        for (std::ptrdiff_t i = 0; i < K * m; ++i) x_k[i] += carried[i];
        solve_transposed(own.R(k), x_k, K, m);
        std::fill(next.begin(), next.begin() + p * m, 0.0);
        for (std::ptrdiff_t c = K; c < own.width(k - 1); ++c)
            std::memcpy(next.data() + own.kept(c) * m, carried.data() + c * m, m * sizeof(double));
        own.minus_S(k, S_k.data());
        transpose(S_k.data(), K, p, transposed.data());
        add_product(transposed.data(), x_k, next.data(), p, K, m);
        carried.swap(next);
    }
    std::memcpy(given.data(), carried.data(), own.width(n - 1) * m * sizeof(double));
    Py_END_ALLOW_THREADS;
    Py_RETURN_NONE;
}

// covariances(R, S, beyond, ahead, (nav_start, nav_dim), next, own, cross, wanted, windows): from the covariance of the
// (x_n, s) behind the last keyframe, next (K + s, K + s), which is 0 of x_n where the chain ends, those of x_k with
// (x_k, s), own (n, K, K + s), and with x_{k+1}, cross (n, K, K). Either may have no
// keyframes, if they are not wanted. windows takes those of y_k, one after the other, of the keyframes `wanted`,
// ascending.
PyObject *covariances(PyObject *, PyObject *arguments) {
    PyObject *R, *S, *beyond, *ahead, *py_next, *py_own, *py_cross, *py_wanted, *py_windows;
    Py_ssize_t nav_start, nav;
    if (!PyArg_ParseTuple(arguments, "OOOO(nn)OOOOO", &R, &S, &beyond, &ahead, &nav_start, &nav, &py_next, &py_own,
                          &py_cross, &py_wanted, &py_windows))
        return nullptr;
    Conditionals chain(R, S, beyond, ahead, nav_start, nav);
    const Doubles behind(py_next, 2), own(py_own, 3, true), with_next(py_cross, 3, true), windows(py_windows, 1, true);
    const Integers wanted(py_wanted, 1);
    if (!chain.ok() || !behind.ok() || !own.ok() || !with_next.ok() || !windows.ok() || !wanted.ok()) return nullptr;
    if (!chain.fits()) return refused("conditionals");
    const std::ptrdiff_t n = chain.n(), K = chain.dim(), size = chain.size(), widest = chain.widest();
    if (behind.size(0) != size || behind.size(1) != size) return refused("the keyframe behind");
    for (const Doubles *out : {&own, &with_next})
        if ((out->size(0) != 0 && out->size(0) != n) || out->size(1) != K || out->size(2) != (out == &own ? size : K))
            return refused("keyframes");
    std::ptrdiff_t room = 0, before = -1;
    for (std::ptrdiff_t i = 0; i < wanted.size(0); ++i) {
        const std::int64_t k = wanted.data()[i];
        if (k <= before || k >= n) return refused("wanted keyframes");
        before = k;
        room += chain.width(k) * chain.width(k);
        if (room > windows.size(0)) return refused("windows");
    }
    if (room != windows.size(0)) return refused("windows");
    Py_BEGIN_ALLOW_THREADS;
    std::vector<double> y(widest * widest), next(widest * widest), A(K * widest), A_transposed(K * widest);
    std::vector<double> cross(K * widest), inverse(K * K), inverse_transposed(K * K), own_k(K * K);
    const std::ptrdiff_t last = chain.width(n - 1);
    for (std::ptrdiff_t i = 0; i < size; ++i) std::copy_n(behind.data() + i * size, size, &y[i * last]);
    std::ptrdiff_t left = wanted.size(0);
    for (std::ptrdiff_t k = n - 1; k >= 0; --k) {
        const std::ptrdiff_t p = chain.width(k), q = chain.width(k - 1);
        chain.minus_S(k, A.data());
        solve_triangle(chain.R(k), A.data(), K, p);
        std::fill(cross.begin(), cross.end(), 0.0);
        add_product(A.data(), y.data(), cross.data(), K, p, p);
        std::fill(inverse.begin(), inverse.end(), 0.0);
        for (std::ptrdiff_t i = 0; i < K; ++i) inverse[i * K + i] = 1.0;
        solve_triangle(chain.R(k), inverse.data(), K, K);
        transpose(inverse.data(), K, K, inverse_transposed.data());
        transpose(A.data(), K, p, A_transposed.data());
        std::fill(own_k.begin(), own_k.end(), 0.0);
        add_product(inverse.data(), inverse_transposed.data(), own_k.data(), K, K, K);
        add_product(cross.data(), A_transposed.data(), own_k.data(), K, p, K);
        if (left > 0 && wanted.data()[left - 1] == k) {
            --left;
            room -= p * p;
            std::memcpy(windows.data() + room, y.data(), p * p * sizeof(double));
        }
        if (with_next.size(0) > 0)
            for (std::ptrdiff_t i = 0; i < K; ++i)
                std::memcpy(with_next.data() + (k * K + i) * K, &cross[i * p], K * sizeof(double));
        for (std::ptrdiff_t i = 0; i < K; ++i) {
            for (std::ptrdiff_t j = 0; j < K; ++j) next[i * q + j] = 0.5 * (own_k[i * K + j] + own_k[j * K + i]);
            for (std::ptrdiff_t c = K; c < q; ++c) {
                const double value = cross[i * p + chain.kept(c)];
                next[i * q + c] = value;
                next[c * q + i] = value;
            }
            if (own.size(0) > 0)
                std::memcpy(own.data() + (k * K + i) * size, &next[i * q], size * sizeof(double));
        }
        for (std::ptrdiff_t r = K; r < q; ++r) {
            const double *from = y.data() + chain.kept(r) * p;
            double *to = next.data() + r * q;
            std::copy(from + K, from + size, to + K);  // the shared variables, which stay where they are
            for (std::ptrdiff_t c = size; c < q; ++c) to[c] = from[chain.kept(c)];
        }
        y.swap(next);
    }
    Py_END_ALLOW_THREADS;
    Py_RETURN_NONE;
}
