// Arguments of the kernels are arrays that Python made: buffers of doubles, 64-bit integers or truth values, contiguous in C order, at
// addresses that a processor reads at once.
#pragma once

#define Py_LIMITED_API 0x030B0000  // Py_buffer is part of it since Python 3.11: one build serves every later version
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>

// Compile a function for the vector units that processors differ in; the loader chooses (GNU C library on x86-64). By
// names of units: by names of processors it would choose none on those of other makers.
#if defined(__x86_64__) && defined(__gnu_linux__) && defined(__GNUC__) && !defined(__clang__)
#define WITH_VECTOR_UNITS __attribute__((target_clones("avx512f", "fma", "default")))
#else
#define WITH_VECTOR_UNITS
#endif

// Whether a buffer of numbers of so many bytes lies where a processor reads them at once; an exception is set where not.
inline bool is_aligned(const Py_buffer &view, std::size_t bytes) {
    if (view.len == 0 || reinterpret_cast<std::uintptr_t>(view.buf) % bytes == 0) return true;
    PyErr_Format(PyExc_ValueError, "expected an array at an address that is a multiple of %d bytes",
                 static_cast<int>(bytes));
    return false;
}

// The format of a buffer without a byte order where that is the processor's own: arrays of some files declare it.
inline const char *in_own_order(const char *format) {
    const std::uint16_t one = 1;
    const char own = *reinterpret_cast<const std::uint8_t *>(&one) == 1 ? '<' : '>';
    return *format == own || *format == '=' || *format == '@' ? format + 1 : format;
}

// One argument: its buffer is held until the kernel returns. Check `ok()` before use; an exception is set where not.
template <typename Number>
class Array {
  public:
    Array(PyObject *object, int dimensions, bool writable = false) {
        const int flags = PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (writable ? PyBUF_WRITABLE : 0);
        if (PyObject_GetBuffer(object, &view_, flags) != 0) return;
        held_ = true;
        const char *format = view_.format == nullptr ? "B" : in_own_order(view_.format);
        const bool integer = std::strcmp(format, "l") == 0 || std::strcmp(format, "q") == 0;
        const bool right_type = std::is_same_v<Number, double>         ? std::strcmp(format, "d") == 0
                                : std::is_same_v<Number, std::uint8_t> ? std::strcmp(format, "?") == 0
                                                                       : integer;
        if (!right_type || view_.itemsize != sizeof(Number) || view_.ndim != dimensions) {
            PyErr_Format(PyExc_TypeError, "expected an array of %d dimensions of %s, and not of %d of format '%s'",
                         dimensions, NUMBERS, view_.ndim, format);
            return;
        }
        ok_ = is_aligned(view_, alignof(Number));
    }
    ~Array() {
        if (held_) PyBuffer_Release(&view_);
    }
    Array(const Array &) = delete;
    Array &operator=(const Array &) = delete;

    bool ok() const { return ok_; }
    Number *data() const { return static_cast<Number *>(view_.buf); }
    std::ptrdiff_t size(int axis) const { return view_.shape[axis]; }
    std::ptrdiff_t total() const { return view_.len / static_cast<std::ptrdiff_t>(sizeof(Number)); }

  private:
    static constexpr const char *NUMBERS = std::is_same_v<Number, double>         ? "doubles"
                                           : std::is_same_v<Number, std::uint8_t> ? "truth values"
                                                                                  : "64-bit integers";
    Py_buffer view_{};
    bool held_ = false, ok_ = false;
};

using Doubles = Array<double>;
using Integers = Array<std::int64_t>;
using Flags = Array<std::uint8_t>;

// Refuse arguments that do not belong together; a kernel would write beyond them.
inline PyObject *refused(const char *what) {
    PyErr_Format(PyExc_ValueError, "arrays of sizes that do not belong together: %s", what);
    return nullptr;
}

PyObject *eliminate(PyObject *, PyObject *arguments);
PyObject *eliminate_pair(PyObject *, PyObject *arguments);
PyObject *triangle(PyObject *, PyObject *arguments);
PyObject *back_substitute(PyObject *, PyObject *arguments);
PyObject *forward_substitute(PyObject *, PyObject *arguments);
PyObject *covariances(PyObject *, PyObject *arguments);
PyObject *preintegrate(PyObject *, PyObject *arguments);
PyObject *inertial_factors(PyObject *, PyObject *arguments);
PyObject *predict(PyObject *, PyObject *arguments);
PyObject *predict_interval(PyObject *, PyObject *arguments);
PyObject *noise_floor(PyObject *, PyObject *arguments);
PyObject *noise_seen(PyObject *, PyObject *arguments);
PyObject *white_noise(PyObject *, PyObject *arguments);
PyObject *interpolate_columns(PyObject *, PyObject *arguments);
PyObject *compress(PyObject *, PyObject *arguments);
PyObject *turning(PyObject *, PyObject *arguments);
PyObject *ahead_of_a_steady_turn(PyObject *, PyObject *arguments);
PyObject *means_around(PyObject *, PyObject *arguments);
PyObject *tach_interval(PyObject *, PyObject *arguments);
PyObject *pair_rows(PyObject *, PyObject *arguments);
PyObject *linear_rows(PyObject *, PyObject *arguments);
PyObject *marginal_prior(PyObject *, PyObject *arguments);
PyObject *retract(PyObject *, PyObject *arguments);
PyObject *step_from(PyObject *, PyObject *arguments);
PyObject *marginalised_states(PyObject *, PyObject *arguments);
PyObject *quantities(PyObject *, PyObject *arguments);
PyObject *quantity_variances(PyObject *, PyObject *arguments);
PyObject *trajectory_rows(PyObject *, PyObject *arguments);
PyObject *spread(PyObject *, PyObject *arguments);
PyObject *dense_motion(PyObject *, PyObject *arguments);
PyObject *hermite_at(PyObject *, PyObject *arguments);
PyObject *resample(PyObject *, PyObject *arguments);
PyObject *add_weighted_rows(PyObject *, PyObject *arguments);
PyObject *add_up_rows(PyObject *, PyObject *arguments);
PyObject *switch_chain(PyObject *, PyObject *arguments);
PyObject *median_step(PyObject *, PyObject *arguments);
PyObject *cauchy_fit(PyObject *, PyObject *arguments);
PyObject *spill(PyObject *, PyObject *arguments);
PyObject *unspill(PyObject *, PyObject *arguments);

extern const std::ptrdiff_t DELTA_SIZE;  // numbers that preintegrate() writes of an interval
