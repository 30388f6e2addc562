// Sums of rows: trackfg.numerics.sums_of_rows.
#include "arrays.h"

namespace {

// Add to each row of `out` (m, columns) its `terms` rows times their weights; a weight of 0 adds nothing.
WITH_VECTOR_UNITS
void add_sums(const double *rows, const std::int64_t *index, const double *weights, std::ptrdiff_t m, std::ptrdiff_t terms,
              std::ptrdiff_t columns, double *out) {
    for (std::ptrdiff_t i = 0; i < m; ++i, out += columns)
        for (std::ptrdiff_t term = 0; term < terms; ++term) {
            const double weight = weights[i * terms + term], *row = rows + index[i * terms + term] * columns;
            if (weight == 0.0) continue;
            for (std::ptrdiff_t j = 0; j < columns; ++j) out[j] += weight * row[j];
        }
}

// Add to each row of `rows` (m, columns) but the first the one before.
WITH_VECTOR_UNITS
void add_up(double *rows, std::ptrdiff_t m, std::ptrdiff_t columns) {
    for (std::ptrdiff_t i = columns; i < m * columns; i += columns)
        for (std::ptrdiff_t j = 0; j < columns; ++j) rows[i + j] += rows[i - columns + j];
}

}  // namespace

// add_weighted_rows(rows (r, s), index (m, c), weights (m, c), out (m, s)): add to each row of `out` those rows times
// their weights.
PyObject *add_weighted_rows(PyObject *, PyObject *arguments) {
    PyObject *py[4];
    if (!PyArg_ParseTuple(arguments, "OOOO", &py[0], &py[1], &py[2], &py[3])) return nullptr;
    const Doubles rows(py[0], 2);
    const Integers index(py[1], 2);
    const Doubles weights(py[2], 2), out(py[3], 2, true);
    if (!rows.ok() || !index.ok() || !weights.ok() || !out.ok()) return nullptr;
    const std::ptrdiff_t m = out.size(0), columns = out.size(1), terms = index.size(1);
    if (rows.size(1) != columns) return refused("rows");
    if (index.size(0) != m || weights.size(0) != m || weights.size(1) != terms) return refused("weights");
    for (std::ptrdiff_t i = 0; i < index.total(); ++i)
        if (index.data()[i] < 0 || index.data()[i] >= rows.size(0)) return refused("indices of rows");
    Py_BEGIN_ALLOW_THREADS;
    add_sums(rows.data(), index.data(), weights.data(), m, terms, columns, out.data());
    Py_END_ALLOW_THREADS;
    Py_RETURN_NONE;
}

// add_up_rows(rows (m, s)): to running sums of the rows, in place.
PyObject *add_up_rows(PyObject *, PyObject *arguments) {
    PyObject *py;
    if (!PyArg_ParseTuple(arguments, "O", &py)) return nullptr;
    const Doubles rows(py, 2, true);
    if (!rows.ok()) return nullptr;
    Py_BEGIN_ALLOW_THREADS;
    add_up(rows.data(), rows.size(0), rows.size(1));
    Py_END_ALLOW_THREADS;
    Py_RETURN_NONE;
}
