// Factors of two keyframes, linearised and stacked: trackfg.solver.pair_rows.
#include <algorithm>
#include <cmath>
#include <vector>

#include "factors.h"
#include "samples.h"

namespace {

constexpr std::ptrdiff_t INERTIAL = 9;  // rows of an inertial factor

// Where variables are among the columns of (x_0, x_1, s).
std::ptrdiff_t column_of(Variable kind, std::int64_t index) {
    std::ptrdiff_t column = kind < OF_MOUNT ? KEYFRAME * index : KEYFRAME;
    for (const Variable before : ORDER) {
        if (before == kind) break;
        column += DIMENSION[before];
    }
    return column;
}

// Rows [A b] over (x_0, x_1, s), which are filled from the first one on.
class Stack {
  public:
    Stack(const Doubles &rows) : rows_(rows.data()), columns_(rows.size(1)) { std::fill_n(rows_, rows.total(), 0.0); }

    void add(const Values &values, const double *delta) {
        double own[INERTIAL * (2 * NAV + BIAS + 1)];
        inertial_factor(delta, values.nav(0), values.nav(1), values.value[OF_BIAS], own, 2 * NAV + BIAS + 1);
        for (const double number : own) bound_ += number * number;
        const std::ptrdiff_t at[] = {column_of(OF_NAV, 0), column_of(OF_NAV, 1), column_of(OF_BIAS, 0)};
        const double *from = own;
        for (std::ptrdiff_t row = 0; row < INERTIAL; ++row, ++next_) {
            from = copied(from, NAV, at[0]), from = copied(from, NAV, at[1]), from = copied(from, BIAS, at[2]);
            from = copied(from, 1, columns_ - 1);
        }
    }

    void add(const Values &values, const Prior &prior) {
        const std::ptrdiff_t shared = prior.columns() - KEYFRAME - 1;
        buffer_.resize(prior.rows() * prior.columns());
        bound_ += prior.linearise(values, buffer_.data(), prior.columns());
        const double *from = buffer_.data();
        for (std::ptrdiff_t row = 0; row < prior.rows(); ++row, ++next_) {
            from = copied(from, KEYFRAME, KEYFRAME * prior.keyframe()), from = copied(from, shared, 2 * KEYFRAME);
            from = copied(from, 1, columns_ - 1);
        }
    }

    void add(const Values &values, const Factors &factors) {
        for (std::ptrdiff_t k = 0; k < factors.count(); ++k) {
            buffer_.assign(factors.rows() * factors.columns(), 0.0);
            bound_ += factors.linearise(values, k, buffer_.data(), factors.columns());
            const double *from = buffer_.data();
            for (std::ptrdiff_t row = 0; row < factors.rows(); ++row, ++next_) {
                for (int slot = 0; slot < factors.slots(); ++slot) {
                    const Variable kind = factors.kind(slot);
                    from = copied(from, DIMENSION[kind], column_of(kind, factors.index(slot, k)));
                }
                from = copied(from, 1, columns_ - 1);
            }
        }
    }

    bool is_finite() const { return std::isfinite(bound_); }

  private:
    // Copy so many numbers into a column of the next row and those behind it; return where the rest of them begins.
    const double *copied(const double *from, std::ptrdiff_t count, std::ptrdiff_t column) {
        std::copy_n(from, count, rows_ + next_ * columns_ + column);
        return from + count;
    }
    double *rows_, bound_ = 0.0;
    std::ptrdiff_t columns_, next_ = 0;
    std::vector<double> buffer_;
};

}  // namespace

// pair_rows(values, deltas (i, DELTA_SIZE), priors, families, rows (r, n + 1)): the factors of two keyframes, `values` as
// States.arrays has them, linearised and stacked over (x_0, x_1, s): inertial factors, of which there is one or none, then
// the priors, tuples of what marginal_prior() takes between `values` and `rows`, then the families, tuples of the type and
// of what linear_rows() takes behind `values`. Returns as linear_rows().
PyObject *pair_rows(PyObject *, PyObject *arguments) {
    PyObject *py[5];
    if (!PyArg_ParseTuple(arguments, "OOOOO", &py[0], &py[1], &py[2], &py[3], &py[4])) return nullptr;
    const Arrays arrays(py[0]);
    if (!arrays.ok()) return nullptr;
    const Values values(arrays);
    if (!values.ok || !values.of_one_run() || values.count[OF_NAV] != 2) return refused("values");
    const Doubles deltas(py[1], 2), rows(py[4], 2, true);
    if (!deltas.ok() || !rows.ok()) return nullptr;
    if (deltas.size(0) > 1 || deltas.size(1) != DELTA_SIZE) return refused("inertial factors");
    if (!PyTuple_Check(py[2]) || !PyTuple_Check(py[3])) return refused("factors");
    std::ptrdiff_t count = INERTIAL * deltas.size(0);
    std::deque<Prior> priors;
    for (Py_ssize_t i = 0; i < PyTuple_Size(py[2]); ++i) {
        PyObject *part[6];
        Py_ssize_t keyframe;
        if (!PyArg_ParseTuple(PyTuple_GetItem(py[2], i), "OnOOOOO", &part[0], &keyframe, &part[1], &part[2], &part[3],
                              &part[4], &part[5]))
            return nullptr;
        priors.emplace_back(part[0], keyframe, part[1], part[2], part[3], part[4], part[5]);
        if (!priors.back().fit(values)) return nullptr;
        if (priors.back().columns() + KEYFRAME > rows.size(1)) return refused("a prior");
        count += priors.back().rows();
    }
    std::deque<Factors> families;
    for (Py_ssize_t i = 0; i < PyTuple_Size(py[3]); ++i) {
        const char *type;
        PyObject *part[3];
        double width;
        if (!PyArg_ParseTuple(PyTuple_GetItem(py[3], i), "sOOOd", &type, &part[0], &part[1], &part[2], &width)) return nullptr;
        families.emplace_back(type, part[0], part[1], part[2], width);
        if (!families.back().fit(values)) return nullptr;
        count += families.back().count() * families.back().rows();
    }
    if (rows.size(0) != count || rows.size(1) < 2 * KEYFRAME + SHARED + 1) return refused("rows");
    Stack stack(rows);
    for (std::ptrdiff_t i = 0; i < deltas.size(0); ++i) stack.add(values, deltas.data());
    for (const Prior &prior : priors) stack.add(values, prior);
    for (const Factors &family : families) stack.add(values, family);
    return PyBool_FromLong(stack.is_finite());
}
