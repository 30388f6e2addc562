// Factors of the graph as Python gives them to the kernels: those of a type, and the marginal prior.
#pragma once

#include <deque>

#include "states.h"

struct FactorType;  // of factors.cpp

// Factors of one type: its name, which variables each of their slots touches, their data, sigma (m, d) and the width of
// their loss, as linear_rows() says.
class Factors {
  public:
    Factors(const char *type, PyObject *indices, PyObject *data, PyObject *sigma, double width);

    // Whether the arguments belong together and touch variables that there are; an exception is set where not.
    bool fit(const Values &values) const;
    std::ptrdiff_t count() const { return sigma_.size(0); }
    std::ptrdiff_t rows() const { return sigma_.size(1); }  // of one factor
    std::ptrdiff_t columns() const;                         // of [A b]
    int slots() const;
    Variable kind(int slot) const;
    std::int64_t index(int slot, std::ptrdiff_t k) const { return indices_[slot].data()[k]; }
    // Write the rows of factor k into `out`, which holds zeros, of so many columns or b alone where there is 1. Return the
    // sum of their squares before they are whitened.
    double linearise(const Values &values, std::ptrdiff_t k, double *out, std::ptrdiff_t columns) const;

  private:
    const FactorType *type_;
    std::deque<Integers> indices_;
    const Arrays data_;
    const Doubles sigma_;
    double width_;
    bool ok_ = false;
};

// An inertial factor on two states, with the bias at the first: rows (9, columns) as inertial_factors() has them.
void inertial_factor(const double *delta, const NavState &start, const NavState &end, const double *bias, double *out,
                     int columns);

// A marginal prior: what marginal_prior() says of its arguments holds here.
class Prior {
  public:
    Prior(PyObject *sensor, Py_ssize_t keyframe, PyObject *origins, PyObject *sensor_origins, PyObject *A, PyObject *b,
          PyObject *sigma);

    bool fit(const Values &values) const;
    std::ptrdiff_t keyframe() const { return keyframe_; }
    std::ptrdiff_t rows() const { return A_.size(0); }
    std::ptrdiff_t columns() const { return A_.size(1) + 1; }
    // Write all rows, of so many columns or b alone where there is 1. Return as Factors::linearise().
    double linearise(const Values &values, double *out, std::ptrdiff_t columns) const;

  private:
    const Doubles sensor_;
    Py_ssize_t keyframe_;
    const Arrays origins_;
    const Doubles sensor_origins_, A_, b_, sigma_;
};
