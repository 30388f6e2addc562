// Robust estimates: cauchy_fit of trackfg.numerics.robust, and the usual step of times.
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "arrays.h"
#include "median.h"

namespace {

// In the order of _LIMITS in robust.py, which says what they are.
struct Limits {
    double cauchy, settled, rounds, sd_per_mad;
};

// A symmetric positive definite matrix (c, c), of which the lower triangle is given, by its Cholesky factor.
class Factored {
  public:
    explicit Factored(std::ptrdiff_t size) : size_(size), lower_(size * size) {}

    // Whether the matrix has a factor: the numbers are finite, and none of the pivots vanishes.
    bool of(const std::vector<double> &matrix) {
        for (std::ptrdiff_t i = 0; i < size_; ++i)
            for (std::ptrdiff_t j = 0; j <= i; ++j) {
                double rest = matrix[i * size_ + j];
                for (std::ptrdiff_t k = 0; k < j; ++k) rest -= lower_[i * size_ + k] * lower_[j * size_ + k];
                if (i == j && !(rest > 0.0)) return false;
                lower_[i * size_ + j] = i == j ? std::sqrt(rest) : rest / lower_[j * size_ + j];
            }
        return true;
    }

    // Solve in place for a right-hand side (c) whose first `zeros` numbers are 0.
    void forward(double *x, std::ptrdiff_t zeros = 0) const {
        for (std::ptrdiff_t i = zeros; i < size_; ++i) {
            for (std::ptrdiff_t k = zeros; k < i; ++k) x[i] -= lower_[i * size_ + k] * x[k];
            x[i] /= lower_[i * size_ + i];
        }
    }

    void solve(double *x) const {
        forward(x);
        for (std::ptrdiff_t i = size_ - 1; i >= 0; --i) {
            for (std::ptrdiff_t k = i + 1; k < size_; ++k) x[i] -= lower_[k * size_ + i] * x[k];
            x[i] /= lower_[i * size_ + i];
        }
    }

    // A diagonal element of the inverse: the squared length of a column of the factor's inverse.
    double inverse(std::ptrdiff_t j) const {
        std::vector<double> column(size_);
        column[j] = 1.0;
        forward(column.data(), j);
        double square = 0.0;
        for (std::ptrdiff_t i = j; i < size_; ++i) square += column[i] * column[i];
        return square;
    }

  private:
    std::ptrdiff_t size_;
    std::vector<double> lower_;
};

struct Fit {
    const double *rows, *right, *precision;
    std::ptrdiff_t count, size;
    double least_sd, per_value;

    // Write coefficients (c) and their standard deviations (c); whether each round had one solution.
    bool write(const Limits &limits, double *coefficients, double *sd) const {
        std::vector<double> off(right, right + count), weight(count, 1.0), values(count);
        std::vector<double> information(size * size), solution(size);
        std::fill(coefficients, coefficients + size, std::numeric_limits<double>::quiet_NaN());
        Factored factored(size);
        for (int round = 0; round < static_cast<int>(limits.rounds); ++round) {
            values = off;
            const double middle = median(values);
            for (std::ptrdiff_t i = 0; i < count; ++i) values[i] = std::fabs(off[i] - middle);
            const double level = std::max(limits.sd_per_mad * median(values), least_sd);
            add_up(weight, per_value * level * level, information, solution);
            if (!factored.of(information)) return false;
            factored.solve(solution.data());
            if (is_short(information, solution.data(), coefficients, limits.settled)) break;
            for (std::ptrdiff_t i = 0; i < count; ++i) {
                off[i] = right[i];
                for (std::ptrdiff_t j = 0; j < size; ++j) off[i] -= rows[i * size + j] * coefficients[j];
                const double far = off[i] / (limits.cauchy * level);
                weight[i] = 1.0 / (1.0 + far * far);
            }
        }
        for (std::ptrdiff_t j = 0; j < size; ++j) sd[j] = std::sqrt(factored.inverse(j));
        return true;
    }

  private:
    // Normal equations: the lower triangle of the information (c, c), and the right-hand side (c).
    void add_up(const std::vector<double> &weight, double variance, std::vector<double> &information,
                std::vector<double> &side) const {
        std::fill(information.begin(), information.end(), 0.0);
        std::fill(side.begin(), side.end(), 0.0);
        for (std::ptrdiff_t i = 0; i < count; ++i) {
            const double *row = rows + i * size;
            for (std::ptrdiff_t j = 0; j < size; ++j) {
                const double weighted = row[j] * weight[i] / variance;
                side[j] += weighted * right[i];
                for (std::ptrdiff_t k = 0; k <= j; ++k) information[j * size + k] += weighted * row[k];
            }
        }
        for (std::ptrdiff_t j = 0; j < size; ++j) information[j * size + j] += precision[j];
    }

    // Take a solution for the coefficients, and whether that moved them by less than `settled` sigmas.
    bool is_short(const std::vector<double> &information, const double *solution, double *coefficients,
                  double settled) const {
        double square = 0.0;
        for (std::ptrdiff_t j = 0; j < size; ++j) {
            const double step = solution[j] - coefficients[j];
            square += information[j * size + j] * step * step;
            for (std::ptrdiff_t k = 0; k < j; ++k)
                square += 2.0 * information[j * size + k] * step * (solution[k] - coefficients[k]);
        }
        std::copy(solution, solution + size, coefficients);
        return square < settled * settled;
    }
};

}  // namespace

// cauchy_fit(rows (n, c), right (n), precision (c), least_sd, per_value, limits, out (2, c)): the coefficients and
// their standard deviations. It returns whether it could: not where numbers are missing or a solution is not unique.
PyObject *cauchy_fit(PyObject *, PyObject *arguments) {
    PyObject *py[5];
    double least_sd, per_value;
    if (!PyArg_ParseTuple(arguments, "OOOddOO", &py[0], &py[1], &py[2], &least_sd, &per_value, &py[3], &py[4]))
        return nullptr;
    const Doubles rows(py[0], 2), right(py[1], 1), precision(py[2], 1), limits(py[3], 1), out(py[4], 2, true);
    if (!rows.ok() || !right.ok() || !precision.ok() || !limits.ok() || !out.ok()) return nullptr;
    const std::ptrdiff_t n = rows.size(0), c = rows.size(1);
    if (right.size(0) != n || precision.size(0) != c) return refused("rows");
    if (limits.total() != static_cast<std::ptrdiff_t>(sizeof(Limits) / sizeof(double))) return refused("limits");
    if (out.size(0) != 2 || out.size(1) != c) return refused("results");
    bool done = false;
    Py_BEGIN_ALLOW_THREADS;
    if (n > 0) {
        Limits of;
        std::memcpy(&of, limits.data(), sizeof of);
        const Fit fit{rows.data(), right.data(), precision.data(), n, c, least_sd, per_value};
        done = fit.write(of, out.data(), out.data() + c);
    }
    Py_END_ALLOW_THREADS;
    return PyBool_FromLong(done);
}

// median_step(values (n + 1)): the median of the differences of neighbours, of which there is one or more.
PyObject *median_step(PyObject *, PyObject *arguments) {
    PyObject *py;
    if (!PyArg_ParseTuple(arguments, "O", &py)) return nullptr;
    const Doubles values(py, 1);
    if (!values.ok()) return nullptr;
    if (values.size(0) < 2) return refused("values");
    std::vector<double> steps(values.size(0) - 1);
    for (std::size_t i = 0; i < steps.size(); ++i) steps[i] = values.data()[i + 1] - values.data()[i];
    return PyFloat_FromDouble(median(steps));
}
